"""Props that figures hold or sit on: phone, cup, bag, stool."""

import numpy as np

from relight.figures.body import makehuman
from relight.figures.body.kinematics import orthonormal_frame, unit
from relight.figures.body.motion import Motion
from relight.figures.drape.colliders import Collider, signed_distance
from relight.figures.draw.poses import Pose
from relight.figures.surfaces import Surface, cut_cells, face_normals, ring_grid, stacked, unit_rows
from relight.meshes import Material

GREYS = (0.02, 0.04, 0.12, 0.45, 0.7)  # luminance of albedo
TINTS = ((1.0, 1.0, 1.0), (1.25, 0.95, 0.75), (0.75, 1.0, 1.3), (1.5, 0.7, 0.6), (0.8, 1.15, 0.7))
CUP_HEIGHT = 0.105  # metres, without the rim of its lid
CUP = (  # radius and height of its profile, from the middle of the bottom to that of the lid
    (0, 0), (0.026, 0), (0.029, 0.002), (0.037, CUP_HEIGHT), (0.039, CUP_HEIGHT + 0.004), (0.036, CUP_HEIGHT + 0.006),
    (0, CUP_HEIGHT),
)  # fmt: skip
SIDES = 28  # of a cup, around its axis
BAG_CLEARANCE = 0.012  # metres between a bag and the clothes
MAX_BAG_OFFSET = 0.16  # largest distance that a bag is moved outward, metres
SEAT = (0.20, 0.19, 0.035)  # half the width and depth of a stool's seat, and its thickness, metres
LEG = 0.016  # half the thickness of its legs
SEAT_RANGE = 0.03  # largest distance of cloth on the seat from the thighs, metres
HANGING_RANGE = 0.12  # metres below the seat where cloth counts as hanging; lower down there may be calves
MAX_HANGING = 0.02  # share of the vertices above or below the seat that may hang below it; skirts have more
Prop = tuple[Surface, Material]  # its posed surface and its material


def box(half: tuple[float, float, float], rounding: float = 0.0, bulge: float = 0.0) -> Surface:
    """Builds a closed box around the origin, finely divided.

    Args:
        half: half of its sides, metres.
        rounding: radius of its edges, metres.
        bulge: metres by which the middles of its sides at both ends of z bulge.

    Returns:
        Vertices (V,3) and faces (F,3), counter-clockwise outward.
    """
    n = 9  # vertices along an edge
    t = np.linspace(-1, 1, n)
    u, v = (grid.ravel() for grid in np.meshgrid(t, t))
    square = cut_cells(np.arange(n * n).reshape(n, n), "abd", "adc")
    ends = [np.stack([np.full_like(u, sign), sign * u, v], axis=1) for sign in (1, -1)]  # the two sides across x
    sides = [(np.roll(end, axis, axis=1), square) for axis in range(3) for end in ends]
    cube, faces = stacked(sides)  # from -1 to 1
    _, first, inverse = np.unique(cube.round(6), axis=0, return_index=True, return_inverse=True)
    cube, faces = cube[first], inverse.reshape(-1)[faces]  # sides share the vertices of their edges
    core = cube * np.maximum(np.array(half) - rounding, 1e-4)  # the box less its rounding, which is added outward
    is_end = np.abs(cube) > 1 - 1e-6
    outward = np.where(is_end, np.sign(cube), 0.0)
    x = core + rounding * outward / np.linalg.norm(outward, axis=1, keepdims=True)
    swell = bulge * (1 - cube[:, 0] ** 2) * (1 - cube[:, 1] ** 2)
    x[:, 2] += np.sign(cube[:, 2]) * swell * is_end[:, 2]
    return x, faces


def revolved(profile: np.ndarray) -> Surface:
    """Builds a surface of revolution about y from a profile (m,2): radius and height, from its lower end up."""
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.stack([np.sin(angle), np.zeros(SIDES), np.cos(angle)], 1)
    x = profile[:, None, :1] * ring + profile[:, None, 1:] * np.array([0.0, 1.0, 0.0])
    x, faces = x.reshape(-1, 3), cut_cells(ring_grid(len(profile), SIDES), "abd", "adc")
    twice_area = np.linalg.norm(face_normals(x, faces), axis=1)
    return x, faces[twice_area > 1e-12]  # triangles at the ends are degenerate


def strap(line: np.ndarray, across: np.ndarray, width: float, thickness: float) -> Surface:
    """Builds a closed strap of rectangular section along a line.

    Args:
        line: (m,3) points of its middle, metres.
        across: (3,) direction of its width, perpendicular to the line.
        width, thickness: metres.

    Returns:
        Vertices (4 m,3) and faces (F,3), counter-clockwise outward.
    """
    along = unit_rows(np.gradient(line, axis=0))
    side = np.broadcast_to(unit(across), line.shape)
    up = np.cross(along, side)
    corners = [line + s * width / 2 * side + t * thickness / 2 * up for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    rings = ring_grid(len(line), 4)
    first, last = rings[0], rings[-1]
    ends = [first[[0, 2, 1]], first[[0, 3, 2]], last[[0, 1, 2]], last[[0, 2, 3]]]
    return np.stack(corners, 1).reshape(-1, 3), np.concatenate([cut_cells(rings, "abd", "adc"), ends])


def _transformed(surface: Surface, axes: np.ndarray, at: np.ndarray) -> Surface:
    """Moves a surface to an origin (3,), with new axes as the columns of `axes` (3,3); faces stay outward."""
    vertices, faces = surface
    return vertices @ axes.T + at, faces if np.linalg.det(axes) > 0 else faces[:, ::-1]


def sample_color(rng: np.random.Generator, min_grey: float = 0.0) -> np.ndarray:
    """Draws a linear albedo (3,), of GREYS of at least `min_grey`, tinted."""
    grey = rng.choice([grey for grey in GREYS if grey >= min_grey])
    return np.clip(grey * np.array(TINTS[rng.integers(len(TINTS))]), 0.01, 0.85).astype(np.float32)


def palm(motion: Motion, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns where a posed hand is.

    Args:
        motion: how the body moves from its rest pose into the pose.
        side: L | R, of the hand.

    Returns:
        The root (3,) of its middle finger, metres, and its axes (3,3) in columns: along the fingers, out of the palm,
        across.
    """
    bones = ("wrist", "finger3-1", "finger2-1", "finger5-1")
    wrist, root, index, little = (motion.joint(f"{bone}.{side}") for bone in bones)
    outward = np.cross(index - little, root - wrist) * (-1 if side == "L" else 1)
    return root, orthonormal_frame(root - wrist, outward)


def _hand_prop(kind: str, motion: Motion, side: str, figure: Surface, rng: np.random.Generator) -> list[Prop]:
    """Builds the prop (phone, cup or bag) in a posed hand; none if there is no room for a bag.

    `figure` has vertices and faces of the posed and dressed figure, from which a bag keeps BAG_CLEARANCE.
    """
    root, axes = palm(motion, side)
    along, out, _ = axes.T  # along the fingers, out of the palm
    if kind == "phone":
        body = box(half=(0.074, 0.004, 0.036), rounding=0.004)
        phone = _transformed(body, axes, root + 0.020 * out + 0.012 * along)
        return [(phone, Material(sample_color(rng), name="phone"))]
    if kind == "cup":
        x, faces = revolved(np.array(CUP))
        place = root + 0.052 * out - 0.018 * along - np.array([0.0, 0.5 * CUP_HEIGHT + 0.01, 0.0])
        return [((place + x, faces), Material(sample_color(rng, min_grey=0.12), name="cup"))]
    return _bag(motion, 1.0 if side == "L" else -1.0, grip=root + 0.030 * out, figure=figure, rng=rng)


def _bag(motion: Motion, sign: float, grip: np.ndarray, figure: Surface, rng: np.random.Generator) -> list[Prop]:
    """Builds a bag that hangs upright by two straps, moved outward until it keeps BAG_CLEARANCE.

    The straps run through the point `grip` (3,) of the left hand, `sign` 1, or the right one, -1. There is no bag if it
    has no room within MAX_BAG_OFFSET.
    """
    ahead = motion.bone("root")[:, 2] * [1, 0, 1]  # level
    outward = orthonormal_frame(ahead, np.array([sign, 0.0, 0.0]))[:, 1]
    half_height, half_width, loop = rng.uniform(0.11, 0.16), rng.uniform(0.13, 0.18), rng.uniform(0.12, 0.18)
    axes = np.stack([orthonormal_frame(ahead, outward)[:, 0], [0.0, 1.0, 0.0], outward], axis=1)
    body = box(half=(half_width, half_height, 0.035), rounding=0.012, bulge=0.012)
    x, faces = _transformed(body, axes, grip - [0, loop + half_height, 0])
    surface = Collider.at_rest(*figure)
    away = 0.0
    while away <= MAX_BAG_OFFSET:
        face, distance, _ = signed_distance(x + away * outward, surface, max_distance=0.1)
        if not ((face >= 0) & (distance < BAG_CLEARANCE)).any():
            break
        away += 0.01
    else:
        return []
    material = Material(sample_color(rng), name="bag")
    s = np.linspace(-1, 1, 25)[:, None]  # along a strap, from one end over the hand (0) to the other end
    straps = []
    for face_sign in (1, -1):  # one strap on each face of the bag
        middle = x.mean(0) + away * outward + face_sign * 0.033 * outward + [0, half_height - 0.02, 0]
        line = middle + 0.55 * half_width * s * axes[:, 0]
        rise = (1 - s**4) * (grip + 0.006 * face_sign * outward - middle)
        narrowing = 0.55 * half_width * s * (1 - s**4) * 0.75 * axes[:, 0]
        straps.append(strap(line + rise - narrowing, outward, width=0.004, thickness=0.02))
    return [(stacked([(x + away * outward, faces), *straps]), material)]


def _stool(motion: Motion, figure: Surface, ground: float, rng: np.random.Generator) -> list[Prop]:
    """Builds a stool, seat and legs, under a sitting figure; none under a skirt, which hangs where the seat goes.

    `figure` is posed and dressed, and `ground` the height of the floor, metres.
    """
    thighs = motion.posed_skin[makehuman.bone_weights("root", "pelvis", "upperleg") > 0.5]
    lowest = thighs[thighs[:, 1] < thighs[:, 1].min() + 0.04]
    ahead = unit(motion.bone("root")[:, 2] * [1, 0, 1])
    up = np.array([0.0, 1.0, 0.0])
    axes = np.stack([np.cross(up, ahead), up, ahead], axis=1)
    x, _, z = lowest.mean(0)
    vertices, half_width, half_depth, thickness = figure[0], *SEAT
    off = (vertices - np.array([x, lowest[:, 1].min(), z])) @ axes
    in_outline = (np.abs(off[:, 0]) < half_width) & (np.abs(off[:, 2]) < half_depth)
    # Of the middle of the seat only: calves hang before it.
    on_seat = in_outline & (np.abs(off[:, 2]) < 0.5 * half_depth) & (np.abs(off[:, 1]) < SEAT_RANGE)
    top = float(np.percentile(vertices[on_seat, 1], 0.5))
    hanging = in_outline & (vertices[:, 1] < top - SEAT_RANGE) & (vertices[:, 1] > top - HANGING_RANGE)
    if hanging.sum() > MAX_HANGING * in_outline.sum():
        return []
    cushion = box(half=(half_width, thickness / 2, half_depth), rounding=0.012)
    cushion = _transformed(cushion, axes, np.array([x, top - thickness / 2, z]))
    legs = []
    length = top - thickness - ground
    for side, end in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        leg, faces = box(half=(LEG, length / 2, LEG), rounding=0.004)
        leg[:, [0, 2]] += 0.03 * np.array([side, end]) * (0.5 - leg[:, 1:2] / length)  # legs spread downward
        corner = axes @ [side * (half_width - 0.04), 0, end * (half_depth - 0.04)]
        legs.append(_transformed((leg, faces), axes, corner + [x, ground + length / 2, z]))
    seat, wood = sample_color(rng), sample_color(rng)
    return [(cushion, Material(seat, name="seat")), (stacked(legs), Material(wood, name="stool legs"))]


def props(motion: Motion, pose: Pose, figure: Surface, seed: int) -> list[Prop]:
    """Builds all props of a figure.

    Args:
        motion: how the body moves from its rest pose into the pose.
        pose: has the props of the hands, and whether the figure sits.
        figure: vertices and faces of the posed and dressed figure, which stands on the floor.
        seed: random seed of colors and sizes.
    """
    rng = np.random.default_rng([seed, 5])
    built = _stool(motion, figure, float(figure[0][:, 1].min()), rng) if pose.sitting else []
    for side, hand in (("L", pose.left), ("R", pose.right)):
        if hand.holds:
            built += _hand_prop(hand.holds, motion, side, figure, rng)
    return built
