"""Builds hair of head and face from strands, and hats with the hair that they leave free."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from relight.figures.body import makehuman
from relight.figures.body.person import Body, Person
from relight.figures.catalogue.schema import entries
from relight.figures.cloth.colliders import Collider
from relight.figures.hair import facial
from relight.figures.hair.combing import Comb, head_centre
from relight.figures.hair.locks import grow_locks, tied_hair
from relight.figures.pose.poses import Motion
from relight.figures.surfaces import thickened
from relight.figures.texture import Color, lattice

COLUMNS, CROWN_ROWS = 180, 34
LIGHT_SKIN_COLORS = {
    "dark brown": 0.25, "brown": 0.28, "auburn": 0.08, "blond": 0.2, "fair": 0.08, "red": 0.04, "black": 0.07,
}  # fmt: skip
DARK_SKIN_COLORS = {"black": 0.6, "dark brown": 0.32, "brown": 0.08}


@dataclass(frozen=True)
class Style:
    """A hair style.

    Attributes:
        name: as `relight figures --names` lists it.
        comb: how the hair lies, or None for painted hair only.
        tie, hat: its kind, or none.
        slack: metres between scalp and hat.
        scalp: coverage of the cropped hair painted on the scalp, in [0,1].
        men, women: how often they have it, relative to other styles.
        african: likewise, for people of mostly African ancestry; None if that makes no difference.
        balding: whether it is more frequent with age, among men.
    """

    name: str
    comb: Comb | None = None
    tie: Literal["none", "bun", "ponytail"] = "none"
    hat: Literal["none", "beanie", "cap"] = "none"
    slack: float = 0.0
    scalp: float = 1.0
    men: float = 0.0
    women: float = 0.0
    african: float | None = None
    balding: bool = False


def styles() -> dict[str, Style]:
    """Returns all hair styles, by name."""
    return entries("hair", "styles", Style)


def style_odds(woman: bool, person: Person, names: Collection[str] = ()) -> np.ndarray:
    """Returns the probability of each of `styles` (S,), 0 for those that `names` excludes; all 0 if none is left."""
    odds = []
    for style in styles().values():
        weight = style.women if woman else style.men
        if style.balding and not woman:
            weight += max(0, person.age - 35) / 20
        if style.african is not None and person.ancestry[0] > 0.5:
            weight = style.african
        odds.append(weight * (not names or style.name in names))
    return np.array(odds) / max(np.sum(odds), np.finfo(float).tiny)


def sample_color(rng: np.random.Generator, person: Person) -> Color:
    """Draws the linear albedo of a person's hair: grey or white with age, else by skin and ancestry."""
    if rng.random() < np.clip((person.age - 42) / 35, 0, 0.9):
        name = "white" if rng.random() < (person.age - 50) / 40 else "grey"
    else:
        odds = LIGHT_SKIN_COLORS if person.skin > 0.72 and person.ancestry[2] > 0.4 else DARK_SKIN_COLORS
        name = str(rng.choice(list(odds), p=list(odds.values())))
    red, green, blue = (np.array(entries("colors", "hair", Color)[name]) * np.exp(rng.normal(0, 0.12))).tolist()
    return red, green, blue


@dataclass(frozen=True)
class HairPart:
    """A part of hair or hat.

    Attributes:
        name: of the part.
        vertices: (V,3) posed, metres.
        faces: (F,3).
        uv: (V,2) across and along the strands.
        kind: hair | hat | brows | lashes | beard, which differ in colour.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    kind: str = "hair"


def build_hair(
    body: Body,
    motion: Motion,
    style: Style,
    bearded: float,
    below: tuple[np.ndarray, np.ndarray],
    seed: int,
    fine: bool,
) -> list[HairPart]:
    """Builds the hair of head and face, and the hat, at the last frame.

    Args:
        body: in its rest pose.
        motion: into the pose.
        style: of the hair.
        bearded: amount of beard, in [0,1].
        below: vertices and faces of posed skin and clothes.
        seed: of length, parting, fringe, and of each strand.
        fine: all strands, else fewer, wider ones.
    """
    parts = [
        HairPart("brows", *facial.brows(body, motion, seed, fine), "brows"),
        HairPart("lashes", *facial.lashes(body, motion, seed, fine), "lashes"),
    ]
    beard = facial.beard(body, motion, bearded, below, seed, fine)
    if beard is not None:
        parts.append(HairPart("beard", *beard, "beard"))
    if style.comb is None:
        return parts
    if style.hat != "none":
        parts += hat(body, motion, style)
    comb = varied(style.comb, seed)
    parts.append(HairPart("locks", *grow_locks(body, motion, comb, below, seed, fine, style.hat != "none")))
    if style.tie != "none":
        parts.append(HairPart(style.tie, *tied_hair(body, motion, style.tie, below, seed, fine)))
    return parts


def varied(comb: Comb, seed: int) -> Comb:
    """Draws one person's length, parting and fringe."""
    a, b, c = (float(lattice(np.array(seed), np.array(k), 77)) for k in range(3))
    return replace(
        comb,
        length=comb.length * (0.85 + 0.3 * a),
        part=comb.part * (1 if b < 0.5 else -1),
        fringe=comb.fringe if comb.fringe == 0 or c < 0.7 else 0.0,
    )


def hat(body: Body, motion: Motion, style: Style) -> list[HairPart]:
    """Builds a round shell over the scalp, and the peak of a cap."""
    centre = head_centre(body)
    head = Collider(body.skin, body.skin, makehuman.base().faces["body"])
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
        posed, faces, source = thickened(posed, faces, np.full(len(posed), 0.003), 6)
        out.append(HairPart(style.name, posed, faces, at[source], "hat"))
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


def hat_thickness(style: Style, direction: np.ndarray, s: np.ndarray) -> np.ndarray:
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


def brim(points: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
