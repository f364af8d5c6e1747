"""Paints the albedo of skin and eyes in MakeHuman's UV: tone, lips, brows, lids, nails, stubble, cropped hair."""

from functools import cache

import numpy as np
from PIL import Image

from relight.figures.body import makehuman
from relight.figures.catalogue.schema import entries
from relight.figures.draw.outfits import Outfit
from relight.figures.draw.person import Person
from relight.figures.texture import Color, coded, lattice, lattice_value, noise
from relight.meshes import Material

SEAM_MARGIN = 0.25  # part of a triangle painted beyond its edges, so that lookups at seams of the UV find skin
UPPER_LIP, LOWER_LIP = 474, 494  # vertices of the base mesh where the lips meet, in the middle
MOUTH_RADII = (0.027, 0.009, 0.03)  # of the ellipsoid of lips and mouth: sideways, up, forward, metres
FACE_DEPTH = 0.035  # metres behind the eyes up to which skin belongs to the face


@cache
def texels(side: int) -> np.ndarray:
    """Returns the point of the base body (side,side,3) at each texel of its UV map, metres; NaN outside the islands.

    The triangles of the map are rasterised: a texel gets the point with its barycentric coordinates.
    """
    base = makehuman.base()
    at = base.uv[base.uv_faces["body"]] * side - 0.5  # (F,3,2) corners, texels
    corner = base.vertices[base.faces["body"]]
    points = np.full((side, side, 3), np.nan)
    low, high = np.floor(at.min(1)).astype(int) - 1, np.ceil(at.max(1)).astype(int) + 1
    a, b, c = at[:, 0], at[:, 1], at[:, 2]
    twice_area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    box_side = (high - low + 1).max(1)
    for size in np.unique(box_side):  # all triangles with boxes of one size at once
        group = np.flatnonzero((box_side == size) & (np.abs(twice_area) > 1e-9))
        column, row = np.meshgrid(np.arange(size), np.arange(size))
        x, y = low[group, 0, None, None] + column, low[group, 1, None, None] + row
        shares = []
        for p, q in ((b, c), (c, a), (a, b)):  # the share of a corner is the area opposite it over the whole
            p, q = p[group][:, :, None, None], q[group][:, :, None, None]
            twice_part = (q[:, 0] - p[:, 0]) * (y - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x - p[:, 0])
            shares.append(twice_part / twice_area[group, None, None])
        barycentric = np.stack(shares, -1)
        inside = (barycentric > -SEAM_MARGIN).all(-1) & (x >= 0) & (y >= 0) & (x < side) & (y < side)
        place = side - 1 - y[inside], x[inside]  # rows run from the top, v from the bottom
        points[place] = np.einsum("gijk,gkd->gijd", barycentric, corner[group])[inside]
    return points


@cache
def region(name: str, side: int) -> np.ndarray:
    """Returns one of MakeHuman's masks in the UV map of the body, (side,side) in [0,1].

    Args:
        name: of its file mpfb_<name>.jpg: lips, eyelids, ears, fingernails, ...
        side: pixels to which it is scaled.
    """
    picture = Image.open(makehuman.folder() / f"mpfb2/textures/mpfb_{name}.jpg").convert("L")
    return np.asarray(picture.resize((side, side), Image.Resampling.BILINEAR), float) / 255


def tone(person: Person) -> np.ndarray:
    """Returns the person's mean skin albedo, linear (3,)."""
    tones = np.array(list(entries("colors", "skin", Color).values()))
    return np.array([np.interp(person.skin * (len(tones) - 1), range(len(tones)), tones[:, c]) for c in range(3)])


def paint_skin(person: Person, outfit: Outfit, side: int, seed: int) -> Material:
    """Paints the skin: tone, freckles and moles, blush, lips, nails, then hair. All shares are set by eye.

    Args:
        person: skin tone, sex.
        outfit: gives the color of the hair, the stubble of scalp and beard, and makeup.
        side: pixels of the texture.
        seed: random seed of the random details.
    """
    hair, scalp, beard, makeup = np.array(outfit.hair_color), outfit.hair.scalp, outfit.beard, outfit.makeup
    point = texels(side)
    inside = np.isfinite(point[..., 0])
    x, y, z = np.moveaxis(point[inside], -1, 0)
    eye = makehuman.base().vertices[makehuman.EYES["L"]].mean(0)
    skin = tone(person)
    blush = np.array([1.0, 0.80, 0.80]) if person.skin > 0.35 else np.array([1.0, 0.92, 0.90])
    color = np.tile(skin, (len(x), 1))
    blotches = 0.10 * (noise(x * 30 + z * 17, y * 30, seed) - 0.5)
    pores = 0.06 * (noise(x * 400, y * 400 + z * 300, seed + 1) - 0.5)
    color *= (1 + blotches + pores)[:, None]
    across, front = np.abs(x), z > eye[2] - FACE_DEPTH

    def mix(share: np.ndarray, target: np.ndarray) -> None:
        """Mixes a share (n,) of a color (3,) or (n,3) into the texels inside the islands."""
        nonlocal color
        share = np.clip(share, 0, 1)[:, None]
        color = color * (1 - share) + target * share

    # Lengths are in metres relative to the left eye; a Gaussian around a place fades a color out.
    fleck = noise(x * 330, y * 330 + z * 250, seed + 5)
    sunny = np.exp(-(((y - eye[1] + 0.04) / 0.035) ** 2)) * front + 0.25  # freckles are densest across nose and cheeks
    mix(0.5 * freckles(person, seed) * sunny * np.clip((fleck - 0.66) / 0.12, 0, 1), skin * [0.66, 0.52, 0.44])
    mole = noise(x * 170, y * 170 + z * 130, seed + 6)
    mix(0.7 * np.clip((mole - 0.965) / 0.015, 0, 1), skin * [0.42, 0.33, 0.30])
    cheek = np.exp(-(((across - 0.043) / 0.022) ** 2) - ((y - eye[1] + 0.045) / 0.020) ** 2) * front
    nose = np.exp(-((across / 0.016) ** 2) - ((y - eye[1] + 0.045) / 0.018) ** 2) * front
    mix(0.5 * np.maximum(cheek, 0.8 * nose), color * blush * 0.95)
    mix(0.35 * region("ears", side)[inside], color * blush * 0.9)
    mix(0.3 * region("eyelids", side)[inside] * (0.6 + makeup), color * np.array([0.62, 0.55, 0.56]))
    lipstick = np.array([0.34, 0.035, 0.045]) * (0.4 + 0.6 * person.skin)
    lips = skin * np.array([0.92, 0.52, 0.52]) * (1 - makeup) + lipstick * makeup
    mix((0.55 + 0.35 * makeup) * region("lips", side)[inside], lips)
    nails = np.maximum(region("fingernails", side), region("toenails", side))[inside]
    mix(0.6 * nails, skin * np.array([1.15, 1.0, 0.98]) if makeup < 0.5 else np.array([0.4, 0.03, 0.06]))
    strokes = 0.5 + 0.7 * noise(x * 1100 + y * 1500, y * 350, seed + 2)
    mix(0.8 * brow_share(point[inside], person) * strokes, brow_color(hair))
    if beard > 0:
        hairs = beard_share(point[inside]) * (1 - region("lips", side)[inside])
        mix(min(0.8, beard) * hairs * (0.6 + 0.5 * noise(x * 900, y * 900, seed + 3)), 0.8 * brow_color(hair))
    if scalp > 0:
        above = np.clip(above_hairline(point[inside]) / 0.06 - 0.4, 0, 1)  # 1 where hair grows
        density = 0.85 + 0.25 * noise(x * 700, y * 700 + z * 500, seed + 4)
        mix(scalp * above * density, np.minimum(brow_color(hair), skin))
    image = np.broadcast_to(skin, (side, side, 3)).copy()
    image[inside] = color
    return Material(texture=coded(image), name="skin")


def brow_color(hair: np.ndarray) -> np.ndarray:
    """Returns the linear albedo (3,) of brows and cropped beards; skin shows through where hair is light and thin."""
    return 0.8 * hair * min(1.0, (0.09 / max(float(hair.mean()), 1e-6)) ** 0.7)


def brow_share(points: np.ndarray, person: Person) -> np.ndarray:
    """Returns the density (n,) of brows at points (n,3) of the base body, in [0,1].

    A brow is an arched line above the eye, with a Gaussian across it that is narrower toward its ends.
    """
    eye = makehuman.base().vertices[makehuman.EYES["L"]].mean(0)
    across, y = np.abs(points[:, 0]), points[:, 1]
    beyond_eye, before_eye = np.clip(across - eye[0] - 0.004, 0, 1), np.clip(eye[0] - across, 0, 1)  # metres
    line = eye[1] + 0.0225 - 0.30 * beyond_eye - 0.12 * before_eye  # its height falls to both sides
    outward = (across - eye[0]) / 0.023  # -1 at the inner end of the brow, 1 at the outer one
    thickness = (0.0040 - 0.0006 * person.female) * (1 - 0.35 * np.clip(outward, -0.2, 1))
    ends = np.clip(1.9 * (1 - np.abs(outward - 0.04)), 0, 1)  # 0 at both ends, 1 between
    share = np.exp(-(((y - line) / (thickness * (0.35 + 0.65 * ends))) ** 2)) * ends
    return np.clip(1.5 * share, 0, 1) * (points[:, 2] > eye[2] - FACE_DEPTH)


def beard_share(points: np.ndarray) -> np.ndarray:
    """Returns the density (n,) of a beard on jaw, chin and upper lip at points (n,3) of the base body, in [0,1]."""
    eye = makehuman.base().vertices[makehuman.EYES["L"]].mean(0)

    def ramp(value: np.ndarray, width: float) -> np.ndarray:
        """Returns 0 where a value is negative and 1 where it is positive, with a rise of a width around 0."""
        return np.clip(value / width + 0.5, 0, 1)

    # Metres from the middle, below the eye and behind it. Each ramp is 0 on one side of a border and 1 on the other.
    across, down, back = np.abs(points[:, 0]), eye[1] - points[:, 1], eye[2] - points[:, 2]
    cheek_line = 0.062 - 0.55 * np.clip(across - 0.030, 0, 0.05)  # the beard climbs toward the ear
    jaw = ramp(down - cheek_line, 0.014) * ramp(0.122 - down, 0.022) * ramp(0.082 - back, 0.018)
    lip = ramp(0.026 - across, 0.008) * ramp(down - 0.052, 0.006) * ramp(0.07 - down, 0.006) * (back < 0.03)
    from_mouth = (points - makehuman.base().vertices[[UPPER_LIP, LOWER_LIP]].mean(0)) / MOUTH_RADII
    return np.maximum(jaw, lip) * (down < 0.16) * ((from_mouth**2).sum(1) >= 1)


def freckles(person: Person, seed: int) -> float:
    """Returns how freckled a person is, in [0,1]: above 0 for every second person with light skin."""
    return max(0.0, 2 * lattice_value(seed, 1, 91) - 1) * float(np.clip(3 * (person.skin - 0.5), 0, 1))


def hairline(azimuth: np.ndarray) -> np.ndarray:
    """Returns the sine (...) of the elevation above which hair grows, at azimuths (...) as in hair.yaml, either way."""
    line = entries("hair", "hairline", tuple[float, ...])
    return np.interp(np.abs(azimuth), line["azimuth"], line["elevation"])


def skull_centre(eye: np.ndarray) -> np.ndarray:
    """Returns the centre (3,) of a skull in its rest pose, given that of its left eye (3,), metres."""
    return np.array([0.0, eye[1] + 0.028, eye[2] - 0.085])


def above_hairline(points: np.ndarray) -> np.ndarray:
    """Returns how far points (...,3) of the base head are above its hairline, in sine of elevation; negative below it.

    Elevations are seen from the middle of the skull. It is -1 from 12 cm below the eyes on.
    """
    eye = makehuman.base().vertices[makehuman.EYES["L"]].mean(0)
    direction = points - skull_centre(eye)
    direction = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    above = direction[..., 1] - hairline(np.arctan2(direction[..., 0], direction[..., 2]))
    return np.where(points[..., 1] > eye[1] - 0.12, above, -1.0)


def paint_eye(iris: np.ndarray, side: int, seed: int) -> np.ndarray:
    """Paints an eye seen from the front, as large as the picture: (side,side,3) uint8 sRGB.

    Args:
        iris: (3,) linear albedo.
        side: side of the picture in pixels.
        seed: random seed of the rays of the iris.
    """
    axis = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = np.meshgrid(axis, -axis)
    from_centre, angle = np.hypot(x, y), np.arctan2(y, x)  # in radii of the eye, as the radii below
    redness = 0.15 * np.clip(from_centre - 0.5, 0, 1)[..., None]
    white = np.array([0.66, 0.63, 0.60]) * (1 - redness * np.array([0.2, 1, 1]))
    rays = 0.7 + 0.6 * lattice(np.floor(angle * 20), np.zeros_like(from_centre), seed)[..., None]

    def disc(radius: float) -> np.ndarray:
        return np.clip((radius - from_centre) / 0.03 + 0.5, 0, 1)[..., None]

    iris_disc, dark_ring, pupil = disc(0.48), disc(0.50) - disc(0.44), disc(0.20)
    color = white * (1 - iris_disc) + np.array(iris) * rays * iris_disc
    color = color * (1 - 0.6 * dark_ring)
    return coded(color * (1 - pupil) + 0.008 * pupil)
