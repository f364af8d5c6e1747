"""Draws the recipe of each picture of the benchmark (figure, view, framing, lights, exposure) from its name.

The recipes of a set must never change: HASHES fixes them.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, replace

import numpy as np

from relight.benchmark.lights import Lamplight
from relight.core.errors import UserError
from relight.learning.augment import CUT_HEIGHT
from relight.meshes import Mesh
from relight.panoramas.polyhaven import NAMES
from relight.transport import View, random_view

# Of figures and lights, none of which is in training.
FIRST_SEED = {"report": 900_000, "choose": 910_000, "real": 920_000}
FIGURES = 64
VIEWS = 2  # pictures per figure: the whole person, then the whole or the upper half
SPARE_OFFSET = 1_000  # added to the seed of a figure that the generator refuses
NEW_LIGHTS = 4  # per picture
LIGHT_KINDS = {"room": 0.5, "sky": 0.2, "lamps": 0.3}  # probabilities
TINT = 0.15  # standard deviation of ln(B/G) of the white balance
STOPS = (-0.7, 0.5)  # range of the exposure
HALF_SHARE = 0.5  # share of the second pictures that show the upper half
VARIANT_EVERY = 2  # the first picture of every second figure has variants
ROUGHNESS, SPECULAR = (0.4, 0.8), (0.2, 1.0)  # ranges of the gloss of materials
RECIPE_STREAM, REAL_STREAM, GLOSS_STREAM = 0xB3, 0x5EA1, 0xC0A7  # of random numbers, independent of each other

REAL = "real"  # kind of the lights of the set of this name: panoramas by Poly Haven

HASHES = {
    "report": "35ec0e0384d839fcc253df3c6654538f01cb7142f4891dbb23017bab5bb57b6e",
    "choose": "0fc33d0e54cbd0b83cc3ee56b3e2c89a9a39a30178957e7d715a835b02e311ff",
    "real": "38ae6c17a249f18989338cc135fe8c3ab1036f4a3fe25531c5bb66509d797b6b",
}


@dataclass(frozen=True)
class PictureRecipe:
    """The content of one picture.

    Attributes:
        name: name of the picture.
        seed: random seed of the figure.
        view: view of the camera.
        cut: fraction of the figure's height that is in the picture, from the top; None for all of it.
        light: light of the photograph.
        new: the lights that the person is to be relit with.
        stops: exposure.
        varied: whether the picture has variants for the invariances.
    """

    name: str
    seed: int
    view: View
    cut: float | None
    light: Lamplight
    new: tuple[Lamplight, ...]
    stops: float
    varied: bool


def draw_recipes(kind: str, count: int | None = None) -> list[PictureRecipe]:
    """Returns the recipes of a set, a key of FIRST_SEED, or its first `count`. Raises UserError for another name."""
    if kind not in FIRST_SEED:
        raise UserError(f"--set {kind}: must be {' or '.join(FIRST_SEED)}")
    seeds = range(FIRST_SEED[kind], FIRST_SEED[kind] + FIGURES)
    drawn = [draw_recipe(seed, number) for seed in seeds for number in range(1, VIEWS + 1)]
    if kind == REAL:
        drawn = [under_real_lights(recipe) for recipe in drawn]
    if count is not None and not 1 <= count <= len(drawn):
        raise UserError(f"--count {count}: must be from 1 to {len(drawn)}")
    return drawn[:count]


def draw_recipe(seed: int, number: int) -> PictureRecipe:
    """Draws the recipe of a picture by the seed of its figure and its number among those of the figure, from 1."""
    name = f"g{seed}.{number}"
    rng = np.random.default_rng([seed, number, RECIPE_STREAM])
    lights = []
    for index in range(NEW_LIGHTS + 1):
        kind = str(rng.choice(list(LIGHT_KINDS), p=list(LIGHT_KINDS.values())))
        light_seed = (seed * VIEWS + number - 1) * (NEW_LIGHTS + 1) + index  # of its own for each light of each picture
        tint = round(float(rng.normal(scale=TINT)), 3)
        lights.append(Lamplight(kind, light_seed, tint, round(float(rng.uniform(-180, 180)), 1)))
    cut = round(float(rng.uniform(*CUT_HEIGHT)), 3) if number > 1 and rng.random() < HALF_SHARE else None
    stops = round(float(rng.uniform(*STOPS)), 3)
    varied = number == 1 and seed % VARIANT_EVERY == 0
    return PictureRecipe(name, seed, random_view(name), cut, lights[0], tuple(lights[1:]), stops, varied)


def under_real_lights(recipe: PictureRecipe) -> PictureRecipe:
    """Returns a recipe with different real panoramas in place of its generated lights; tints and yaws stay."""
    generated = (recipe.light, *recipe.new)
    rng = np.random.default_rng([recipe.seed, int(recipe.name[-1]), REAL_STREAM])
    chosen = rng.permutation(len(NAMES))[: len(generated)]
    light, *new = (replace(source, kind=REAL, seed=int(index)) for source, index in zip(generated, chosen))
    return replace(recipe, light=light, new=tuple(new))


def with_gloss(mesh: Mesh, seed: int) -> Mesh:
    """Returns a figure with gloss drawn anew from a seed for each material, from satin to nearly matt."""
    rng = np.random.default_rng([seed, GLOSS_STREAM])
    materials = []
    for material in mesh.materials:
        roughness, specular = (round(float(rng.uniform(*ends)), 3) for ends in (ROUGHNESS, SPECULAR))
        materials.append(replace(material, roughness=roughness, specular=specular))
    return replace(mesh, materials=materials)


def digest(drawn: list[PictureRecipe]) -> str:
    """Returns the SHA-256 of recipes, in hexadecimal."""
    text = json.dumps([asdict(recipe) for recipe in drawn], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
