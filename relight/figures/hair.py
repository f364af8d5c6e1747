"""Hair: a shell over the scalp whose thickness, hanging length and grain make the style; hats use the same shell."""

from dataclasses import dataclass

import numpy as np

from relight.figures import makehuman
from relight.figures.body import Body
from relight.figures.drape import Collider
from relight.figures.fabrics import noise
from relight.figures.layers import sided
from relight.figures.poses import Motion
from relight.figures.skin import hairline
from relight.figures.surfaces import smoothed, thickened

COLUMNS, CROWN_ROWS = 180, 34


@dataclass(frozen=True)
class Style:
    """thick: metres over the scalp; length: metres hanging below the hairline at the back; face: azimuth (radians) of
    the front edge of what hangs; grain: strands across the shell; rough: depth of the grain; curl: depth of round
    lumps; part: azimuth of a parting or None; tie: none | bun | ponytail; brim: metres of a hat's brim; hat: fabric."""

    name: str
    thick: float
    length: float = 0.0
    face: float = 0.9
    grain: float = 16.0
    rough: float = 0.006
    curl: float = 0.0
    part: float | None = None
    tie: str = "none"
    hat: str = "none"
    scalp: float = 1.0


STYLES = (
    Style("bald", 0.0, scalp=0.0),
    Style("shaved", 0.0, scalp=0.75),
    Style("crop", 0.011, rough=0.005, grain=26),
    Style("side part", 0.022, rough=0.008, part=0.45),
    Style("quiff", 0.030, rough=0.012, grain=14),
    Style("bob", 0.020, length=0.13, face=0.92, rough=0.006, part=0.1),
    Style("chin length", 0.022, length=0.10, face=0.86, rough=0.007, part=-0.35),
    Style("long", 0.020, length=0.30, face=0.88, rough=0.008, part=0.0),
    Style("wavy long", 0.024, length=0.26, face=0.88, rough=0.009, curl=0.010, part=0.3),
    Style("bun", 0.009, rough=0.004, grain=22, tie="bun"),
    Style("ponytail", 0.010, rough=0.004, grain=22, tie="ponytail"),
    Style("curly", 0.034, rough=0.003, curl=0.022),
    Style("afro", 0.075, rough=0.003, curl=0.014),
    Style("beanie", 0.012, rough=0.0015, grain=40, hat="beanie"),
    Style("cap", 0.012, rough=0.0, hat="cap"),
)


@dataclass(frozen=True)
class Shell:
    """vertices (V,3) posed, faces (F,3), uv (V,2): across and down the strands."""

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray


def build_hair(
    body: Body, motion: Motion, style: Style, below: tuple[np.ndarray, np.ndarray], seed: int
) -> list[Shell]:
    """The hair at the last frame, pushed off the shoulders: `below` is the posed surface of skin and clothes."""
    if style.thick == 0:
        return []
    eye = body.vertices[makehuman.EYES["L"]].mean(0)
    centre = np.array([0.0, eye[1] + 0.028, eye[2] - 0.085])
    head = Collider(body.skin, body.skin, makehuman.base().faces["body"])
    azimuth = np.linspace(-np.pi, np.pi, COLUMNS, endpoint=False)
    line = hairline(azimuth)
    if style.hat != "none":
        line = np.interp(np.abs(azimuth), [0, 1.0, 1.5, 1.9, np.pi], [0.34, 0.20, -0.02, -0.12, -0.42])
    rows, down = [], []
    lowest = np.arcsin(line)
    for s in np.linspace(0, 1, CROWN_ROWS):
        elevation = np.pi / 2 - 0.02 - (np.pi / 2 - 0.02 - lowest) * s
        direction = np.stack(
            [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)], 1
        )
        rows.append(direction)
        down.append(np.full(COLUMNS, s))
    direction = np.stack(rows)
    radius = scalp_radius(head, centre, direction)
    s = np.stack(down)
    thick = thickness(style, azimuth, direction, s, seed)
    points = centre + direction * (radius + thick)[..., None]
    uv = np.stack(np.broadcast_arrays(azimuth / (2 * np.pi) + 0.5, 1 - 0.5 * s), -1)
    if style.length:
        points, uv = hang(style, body, points, uv, azimuth, centre, seed)
    faces = grid(len(points))
    vertices, uv = points.reshape(-1, 3), uv.reshape(-1, 2)
    if style.length:
        faces = sewn(vertices, faces)
    shells = [Shell(style.name, vertices, faces, uv)]
    if style.tie != "none":
        backward = np.array([[[0.0, 0.34, -0.94]]])
        shells.append(tied(style, centre + backward[0, 0] * (scalp_radius(head, centre, backward)[0, 0] - 0.006), seed))
    if style.hat == "cap":
        shells.append(brim(points, azimuth))
    weights = np.zeros(len(motion.bones))
    weights[motion.bones["head"]] = 1
    out = []
    for shell in shells:
        posed = motion.skin(np.tile(weights, (len(shell.vertices), 1)), shell.vertices)
        if style.length or style.tie == "ponytail":
            free = np.arange(len(posed)) >= (COLUMNS * CROWN_ROWS if shell.name == style.name else 8 * COLUMNS)
            posed = pushed_off(posed, shell.faces, below, free)
        rings = 6 if style.length or shell.name == "brim" else 0  # a short rim ends inside the skin and needs no edge
        posed, faces, source = thickened(posed, shell.faces, np.full(len(posed), 0.004), rings)
        out.append(Shell(shell.name, posed, faces, shell.uv[source]))
    return out


def scalp_radius(head: Collider, centre: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Distance from `centre` to the skin along each direction, by a few steps of nearest-point search."""
    flat = direction.reshape(-1, 3)
    radius = np.full(len(flat), 0.10)
    vertices, corner = head.after.numpy(), head.corner.numpy().reshape(-1, 3)
    for _ in range(8):
        face, weights = head.nearest(centre + flat * radius[:, None], 0.2)
        nearest = np.einsum("nk,nkd->nd", weights, vertices[corner[face]])
        radius = 0.5 * radius + 0.5 * np.einsum("nd,nd->n", nearest - centre, flat)
    radius = radius.reshape(direction.shape[:2])
    return np.minimum(radius, 0.125)


def thickness(style: Style, azimuth: np.ndarray, direction: np.ndarray, s: np.ndarray, seed: int) -> np.ndarray:
    """Metres of hair over the scalp at each point of the shell (rows, columns)."""
    front, top = np.cos(azimuth) * np.ones_like(s), direction[..., 1]
    thick = style.thick * (0.8 + 0.35 * np.clip(top, 0, 1))
    if style.name == "quiff":
        thick = thick * (0.45 + 0.9 * np.clip(front, 0, 1) * np.clip(top, 0, 1))
    ease = np.clip((1 - s) / 0.16, 0, 1)
    ease = ease * (2 - ease)
    if style.length:
        hanging = np.clip((np.abs(azimuth) - style.face) / 0.25, 0, 1)
        ease = np.maximum(ease, hanging)
    if style.part is not None:
        groove = (
            np.exp(-((((azimuth - style.part + np.pi) % (2 * np.pi) - np.pi) / 0.07) ** 2))
            * np.clip(1 - s, 0, 1) ** 0.3
        )
        thick = thick * (1 - 0.75 * groove * (front > 0))
    strands = noise(azimuth * style.grain + 2.5 * noise(azimuth * 3, s * 3, seed), s * 2.5, seed + 1) - 0.5
    fine = noise(azimuth * style.grain * 3.1, s * 4, seed + 2) - 0.5
    bumps = style.rough * (strands + 0.5 * fine)
    if style.curl:
        d = direction * 13
        lumps = noise(d[..., 0] + 0.5 * d[..., 2], d[..., 1] + 0.4 * d[..., 2], seed + 3) + 0.6 * noise(
            2.3 * d[..., 0] - d[..., 2], 2.3 * d[..., 1], seed + 4
        )
        bumps = bumps + style.curl * (lumps - 0.8)
    rim = 0.004 if style.hat != "none" else -0.002
    return rim + (thick + bumps - rim) * ease


def hang(
    style: Style, body: Body, points: np.ndarray, uv: np.ndarray, azimuth: np.ndarray, centre: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rows that hang from the rim of the shell, beside and behind the face."""
    rim = points[-1]
    share = np.clip((np.abs(azimuth) - style.face) / 0.12, 0, 1)
    back = np.clip((np.abs(azimuth) - 1.2) / 1.2, 0, 1)
    bottom = rim[:, 1].min() - style.length * (0.9 + 0.1 * np.sin(5 * azimuth + seed % 7))
    top = np.maximum(rim[:, 1] - bottom, 0)
    rows = [points]
    marks = [uv]
    count = max(6, int(0.5 * np.ceil((style.length + 0.12) / 0.012)))
    outward = np.stack([np.sin(azimuth), 0 * azimuth, np.cos(azimuth)], 1)
    for k in range(1, count + 1):
        s = k / count
        wave = style.rough * (noise(azimuth * style.grain, np.full_like(azimuth, 3 * s), seed + 6) - 0.5)
        if style.curl:
            wave = wave + style.curl * np.sin(14 * s + 3 * noise(azimuth * 4, azimuth * 0, seed + 7))
        inward = -0.030 * s * (1 - back) - 0.012 * s**3
        row = rim + outward * (wave + inward)[:, None] * share[:, None]
        row[:, 1] -= top * s * share
        rows.append(row[None])
        marks.append(np.stack([azimuth / (2 * np.pi) + 0.5, np.full_like(azimuth, 0.5 - 0.5 * s)], -1)[None])
    return np.concatenate(rows), np.concatenate(marks)


def grid(rows: int) -> np.ndarray:
    """Faces of `rows` rings of COLUMNS vertices, outward for rows that go down."""
    j = np.arange(COLUMNS)
    faces = []
    for k in range(rows - 1):
        a, b = k * COLUMNS + j, k * COLUMNS + (j + 1) % COLUMNS
        faces += [np.stack([a, a + COLUMNS, b], 1), np.stack([b, a + COLUMNS, b + COLUMNS], 1)]
    return np.concatenate(faces)


def sewn(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces on the first of the vertices that coincide: over the face the hanging rows have no length."""
    _, first, same = np.unique(np.round(vertices, 6), axis=0, return_index=True, return_inverse=True)
    faces = first[same.reshape(-1)][faces]
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]


def tied(style: Style, start: np.ndarray, seed: int) -> Shell:
    """A bun or a ponytail at the back of the head: a tube of rings along a curve."""
    if style.tie == "bun":
        t = np.linspace(0, np.pi, 18)
        middle = start + np.stack([0 * t, 0.012 - 0.012 * np.cos(t), -0.030 * (1 - np.cos(t))], 1)
        radius = 0.004 + 0.036 * np.sin(t)
    else:
        t = np.linspace(0, 1, 26)
        middle = start + np.stack(
            [0 * t, 0.02 * np.sin(3 * t) - 0.26 * t**1.6, -0.055 * np.sin(np.pi * np.minimum(1.4 * t, 1) / 1.3)], 1
        )
        radius = 0.010 + 0.026 * np.sin(np.pi * np.clip(0.10 + 0.9 * t, 0, 1)) ** 0.7
    forward = np.gradient(middle, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    side = np.array([1.0, 0.0, 0.0])
    up = np.cross(forward, side)
    angle = np.linspace(-np.pi, np.pi, COLUMNS, endpoint=False)
    grain = (
        1
        + 0.16 * (noise(angle[None] * 6, t[:, None] * 3, seed + 8) - 0.5)
        + 0.10 * (noise(angle[None] * 17, t[:, None] * 4, seed + 9) - 0.5)
    )
    ring = np.cos(angle)[None, :, None] * side + np.sin(angle)[None, :, None] * up[:, None]
    points = middle[:, None] + ring * (radius[:, None] * grain)[..., None]
    uv = np.stack(np.broadcast_arrays(angle[None] / (2 * np.pi) + 0.5, 1 - t[:, None] / t[-1]), -1)
    faces = grid(len(t))
    flat = points.reshape(-1, 3)
    normal = np.cross(flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]])
    if (normal * (flat[faces].mean(1) - middle[len(t) // 2])).sum() < 0:
        faces = faces[:, ::-1]
    return Shell(style.tie, flat, faces, uv.reshape(-1, 2))


def brim(points: np.ndarray, azimuth: np.ndarray) -> Shell:
    """The peak of a cap: a curved plate in front of the rim."""
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
    return Shell("brim", vertices, np.concatenate(faces), np.full((len(vertices), 2), 0.5))


def pushed_off(
    points: np.ndarray, faces: np.ndarray, below: tuple[np.ndarray, np.ndarray], free: np.ndarray
) -> np.ndarray:
    """Moves the `free` (n,) vertices that are in, or within 6 mm of, the surface below out of it, and smooths them."""
    surface = Collider(below[0], below[0], below[1])
    for _ in range(4):
        face, distance, normal = sided(points, surface, 0.08)
        depth = np.where(free & (face >= 0), np.clip(0.006 - distance, 0, 0.1), 0)
        move = depth[:, None] * normal
        spread = np.where(free[:, None], smoothed(move, faces, 4), 0)
        points = points + np.where(depth[:, None] > 0, move, spread)
    return smoothed(points, faces, 3, keep=~free)
