"""sRGB and the two color models."""

import pytest
import torch

from relight.learning.color import LINEAR, decode, encode, quantised


def test_srgb_by_its_published_points():
    codes, linear = torch.tensor([0.0, 0.04045, 0.5, 1.0]), [0, 0.0031308, 0.2140411, 1]
    assert decode(codes).tolist() == pytest.approx(linear, abs=1e-6)
    x = torch.linspace(0, 1, 1001)
    torch.testing.assert_close(decode(encode(x)), x, atol=1e-6, rtol=0)


def test_codes_survive():
    assert torch.equal(quantised(LINEAR), torch.arange(256, dtype=torch.uint8))
    assert quantised(torch.tensor([-1.0, 2.0])).tolist() == [0, 255]
