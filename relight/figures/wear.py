"""Dressing: the garments of an outfit draped one over the other on a body that moves into its pose."""

from dataclasses import dataclass, replace

import numpy as np

from relight.figures import collars, drape, footwear, layers, makehuman, patterns, scarves, wrinkles
from relight.figures.body import Body
from relight.figures.colliders import Collider
from relight.figures.drape import Effort
from relight.figures.fabrics import Fabric
from relight.figures.garments import Garment
from relight.figures.outfits import Outfit
from relight.figures.poses import Motion
from relight.figures.surfaces import Surface, neighbours, normals, stacked

HANGS = 0.2  # metres of a drop from which on cloth hangs free in it
CLEFT = (0.04, -0.15, 0.16)  # metres from the middle, and from and to which height above the crotch, buttocks meet
BROAD = 100  # times that normals are averaged with their neighbours', to span several gathers
CLOSE = 0.6  # of a cloth's thickness: its folds come no nearer to what lies below


@dataclass(frozen=True)
class Detail:
    """refine: subdivisions of a garment; frames of the motion; efforts by level; body: subdivisions of the skin."""

    refine: int
    frames: int
    efforts: list[Effort]
    body: int


DETAILS = {
    "draft": Detail(1, 20, [Effort(12, 2, 8), Effort(10, 3, 8)], 0),
    "full": Detail(2, 28, [Effort(14, 2, 12), Effort(10, 4, 12), Effort(8, 5, 14, gravity=-5.0)], 1),
}


@dataclass(frozen=True)
class Worn:
    """One draped garment: its pattern, its fabric, and how it hangs."""

    pattern: patterns.Pattern
    fabric: Fabric
    draped: drape.Draped


def wear(body: Body, way: Motion, outfit: Outfit, detail: Detail) -> list[Worn]:
    """Drapes the garments one over the other."""
    rig, frames = makehuman.rig(), detail.frames
    weights = rig.weights[makehuman.BODY]
    faces = makehuman.base().faces["body"]

    def share(*names: str) -> np.ndarray:
        return weights[:, [i for i, bone in enumerate(rig.bones) if bone.startswith(names)]].sum(1)

    head = share(
        "head", "jaw", "eye", "levator", "oris", "special", "temporalis", "risorius", "oculi", "tongue", "orbicularis"
    )
    hands = share("finger", "metacarpal") + head
    arms = hands + share("wrist", "lowerarm", "upperarm")
    # hands and, for what hangs from the waist, arms are no obstacles: fingers would catch the cloth
    solid = {"top": faces[(hands[faces] < 0.3).all(1)], "other": faces[(arms[faces] < 0.3).all(1)]}
    solid["top"] = solid["top"][~cleft(body, body.skin, solid["top"])]
    posed = [way.skin(weights, body.skin, t) for t in range(frames + 1)]
    uppers = [] if outfit.shoe.straps else [footwear.upper(body, way.bones, outfit.shoe, side) for side in "LR"]
    shoes = [[(way.skin(one.weights, one.shape, t), one.faces) for one in uppers] for t in range(frames + 1)]
    worn: list[Worn] = []
    for garment, fabric in outfit.garments:
        if garment.kind == "scarf":
            bare = faces[(hands - head)[faces].max(1) < 0.3]
            worn.append(wrapped(body, way, garment, fabric, (posed[-1], bare), worn, detail))
            continue
        pattern = patterns.build_pattern(body, garment, detail.refine)
        top = garment.kind == "top"
        under = solid["top" if top else "other"]

        def below(
            frame: int,
            fine: bool,
            under: np.ndarray = under,
            top: bool = top,
            before: tuple[Worn, ...] = tuple(worn),
        ):
            parts = [(posed[frame], under), *([] if top else shoes[frame])]
            for w in before:
                level = w.pattern.levels[-1 if fine else 0]
                cloth = level.faces
                if top:
                    caught = cleft(body, level.held, cloth)
                    if fine and (w.pattern.garment.gather or w.pattern.garment.pleat):
                        caught |= fallen_over(w.draped.positions, cloth)
                    cloth = cloth[~caught]
                parts.append((w.draped.positions if fine else w.draped.history[frame], cloth))
            return stacked(parts)

        draped = drape.drape(
            pattern.levels, pattern.refine, garment.cloth, detail.efforts, below, way.skin, frames, ground=0.006
        )
        surface, corners = below(frames, True)
        folded = finished(pattern, draped, fabric, Collider(surface, surface, corners), neckband(pattern, body, way))
        worn.append(Worn(pattern, fabric, folded))
    return worn


def cleft(body: Body, rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces (F,) of a surface (vertices (n,3) on the rest pose, faces (F,3)) line the cleft between the buttocks
    and the thighs below. Cloth that hangs over them must not be caught there."""
    a, b, c = (rest[faces[:, k]] for k in range(3))
    middle, normal = (a + b + c) / 3, np.cross(b - a, c - a)
    sideways = np.abs(normal[:, 0]) > 0.6 * np.linalg.norm(normal, axis=1)
    high = middle[:, 1] - patterns.landmarks(body)["crotch"]
    return sideways & (np.abs(middle[:, 0]) < CLEFT[0]) & (high > CLEFT[1]) & (high < CLEFT[2])


def fallen_over(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces (F,) of cloth (n,3) turn against the side to which the cloth around them turns: gathers that fell
    over. What hangs over the cloth would be pushed into it by them, and be caught there."""
    facing = normals(x, faces)
    around = wrinkles.averaged(facing, neighbours(faces, len(x)), BROAD)
    middle, (a, b, c) = around[faces].sum(1), (x[faces[:, k]] for k in range(3))
    return np.einsum("fx,fx->f", np.cross(b - a, c - a), middle) < 0


def neckband(pattern: patterns.Pattern, body: Body, way: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """What `collars.banded` asks of a top: the cloth without folds (n,3), base and axis of the neck (3,)."""
    if pattern.garment.kind != "top":
        return None
    level, (neck, axes) = pattern.levels[-1], collars.neck_of(body, way)
    return way.skin(level.weights, level.held), neck, axes[1]


def finished(
    pattern: patterns.Pattern,
    draped: drape.Draped,
    fabric: Fabric,
    below: Collider,
    band: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> drape.Draped:
    """The drape with the fine folds of its cloth and, with a `neckband`, an even neckline, outside what lies below."""
    garment, level = pattern.garment, pattern.levels[-1]
    crimp = wrinkles.of_one_garment(garment.cloth.crimp, fabric.seed)
    hang = np.clip(4 * pattern.fields["tube"], 0, 1) * (garment.drop > HANGS)
    x = wrinkles.folded(pattern.levels, pattern.refine, draped.positions, crimp, hang, fabric.seed)
    if band is not None:
        x = collars.banded(x, level.faces, *band)
    face, distance, out = layers.sided(x, below, 2 * garment.cloth.thickness)
    lacking = np.clip(CLOSE * garment.cloth.thickness - distance, 0, garment.cloth.thickness)
    x = x + np.where((face >= 0) & (level.pinned < 0.5), lacking, 0)[:, None] * out
    return replace(draped, positions=x)


def wrapped(
    body: Body, way: Motion, garment: Garment, fabric: Fabric, skin: Surface, below: list[Worn], detail: Detail
) -> Worn:
    """A scarf over the posed skin (vertices, faces) and all garments below it; it is laid there, not carried there."""
    neck, axes = collars.neck_of(body, way)
    parts = [skin]
    for w in below:
        x, cloth = w.draped.positions, w.pattern.levels[-1].faces
        parts.append((x, cloth))
        if w.pattern.garment.kind == "top":
            collar = collars.collar(x, cloth, np.zeros((len(x), 2)), w.pattern.garment.collar, neck, axes[1], 1.0)
            parts += [collar[:2]] if collar else []
    vertices, faces = stacked(parts)
    pattern = scarves.build_scarf(body, way, garment, Collider(vertices, vertices, faces), detail.refine)
    draped = drape.drape(
        pattern.levels,
        pattern.refine,
        garment.cloth,
        scarves.EFFORTS[: detail.refine + 1],
        lambda frame, fine: (vertices, faces),
        lambda weights, rest, frame: rest,
        frames=0,
        ground=0.006,
    )
    return Worn(pattern, fabric, draped)
