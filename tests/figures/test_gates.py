"""Rings around limbs: contours of a field, and how often they wind around a bone."""

import numpy as np
import pytest

from relight.figures.gates.rings import contour, winding

BONE = np.array([[0, 0, 0], [0, 0, 1.0], [0, 0, 2.0]])
AROUND, ALONG = 24, 41


def tube(radius: float = 0.1, turns: float = 0.0, bend: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A tube about a bone of length 2 that bends by `bend` radians halfway; its cross-section turns `turns` times along
    it. Vertices (n,3), faces with their outside outward, and where on the bone each vertex lies (n,)."""
    t, angle = np.meshgrid(np.linspace(0, 2, ALONG), np.arange(AROUND) / AROUND * 2 * np.pi, indexing="ij")
    angle = angle + np.pi * turns * t
    curve = np.clip((t - 0.8) / 0.4, 0, 1) * bend  # the direction of the tube, which turns in the plane y = 0
    step = 2 / (ALONG - 1)
    place = [np.concatenate([0 * f[:1], np.cumsum(f[1:] * step, axis=0)]) for f in (np.sin(curve), np.cos(curve))]
    x = place[0] + radius * np.cos(angle) * np.cos(curve)
    z = place[1] - radius * np.cos(angle) * np.sin(curve)
    i = np.arange(ALONG * AROUND).reshape(ALONG, AROUND)
    p, q, r, s = i[:-1], np.roll(i, -1, 1)[:-1], i[1:], np.roll(i, -1, 1)[1:]
    faces = np.concatenate([np.stack([p, q, r], -1).reshape(-1, 3), np.stack([q, s, r], -1).reshape(-1, 3)])
    return np.stack([x, radius * np.sin(angle), z], -1).reshape(-1, 3), faces, t.ravel()


def ring(points: np.ndarray, faces: np.ndarray, field: np.ndarray, level: float) -> np.ndarray:
    edge, share, closed = contour(field, faces, level)
    assert closed
    return points[edge[..., 0]] * (1 - share[..., None]) + points[edge[..., 1]] * share[..., None]


def test_contour_lies_where_the_field_has_its_value():
    points, faces, field = tube()
    found = ring(points, faces, field, 0.333)
    np.testing.assert_allclose(found[..., 2], 0.333, atol=1e-12)
    length = np.linalg.norm(found[:, 1] - found[:, 0], axis=1).sum()
    assert length == pytest.approx(2 * AROUND * 0.1 * np.sin(np.pi / AROUND), rel=0.01)


def test_contour_that_is_cut_is_not_closed():
    points, faces, field = tube()
    slit = faces[(points[faces, 1] > -0.09).all(1)]
    assert contour(field, faces, 0.3)[2] and not contour(field, slit, 0.3)[2]


@pytest.mark.parametrize("level", [0.12, 0.71, 0.97, 1.04, 1.83])
@pytest.mark.parametrize("turns", [0.0, 0.5, -3.0])
@pytest.mark.parametrize(("off", "times"), [(0.0, 1), (0.08, 1), (0.12, 0), (0.5, 0)])
def test_winding_is_one_however_the_sleeve_is_twisted(level, turns, off, times):
    found = ring(*tube(turns=turns), level)
    for angle in (0.1, 2.0, 4.3):
        bone = BONE + off * np.array([np.cos(angle), np.sin(angle), 0])
        assert winding(found, bone) == times
        assert winding(found, bone[::-1]) == -times
        assert winding(found[np.random.default_rng(0).permutation(len(found))], bone) == times


@pytest.mark.parametrize("bend", [0.5, 1.5, 2.6])
def test_winding_of_a_bent_sleeve_around_a_bent_bone(bend):
    """Rings slid along the bone count too, and a bone on which one half leaves the sleeve shows on that half only."""
    points, faces, field = tube(radius=0.05, bend=bend)
    centre = points.reshape(ALONG, AROUND, 3).mean(1)
    for level in (0.31, 0.93, 1.08, 1.71):
        assert winding(ring(points, faces, field, level), centre) == 1
        assert winding(ring(points, faces, field, level), centre + [0, 0.06, 0]) == 0
    half = centre + np.array([0, 0.06, 0]) * (np.arange(ALONG) > ALONG // 2)[:, None]
    assert [winding(ring(points, faces, field, level), half) for level in (0.31, 0.71, 1.32, 1.71)] == [1, 1, 0, 0]


def test_winding_of_a_ring_to_one_side():
    """Rings of any shape against the turns of the angle at the bone: a loose sleeve is not centred on it."""
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(300):
        angle = np.sort(rng.uniform(0, 2 * np.pi, 15))
        flat = np.exp(rng.normal(0, 0.5, 15))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        place = rng.normal(0, 0.8, 2)
        seen = np.arctan2(*(flat - place).T[::-1])
        turns = (np.diff(seen, append=seen[:1]) + np.pi) % (2 * np.pi) - np.pi
        points = np.insert(flat, 2, 1.0, axis=1)
        bone = np.array([[*place, 0.0], [*place, 2.0]])
        assert winding(np.stack([points, np.roll(points, -1, 0)], axis=1), bone) == round(turns.sum() / (2 * np.pi))
        inside += abs(round(turns.sum() / (2 * np.pi)))
    assert 50 < inside < 250
