"""What a figure must pass before it is used: finite, in place, not over-stretched, nothing through the cloth."""

import numpy as np
from scipy import ndimage

from relight.figures import makehuman
from relight.figures.body import Body
from relight.figures.clearance import shares
from relight.figures.colliders import Collider
from relight.figures.crossings import crossing
from relight.figures.drape import Draped
from relight.figures.layers import sided
from relight.figures.patterns import Pattern
from relight.figures.poses import Motion
from relight.figures.rings import lost_rings
from relight.figures.surfaces import normals, stacked
from relight.figures.wear import Worn
from relight.meshes import Mesh

STRETCH = 1.35  # 95th percentile of an edge's length over its pattern's
TORN = 2.5  # 99.9th percentile
SUNK = 0.012  # share of the cloth inside the body
PIXEL = 0.003  # metres between the rays that look for what comes through
SPECK = 250  # pixels: a smaller patch of a lower layer inside a higher one came through the cloth
THROUGH = 60  # pixels of such patches that a figure may have
CROSSING = 0.015  # share of a garment's faces that went through cloth
CREASED = 0.03  # the same for figures that sit: trousers crease through themselves deep in the fold of the hip
COVERED = 0.25  # share of a hand, seen from the front, that cloth covers
SKIN_DEEP = 0.04  # metres: cloth further before a hand merely hangs in front of it
LONG = 0.2  # metres of a drop from which on its hem hangs level, whatever the pose
HEM = 0.10  # metres by which one part of a short hem may have moved up from where it was worn, against another
SPREAD = 0.25  # metres beyond the body that cloth may reach sideways


def cloth(pattern: Pattern, draped: Draped, way: Motion, body: Body) -> str | None:
    """Judges one draped garment.

    Args:
        pattern: its pattern.
        draped: how it hangs.
        way: the motion into the pose.
        body: in its rest pose.

    Returns:
        Why it is rejected, in one phrase; None if it passes.
    """
    name, x = pattern.garment.name, draped.positions
    if not np.isfinite(x).all():
        return f"{name}: not finite"
    if (high := np.percentile(draped.strain, 95)) > STRETCH:
        return f"{name}: stretched to {high:.2f} of its pattern"
    if (high := np.percentile(draped.strain, 99.9)) > TORN:
        return f"{name}: torn, edges at {high:.2f} of their pattern"
    skin = way.skin(makehuman.rig().weights[makehuman.BODY], body.skin)
    reach = SPREAD + pattern.garment.drop * (0.4 + pattern.garment.flare)
    low, high = skin.min(0) - reach, skin.max(0) + reach
    if (x < low).any() or (x > high).any():
        return f"{name}: flew away from the body"
    if (swept := hem_swept(pattern, x, way)) > HEM + 0.35 * pattern.garment.drop * (pattern.garment.drop > LONG):
        return f"{name}: its hem was swept up by {swept:.2f} m"
    if (share := sunk(x, skin)) > SUNK:
        return f"{name}: {100 * share:.1f} % of it inside the body"
    if pattern.garment.kind == "scarf":
        return None
    slid = x[:, 1].max() - way.skin(pattern.levels[0].weights, pattern.levels[0].held)[:, 1].max()
    if slid < -0.12:
        return f"{name}: slid down by {-slid:.2f} m"
    for limb, (lost, rings) in lost_rings(pattern, x, way, body).items():
        if lost:
            return f"{name}: the {limb} left it, {lost} of {rings} rings do not go around it"
    return None


def hem_swept(pattern: Pattern, x: np.ndarray, way: Motion) -> float:
    """Metres between the highest and the lowest parts of a hem (5 % at either end left out): as it hangs where the drop
    is LONG, and over where it would be if it moved with the body where it is short.

    Args:
        pattern: without a drop there is no such hem, and 0.
        x: (n,3) the draped finest vertices, metres.
        way: the motion into the pose.
    """
    if not pattern.garment.drop:
        return 0.0
    level, end = pattern.levels[-1], pattern.fields["tube"] > 0.999
    high = x[end, 1]
    if pattern.garment.drop <= LONG:
        high = high - way.skin(level.weights[end], level.held[end])[:, 1]
    return float(np.ptp(np.percentile(high, [5, 95])))


def wardrobe(worn: list[Worn], way: Motion, body: Body, sitting: bool) -> tuple[str | None, dict[str, float]]:
    """Judges the garments together.

    Args:
        worn: the draped garments, from the skin outward.
        way: the motion into the pose.
        body: in its rest pose.
        sitting: whether the figure sits; more of its cloth may go through cloth.

    Returns:
        Why they are rejected, None if they pass; and the measures: `crossing`, the largest share of a garment's faces
        that went through cloth, and `covered`, the larger share of a hand's skin that cloth covers in front.
    """
    flat = [(w.draped.positions[: len(level.pattern)], level) for w in worn for level in [w.pattern.levels[1]]]
    through_cloth = crossing([(x, level.faces) for x, level in flat], [level.pattern for _, level in flat])
    hidden = max(covered_hands(worn, way, body))
    measured = {"crossing": round(max(through_cloth), 4), "covered": round(hidden, 3)}
    for w, share in zip(worn, through_cloth):
        if share > (CREASED if sitting else CROSSING):
            return f"{w.pattern.garment.name}: {100 * share:.1f} % of it goes through cloth", measured
    if hidden > COVERED:
        return f"{100 * hidden:.0f} % of a hand is sunk in cloth", measured
    return None, measured


def covered_hands(worn: list[Worn], way: Motion, body: Body) -> tuple[float, float]:
    """The shares of the left and the right hand that cloth covers, seen from the front.

    Only skin that faces forward counts. It is covered where the first surface in front of it is cloth within SKIN_DEEP
    whose outside faces forward too. Skin behind other skin or behind more distant cloth is not counted. Sleeves are
    left out: a cuff may fall over the hand. A hand with 40 counted vertices or fewer has share 0.
    """
    faces = makehuman.base().faces["body"]
    skin = way.skin(makehuman.rig().weights[makehuman.BODY], body.skin)
    parts = [(skin, faces)]
    for w in worn:
        level = w.pattern.levels[-1]
        parts.append((w.draped.positions, level.faces[~w.pattern.sleeve]))
    vertices, every = stacked(parts)
    hand = shares("finger", "metacarpal") > 0.7
    ahead = normals(skin, faces)[:, 2] > 0.2
    a, b, c = (vertices[every[:, k]] for k in range(3))
    forward = np.cross(b - a, c - a)[:, 2] > 0
    surface, out = Collider(vertices, vertices, every), []
    for sign in (1, -1):
        points = skin[hand & ahead & (np.sign(body.skin[:, 0]) == sign)] + [0, 0, 0.001]
        face, depth = surface.cast(points, np.broadcast_to([0.0, 0.0, 1.0], points.shape))
        under = (face >= len(faces)) & (depth < SKIN_DEEP) & forward[face]
        seen_or_under = under | (face < 0)
        out.append(float(under.sum() / seen_or_under.sum()) if seen_or_under.sum() > 40 else 0.0)
    return out[0], out[1]


def sunk(x: np.ndarray, skin: np.ndarray) -> float:
    """The share of cloth that lies inside the body.

    Args:
        x: (n,3) the vertices of the cloth, metres.
        skin: (V,3) the posed skin.

    Returns:
        The share of vertices more than 12 mm under the skin; hands and wrists do not count.
    """
    faces = makehuman.base().faces["body"]
    loose = shares("finger", "metacarpal", "wrist") > 0.3
    _, distance, _ = sided(x, Collider(skin, skin, faces[~loose[faces].any(1)]), 0.12)
    return float((distance < -0.012).mean())


def seen(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Casts parallel rays at a surface from the front, PIXEL apart.

    Args:
        vertices: (V,3) metres.
        faces: (F,3).

    Returns:
        The first face (H,W) that each ray meets, -1 for none, and its distance (H,W) in metres.
    """
    low, high = vertices.min(0), vertices.max(0)
    x, y = np.arange(low[0], high[0], PIXEL), np.arange(high[1], low[1], -PIXEL)
    origin = np.stack([*np.meshgrid(x, y), np.full((len(y), len(x)), high[2] + 0.1)], axis=-1).reshape(-1, 3)
    ahead = np.broadcast_to([0.0, 0.0, -1.0], origin.shape)
    face, depth = Collider(vertices, vertices, faces).cast(origin, ahead)
    return face.reshape(len(y), len(x)), depth.reshape(len(y), len(x))


def through(vertices: np.ndarray, faces: np.ndarray, layer: np.ndarray) -> int:
    """Counts the pixels where a lower layer came through a higher one, seen from the front.

    These are patches of at most SPECK pixels, enclosed by a higher layer at nearly the same depth.

    Args:
        vertices: (V,3) metres.
        faces: (F,3).
        layer: (F,) 0 the skin, 1, 2, ... the clothes outward, -1 anything else.
    """
    face, depth = seen(vertices, faces)
    label = np.where(face >= 0, layer[face], -2)
    total = 0
    for lower in range(int(layer.max())):
        patches = ndimage.label(label == lower)[0]
        for number, box in enumerate(ndimage.find_objects(patches), 1):
            box = tuple(slice(max(s.start - 2, 0), s.stop + 2) for s in box)
            mine = patches[box] == number
            if mine.sum() > SPECK:
                continue
            ring = ndimage.binary_dilation(mine) & ~mine
            over = label[box][ring] > lower
            if over.all() and abs(depth[box][ring].mean() - depth[box][mine].mean()) < 0.02:
                total += int(mine.sum())
    return total


def figure(mesh: Mesh, layer: np.ndarray) -> str | None:
    """Judges the assembled figure.

    Args:
        mesh: its record.
        layer: (F,) of its faces, as for `through`.

    Returns:
        Why it is rejected; None if it passes.
    """
    if not np.isfinite(mesh.vertices).all():
        return "vertices not finite"
    height = float(np.ptp(mesh.vertices[:, 1]))
    if not 1.0 < height < 2.7:
        return f"{height:.2f} m high"
    if (count := through(mesh.vertices, mesh.faces, layer)) > THROUGH:
        return f"{count} pixels of a lower layer show through the cloth"
    return None
