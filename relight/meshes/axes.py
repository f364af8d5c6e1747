"""Which axis of a file points up, and which way the figure faces: read from the figure itself."""

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from relight.meshes.mesh import Mesh
from relight.meshes.parts import areas

AXES = {sign + axis: (1 if sign == "+" else -1) * np.eye(3)[k] for k, axis in enumerate("xyz") for sign in "+-"}
FEET, ANKLES = (0.0, 0.04), (0.05, 0.10)  # of the height, from the soles
FACE, NECK = (0.05, 0.12), (0.14, 0.17)  # of the height, from the top of the head
CLEAR = 0.008  # of the height: less ahead than this shows no direction
SOLES = 0.01  # of the squared height: the area that two soles cover; .015 in the median, a head's top .006
GRID = 256  # cells to the longest extent, on which covered area is counted
SHINS, LEVELS = (0.06, 0.20), 6  # of the height: where two legs have nothing between them, but no head and no skirt
APART = 0.03  # of the height: legs are .04 to .2 apart there; loose hair leaves .015


@dataclass
class Axes:
    """The file's axes `up` and `front`; certainty in [0,1] is 0 where a convention stood in for evidence."""

    up: str
    front: str
    certainty: float


def find_axes(mesh: Mesh, up: str | None = None, front: str | None = None) -> Axes:
    """Finds what is not given.

    Up is the longest extent of the file, y before z where they are alike; it is negative when legs, or soles and toes,
    are plainly at the other end. Front is where the feet point and the face looks: each foot's toes lie ahead of its
    ankle, however far the feet are apart, and, half as sure, faces ahead of necks, whatever the arms do. Where neither
    shows, y-up files face +z and z-up files -y.
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

        def apart(sign: str, axis: str = axis) -> float:
            return _apart(mesh, points, area, AXES[sign + axis])

        # Raised arms are apart, too: over legs that are, or over a skirt, but not on soles.
        legs = flat["-"] > 0.8 * flat["+"] and apart("-") > APART > 2 * apart("+")
        inverted = legs or (flat["-"] > max(SOLES, 2 * flat["+"]) and toes > 3 * CLEAR)
        up = ("-" if inverted else "+") + axis
    if front is not None:
        return Axes(up, front, 1.0)
    head = _near_top(points, area, AXES[up])
    ahead = _toes(points, area, AXES[up]) + 0.5 * _ahead(points, area * head, -AXES[up], FACE, NECK)
    shown = {name: float(ahead @ axis) for name, axis in AXES.items() if not axis @ AXES[up]}
    front = max(shown, key=shown.get)
    if shown[front] > CLEAR:
        return Axes(up, front, min(1.0, shown[front] / (4 * CLEAR)))
    return Axes(up, "-y" if up[1] == "z" else "+z", 0.0)


def _between(points: np.ndarray, up: np.ndarray, slice: tuple[float, float]) -> tuple[np.ndarray, float]:
    """Which points (n,3) lie between two shares of the height, counted along `up`; and the height."""
    height = points @ up
    size = max(np.ptp(height), 1e-30)
    level = (height - height.min()) / size
    return (level >= slice[0]) & (level < slice[1]), size


def _ahead(points: np.ndarray, area: np.ndarray, up: np.ndarray, slice: tuple, other: tuple) -> np.ndarray:
    """How far the middle of a slice lies ahead of the middle of another, horizontally, in units of the height.

    points (F,3) and area (F,) of the faces; slices are (from, to) shares of the height, counted along `up`.
    """

    def middle(between: tuple[float, float]) -> np.ndarray:
        weight = area * _between(points, up, between)[0]
        return points.T @ weight / weight.sum() if weight.any() else np.full(3, np.nan)

    offset = middle(slice) - middle(other)
    return np.nan_to_num((offset - (offset @ up) * up) / _between(points, up, slice)[1])


def _toes(points: np.ndarray, area: np.ndarray, up: np.ndarray) -> np.ndarray:
    """How far the toes lie ahead of the ankles, horizontally, in units of the height: the mean of two feet.

    points (F,3) and area (F,) of the faces. The ankles are the two clusters of their slice, begun on both sides of its
    middle along its longest direction.
    """
    ankle, size = _between(points, up, ANKLES)
    foot = _between(points, up, FEET)[0]
    if not (area[ankle].any() and area[foot].any()):
        return np.zeros(3)
    flat = (points - np.outer(points @ up, up)) / size
    at, weight = flat[ankle], area[ankle]
    middle, longest = _spread(at, weight)
    second = (at - middle) @ longest > 0
    for _ in range(8):
        share = weight * np.stack([~second, second])
        ankles = share @ at / np.maximum(share.sum(axis=1, keepdims=True), 1e-30)
        second = np.linalg.norm(at - ankles[1], axis=1) < np.linalg.norm(at - ankles[0], axis=1)
    second = np.linalg.norm(flat[foot] - ankles[1], axis=1) < np.linalg.norm(flat[foot] - ankles[0], axis=1)
    share = area[foot] * np.stack([~second, second])
    there = share.sum(axis=1) > 0
    return (share[there] @ flat[foot] / share[there].sum(axis=1, keepdims=True) - ankles[there]).mean(axis=0)


def _spread(at: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middle of points (n,3) with weights (n,), and the unit direction along which they spread the furthest."""
    middle = weight @ at / weight.sum()
    off = (at - middle) * np.sqrt(weight)[:, None]
    return middle, np.linalg.eigh(off.T @ off)[1][:, -1]


def _apart(mesh: Mesh, points: np.ndarray, area: np.ndarray, up: np.ndarray) -> float:
    """The median, over thin levels of SHINS, of the widest gap between a level's two parts along its longest direction,
    in units of the height; a part has at least three tenths of the area. points (F,3) and area (F,) of the faces."""
    widest = np.zeros(LEVELS)
    low, high = SHINS
    for i in range(LEVELS):
        at, size = _between(points, up, (low + (high - low) * i / LEVELS, low + (high - low) * (i + 1) / LEVELS))
        if not area[at].any():
            continue
        _, longest = _spread(points[at] - np.outer(points[at] @ up, up), area[at])
        along = mesh.vertices[mesh.faces[at]] @ longest
        order = along.min(axis=1).argsort()
        start, end = along.min(axis=1)[order], np.maximum.accumulate(along.max(axis=1)[order])
        share = area[at][order].cumsum() / area[at].sum()
        between = (start[1:] - end[:-1]) * ((share[:-1] > 0.3) & (share[:-1] < 0.7))
        widest[i] = max(0.0, between.max(initial=0.0)) / size
    return float(np.median(widest))


def _near_top(points: np.ndarray, area: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Which faces are near the vertical through the highest ones: a head and a neck without arms beside them (F,)."""
    height = points @ up
    size = max(np.ptp(height), 1e-30)
    weight = area * (height > height.max() - 0.05 * size)
    away = points - points.T @ weight / max(weight.sum(), 1e-30)
    return np.linalg.norm(away - np.outer(away @ up, up), axis=-1) < 0.09 * size


def _flat(mesh: Mesh, points: np.ndarray, up: np.ndarray) -> float:
    """The horizontal area that the faces within 2 % of the height from the lowest one cover, in units of the squared
    longest extent: layers of hair one over the other count once. points (F,3): the middles of the faces."""
    height = points @ up
    low = mesh.faces[height <= height.min() + 0.02 * np.ptp(height)]
    size = max(np.ptp(mesh.vertices, axis=0).max(), 1e-30)  # bounds the picture for any mesh; a figure's is its height
    corners = mesh.vertices[low][:, :, np.flatnonzero(up == 0)].astype(np.float64) / size * GRID
    corners -= corners.min(axis=(0, 1))
    picture = Image.new("1", tuple(np.ceil(corners.max(axis=(0, 1))).astype(int) + 1))
    draw = ImageDraw.Draw(picture)
    for corner in corners.reshape(-1, 6).tolist():
        draw.polygon(corner, fill=1)
    return float(np.asarray(picture).sum()) / GRID**2
