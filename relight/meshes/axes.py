"""Which axis of a file points up, and which way the figure faces: read from the figure itself."""

from dataclasses import dataclass

import numpy as np

from relight.meshes.mesh import Mesh
from relight.meshes.parts import areas

AXES = {sign + axis: (1 if sign == "+" else -1) * np.eye(3)[k] for k, axis in enumerate("xyz") for sign in "+-"}
FEET, ANKLES = (0.0, 0.04), (0.05, 0.10)  # of the height, from the soles
FACE, NECK = (0.05, 0.12), (0.14, 0.17)  # of the height, from the top of the head
CLEAR = 0.008  # of the height: less ahead than this shows no direction
SOLES = 0.01  # of the squared height: the flat area of two soles; .015 in the median, a head's top has .0055


@dataclass
class Axes:
    """The file's axes `up` and `front`; certainty in [0,1] is 0 where a convention stood in for evidence."""

    up: str
    front: str
    certainty: float


def find_axes(mesh: Mesh, up: str | None = None, front: str | None = None) -> Axes:
    """Finds what is not given.

    Up is the longest extent of the file, y before z where they are alike; it is negative when soles and toes are
    plainly at the other end. Front is where the feet point and the face looks: toes lie ahead of ankles and, half as
    sure, faces ahead of necks, whatever the arms do. Where neither shows, y-up files face +z and z-up files -y.
    """
    area = areas(mesh.vertices, mesh.faces)
    points = mesh.vertices[mesh.faces].mean(axis=1, dtype=np.float64)
    if up is None:
        weight = np.ptp(mesh.vertices, axis=0) * [0.8, 1.0, 0.95]  # a T-pose is as wide as high; hardly a file is x-up
        if front is not None:
            weight[np.abs(AXES[front]).argmax()] = 0
        axis = "xyz"[int(weight.argmax())]
        flat = {sign: _flat(mesh, points, AXES[sign + axis]) for sign in "+-"}
        toes = np.linalg.norm(_ahead(points, area, AXES["-" + axis], FEET, ANKLES))
        inverted = flat["-"] > max(SOLES, 2 * flat["+"]) and toes > 3 * CLEAR
        up = ("-" if inverted else "+") + axis
    if front is not None:
        return Axes(up, front, 1.0)
    head = _near_top(points, area, AXES[up])
    ahead = _ahead(points, area, AXES[up], FEET, ANKLES) + 0.5 * _ahead(points, area * head, -AXES[up], FACE, NECK)
    shown = {name: float(ahead @ axis) for name, axis in AXES.items() if not axis @ AXES[up]}
    front = max(shown, key=shown.get)
    if shown[front] > CLEAR:
        return Axes(up, front, min(1.0, shown[front] / (4 * CLEAR)))
    return Axes(up, "-y" if up[1] == "z" else "+z", 0.0)


def _ahead(points: np.ndarray, area: np.ndarray, up: np.ndarray, slice: tuple, other: tuple) -> np.ndarray:
    """How far the middle of a slice lies ahead of the middle of another, horizontally, in units of the height.

    points (F,3) and area (F,) of the faces; slices are (from, to) shares of the height, counted along `up`.
    """
    height = points @ up
    size = max(np.ptp(height), 1e-30)
    level = (height - height.min()) / size

    def middle(between: tuple[float, float]) -> np.ndarray:
        weight = area * ((level >= between[0]) & (level < between[1]))
        return points.T @ weight / weight.sum() if weight.any() else np.full(3, np.nan)

    offset = middle(slice) - middle(other)
    return np.nan_to_num((offset - (offset @ up) * up) / size)


def _near_top(points: np.ndarray, area: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Which faces are near the vertical through the highest ones: a head and a neck without arms beside them (F,)."""
    height = points @ up
    size = max(np.ptp(height), 1e-30)
    weight = area * (height > height.max() - 0.05 * size)
    away = points - points.T @ weight / max(weight.sum(), 1e-30)
    return np.linalg.norm(away - np.outer(away @ up, up), axis=-1) < 0.09 * size


def _flat(mesh: Mesh, points: np.ndarray, up: np.ndarray) -> float:
    """The horizontal area within 2 % of the height from the lowest point, in units of the squared height."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    height = points @ up
    size = max(np.ptp(height), 1e-30)
    low = height < height.min() + 0.02 * size
    return float(np.abs(np.cross(b - a, c - a)[low] @ up).sum() / 2 / size**2)
