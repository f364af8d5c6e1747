from dataclasses import replace

import numpy as np
import pytest

from relight.core.srgb import decode
from relight.photos.trust import doubts
from relight.sh import basis


@pytest.fixture
def figure(relighter, draw):
    return relighter.infer(*draw(), white_balance="scene")[0]


def lamp(azimuth, elevation=30, fill=1.0, color=(1, 1, 1)):
    a, e = np.radians(azimuth), np.radians(elevation)
    toward = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    light = 0.25 * basis(toward, 2)[:, None] * np.array(color)
    light[0] += 0.25 * fill * np.array(color)
    return light.astype(np.float32)


@pytest.mark.slow
def test_doubts_are_said_in_words_and_a_usual_light_raises_none(figure):
    zero = np.zeros_like(figure.image)
    for change, words in (
        ({"light": lamp(180, 0, 0.3)}, "from behind"),
        ({"light": -lamp(0)}, "no real light"),
        ({"light": 8 * lamp(0)}, "brighter"),
        ({"light": lamp(10, color=(1.6, 0.3, 0.05))}, "colored"),
        ({"albedo": zero}, "rebuild the photo"),
        ({"image": zero + 1}, "blown out"),
        ({"image": zero}, "nearly black"),
    ):
        assert words in " ".join(doubts(replace(figure, **change)))
    quiet = " ".join(doubts(replace(figure, light=lamp(20))))
    assert not any(words in quiet for words in ("behind", "colored", "real light"))
    assert replace(figure, albedo=np.full_like(figure.albedo, 0.5), image=0.5 * figure.shading).error < 1e-3


@pytest.mark.slow
def test_a_linear_photo_brighter_than_white_is_inferred_in_the_exposure_that_suits_it(relighter, draw):
    codes, mask = draw()
    linear = decode(codes / 255)
    dim, bright = (relighter.infer(linear * factor, mask, white_balance="scene")[0] for factor in (4.0, 32.0))
    np.testing.assert_allclose(bright.albedo, dim.albedo, atol=1e-5)
    np.testing.assert_allclose(bright.light, 8 * dim.light, rtol=1e-3)
    assert bright.error == pytest.approx(dim.error, rel=1e-3)
    for figure in (dim, bright):
        assert not any("blown out" in w or "brighter" in w for w in doubts(figure))
