import numpy as np
import pytest

from relight.core.srgb import LINEAR, encode
from relight.photos.tone import KNEE, apply_gain, chroma, clipping_excess, display_shading, roll_off
from relight.pictures.codes import to_srgb8

CODES = np.arange(256)
HUES = [(1, 1, 1), (1, 0.62, 0.4), (1, 0.3, 0.2), (0.4, 0.6, 1), (0.5, 1, 0.4), (1, 0.9, 0.3), (0.8, 0.3, 1)]
GAINS = [(0.5, 0.5, 0.5), (0.2, 0.2, 0.2), (2, 2, 2), (3, 1.5, 0.6), (0.3, 0.4, 1.6), (0.15, 0.15, 3), (3, 0.2, 0.2)]


def spread(color, like):
    return np.broadcast_to(np.asarray(color, np.float32), like.shape)


@pytest.mark.parametrize("first", range(0, 256, 51))
def test_a_gain_of_one_returns_every_color(first):
    """Also where channels are clipped, whatever color is about."""
    colors = np.stack(np.meshgrid(np.arange(first, min(first + 5, 256)), CODES, CODES), -1).reshape(-1, 3)
    linear = LINEAR[colors]
    above = clipping_excess(linear, spread((0.5, 0.3, 0.2), linear))
    gain = np.ones_like(linear)
    assert np.array_equal(to_srgb8(apply_gain(linear, gain, above)), colors)
    gain[0] = 3  # beside a pixel that is rolled off
    assert np.array_equal(to_srgb8(apply_gain(linear, gain, above))[1:], colors[1:])


def test_fast_coder_equals_the_formula():
    linear = np.random.default_rng(0).random(100_000) * 1.2
    assert np.abs(to_srgb8(linear.astype(np.float32)) - encode(linear) * 255).max() < 0.501
    assert to_srgb8(np.array([np.nan]))[0] == 0 and to_srgb8(np.array([np.inf, 1e9, -1]))[:2].min() == 255


@pytest.mark.parametrize("white", [1.0, 1.3, 4.0, np.inf])
def test_grey_is_rolled_smoothly_to_white(white):
    x = np.linspace(0, min(white, 30), 200_001)
    y = roll_off(np.repeat(x[:, None], 3, 1), white)
    assert np.ptp(y, axis=1).max() < 1e-12  # grey stays grey
    slope = np.diff(y[:, 0]) / np.diff(x)
    assert (slope > 0).all() and (slope <= 1 + 1e-9).all() and np.abs(np.diff(slope)).max() < 2e-3
    assert np.abs(y[x < KNEE, 0] - x[x < KNEE]).max() < 1e-12
    assert y.max() < 1 if white == np.inf else y.max() == pytest.approx(1)


def test_hue_is_kept_and_stays_in_the_gamut():
    """Where each channel is rolled off for itself, skin under a warm lamp turns yellow."""
    color = np.array([[1.5, 0.9, 0.6], [3.0, 1.2, 0.48], [0.1, 0.3, 9.0]])
    out = roll_off(color)
    assert (out >= 0).all() and (out <= 1).all()
    before, after = (np.sort(each, 1).T for each in (color, out))
    hue = (before[1] - before[0]) / (before[2] - before[0])
    assert np.abs((after[1] - after[0]) / (after[2] - after[0]) - hue).max() < 1e-9
    assert (np.argsort(out, 1) == np.argsort(color, 1)).all()


@pytest.mark.parametrize("hue", HUES)
def test_no_edge_on_the_way_through_white(hue):
    """A code more in the photo is never a visible step more in the result, and never less of the largest channel."""
    light = np.linspace(0.05, 4, 20_001)[:, None] * np.array(hue) / max(hue)  # grows through white
    codes = np.round(encode(light) * 255).astype(np.uint8)
    codes = codes[np.r_[True, (np.diff(codes.astype(int), axis=0) != 0).any(1)]]  # each once
    linear = LINEAR[codes]
    near = (codes.max(1) >= 235)[1:]  # where codes are not far apart for being dark
    own = np.array(hue) / sum(hue)
    for about in (own, (1 / 3, 1 / 3, 1 / 3)):
        above = clipping_excess(linear, spread(about, linear))
        for gain in GAINS:
            coded = encode(apply_gain(linear, spread(gain, linear), above)) * 255
            step = np.diff(coded, axis=0)[near]
            assert np.abs(step).max() < 2.5, (about, gain)
            assert np.diff(coded.max(1)).min() > -0.1, (about, gain)
            if max(gain) < 1:  # nothing is rolled off: each channel grows
                assert step.min() > -0.6, (about, gain)


def test_more_light_is_never_darker():
    generator = np.random.default_rng(3)
    linear = LINEAR[generator.integers(0, 256, (500, 3))]
    linear[:200] = np.where(generator.random((200, 3)) < 0.5, 1, linear[:200])
    above = clipping_excess(linear, spread((0.5, 0.3, 0.2), linear))
    out = [apply_gain(linear, spread(g, linear), above) for g in np.linspace(0, 4, 200)]
    assert np.diff(out, axis=0).min() > -1e-6


def test_noise_near_black_is_raised_little():
    """Brightened eight times, noise stays dark and nearly grey; what is a signal gets its gain."""
    codes = np.random.default_rng(2).integers(0, 4, (1000, 3)).astype(np.uint8)
    gain = np.array([3, 8, 8], np.float32)
    plain, found = (to_srgb8(light).astype(int) for light in (LINEAR[codes] * gain, apply_gain(LINEAR[codes], gain)))
    assert plain.max() > 20 and found.max() <= 10 and np.ptp(found, axis=1).mean() < 0.5 * np.ptp(plain, axis=1).mean()
    signal = LINEAR[CODES[48:60]][:, None] * np.ones(3, np.float32)
    assert np.allclose(apply_gain(signal, gain), signal * gain, rtol=1e-2)
    grey = apply_gain(LINEAR[:, None] * np.ones(3, np.float32), np.full(3, 8, np.float32))
    assert (np.diff(grey[:, 0]) > 0).all()


def test_what_was_clipped_is_rebuilt_from_the_others():
    """A ball of skin color, twice too bright in the middle, darkened: nearer to the truth than without."""
    y, x = np.mgrid[:96, :96] / 47.5 - 1
    light = 2.0 * np.maximum(1 - 0.9 * np.hypot(x, y), 0.02)
    truth = light[..., None] * np.array([0.9, 0.55, 0.4])
    photo, mask = np.minimum(truth, 1).astype(np.float32), np.ones(light.shape, bool)
    colors = chroma(photo, mask)
    assert np.abs(colors - np.array([0.9, 0.55, 0.4]) / 1.85).max() < 0.03
    gain, excess = np.full_like(photo, 0.4), clipping_excess(photo, colors)
    off = [np.abs(apply_gain(photo, gain, e) - 0.4 * truth)[photo.max(-1) == 1].mean() for e in (excess, 0.0)]
    assert off[0] < 0.6 * off[1]
    white = np.full_like(photo, 1.0)
    white[:8] = [0.5, 0.45, 0.4]
    assert clipping_excess(white, chroma(white, mask)).max() < 0.35  # nothing but a little of what color there is


def test_white_cloth_beside_skin_stays_white():
    cloth = np.linspace(0.6, 1.05, 32).clip(0, 1)[:, None] * np.ones((64, 1, 3))
    photo = np.concatenate([np.tile([0.55, 0.35, 0.25], (64, 32, 1)), cloth], 1).astype(np.float32)
    above = clipping_excess(photo, chroma(photo, np.ones((64, 64), bool)))
    assert np.ptp(apply_gain(photo, np.full_like(photo, 0.3), above)[:, 40:], axis=-1).max() < 0.02


def test_a_shading_is_shown_without_burning_out():
    codes = to_srgb8(display_shading(np.repeat(np.linspace(0, 6, 500)[:, None], 3, 1))).astype(int)
    assert codes.max() < 255 and (np.diff(codes[:, 0]) >= 0).all()
    assert abs(int(to_srgb8(display_shading(np.ones((1, 3))))[0, 0]) - 188) <= 1  # 1, white paper's, at half the light
