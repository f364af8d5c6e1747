"""Hair styles and colors: what there is, and how one is drawn."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from relight.figures.catalogue.schema import entries
from relight.figures.draw.person import Person
from relight.figures.texture import Color, as_color, lattice_value


@dataclass(frozen=True)
class Comb:
    """How hair is combed and cut.

    Attributes:
        count: number of guides.
        length: metres on the top.
        strands: per guide.
        sides: length at the sides over that on the top.
        width: width of a strand, metres.
        direction: in which the top is combed.
        fringe: share of the front that falls on the forehead.
        part: azimuth of the parting.
        lift: from 0 (lies flat) to 1 (stands up).
        weight: how soon hair falls.
        cling: how close it keeps to the head.
        body: metres of the topmost strand over the skin.
        curl: radius of its turns, metres.
        pitch: metres from one turn to the next.
        clump: how far the strands of a guide draw together at their tips, in [0,1].
        fray: metres by which strands stray.
        wander: how much guides turn at each step.
        above: metres over the skin where strands start.
    """

    count: int
    length: float
    strands: int = 10
    sides: float = 1.0
    width: float = 0.0022
    direction: Literal["forward", "aside", "back", "down", "out", "tie"] = "down"
    fringe: float = 0.0
    part: float = 0.0
    lift: float = 0.25
    weight: float = 0.25
    cling: float = 0.0
    body: float = 0.014
    curl: float = 0.0
    pitch: float = 0.08
    clump: float = 0.5
    fray: float = 0.0012
    wander: float = 0.1
    above: float = 0.0


@dataclass(frozen=True)
class HairStyle:
    """A hair style.

    Attributes:
        name: as `relight figures --names` lists it.
        comb: how the hair lies, or None for painted hair only.
        tie, hat: its kind, or none.
        slack: metres between scalp and hat.
        scalp: coverage of the cropped hair painted on the scalp, in [0,1].
        men, women: how often they have it, relative to other styles.
        african: likewise, men and women of mostly African ancestry; None if that makes no difference.
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
    african: tuple[float, float] | None = None
    balding: bool = False


def styles() -> dict[str, HairStyle]:
    """Returns all hair styles, by name."""
    return entries("hair", "styles", HairStyle)


def style_odds(woman: bool, person: Person, names: Collection[str] = ()) -> np.ndarray:
    """Returns the probability of each hair style of a person, in the order of `styles`, (S,).

    Args:
        woman: whether the person's body is a woman's.
        person: whose age and ancestry count.
        names: styles that are allowed; empty for all. If the person can have none of them, all probabilities are 0.
    """
    odds = []
    for style in styles().values():
        weight = style.women if woman else style.men
        if style.balding and not woman:
            weight += max(0, person.age - 35) / 20
        if style.african is not None and person.ancestry[0] > 0.5:
            weight = style.african[woman]
        odds.append(weight * (not names or style.name in names))
    return np.array(odds) / max(np.sum(odds), np.finfo(float).tiny)


def sample_color(rng: np.random.Generator, person: Person) -> Color:
    """Draws the linear albedo of a person's hair: grey or white with age, else by skin and ancestry."""
    if rng.random() < np.clip((person.age - 42) / 35, 0, 0.9):
        name = "white" if rng.random() < (person.age - 50) / 40 else "grey"
    else:
        _, _, caucasian = person.ancestry
        skin = "light skin" if person.skin > 0.72 and caucasian > 0.4 else "dark skin"
        odds = entries("hair", "colors", dict[str, float])[skin]
        name = str(rng.choice(list(odds), p=list(odds.values())))
    return as_color(np.array(entries("colors", "hair", Color)[name]) * np.exp(rng.normal(0, 0.12)))


def varied(comb: Comb, seed: int) -> Comb:
    """Returns a style's comb with one person's length, side of the parting, and fringe, drawn by the seed."""
    length, side, fringe = (lattice_value(seed, k, 77) for k in range(3))  # in [0,1)
    part, fringe = comb.part * (1 if side < 0.5 else -1), comb.fringe if fringe < 0.7 else 0.0
    return replace(comb, length=comb.length * (0.85 + 0.3 * length), part=part, fringe=fringe)
