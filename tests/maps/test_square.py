"""Placing back is exact: a map of coordinates goes through the square and comes home to where it was."""

import numpy as np
import pytest
from PIL import Image

from relight.core.errors import UserError
from relight.maps.square import Crop, crop_around, figure_means, fill_outside, tiles


def figure(height, width, top, left, bottom, right):
    coverage = np.zeros((height, width), np.uint8)
    coverage[top:bottom, left:right] = 255
    return coverage


def coordinates(height, width):
    """(row, column) of each pixel's centre."""
    return np.stack(np.meshgrid(np.arange(height) + 0.5, np.arange(width) + 0.5, indexing="ij"), -1).astype(np.float32)


def network_coordinates(f: Crop):
    """The photo coordinates of each of the network's pixel centres, by the definition of the frame."""
    along = (np.arange(f.size) + 0.5) / f.size * f.side
    return np.stack(np.meshgrid(f.top + along, f.left + along, indexing="ij"), -1).astype(np.float32)


def cases():
    rng = np.random.default_rng(7)
    for _ in range(50):
        height, width = rng.integers(24, 700, 2)
        top, left = rng.integers(0, height - 8), rng.integers(0, width - 8)
        yield height, width, top, left, rng.integers(top + 8, height + 1), rng.integers(left + 8, width + 1)
    yield 256, 256, 0, 0, 256, 256  # square, all borders touched
    yield 300, 300, 0, 120, 300, 180  # square, top and bottom touched
    yield 64, 640, 0, 0, 30, 20  # a corner, 20 px wide
    yield 640, 64, 600, 40, 640, 64


def test_back_to_the_pixel():
    size = 64
    for height, width, *box in cases():
        f = crop_around(figure(height, width, *box), size)
        assert f.rows == (box[0], box[2]) and f.columns == (box[1], box[3])
        error = np.abs(f.place(network_coordinates(f)) - coordinates(height, width)[f.window]).max()
        assert error < (1e-3 * f.side / size if f.side > size else 0.1), (height, width, box)
        inside = f.extract(np.ones((height, width), np.float32)) > 0.999
        seen = f.extract(coordinates(height, width))[inside]
        assert np.abs(seen - network_coordinates(f)[inside]).max() < 0.1 * max(f.side / size, 1), (height, width, box)


def test_centred_and_padded_as_in_training_and_an_empty_mask_is_refused():
    f = crop_around(figure(400, 300, 40, 100, 220, 160), 128)
    assert f.side == pytest.approx(200) and f.top == pytest.approx(30) and f.left == pytest.approx(30)
    wide = crop_around(figure(100, 400, 10, 20, 60, 380), 128)  # wider than high: fits the width
    assert wide.side == pytest.approx(400) and wide.left == pytest.approx(0) and wide.top == pytest.approx(-165)
    with pytest.raises(UserError, match="empty"):
        crop_around(np.full((20, 20), 100, np.uint8), 64)


def test_equal_scale_is_the_identity():
    photo = np.random.default_rng(1).random((300, 260, 3)).astype(np.float32)
    f = Crop(top=-5, left=30, side=256, rows=(0, 240), columns=(40, 250), size=256)
    seen = f.extract(photo)
    assert np.array_equal(seen, np.pad(photo[:251, 30:], ((5, 0), (0, 26), (0, 0))))
    assert np.array_equal(f.place(seen), photo[f.window])


def test_parts_equal_the_whole():
    rng, f = np.random.default_rng(2), crop_around(figure(777, 500, 13, 30, 765, 420), 64)
    maps = rng.random((64, 64, 2)).astype(np.float32)
    whole = f.place(maps)
    for rows, columns in tiles(f.rows, f.columns):
        part = whole[rows.start - 13 : rows.stop - 13, columns.start - 30 : columns.stop - 30]
        assert np.abs(f.place(maps, (rows, columns)) - part).max() < 1e-5


@pytest.mark.parametrize("cubic", [True, False])
@pytest.mark.parametrize("side", [40.3, 333.3])
def test_placing_is_pillows_resampling(side, cubic):
    """Smaller and larger squares, in any pixels of it, as Pillow enlarges or averages the extended maps."""
    maps = np.random.default_rng(3).random((64, 64, 3)).astype(np.float32)
    f = Crop(top=10.7, left=20.2, side=side, rows=(5, int(side)), columns=(18, int(side) + 25), size=64)
    scale, margin = 64 / side, 40
    box = ((18 - 20.2) * scale, (5 - 10.7) * scale, (f.columns[1] - 20.2) * scale, (f.rows[1] - 10.7) * scale)
    box = tuple(edge + margin for edge in box)
    kind = Image.Resampling.BICUBIC if cubic and side > 64 else Image.Resampling.BILINEAR
    padded = (Image.fromarray(np.pad(maps[..., c], margin, mode="edge")) for c in range(3))
    size = f.columns[1] - 18, f.rows[1] - 5
    slow = np.stack([np.asarray(each.resize(size, kind, box)) for each in padded], -1)
    assert np.abs(f.place(maps, cubic=cubic) - slow).max() < 2e-6


def test_huge_and_tiny():
    f, rows = crop_around(figure(8000, 8000, 0, 3000, 8000, 5000), 64), (7900, 8000)
    placed = f.place(network_coordinates(f)[..., 0], (slice(*rows), slice(*f.columns)))
    assert np.abs(placed - (np.arange(*rows) + 0.5)[:, None]).max() < 0.1  # of 8889 pixels
    tiny = crop_around(figure(600, 800, 580, 790, 600, 800), 256)
    assert np.abs(tiny.place(network_coordinates(tiny)) - coordinates(600, 800)[580:, 790:]).max() < 1e-3


def test_soft_edge_past_the_square_is_covered():
    coverage = figure(200, 200, 80, 80, 120, 120)
    coverage[60:140, 60:140] = np.maximum(coverage[60:140, 60:140], 40)
    f = crop_around(coverage, 64)
    assert f.rows == (60, 140)
    placed = f.place(np.ones((64, 64), np.float32))
    assert placed.shape == (80, 80) and np.abs(placed - 1).max() < 1e-6
    coverage[0, 0] = 1  # a speck far away must not make the window grow without bound
    assert crop_around(coverage, 64).rows[0] >= 80 - 40


def test_extend_takes_the_nearest():
    mask = np.zeros((5, 5), bool)
    mask[2, 1:3] = True
    maps = np.arange(25, dtype=np.float32).reshape(5, 5)
    out = fill_outside(maps, mask)
    assert np.array_equal(out[mask], maps[mask]) and out[2, 4] == maps[2, 2] and out[0, 0] == maps[2, 1]


def test_figure_means_of_one_channel_and_of_three_are_averages_over_the_figure():
    coverage = np.zeros((64, 48), np.float32)
    coverage[8:56, 12:36] = 1
    inside, mean = figure_means(coverage, coverage > 0, crop_around(np.uint8(255 * coverage), 20))
    assert inside.shape == (20, 20) and 0.2 < inside.mean() < 0.6
    for channels in (1, 3):
        means = mean(np.full((64, 48, channels), 7.0) * coverage[..., None] - 9 * (coverage[..., None] == 0))
        assert means.shape == (20, 20, channels)
        assert np.allclose(means[inside], 7, atol=1e-4) and not means[~inside].any()
