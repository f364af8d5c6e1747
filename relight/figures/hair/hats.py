"""Hats: round shells over the scalp, and the peaks of caps."""

import numpy as np

from relight.figures.body import makehuman
from relight.figures.cloth.colliders import Collider
from relight.figures.hair.combing import head_centre
from relight.figures.hair.strands import Strip
from relight.figures.hair.styles import HairStyle
from relight.figures.pose.motion import Motion
from relight.figures.surfaces import thickened

COLUMNS, CROWN_ROWS = 180, 34


def hat(motion: Motion, style: HairStyle) -> list[Strip]:
    """Builds a round shell over the scalp, and the peak of a cap."""
    centre = head_centre(motion.body)
    head = Collider(motion.body.skin, motion.body.skin, makehuman.base().faces["body"])
    azimuth = np.linspace(-np.pi, np.pi, COLUMNS, endpoint=False)
    front = 0.10 if style.hat == "beanie" else 0.20
    lowest = np.arcsin(np.interp(np.abs(azimuth), [0, 1.0, 1.5, 1.9, np.pi], [front, front, -0.14, -0.30, -0.46]))
    s = np.tile(np.linspace(0, 1, CROWN_ROWS)[:, None], (1, COLUMNS))
    elevation = np.pi / 2 - 0.02 - (np.pi / 2 - 0.02 - lowest) * s
    around = np.broadcast_to(azimuth, s.shape)
    direction = np.stack(
        [np.sin(around) * np.cos(elevation), np.sin(elevation), np.cos(around) * np.cos(elevation)], -1
    )
    thick = hat_thickness(style, direction, s)
    points = centre + direction * (scalp_radius(head, centre, direction) + thick)[..., None]
    uv = np.stack([around / (2 * np.pi) + 0.5, 1 - 0.5 * s], -1)
    parts = [(points.reshape(-1, 3), grid(CROWN_ROWS), uv.reshape(-1, 2))]
    if style.hat == "cap":
        parts.append(brim(points, azimuth))
    weights = np.zeros(len(motion.bones))
    weights[motion.bones["head"]] = 1
    out = []
    for vertices, faces, at in parts:
        posed = motion.skin(np.tile(weights, (len(vertices), 1)), vertices)
        posed, faces, source = thickened(posed, faces, 0.003, 6)
        out.append((posed, faces, at[source]))
    return out


def scalp_radius(head: Collider, centre: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Returns the distance from `centre` to the skin along directions (h,w,3), by steps of nearest-point search."""
    flat = direction.reshape(-1, 3)
    radius = np.full(len(flat), 0.10)
    vertices, corner = head.end.numpy(), head.indices.numpy().reshape(-1, 3)
    for _ in range(8):
        face, weights = head.nearest(centre + flat * radius[:, None], 0.2)
        nearest = np.einsum("nk,nkd->nd", weights, vertices[corner[face]])
        radius = 0.5 * radius + 0.5 * np.einsum("nd,nd->n", nearest - centre, flat)
    return np.minimum(radius.reshape(direction.shape[:2]), 0.125)


def hat_thickness(style: HairStyle, direction: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Returns the metres between scalp and hat, more at the top and at the ribbed, turned-up edge of a beanie."""
    room = (0.022 if style.hat == "beanie" else 0.012) * np.clip(direction[..., 1], 0, 1) ** 2
    thick = style.slack * (0.75 + 0.25 * np.clip((1 - s) / 0.3, 0, 1)) + room
    if style.hat != "beanie":
        return thick
    azimuth = np.arctan2(direction[..., 0], direction[..., 2])
    edge = np.clip((s - 0.66) / 0.03, 0, 1)
    return thick + 0.0045 * edge + 0.0008 * np.cos(60 * azimuth)


def grid(rows: int) -> np.ndarray:
    """Returns the faces of `rows` rings of COLUMNS vertices, outward for rows that go down."""
    j = np.arange(COLUMNS)
    faces = []
    for k in range(rows - 1):
        a, b = k * COLUMNS + j, k * COLUMNS + (j + 1) % COLUMNS
        faces += [np.stack([a, a + COLUMNS, b], 1), np.stack([b, a + COLUMNS, b + COLUMNS], 1)]
    return np.concatenate(faces)


def brim(points: np.ndarray, azimuth: np.ndarray) -> Strip:
    """Builds the peak of a cap: a curved plate that begins at the front of the crown's rim.

    Args:
        points: (rows,columns,3) of the crown, whose last row is its rim, metres.
        azimuth: (columns,) of each column about the head, radians; 0 is in front.

    Returns:
        Its vertices (V,3), faces (F,3), and uv (V,2), all in the middle of the texture.
    """
    front = np.abs(azimuth) < 0.95
    rim, a = points[-1][front], azimuth[front]
    rows = []
    for s in np.linspace(0, 1, 8):
        reach = 0.072 * s * np.sqrt(np.clip(1 - (a / 0.98) ** 2, 0, 1))
        out = np.stack([0.25 * np.sin(a), -0.32 - 0.5 * (a / 0.95) ** 2, np.ones_like(a)], 1)
        rows.append(rim + out * reach[:, None] + np.array([0, 0.002, 0.0]))
    n = len(a)
    j = np.arange(n - 1)
    faces = [
        np.stack(c, 1)
        for k in range(7)
        for c in ((k * n + j, (k + 1) * n + j, k * n + j + 1), (k * n + j + 1, (k + 1) * n + j, (k + 1) * n + j + 1))
    ]
    vertices = np.concatenate(rows)
    return vertices, np.concatenate(faces), np.full((len(vertices), 2), 0.5)
