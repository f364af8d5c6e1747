import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import zoom

from relight.maps.square import Crop
from relight.photos.guide import SMOOTH, FittedMap, Guide, square_root

SIDE, SCALE = 48, 8
LARGE = SIDE * SCALE
WHOLE = Crop(0.0, 0.0, float(LARGE), (0, LARGE), (0, LARGE), SIDE)


def averaged(image):
    return image.reshape(SIDE, SCALE, SIDE, SCALE, -1).mean((1, 3))


def upsampled(maps, guide, photo, **options):
    fit = FittedMap(maps, Guide(guide, np.ones((SIDE, SIDE), bool)), **options)
    return fit.place(WHOLE, photo - WHOLE.place(guide), WHOLE.window)


def test_an_edge_of_the_photo_becomes_the_maps_edge():
    """An arm before a body: the gain of each is carried to the photo's edge, which lies within a network pixel."""
    edge = 131 + 20 * np.sin(np.arange(LARGE) / 40)
    arm = (np.arange(LARGE)[None] < edge[:, None])[..., None]
    photo, gain = np.where(arm, 0.7, 0.3), np.where(arm, 2.0, 0.5)
    found = upsampled(averaged(gain), averaged(photo), photo)
    off = [np.abs(each - gain).mean() for each in (found, WHOLE.place(averaged(gain)))]
    assert off[0] < 0.4 * off[1]
    assert found.min() > 0.35 and found.max() < 2.15  # no halo beyond what both sides have


def test_albedo_gains_the_photos_detail():
    """Under even light albedo is the photo over a constant: the fine pattern comes back."""
    rng = np.random.default_rng(0)
    albedo = 0.3 + 0.2 * np.clip(zoom(rng.normal(size=(96, 96, 1)), (4, 4, 1), order=1) * 0.6, -1, 1)
    photo = 0.8 * albedo
    coarse = square_root(averaged(albedo))
    found = upsampled(coarse, square_root(averaged(photo)), square_root(photo), textured=True)
    assert np.abs(found**2 - albedo).mean() < 0.35 * np.abs(WHOLE.place(coarse) ** 2 - albedo).mean()


def test_what_the_photo_does_not_show_stays_as_the_network_said():
    rng = np.random.default_rng(1)
    maps = rng.random((SIDE, SIDE, 4))
    flat = np.full((SIDE, SIDE, 1), 0.4)
    assert np.abs(upsampled(maps, flat, np.full((LARGE, LARGE, 1), 0.4)) - WHOLE.place(maps)).max() < 0.25
    same = Crop(0.0, 0.0, float(SIDE), (0, SIDE), (0, SIDE), SIDE)
    guide = rng.random((SIDE, SIDE, 1))
    fit = FittedMap(maps, Guide(guide, np.ones((SIDE, SIDE), bool)))
    again = fit.place(same, guide - same.place(guide), same.window)
    assert np.abs(again - maps).max() < 1e-6  # at its own resolution a map is returned
    ones = FittedMap(np.ones((SIDE, SIDE, 3)), Guide(guide, guide[..., 0] > 0.2))
    assert np.abs(ones.place(WHOLE, rng.normal(size=(LARGE, LARGE, 1)), WHOLE.window) - 1).max() < 1e-6


def test_the_fit_is_the_slow_one():
    """Against weighted least squares in each window of 5 x 5 pixels; what is outside of the picture has no weight."""
    rng = np.random.default_rng(2)
    guide, maps, mask = rng.random((12, 12, 1)), rng.random((12, 12, 2)), rng.random((12, 12)) > 0.4

    def windows(values):
        return sliding_window_view(np.pad(values, 2), (5, 5))

    w, g = windows(mask.astype(float)), windows(guide[..., 0])
    weight = w.sum((2, 3))
    off = g - ((w * g).sum((2, 3)) / weight)[..., None, None]
    square = (w * off**2).sum((2, 3)) + SMOOTH * weight
    for c in range(2):
        slope = (w * off * windows(maps[..., c])).sum((2, 3)) / square
        expected = (w * windows(slope)).sum((2, 3)) / weight
        np.testing.assert_allclose(Guide(guide, mask).slope(maps, SMOOTH)[..., c], expected, atol=1e-9)
