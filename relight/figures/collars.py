"""Collars, ribbed necklines and hoods: strips that continue the draped neckline up along the neck and fold over."""

import numpy as np

from relight.figures.body import Body
from relight.figures.colliders import Collider
from relight.figures.fabrics import noise
from relight.figures.poses import Motion
from relight.figures.surfaces import Surface, border_loops, extruded, thickened

CORD = 0.20  # metres of a drawstring
THIN = 0.0028  # its radius
STEP = 0.007  # between its rings


def neck_of(body: Body, way: Motion) -> tuple[np.ndarray, np.ndarray]:
    """The base of the posed neck (3,), metres, and the axes (3,3) of the neck: to its left, up, forward."""
    bone = way.transforms[-1][way.bones["neck01"]]
    up, left = bone[:, :3] @ np.array([0.0, 0.94, 0.34]), bone[:, :3] @ np.array([1.0, 0.0, 0.0])
    return bone[:, :3] @ body.joints["neck01"] + bone[:, 3], np.stack([left, up, np.cross(left, up)])


def neckline(vertices: np.ndarray, faces: np.ndarray, neck: np.ndarray) -> tuple[np.ndarray, bool] | None:
    """The border around the neck (m,) and whether it is a whole loop; None where there is none. `neck` (3,) posed."""
    for ring in border_loops(faces):
        near = np.linalg.norm(vertices[ring] - neck, axis=1) < 0.16
        if near.sum() < 12:
            continue
        if near.all():
            front = int(np.argmax(vertices[ring, 2] - 0.2 * np.abs(vertices[ring, 0] - neck[0])))
            return np.roll(ring, -front), True  # begins in front, where a collar opens
        first = np.flatnonzero(near & ~np.roll(near, 1))
        run = max((np.roll(ring, -k)[: int(np.argmin(np.roll(near, -k)))] for k in first), key=len)
        return (run, False) if len(run) > 12 else None
    return None


def profile(kind: str, back: np.ndarray, front: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows of a collar as (up, out) metres from the neckline; back, front (m,) say where on the neck."""
    flat = np.zeros_like(back)
    if kind == "fold":
        fall = -0.008 - 0.026 * front**3
        return [
            (flat + 0.010, flat + 0.000),
            (flat + 0.022 + 0.006 * back, flat + 0.001),
            (flat + 0.025 + 0.006 * back, flat + 0.006),
            (flat + 0.012, flat + 0.014),
            (fall, flat + 0.020 + 0.010 * front),
        ]
    if kind == "lapel":
        return [
            (flat + 0.014, flat + 0.002),
            (flat + 0.026, flat + 0.008),
            (flat + 0.022, flat + 0.018),
            (flat + 0.002, flat + 0.028),
            (flat - 0.028 - 0.02 * front, flat + 0.036),
        ]
    if kind == "stand":
        return [(flat + 0.012, flat - 0.002), (flat + 0.026, flat - 0.001), (flat + 0.040, flat + 0.002)]
    if kind == "hood":
        size = 0.014 + 0.040 * back**1.5
        angle = np.linspace(-0.35, 1.75, 11) * np.pi
        return [
            (size * (0.9 + 0.95 * np.sin(a)) * (0.75 + 0.25 * back), size * (0.65 - 0.95 * np.cos(a)) + 0.004)
            for a in angle
        ]
    return [(flat + 0.007, flat - 0.001), (flat + 0.013, flat - 0.003)]


def collar(
    vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray, kind: str, neck: np.ndarray, up: np.ndarray, metre: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Vertices, faces and corner uv of the collar of a draped garment, or None where the neckline is lost.

    uv (V,2): of the garment's vertices; neck, up (3,): base of the neck and its axis; metre: texture units per metre.
    """
    found = neckline(vertices, faces, neck)
    if found is None:
        return None
    ring, closed = found
    base = vertices[ring]
    for _ in range(4):
        base[1:-1] = 0.5 * base[1:-1] + 0.25 * (base[:-2] + base[2:])
    out = base - neck - np.outer((base - neck) @ up, up)
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-6)
    back, front = np.clip(-out[:, 2], 0, 1), np.clip(out[:, 2], 0, 1)
    if kind in ("fold", "lapel"):
        closed = False
    spread = np.zeros_like(base)
    if kind in ("fold", "lapel"):  # the points stand apart where the collar opens
        far = np.r_[0, np.cumsum(np.linalg.norm(np.diff(base, axis=0), axis=1))]
        for end, step in ((far, base[2] - base[0]), (far[-1] - far, base[-3] - base[-1])):
            spread += np.outer(np.exp(-((end / 0.035) ** 2)), 0.013 * step / np.linalg.norm(step))
    rows, travel, last = [base], [np.zeros(len(ring))], base
    shape = profile(kind, back, front)
    for number, (rise, reach) in enumerate(shape, 1):
        row = base + up * rise[:, None] + out * reach[:, None] + spread * (number / len(shape)) ** 2
        if kind == "hood":
            angle = np.arctan2(out[:, 0], -out[:, 2])
            row = (
                row + out * (0.012 * back * (noise(angle * 4, np.full_like(angle, 7.0 * rise.max()), 5) - 0.5))[:, None]
            )
        travel.append(travel[-1] + np.linalg.norm(row - last, axis=1))
        rows.append(row)
        last = row
    strip, strip_faces = extruded(np.arange(len(ring)), rows[1:], len(ring), closed)
    points = np.concatenate([base, strip])
    points, solid, source = thickened(points, strip_faces, np.full(len(points), 0.0025), 99)
    column, row = source % len(ring), source // len(ring)
    at = uv[ring][column] - np.stack([0 * column, np.stack(travel)[row, column] * metre], axis=1)
    corner = at[solid]
    torn = np.ptp(corner[..., 0], axis=1) > 0.06 * metre  # across a seam between panels: stay on one of them
    corner[torn] = corner[torn][:, :1]
    return points, solid, np.clip(corner, 0.001, 0.999)


def cords(vertices: np.ndarray, faces: np.ndarray, neck: np.ndarray, left: np.ndarray) -> list[Surface]:
    """The two drawstrings of a hood: tubes that lie on the garment's front (faces of its body only), from the neckline
    down. neck (3,): base of the posed neck; left (3,): the axis to its left."""
    surface, out = Collider(vertices, vertices, faces), []
    for side in (-1, 1):
        y = neck[1] + 0.05 - STEP * np.arange(60)
        origin = np.broadcast_to(neck + side * 0.028 * left + [0, 0, 0.6], (60, 3)).copy()
        origin[:, 1] = y
        _, depth = surface.cast(origin, np.broadcast_to([0.0, 0.0, -1.0], (60, 3)))
        on = np.flatnonzero(np.isfinite(depth) & (depth < 0.58))[: round(CORD / STEP)]
        if len(on) < 12:
            continue
        path = origin[on] - [0, 0, 1] * (depth[on] - 1.5 * THIN)[:, None]
        for _ in range(3):
            path[1:-1] = 0.5 * path[1:-1] + 0.25 * (path[:-2] + path[2:])
        turn = 2 * np.pi * np.arange(6) / 6
        around = THIN * np.stack([np.cos(turn), 0 * turn, -np.sin(turn)], axis=1)
        rings = [point + around for point in path]
        strip, tube = extruded(np.arange(6), rings[1:], 6, True)
        ends = [[0, k, k + 1] for k in range(1, 5)] + [
            [len(path) * 6 - 6, len(path) * 6 - 6 + k + 1, len(path) * 6 - 6 + k] for k in range(1, 5)
        ]
        out.append((np.concatenate([rings[0], strip]), np.concatenate([tube, ends])))
    return out
