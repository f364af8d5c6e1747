"""Cuts and trims of garments: hulls, drops, necklines, collars, bands, belts, ties, fits."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from relight.figures.body.motion import build_motion
from relight.figures.cut import patterns
from relight.figures.cut.level import Level
from relight.figures.drape import collars, trims
from relight.figures.drape.colliders import Collider, signed_distance
from relight.figures.draw.garments import wardrobe
from relight.figures.draw.poses import poses
from relight.figures.surfaces import border_loops, grid_faces, loop
from relight.meshes.geometry import edges

UP, LEFT, AHEAD = np.eye(3)[[1, 0, 2]]
NECK = collars.Neck(np.zeros(3), LEFT, UP, AHEAD)


def cut(body, name, **changes):
    return patterns.build_pattern(body, replace(wardrobe()[name], **changes), 0)


def hollow(points: np.ndarray) -> float:
    """Metres by which the deepest of points (n,2) lies inside their hull."""
    sides = ConvexHull(points).equations
    return float(-(points @ sides[:, :2].T + sides[:, 2]).max(1).min())


def test_a_skirt_hangs_on_the_waist_of_a_dress_whose_sleeves_end_lower(body):
    short, long = (cut(body, "long dress", sleeve_end=end).levels[0].rest_shape for end in (0.2, 2.0))
    for shape in (short, long):
        hem = shape[shape[:, 1] < shape[:, 1].min() + 0.03]
        assert hem[:, 0].min() < -0.15 and hem[:, 0].max() > 0.15
    np.testing.assert_allclose(long[:, 1].min(), short[:, 1].min(), atol=1e-3)


@pytest.mark.parametrize("name", ["sweater", "t-shirt", "short skirt"])
def test_build_pattern_has_no_length_for_the_hollow_of_the_seat(body, name):
    at, level = body.heights, cut(body, name).levels[0]
    for height in np.arange(at["crotch"] + 0.1, at["hip"] + 0.02, 0.02):
        suit = body.tights[np.abs(body.tights[:, 1] - height) < 0.01][:, [0, 2]]
        for points in (level.rest_shape, level.fitted):
            near = points[np.abs(points[:, 1] - height) < 0.01][:, [0, 2]]
            near = near[np.abs(near[:, 0]) < np.abs(suit[:, 0]).max() + 0.05]
            assert len(near) > 6 and hollow(near) < 0.006
    seat = body.tights[np.abs(body.tights[:, 1] - at["crotch"] - 0.1) < 0.01][:, [0, 2]]
    assert hollow(seat) > 0.009, "the body is hollow there"


def tube() -> tuple[np.ndarray, np.ndarray]:
    """A dome with a round hole, as shoulders are to a neck: vertices and faces turned outward."""
    rings = [(0.06, 0.0), (0.09, -0.012), (0.13, -0.04), (0.18, -0.10), (0.20, -0.2), (0.20, -0.3)]
    dome = trimesh.creation.revolve(rings[::-1], sections=24)
    points, faces = dome.vertices[:, [1, 2, 0]], dome.faces
    for _ in range(2):
        matrix, finer = loop(faces, len(points))
        points, faces = matrix @ points, finer
    return points, faces


@pytest.mark.parametrize("kind", ["none", "roll", "stand"])
def test_collar_of_a_closed_neckline_is_smooth(kind):
    """A neckline as uneven as a drape's, in and out by 3 %: no notch is left, nor where the band is joined."""
    points, faces = tube()
    ring = max(border_loops(faces), key=lambda ring: points[ring, 1].mean())
    points[ring] *= 1 + 0.03 * (-1.0) ** np.arange(len(ring))[:, None]
    vertices, _, _ = collars.collar(points, faces, np.zeros((len(points), 2)), kind, NECK, 1.0)
    band = vertices[len(ring) : 2 * len(ring)]  # above the row that is sewn to the cloth
    assert np.ptp(np.hypot(points[ring, 0], points[ring, 2])) > 0.003
    assert np.ptp(np.hypot(band[:, 0], band[:, 2])) < 0.0006


@pytest.mark.parametrize("kind", ["hood", "lapel"])
def test_collar_hood_and_lapel_are_outside_the_cloth(kind):
    points, faces = tube()
    vertices, solid, _ = collars.collar(points, faces, np.zeros((len(points), 2)), kind, NECK, 1.0)
    _, distance, _ = signed_distance(vertices, Collider(points, points, faces), 0.2)
    assert np.percentile(distance, 2) > -0.004 and distance.max() > 0.004
    shell = trimesh.Trimesh(vertices, solid, process=False)
    assert shell.is_watertight and shell.is_winding_consistent
    if kind == "hood":
        assert vertices[vertices[:, 2] < 0, 1].min() < -0.08, "it hangs down the back"
        assert vertices[vertices[:, 2] > 0.05, 1].min() > -0.05, "and not in front"


def sheet(size: float, front: float, step: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """A square of cloth in the plane z = `front`, seen from +z."""
    a = np.arange(-size, size + 1e-9, step)
    x, y = np.meshgrid(a, a[::-1])
    return np.stack([x, y, np.full_like(x, front)], -1).reshape(-1, 3), grid_faces(len(a), len(a))


@pytest.mark.parametrize("front", ["zip", "buttons", "double", "placket", "none"])
def test_band_of_a_closed_front_has_its_width_and_offset(front):
    points, faces = sheet(0.4, 0.1)
    back, behind = sheet(0.4, -0.1)
    both, solid = np.concatenate([points, back]), np.concatenate([faces, behind + len(points)])
    level = Level(both, both, both, np.zeros(len(both)), np.zeros((len(both), 1)), solid)
    garment = replace(wardrobe()["closed coat"], front=front)
    pattern = patterns.Pattern(None, garment, [level], [], {}, np.zeros(2 * len(faces), bool))
    found = trims.band(pattern, both, both[:, :2])
    if front == "none":
        assert found is None
        return
    vertices, solid, uv = found
    shell = trimesh.Trimesh(vertices, solid, process=False)
    assert shell.is_watertight and shell.is_winding_consistent and shell.volume > 0
    assert (vertices[:, 0].min(), vertices[:, 0].max()) == pytest.approx(trims.BANDS[front], abs=1e-6)
    assert vertices[:, 2].max() == pytest.approx(0.1 + trims.OFFSET) and vertices[:, 2].min() == pytest.approx(0.1)
    assert np.ptp(vertices[:, 1]) == pytest.approx(trims.PLACKET if front == "placket" else 0.8, abs=1e-6)
    np.testing.assert_allclose(uv, vertices[solid][..., :2], atol=1e-9)


def front(points, faces, neck, part):
    if part == "tie":
        return trims.tie(points, faces, neck)[0]
    if part == "cords":
        return np.concatenate([vertices for vertices, _ in collars.cords(points, faces, neck)])
    return collars.collar(points, faces, np.zeros((len(points), 2)), part, neck, 1.0)[0]


@pytest.mark.parametrize("part", ["none", "roll", "fold", "hood", "lapel", "cords", "tie"])
@pytest.mark.parametrize("degrees", [40, -130])
def test_what_lies_on_the_chest_turns_with_it(part, degrees):
    """Collars, cords and ties of a trunk that leans, and is turned about the vertical afterwards."""
    points, faces = tube()
    points[:, 1] *= np.where(points[:, 1] < -0.1, 2.5, 1)  # long enough for a tie
    points = Rotation.from_euler("xz", [12, -5], degrees=True).apply(points * [1.2, 1, 1])
    neck = collars.Neck(np.zeros(3), LEFT, *Rotation.from_euler("x", 20, degrees=True).apply([UP, AHEAD]))
    turn = Rotation.from_euler("y", degrees, degrees=True)
    found = front(turn.apply(points), faces, collars.Neck(*turn.apply(neck)), part)
    np.testing.assert_allclose(found, turn.apply(front(points, faces, neck, part)), atol=1e-4)


@pytest.mark.parametrize("name", sorted(wardrobe()))
@pytest.mark.slow
def test_build_pattern_cuts_every_garment(body, name):
    """In one piece, with as many borders as it has openings, around a body that stands."""
    garment, level = wardrobe()[name], cut(body, name).levels[0]
    openings = {"top": 4 - bool(garment.front_gap), "trousers": 3, "skirt": 2}[garment.kind]
    assert len(border_loops(level.faces)) == openings
    assert all(np.isfinite(part).all() for part in (level.rest_shape, level.start, level.fitted))
    assert np.isfinite(build_motion(body, poses()["straight"], 1).skin(level.weights, level.start)).all()
    assert np.linalg.norm(np.diff(level.rest_shape[edges(level.faces)[0]], axis=1), axis=-1).max() < 0.16
