"""Marks: where a garment is sewn, where it ends, and where it rubs and bends, as images of its texture atlas."""

import math

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, zoom
from scipy.spatial import cKDTree

from relight.figures.cut.patterns import Pattern
from relight.figures.cut.suit import arm_share
from relight.figures.dye.panels import Panels, limb_frame, side_plane
from relight.figures.surfaces import rim

MAX_DISTANCE = 0.2  # metres, from seams and borders
CELL = 2  # pixels of the atlas per cell of the images of marks
BLUR = 0.8  # standard deviation by which samples are spread over the cells, cells
MIN_COUNT = 1e-6  # samples in a cell after that, below which it has none
HIP, KNEE, ELBOW = 0.0, 1.0, 1.0  # positions along a limb, see `suit_fields`
FRAY = 0.004  # metres from a border over which it rubs


def marks(pattern: Pattern) -> dict[str, np.ndarray]:
    """Computes the marks of a garment on its pattern; they do not depend on the pose.

    Knees and elbows rub and bend; hips bend; borders rub. Positions along limbs are those of `suit_fields`.

    Returns:
        At the corners (F,3) of its faces: `seam` and `edge`, metres to the nearest seam between panels and to the
        nearest border; `rub` and `bend`, how much the cloth rubs and is bent, in [0,1].
    """
    level, fields = pattern.levels[-1], pattern.fields
    faces, points = level.faces, level.rest_shape
    start, end = points[rim(faces)].swapaxes(0, 1)
    border = np.concatenate([start + t * (end - start) for t in (0.0, 0.25, 0.5, 0.75)])  # four points of each edge
    edge = np.minimum(cKDTree(border).query(points, distance_upper_bound=MAX_DISTANCE)[0], MAX_DISTANCE)[faces]
    rub, bend = np.zeros(len(points)), np.zeros(len(points))
    if pattern.garment.kind == "trousers":
        leg = np.where(fields["x"] > 0, fields["legL"], fields["legR"])
        from_side = np.abs(fields["z"] - np.median(fields["z"]))  # metres to the front or the back; sides rub less
        rub = np.maximum(bell(leg, KNEE, 0.14), 0.8 * bell(leg, 0.45, 0.4)) * np.clip(from_side / 0.05, 0, 1)
        bend = np.maximum(bell(leg, HIP + 0.05, 0.22), bell(leg, KNEE, 0.2))
    elif pattern.garment.kind == "top":
        arm, on_arm = np.maximum(fields["armL"], fields["armR"]), np.clip(arm_share(fields), 0, 1)
        rub, bend = on_arm * bell(arm, ELBOW, 0.15), on_arm * bell(arm, ELBOW, 0.25)
    rub = np.maximum(rub[faces], 0.7 * np.exp(-edge / FRAY))
    return {"seam": seam_distance(pattern), "edge": edge, "rub": rub, "bend": 0.3 + 0.7 * bend[faces]}


def bell(position: np.ndarray, centre: float, width: float) -> np.ndarray:
    """Returns a bell curve: 1 where the position along a limb is `centre`, 1/e at `width` from it."""
    return np.exp(-(((position - centre) / width) ** 2))


def seam_distance(pattern: Pattern) -> np.ndarray:
    """Returns the metres (F,3), at most MAX_DISTANCE, from each face's corners to the nearest seam of a garment.

    Seams are at the sides, shoulders and armholes, and along the insides of limbs.
    """
    level = pattern.levels[-1]
    faces, points = level.faces, level.rest_shape
    corner, distance = points[faces], np.full(faces.shape, MAX_DISTANCE)
    if pattern.garment.kind == "scarf":
        return distance
    if pattern.garment.kind == "trousers":
        for side in "LR":
            on_limb, _, forward = limb_frame(pattern, side)
            above_crotch = corner[on_limb][..., 1] > pattern.body.heights["crotch"] - 0.01
            to_middle_seam = np.where(above_crotch, np.abs(corner[on_limb][..., 0]), MAX_DISTANCE)
            distance[on_limb] = np.minimum(np.abs(forward), to_middle_seam)
        return np.minimum(distance, MAX_DISTANCE)
    distance = np.abs(corner[..., 2] - side_plane(pattern))
    if pattern.garment.kind == "top":
        for side in "LR":
            on_limb, up, forward = limb_frame(pattern, side)
            distance[on_limb] = np.where(up < 0, np.abs(forward), MAX_DISTANCE)  # under the arm
        armhole = np.intersect1d(faces[pattern.sleeve], faces[~pattern.sleeve])
        if len(armhole):
            to_armhole = cKDTree(points[armhole]).query(points, distance_upper_bound=MAX_DISTANCE)[0]
            distance = np.minimum(distance, to_armhole[faces])
    return np.minimum(distance, MAX_DISTANCE)


def images(panels: Panels, marks: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Renders the marks into images of the atlas.

    Each face is sampled at seven points: its corners, the middles of its sides, and its centre. A cell is the mean over
    the samples in it and near it, or, where there are none, that of the nearest cell that has some.

    Args:
        panels: the atlas.
        marks: at the corners (F,3) of the faces, by name.

    Returns:
        (side,side) float32 images by the name of the mark, with rows from the bottom up.
    """
    side = math.ceil(panels.side / CELL)  # cells
    barycentric = np.concatenate([np.eye(3), 0.5 * (1 - np.eye(3)), np.full((1, 3), 1 / 3)])  # (7,3)
    column_row = np.floor(np.einsum("wk,fkd->wfd", barycentric, panels.uv) * side).astype(int).clip(0, side - 1)
    cell = (column_row[..., 1] * side + column_row[..., 0]).ravel()
    count = gaussian_filter(np.bincount(cell, minlength=side * side).reshape(side, side).astype(float), BLUR)
    nearest = distance_transform_edt(count < MIN_COUNT, return_distances=False, return_indices=True)
    rendered = {}
    for name, at_corners in marks.items():
        values = np.einsum("wk,fk->wf", barycentric, at_corners).ravel()
        total = np.bincount(cell, values, side * side).reshape(side, side)
        mean = gaussian_filter(total, BLUR) / np.maximum(count, MIN_COUNT)
        enlarged = zoom(mean[*nearest].astype(np.float32), CELL, order=1, grid_mode=True, mode="nearest")
        rendered[name] = enlarged[: panels.side, : panels.side]
    return rendered
