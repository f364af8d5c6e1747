"""Drops: skirts, coat tails and shirt tails, which hang from the border of what is cut from the suit."""

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import ConvexHull

from relight.figures.cut.level import Level
from relight.figures.cut.suit import Fields, Hull
from relight.figures.draw.garments import Garment
from relight.figures.surfaces import border_loops, extruded, longest_run, rim

ROW = 0.028  # metres between the rows of a drop
GATHERED = 0.06  # metres from the top of a drop to the full depth of its gathers
HANGING_FLARE = 0.35  # share of its flare that a drop keeps as it hangs
HIP_CLEARANCE = 0.014  # metres between a drop and the hull of the hips


def lowest_border(faces: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, bool]:
    """Finds the lowest part of the border of a garment as it was cut; long sleeves end lower than a high waist.

    Args:
        faces: (F,3).
        x: (n,) of the vertices on the rest pose, 0 in the middle of the body.
        y: (n,) their heights on it, metres.

    Returns:
        Its vertices (m,) in order, and whether it is a closed loop.
    """
    ring = min(border_loops(faces), key=lambda ring: (x[ring].min() * x[ring].max() > 0, y[ring].min()))
    low = y[ring] < y[ring].min() + 0.003  # metres
    # a garment open in front has one border all round, of which only the longest run at the bottom counts
    return (ring, True) if low.all() else (longest_run(ring, low), False)


def split_border(faces: np.ndarray, n: int, ring: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """Splits edges of the border in the middle, and with them their faces; each has at most one of them.

    Args:
        faces: (F,3).
        n: number of vertices.
        ring: (m,) vertices, between which border edges are split.

    Returns:
        The matrix (n+e,n) from the vertices to those with the e middles, the new faces (F',3), and the old face (F',)
        that each comes from.
    """
    on_ring = np.zeros(n, bool)
    on_ring[ring] = True
    sides = rim(faces)
    border = sides[on_ring[sides].all(1)]
    rotated = np.stack([np.roll(faces, -k, axis=1) for k in range(3)], axis=1)  # a face begins with each of its sides
    is_border_side = np.isin(rotated[..., :2] @ [n, 1], border @ [n, 1])
    is_split = is_border_side.any(1)
    a, b, c = rotated[is_split, is_border_side[is_split].argmax(1)].T
    middle = n + np.arange(len(a))
    parent = np.repeat(np.arange(len(faces)), 1 + is_split)
    new_faces, first = faces[parent], np.flatnonzero(is_split) + np.arange(len(a))  # places of the first halves
    new_faces[first], new_faces[first + 1] = np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)
    identity = sparse.identity(n, format="csr")
    return sparse.vstack([identity, 0.5 * (identity[a] + identity[b])]).tocsr(), new_faces, parent


def _wave_profile(garment: Garment, angle: np.ndarray) -> np.ndarray:
    """Returns the height (n,) in [0,1] of a drop's irregular folds at bearings (n,), radians."""
    phase = garment.fold_phase
    uneven = 0.5 * np.sin(3 * angle + phase) + 0.4 * np.sin(5 * angle + 2.3 * phase)
    return 0.5 + 0.5 * np.sin(garment.fold_count * angle + uneven + 4.1 * phase)


def _rounded(flat: np.ndarray, centre: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Returns an outline (m,2) pushed out to its convex hull, which bridges the hollow between the legs.

    `angle` (m,) are the bearings of its points about `centre` (2,), radians.
    """
    outline = flat[ConvexHull(flat).vertices]
    radius = np.linalg.norm(outline - centre, axis=1)
    bearing = np.arctan2(outline[:, 1] - centre[1], outline[:, 0] - centre[0])
    order = np.argsort(bearing)
    hull_radius = np.interp(angle, bearing[order], radius[order], period=2 * np.pi)
    direction = np.stack([np.cos(angle), np.sin(angle)], 1)
    return centre + direction * np.maximum(hull_radius, np.linalg.norm(flat - centre, axis=1))[:, None]


def _drop_rows(
    garment: Garment, top: np.ndarray, cut_height: np.ndarray, closed: bool, hull: Hull
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Computes the rows of a drop that hangs on a border `top` (m,3), whose heights as cut are `cut_height` (m,).

    What is cut wider than it hangs starts the simulation in folds of the same length. Returns the rows (m,3) as cut,
    and the rows (m,3) at the start of the simulation.
    """
    flat = top[:, [0, 2]]  # seen from above
    centre = flat.mean(0)
    angle = np.arctan2(flat[:, 1] - centre[1], flat[:, 0] - centre[0])
    round_outline = _rounded(flat, centre, angle) if closed else flat.copy()
    wave = _wave_profile(garment, angle)

    def length(outline: np.ndarray) -> float:
        sides = np.linalg.norm(np.roll(outline, -1, 0) - outline, axis=1)
        return float(sides[: len(top) - (not closed)].sum())  # an open outline has no last side

    def row_outline(s: float, flare: float, depth: float) -> np.ndarray:
        """Returns the row (m,2) at the share s of the drop, wider by a flare, with folds of a depth in metres."""
        y = cut_height - garment.drop * s
        ring = centre + (flat + (round_outline - flat) * min(1.0, 5 * s) - centre)  # round within a fifth of the drop
        flared = centre + (ring - centre) * (1 + flare * s)
        radius = np.linalg.norm(flared - centre, axis=1)
        outer_radius = radius
        if closed:  # clear of the hips
            points = np.stack([flared[:, 0], y, flared[:, 1]], axis=1)
            outer_radius = np.maximum(radius, np.where(y > hull.heights[0], hull.radius(points) + HIP_CLEARANCE, 0))
        return centre + (flared - centre) * ((outer_radius + 2 * depth * wave) / radius)[:, None]

    cut_rows: list[np.ndarray] = []
    start_rows: list[np.ndarray] = []
    count = max(2, round(garment.drop / ROW))
    for k in range(1, count + 1):
        s = k / count
        mean_radius = np.linalg.norm(row_outline(s, garment.flare, depth=0.0) - centre, axis=1).mean()
        depth = garment.gather * min(1.0, garment.drop * s / GATHERED) + garment.pleat * s  # over the radius
        cut = row_outline(s, garment.flare, depth * mean_radius)
        hanging, low, high = cut, 0.0, 0.5 * mean_radius
        for _ in range(12):  # bisection for the depth of the folds at which the row is as long as it is cut
            middle = (low + high) / 2
            hanging = row_outline(s, HANGING_FLARE * garment.flare, middle)
            low, high = (low, middle) if length(hanging) > length(cut) else (middle, high)
        for rows, outline in ((cut_rows, cut), (start_rows, hanging)):
            rows.append(np.stack([outline[:, 0], top[:, 1] - garment.drop * s, outline[:, 1]], axis=1))
    return cut_rows, start_rows


def add_drop(garment: Garment, level: Level, fields: Fields, hull: Hull) -> tuple[Level, Fields]:
    """Continues the lowest border downward: skirts, coat tails, shirt tails. A drop moves with the pelvis.

    Args:
        garment: how long the drop is, how it flares and folds.
        level: the coarsest level, as cut from the suit.
        fields: values (n,) of its vertices by name, see `suit_fields`.
        hull: convex hull of the trunk, around which the drop starts.

    Returns:
        The level and the fields with the rows of the drop after the other vertices. The field "drop" is 0 above, and
        rises to 1 at the drop's lower end. Its rest shape is as wide as it is cut; its start is in
        folds around the hull; no pin holds it.
    """
    ring, closed = lowest_border(level.faces, level.rest_shape[:, 0], fields["y"])
    cut_rows, start_rows = _drop_rows(garment, level.rest_shape[ring].copy(), fields["y"][ring], closed, hull)
    points, strip = extruded(ring, cut_rows, offset=len(level.rest_shape), closed=closed)
    start, count = np.concatenate(start_rows), len(cut_rows)
    down = np.repeat(np.arange(1, count + 1) / count, len(ring))
    root = np.zeros(level.weights.shape[1])  # skinning weights of the pelvis, the first bone
    root[0] = 1
    root_share = np.clip(4 * down, 0, 1)[:, None]  # from a quarter of the drop on, it follows the pelvis only
    weights = np.tile(level.weights[ring], (count, 1)) * (1 - root_share) + root * root_share
    fields = {name: np.r_[values, np.tile(values[ring], count)] for name, values in fields.items()}
    fields["drop"][len(level.rest_shape) :] = down
    whole = Level(
        rest_shape=np.concatenate([level.rest_shape, points]),
        start=np.concatenate([level.start, start]),
        fitted=np.concatenate([level.fitted, start]),
        pin_weight=np.r_[level.pin_weight, np.zeros(len(points))],
        weights=np.concatenate([level.weights, weights]),
        faces=np.concatenate([level.faces, strip]),
    )
    return whole, fields
