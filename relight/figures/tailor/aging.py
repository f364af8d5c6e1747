"""Traces of sewing and wear in the albedo: seams, hems, ribs, fading, creases, soil, panels of unequal dye."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, zoom
from scipy.spatial import cKDTree

from relight.figures.body.person import Body
from relight.figures.surfaces import rim
from relight.figures.tailor.fabrics import Fabric, trait
from relight.figures.tailor.garments import Garment
from relight.figures.tailor.panels import Panels, limb_frame, side_plane
from relight.figures.tailor.patterns import Pattern
from relight.figures.tailor.seams import line
from relight.figures.texture import band, grain, lattice

MAX_DISTANCE = 0.2  # metres, from seams and borders
CELL = 2  # pixels of the atlas per cell of the images of marks
RIB = 0.055  # metres of ribbing at hems and cuffs
FADES = {"denim": 1.0, "leather": 0.45, "corduroy": 0.35, "knit": 0.1, "melange": 0.1, "tweed": 0.08}  # others have .2


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


def marks(body: Body, pattern: Pattern) -> Marks:
    """Computes the marks of a garment; they do not depend on the pose."""
    level, fields = pattern.levels[-1], pattern.fields
    faces, p = level.faces, level.rest_shape
    sides = rim(faces)
    ends = p[sides]
    border = np.concatenate([ends[:, 0] + t * (ends[:, 1] - ends[:, 0]) for t in (0.0, 0.25, 0.5, 0.75)])
    edge = np.minimum(cKDTree(border).query(p, distance_upper_bound=MAX_DISTANCE)[0], MAX_DISTANCE)[faces]
    seam = seam_distance(body, pattern)
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


def seam_distance(body: Body, pattern: Pattern) -> np.ndarray:
    """Returns the metres (F,3) to the nearest seam: sides, shoulders, armholes, insides of limbs."""
    level = pattern.levels[-1]
    faces, p = level.faces, level.rest_shape
    corner = p[faces]
    if pattern.garment.kind == "scarf":
        return np.full(faces.shape, MAX_DISTANCE)
    if pattern.garment.kind == "trousers":
        out = np.full(faces.shape, MAX_DISTANCE)
        for side in "LR":
            mine, _, forward = limb_frame(body, pattern, side)
            rise = np.where(corner[mine][..., 1] > pattern.crotch - 0.01, np.abs(corner[mine][..., 0]), MAX_DISTANCE)
            out[mine] = np.minimum(np.abs(forward), rise)
        return np.minimum(out, MAX_DISTANCE)
    out = np.abs(corner[..., 2] - side_plane(pattern))
    if pattern.garment.kind == "top":
        for side in "LR":
            mine, up, forward = limb_frame(body, pattern, side)
            out[mine] = np.where(up < 0, np.abs(forward), MAX_DISTANCE)
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


def aged(
    garment: Garment,
    fabric: Fabric,
    name: str,
    u: np.ndarray,
    v: np.ndarray,
    marks_here: dict[str, np.ndarray],
    texel: float,
    color: np.ndarray,
) -> np.ndarray:
    """Adds traces of sewing and wear to the albedo of a panel.

    Args:
        garment: of the panel.
        fabric: its seed gives age and soil.
        name: of the panel.
        u: (h,w) cloth coordinate across, metres.
        v: (h,w) cloth coordinate along, metres.
        marks_here: (h,w) the panel's part of `images`.
        texel: metres between the samples.
        color: (h,w,3) linear albedo.

    Returns:
        (h,w,3) linear albedo.
    """
    kind, number = fabric.kind, sum(map(ord, name))
    soil, age, offset = trait(fabric, 10), trait(fabric, 11), 3.17 * (number % 19)
    thin = min(1.0, 0.0016 / texel)  # contrast of a line that is thinner than a texel
    log = (
        0.035 * (2 * trait(fabric, 40 + number % 7) - 1) * np.ones(u.shape, u.dtype)
    )  # panels are cut from other bolts
    # seams and hems
    uneven = grain(u, v, 0.012, 0.012, texel, fabric.seed + 60, offset)
    log -= 0.40 * thin * line(marks_here["seam"] / max(1.0, texel / 0.0011)) * (kind != "scarf")
    stitch = line((marks_here["edge"] - 0.020 * (1 + (garment.thickness > 0.004))) / max(1.0, texel / 0.0011))
    ribbed = kind not in ("denim", "leather") and max(garment.hem_pin, garment.cuff_pin - 0.1) > 0.35
    if ribbed:
        inside = np.clip((RIB - marks_here["edge"]) / 0.003, 0, 1)
        log += inside * (0.30 * thin * (band(u, 0.0055, 0.5, max(0.002, texel)) - 0.5) - 0.05)
        log -= 0.30 * thin * line((marks_here["edge"] - RIB) / max(1.0, texel / 0.0011))
    elif kind == "denim":
        dashes = np.maximum(stitch, np.maximum(line(marks_here["seam"] - 0.0025), line(marks_here["seam"] - 0.0075)))
        color = color + (np.array([0.36, 0.20, 0.07]) - color) * (0.55 * thin * dashes)[..., None]
    else:
        log -= 0.22 * thin * stitch
    pucker = np.exp(-np.minimum(marks_here["seam"], marks_here["edge"]) / 0.010)
    rope = grain(u + v, v - u, 0.010, 0.014, texel, fabric.seed + 61, offset)
    fades = FADES.get(kind, 0.2) * (0.4 + 0.9 * age)
    log += (0.05 + 0.13 * fades) * pucker * rope
    # fading
    worn = np.clip(marks_here["rub"] * (0.75 + 0.25 * uneven) + 0.35 * pucker * np.clip(rope, 0, 2), 0, 1)
    pale = 0.5 * color + 0.5 * np.array([0.48, 0.51, 0.55]) if kind == "denim" else 1.5 * color + 0.01
    color = color + (pale - color) * np.clip(0.55 * fades * worn, 0, 1)[..., None]
    lines = np.abs(grain(u, v, 0.055, 0.011, texel, fabric.seed + 62, offset))  # old creases lost their dye
    log += (0.02 + 0.13 * fades) * marks_here["bend"] * np.clip(1 - 1.8 * lines, -0.3, 1)
    # soil
    low = np.exp(-marks_here["edge"] / 0.035) * (garment.kind == "trousers")
    log -= 0.25 * soil * low * np.clip(0.6 + 0.5 * uneven, 0, 2)
    for k in range(int(5 * soil**2 * (0.5 + trait(fabric, 13)))):
        x, y, r = (float(lattice(np.array(k), np.array(number + 100 * j), fabric.seed)) for j in range(3))
        x, y = u.min() + x * np.ptp(u), v.min() + y * np.ptp(v)
        radius = 0.004 + 0.022 * r**2
        distance = np.hypot(u - x, v - y) / radius + 0.15 * uneven
        log -= (0.10 + 0.22 * r) * np.clip((1.15 - distance) / 0.3, 0, 1)
    if garment.front_gap and garment.collar == "stand" and name == "front":  # the teeth of a zip
        teeth = (marks_here["edge"] < 0.006) & (np.abs(u) < 3 * garment.front_gap)
        share = 0.8 * teeth * (0.35 + 0.65 * thin * band(v, 0.004, 0.5, max(0.001, texel)))
        color = color + (np.array([0.30, 0.29, 0.27]) - color) * share[..., None]
    return np.clip(color * np.exp(log)[..., None], 0.006, 0.88)
