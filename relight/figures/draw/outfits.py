"""Draws a person's outfit: garments, fabrics, footwear, hair and make-up."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from relight.figures.draw import fabrics
from relight.figures.draw.fabrics import Fabric, Kind
from relight.figures.draw.fitting import cut_to_sit, over, tailored, tucked, under
from relight.figures.draw.garments import Garment, Worn, drawn_from, group, wardrobe
from relight.figures.draw.hairstyles import HairStyle, sample_color, style_odds, styles
from relight.figures.draw.person import Person, sample_iris
from relight.figures.draw.poses import Pose
from relight.figures.draw.shoes import Shoe, shoes
from relight.figures.texture import Color

TUCKS = ("shirt", "t-shirt", "fitted t-shirt", "long sleeve", "polo shirt", "roll-neck")  # may be worn inside trousers
TIES: tuple[Kind, ...] = ("plain", "stripes", "print", "check")  # fabrics of ties
# Outer garment -> share of those who wear it with a scarf.
SCARF_SHARES = {"coat": 0.5, "closed coat": 0.5, "jacket": 0.3, "blazer": 0.25, "cardigan": 0.25}
PALE_SOLE, DARK_SOLE = (0.68, 0.66, 0.62), (0.03, 0.025, 0.022)  # linear albedo
BELT = 0.09  # metres above the navel: the belt of a robe
ABOVE_SEAM = 0.022  # metres above the seam of a dress: the middle of its belt
CROSSED = -0.1  # arm lengths inward from the shoulder, beyond which a wrist ahead of it is in front of the chest


@dataclass(frozen=True)
class Outfit:
    """The clothes, hair and make-up of a figure. Colors are linear albedo.

    Attributes:
        garments: from the skin outward.
        shoe: its shape.
        upper, sole: colors of the shoes.
        hair: its style.
        hair_color: also of beard and brows.
        hat: fabric of the hat that some hair styles include.
        beard: amount in [0,1].
        makeup: amount in [0,1].
        iris: color.
        tie, belt: their fabrics, or None.
    """

    garments: list[Worn]
    shoe: Shoe
    upper: Color
    sole: Color
    hair: HairStyle
    hair_color: Color
    hat: Fabric
    beard: float
    makeup: float
    iris: Color
    tie: Fabric | None = None
    belt: Fabric | None = None


def fitted_to_pose(outfit: Outfit, pose: Pose) -> Outfit:
    """Adapts an outfit to a pose: removes long coats to sit, and scarves where hands are in front of the chest."""
    crossed = any(outward < CROSSED and ahead > 0 for outward, _, ahead in (pose.left.wrist, pose.right.wrist))

    def stays(garment: Garment) -> bool:
        long_coat = garment.collar == "lapel" and garment.drop > 0.2
        return not (pose.sitting and long_coat) and not (crossed and garment.kind == "scarf")

    kept = [worn for worn in outfit.garments if stays(worn.garment)]
    if pose.sitting:
        kept = [Worn(cut_to_sit(worn.garment), worn.fabric) for worn in kept]
    return replace(outfit, garments=kept)


def pick(rng: np.random.Generator, *draws: str) -> Garment:
    """Draws one of the garments that these draws of the catalogue list, such as "trousers", and its fit."""
    names = [name for draw in draws for name in drawn_from(draw)]
    return tailored(rng, wardrobe()[str(rng.choice(names))])


def _sample_base_garments(rng: np.random.Generator, woman: bool) -> list[Garment]:
    """Draws the garments below jackets and scarves, from the skin outward.

    2.5 % of people wear a robe; of women 20 % a dress, 20 % a skirt and 8 % leggings; the others trousers and a top,
    which 38 % of those who can tuck in.
    """
    draw = rng.random()
    if draw > 0.975:
        return [pick(rng, "robes")]
    if woman and draw < 0.20:
        return [pick(rng, "dresses")]
    if woman and draw < 0.40:
        return tucked(pick(rng, "tops in skirts"), pick(rng, "skirts"))
    if woman and draw < 0.48:
        return [pick(rng, "leggings"), pick(rng, "tops over leggings")]
    trousers = pick(rng, "trousers")
    top = pick(rng, "tops", *(["further tops of women"] if woman else []))
    is_tucked = top.name in TUCKS and trousers.name != "joggers" and rng.random() < 0.38
    return tucked(top, trousers) if is_tucked else [trousers, top]


def _innermost_top(worn: list[Garment]) -> Garment:
    """Returns the first top of the garments, or the only garment."""
    return worn[0] if len(worn) == 1 else next(g for g in worn if g.kind == "top")


def _add_outer_layers(rng: np.random.Generator, worn: list[Garment]) -> list[Garment]:
    """Adds a jacket or coat in 40 % of cases, for whose sake the top below is cut closer, and at times a scarf.

    Garments are listed from the skin outward. Nothing is worn over sweaters, hoodies, robes and dresses with a seam.
    """
    worn, top = list(worn), _innermost_top(worn)
    is_dress = top.seam is not None  # of tops, only dresses have one
    if top.name in ("sweater", "hoodie", "robe") or is_dress or rng.random() >= 0.40:
        return worn
    draws = ["outer"]
    if top.collar == "fold" and top.tuck_height is not None:
        draws.append("outer over tucked shirts")
    inner = under(top)
    worn[worn.index(top)] = inner
    outer = over(pick(rng, *draws), inner)
    worn.append(outer)
    if rng.random() < SCARF_SHARES.get(outer.name, 0) and not any(g.name in ("shorts", "tank top") for g in worn):
        scarves = list(group("scarves").values())
        worn.append(scarves[int(rng.integers(len(scarves)))])
    return worn


def sample_outfit(rng: np.random.Generator, person: Person, hair: Collection[str] = ()) -> Outfit:
    """Draws an outfit. Only women wear skirts and dresses, only men have beards.

    Args:
        rng: random generator.
        person: who wears it.
        hair: names of the styles to draw from, at least one of which suits the person; empty for all.
    """
    woman = person.female > 0.5
    worn = _add_outer_layers(rng, _sample_base_garments(rng, woman))
    names = {g.name for g in worn}
    top = _innermost_top(worn)
    can_wear_tie = "shirt" in names and not woman and not names & {"scarf", "wrapped scarf", "shorts"}
    has_tie = can_wear_tie and rng.random() < (0.85 if names & {"blazer", "waistcoat"} else 0.3)
    # The loops of trousers show where a top is tucked in; dresses and robes are belted without loops.
    has_loops = top.tuck_height is not None and worn[1].kind == "trousers" and not names & {"leggings", "joggers"}
    is_dress = top.seam is not None
    has_belt = rng.random() < (0.6 if has_loops else 0.35 if is_dress else 0.4 * (top.name == "robe"))
    if has_belt and not has_loops:
        worn[0] = replace(top, belt_height=BELT if top.seam is None else top.seam + ABOVE_SEAM)
    garments = [_in_fabric(rng, garment) for garment in worn]
    shoe = shoes()[int(rng.choice(len(shoes()), p=shoe_odds(woman, worn)))]
    upper = _shoe_color(rng, shoe)
    has_pale_sole = "sneaker" in shoe.name and rng.random() < 0.75
    style = list(styles().values())[int(rng.choice(len(styles()), p=style_odds(woman, person, hair)))]
    return Outfit(
        garments=garments,
        shoe=shoe,
        upper=upper,
        sole=PALE_SOLE if has_pale_sole else DARK_SOLE,
        hair=style,
        hair_color=sample_color(rng, person),
        hat=fabrics.sample_fabric(rng, ("knit",) if style.hat == "beanie" else ("plain", "denim"), muted=False),
        beard=0.0 if woman or rng.random() < 0.5 else float(rng.uniform(0.15, 0.9)),
        makeup=float(rng.uniform(0.1, 0.9)) if woman else 0.0,
        iris=sample_iris(rng, person),
        tie=fabrics.sample_fabric(rng, TIES, muted=False) if has_tie else None,
        belt=fabrics.sample_fabric(rng, ("leather",), muted=True) if has_belt else None,
    )


def in_other_fabrics(outfit: Outfit, rng: np.random.Generator) -> Outfit:
    """Returns the same clothes in other fabrics and colors."""
    return replace(
        outfit,
        garments=[_in_fabric(rng, worn.garment) for worn in outfit.garments],
        upper=_shoe_color(rng, outfit.shoe),
        hat=fabrics.sample_fabric(rng, (outfit.hat.kind,), muted=False),
        tie=None if outfit.tie is None else fabrics.sample_fabric(rng, TIES, muted=False),
        belt=None if outfit.belt is None else fabrics.sample_fabric(rng, ("leather",), muted=True),
    )


def _in_fabric(rng: np.random.Generator, garment: Garment) -> Worn:
    """Draws the fabric of a garment; trousers and outer garments are mostly of neutral colors."""
    muted = garment.kind == "trousers" or garment.name in group("outer")
    return Worn(garment, fabrics.sample_fabric(rng, garment.fabrics, muted))


def _shoe_color(rng: np.random.Generator, shoe: Shoe) -> Color:
    """Draws the color of a shoe's upper."""
    kind: Kind = "plain" if "sneaker" in shoe.name else "leather"
    return fabrics.sample_fabric(rng, (kind,), muted=True).first


def shoe_odds(woman: bool, worn: list[Garment]) -> np.ndarray:
    """Returns the probability of each of `shoes` (S,) with these garments."""
    has_skirt = worn[0].name.endswith("dress") or any(g.kind == "skirt" for g in worn)
    weights = []
    for shoe in shoes():
        weight = shoe.women if woman else shoe.men
        weights.append(shoe.with_skirt if woman and has_skirt and shoe.with_skirt is not None else weight)
    return np.array(weights) / np.sum(weights)
