"""Cloth that hangs, lies and stays the same."""

import numpy as np
import pytest
import trimesh

from relight.figures import drape
from relight.figures.drape import Cloth, Collider, Effort, Sheet


@pytest.fixture(scope="module", autouse=True)
def warp():
    drape.prepare()


def square(n=21, side=0.4, height=1.0):
    a = np.linspace(-side / 2, side / 2, n)
    x, z = np.meshgrid(a, a)
    i = np.arange(n * n).reshape(n, n)
    p, q, r, s = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel()
    faces = np.concatenate([np.stack([p, r, q], 1), np.stack([q, r, s], 1)])
    return np.stack([x.ravel(), np.full(n * n, height), z.ravel()], axis=1), faces


def ball(radius=0.12, height=0.8):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return np.asarray(mesh.vertices) + [0, height, 0], np.asarray(mesh.faces)


def test_a_cloth_over_a_ball_lies_outside_it_and_keeps_its_lengths():
    vertices, faces = square()
    under = Collider(*([ball()[0]] * 2), ball()[1])
    sheet = Sheet(vertices, faces, Cloth(crumple=0.0, friction=0.6))
    for _ in range(50):
        sheet.frame(under, Effort(10, 4, 0, contact=False), ground=0.0, damp=0.98)
    x = sheet.positions()
    distance = np.linalg.norm(x - [0, 0.8, 0], axis=1)
    assert distance.min() > 0.12 + 0.004 - 0.002  # the thickness, less the facets of the ball
    assert x[:, 1].min() < 0.85  # the corners hang
    assert np.abs(np.percentile(sheet.strain(), [2, 98]) - 1).max() < 0.05


def test_a_free_cloth_falls_as_anything_falls():
    vertices, faces = square(5, height=3.0)
    under = Collider(*([ball()[0]] * 2), ball()[1])
    sheet = Sheet(vertices, faces, Cloth(crumple=0.0))
    for _ in range(12):
        sheet.frame(under, Effort(10, 2, 0, contact=False), ground=-9.0, damp=1.0)
    assert 3 - sheet.positions()[:, 1].mean() == pytest.approx(9.8 * 0.2**2 / 2, rel=0.03)


def test_the_ground_holds():
    vertices, faces = square(9, height=0.05)
    under = Collider(*([ball(height=3.0)[0]] * 2), ball()[1])
    sheet = Sheet(vertices, faces, Cloth())
    for _ in range(40):
        sheet.frame(under, Effort(8, 2, 0, contact=False), ground=0.01, damp=0.98)
    assert sheet.positions()[:, 1].min() == pytest.approx(0.01, abs=1e-6)


def test_nearest_is_the_true_nearest_point():
    vertices, faces = ball()
    points = np.random.default_rng(0).normal(size=(200, 3)) * 0.1 + [0, 0.8, 0]
    face, weights = Collider(vertices, vertices, faces).nearest(points, 1.0)
    found = np.einsum("nk,nkd->nd", weights, vertices[faces[face]])
    true, _, _ = trimesh.proximity.closest_point_naive(trimesh.Trimesh(vertices, faces, process=False), points)
    np.testing.assert_allclose(np.linalg.norm(found - points, axis=1), np.linalg.norm(true - points, axis=1), atol=2e-6)


def test_mended_spreads_one_torn_edge():
    vertices, faces = square(9)
    sheet = Sheet(vertices, faces, Cloth(crumple=0.0))
    torn = vertices.copy()
    torn[40, 1] += 0.3
    sheet.move_to(torn)
    before = sheet.strain().max()
    sheet.move_to(drape.mended(torn, faces, sheet.edge, sheet.strain()))
    assert sheet.strain().max() < 0.4 * before
