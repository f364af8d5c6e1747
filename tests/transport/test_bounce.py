"""Interreflection against the integrating sphere, where every bounce and every coefficient has a closed form."""

import numpy as np
import pytest
import trimesh
from samples import mesh_of

from relight.meshes import Material
from relight.sh import unoccluded
from relight.transport import bake

ALBEDO = np.float32([0.8, 0.5, 0.2])


@pytest.mark.parametrize("bounces", [1, 4])
@pytest.mark.slow
def test_integrating_sphere(bounces):
    """Form factors between parts of a sphere are all dA / (4 pi R^2), so what has bounced is the same everywhere.

    Flux enters the port as pi R^2 sin^2(port) A_l Y_lm(z), since a direction w lights the port's disc with its
    cosine; it spreads over the sphere, 4 pi R^2, and each further bounce keeps the share rho * wall of it.
    """
    sphere = trimesh.creation.icosphere(subdivisions=5)
    faces = sphere.faces[(sphere.vertices[sphere.faces][..., 2] < np.cos(0.8)).all(1)][:, ::-1]  # wound inward
    wall = trimesh.Trimesh(sphere.vertices, faces, process=False).area / sphere.area
    maps = bake(mesh_of(sphere.vertices, faces, materials=[Material(ALBEDO)]), 48, 256, bounces=bounces)
    opening = 4 * wall * (1 - wall)  # sin^2 of the port's half-angle, by its solid angle
    entered = opening / 4 * unoccluded(np.array([0.0, 0.0, 1.0]))
    expected = entered[:, None] * sum(ALBEDO * (ALBEDO * wall) ** k for k in range(bounces))
    inside = maps.mask & (np.hypot(*np.meshgrid(*[(2 * np.arange(48) + 1) / 48 - 1] * 2)) < 0.6)
    bounced = maps.bounced[inside]
    np.testing.assert_allclose(bounced.mean(0), expected, atol=6e-3 * expected.max())
    assert (bounced.std(0) < 0.02 * expected.max()).all()  # the same everywhere
    # AO of the wall under a uniform light: the opening's form factor, for every point of the wall.
    assert maps.ao[inside].mean() == pytest.approx(1 - wall, abs=2e-3)


def corner(times):
    """A white floor and a red wall at its right that looks left, two triangles each, cut into four `times` times."""
    floor = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    wall, quad = [[1, -1, 0], [1, -1, 1], [1, 1, 1], [1, 1, 0]], np.array([[0, 1, 2], [0, 2, 3]])
    vertices, faces = np.array(floor + wall, float), np.concatenate([quad, quad + 4])
    for _ in range(times):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    material = (vertices[faces][:, :, 0] == 1).all(1).astype(np.int16)
    return mesh_of(vertices, faces, material=material, materials=[Material(), Material(np.float32([1, 0, 0]))])


def test_large_faces_reflect_in_pieces_and_backs_nothing():
    """Four triangles give what four thousand give, though light falls off along them; the wall sends back red."""
    coarse, fine = (bake(corner(times), 24, 256, bounces=2).bounced for times in (0, 5))
    along = coarse[..., 0, 0].mean(0)
    np.testing.assert_allclose(along, fine[..., 0, 0].mean(0), rtol=0.05)
    assert along[22] > 8 * along[0]  # close to the wall, far from it
    assert coarse[..., 1:].max() == 0
    mesh = corner(0)
    mesh.faces[2:] = mesh.faces[2:, ::-1]
    assert not bake(mesh, 24, 64, bounces=1).bounced.any()
