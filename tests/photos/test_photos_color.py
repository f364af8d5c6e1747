"""Colour: the 256 codes survive, the fast coder equals the formulas, highlights roll off."""

import numpy as np

from relight.photos.color import KNEE, SCENE, develop, shoulder, to_srgb8, unshoulder
from relight.srgb import LINEAR, encode

CODES = np.arange(256)


def test_every_code_returns():
    assert np.array_equal(develop(SCENE), CODES)
    assert np.array_equal(to_srgb8(LINEAR), CODES)


def test_fast_coder_equals_the_formula():
    rng = np.random.default_rng(0)
    scene = np.concatenate([rng.random(200_000) * 3, rng.random(50_000) ** 4, [0, -1, 1e9, np.inf]])
    exact = encode(shoulder(scene)) * 255
    assert np.abs(develop(scene.astype(np.float32)) - exact).max() < 0.501
    linear = rng.random(100_000) * 1.2
    assert np.abs(to_srgb8(linear.astype(np.float32)) - encode(linear) * 255).max() < 0.501
    assert develop(np.array([np.nan]))[0] == 0


def test_shoulder_is_smooth_monotone_and_inverted():
    x = np.linspace(0, 2.5, 100_001)
    y = shoulder(x)
    slope = np.diff(y) / np.diff(x)
    assert (slope > 0).all() and (slope <= 1 + 1e-9).all()
    assert np.abs(np.diff(slope)).max() < 1e-3  # no kink at the knee
    assert np.array_equal(y[x < KNEE], x[x < KNEE]) and y.max() < 1
    linear = np.linspace(0, 0.998, 1000)
    assert np.abs(shoulder(unshoulder(linear)) - linear).max() < 1e-12


def test_highlights_keep_their_detail():
    """Where a hard clip would leave one flat white, the shoulder leaves a gradient."""
    twice_as_bright = 2 * SCENE[CODES[180:250]]
    codes = develop(twice_as_bright).astype(int)
    assert (np.diff(codes) >= 0).all()
    assert len(set(codes[:60])) > 10 and len(set(to_srgb8(2 * LINEAR[190:240]))) == 1
