"""Vertex normals against closed forms and trimesh."""

import numpy as np
import trimesh
from samples import mesh_of

from relight.meshes import vertex_normals


def test_as_trimesh(person):
    mesh = person()
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    np.testing.assert_allclose(vertex_normals(mesh), other.vertex_normals, atol=1e-5)


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
