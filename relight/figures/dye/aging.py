"""Traces of sewing and wear in the albedo: seams, hems, ribs, fading, creases, soil, panels of unequal dye."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from relight.figures.draw.fabrics import trait
from relight.figures.draw.garments import Garment
from relight.figures.dye.weaves import Swatch
from relight.figures.texture import band, grain, lattice_value

DENIM_THREAD, ZIP = (0.36, 0.20, 0.07), (0.30, 0.29, 0.27)  # linear albedo
FADED_DENIM = np.array([0.48, 0.51, 0.55])
STITCH = 0.0011  # half the width of a line of stitches, metres
RIB = 0.055  # metres of ribbing at hems and cuffs
FADES = {"denim": 1.0, "leather": 0.45, "corduroy": 0.35, "knit": 0.1, "melange": 0.1, "tweed": 0.08}  # others have .2


def line(distance: np.ndarray) -> np.ndarray:
    """Returns the coverage of a line of stitches at `distance` metres from it, in [0,1]."""
    return np.clip(1.5 - np.abs(distance) / STITCH, 0, 1)


@dataclass
class Patch(Swatch):
    """The albedo of a panel, on which traces are left one after the other.

    Attributes:
        garment: garment to which the panel belongs.
        marks: (h,w) the panel's part of `marks.images`, by name.
        color: (h,w,3) linear albedo, without `log`; at first that of the weave.
        log: (h,w) logarithm of the factor by which traces change the albedo; at first that of the panel's dye.
    """

    garment: Garment
    marks: dict[str, np.ndarray]
    color: np.ndarray
    log: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        """Varies the dye between panels, which are cut from different bolts."""
        dye = 2 * trait(self.fabric, "dye", self.number % 7) - 1
        self.log = 0.035 * dye * np.ones(self.u.shape, self.u.dtype)

    @property
    def thin(self) -> float:
        """Returns the contrast in [0,1] of thin lines: less than 1 where they are thinner than a texel."""
        return min(1.0, 0.0016 / self.texel)

    @property
    def fading(self) -> float:
        """Returns how much the fabric fades with its age."""
        return FADES.get(self.fabric.kind, 0.2) * (0.4 + 0.9 * trait(self.fabric, "age"))

    @cached_property
    def uneven(self) -> np.ndarray:
        """Noise (h,w) of mean 0 and standard deviation 1, with features of a centimetre."""
        return self.grain(0.012, 0.012, layer=60)

    @cached_property
    def pucker(self) -> np.ndarray:
        """How near (h,w) the cloth is to a seam or border: 1 there, 1/e a centimetre from it."""
        return np.exp(-np.minimum(self.marks["seam"], self.marks["edge"]) / 0.010)

    @cached_property
    def rope(self) -> np.ndarray:
        """Noise (h,w) of mean 0 and standard deviation 1 across the bias, as puckered cloth turns to ropes."""
        u, v = self.u + self.v, self.v - self.u
        return grain(u, v, 0.010, 0.014, self.texel, self.fabric.seed + 61, self.offset)

    @property
    def offset(self) -> float:
        """Returns a number that makes noise differ between panels, and from that of the weave."""
        return 3.17 * (self.number % 19)

    def line(self, distance: np.ndarray) -> np.ndarray:
        """Returns the coverage (h,w) of a line of stitches at `distance` metres, not thinner than a texel."""
        return line(distance / max(1.0, self.texel / STITCH))

    def paint(self, color: np.ndarray, share: np.ndarray) -> None:
        """Mixes a share (h,w) of a linear color (3,) or (h,w,3) into the albedo."""
        self.color = self.color + (color - self.color) * share[..., None]


def seams(patch: Patch) -> None:
    """Darkens the lines of seams by up to a third."""
    patch.log -= 0.40 * patch.thin * patch.line(patch.marks["seam"])


def hems(patch: Patch) -> None:
    """Draws ribs or stitches along the borders; on denim also double stitches beside the seams, with yellow thread."""
    garment, edge = patch.garment, patch.marks["edge"]
    hem = 0.040 if garment.thickness > 0.004 else 0.020  # metres from the border to its stitches
    stitch = patch.line(edge - hem)
    is_gathered = max(garment.hem_pin, garment.cuff_pin - 0.1) > 0.35  # a border that clings to the body has ribs
    if patch.fabric.kind not in ("denim", "leather") and is_gathered:
        ribs = 0.30 * patch.thin * (band(patch.u, 0.0055, 0.5, max(0.002, patch.texel)) - 0.5)
        patch.log += np.clip((RIB - edge) / 0.003, 0, 1) * (ribs - 0.05)
        patch.log -= 0.30 * patch.thin * patch.line(edge - RIB)
    elif patch.fabric.kind == "denim":
        beside = [line(patch.marks["seam"] - distance) for distance in (0.0025, 0.0075)]
        patch.paint(np.array(DENIM_THREAD), 0.55 * patch.thin * np.maximum(stitch, np.maximum(*beside)))
    else:
        patch.log -= 0.22 * patch.thin * stitch


def puckers(patch: Patch) -> None:
    """Shades the small folds along seams and borders."""
    patch.log += (0.05 + 0.13 * patch.fading) * patch.pucker * patch.rope


def fading(patch: Patch) -> None:
    """Bleaches cloth where it rubs, and on the crests of puckers: denim to FADED_DENIM, other fabrics by half."""
    worn = patch.marks["rub"] * (0.75 + 0.25 * patch.uneven) + 0.35 * patch.pucker * np.clip(patch.rope, 0, 2)
    pale = 0.5 * patch.color + 0.5 * FADED_DENIM if patch.fabric.kind == "denim" else 1.5 * patch.color + 0.01
    patch.paint(pale, np.clip(0.55 * patch.fading * np.clip(worn, 0, 1), 0, 1))


def creases(patch: Patch) -> None:
    """Bleaches old creases, which lost their dye, where the cloth bends: by up to a sixth, and darkens between them."""
    noise = patch.grain(0.055, 0.011, layer=62)  # long across the limb, short along it
    lines = np.clip(1 - 1.8 * np.abs(noise), -0.3, 1)  # 1 on creases, which are where the noise is zero
    patch.log += (0.02 + 0.13 * patch.fading) * patch.marks["bend"] * lines


def soil(patch: Patch) -> None:
    """Darkens the hems of trousers, and leaves stains."""
    soiled, seed = trait(patch.fabric, "soil"), patch.fabric.seed
    low = np.exp(-patch.marks["edge"] / 0.035) * (patch.garment.kind == "trousers")
    patch.log -= 0.25 * soiled * low * np.clip(0.6 + 0.5 * patch.uneven, 0, 2)
    for stain in range(int(5 * soiled**2 * (0.5 + trait(patch.fabric, "stains")))):
        across, along, size = (lattice_value(stain, patch.number + 100 * k, seed) for k in range(3))
        u, v = patch.u.min() + across * np.ptp(patch.u), patch.v.min() + along * np.ptp(patch.v)
        radius = 0.004 + 0.022 * size**2  # metres
        distance = np.hypot(patch.u - u, patch.v - v) / radius + 0.15 * patch.uneven
        patch.log -= (0.10 + 0.22 * size) * np.clip((1.15 - distance) / 0.3, 0, 1)


def zip_teeth(patch: Patch) -> None:
    """Paints the teeth of a zip, 4 mm apart, along an open front with a stand-up collar."""
    garment = patch.garment
    if not garment.front_gap or garment.collar != "stand" or patch.panel != "front":
        return
    teeth = (patch.marks["edge"] < 0.006) & (np.abs(patch.u) < 3 * garment.front_gap)
    metal = 0.35 + 0.65 * patch.thin * band(patch.v, 0.004, 0.5, max(0.001, patch.texel))
    patch.paint(np.array(ZIP), 0.8 * teeth * metal)


TRACES = (seams, hems, puckers, fading, creases, soil, zip_teeth)  # in this order


def aged(patch: Patch) -> np.ndarray:
    """Adds the traces of sewing and wear to a panel, which is changed, and returns its linear albedo (h,w,3)."""
    for leave in TRACES:
        leave(patch)
    return np.clip(patch.color * np.exp(patch.log)[..., None], 0.006, 0.88)
