"""The cloth solver, its colliders, cloth that passes through cloth, and rings around a bone."""

import numpy as np
import pytest
import trimesh

from relight.figures.drape import simulate
from relight.figures.drape.colliders import Collider
from relight.figures.drape.solver import ClothSolver, SolverSettings
from relight.figures.draw.garments import Cloth
from relight.figures.gates.checks import crossing
from relight.figures.gates.rings import winding
from relight.figures.surfaces import grid_faces


def square(n=21, side=0.4, height=1.0):
    x, z = np.meshgrid(a := np.linspace(-side / 2, side / 2, n), a)
    return np.stack([x.ravel(), np.full(n * n, height), z.ravel()], axis=1), grid_faces(n, n)


def ball(radius=0.12, height=0.8):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return np.asarray(mesh.vertices) + [0, height, 0], np.asarray(mesh.faces)


def test_step_frame_cloth_over_a_ball_lies_outside_and_keeps_its_lengths():
    vertices, faces = square()
    under = Collider.at_rest(*ball())
    solver = ClothSolver(vertices, faces, Cloth(extra_length=0.0, friction=0.6))
    for _ in range(50):
        solver.step_frame(under, SolverSettings(10, 4, 0), ground=0.0, damping=0.98)
    x = solver.positions()
    # The thickness, less the facets of the ball.
    assert np.linalg.norm(x - [0, 0.8, 0], axis=1).min() > 0.12 + 0.004 - 0.002
    assert x[:, 1].min() < 0.85  # the corners hang
    assert np.abs(np.percentile(solver.strain(), [2, 98]) - 1).max() < 0.05


def test_step_frame_free_cloth_falls_as_anything_falls_and_stays_above_the_ground():
    vertices, faces = square(5, height=3.0)
    under, solver = Collider.at_rest(*ball()), ClothSolver(vertices, faces, Cloth(extra_length=0.0))
    for _ in range(12):
        solver.step_frame(under, SolverSettings(10, 2, 0), ground=-9.0, damping=1.0)
    assert 3 - solver.positions()[:, 1].mean() == pytest.approx(9.8 * 0.2**2 / 2, rel=0.03)
    vertices, faces = square(9, height=0.05)
    under, solver = Collider.at_rest(*ball(height=3.0)), ClothSolver(vertices, faces, Cloth())
    for _ in range(40):
        solver.step_frame(under, SolverSettings(8, 2, 0), ground=0.01, damping=0.98)
    assert solver.positions()[:, 1].min() == pytest.approx(0.01, abs=1e-6)


def test_collider_nearest_is_the_true_nearest_point():
    vertices, faces = ball()
    points = np.random.default_rng(0).normal(size=(200, 3)) * 0.1 + [0, 0.8, 0]
    _, found, _ = Collider.at_rest(vertices, faces).nearest(points, 1.0)
    true, _, _ = trimesh.proximity.closest_point_naive(trimesh.Trimesh(vertices, faces, process=False), points)
    np.testing.assert_allclose(np.linalg.norm(found - points, axis=1), np.linalg.norm(true - points, axis=1), atol=2e-6)


def test_step_frame_sleeve_follows_a_fast_arm():
    def tube(radius: float, length: float) -> tuple[np.ndarray, np.ndarray]:
        angle, y = np.meshgrid(np.arange(20) / 20 * 2 * np.pi, np.linspace(-length / 2, length / 2, 25))
        i = np.arange(500).reshape(25, 20)
        p, q, r, s = i[:-1], np.roll(i, -1, 1)[:-1], i[1:], np.roll(i, -1, 1)[1:]
        faces = np.stack([p, r, q, q, r, s], -1).reshape(-1, 3)
        return np.stack([radius * np.cos(angle), 1 + y, radius * np.sin(angle)], -1).reshape(-1, 3), faces

    (arm, solid), (sleeve, faces) = tube(0.03, 0.5), tube(0.04, 0.3)
    solver, step = ClothSolver(sleeve, faces, Cloth(extra_length=0.0)), np.array([0.07, 0, 0])
    for k in range(8):
        below = Collider(arm + k * step, arm + (k + 1) * step, solid)
        solver.step_frame(below, SolverSettings(12, 2, 0), ground=0.0, damping=0.99)
    x = solver.positions()
    for row in (5, 12, 19):
        ring, bone = x[20 * row : 20 * row + 20], np.array([[0, 0, 0], [0, 2, 0]]) + 8 * step
        assert abs(winding(np.stack([ring, np.roll(ring, -1, 0)], axis=1), bone)) == 1


def test_relax_torn_edges_spreads_one_torn_edge():
    vertices, faces = square(9)
    solver, torn = ClothSolver(vertices, faces, Cloth(extra_length=0.0)), vertices.copy()
    torn[40, 1] += 0.3
    solver.move_to(torn)
    before = solver.strain().max()
    solver.move_to(simulate.relax_torn_edges(torn, faces, solver.edges, solver.strain(), np.zeros(81, bool)))
    assert solver.strain().max() < 0.4 * before


def standing(n=21):
    """The square of cloth, upright in the plane x = 8 mm and 10 mm up, so that no vertex of one lies in the other."""
    vertices, faces = square(n)
    return np.stack([0 * vertices[:, 0] + 0.008, 1.01 + vertices[:, 0], vertices[:, 2]], axis=1), faces


def test_crossing_measures_cloth_through_cloth_and_no_graze():
    flat, wall = square(), standing()
    found = crossing([flat, wall], [flat[0], wall[0]])
    for share, (_, faces) in zip(found, (flat, wall)):
        assert 20 / len(faces) <= share <= 60 / len(faces)  # the faces along a line of 20 edges
    clear = wall[0] + [0, 0.25, 0], wall[1]
    assert crossing([flat, clear], [flat[0], clear[0]]) == [0, 0]
    bent = flat[0] + np.insert(np.zeros((len(flat[0]), 2)), 1, 0.002 * np.sin(60 * flat[0][:, 0]), axis=1)
    assert crossing([flat, (bent, flat[1])], [flat[0], flat[0]]) == [0, 0]


def test_crossing_of_a_garment_with_itself_needs_a_distant_pattern():
    flat, wall = square(), standing()
    both = np.concatenate([flat[0], wall[0]]), np.concatenate([flat[1], wall[1] + len(flat[0])])
    far = np.concatenate([flat[0], wall[0] + [3, 0, 0]])
    assert crossing([both], [far])[0] > 0.02 and crossing([both], [np.zeros_like(far)]) == [0]


def test_pin_holds_a_fully_pinned_vertex_at_its_target():
    vertices, faces = square(9)
    under = Collider.at_rest(*ball(height=0.95))
    solver = ClothSolver(vertices, faces, Cloth(extra_length=0.0))
    pinned, target = np.array([40, 41]), vertices[[40, 41]] - [0, 0.02, 0]  # inside the ball
    solver.step_frame(under, SolverSettings(8, 2, 0), ground=0.0, damping=0.9)
    solver.pin(pinned, np.array([1.0, 0.5]), target, under, 0.0)
    np.testing.assert_allclose(solver.positions()[40], target[0], atol=1e-6)
    assert np.linalg.norm(solver.positions()[41] - [0, 0.95, 0]) > 0.12


def test_winding_of_a_ring_to_one_side():
    """Rings of any shape against the turns of the angle at the bone: a loose sleeve is not centred on it."""
    rng, inside = np.random.default_rng(0), 0
    for _ in range(300):
        angle = np.sort(rng.uniform(0, 2 * np.pi, 15))
        flat = np.exp(rng.normal(0, 0.5, 15))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        place = rng.normal(0, 0.8, 2)
        seen = np.arctan2(*(flat - place).T[::-1])
        turns = (np.diff(seen, append=seen[:1]) + np.pi) % (2 * np.pi) - np.pi
        points, bone = np.insert(flat, 2, 1.0, axis=1), np.array([[*place, 0.0], [*place, 2.0]])
        assert winding(np.stack([points, np.roll(points, -1, 0)], axis=1), bone) == round(turns.sum() / (2 * np.pi))
        inside += abs(round(turns.sum() / (2 * np.pi)))
    assert 50 < inside < 250
