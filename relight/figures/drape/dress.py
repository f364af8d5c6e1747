"""Dresses a body: drapes the garments of an outfit one over the other while it moves into its pose."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from relight.figures.body import makehuman
from relight.figures.body.motion import Motion
from relight.figures.body.shape import Body
from relight.figures.catalogue.schema import entries
from relight.figures.cut import footwear
from relight.figures.cut.patterns import Pattern, build_pattern
from relight.figures.drape import collars, scarves, wrinkles
from relight.figures.drape.colliders import Collider, signed_distance
from relight.figures.drape.simulate import DrapeResult, drape
from relight.figures.drape.solver import SolverSettings
from relight.figures.draw.fabrics import Fabric
from relight.figures.draw.garments import Garment, Worn
from relight.figures.draw.outfits import Outfit
from relight.figures.surfaces import Surface, face_normals, normals, smoothed, stacked, unit_rows

FREE_DROP = 0.2  # length of a drop above which its cloth hangs free, metres
CLEFT_WIDTH = 0.04  # largest distance of the cleft between the buttocks from the middle, metres
CLEFT_HEIGHTS = (-0.15, 0.16)  # its ends above the crotch, metres
BROAD = 100  # averagings of normals with their neighbours', which span several gathers
MIN_FOLD_DISTANCE = 0.6  # smallest distance of wrinkles from the layer below, over the cloth's thickness


@dataclass(frozen=True)
class Detail:
    """How fine a figure is.

    Attributes:
        refine: subdivisions of the garments.
        frames: number of frames of the motion into the pose.
        solver, scarf: settings for each level of a garment or a scarf, from coarse to fine.
        body: subdivisions of the skin.
        texture: side of the largest texture in pixels.
    """

    refine: int
    frames: int
    solver: list[SolverSettings]
    scarf: list[SolverSettings]
    body: int
    texture: int = 1024


def details() -> dict[str, Detail]:
    """Returns how fine figures are, by the name of the setting: draft and full."""
    return entries("details", "details", Detail)


@dataclass(frozen=True)
class DrapedGarment:
    """A garment of a figure: its pattern, its fabric, and the result of its simulation."""

    pattern: Pattern
    fabric: Fabric
    draped: DrapeResult

    @property
    def surface(self) -> Surface:
        """Returns its vertices as it hangs, and its faces."""
        return self.draped.positions, self.pattern.levels[-1].faces


class Obstacles:
    """The posed surfaces on which garments are draped: skin, shoes, and the garments below.

    Hands and, for what hangs from the waist, arms are no obstacles: fingers would catch the cloth.

    Attributes:
        body: in its rest pose.
        under_tops, under_bottoms, under_scarves: (F,3) the faces of the skin that are obstacles of such garments.
        skin: (V,3) its vertices at each frame, metres.
        shoes: for each frame the vertices and faces of the uppers; none of sandals.
    """

    def __init__(self, motion: Motion, outfit: Outfit, frames: int):
        """Poses skin and shoes at `frames` + 1 frames of a motion."""
        weights, faces = makehuman.rig().weights[makehuman.BODY], makehuman.base().faces["body"]
        head = makehuman.bone_weights(
            "head", "jaw", "eye", "levator", "oris", "special", "temporalis", "risorius", "oculi", "tongue",
            "orbicularis",
        )  # fmt: skip
        hands = makehuman.bone_weights("finger", "metacarpal")
        head_and_hands = hands + head
        head_and_arms = head_and_hands + makehuman.bone_weights("wrist", "lowerarm", "upperarm")
        trunk_and_arms = faces[(head_and_hands[faces] < 0.3).all(1)]
        self.body = motion.body
        self.under_tops = trunk_and_arms[~_cleft(motion.body, motion.body.skin, trunk_and_arms)]
        self.under_bottoms = faces[(head_and_arms[faces] < 0.3).all(1)]
        self.under_scarves = faces[hands[faces].max(1) < 0.3]
        self.skin = [motion.skin(weights, motion.body.skin, frame) for frame in range(frames + 1)]
        uppers = [] if outfit.shoe.straps else [footwear.upper(motion.body, outfit.shoe, side) for side in "LR"]
        self.shoes = [
            [(motion.skin(upper.weights, upper.shape, frame), upper.faces) for upper in uppers]
            for frame in range(frames + 1)
        ]

    def below(self, garment: Garment, inner: list[DrapedGarment], frame: int, fine: bool) -> Surface:
        """Returns the surface below a garment.

        Args:
            garment: to be draped; no scarf.
            inner: the garments already draped.
            frame: index of the motion's frame.
            fine: whether their finest levels are meant, as they hang at the last frame, or their coarsest, at `frame`.
        """
        is_top = garment.kind == "top"
        parts = [(self.skin[frame], self.under_tops if is_top else self.under_bottoms)]
        parts += [] if is_top else self.shoes[frame]
        for other in inner:
            level = other.pattern.levels[-1 if fine else 0]
            faces = level.faces
            if is_top:
                catching = _cleft(self.body, level.fitted, faces)
                if fine and (other.pattern.garment.gather or other.pattern.garment.pleat):
                    catching |= _fallen_over(other.draped.positions, faces)
                faces = faces[~catching]
            parts.append((other.draped.positions if fine else other.draped.history[frame], faces))
        return stacked(parts)


def drape_outfit(motion: Motion, outfit: Outfit, detail: Detail) -> list[DrapedGarment]:
    """Drapes the garments of an outfit one over the other.

    Args:
        motion: of the body, from the rest pose to the figure's pose.
        outfit: its garments are in order from the skin outward.
        detail: how fine the cloth is, and how long it is simulated.

    Returns:
        The draped garments, in the same order.
    """
    obstacles, worn = Obstacles(motion, outfit, detail.frames), list[DrapedGarment]()
    for item in outfit.garments:
        garment = item.garment
        if garment.kind == "scarf":
            worn.append(drape_scarf(motion, item, (obstacles.skin[-1], obstacles.under_scarves), worn, detail))
            continue
        pattern = build_pattern(motion.body, garment, detail.refine)
        surface_at = partial(obstacles.below, garment, list(worn))
        draped = drape(pattern, detail.solver, surface_at, motion.skin, detail.frames)
        below = Collider.at_rest(*surface_at(detail.frames, fine=True))
        worn.append(DrapedGarment(pattern, item.fabric, finished(pattern, draped, item.fabric, below, motion)))
    return worn


def _cleft(body: Body, rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns which faces (F,) line the cleft between buttocks and thighs, where cloth must not be caught.

    `rest` (n,3) are the vertices on the rest pose, metres.
    """
    centre, normal = rest[faces].mean(1), face_normals(rest, faces)
    sideways = np.abs(normal[:, 0]) > 0.6 * np.linalg.norm(normal, axis=1)
    height = centre[:, 1] - body.heights["crotch"]
    return sideways & (np.abs(centre[:, 0]) < CLEFT_WIDTH) & (height > CLEFT_HEIGHTS[0]) & (height < CLEFT_HEIGHTS[1])


def _fallen_over(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns which faces (F,) of cloth, vertices (n,3), face against the cloth around them: gathers that fell over.

    They would push cloth that hangs over them inward, and catch it.
    """
    around = smoothed(normals(x, faces), faces, BROAD)[faces].sum(1)
    return np.einsum("fx,fx->f", face_normals(x, faces), around) < 0


def finished(pattern: Pattern, draped: DrapeResult, fabric: Fabric, below: Collider, motion: Motion) -> DrapeResult:
    """Adds fine wrinkles to a draped garment and an even neckline to a top, and moves it out of the layers below.

    Args:
        pattern: pattern of the garment.
        draped: the result of its simulation.
        fabric: its seed places the wrinkles.
        below: the layers below.
        motion: how the body moves from its rest pose into the pose.

    Returns:
        The result with other positions of its vertices.
    """
    garment, level = pattern.garment, pattern.levels[-1]
    crimp = wrinkles.varied(garment.cloth.crimp, fabric.seed)
    hang = np.clip(4 * pattern.fields["drop"], 0, 1) * (garment.drop > FREE_DROP)
    height = wrinkles.folds(pattern.levels, pattern.refine, draped.positions, crimp, hang, fabric.seed)
    facing = unit_rows(smoothed(normals(draped.positions, level.faces), level.faces, times=3))
    x = draped.positions + height[:, None] * facing
    if garment.kind == "top":
        without_folds = motion.skin(level.weights, level.fitted)
        x = collars.banded(x, level.faces, without_folds, collars.neck_of(motion))
    face, distance, outward = signed_distance(x, below, 2 * garment.cloth.thickness)
    depth = np.clip(MIN_FOLD_DISTANCE * garment.cloth.thickness - distance, 0, garment.cloth.thickness)
    x = x + np.where((face >= 0) & (level.pin_weight < 0.5), depth, 0)[:, None] * outward
    return replace(draped, positions=x)


def drape_scarf(
    motion: Motion, scarf: Worn, skin: Surface, inner: list[DrapedGarment], detail: Detail
) -> DrapedGarment:
    """Drapes a scarf around the neck of the posed figure; it does not take part in the motion.

    Args:
        motion: how the body moves from its rest pose into the pose.
        scarf: to be draped.
        skin: vertices and faces, posed.
        inner: the garments already draped.
        detail: how fine the figure is.
    """
    neck = collars.neck_of(motion)
    parts = [skin]
    for other in inner:
        parts.append(other.surface)
        if other.pattern.garment.kind == "top":
            x, cloth = other.surface
            no_uv, kind = np.zeros((len(x), 2)), other.pattern.garment.collar
            if (collar := collars.collar(x, cloth, no_uv, kind, neck, uv_per_metre=1.0)) is not None:
                parts.append(collar[:2])
    below = stacked(parts)
    pattern = scarves.build_scarf(motion, scarf.garment, Collider.at_rest(*below), detail.refine)
    draped = drape(pattern, detail.scarf, lambda frame, fine: below, lambda weights, rest, frame: rest, frames=0)
    return DrapedGarment(pattern, scarf.fabric, draped)
