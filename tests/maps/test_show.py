"""The picture of the maps shows their values."""

import numpy as np
from PIL import Image

from relight.core.srgb import encode
from relight.maps import Maps, write_maps_picture
from relight.maps.show import BACKGROUND


def test_panels(tmp_path):
    mask = np.zeros((50, 50), bool)
    mask[10:40, 20:35] = True
    inside = mask[..., None]
    transport = np.zeros((50, 50, 9), np.float32)
    transport[..., 0], transport[..., 3] = 0.8862 * mask, -0.5 * mask
    albedo, normal = inside * np.float32([0.5, 0.25, 0.1]), inside * np.float32([0, 0, 1])
    coverage = depth = mask.astype(np.float32)
    write_maps_picture(tmp_path / "a.png", Maps(mask, coverage, albedo, normal, depth, 0.75 * depth, transport))
    shown = np.asarray(Image.open(tmp_path / "a.png"))
    width = 15 + 2  # a margin of a fiftieth of the image on each side
    assert shown.shape[1] == 4 * width and shown.shape[0] > 32
    centers = [shown[16, k * width + 8] for k in range(3)]
    np.testing.assert_array_equal(centers[0], (encode(np.array([0.5, 0.25, 0.1])) * 255).round())
    np.testing.assert_array_equal(centers[1], [128, 128, 255])
    np.testing.assert_array_equal(centers[2], [191, 191, 191])
    assert (shown[0, 0] == round(255 * BACKGROUND)).all()
    row = shown[32:]
    at = [row[row.shape[0] // 2, int((k + 0.5) / 9 * shown.shape[1])].astype(int) for k in range(9)]
    assert at[0][0] > at[0][2] + 50 and at[3][2] > at[3][0] + 50  # positive red, negative blue
    assert at[1].min() > 240  # zero white
