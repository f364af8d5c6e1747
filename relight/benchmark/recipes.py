"""What stands in each picture of the benchmark: figure, view, framing and lights, all drawn from its name.

Nothing here may change: the hash of a set's recipes is part of the set, and `HASHES` says what it must be.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, replace

import numpy as np

from relight.benchmark.lights import Lamplight
from relight.files import UserError
from relight.learning.augment import CUT
from relight.meshes import Mesh
from relight.transport import View, random_view

FIRST = {"report": 900_000, "choose": 910_000}  # first seed of figures and of lights; none of them is trained on
FIGURES = 64
VIEWS = 2  # pictures of each figure: the whole person, then a whole or a half one
SPARE = 1_000  # a figure that its generator refuses is replaced by that of the seed so much higher
NEW = 4  # lights that each picture is relit by
KIND = {"room": 0.5, "sky": 0.2, "lamps": 0.3}
TINT = 0.15  # standard deviation of ln(B/G) of white balances
STOPS = (-0.7, 0.5)
HALF = 0.5  # share of the second pictures that show half a person
VARIED = 2  # every second figure's first picture is there in variants too

HASHES = {
    "report": "35ec0e0384d839fcc253df3c6654538f01cb7142f4891dbb23017bab5bb57b6e",
    "choose": "0fc33d0e54cbd0b83cc3ee56b3e2c89a9a39a30178957e7d715a835b02e311ff",
}


@dataclass(frozen=True)
class Recipe:
    """One picture. cut: share of the figure's height that is in it, None for all; light: in which the person is seen;
    new: in which it is to be shown; stops: exposure; varied: whether it is there in variants for the invariances."""

    name: str
    seed: int
    view: View
    cut: float | None
    light: Lamplight
    new: tuple[Lamplight, ...]
    stops: float
    varied: bool


def recipes(kind: str, count: int | None = None) -> list[Recipe]:
    """The recipes of the set `report` or `choose`, or the first `count` of them. UserError for another name."""
    if kind not in FIRST:
        raise UserError(f"--set {kind}: {' or '.join(FIRST)}")
    made = [recipe(FIRST[kind] + figure, number) for figure in range(FIGURES) for number in range(1, VIEWS + 1)]
    if count is not None and not 1 <= count <= len(made):
        raise UserError(f"--count {count}: the set has 1 to {len(made)} pictures")
    return made[:count]


def recipe(seed: int, number: int) -> Recipe:
    """Picture `number` (from 1) of the figure of a seed."""
    name = f"g{seed}.{number}"
    rng = np.random.default_rng([seed, number, 0xB3])
    lights = []
    for place in range(NEW + 1):
        kind = str(rng.choice(list(KIND), p=list(KIND.values())))
        own = (seed * VIEWS + number - 1) * (NEW + 1) + place
        lights.append(
            Lamplight(kind, own, round(float(rng.normal(0, TINT)), 3), round(float(rng.uniform(-180, 180)), 1))
        )
    half = number > 1 and rng.random() < HALF
    cut = round(float(rng.uniform(*CUT)), 3) if half else None
    stops = round(float(rng.uniform(*STOPS)), 3)
    varied = number == 1 and seed % VARIED == 0
    return Recipe(name, seed, random_view(name, 0), cut, lights[0], tuple(lights[1:]), stops, varied)


def with_gloss(mesh: Mesh, seed: int) -> Mesh:
    """The figure of a seed with another gloss on each material than its own, from satin to nearly matt."""
    rng = np.random.default_rng([seed, 0xC0A7])
    materials = []
    for material in mesh.materials:
        roughness, specular = (round(float(rng.uniform(*ends)), 3) for ends in ((0.4, 0.8), (0.2, 1.0)))
        materials.append(replace(material, roughness=roughness, specular=specular))
    return replace(mesh, materials=materials)


def digest(made: list[Recipe]) -> str:
    """The hash of recipes."""
    text = json.dumps([asdict(one) for one in made], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
