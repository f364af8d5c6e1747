"""The curve against the standard's formula and printed values; what lies outside [0,1]; types."""

import numpy as np
import pytest

from relight.core.srgb import LINEAR, decode, encode, to_bytes

LINEAR_POINTS, CODE_POINTS = [0, 0.0031308, 0.2140411, 0.5, 1], [0, 0.04045, 0.5, 0.7353570, 1]


def formula(code: float) -> float:
    return code / 12.92 if code <= 0.04045 else ((code + 0.055) / 1.055) ** 2.4


def test_published_points_and_what_is_outside_of_the_range():
    np.testing.assert_allclose(encode(np.array(LINEAR_POINTS)), CODE_POINTS, atol=1e-6)
    np.testing.assert_allclose(decode(np.array(CODE_POINTS)), LINEAR_POINTS, atol=1e-6)
    assert LINEAR[188] == pytest.approx(0.5029, abs=1e-4)
    np.testing.assert_allclose(encode(np.array([-np.inf, -1, 2, np.inf])), [0, 0, 1, 1])
    np.testing.assert_allclose(decode(np.array([-12.92, 2])), [-1, formula(2)])
    assert to_bytes(np.array([-0.3, 0.4999 / 255, 0.5001 / 255, 7])).tolist() == [0, 0, 1, 255]


def test_every_code_returns():
    codes = np.arange(256)
    np.testing.assert_array_equal(LINEAR, np.float32([formula(code / 255) for code in codes]))
    np.testing.assert_array_equal(to_bytes(encode(LINEAR)), codes)
    np.testing.assert_allclose(encode(decode(codes / 255)), codes / 255, atol=1e-7)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("curve", [encode, decode])
def test_types_and_shapes_are_kept(curve, kind):
    values = np.random.default_rng(0).random((3, 4, 3)).astype(kind) * 1.4 - kind(0.2)
    with np.errstate(all="raise"):
        result = curve(values)
    assert result.dtype == kind and result.shape == values.shape
