"""Panels: a garment's cloth coordinates in metres, along the straight grain, and their texture atlas."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from relight.figures.body.shape import Body
from relight.figures.cut.patterns import Pattern
from relight.figures.texture import coded

GUTTER = 2  # pixels between panels and around them


class Box(NamedTuple):
    """The rectangle of a panel in the atlas.

    Attributes:
        u, v: cloth coordinates of the panel's lower left corner, metres.
        column, row: of the rectangle's lower left pixel; rows run from the bottom up.
        columns, rows: its size in pixels.
    """

    u: float
    v: float
    column: int
    row: int
    columns: int
    rows: int


Painter = Callable[[str, np.ndarray, np.ndarray, tuple[slice, slice]], np.ndarray]  # see `draw`


@dataclass(frozen=True)
class Panels:
    """The panels of a garment and their texture atlas.

    Attributes:
        names: names of the panels, by number.
        panel: (F,) number of each face's panel.
        cloth: (F,3,2) cloth coordinates of the corners, metres across and along.
        uv: (F,3,2) of the corners in the atlas.
        boxes: rectangle of each panel, by number.
        scale: pixels per metre.
        side: pixels of the atlas.
    """

    names: list[str]
    panel: np.ndarray
    cloth: np.ndarray
    uv: np.ndarray
    boxes: dict[int, Box]
    scale: float
    side: int


def _arc_length(sideways: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """Returns the arc length (F,3) from a panel's middle, which is forward: radius times angle, without jumps."""
    angle = np.arctan2(sideways, forward)
    angle = angle[:, :1] + (angle - angle[:, :1] + np.pi) % (2 * np.pi) - np.pi
    return angle * np.hypot(sideways, forward)


def side_plane(pattern: Pattern) -> float:
    """Returns the z of the plane between front and back of the trunk, metres."""
    points, y = pattern.levels[-1].rest_shape, pattern.fields["y"]
    return float(np.median(points[y > np.median(y), 2]))  # of the upper half


def limb_frame(pattern: Pattern, side: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finds the faces of a sleeve or trouser leg.

    Args:
        pattern: pattern of a top or trousers.
        side: L | R.

    Returns:
        Which faces (F,) belong to the limb; of their corners, the metres (m,3) outward from a leg's axis, or upward
        from an arm's; the same forward.
    """
    level, joints = pattern.levels[-1], pattern.body.joints
    corner = level.rest_shape[level.faces]
    middle = corner.mean(1)[:, 0]
    sign = 1 if side == "L" else -1
    on_limb = middle > 0 if side == "L" else middle <= 0
    if pattern.garment.kind == "trousers":
        line = np.stack([joints[f"{bone}.{side}"] for bone in ("foot", "lowerleg01", "upperleg01")])
        centre = [np.interp(corner[on_limb][..., 1], line[:, 1], line[:, axis]) for axis in (0, 2)]
        return on_limb, (corner[on_limb][..., 0] - centre[0]) * sign, corner[on_limb][..., 2] - centre[1]
    on_limb = pattern.sleeve & ((middle > 0) == (side == "L"))
    _, up, forward = _arm_axes(pattern.body, side)
    from_shoulder = corner[on_limb] - joints[f"upperarm01.{side}"]
    return on_limb, from_shoulder @ up, from_shoulder @ forward


def _arm_axes(body: Body, side: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns three unit vectors (3,) of the arm of a side ("L" | "R") on the rest pose: along it, up, and forward."""
    start, end = body.joints[f"upperarm01.{side}"], body.joints[f"wrist.{side}"]
    along = (end - start) / np.linalg.norm(end - start)
    up = np.array([0.0, 1.0, 0.0]) - along * along[1]
    up /= np.linalg.norm(up)
    return along, up, np.cross(along, up) * (-1 if side == "L" else 1)


def cloth_coordinates(pattern: Pattern) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Divides a garment into panels and flattens them.

    Returns:
        The panels' names by number, the number (F,) of each face's panel, and cloth coordinates (F,3,2) of its corners,
        metres across and along the panel.
    """
    level = pattern.levels[-1]
    faces = level.faces
    corner = level.rest_shape[faces]
    if pattern.garment.kind == "scarf":  # both halves have the same texture, from the middle to the ends
        return ["scarf"], np.zeros(len(faces), int), np.stack([corner[..., 0], np.abs(corner[..., 1])], axis=-1)
    cloth = np.zeros((*faces.shape, 2))
    cloth[..., 1] = corner[..., 1] - pattern.body.heights["crotch"]
    panel = np.zeros(len(faces), int)
    if pattern.garment.kind == "trousers":
        names = ["front left", "front right", "back left", "back right"]
        for k, side in enumerate("LR"):
            sign = 1 if side == "L" else -1
            on_limb, outward, forward = limb_frame(pattern, side)
            back = forward.mean(1) < 0
            panel[on_limb] = k + 2 * back
            turn = np.where(back, -1, 1)[:, None]
            cloth[on_limb, :, 0] = _arc_length(outward * turn, forward * turn) * turn * sign
        return names, panel, cloth
    names = ["front", "back", "left sleeve", "right sleeve"]
    axis = side_plane(pattern)
    back = corner.mean(1)[:, 2] < axis
    turn = np.where(back, -1, 1)[:, None]
    panel[back] = 1
    cloth[..., 0] = _arc_length(corner[..., 0] * turn, (corner[..., 2] - axis) * turn)
    if pattern.garment.kind == "top":
        for k, side in enumerate("LR"):
            on_limb, up, forward = limb_frame(pattern, side)
            panel[on_limb] = 2 + k
            along, _, _ = _arm_axes(pattern.body, side)
            from_shoulder = corner[on_limb] - pattern.body.joints[f"upperarm01.{side}"]
            cloth[on_limb, :, 0] = _arc_length(forward, up)
            cloth[on_limb, :, 1] = -(from_shoulder @ along)
    return names, panel, cloth


def lay_out(names: list[str], panel: np.ndarray, cloth: np.ndarray, side: int) -> Panels:
    """Packs the panels' rectangles, in rows of falling height, into a square at the largest scale that fits.

    Args:
        names: names of the panels, by number.
        panel: (F,) number of each face's panel.
        cloth: (F,3,2) cloth coordinates of the corners, metres.
        side: of the square, pixels.
    """
    used = [int(k) for k in np.unique(panel)]
    low = {k: cloth[panel == k].reshape(-1, 2).min(0) for k in used}
    span = {k: cloth[panel == k].reshape(-1, 2).max(0) - low[k] for k in used}
    order = sorted(used, key=lambda k: (-span[k][1], k))

    def place(scale: float) -> dict[int, Box]:
        """Returns the rectangles at a scale; none if they do not fit."""
        boxes, x, y, row_height = {}, 0, 0, 0
        for k in order:
            width, height = (int(np.ceil(metres * scale)) + 2 * GUTTER for metres in span[k])
            if x + width > side:  # begins another row
                x, y, row_height = 0, y + row_height, 0
            if width > side or y + height > side:
                return {}
            boxes[k] = Box(float(low[k][0]), float(low[k][1]), x, y, width, height)
            x, row_height = x + width, max(row_height, height)
        return boxes

    small, large = 1.0, 20.0 * side  # pixels per metre: one scale that fits, and one that does not
    for _ in range(30):  # bisection of the logarithm
        scale = np.sqrt(small * large)
        small, large = (scale, large) if place(scale) else (small, scale)
    boxes = place(small)
    uv = np.zeros_like(cloth)
    for k, box in boxes.items():
        on_panel = panel == k
        uv[on_panel, :, 0] = (box.column + GUTTER + (cloth[on_panel, :, 0] - box.u) * small) / side
        uv[on_panel, :, 1] = (box.row + GUTTER + (cloth[on_panel, :, 1] - box.v) * small) / side
    return Panels(names, panel, cloth, uv, boxes, small, side)


def draw(panels: Panels, paint: Painter) -> np.ndarray:
    """Paints the atlas of a garment.

    Args:
        panels: panels of the garment.
        paint: (name of a panel, u (h,w), v (h,w), place) to linear albedo (h,w,3); the place is two slices of the
            atlas with rows from the bottom up.

    Returns:
        (side,side,3) uint8 sRGB.
    """
    image = np.full((panels.side, panels.side, 3), 128, np.uint8)
    for k, box in panels.boxes.items():
        u = box.u + (np.arange(box.columns) + 0.5 - GUTTER) / panels.scale
        v = box.v + (np.arange(box.rows) + 0.5 - GUTTER) / panels.scale
        u, v = np.broadcast_arrays(u[None].astype(np.float32), v[:, None].astype(np.float32))
        place = (slice(box.row, box.row + box.rows), slice(box.column, box.column + box.columns))
        image[place] = coded(paint(panels.names[k], u, v, place))
    return image[::-1].copy()  # rows run from the top, v from the bottom
