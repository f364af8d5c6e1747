"""Hats: round shells over the scalp, and the peaks of caps."""

import numpy as np

from relight.figures.assemble.hair.combing import head_centre
from relight.figures.assemble.hair.strands import Strip
from relight.figures.body import makehuman
from relight.figures.body.motion import Motion
from relight.figures.drape.colliders import Collider
from relight.figures.draw.hairstyles import HairStyle
from relight.figures.surfaces import cut_cells, ring_grid, thickened

COLUMNS, CROWN_ROWS, BRIM_ROWS = 180, 34, 8  # vertices around the head, from crown to rim, and along a peak
TOP_GAP = 0.02  # radians between the zenith and the first row
RIM_AZIMUTH = (0.0, 1.0, 1.5, 1.9, np.pi)  # radians from the front, where the height of the rim is given
RIM_SIDES_AND_BACK = (-0.14, -0.30, -0.46)  # sine of its elevation about the head's centre, at the last three
HAT_THICKNESS = 0.003  # metres
FIRST_RADIUS, MAX_RADIUS = 0.10, 0.125  # metres from the head's centre to the scalp: first guess, and limit
BRIM_HALF_ANGLE = 0.95  # radians of azimuth to either side of the front where a peak is joined to the crown
BRIM_END = 0.98  # radians of azimuth where its elliptic edge would meet the crown
BRIM_LENGTH = 0.072  # metres, in front


def hat(motion: Motion, style: HairStyle) -> list[Strip]:
    """Builds a round shell over the scalp, and the peak of a cap.

    Args:
        motion: how the body moves from its rest pose into the pose.
        style: a style with a hat.

    Returns:
        For each part its posed vertices (V,3), faces (F,3) and uv (V,2).
    """
    centre = head_centre(motion.body)
    head = Collider.at_rest(motion.body.skin, makehuman.base().faces["body"])
    azimuth = np.linspace(-np.pi, np.pi, COLUMNS, endpoint=False)
    front = 0.10 if style.hat == "beanie" else 0.20  # sine of the rim's elevation above the forehead
    rim = np.arcsin(np.interp(np.abs(azimuth), RIM_AZIMUTH, (front, front, *RIM_SIDES_AND_BACK)))
    around, down = np.meshgrid(azimuth, np.linspace(0, 1, CROWN_ROWS))  # `down` is 0 at the top, 1 at the rim
    elevation = np.pi / 2 - TOP_GAP - (np.pi / 2 - TOP_GAP - rim) * down
    level = np.cos(elevation)
    direction = np.stack([np.sin(around) * level, np.sin(elevation), np.cos(around) * level], -1)
    above_scalp = _hat_height(style, direction, down)
    points = centre + direction * (_scalp_radius(head, centre, direction) + above_scalp)[..., None]
    uv = np.stack([np.abs(around) / (2 * np.pi), 1 - 0.5 * down], -1)  # both sides alike, so without a seam
    faces = cut_cells(ring_grid(CROWN_ROWS, COLUMNS), "acb", "bcd", by_row=True)
    parts = [(points.reshape(-1, 3), faces, uv.reshape(-1, 2))]
    if style.hat == "cap":
        parts.append(_brim(points, azimuth))
    weights = np.zeros(len(motion.bones))
    weights[motion.bones["head"]] = 1
    strips = []
    for vertices, faces, vertex_uv in parts:
        posed = motion.skin(np.tile(weights, (len(vertices), 1)), vertices)
        posed, thick_faces, corner = thickened(posed, faces, HAT_THICKNESS, rings=6)
        uv = np.zeros((len(posed), 2))
        uv[thick_faces] = vertex_uv[faces.ravel()[corner]]
        strips.append((posed, thick_faces, uv))
    return strips


def _scalp_radius(head: Collider, centre: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Returns the metres (h,w) from `centre` (3,) of the skull to the skin along unit directions (h,w,3).

    Each step searches the skin's nearest point to the current one, and goes half the way to that point's distance along
    the direction.
    """
    flat = direction.reshape(-1, 3)
    radius = np.full(len(flat), FIRST_RADIUS)
    for _ in range(8):
        _, nearest, _ = head.nearest(centre + flat * radius[:, None], max_distance=0.2)
        radius = 0.5 * radius + 0.5 * np.einsum("nd,nd->n", nearest - centre, flat)
    return np.minimum(radius.reshape(direction.shape[:2]), MAX_RADIUS)


def _hat_height(style: HairStyle, direction: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Returns the metres (h,w) between scalp and hat, more at the top and at the turned-up, ribbed edge of a beanie.

    `direction` (h,w,3) is seen from the head's centre, and `down` (h,w) is 0 at the top of the hat and 1 at its rim.
    """
    room = (0.022 if style.hat == "beanie" else 0.012) * np.clip(direction[..., 1], 0, 1) ** 2
    height = style.slack * (0.75 + 0.25 * np.clip((1 - down) / 0.3, 0, 1)) + room
    if style.hat != "beanie":
        return height
    azimuth = np.arctan2(direction[..., 0], direction[..., 2])
    turned_up = np.clip((down - 0.66) / 0.03, 0, 1)  # the lowest third
    return height + 0.0045 * turned_up + 0.0008 * np.cos(60 * azimuth)  # 60 ribs


def _brim(points: np.ndarray, azimuth: np.ndarray) -> Strip:
    """Builds the peak of a cap: a curved plate that begins at the front of the crown's rim.

    `points` (rows,columns,3) are those of the crown, and `azimuth` (columns,) is 0 in front. Returns vertices (V,3),
    faces (F,3), and uv (V,2), all in the middle of the texture.
    """
    front = np.abs(azimuth) < BRIM_HALF_ANGLE
    rim, angle = points[-1][front], azimuth[front]
    # Forward and down, steeper toward the sides, so that the peak is curved.
    outward = np.stack([0.25 * np.sin(angle), -0.32 - 0.5 * (angle / BRIM_HALF_ANGLE) ** 2, np.ones_like(angle)], 1)
    share = np.linspace(0, 1, BRIM_ROWS)[:, None]  # of the way to the edge
    reach = BRIM_LENGTH * share * np.sqrt(np.clip(1 - (angle / BRIM_END) ** 2, 0, 1))
    vertices = (rim + outward * reach[..., None] + np.array([0, 0.002, 0.0])).reshape(-1, 3)
    faces = cut_cells(np.arange(len(vertices)).reshape(BRIM_ROWS, len(rim)), "acb", "bcd", by_row=True)
    return vertices, faces, np.full((len(vertices), 2), 0.5)
