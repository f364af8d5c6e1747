"""People: the traits of one, the color of the eyes, and expressions, drawn at random."""

from dataclasses import dataclass, field

import numpy as np

from relight.figures.catalogue.schema import entries
from relight.figures.texture import Color

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
class Iris:
    """A color of eyes, and the shares of people with light and with darker skin who have it."""

    color: Color
    light_skin: float
    dark_skin: float


def sample_iris(rng: np.random.Generator, person: Person) -> Color:
    """Draws the linear albedo of a person's irises, by the lightness of the skin."""
    irises = list(entries("colors", "irises", Iris).values())
    odds = [iris.light_skin if person.skin > 0.75 else iris.dark_skin for iris in irises]
    return irises[int(rng.choice(len(irises), p=odds))].color


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
