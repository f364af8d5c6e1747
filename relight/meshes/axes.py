"""Finds which axis of a file points up and which way the figure faces, from the shape of the figure."""

from functools import partial

import numpy as np
from PIL import Image, ImageDraw

from relight.meshes.geometry import face_areas
from relight.meshes.mesh import Mesh

AXES = {sign + axis: (1 if sign == "+" else -1) * np.eye(3)[k] for k, axis in enumerate("xyz") for sign in "+-"}
Band = tuple[float, float]  # from and to, as shares of the height
FEET, ANKLES = (0.0, 0.04), (0.05, 0.10)  # of the height, from the soles
FACE, NECK = (0.05, 0.12), (0.14, 0.17)  # of the height, from the top of the head
SEATED = 0.23  # width times depth, over the squared height: 29 of 31 who sit have more, and 4 of 314 who stand
MIN_OFFSET = 0.008  # of the height: smaller horizontal offsets show no direction
SOLES = 0.01  # least area of two soles, over the squared height: .015 in the median; the top of a head has .006
FLOOR = 0.06  # area of a floor, over the squared longest extent; the soles of six dressed figures have .016 to .018
GRID = 256  # cells along the longest extent, in which covered areas are counted
SHINS, LEVELS = (0.06, 0.20), 6  # of the height: where there is a gap between two legs, but none in a head or skirt
MIN_GAP = 0.03  # of the height: that between legs is .04 to .2; loose hair has .015
LOWEST = 0.02  # of the height: the slice in which soles, floors and plinths are
CROWN, HEAD_RADIUS = 0.05, 0.09  # of the height: the top of the head, and how far head and neck reach sideways from it


def find_axes(mesh: Mesh, up: str | None = None, front: str | None = None) -> tuple[str, str, float]:
    """Finds the axes that are not given.

    Up is the longest extent of the file, y before z where they are similar; negative if legs, or soles and toes, are
    clearly at the other end. Front is where feet and face point: toes are ahead of their ankle and, with half the
    weight, the face is ahead of the neck, whatever the arms do. Without such evidence, y-up files face +z and z-up
    files -y.

    Args:
        mesh: in the file's frame.
        up: name in AXES, or None.
        front: name in AXES, or None.

    Returns:
        Up and front, names in AXES, and the certainty of the front, in [0,1]. It is 1 for a front that was given; 0 for
        that of a convention for lack of evidence, if the evidence points between two axes, or if somebody sits.
    """
    area = face_areas(mesh.vertices, mesh.faces)
    points = mesh.vertices[mesh.faces].mean(axis=1, dtype=np.float64)
    if up is None:
        # A T-pose is as wide as high, and hardly any file is x-up: x must be longest by far, and y goes before z.
        extent = np.ptp(mesh.vertices, axis=0) * [0.8, 1.0, 0.95]
        if front is not None:
            extent[np.abs(AXES[front]).argmax()] = 0
        axis = "xyz"[int(extent.argmax())]
        soles = {sign: _sole_area(mesh, points, AXES[sign + axis]) for sign in "+-"}
        toes = np.linalg.norm(_horizontal_offset(points, area, AXES["-" + axis], FEET, ANKLES))
        gap = partial(_gap, mesh, points, area)
        # Raised arms have a gap, too, but it is above legs that have one or above a skirt, and they have no soles.
        legs = soles["-"] > 0.8 * soles["+"] and gap(AXES["-" + axis]) > MIN_GAP > 2 * gap(AXES["+" + axis])
        inverted = legs or (soles["-"] > max(SOLES, 2 * soles["+"]) and toes > 3 * MIN_OFFSET)
        up = ("-" if inverted else "+") + axis
    if front is not None:
        return up, front, 1.0
    head = _head_faces(points, area, AXES[up])
    ahead = _toe_offset(points, area, AXES[up]) + 0.5 * _horizontal_offset(points, area * head, -AXES[up], FACE, NECK)
    offsets = {name: float(ahead @ axis) for name, axis in AXES.items() if not axis @ AXES[up]}
    front = max(offsets, key=lambda name: offsets[name])
    if (forward := offsets[front]) > MIN_OFFSET:
        aside = float(np.linalg.norm(ahead - forward * AXES[front]))
        width, depth = np.ptp(points, axis=0)[AXES[up] == 0] / np.ptp(points @ AXES[up])
        return up, front, min(float(width * depth < SEATED), forward / (4 * MIN_OFFSET), 1 - aside / forward)
    return up, "-y" if up[1] == "z" else "+z", 0.0


def flat_side(mesh: Mesh) -> str | None:
    """Returns the side, named in AXES, at which a flat part covers most, and more than FLOOR, as of a floor or plinth.

    None if there is no such side.
    """
    area = face_areas(mesh.vertices, mesh.faces)
    points = mesh.vertices[mesh.faces].mean(axis=1, dtype=np.float64)
    limit = FLOOR * max(np.ptp(mesh.vertices, axis=0).max(), 1e-30) ** 2
    covered: dict[str | None, float] = {None: FLOOR}
    for name, axis in AXES.items():
        height = points @ axis
        if area[height >= height.max() - LOWEST * np.ptp(height)].sum() >= limit:  # at least what they cover
            covered[name] = _sole_area(mesh, points, -axis)
    return max(covered, key=covered.__getitem__)  # the walls of a plinth are smaller than what it stands on


def _in_band(points: np.ndarray, up: np.ndarray, band: Band) -> tuple[np.ndarray, float]:
    """Returns which points (N,3) are in a band of the height along the unit vector `up`, and the height."""
    height = points @ up
    size = max(np.ptp(height), 1e-30)
    level = (height - height.min()) / size
    return (level >= band[0]) & (level < band[1]), size


def _horizontal_offset(points: np.ndarray, area: np.ndarray, up: np.ndarray, band: Band, other: Band) -> np.ndarray:
    """Returns the horizontal offset (3,) of one band's centroid from another's, over the height."""

    def centroid(of: Band) -> np.ndarray:
        weight = area * _in_band(points, up, of)[0]
        return points.T @ weight / weight.sum() if weight.any() else np.full(3, np.nan)

    offset = centroid(band) - centroid(other)
    return np.nan_to_num((offset - (offset @ up) * up) / _in_band(points, up, band)[1])


def _toe_offset(points: np.ndarray, area: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Returns the horizontal offset (3,) of the toes from their ankle, over the height, as the mean of two feet.

    The ankles are two clusters of their band, initialised on both sides of its centroid along its longest direction.
    `points` (F,3) are the centres of the faces.
    """
    in_ankles, height = _in_band(points, up, ANKLES)
    in_feet, _ = _in_band(points, up, FEET)
    if not (area[in_ankles].any() and area[in_feet].any()):
        return np.zeros(3)
    flat = (points - np.outer(points @ up, up)) / height
    ankle_points, ankle_area = flat[in_ankles], area[in_ankles]
    foot_points, foot_area = flat[in_feet], area[in_feet]
    centroid, longest = _principal_direction(ankle_points, ankle_area)
    second = (ankle_points - centroid) @ longest > 0  # whether a point belongs to the second ankle
    for _ in range(8):  # iterations of k-means
        weights = ankle_area * np.stack([~second, second])
        ankles = weights @ ankle_points / np.maximum(weights.sum(axis=1, keepdims=True), 1e-30)
        second = _nearer_to_second(ankle_points, ankles)
    second = _nearer_to_second(foot_points, ankles)
    weights = foot_area * np.stack([~second, second])
    present = weights.sum(axis=1) > 0  # a figure may have one foot only
    toes = weights[present] @ foot_points / weights[present].sum(axis=1, keepdims=True)
    return (toes - ankles[present]).mean(axis=0)


def _nearer_to_second(points: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Returns which points (N,3) are nearer to the second than to the first of two centres (2,3), (N,) bool."""
    return np.linalg.norm(points - centres[1], axis=1) < np.linalg.norm(points - centres[0], axis=1)


def _principal_direction(points: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the centroid (3,) of points (N,3) with weights (N,), and their first principal direction (3,)."""
    centroid = weight @ points / weight.sum()
    weighted = (points - centroid) * np.sqrt(weight)[:, None]
    _, directions = np.linalg.eigh(weighted.T @ weighted)  # in columns, by ascending variance
    return centroid, directions[:, -1]


def _gap(mesh: Mesh, points: np.ndarray, area: np.ndarray, up: np.ndarray) -> float:
    """Returns the gap between two legs over the height: the median over LEVELS bands of SHINS.

    The gap of a band is the widest one along its longest direction with at least 30 % of the area on each side. `mesh`
    and `points` (F,3), the centres of its faces, are in the file's frame.
    """
    widest = np.zeros(LEVELS)
    low, high = SHINS
    for i in range(LEVELS):
        band = (low + (high - low) * i / LEVELS, low + (high - low) * (i + 1) / LEVELS)
        inside, height = _in_band(points, up, band)
        if not area[inside].any():
            continue
        _, longest = _principal_direction(points[inside] - np.outer(points[inside] @ up, up), area[inside])
        along = mesh.vertices[mesh.faces[inside]] @ longest
        order = along.min(axis=1).argsort()
        start = along.min(axis=1)[order]
        end = np.maximum.accumulate(along.max(axis=1)[order])  # where all faces up to this one have ended
        share = area[inside][order].cumsum() / area[inside].sum()
        gaps = (start[1:] - end[:-1]) * ((share[:-1] > 0.3) & (share[:-1] < 0.7))
        widest[i] = max(0.0, gaps.max(initial=0.0)) / height
    return float(np.median(widest))


def _head_faces(points: np.ndarray, area: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Returns which faces (F,) are near the vertical through the highest ones: head and neck, no arms."""
    level = points @ up
    height = max(np.ptp(level), 1e-30)
    weight = area * (level > level.max() - CROWN * height)
    offset = points - points.T @ weight / max(weight.sum(), 1e-30)
    return np.linalg.norm(offset - np.outer(offset @ up, up), axis=-1) < HEAD_RADIUS * height


def _sole_area(mesh: Mesh, points: np.ndarray, up: np.ndarray) -> float:
    """Returns the area that layers up to LOWEST cover, each place once, over the squared longest extent."""
    height = points @ up
    lowest = mesh.faces[height <= height.min() + LOWEST * np.ptp(height)]
    longest = max(np.ptp(mesh.vertices, axis=0).max(), 1e-30)  # of any mesh, so that the picture has at most GRID px
    corners = mesh.vertices[lowest][:, :, np.flatnonzero(up == 0)].astype(np.float64) / longest * GRID
    corners -= corners.min(axis=(0, 1))
    picture = Image.new("1", tuple(np.ceil(corners.max(axis=(0, 1))).astype(int) + 1))
    draw = ImageDraw.Draw(picture)
    for triangle in corners.reshape(-1, 6).tolist():  # x y of three corners
        draw.polygon(triangle, fill=1)
    return float(np.asarray(picture).sum()) / GRID**2
