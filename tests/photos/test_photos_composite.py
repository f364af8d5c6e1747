"""Soft masks: the figure's own colour is found at its edge, and no old background comes along."""

import numpy as np

from relight.photos.composite import foreground, over, strips


def soft_disc(size=200, radius=60, softness=12.0):
    y, x = np.mgrid[:size, :size] - size / 2
    return np.clip(0.5 + (radius - np.hypot(x, y)) / softness, 0, 1).astype(np.float32)


def pair(size=200):
    """A figure whose colour changes slowly, before a bright background."""
    y, x = np.mgrid[:size, :size] / size
    figure = np.stack([0.2 + 0.1 * x, 0.1 + 0.05 * y, 0.15 + 0 * x], -1).astype(np.float32)
    behind = np.stack([0.8 + 0.1 * y, 0.9 + 0 * x, 0.95 - 0.1 * x], -1).astype(np.float32)
    return figure, behind


def test_no_halo_on_a_new_background():
    alpha = soft_disc()
    figure, behind = pair()
    new = np.full_like(figure, 0.02)
    truth = over(figure, alpha, new)
    photo = over(figure, alpha, behind)
    good = over(foreground(photo, alpha), alpha, new)
    naive = over(photo, alpha, new)
    assert np.abs(naive - truth).max() > 0.15  # the halo
    assert np.abs(good - truth).max() < 0.02


def test_opaque_pixels_stay_and_hard_masks_change_nothing():
    alpha = soft_disc()
    photo = over(*pair()[:1], alpha, pair()[1])
    found = foreground(photo, alpha)
    assert np.array_equal(found[alpha == 1], photo[alpha == 1])
    hard = (alpha > 0.5).astype(np.float32)
    assert foreground(photo, hard) is photo


def test_relit_edge_on_the_photos_own_background():
    """Half the light on the figure, the background untouched: the edge is the true mixture."""
    alpha = soft_disc()
    figure, behind = pair()
    photo = over(figure, alpha, behind)
    front = foreground(photo, alpha)
    relit = photo + alpha[..., None] * (front * 0.3 - front)
    assert np.abs(relit - over(figure * 0.3, alpha, behind)).max() < 0.02


def test_strips_cover_once():
    assert [r for a, b in strips(5, 1400) for r in range(a, b)] == list(range(5, 1400))
