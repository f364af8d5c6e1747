"""A figure made of ellipsoids, with what alignment and cleaning look for: feet, a face, parts, colors."""

import numpy as np
import pytest
import trimesh
from samples import mesh_of

from relight.meshes import Material, Mesh


def ball(centre, radii, rings=12) -> tuple[np.ndarray, np.ndarray]:
    """A closed ellipsoid: vertices (V,3), faces (F,3) counter-clockwise outward."""
    angle = np.linspace(0, np.pi, rings + 1)
    sphere = trimesh.creation.revolve(np.stack([np.sin(angle), -np.cos(angle)], 1), sections=2 * rings)
    return sphere.vertices[:, [1, 2, 0]] * radii + centre, sphere.faces


# centre, radii, in metres: y up, facing +z, feet at y = 0, left hand at +x
BODY = {
    "torso": ((0, 1.15, 0), (0.20, 0.33, 0.12)),
    "head": ((0, 1.62, 0.02), (0.08, 0.12, 0.10)),
    "nose": ((0, 1.60, 0.13), (0.015, 0.02, 0.02)),
    "left leg": ((0.1, 0.45, 0), (0.07, 0.45, 0.08)),
    "right leg": ((-0.1, 0.45, 0), (0.07, 0.45, 0.08)),
    "left shoe": ((0.11, 0.04, 0.06), (0.045, 0.04, 0.14)),
    "right shoe": ((-0.11, 0.04, 0.06), (0.045, 0.04, 0.14)),
    "left arm": ((0.27, 1.1, 0), (0.05, 0.35, 0.05)),
    "right arm": ((-0.27, 1.1, 0), (0.05, 0.35, 0.05)),
    "left eye": ((0.03, 1.64, 0.11), (0.012, 0.012, 0.012)),
}


def make_person(rings=12, **moved) -> Mesh:
    """The figure; `moved` replaces (centre, radii) of parts, blanks in their names written as _."""
    shapes = {**BODY, **{name.replace("_", " "): shape for name, shape in moved.items()}}
    vertices, faces, material, count = [], [], [], 0
    for index, (centre, radii) in enumerate(shapes.values()):
        points, triangles = ball(centre, radii, rings)
        vertices.append(points)
        faces.append(triangles + count)
        material.append(np.full(len(triangles), index % 2))
        count += len(points)
    vertices, faces = np.concatenate(vertices), np.concatenate(faces)
    uv = vertices[faces][..., :2] / 2 + 0.5  # a planar chart, so that the uv of a corner can be told from its place
    fields = {"uv": uv.astype(np.float32), "color": (vertices[faces] / 2).clip(0, 1).astype(np.float32)}
    fields["material"] = np.concatenate(material).astype(np.int16)
    materials = [Material(np.float32(color)) for color in ((0.5, 0.2, 0.1), (0.1, 0.2, 0.5))]
    return mesh_of(vertices, faces, **fields, materials=materials, info={"name": "person"})


@pytest.fixture
def person():
    return make_person


@pytest.fixture
def ellipsoid():
    return ball
