"""Cutting, subdividing and thickening surfaces, against closed forms."""

import numpy as np
import pytest
import scipy.sparse as sparse
import trimesh

from relight.figures import surfaces


def plate(n=9):
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), surfaces.grid_faces(n, n)[:, ::-1]


@pytest.mark.parametrize("at", [0.31, 0.5, 0.77])
def test_clip_keeps_the_exact_area_and_no_slivers(at):
    vertices, faces = plate()
    matrix, kept = surfaces.clip(sparse.identity(len(vertices), format="csr"), faces, vertices[:, 0] - at)
    out = matrix @ vertices
    assert trimesh.Trimesh(out, kept).area == pytest.approx(1 - at) and out[:, 0].min() == pytest.approx(at)
    assert (surfaces.normals(out, kept)[:, 2] > 0.99).all()  # faces keep their turn
    a, b, c = (out[kept[:, k]] for k in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-4


def test_split_loses_nothing_and_puts_edges_on_the_line():
    vertices, faces = plate(11)
    field = vertices @ [1.0, 0.37, 0] - 0.61
    matrix, joined, side = surfaces.split(sparse.identity(len(vertices), format="csr"), faces, field)
    out = matrix @ vertices
    assert trimesh.Trimesh(out, joined).area == pytest.approx(1, abs=1e-3)
    assert len(surfaces.border_loops(joined)) == 1  # sewn: no border inside
    at = (out @ [1.0, 0.37, 0] - 0.61)[joined]
    assert (at[side] > -1e-9).all() and (at[~side] < 1e-9).all()


def test_loop_is_affine_agrees_with_trimesh_and_keeps_a_straight_border_straight():
    ball = trimesh.creation.torus(1.0, 0.4, 12, 8)  # six edges at each vertex, where all weights agree
    matrix, faces = surfaces.loop(np.asarray(ball.faces), len(ball.vertices))
    np.testing.assert_allclose(np.asarray(matrix.sum(1)).ravel(), 1)
    theirs, _ = trimesh.remesh.subdivide_loop(np.asarray(ball.vertices), np.asarray(ball.faces), iterations=1)
    ours = matrix @ ball.vertices
    assert len(faces) == 4 * len(ball.faces)
    assert np.linalg.norm(ours[:, None] - theirs[None], axis=2).min(1).max() < 1e-9
    vertices, faces = plate(5)
    matrix, finer = surfaces.loop(faces, len(vertices))
    border, out = np.concatenate(surfaces.border_loops(finer)), matrix @ vertices
    inside = (out[border][:, :2] > 1e-9) & (out[border][:, :2] < 1 - 1e-9)
    assert (~inside).any(1).sum() >= len(border) - 4  # all but the rounded corners stay on the square


def test_thickened_cloth_is_closed_at_its_border():
    vertices, faces = plate(7)
    out, solid, source = surfaces.thickened(vertices, faces, 0.01, rings=None)
    shell = trimesh.Trimesh(out, solid, process=False)
    assert shell.is_watertight and shell.is_winding_consistent and shell.volume == pytest.approx(0.01)
    np.testing.assert_allclose(out[solid][..., :2], vertices[faces.ravel()[source]][..., :2], atol=1e-12)
    assert (np.ptp(source // 3, axis=1) == 0).all(), "each face comes from one face"
