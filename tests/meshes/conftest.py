"""A figure made of ellipsoids, with what alignment and cleaning look for: feet, a face, parts, colors."""

import numpy as np
import pytest

from relight.meshes import Material, Mesh


def ball(centre, radii, rings=12) -> tuple[np.ndarray, np.ndarray]:
    """A closed ellipsoid: vertices (V,3), faces (F,3) counter-clockwise outward."""
    theta = np.linspace(0, np.pi, rings + 1)[1:-1]
    phi = np.arange(2 * rings) * np.pi / rings
    ring = np.stack(
        [
            np.outer(np.sin(theta), np.sin(phi)),
            np.outer(np.cos(theta), np.ones_like(phi)),
            np.outer(np.sin(theta), np.cos(phi)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    n = len(phi)
    vertices = np.concatenate([[[0, 1, 0]], ring, [[0, -1, 0]]]) * radii + centre
    at = lambda i, j: 1 + i * n + j % n  # noqa: E731
    faces = [[0, at(0, j), at(0, j + 1)] for j in range(n)]
    for i in range(len(theta) - 1):
        for j in range(n):
            faces += [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    last = len(vertices) - 1
    faces += [[at(len(theta) - 1, j + 1), at(len(theta) - 1, j), last] for j in range(n)]
    return vertices, np.array(faces)


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
    return Mesh(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        uv=uv.astype(np.float32),
        material=np.concatenate(material).astype(np.int16),
        materials=[Material(np.array([0.5, 0.2, 0.1], np.float32)), Material(np.array([0.1, 0.2, 0.5], np.float32))],
        color=(vertices[faces] / 2).clip(0, 1).astype(np.float32),
        info={"name": "person"},
    )


@pytest.fixture
def person():
    return make_person


@pytest.fixture
def ellipsoid():
    return ball
