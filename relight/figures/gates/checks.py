"""Gates: tests that a figure must pass, or it is drawn again. Cloth is finite, in place, and not over-stretched."""

import numpy as np
import warp as wp
from scipy import ndimage

from relight.figures.body import makehuman
from relight.figures.body.motion import Motion
from relight.figures.cut.patterns import Pattern
from relight.figures.drape.colliders import Collider, signed_distance, vec3_array
from relight.figures.drape.dress import DrapedGarment
from relight.figures.drape.kernels import find_intersections
from relight.figures.drape.simulate import DrapeResult
from relight.figures.gates.rings import lost_rings
from relight.figures.surfaces import Surface, face_normals, normals, stacked
from relight.meshes import Mesh

MAX_STRAIN = 1.35  # 95th percentile of an edge's length over that on the pattern
MAX_EXTREME_STRAIN = 2.5  # 99.9th percentile of the same
MAX_INSIDE = 0.012  # share of the cloth inside the body
INSIDE = 0.012  # depth under the skin at which cloth counts as inside, metres
PIXEL = 0.003  # metres between the rays that look for skin or cloth that pokes through
MAX_PATCH = 250  # pixels of a patch of a lower layer inside a higher one; larger patches are openings
MAX_POKE_DEPTH = 0.02  # metres between such a patch and the layer around it; deeper ones are seen through an opening
MAX_POKE_THROUGH = 60  # pixels of such patches per figure
MAX_CROSSING = 0.015  # share of a garment's faces that passed through cloth
MAX_CROSSING_SITTING = 0.03  # likewise, for figures that sit: trousers crease through themselves in the fold of the hip
MIN_DEPTH = 0.003  # metres that two faces must reach through each other, on both sides; folds that graze do not count
MIN_REST_DISTANCE = 0.03  # metres on the pattern: closer faces of one garment are neighbours
MAX_COVERED = 0.25  # share of a hand, seen from the front, that cloth covers
MIN_HEIGHT, MAX_HEIGHT = 1.0, 2.7  # of a figure, metres
COVER_RANGE = 0.04  # metres: cloth further before a hand merely hangs in front of it
MIN_HAND_VERTICES = 40  # seen from the front; with fewer or as many a hand is not judged
LONG_DROP = 0.2  # length of a drop above which its hem hangs level in all poses, metres
MAX_HEM_SWEPT = 0.10  # difference in height between parts of a hem, metres
SWEPT_PER_DROP = 0.35  # more of it for each metre of a long drop
MAX_SPREAD = 0.25  # distance of cloth from the body, in addition to that of its drop, metres
SPREAD_PER_DROP = 0.4  # the same for each metre of drop, in addition to its flare
MAX_SLID = 0.12  # distance that the top of a garment may slide down, metres


def check_garment(pattern: Pattern, draped: DrapeResult, motion: Motion) -> str | None:
    """Judges one draped garment.

    Args:
        pattern: its pattern.
        draped: the result of its simulation.
        motion: how the body moves from its rest pose into the pose.

    Returns:
        Why it is rejected, in one phrase; None if it passes.
    """
    garment, x = pattern.garment, draped.positions
    name = garment.name
    if not np.isfinite(x).all():
        return f"{name}: not finite"
    if (strain := np.percentile(draped.strain, 95)) > MAX_STRAIN:
        return f"{name}: stretched to {strain:.2f} of its pattern"
    if (strain := np.percentile(draped.strain, 99.9)) > MAX_EXTREME_STRAIN:
        return f"{name}: torn, edges at {strain:.2f} of their pattern"
    skin = motion.posed_skin
    reach = MAX_SPREAD + garment.drop * (SPREAD_PER_DROP + garment.flare)
    low, high = skin.min(0) - reach, skin.max(0) + reach
    if (x < low).any() or (x > high).any():
        return f"{name}: flew away from the body"
    max_swept = MAX_HEM_SWEPT + SWEPT_PER_DROP * garment.drop * (garment.drop > LONG_DROP)
    if (swept := hem_swept(pattern, x, motion)) > max_swept:
        return f"{name}: its hem was swept up by {swept:.2f} m"
    if (share := share_inside(x, skin)) > MAX_INSIDE:
        return f"{name}: {100 * share:.1f} % of it inside the body"
    if garment.kind == "scarf":
        return None
    slid = x[:, 1].max() - motion.skin(pattern.levels[0].weights, pattern.levels[0].fitted)[:, 1].max()
    if slid < -MAX_SLID:
        return f"{name}: slid down by {-slid:.2f} m"
    for limb, (lost, rings) in lost_rings(pattern, x, motion).items():
        if lost:
            return f"{name}: the {limb} left it, {lost} of {rings} rings do not go around it"
    return None


def hem_swept(pattern: Pattern, x: np.ndarray, motion: Motion) -> float:
    """Returns the metres between the highest and the lowest part of a hem, without 5 % at either end.

    A hem that is swept up at one side fails. One longer than LONG_DROP should hang level, so its heights are taken as
    they are; a shorter one follows the legs, so they are relative to where it would be if it moved with the body.

    Args:
        pattern: the result is 0 if it has no drop.
        x: (n,3) the draped finest vertices, metres.
        motion: how the body moves from its rest pose into the pose.
    """
    if not pattern.garment.drop:
        return 0.0
    level, hem = pattern.levels[-1], pattern.fields["drop"] > 0.999
    height = x[hem, 1]
    if pattern.garment.drop <= LONG_DROP:
        height = height - motion.skin(level.weights[hem], level.fitted[hem])[:, 1]
    return float(np.ptp(np.percentile(height, [5, 95])))


def check_outfit(worn: list[DrapedGarment], motion: Motion, sitting: bool) -> tuple[str | None, dict[str, float]]:
    """Judges the garments together.

    Args:
        worn: the draped garments, from the skin outward.
        motion: how the body moves from its rest pose into the pose.
        sitting: whether the figure sits; more of its cloth may go through cloth.

    Returns:
        Why they are rejected, None if they pass; and the measures: `crossing`, the largest share of a garment's faces
        that passed through cloth, and `covered`, the larger share of a hand's skin that cloth covers in front.
    """
    levels = [w.pattern.levels[1] for w in worn]  # begins with the same vertices as the finest one
    sheets = [(w.draped.positions[: len(level.rest_shape)], level.faces) for w, level in zip(worn, levels)]
    crossings = crossing(sheets, [level.rest_shape for level in levels])
    hidden = max(covered_hands(worn, motion))
    measured = {"crossing": round(max(crossings), 4), "covered": round(hidden, 3)}
    for w, share in zip(worn, crossings):
        if share > (MAX_CROSSING_SITTING if sitting else MAX_CROSSING):
            return f"{w.pattern.garment.name}: {100 * share:.1f} % of it goes through cloth", measured
    return (f"{100 * hidden:.0f} % of a hand is sunk in cloth" if hidden > MAX_COVERED else None), measured


def crossing(sheets: list[Surface], rest_shapes: list[np.ndarray]) -> list[float]:
    """Measures which share of each garment's faces passed through cloth.

    Args:
        sheets: for each garment its vertices (n,3), metres, and faces (m,3).
        rest_shapes: for each garment its vertices (n,3) on the pattern, metres.

    Returns:
        For each garment the share of its faces that intersect, by more than MIN_DEPTH, faces of another garment, or
        its own that are more than MIN_REST_DISTANCE away on the pattern.
    """
    x, faces = stacked(sheets)
    centres = np.concatenate([rest[f].mean(1) for rest, (_, f) in zip(rest_shapes, sheets)])
    garment = np.repeat(np.arange(len(sheets)), [len(f) for _, f in sheets])
    points = vec3_array(x)
    indices: wp.array = wp.array(faces.astype(np.int32).ravel(), dtype=int)
    mesh = wp.Mesh(points=points, indices=indices)
    intersects = wp.zeros(len(faces), dtype=int)
    garments: wp.array = wp.array(garment.astype(np.int32), dtype=int)
    inputs = [mesh.id, points, indices, vec3_array(centres), garments, MIN_DEPTH, MIN_REST_DISTANCE, intersects]
    wp.launch(find_intersections, dim=len(faces), inputs=inputs)
    return [float(intersects.numpy()[garment == k].mean()) for k in range(len(sheets))]


def covered_hands(worn: list[DrapedGarment], motion: Motion) -> tuple[float, float]:
    """Measures the shares of the left and the right hand that cloth covers, seen from the front.

    Only skin that faces forward counts. It is covered where the first surface in front of it is cloth within
    COVER_RANGE whose outside faces forward too. Skin behind other skin or behind more distant cloth is not counted.
    Sleeves are left out: a cuff may fall over the hand. A hand with MIN_HAND_VERTICES counted vertices or fewer has
    share 0.

    Args:
        worn: the draped garments.
        motion: how the body moves from its rest pose into the pose.

    Returns:
        The shares of the left and of the right hand, in [0,1].
    """
    skin_faces = makehuman.base().faces["body"]
    skin = motion.posed_skin
    cloth = [(w.draped.positions, w.pattern.levels[-1].faces[~w.pattern.sleeve]) for w in worn]
    vertices, faces = stacked([(skin, skin_faces), *cloth])
    hand = makehuman.bone_weights("finger", "metacarpal") > 0.7
    skin_forward = normals(skin, skin_faces)[:, 2] > 0.2
    face_forward = face_normals(vertices, faces)[:, 2] > 0
    surface, shares = Collider.at_rest(vertices, faces), []
    for sign in (1, -1):  # left, right
        on_side = np.sign(motion.body.skin[:, 0]) == sign
        start = skin[hand & skin_forward & on_side] + [0, 0, 0.001]  # a millimetre before the skin
        face, depth = surface.raycast(start, np.array([0.0, 0.0, 1.0]))
        is_cloth, is_free = face >= len(skin_faces), face < 0  # the faces of the skin come first
        covered = is_cloth & (depth < COVER_RANGE) & face_forward[face]
        counted = covered | is_free
        shares.append(float(covered.sum() / counted.sum()) if counted.sum() > MIN_HAND_VERTICES else 0.0)
    return shares[0], shares[1]


def share_inside(x: np.ndarray, skin: np.ndarray) -> float:
    """Returns the share of the cloth that lies inside the body.

    Args:
        x: (n,3) the vertices of the cloth, metres.
        skin: (V,3) the posed skin.

    Returns:
        The share of vertices deeper than INSIDE under the skin, without that of hands and wrists.
    """
    faces = makehuman.base().faces["body"]
    hands = makehuman.bone_weights("finger", "metacarpal", "wrist") > 0.3
    _, distance, _ = signed_distance(x, Collider.at_rest(skin, faces[~hands[faces].any(1)]), max_distance=0.12)
    return float((distance < -INSIDE).mean())


def first_seen(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Casts parallel rays at a surface from the front, PIXEL apart.

    Args:
        vertices: (V,3) metres.
        faces: (F,3).

    Returns:
        The first face (H,W) that each ray hits, -1 for none, and its distance (H,W) in metres.
    """
    low, high = vertices.min(0), vertices.max(0)
    x, y = np.arange(low[0], high[0], PIXEL), np.arange(high[1], low[1], -PIXEL)
    origin = np.stack([*np.meshgrid(x, y), np.full((len(y), len(x)), high[2] + 0.1)], axis=-1).reshape(-1, 3)
    face, depth = Collider.at_rest(vertices, faces).raycast(origin, np.array([0.0, 0.0, -1.0]))
    return face.reshape(len(y), len(x)), depth.reshape(len(y), len(x))


def poke_through(vertices: np.ndarray, faces: np.ndarray, layer: np.ndarray) -> int:
    """Counts the pixels where a lower layer pokes through a higher one, seen from the front.

    These are patches of at most MAX_PATCH pixels, enclosed by a higher layer at nearly the same depth.

    Args:
        vertices: (V,3) metres.
        faces: (F,3).
        layer: (F,) 0 the skin, 1, 2, ... the clothes outward, -1 anything else.
    """
    face, depth = first_seen(vertices, faces)
    seen_layer = np.where(face >= 0, layer[face], -2)  # -2 where no face is seen
    total = 0
    for lower in range(int(layer.max())):
        patches = ndimage.label(seen_layer == lower)[0]
        for number, box in enumerate(ndimage.find_objects(patches), 1):
            box = tuple(slice(max(s.start - 2, 0), s.stop + 2) for s in box)  # with room for the ring around the patch
            patch = patches[box] == number
            if patch.sum() > MAX_PATCH:
                continue
            ring = ndimage.binary_dilation(patch) & ~patch
            enclosed = (seen_layer[box][ring] > lower).all()
            if enclosed and abs(depth[box][ring].mean() - depth[box][patch].mean()) < MAX_POKE_DEPTH:
                total += int(patch.sum())
    return total


def check_figure(mesh: Mesh, layer: np.ndarray) -> str | None:
    """Judges the assembled figure.

    Args:
        mesh: its record.
        layer: (F,) of its faces: 0 the skin, 1, 2, ... the clothes outward, -1 anything else.

    Returns:
        Why it is rejected; None if it passes.
    """
    if not np.isfinite(mesh.vertices).all():
        return "vertices not finite"
    height = float(np.ptp(mesh.vertices[:, 1]))
    if not MIN_HEIGHT < height < MAX_HEIGHT:
        return f"{height:.2f} m high"
    if (count := poke_through(mesh.vertices, mesh.faces, layer)) > MAX_POKE_THROUGH:
        return f"{count} pixels of a lower layer show through the cloth"
    return None
