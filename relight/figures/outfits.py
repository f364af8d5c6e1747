"""Who wears what: an outfit drawn for a person, from the skin outward, with fabrics, footwear, hair and make-up."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from relight.figures import fabrics, wardrobe
from relight.figures.body import Person
from relight.figures.fabrics import Color, Fabric, as_color
from relight.figures.footwear import SHOES, Shoe
from relight.figures.garments import Garment
from relight.figures.hair import STYLES, Style
from relight.figures.scarves import SCARVES
from relight.figures.skin import HAIR, IRISES
from relight.figures.stances import Pose


@dataclass(frozen=True)
class Outfit:
    """garments: in the order in which they are draped, each over those before; sole, upper: linear albedo of shoes;
    tie, belt: what they are made of, where they are worn."""

    garments: list[tuple[Garment, Fabric]]
    shoe: Shoe
    upper: Color
    sole: Color
    hair: Style
    hair_color: Color
    hat: Fabric
    beard: float
    makeup: float
    iris: Color
    tie: Fabric | None = None
    belt: Fabric | None = None


NECKS = (  # of what is cut like a t-shirt: radii of the opening, and the depth of a V below it
    ((0.078, 0.075, 0.085), 0.0),
    ((0.074, 0.066, 0.082), 0.0),
    ((0.088, 0.105, 0.100), 0.0),
    ((0.100, 0.072, 0.090), 0.0),
    ((0.080, 0.060, 0.092), 0.075),
    ((0.080, 0.060, 0.092), 0.120),
)
TUCKS = ("shirt", "t-shirt", "fitted t-shirt", "long sleeve", "polo shirt", "roll-neck")  # may be worn inside trousers
ROUND = ("t-shirt", "fitted t-shirt", "long sleeve", "sweater", "dress", "long dress")  # cut like a t-shirt at the neck
TIES = ("plain", "stripes", "print", "check")
WIDEST = 0.036  # metres of ease at the waist at most of a top: wider cloth falls into one deep fold at the back
SLIM = 0.020  # metres of ease at most of the trunk of what is worn under a jacket
SLIM_ARM = 0.016  # of its sleeves
BENT = 0.009  # metres of ease of trousers that sit, unless they stretch
LAP = 0.10  # metres above the crotch: where tops of who sits end
LONGEST = 1.06  # times its usual length: skirts would lie on the floor
BELT = 0.09  # metres above the navel: where robes are belted
ABOVE_SEAM = 0.022  # metres above the seam of a dress: the middle of its belt
LEAST = 0.004  # metres of ease that no piece is cut below


def tailored(rng: np.random.Generator, garment: Garment) -> Garment:
    """A garment as one person owns it: a draw of its fit, lengths, neckline and the places of its folds.

    Args:
        rng: the source of chance.
        garment: of the wardrobe, as its kind is usually cut.

    Returns:
        The garment with other numbers: its ease (metres between body and cloth, where above 4 mm) scaled by .5 to 1.8,
        its sleeves, legs and drop longer or shorter, one of NECKS where its neckline is round.
    """
    wide = float(np.exp(np.clip(rng.normal(-0.05, 0.32), -0.7, 0.6)))
    if garment.kind == "top":
        wide = min(wide, WIDEST / garment.torso[1])
    longer, sleeve, leg = rng.normal(0, [0.025, 0.05, 0.03])

    def eased(ease: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(min(e, LEAST) + wide * max(e - LEAST, 0) for e in ease)

    if garment.name in ROUND:
        neck, vee = NECKS[int(rng.choice(len(NECKS), p=(0.4, 0.15, 0.15, 0.08, 0.14, 0.08)))]
        garment = replace(garment, neck=neck, vee=vee)
    if garment.sleeve > 1.5 and garment.collar not in ("lapel", "stand") and rng.random() < 0.14:
        garment = replace(garment, sleeve=float(rng.uniform(1.3, 1.65)), cuff=max(garment.cuff, 0.5))  # pushed up
    elif 0.3 < garment.sleeve < 0.9:
        garment = replace(garment, sleeve=float(np.clip(garment.sleeve + 2 * sleeve, 0.32, 0.85)))
    if garment.kind == "trousers" and garment.leg > 1.5:
        leg = garment.leg - abs(leg) - (0.25 if rng.random() < 0.12 else 0)  # some end above the ankle
    elif garment.kind == "trousers":
        leg = garment.leg + 3 * leg
    if garment.drop > 0.2:
        longer = garment.drop * (min(float(np.exp(rng.normal(-0.03, 0.12))), LONGEST) - 1)
    return replace(
        garment,
        torso=eased(garment.torso),
        arm=eased(garment.arm),
        legs=eased(garment.legs),
        leg=leg if garment.kind == "trousers" else garment.leg,
        drop=max(garment.drop + longer, 0.0) if garment.drop else 0.0,
        flare=garment.flare * float(np.exp(rng.normal(0, 0.15))),
        turn=float(rng.uniform(0, 2 * np.pi)),
    )


def over(outer: Garment, inner: Garment) -> Garment:
    """An outer garment with at least so much ease that the inner one fits under it.

    Args:
        outer: a jacket, coat, cardigan or vest.
        inner: the top that is worn under it.

    Returns:
        `outer` with ease (metres between body and cloth) of its trunk at least 8 mm more than that of `inner`, and of
        its sleeves 6 mm more, where `inner` has sleeves.
    """
    torso = tuple(max(o, i + 0.008) for o, i in zip(outer.torso, inner.torso))
    arm = outer.arm if inner.armhole else tuple(max(o, i + 0.006) for o, i in zip(outer.arm, inner.arm))
    return replace(outer, torso=torso, arm=arm)


def under(inner: Garment) -> Garment:
    """A top cut close enough to be worn under a jacket."""
    return replace(
        inner,
        torso=tuple(min(ease, SLIM) for ease in inner.torso),
        arm=tuple(min(ease, SLIM_ARM) for ease in inner.arm),
        sleeve_slack=min(inner.sleeve_slack, 0.02),
    )


def tucked(top: Garment, bottom: Garment) -> list[Garment]:
    """A top inside the waistband of a skirt or trousers, and those over it."""
    snug = tuple(ease * share for ease, share in zip(top.torso, (0.5, 0.5, 0.7, 1, 1, 1)))
    inside = replace(top, hem=0.10, drop=0.0, flare=0.0, slack=0.025, torso=snug, tuck=bottom.waist)
    return [inside, replace(bottom, over=0.007)]


def cut_to_sit(garment: Garment) -> Garment:
    """Clothes as they are pulled straight to sit: tops without the length that the lap would push up under the chest,
    trousers with room to bend in, and shorts no wider, as they would gape below the thighs."""
    if garment.kind == "trousers":
        most = 1.4 * BENT if garment.leg < 1.2 else np.inf
        return replace(garment, legs=tuple(min(max(e, BENT), most) if e > 0.003 else e for e in garment.legs))
    if garment.kind != "top" or garment.drop > 0.2:
        return garment
    return replace(garment, slack=0.0, drop=0.0, hem=max(garment.hem, LAP))


def fitted_to_pose(outfit: Outfit, pose: Pose) -> Outfit:
    """The outfit as the pose allows it: long coats come off to sit, scarves where hands are before the chest."""
    crossed = min(pose.left.wrist[0], pose.right.wrist[0]) < -0.1

    def stays(garment: Garment) -> bool:
        long_coat = garment.collar == "lapel" and garment.drop > 0.2
        return not (pose.sitting and long_coat) and not (crossed and garment.kind == "scarf")

    kept = [(g, fabric) for g, fabric in outfit.garments if stays(g)]
    return replace(outfit, garments=[(cut_to_sit(g), fabric) for g, fabric in kept] if pose.sitting else kept)


def pick(rng: np.random.Generator, *names: str) -> Garment:
    """A piece of one of the kinds."""
    library = (*wardrobe.TOPS, *wardrobe.OUTER, *wardrobe.BOTTOMS, *wardrobe.SKIRTS, *wardrobe.DRESSES, *wardrobe.ROBES)
    by_name = {garment.name: garment for garment in library}
    return tailored(rng, by_name[str(rng.choice(names))])


def sample_outfit(rng: np.random.Generator, person: Person, styles: Collection[str] = ()) -> Outfit:
    """Draws an outfit. Skirts and dresses go to women, beards to men; all else is shared.

    Args:
        rng: the source of chance.
        person: who wears it.
        styles: names of the hair styles to draw from, of which the person has at least one; all where it is empty.
    """
    woman = person.female > 0.5
    draw = rng.random()
    worn: list[Garment] = []
    if draw > 0.975:
        worn = [pick(rng, "robe")]
    elif woman and draw < 0.20:
        worn = [pick(rng, "dress", "dress", "sleeveless dress", "long dress", "shift dress")]
    elif woman and draw < 0.40:
        names = ["t-shirt", "fitted t-shirt", "shirt", "long sleeve", "tank top", "short shirt", "roll-neck"]
        skirts = ["a-line skirt", "short skirt", "long skirt", "flared skirt", "pleated skirt", "pencil skirt"]
        worn = tucked(pick(rng, *names), pick(rng, *skirts))
    elif woman and draw < 0.48:
        worn = [pick(rng, "leggings"), pick(rng, "t-shirt", "long sleeve", "sweater", "hoodie", "tank top", "shirt")]
    else:
        names = ["jeans", "jeans", "wide jeans", "slim trousers", "trousers", "trousers", "joggers", "wide trousers"]
        bottom = pick(rng, *names, "shorts")
        names = [
            "t-shirt",
            "t-shirt",
            "long sleeve",
            "shirt",
            "shirt",
            "short shirt",
            "polo shirt",
            "sweater",
            "hoodie",
        ]
        top = pick(rng, *names, "roll-neck", "tank top", *(["fitted t-shirt"] if woman else []))
        inside = top.name in TUCKS and bottom.name != "joggers" and rng.random() < 0.38
        worn = tucked(top, bottom) if inside else [bottom, top]
    thin = worn[0] if len(worn) == 1 else next(g for g in worn if g.kind == "top")
    if thin.name not in ("sweater", "hoodie", "robe") and thin.seam is None and rng.random() < 0.40:
        outer = ["jacket", "jacket", "closed jacket", "blazer", "coat", "closed coat", "cardigan", "vest"]
        waistcoat = ["waistcoat"] if thin.collar == "fold" and thin.tuck is not None else []
        inner = under(thin)
        worn[worn.index(thin)] = inner
        worn.append(over(pick(rng, *outer, *waistcoat), inner))
        odds = {"coat": 0.5, "closed coat": 0.5, "jacket": 0.3, "blazer": 0.25, "cardigan": 0.25}.get(worn[-1].name, 0)
        if rng.random() < odds and not any(g.name in ("shorts", "tank top") for g in worn):
            worn.append(SCARVES[int(rng.integers(len(SCARVES)))])
    pieces = {g.name for g in worn}
    ties = "shirt" in pieces and not woman and not pieces & {"scarf", "wrapped scarf", "shorts"}
    tie = ties and rng.random() < (0.85 if pieces & {"blazer", "waistcoat"} else 0.3)
    waisted = thin.tuck is not None and worn[1].kind == "trousers" and not pieces & {"leggings", "joggers"}
    belt = rng.random() < (0.6 if waisted else 0.35 if thin.seam is not None else 0.4 * (thin.name == "robe"))
    if belt and not waisted:
        worn[0] = replace(thin, belt=BELT if thin.seam is None else thin.seam + ABOVE_SEAM)
    cloths = [(g, fabrics.sample_fabric(rng, g.fabrics, is_muted(g))) for g in worn]
    shoe = SHOES[int(rng.choice(len(SHOES), p=shoe_odds(woman, worn)))]
    upper = shoe_color(rng, shoe)
    pale = "sneaker" in shoe.name and rng.random() < 0.75
    style = STYLES[int(rng.choice(len(STYLES), p=hair_odds(woman, person, styles)))]
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
        tie=fabrics.sample_fabric(rng, TIES, False) if tie else None,
        belt=fabrics.sample_fabric(rng, ("leather",), True) if belt else None,
    )


def in_other_fabrics(outfit: Outfit, rng: np.random.Generator) -> Outfit:
    """The same clothes, cut and worn alike, of other fabrics and in other colours."""

    return replace(
        outfit,
        garments=[(g, fabrics.sample_fabric(rng, g.fabrics, is_muted(g))) for g, _ in outfit.garments],
        upper=shoe_color(rng, outfit.shoe),
        hat=fabrics.sample_fabric(rng, (outfit.hat.kind,), False),
        tie=None if outfit.tie is None else fabrics.sample_fabric(rng, TIES, False),
        belt=None if outfit.belt is None else fabrics.sample_fabric(rng, ("leather",), True),
    )


def is_muted(garment: Garment) -> bool:
    """Whether such clothes are mostly of neutral colours."""
    return garment.kind == "trousers" or garment.name in {g.name for g in wardrobe.OUTER}


def shoe_color(rng: np.random.Generator, shoe: Shoe) -> Color:
    """Draws the colour of a shoe's upper."""
    return fabrics.sample_fabric(rng, ("leather",) if "sneaker" not in shoe.name else ("plain",), True).first


def shoe_odds(woman: bool, worn: list[Garment]) -> np.ndarray:
    """Probability of each of SHOES (S,), by what else is worn."""
    skirted = worn[0].name.endswith("dress") or any(g.kind == "skirt" for g in worn)
    odds = {"sneakers": 3, "high sneakers": 1.5, "oxfords": 1.2, "loafers": 1, "boots": 1.5, "sandals": 0.8}
    if woman:
        odds |= {"ballet flats": 3 if skirted else 1.2, "high boots": 1.5 if skirted else 0.3}
    weights = np.array([odds.get(shoe.name, 0.0) for shoe in SHOES])
    return weights / weights.sum()


def hair_odds(woman: bool, person: Person, styles: Collection[str] = ()) -> np.ndarray:
    """Probability of each of STYLES (S,), of those with one of the names if there are any; all 0 where none fits."""
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
    weights = np.array([odds.get(style.name, 0.0) * (not styles or style.name in styles) for style in STYLES])
    return weights / max(weights.sum(), np.finfo(float).tiny)


def hair_color(rng: np.random.Generator, person: Person) -> Color:
    """Draws a hair colour: grey or white with age, else by skin and ancestry."""
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
    return as_color(np.array(HAIR[name]) * np.exp(rng.normal(0, 0.12)))
