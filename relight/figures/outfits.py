"""Who wears what: an outfit drawn for a person, from the skin outward, with fabrics, footwear, hair and make-up."""

from dataclasses import dataclass, replace

import numpy as np

from relight.figures import fabrics, wardrobe
from relight.figures.body import Person
from relight.figures.fabrics import Fabric
from relight.figures.footwear import SHOES, Shoe
from relight.figures.garments import Garment
from relight.figures.hair import STYLES, Style
from relight.figures.scarves import SCARVES
from relight.figures.skin import HAIR, IRISES
from relight.figures.stances import Pose


@dataclass(frozen=True)
class Outfit:
    """garments: in the order in which they are draped, each over those before; sole, upper: linear albedo of shoes."""

    garments: list[tuple[Garment, Fabric]]
    shoe: Shoe
    upper: tuple[float, float, float]
    sole: tuple[float, float, float]
    hair: Style
    hair_color: tuple[float, float, float]
    hat: Fabric
    beard: float
    makeup: float
    iris: tuple[float, float, float]


def tucked(top: Garment, bottom: Garment) -> list[Garment]:
    """A top inside the waistband of a skirt or trousers, and those over it."""
    snug = tuple(ease * share for ease, share in zip(top.torso, (0.5, 0.5, 0.7, 1, 1, 1)))
    inside = replace(top, hem=0.10, drop=0.0, flare=0.0, slack=0.025, torso=snug, tuck=bottom.waist)
    return [inside, replace(bottom, over=0.007)]


def suited(outfit: Outfit, pose: Pose) -> Outfit:
    """The outfit as the pose allows it: long coats come off to sit, scarves where hands are before the chest."""
    crossed = min(pose.left.wrist[0], pose.right.wrist[0]) < -0.1
    off = [
        g for g, _ in outfit.garments if (pose.sitting and g.open and g.drop > 0.2) or (crossed and g.kind == "scarf")
    ]
    return replace(outfit, garments=[(g, fabric) for g, fabric in outfit.garments if g not in off])


def pick(rng: np.random.Generator, *names: str) -> Garment:
    library = (*wardrobe.TOPS, *wardrobe.OUTER, *wardrobe.BOTTOMS, *wardrobe.SKIRTS, *wardrobe.DRESSES)
    by_name = {garment.name: garment for garment in library}
    return by_name[str(rng.choice(names))]


def sample_outfit(rng: np.random.Generator, person: Person) -> Outfit:
    """Draws an outfit. Skirts and dresses go to women, beards to men; all else is shared."""
    woman = person.female > 0.5
    draw = rng.random()
    worn: list[Garment] = []
    if woman and draw < 0.22:
        worn = [pick(rng, "dress", "long dress", "shift dress")]
    elif woman and draw < 0.42:
        top = pick(rng, "t-shirt", "fitted t-shirt", "shirt", "long sleeve", "tank top", "short shirt")
        worn = tucked(top, pick(rng, "a-line skirt", "short skirt", "long skirt"))
    else:
        bottom = pick(rng, "jeans", "jeans", "slim trousers", "trousers", "trousers", "wide trousers", "shorts")
        names = ["t-shirt", "t-shirt", "long sleeve", "shirt", "shirt", "short shirt", "sweater", "hoodie"]
        top = pick(rng, *names, *(["fitted t-shirt", "tank top"] if woman else ["tank top"]))
        inside = top.name in ("shirt", "t-shirt", "fitted t-shirt", "long sleeve") and rng.random() < 0.35
        worn = tucked(top, bottom) if inside else [bottom, top]
    thin = worn[0] if len(worn) == 1 else next(g for g in worn if g.kind == "top")
    if thin.name not in ("sweater", "hoodie", "long dress") and rng.random() < 0.36:
        worn.append(pick(rng, "jacket", "jacket", "blazer", "coat", "cardigan"))
        odds = {"coat": 0.5, "jacket": 0.3, "blazer": 0.25, "cardigan": 0.25}[worn[-1].name]
        if rng.random() < odds and not any(g.name in ("shorts", "tank top") for g in worn):
            worn.append(SCARVES[int(rng.integers(len(SCARVES)))])
    cloths = [(g, fabrics.sample_fabric(rng, g.fabrics, g.kind == "trousers" or g in wardrobe.OUTER)) for g in worn]
    shoe = SHOES[int(rng.choice(len(SHOES), p=shoe_odds(woman, worn)))]
    upper = fabrics.sample_fabric(rng, ("leather",) if "sneaker" not in shoe.name else ("plain",), True).first
    pale = "sneaker" in shoe.name and rng.random() < 0.75
    style = STYLES[int(rng.choice(len(STYLES), p=hair_odds(woman, person)))]
    return Outfit(
        garments=cloths,
        shoe=shoe,
        upper=upper,
        sole=(0.68, 0.66, 0.62) if pale else (0.03, 0.025, 0.022),
        hair=style,
        hair_color=hair_color(rng, person),
        hat=fabrics.sample_fabric(rng, ("knit",) if style.hat == "beanie" else ("plain", "denim"), False),
        beard=0.0 if woman or rng.random() < 0.5 else float(rng.uniform(0.15, 0.9)),
        makeup=float(rng.uniform(0.1, 0.9)) if woman else 0.0,
        iris=IRISES[
            int(
                rng.choice(
                    len(IRISES), p=(0.1, 0.3, 0.25, 0.15, 0.2) if person.skin > 0.75 else (0.6, 0.34, 0.02, 0.02, 0.02)
                )
            )
        ],
    )


def shoe_odds(woman: bool, worn: list[Garment]) -> np.ndarray:
    skirted = worn[0].name.endswith("dress") or any(g.kind == "skirt" for g in worn)
    odds = {"sneakers": 3, "high sneakers": 1.5, "oxfords": 1.2, "loafers": 1, "boots": 1.5, "sandals": 0.8}
    if woman:
        odds |= {"ballet flats": 3 if skirted else 1.2, "high boots": 1.5 if skirted else 0.3}
    weights = np.array([odds.get(shoe.name, 0.0) for shoe in SHOES])
    return weights / weights.sum()


def hair_odds(woman: bool, person: Person) -> np.ndarray:
    men = {
        "bald": 1 + max(0, person.age - 35) / 20,
        "shaved": 1.6,
        "crop": 3,
        "side part": 2,
        "quiff": 1.5,
        "curly": 1,
        "beanie": 0.7,
        "cap": 0.8,
    }
    women = {
        "bob": 2,
        "chin length": 1.6,
        "long": 2,
        "wavy long": 2,
        "bun": 1.6,
        "ponytail": 1.6,
        "curly": 1,
        "crop": 0.6,
        "beanie": 0.4,
        "cap": 0.3,
    }
    odds = women if woman else men
    if person.ancestry[0] > 0.5:
        odds |= {"afro": 2, "curly": 2, "long": 0.5, "wavy long": 0.7, "quiff": 0.2, "side part": 0.2}
    weights = np.array([odds.get(style.name, 0.0) for style in STYLES])
    return weights / weights.sum()


def hair_color(rng: np.random.Generator, person: Person) -> tuple[float, float, float]:
    if rng.random() < np.clip((person.age - 42) / 35, 0, 0.9):
        name = "white" if rng.random() < (person.age - 50) / 40 else "grey"
    elif person.skin > 0.72 and person.ancestry[2] > 0.4:
        name = str(
            rng.choice(
                ["dark brown", "brown", "auburn", "blond", "fair", "red", "black"],
                p=[0.25, 0.28, 0.08, 0.2, 0.08, 0.04, 0.07],
            )
        )
    else:
        name = str(rng.choice(["black", "dark brown", "brown"], p=[0.6, 0.32, 0.08]))
    return tuple(float(c) for c in np.array(HAIR[name]) * np.exp(rng.normal(0, 0.12)))
