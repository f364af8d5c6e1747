"""Garments: cuts of a smooth suit around the body, their ease, lengths and cloth. The wardrobe has them all."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from relight.core.errors import UserError
from relight.figures.catalogue.schema import entries
from relight.figures.draw.fabrics import Fabric, Kind

LAYER = 0.005  # metres of room that hands need for each garment
GROUPS = ("tops", "outer", "bottoms", "skirts", "dresses", "robes")  # of the catalogue
# where ease is given
TORSO_AT = (0.0, 0.3, 0.55, 0.8, 0.95, 1.1)  # 0 the crotch, 1 the base of the neck
ARM_AT = (0.0, 0.3, 0.6, 1.0, 1.4, 1.8, 2.0)  # 0 the shoulder, 1 the elbow, 2 the wrist
LEG_AT = (-0.6, -0.3, 0.0, 0.3, 0.7, 1.0, 1.5, 2.0)  # 0 the hip, 1 the knee, 2 the ankle


@dataclass(frozen=True)
class Crimp:
    """The wrinkles of a cloth that are finer than the simulation.

    Attributes:
        width: metres from crest to crest of the finest folds.
        slack: length that these folds take up, relative to that of the pattern.
        density: crests relative to the room there is.
        length: metres of a typical crest.
    """

    width: float = 0.026
    slack: float = 0.06
    density: float = 2.0
    length: float = 0.07


@dataclass(frozen=True)
class Cloth:
    """Mechanical properties of a fabric.

    Attributes:
        bend: bending stiffness at edges of 25 mm, from 0 (silk) to 0.6 (leather).
        extra_length: rest lengths over those of the pattern, minus 1; negative for elastic cloth.
        thickness: metres to the layer below.
        friction: in [0,1].
        crimp: its fine wrinkles.
    """

    bend: float = 0.15
    extra_length: float = 0.02
    thickness: float = 0.004
    friction: float = 0.25
    crimp: Crimp = Crimp()


@dataclass(frozen=True)
class Garment:
    """A garment, independent of the body that wears it. Lengths are in metres.

    Attributes:
        name: as in the record of a figure.
        kind: how it is cut; dresses are tops.
        sleeve_end: where sleeves end: 0 shoulder, 1 elbow, 2 wrist.
        leg_end: where trousers end: 0 hip, 1 knee, 2 ankle.
        hem: height of the cut above the crotch.
        armhole: radius of the opening of a garment without sleeves, else 0.
        seam: height above the navel at which a drop is sewn on, or None.
        drop: length added below the hem, or below the hips if there is a seam.
        flare: extra width at the end of the drop, relative.
        gather: depth of the drop's folds at its upper end, relative to its radius.
        pleat: likewise, at its lower end.
        fold_count: number of the drop's folds.
        fold_phase: radians by which they are rotated about the body.
        waist: height of a waistband above the navel.
        neck: radii of the neck opening: sideways, up, forward.
        v_depth: depth of a V below the neck opening.
        front_gap: half the gap of a garment that is open in front, else 0.
        torso_ease: distance between body and cloth at TORSO_AT.
        arm_ease: likewise, at ARM_AT.
        leg_ease: likewise, at LEG_AT.
        slack: extra length of the trunk, which makes folds.
        sleeve_slack: likewise, of the sleeves.
        leg_slack: likewise, of the legs.
        cuff_pin: how firmly the ends of sleeves and legs are pinned to the body, in [0,1].
        hem_pin: likewise, for the hem, as by ribbing.
        neck_pin: likewise, for the neckline.
        thickness: thickness of the visible edge.
        tuck_height: height above the navel of the waistband inside which a top is worn, or None.
        belt_height: height above the navel of a belt that gathers the cloth, or None.
        waistband_offset: how far outside other clothes a waistband is pinned.
        collar: its kind.
        front: fastening of a closed front; a placket ends below the neck, double means two rows of buttons.
        cloth: mechanical properties.
        fabrics: kinds of fabric, drawn with equal probabilities.
    """

    name: str
    kind: Literal["top", "trousers", "skirt", "scarf"]
    sleeve_end: float = 0.6
    leg_end: float = 1.95
    hem: float = 0.06
    armhole: float = 0.0
    seam: float | None = None
    drop: float = 0.0
    flare: float = 0.0
    gather: float = 0.0
    pleat: float = 0.0
    fold_count: int = 12
    fold_phase: float = 1.0
    waist: float = 0.0
    neck: tuple[float, float, float] = (0.078, 0.075, 0.085)
    v_depth: float = 0.0
    front_gap: float = 0.0
    torso_ease: tuple[float, ...] = (0.016, 0.034, 0.028, 0.014, 0.008, 0.006)
    arm_ease: tuple[float, ...] = (0.010, 0.016, 0.022, 0.024, 0.03, 0.03, 0.03)
    leg_ease: tuple[float, ...] = (0.004, 0.006, 0.010, 0.018, 0.022, 0.024, 0.024, 0.018)
    slack: float = 0.0
    sleeve_slack: float = 0.0
    leg_slack: float = 0.0
    cuff_pin: float = 0.0
    hem_pin: float = 0.0
    neck_pin: float = 0.0
    thickness: float = 0.003
    tuck_height: float | None = None
    belt_height: float | None = None
    waistband_offset: float = 0.0
    collar: Literal["none", "fold", "stand", "roll", "hood", "lapel"] = "none"
    front: Literal["none", "placket", "buttons", "zip", "double"] = "none"
    cloth: Cloth = field(default_factory=Cloth)
    fabrics: tuple[Kind, ...] = ("plain", "stripes", "print", "melange")

    def __post_init__(self) -> None:
        for name, places in (("torso_ease", TORSO_AT), ("arm_ease", ARM_AT), ("leg_ease", LEG_AT)):
            if len(getattr(self, name)) != len(places):
                raise ValueError(f"{name} must have {len(places)} numbers, not {len(getattr(self, name))}")


@dataclass(frozen=True)
class Worn:
    """A garment in a fabric."""

    garment: Garment
    fabric: Fabric


def group(name: str) -> Mapping[str, Garment]:
    """Returns the garments of a group of the catalogue by name: one of GROUPS, or scarves."""
    return entries("garments", name, Garment)


def wardrobe() -> Mapping[str, Garment]:
    """Returns all garments that are cut for a body, by name; scarves are not."""
    return {name: garment for section in GROUPS for name, garment in group(section).items()}


def necks() -> Mapping[str, tuple[tuple[float, float, float], float, float]]:
    """Returns the openings of tops cut like a t-shirt: their radii, the depth of a V, and how often each is drawn."""
    return entries("garments", "necks", tuple[tuple[float, float, float], float, float])


def drawn_from(draw: str) -> tuple[str, ...]:
    """Returns the names of the garments that a draw of the catalogue lists.

    Raises:
        UserError: if it is missing, or lists a garment that does not exist.
    """
    names = entries("garments", "draws", tuple[str, ...]).get(draw, ())
    unknown = [name for name in names if name not in wardrobe()]
    if unknown or not names:
        what = f"there is no garment {unknown[0]}" if unknown else "it must list garments"
        raise UserError(f"garments.yaml: draws: {draw}: {what}")
    return names


def room_for_hands(garments: list[Garment], sitting: bool) -> tuple[float, float]:
    """Returns how much room the clothes take up.

    Args:
        garments: all that is worn.
        sitting: whether the figure sits; its tops do not reach the lap.

    Returns:
        Metres at the hips and thighs, and metres at the chest.
    """
    cut = [g for g in garments if g.kind != "scarf"]
    tops = [g for g in cut if g.kind == "top"]
    at_hips = [max(g.leg_ease[2:5]) for g in cut if g.kind == "trousers"]
    at_hips += [0.02 + 0.03 * g.flare for g in cut if g.drop > 0.2]
    if not sitting:
        at_hips += [max(g.torso_ease[:2]) for g in tops]
    at_chest = [g.torso_ease[3] for g in tops]
    return max(at_hips, default=0.01) + LAYER * len(cut), max(at_chest, default=0.0) + LAYER * len(tops)
