"""Collars, neckbands, lapels and hoods: strips that continue the draped neckline, upward or folded onto the cloth."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from relight.figures import surfaces
from relight.figures.body.kinematics import unit
from relight.figures.body.motion import Motion
from relight.figures.catalogue.schema import entries
from relight.figures.drape.colliders import Collider, signed_distance
from relight.figures.texture import noise

CORD = 0.20  # metres of a drawstring
CORD_RADIUS = 0.0028  # metres
CORD_SIDES = 6  # of its section
CORD_STEP = 0.007  # metres between its rings
CORD_DISTANCE = 0.028  # metres from the middle
MIN_CORD_RINGS = 12
VERTICAL = np.array([0.0, 1.0, 0.0])
NECK_AXIS = (0.0, 0.94, 0.34)  # of the rest pose: necks lean forward by 20 degrees
NECK_RANGE = 0.16  # largest distance of the neckline from the base of the neck, metres
MIN_NECKLINE = 12  # vertices of a neckline
LAPEL = 0.27  # length of lapels below the base of the neck, metres
BAND = 0.030  # standard deviation of the average by which a neckband smooths the neckline, metres
BAND_RANGE = 0.045  # width of the cloth beside the neckline that moves with it, metres
PATH_STEPS = 10  # of a path over the cloth
THICKNESS = 0.0025  # metres
TORN = 0.06  # metres on the flat panels, beyond which a face has corners in two of them
SEAM_OFFSET = 0.0005  # metres below the border where a collar begins: vertices at the same place would be merged
HOOD_CLEARANCE = 0.002  # metres between a hood and the cloth
HOOD_SMOOTHING = 30  # times that a hood's paths, and the cloth under it, are averaged with their neighbours


class Neck(NamedTuple):
    """The posed neck.

    Attributes:
        base: (3,) its lower end, metres.
        left, up, forward: (3,) its axes, of unit length; `left` and `forward` are those of the chest, not of the head.
    """

    base: np.ndarray
    left: np.ndarray
    up: np.ndarray
    forward: np.ndarray

    @property
    def aside(self) -> np.ndarray:
        """The level direction (3,) to the left of the chest, for what hangs."""
        return np.cross(VERTICAL, self.ahead)

    @property
    def ahead(self) -> np.ndarray:
        """The level direction (3,) in front of the chest, for what hangs."""
        return unit(self.forward - (self.forward @ VERTICAL) * VERTICAL)


def neck_of(motion: Motion) -> Neck:
    """Returns the neck of the posed body."""
    up = motion.bone("neck01")[:, :3] @ NECK_AXIS
    left = unit(np.cross(up, motion.bone("spine01")[:, 2]))
    return Neck(motion.joint("neck01"), left, up, np.cross(left, up))


def _neckline(vertices: np.ndarray, faces: np.ndarray, neck: Neck, low: float = 0.0) -> tuple[np.ndarray, bool] | None:
    """Returns the vertices (m,) of the border around the neck in order, and whether it is a loop, begun in front.

    The edges of an open front belong to it down to `low` metres below the neck. None if there is no such border.
    """
    for ring in surfaces.border_loops(faces):
        away = vertices[ring] - neck.base
        near = np.linalg.norm(away, axis=1) < NECK_RANGE
        if near.sum() < MIN_NECKLINE:
            continue
        near |= (np.linalg.norm(away, axis=1) < 2 * low) & (away @ neck.up > -low)
        if near.all():
            front = int(np.argmax(away @ neck.forward - 0.2 * np.abs(away @ neck.left)))
            return np.roll(ring, -front), True
        run = surfaces.longest_run(ring, near)
        return (run, False) if len(run) > MIN_NECKLINE else None
    return None


def banded(vertices: np.ndarray, faces: np.ndarray, smooth: np.ndarray, neck: Neck) -> np.ndarray:
    """Smooths a garment's neckline as a neckband does, and returns the vertices (n,3).

    The border's displacement from a smooth border is replaced by its average along it, with a Gaussian of standard
    deviation BAND. Averages with both neighbours, repeated, tend to a Gaussian: each adds half the square of the
    distance between vertices to its variance. The cloth beside the border follows, less and less up to BAND_RANGE.

    Args:
        vertices: (n,3) as draped, metres.
        faces: (F,3).
        smooth: (n,3) the garment close around the body, without folds, metres.
        neck: of the posed figure.
    """
    if (border := _neckline(vertices, faces, neck)) is None:
        return vertices
    ring, closed = border
    spacing = np.linalg.norm(np.diff(smooth[ring], axis=0), axis=1).mean()
    averagings = round(BAND**2 / (0.5 * spacing**2))
    displacement = (vertices - smooth)[ring]
    move = surfaces.smooth_line(displacement, averagings, closed) - displacement
    distance, nearest = cKDTree(vertices[ring]).query(vertices, 4, distance_upper_bound=BAND_RANGE)
    share = np.clip(1 - distance / BAND_RANGE, 0, 1) ** 2
    move_or_none = np.concatenate([move, [[0, 0, 0]]])  # where there is no vertex in range, `nearest` is len(ring)
    mean = np.einsum("nk,nkd->nd", share, move_or_none[nearest])
    moved = vertices + share.max(1, keepdims=True) * mean / np.maximum(share.sum(1, keepdims=True), 1e-9)
    moved[ring] = vertices[ring] + move
    return moved


def profile(kind: str, back: np.ndarray, front: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns the rows of a collar, from the neckline to its edge.

    Args:
        kind: fold | roll | stand | none, a ribbed neckband.
        back: (m,) 1 at the back of the neck to 0 at its sides.
        front: (m,) the same for its front.

    Returns:
        For each row its metres (m,) up and out from the neckline.
    """
    zero = np.zeros_like(back)
    if kind != "fold":
        return [(zero + rise, zero + reach) for rise, reach in _rows(kind)]
    # Up, over, and down on the outside, lower in front.
    rises = [zero + 0.010, 0.022 + 0.006 * back, 0.025 + 0.006 * back, zero + 0.012, -0.008 - 0.026 * front**3]
    reaches = [zero, zero + 0.001, zero + 0.006, zero + 0.014, 0.020 + 0.010 * front]
    return list(zip(rises, reaches))


def _rows(kind: str) -> tuple[tuple[float, float], ...]:
    return entries("garments", "collars", tuple[tuple[float, float], ...])[kind]


def _paths_over(
    surface: Collider, start: np.ndarray, heading: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Traces paths of a length (m,) over a surface, from points (m,3) in directions (m,3).

    Returns points of the paths, and unit normals of the surface there, each (PATH_STEPS + 1,m,3).
    """
    points, places, facing = start, [], []
    for _ in range(PATH_STEPS + 1):
        face, distance, normal = signed_distance(points, surface, max_distance=0.06)
        points = points - np.where(face >= 0, distance, 0)[:, None] * normal
        places.append(points)
        facing.append(normal)
        heading = surfaces.unit_rows(heading - (heading * normal).sum(1, keepdims=True) * normal)
        heading = surfaces.smooth_line(heading, 2, closed=False)
        points = points + heading * (length / PATH_STEPS)[:, None]
    return np.stack(places), np.stack(facing)


def _lay_hood(vertices: np.ndarray, faces: np.ndarray, base: np.ndarray, neck: Neck) -> list[np.ndarray]:
    """Lays a hood that is not worn on the cloth: deep and thick at the back of the neck, thin at the front.

    Returns rows (m,3) from the neckline outward; `base` (m,3) is the neckline, smoothed.
    """
    cloth = Collider.at_rest(vertices, faces)
    away, up = base - neck.base, neck.up
    level = away - np.outer(away @ up, up)  # without its part along the neck
    level_length = np.linalg.norm(level, axis=1)
    back = np.clip(-(level @ neck.forward) / np.maximum(level_length, 1e-6), 0, 1)  # 1 at the back of the neck
    length, thick = 0.045 + 0.15 * back**1.2, 0.020 + 0.030 * back
    heading = level / np.maximum(level_length[:, None], 1e-6) - up  # outward on all sides, and down
    start = surfaces.smooth_line(base, HOOD_SMOOTHING, closed=False)
    heading = surfaces.smooth_line(heading, HOOD_SMOOTHING, closed=False)
    flattened = surfaces.smoothed(vertices, faces, HOOD_SMOOTHING)  # over folds the paths would cross
    points, outward = _paths_over(Collider.at_rest(flattened, faces), start, heading, length)
    outward = np.stack([surfaces.smooth_line(row, HOOD_SMOOTHING, closed=False) for row in outward])
    rows = _rows_over(points, outward, thick, "hood")
    for row, rise in zip(rows[-4:], (0.006, 0.010, 0.012, 0.006)):  # the opening's edge stands up around the neck
        row += np.outer(rise + 0.016 * back, up)
    for row in rows:
        face, distance, normal = signed_distance(row, cloth, max_distance=0.03)
        row += np.where(face >= 0, np.clip(HOOD_CLEARANCE - distance, 0, 0.02), 0)[:, None] * normal
    return rows


def _lay_lapels(
    vertices: np.ndarray, faces: np.ndarray, ring: np.ndarray, base: np.ndarray, neck: Neck
) -> list[np.ndarray]:
    """Lays the collar and the lapels of a jacket on the cloth, with the notch between them.

    `ring` (m,) has the vertices of the neckline in order, and `base` (m,3) is the neckline, smoothed. Returns rows
    (m,3).
    """
    cloth = Collider.at_rest(vertices, faces)
    normal = surfaces.smooth_line(surfaces.normals(vertices, faces)[ring], 6, closed=False)
    tangent = surfaces.smooth_line(np.gradient(base, axis=0), 6, closed=False)
    # Borders run so that the cloth is to their left.
    inward = surfaces.unit_rows(surfaces.smooth_line(np.cross(normal, tangent), 12, closed=False))
    below = np.clip(-((base - neck.base) @ neck.up), 0, LAPEL)  # metres below the neck's base
    collar = np.clip(1 - below / 0.06, 0, 1)  # 1 on the collar around the neck, 0 on the lapels below it
    from_end = np.minimum(np.arange(len(ring)), np.arange(len(ring))[::-1]) / 8
    notch = 1 - 0.5 * np.exp(-(((below - 0.055) / 0.014) ** 2))  # between collar and lapels
    length = 0.062 * collar + 0.085 * (1 - collar) * (1 - below / LAPEL) ** 0.7
    points, outward = _paths_over(cloth, base, inward, length * notch * np.clip(from_end, 0.1, 1))
    return _rows_over(points, outward, 0.008 + 0.020 * collar, "lapel")


def _rows_over(points: np.ndarray, outward: np.ndarray, thick: np.ndarray, kind: str) -> list[np.ndarray]:
    """Returns the rows (m,3) of a strip, a "hood" or a "lapel", along paths over the cloth, metres.

    Of each row, `_rows` has the share of the paths' length, and the height over that of the strip, `thick` (m,). Those
    of a hood are creased, and each row is averaged along itself.
    """
    smoothing = 8 if kind == "hood" else 2
    crease_place = np.arange(len(thick)) / 7.0  # a crease is about seven vertices wide
    rows = []
    for share, height in _rows(kind):
        k = min(int(share * PATH_STEPS), PATH_STEPS - 1)
        t = share * PATH_STEPS - k
        row, raised = (part[k] * (1 - t) + part[k + 1] * t for part in (points, outward))
        crease = np.zeros(len(thick))
        if kind == "hood":
            crease = 0.25 * (noise(crease_place, np.full_like(crease_place, 5 * share), 5) - 0.5)
        rows.append(surfaces.smooth_line(row + raised * ((height + crease) * thick)[:, None], smoothing, closed=False))
    return rows


def _into_panel(faces: np.ndarray, cloth: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Returns the unit direction (r,2) from each vertex of a border into its panel, along which a collar lies on it.

    `cloth` (n,2) are the vertices of the garment on the flat panels, metres, and `ring` (r,) those of the border.
    """
    step = cloth[faces].mean(1, keepdims=True) - cloth[faces]
    step[np.linalg.norm(step, axis=2).max(1) > TORN] = 0
    summed = np.zeros_like(cloth)
    np.add.at(summed, faces, step)
    return surfaces.unit_rows(surfaces.smooth_line(summed[ring], 20, closed=False))  # over seams


def collar(
    vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray, kind: str, neck: Neck, uv_per_metre: float
) -> surfaces.Textured | None:
    """Builds the collar of a draped garment.

    Args:
        vertices: (n,3) of the garment, metres.
        faces: (F,3).
        uv: (n,2) of the vertices.
        kind: see `Garment.collar`.
        neck: of the posed figure.
        uv_per_metre: texture units per metre.

    Returns:
        Vertices (V,3), faces (F,3) and corner uv (F,3,2); None if the neckline is not found.
    """
    if (border := _neckline(vertices, faces, neck, low=LAPEL if kind == "lapel" else 0.0)) is None:
        return None
    ring, closed = border
    if kind in ("fold", "lapel", "hood"):
        closed = False
    elif closed:  # a band is joined at the back
        ring = np.roll(ring, len(ring) // 2)
    base = surfaces.smooth_line(vertices[ring], 4, closed)
    if kind == "hood":
        rows = _lay_hood(vertices, faces, base, neck)
    elif kind == "lapel":
        rows = _lay_lapels(vertices, faces, ring, base, neck)
    else:
        away = base - neck.base
        out = surfaces.unit_rows(away - np.outer(away @ neck.up, neck.up), 1e-6)
        spread = np.zeros_like(base)
        if kind == "fold":  # the points stand apart where the collar opens
            travel = np.r_[0, np.cumsum(np.linalg.norm(np.diff(base, axis=0), axis=1))]
            for from_end, inward in ((travel, base[2] - base[0]), (travel[-1] - travel, base[-3] - base[-1])):
                spread += np.outer(np.exp(-((from_end / 0.035) ** 2)), 0.013 * inward / np.linalg.norm(inward))
        ahead = out @ neck.forward
        shape = profile(kind, back=np.clip(-ahead, 0, 1), front=np.clip(ahead, 0, 1))
        rows = [
            base + neck.up * rise[:, None] + out * reach[:, None] + spread * (number / len(shape)) ** 2
            for number, (rise, reach) in enumerate(shape, 1)
        ]
    row_lengths = [np.linalg.norm(b - a, axis=1) for a, b in pairwise([base, *rows])]
    travel = np.concatenate([np.zeros((1, len(ring))), np.cumsum(row_lengths, axis=0)])  # metres from the neckline
    strip, strip_faces = surfaces.extruded(np.arange(len(ring)), rows, offset=len(ring), closed=closed)
    points = np.concatenate([vertices[ring] - SEAM_OFFSET * neck.up, strip])
    points, shell, corner = surfaces.thickened(points, strip_faces, THICKNESS, rings=None)
    row, column = np.divmod(strip_faces.ravel()[corner], len(ring))  # of each corner in the strip
    opens = kind in ("lapel", "stand")  # down an open front; the others lie above the panels' upper sides
    direction = _into_panel(faces, uv / uv_per_metre, ring) if opens else np.tile([0.0, -1.0], (len(ring), 1))
    corner_uv = uv[ring][column] + (travel[row, column] * uv_per_metre)[..., None] * direction[column]
    is_torn = np.ptp(corner_uv[..., 0], axis=1) > TORN * uv_per_metre  # across a seam between panels: use one of them
    corner_uv[is_torn] = corner_uv[is_torn][:, :1]
    return points, shell, np.clip(corner_uv, 0.001, 0.999)


def cords(vertices: np.ndarray, faces: np.ndarray, neck: Neck) -> list[surfaces.Surface]:
    """Builds the two drawstrings of a hood: tubes that lie on the garment's front, from the neckline down.

    Args:
        vertices: (n,3) of the garment, metres.
        faces: (F,3) without sleeves.
        neck: of the posed figure.

    Returns:
        Vertices (V,3) and faces (F,3) of each cord; none where the garment has no front to lie on.
    """
    surface, tubes = Collider.at_rest(vertices, faces), []
    rays, distance = 60, 0.6  # rays from the front, metres before the neck, CORD_STEP apart downward
    for side in (-1, 1):
        top = neck.base + side * CORD_DISTANCE * neck.aside + distance * neck.ahead + 0.05 * VERTICAL
        origin = top - CORD_STEP * np.arange(rays)[:, None] * VERTICAL
        _, depth = surface.raycast(origin, -neck.ahead)
        on_front = np.flatnonzero(np.isfinite(depth) & (depth < distance - 0.02))[: round(CORD / CORD_STEP)]
        if len(on_front) < MIN_CORD_RINGS:
            continue
        path = origin[on_front] - neck.ahead * (depth[on_front] - 1.5 * CORD_RADIUS)[:, None]
        path = surfaces.smooth_line(path, 3, closed=False)
        turn = 2 * np.pi * np.arange(CORD_SIDES) / CORD_SIDES
        around = CORD_RADIUS * (np.outer(np.cos(turn), neck.aside) - np.outer(np.sin(turn), neck.ahead))
        rings = [point + around for point in path]
        strip, tube = surfaces.extruded(np.arange(CORD_SIDES), rings[1:], offset=CORD_SIDES, closed=True)
        last = CORD_SIDES * (len(path) - 1)  # first vertex of the last ring
        fan = range(1, CORD_SIDES - 1)
        ends = [[0, k, k + 1] for k in fan] + [[last, last + k + 1, last + k] for k in fan]
        tubes.append((np.concatenate([rings[0], strip]), np.concatenate([tube, ends])))
    return tubes
