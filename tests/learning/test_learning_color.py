"""sRGB and the two color models."""

import pytest
import torch

from relight.learning.color import LINEAR, decode, encode, photograph, quantised


def test_srgb_by_its_published_points():
    assert decode(torch.tensor([0.0, 0.04045, 0.5, 1.0])).tolist() == pytest.approx(
        [0, 0.0031308, 0.2140411, 1], abs=1e-6
    )
    x = torch.linspace(0, 1, 1001)
    torch.testing.assert_close(decode(encode(x)), x, atol=1e-6, rtol=0)


def test_codes_survive():
    assert torch.equal(quantised(LINEAR), torch.arange(256, dtype=torch.uint8))
    assert quantised(torch.tensor([-1.0, 2.0])).tolist() == [0, 255]


def test_photograph():
    relit = torch.tensor([-0.2, 0.3, 1.7])
    assert torch.equal(photograph(relit, "paper"), relit)
    seen = photograph(relit, "photo")
    assert seen[0] == 0 and seen[2] == 1
    code = encode(seen[1]) * 255
    assert code.item() == pytest.approx(round(code.item()), abs=1e-3)
    assert seen[1].item() == pytest.approx(0.3, abs=0.003)
