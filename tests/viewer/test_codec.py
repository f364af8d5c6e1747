import zlib

import numpy as np
import pytest

from relight.viewer.codec import encode, predictions


def decode(stream, region, predictors):
    """The slow twin of page/codec.js, pixel by pixel: planes (H,W,C) from a stream, zero outside the region."""
    data = np.frombuffer(zlib.decompress(stream), np.uint8).reshape(len(predictors), 2, -1).astype(np.int32)
    folded = data[:, 0] | data[:, 1] << 8
    residuals = (folded >> 1) ^ -(folded & 1)
    values = np.zeros((*region.shape, len(predictors)), np.int32)
    for channel, predictor in enumerate(predictors):
        plane = values[..., channel]
        for (i, j), residual in zip(np.argwhere(region), residuals[channel]):
            has_left, has_up = j > 0 and region[i, j - 1], i > 0 and region[i - 1, j]
            left, up = plane[i, j - 1] if has_left else 0, plane[i - 1, j] if has_up else 0
            left, up = left if has_left else up, up if has_up else left
            has_corner = has_left and has_up and region[i - 1, j - 1]
            corner = plane[i - 1, j - 1] if has_corner else (left + up) >> 1
            plane[i, j] = predictions(left, up, corner)[predictor] + residual
    return values


@pytest.mark.parametrize("seed", range(6))
def test_planes_come_back_in_any_region(seed):
    generator = np.random.default_rng(seed)
    shape = generator.integers(1, 24, 2)
    region = generator.random(shape) < generator.choice([0.0, 0.3, 0.9, 1.0])
    smooth = np.add.outer(np.arange(shape[0]), np.arange(shape[1]))
    planes = np.stack([7 * smooth, smooth**2, generator.integers(-9000, 9000, shape), 0 * smooth], -1)
    back = decode(*[encode(planes, region)[0], region, encode(planes, region)[1]])
    np.testing.assert_array_equal(back, planes * region[..., None])


def test_smooth_planes_shrink_and_too_large_steps_are_refused():
    region = np.ones((64, 64), bool)
    ramp = np.add.outer(3 * np.arange(64), np.arange(64))[..., None]
    assert len(encode(ramp, region)[0]) < 100  # of 4096 values
    with pytest.raises(ValueError, match="16 bits"):
        encode(np.where(np.arange(64) % 2, 40000, -40000)[None, :, None] + 0 * ramp, region)
