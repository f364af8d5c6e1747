"""Shading baked into the albedo."""

import numpy as np
from samples import mesh_of

from relight.figures import shading
from relight.meshes import Mesh
from relight.sh import basis


def ball_and_plate() -> Mesh:
    """A sphere of radius 1 at the origin, and a plate far wider than it 5 mm above its top, facing down."""
    rows, columns = 24, 48
    t, p = np.meshgrid(np.linspace(0, np.pi, rows), np.linspace(0, 2 * np.pi, columns), indexing="ij")
    ball = np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], -1).reshape(-1, 3)
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    plate = np.array([[-9, 1.005, -9], [9, 1.005, -9], [9, 1.005, 9], [-9, 1.005, 9]], float)
    faces = np.concatenate([faces, len(ball) + np.array([[0, 1, 2], [0, 2, 3]])])
    return mesh_of(np.concatenate([ball, plate]), faces, info={"name": "ball"})


def without_plate(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices[:-4], mesh.faces[:-2], mesh.uv[:-2], mesh.material[:-2], mesh.materials, info=mesh.info)


def test_overhead_gives_one_to_an_open_upward_surface():
    normals = np.array([[0, 1.0, 0], [1, 0, 0], [0, -1, 0]])
    cosine_lobe = np.pi * np.array([1, 2 / 3, 2 / 3, 2 / 3])  # of bands 0 and 1
    received = (basis(normals, 1) * cosine_lobe) @ shading.overhead()
    np.testing.assert_allclose(received, [1, 0.75, 0.5], atol=1e-12)


def at_vertices(mesh):
    """The colors (V,3) of vertices, which have the same at all corners."""
    color = np.empty((len(mesh.vertices), 3), np.float32)
    color[mesh.faces] = mesh.color
    np.testing.assert_array_equal(color[mesh.faces], mesh.color)
    return color


def test_shaded_is_bright_above_dim_below_and_dark_in_a_crevice():
    open_ball = without_plate(ball_and_plate())
    y = open_ball.vertices[:, 1]
    factor = at_vertices(shading.shaded(open_ball, 1.0))
    assert (factor[:, :1] == factor).all() and 0 <= factor.min() and factor.max() <= 1
    want = (1 + y / 3) / (4 / 3)  # of a convex body, in closed form
    inner = np.abs(y) < 0.9  # smoothing reaches along the poles' small faces
    np.testing.assert_allclose(factor[inner, 0], want[inner], atol=0.02)
    under = at_vertices(shading.shaded(ball_and_plate(), 1.0))[: len(y), 0]
    assert under[y > 0.95].mean() < 0.2 < factor[y > 0.95, 0].mean()


def test_shaded_strength_blends_from_nothing():
    mesh = without_plate(ball_and_plate())
    assert shading.shaded(mesh, 0.0) is mesh
    full, half = (shading.shaded(mesh, s) for s in (1.0, 0.5))
    np.testing.assert_allclose(half.color, 0.5 + 0.5 * full.color, atol=1e-6)
    assert half.info == {"name": "ball", "shading": 0.5} and mesh.color is None and "shading" not in mesh.info
    color = np.full((*mesh.faces.shape, 3), 0.5)
    tinted = Mesh(mesh.vertices, mesh.faces, mesh.uv, mesh.material, mesh.materials, color, mesh.info)
    np.testing.assert_allclose(shading.shaded(tinted, 1.0).color, 0.5 * full.color, atol=1e-6)
