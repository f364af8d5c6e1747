"""Vertex normals against closed forms and a plain loop."""

import numpy as np
from samples import mesh_of

from relight.meshes import Mesh, vertex_normals


def slow_normals(mesh: Mesh) -> np.ndarray:
    total = np.zeros((len(mesh.vertices), 3))
    for face in mesh.faces:
        points = mesh.vertices[face].astype(np.float64)
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal /= np.linalg.norm(normal)
        for k in range(3):
            a, b = points[(k + 1) % 3] - points[k], points[(k + 2) % 3] - points[k]
            total[face[k]] += normal * np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
    return total / np.linalg.norm(total, axis=-1, keepdims=True)


def test_as_a_plain_loop(person):
    mesh = person()
    np.testing.assert_allclose(vertex_normals(mesh), slow_normals(mesh), atol=2e-6)


def test_cube_corners_do_not_depend_on_how_the_sides_are_cut():
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    for cut in range(2):
        faces = [f for q in sides for f in ((q[cut], q[cut + 1], q[cut + 2]), (q[cut], q[cut + 2], q[(cut + 3) % 4]))]
        np.testing.assert_allclose(vertex_normals(mesh_of(corner, faces)), (2 * corner - 1) / np.sqrt(3), atol=1e-6)


def test_faces_without_area_and_lone_vertices_give_unit_normals():
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9], [1, 0, 0], [2, 2, 2], [np.nan, 0, 0]]
    normals = vertex_normals(mesh_of(vertices, [[0, 1, 2], [0, 1, 4], [5, 5, 5], [0, 0, 2], [6, 0, 1]]))
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 7, atol=1e-6)
