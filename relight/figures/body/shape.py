"""The shape of a body: MakeHuman's targets, weighted by a person's traits, in the rest pose (arms half down)."""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from relight.figures.body import makehuman
from relight.figures.draw.person import ANCESTRIES, Expression, Person

AGES = ("child", "young", "old")  # the ends and the middle of MakeHuman's age slider
AGE_ANCHORS = (12, 25, 90)  # years of these


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
        bones = {"hip": "upperleg01.L", "waist": "spine04", "neck": "neck01"}
        at_joints = {name: float(joints[bone][1]) for name, bone in bones.items()}
        return {"crotch": float(self.tights[middle, 1].min()), **at_joints}


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


def build_body(person: Person, expression: Expression | None = None) -> Body:
    """Builds a person's body in the rest pose, with the mouth closed; without an expression, the face is at rest."""
    face = person.face | (expression.units if expression else {})
    vertices = makehuman.blended(macro_weights(person) | face)
    rig = makehuman.rig()
    return Body(person, vertices, {bone: vertices[head].mean(0) for bone, head in zip(rig.bones, rig.heads)})
