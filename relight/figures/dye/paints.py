"""Paints of a figure's parts: functions from an outfit to a material, and the materials that all outfits share."""

from collections.abc import Callable

import numpy as np

from relight.figures.cut.patterns import Pattern
from relight.figures.drape import trims
from relight.figures.draw.outfits import Outfit
from relight.figures.dye import panels, skin
from relight.figures.dye.aging import Patch, aged
from relight.figures.dye.marks import images, marks
from relight.figures.dye.seams import stitch
from relight.figures.dye.weaves import Swatch, woven
from relight.figures.texture import coded, noise
from relight.meshes import Material

Paint = Material | Callable[[Outfit], Material]  # a function if the material depends on the outfit's colors


def garment_paint(pattern: Pattern, number: int, atlas: panels.Panels) -> Paint:
    """Returns the paint of a garment's texture: its fabric, seams and wear.

    Args:
        pattern: by which the garment is cut.
        number: of the garment in the outfit.
        atlas: panels of the garment's texture.
    """
    garment, worn_places, texel = pattern.garment, images(atlas, marks(pattern)), 1 / atlas.scale

    def paint(outfit: Outfit) -> Material:
        worn = outfit.garments[number]

        def paint_panel(panel: str, u: np.ndarray, v: np.ndarray, place: tuple[slice, slice]) -> np.ndarray:
            top = atlas.cloth[atlas.panel == atlas.names.index(panel)][..., 1].max()  # v of the panel's upper end
            marks_here = {mark: image[place] for mark, image in worn_places.items()}
            cloth = worn.fabric, panel, u, v, texel
            patch = Patch(*cloth, garment, marks_here, woven(Swatch(*cloth)))
            stitch(patch, top)
            return aged(patch)

        return Material(texture=panels.draw(atlas, paint_panel), name=worn.garment.name)

    return paint


def cord_paint(number: int) -> Paint:
    """Returns the paint of the cords of a hood, paler than the garment with this number."""

    def paint(outfit: Outfit) -> Material:
        ground = np.array(outfit.garments[number].fabric.first, np.float32)
        return Material(0.5 * (ground + 0.7), name="hood cord")  # half-way to a light grey

    return paint


def shoe_paint(part: str) -> Paint:
    """Returns the paint of a part of the shoes: upper, sole, lace or cap."""

    def paint(outfit: Outfit) -> Material:
        cloth, rubber = np.array(outfit.upper, np.float32), np.array(outfit.sole, np.float32)
        has_pale_laces = "sneakers" in outfit.shoe.name and rubber[0] > 0.3
        colors = {
            "upper": cloth,
            "sole": rubber,
            "lace": rubber if has_pale_laces else 0.35 * cloth + np.float32(0.01),
            "cap": rubber if outfit.shoe.name == "high sneakers" else 0.8 * cloth,
        }
        return Material(colors[part], name=f"shoes: {part}")

    return paint


ACCESSORIES = {"hat": 0.6, "tie": trims.TIE, "belt": 0.3}  # width of the cloth, metres; its fabric is in `Outfit`


def accessory_paint(name: str, side: int) -> Paint:
    """Returns the paint of one of ACCESSORIES.

    Args:
        name: of the accessory.
        side: pixels of its square texture, which is as wide as the cloth and stands for half that length of it: the
            accessories' texture coordinates are stretched as much along the cloth.
    """
    width = ACCESSORIES[name]
    u, v = cell_centres(side)

    def paint(outfit: Outfit) -> Material:
        albedo = woven(Swatch(getattr(outfit, name), "front", width * u, -0.5 * width * v, width / side))
        return Material(texture=coded(albedo), name=name)

    return paint


def cell_centres(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns u and v in (0,1) at the centres of a texture's pixels, each (side,side); v runs down the rows."""
    return np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side)


def hair_material(outfit: Outfit, kind: str, side: int, seed: int) -> Material:
    """Returns a material with strands along v of varying lightness; lashes are of one color.

    Args:
        outfit: with the color of the hair.
        kind: hair | beard | brows | lashes.
        side: of the texture, pixels.
        seed: random seed of the strands.
    """
    color = np.array(outfit.hair_color)
    if kind == "lashes":
        return Material((0.3 * np.minimum(color, 0.12)).astype(np.float32), name=kind)  # dark on blond people, too
    if kind == "brows":
        color = skin.brow_color(color)
    u, v = cell_centres(side)
    pale = float(np.clip(color.mean() / 0.3, 0, 1))  # light hair varies less, in shares of its own albedo
    spread = 0.30 - 0.16 * pale  # standard deviation of ln albedo, about
    # Fine and coarse strands, 120 and 31 across the texture, less the mean of both.
    streaks = noise(u * 120, v * 5, seed) + 0.7 * noise(u * 31, v * 3, seed + 1) - 0.85
    return Material(texture=coded(color * np.exp(2.4 * spread * streaks)[..., None]), name=kind)
