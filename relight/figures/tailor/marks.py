"""Marks: where a garment is sewn, where it ends, and where it rubs and bends, as images of its texture atlas."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, zoom
from scipy.spatial import cKDTree

from relight.figures.surfaces import rim
from relight.figures.tailor.panels import Panels, limb_frame, side_plane
from relight.figures.tailor.patterns import Pattern

MAX_DISTANCE = 0.2  # metres, from seams and borders
CELL = 2  # pixels of the atlas per cell of the images of marks


@dataclass(frozen=True)
class Marks:
    """Where a garment is sewn and worn, at the corners (F,3) of its faces.

    Attributes:
        seam: metres to the nearest seam between panels.
        edge: metres to the nearest border.
        rub: how much the cloth rubs, in [0,1].
        bend: how much it is bent, in [0,1].
    """

    seam: np.ndarray
    edge: np.ndarray
    rub: np.ndarray
    bend: np.ndarray


def marks(pattern: Pattern) -> Marks:
    """Computes the marks of a garment; they do not depend on the pose."""
    level, fields = pattern.levels[-1], pattern.fields
    faces, p = level.faces, level.rest_shape
    sides = rim(faces)
    ends = p[sides]
    border = np.concatenate([ends[:, 0] + t * (ends[:, 1] - ends[:, 0]) for t in (0.0, 0.25, 0.5, 0.75)])
    edge = np.minimum(cKDTree(border).query(p, distance_upper_bound=MAX_DISTANCE)[0], MAX_DISTANCE)[faces]
    seam = seam_distance(pattern)
    rub, bend = np.zeros(len(p)), np.zeros(len(p))
    if pattern.garment.kind == "trousers":
        leg = np.where(fields["x"] > 0, fields["legL"], fields["legR"])
        middle = np.abs(fields["z"] - np.median(fields["z"]))
        thigh = np.exp(-(((leg - 0.45) / 0.4) ** 2))
        rub = np.maximum(np.exp(-(((leg - 1.0) / 0.14) ** 2)), 0.8 * thigh) * np.clip(middle / 0.05, 0, 1)
        bend = np.maximum(np.exp(-(((leg - 0.05) / 0.22) ** 2)), np.exp(-(((leg - 1.0) / 0.2) ** 2)))
    elif pattern.garment.kind == "top":
        arm = np.maximum(fields["armL"], fields["armR"])
        arm_share = np.maximum(fields["arm_shareL"], fields["arm_shareR"])
        rub = np.clip(arm_share, 0, 1) * np.exp(-(((arm - 1.0) / 0.15) ** 2))
        bend = np.clip(arm_share, 0, 1) * np.exp(-(((arm - 1.0) / 0.25) ** 2))
    rub = np.maximum(rub[faces], 0.7 * np.exp(-edge / 0.004))
    return Marks(seam, edge, rub, 0.3 + 0.7 * bend[faces])


def seam_distance(pattern: Pattern) -> np.ndarray:
    """Returns the metres (F,3) to the nearest seam: sides, shoulders, armholes, insides of limbs."""
    level = pattern.levels[-1]
    faces, p = level.faces, level.rest_shape
    corner = p[faces]
    if pattern.garment.kind == "scarf":
        return np.full(faces.shape, MAX_DISTANCE)
    if pattern.garment.kind == "trousers":
        out = np.full(faces.shape, MAX_DISTANCE)
        for side in "LR":
            on_limb, _, forward = limb_frame(pattern, side)
            rise = np.where(
                corner[on_limb][..., 1] > pattern.body.heights["crotch"] - 0.01,
                np.abs(corner[on_limb][..., 0]),
                MAX_DISTANCE,
            )
            out[on_limb] = np.minimum(np.abs(forward), rise)
        return np.minimum(out, MAX_DISTANCE)
    out = np.abs(corner[..., 2] - side_plane(pattern))
    if pattern.garment.kind == "top":
        for side in "LR":
            on_limb, up, forward = limb_frame(pattern, side)
            out[on_limb] = np.where(up < 0, np.abs(forward), MAX_DISTANCE)
        armhole = np.intersect1d(faces[pattern.sleeve], faces[~pattern.sleeve])
        if len(armhole):
            near = cKDTree(p[armhole]).query(p, distance_upper_bound=MAX_DISTANCE)[0]
            out = np.minimum(out, near[faces])
    return np.minimum(out, MAX_DISTANCE)


def images(panels: Panels, marks: Marks) -> dict[str, np.ndarray]:
    """Renders the marks into images (side,side) of the atlas, with rows from the bottom up."""
    side = -(-panels.side // CELL)
    weights = np.concatenate([np.eye(3), 0.5 * (1 - np.eye(3)), np.full((1, 3), 1 / 3)])
    at = np.floor(np.einsum("wk,fkd->wfd", weights, panels.uv) * side).astype(int).clip(0, side - 1)
    cell = (at[..., 1] * side + at[..., 0]).ravel()
    count = gaussian_filter(np.bincount(cell, minlength=side * side).reshape(side, side).astype(float), 0.8)
    out = {}
    for name in ("seam", "edge", "rub", "bend"):
        values = np.einsum("wk,fk->wf", weights, getattr(marks, name)).ravel()
        total = np.bincount(cell, values, side * side).reshape(side, side)
        mean = gaussian_filter(total, 0.8) / np.maximum(count, 1e-6)
        out[name] = zoom(mean.astype(np.float32), CELL, order=1, grid_mode=True, mode="nearest")[
            : panels.side, : panels.side
        ]
    return out
