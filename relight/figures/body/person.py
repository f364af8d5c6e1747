"""People: sampled traits, and bodies built from them with MakeHuman's targets, in the rest pose (arms half down)."""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np

from relight.figures.body import makehuman
from relight.figures.catalogue.schema import entries

AGES = ("child", "young", "old")  # the ends and the middle of MakeHuman's age slider
AGE_ANCHORS = (12, 25, 90)  # years of these
ANCESTRIES = ("african", "asian", "caucasian")
MEAN_SKIN = (0.16, 0.66, 0.8)  # lightness of the skin of each, in [0,1]
WHOLE_FACE = ("browInnerUp", "mouthRollLower", "mouthShrugLower")  # units without sides
HEADS = ("oval", "round", "square", "rectangular", "diamond", "triangular", "invertedtriangular")


@dataclass(frozen=True)
class Person:
    """Traits of one subject, in [0,1] unless said otherwise.

    Attributes:
        female, muscle, weight, height, proportions, bust: as MakeHuman's sliders.
        age: years, 20 to 85.
        ancestry: three shares that sum to 1, see ANCESTRIES.
        skin: lightness.
        face: weights of face targets by name.
    """

    female: float
    age: float
    muscle: float
    weight: float
    height: float
    proportions: float
    bust: float
    ancestry: tuple[float, float, float]
    skin: float
    face: dict[str, float]


@dataclass(frozen=True)
class Shape:
    """A shape of face or trunk: two opposite targets of MakeHuman, and the standard deviation of their weight."""

    negative: str
    positive: str
    spread: float


@dataclass(frozen=True)
class Expression:
    """A facial expression with the mouth closed. `units` are weights of face units by name."""

    name: str = "calm"
    units: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Body:
    """A person's body in the rest pose: vertices (19158,3) of the base mesh, metres; joints (3,) by bone."""

    person: Person
    vertices: np.ndarray
    joints: dict[str, np.ndarray]

    @property
    def tights(self) -> np.ndarray:
        """Returns the vertices (n,3) of MakeHuman's suit, from which clothes are cut."""
        return self.vertices[makehuman.TIGHTS]

    @property
    def skin(self) -> np.ndarray:
        """Returns the vertices (n,3) of the skin."""
        return self.vertices[makehuman.BODY]

    @cached_property
    def heights(self) -> dict[str, float]:
        """The heights of crotch, hip, waist and neck, metres."""
        joints = self.joints
        middle = (np.abs(self.tights[:, 0]) < 0.01) & (self.tights[:, 1] < joints["root"][1] + 0.1)
        return {
            "crotch": float(self.tights[middle, 1].min()),
            "hip": float(joints["upperleg01.L"][1]),
            "waist": float(joints["spine04"][1]),
            "neck": float(joints["neck01"][1]),
        }


def sample_person(rng: np.random.Generator) -> Person:
    """Draws a person: adults of both sexes, builds from slight to heavy, skin loosely correlated with ancestry.

    The spreads are set by eye, but for those of the face, which are in the catalogue.
    """
    female = float(np.clip(rng.choice([0.05, 0.95]) + rng.normal(0, 0.06), 0, 1))
    age = float(np.clip(20 + rng.gamma(2.0, 12.0), 20, 85))
    ancestry = rng.dirichlet([0.6, 0.6, 0.6])
    african, asian, caucasian = ancestry.tolist()
    face = {}
    for shape in entries("faces", "shapes", Shape).values():
        weight = float(np.clip(rng.normal(0, shape.spread), -0.9, 0.9))
        name = shape.positive if weight > 0 else shape.negative
        face[name] = abs(weight)
        if "/l-" in name:  # a target of the left side: the right one is the same
            face[name.replace("/l-", "/r-")] = abs(weight)
    face[f"head/head-{rng.choice(HEADS)}"] = float(rng.uniform(0, 0.5))
    return Person(
        female=female,
        age=age,
        muscle=float(np.clip(rng.normal(0.55 - 0.1 * female, 0.15), 0.1, 0.95)),
        weight=float(np.clip(rng.normal(0.5, 0.17), 0.12, 0.95)),
        height=float(np.clip(rng.normal(0.5, 0.16), 0.1, 0.9)),
        proportions=float(rng.uniform(0.35, 0.95)),
        bust=float(rng.uniform(0.25, 0.7)),
        ancestry=(african, asian, caucasian),
        skin=float(np.clip(ancestry @ MEAN_SKIN + rng.normal(0, 0.09), 0.03, 0.97)),
        face=face,
    )


def between(value: float, names: tuple[str, str, str]) -> dict[str, float]:
    """Interpolates between three shapes that stand at 0, 1/2 and 1, as MakeHuman's sliders do.

    >>> between(0.25, ("thin", "average", "heavy"))
    {'thin': 0.5, 'average': 0.5, 'heavy': 0.0}
    """
    t = 2 * value
    return {names[0]: max(1 - t, 0.0), names[1]: 1 - abs(t - 1), names[2]: max(t - 1, 0.0)}


def macro_weights(person: Person) -> dict[str, float]:
    """Returns the weights of MakeHuman's macro targets, by name: products of the traits' linear weights.

    A target of the face depends on ancestry, sex and age; one of the body on sex, age, muscle and weight, and those of
    height, proportions and breasts on these and one or two traits more. Weights under 1e-4 are left out.
    """
    sex = {"female": person.female, "male": 1 - person.female}
    years = np.interp(person.age, AGE_ANCHORS, [0, 0.5, 1])
    age = between(float(years), AGES)
    muscle = between(person.muscle, ("minmuscle", "averagemuscle", "maxmuscle"))
    weight = between(person.weight, ("minweight", "averageweight", "maxweight"))
    height = between(person.height, ("minheight", "", "maxheight"))
    proportions = between(person.proportions, ("uncommonproportions", "", "idealproportions"))
    cup = between(person.bust, ("mincup", "averagecup", "maxcup"))
    firmness = between(0.75 - 0.35 * float(years), ("minfirmness", "averagefirmness", "maxfirmness"))
    targets: dict[str, float] = {}
    # One letter stands for the name of a shape of each trait: s for "female", a for "young", ...
    for (s, a), (race, share) in product(product(sex, age), zip(ANCESTRIES, person.ancestry)):
        targets[f"macrodetails/{race}-{s}-{a}"] = share * sex[s] * age[a]
    for s, a, m, w in product(sex, age, muscle, weight):
        share, name = sex[s] * age[a] * muscle[m] * weight[w], f"{s}-{a}-{m}-{w}"
        targets[f"macrodetails/universal-{name}"] = share
        targets |= {f"macrodetails/height/{name}-{h}": share * height[h] for h in height if h}
        targets |= {f"macrodetails/proportions/{name}-{p}": share * proportions[p] for p in proportions if p}
        if s == "female":
            targets |= {f"breast/{name}-{c}-{f}": share * cup[c] * firmness[f] for c, f in product(cup, firmness)}
    return {name: weight for name, weight in targets.items() if weight > 1e-4}


def expressions() -> dict[str, dict[str, float]]:
    """Returns all expressions by name: the weights of their face units at full strength, by the name of the unit."""
    return entries("faces", "expressions", dict[str, float])


def units(name: str, strength: float = 1.0, swap: bool = False) -> dict[str, float]:
    """Returns the weights of the face units of an expression, by target name.

    Args:
        name: name of the expression. A unit of it, such as `mouthSmile`, moves both sides, `mouthSmile.L` the left one
            only.
        strength: factor of the weights.
        swap: exchanges the sides.
    """
    weights = {}
    for unit, weight in expressions()[name].items():
        unit, _, only = unit.partition(".")
        for side, word in (("L", "Right"), ("R", "Left")) if swap else (("L", "Left"), ("R", "Right")):
            if only in ("", side):
                target = unit if unit in WHOLE_FACE else unit + word
                weights[f"faceunits/{target}"] = strength * weight
    return weights


def sample_expression(rng: np.random.Generator) -> Expression:
    """Draws an expression (calm in 30 % of cases), its strength, its sides, and the gaze."""
    names = list(expressions())
    shares = np.array([30, 21] + [7] * (len(names) - 2))  # calm, a smile, each of the others
    name = str(rng.choice(names, p=shares / shares.sum()))
    face = units(name, strength=float(rng.uniform(0.45, 1.0)), swap=rng.random() < 0.5)
    left, down = np.clip(rng.normal([0, 0.05], [0.22, 0.12]), -0.5, 0.5)  # the gaze, in shares of the eyes' range
    for eye, outward in (("Left", left), ("Right", -left)):
        face[f"faceunits/eyeLook{'Out' if outward > 0 else 'In'}{eye}"] = float(abs(outward))
        face[f"faceunits/eyeLook{'Down' if down > 0 else 'Up'}{eye}"] = float(abs(down))
    return Expression(name, face)


def build_body(person: Person, expression: Expression | None = None) -> Body:
    """Builds a person's body in the rest pose, with the mouth closed; without an expression, the face is at rest."""
    face = person.face | (expression.units if expression else {})
    vertices = makehuman.blended(macro_weights(person) | face)
    rig = makehuman.rig()
    joints = {bone: vertices[head].mean(0) for bone, head in zip(rig.bones, rig.heads)}
    return Body(person, vertices, joints)
