"""Weaves: the albedo of each kind of fabric as a function of cloth coordinates, without shading."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from relight.figures.draw.fabrics import Fabric, Kind, further_color, trait
from relight.figures.dye.prints import emblem, printed
from relight.figures.texture import band, grain, mixed


@dataclass
class Swatch:
    """A piece of a panel, to be painted.

    Attributes:
        fabric: fabric of the panel.
        panel: its name.
        u: (...) cloth coordinate across, metres.
        v: (...) cloth coordinate along, metres.
        texel: metres between the samples; finer details are averaged.
    """

    fabric: Fabric
    panel: str
    u: np.ndarray
    v: np.ndarray
    texel: float

    @property
    def first(self) -> np.ndarray:
        """Returns the color (3,) of the fabric's ground."""
        return np.array(self.fabric.first, self.u.dtype)

    @property
    def second(self) -> np.ndarray:
        """Returns the color (3,) of the fabric's pattern."""
        return np.array(self.fabric.second, self.u.dtype)

    @property
    def number(self) -> int:
        """Returns a number that differs between panels, from the letters of the panel's name."""
        return sum(map(ord, self.panel))

    @property
    def offset(self) -> float:
        """Returns a number that makes noise differ between panels."""
        return 7.31 * (self.number % 17)

    @property
    def soft(self) -> float:
        """Returns the metres over which edges of a pattern are soft."""
        return max(0.0012, self.texel)

    def trait(self, name: str) -> float:
        """Returns a random property in [0,1) of the fabric, one of `fabrics.TRAITS`."""
        return trait(self.fabric, name)

    def grain(self, width: float, height: float, layer: int) -> np.ndarray:
        """Returns noise (...) of mean 0 and standard deviation 1 with features of `width` by `height` metres.

        Each layer of noise has a number of its own.
        """
        return grain(self.u, self.v, width, height, self.texel, self.fabric.seed + layer, self.offset)

    def patterned(self, share: np.ndarray, second: np.ndarray | None = None) -> np.ndarray:
        """Mixes a pattern into the ground.

        Args:
            share: (...) of the pattern; it is clipped to [0,1].
            second: (3,) its linear albedo; that of the fabric's pattern if it is None.

        Returns:
            (...,3) linear albedo.
        """
        return mixed(self.first, self.second if second is None else second, np.clip(share, 0, 1))


def plain(swatch: Swatch) -> np.ndarray:
    """Returns the color of the ground."""
    return np.broadcast_to(swatch.first, (*swatch.u.shape, 3))


def stripes(swatch: Swatch) -> np.ndarray:
    """Returns stripes across the cloth, on some fabrics with a line of a third color in each or every other gap."""
    v, size, soft = swatch.v, swatch.fabric.size, swatch.soft
    period = 0.055 * size
    color = swatch.patterned(band(v, period, 0.25 + 0.4 * swatch.trait("stripe width"), soft))
    if swatch.trait("third stripe") >= 0.45:
        return color
    in_every_gap = swatch.trait("third stripe gaps") >= 0.5
    line = band(v + 0.0275 * size, period * (1 if in_every_gap else 2), 0.12, soft)
    return mixed(color, further_color(swatch.fabric, "third color"), line)


def fine_stripes(swatch: Swatch) -> np.ndarray:
    """Returns narrow stripes along the cloth, as on shirts."""
    return swatch.patterned(band(swatch.u, 0.016 * swatch.fabric.size, 0.38, 0.0008))


def pinstripe(swatch: Swatch) -> np.ndarray:
    """Returns thin pale lines along the cloth, as on suits."""
    return swatch.patterned(0.55 * band(swatch.u, 0.022 * swatch.fabric.size, 0.07, 0.0008))


def check(swatch: Swatch) -> np.ndarray:
    """Returns a check, on most fabrics with the lines of a tartan in a third color."""
    u, v, soft, period = swatch.u, swatch.v, swatch.soft, 0.06 * swatch.fabric.size
    color = swatch.patterned(0.5 * band(u, period, 0.45, soft) + 0.5 * band(v, period, 0.45, soft))
    if swatch.trait("tartan") >= 0.6:
        return color
    lines = [band(along + 0.3 * period, period, 0.07, soft) for along in (u, v)]
    return mixed(color, further_color(swatch.fabric, "third color"), 0.6 * np.maximum(*lines))


def melange(swatch: Swatch) -> np.ndarray:
    """Returns yarn of two colors, spun together."""
    return swatch.patterned(0.22 + 0.055 * swatch.grain(0.0025, 0.009, layer=1), 0.5 * (swatch.second + 0.5))


def tweed(swatch: Swatch) -> np.ndarray:
    """Returns a coarse twill with flecks."""
    flecks = 0.15 * np.clip(swatch.grain(0.0026, 0.0026, layer=1), -1.4, 1.6)
    twill = 0.12 * band(swatch.u + swatch.v, 0.012, 0.5, swatch.soft)
    return swatch.patterned(0.30 + flecks + twill, 0.5 * (swatch.first + swatch.second))


def knit(swatch: Swatch) -> np.ndarray:
    """Returns stitches, on some fabrics with ribs; stitches finer than two texels are grey."""
    u, v = swatch.u, swatch.v
    period = 0.006 * (0.8 + 0.8 * swatch.trait("stitch size"))  # of the stitches, metres
    from_middle = np.abs((u / period) % 1 - 0.5)  # across a column of stitches: 0 in its middle, 0.5 at its sides
    chevrons = band(v + 0.7 * period * from_middle, period, 0.35, 0.002)
    stitch = np.clip(chevrons + 0.6 * (from_middle < 0.08), 0, 1)
    visible = 1 / (1 + (1.5 * swatch.texel / period) ** 4)  # 1 for stitches of many texels, 0 for fine ones
    mean = 0.4  # of `stitch`, the grey of fine ones
    share = 0.35 * (mean + visible * (stitch - mean))
    if swatch.trait("ribs") < 0.4:
        share = share + 0.22 * band(u, 0.012 + 0.012 * swatch.trait("rib width"), 0.4, 0.003)
    return swatch.patterned(share, 0.45 * swatch.first)


def corduroy(swatch: Swatch) -> np.ndarray:
    """Returns ribs along the cloth."""
    ribs = band(swatch.u, 0.0045 + 0.003 * swatch.trait("wale width"), 0.45, max(0.0020, swatch.texel))
    return swatch.patterned(0.42 * ribs, 0.45 * swatch.first)


def denim(swatch: Swatch) -> np.ndarray:
    """Returns a twill of blue and white yarn, with streaks along the warp."""
    twill = band(swatch.u + 0.6 * swatch.v, 0.0035, 0.5, max(0.0015, swatch.texel))
    streaks, slubs = swatch.grain(0.0016, 0.030, layer=3), swatch.grain(0.004, 0.09, layer=4)
    share = 0.05 * twill + 0.16 + (0.06 + 0.06 * swatch.trait("streaks")) * streaks + 0.03 * slubs
    return swatch.patterned(share, 0.5 * swatch.first + 0.5 * np.array([0.48, 0.53, 0.60]))


def leather(swatch: Swatch) -> np.ndarray:
    """Returns pores and pale scuffs."""
    scuffs = np.clip(swatch.grain(0.03, 0.045, layer=1), 0, 2) ** 2
    pores = swatch.grain(0.003, 0.003, layer=0)
    return swatch.patterned(0.15 + 0.07 * pores + 0.05 * scuffs, 2.2 * swatch.first)


@dataclass(frozen=True)
class Weave:
    """A kind of fabric.

    Attributes:
        paint: its albedo (...,3) on a swatch, with even yarn and dye.
        warp, weft, flecks, blotches: standard deviations of ln albedo by which threads along and across the cloth,
            single stitches, and dye are uneven.
    """

    paint: Callable[[Swatch], np.ndarray]
    warp: float
    weft: float
    flecks: float
    blotches: float


WEAVES: dict[Kind, Weave] = {
    "plain": Weave(plain, 0.085, 0.10, 0.055, 0.055),
    "jersey": Weave(plain, 0.02, 0.04, 0.09, 0.055),
    "stripes": Weave(stripes, 0.05, 0.06, 0.06, 0.045),
    "fine stripes": Weave(fine_stripes, 0.05, 0.05, 0.04, 0.045),
    "pinstripe": Weave(pinstripe, 0.07, 0.05, 0.06, 0.045),
    "check": Weave(check, 0.06, 0.06, 0.06, 0.045),
    "print": Weave(lambda s: printed(s.fabric, s.u, s.v, s.offset), 0.05, 0.06, 0.05, 0.045),
    "logo": Weave(lambda s: emblem(s.fabric, s.panel, s.u, s.v, s.soft), 0.06, 0.06, 0.075, 0.05),
    "melange": Weave(melange, 0.04, 0.04, 0.07, 0.045),
    "tweed": Weave(tweed, 0.04, 0.04, 0.07, 0.045),
    "knit": Weave(knit, 0.05, 0.08, 0.08, 0.06),
    "corduroy": Weave(corduroy, 0.08, 0.02, 0.06, 0.06),
    "denim": Weave(denim, 0.04, 0.03, 0.05, 0.05),
    "leather": Weave(leather, 0.0, 0.0, 0.06, 0.07),
}


def unevenness(swatch: Swatch) -> np.ndarray:
    """Returns the logarithm (...) of the factor by which yarn and dye vary the albedo.

    It is a sum of six layers of noise, from single threads to blotches of a hand's size.
    """
    weave = WEAVES[swatch.fabric.kind]
    strength = 0.7 + 0.6 * swatch.trait("unevenness")
    linen = swatch.trait("linen")  # 1: long uneven threads, as in linen; 0: flecks instead
    yarn = 0.0012 + 0.0014 * swatch.trait("yarn width")  # width of a thread, metres
    log_factor = weave.warp * (0.25 + linen) * swatch.grain(yarn, 0.045, layer=31)
    log_factor = log_factor + weave.weft * (0.25 + linen) * swatch.grain(0.038, yarn, layer=32)
    log_factor += weave.flecks * (1.6 - linen) * swatch.grain(0.0022, 0.0030, layer=33)
    log_factor += weave.blotches * swatch.grain(0.0055, 0.0075, layer=34)
    log_factor += 0.6 * weave.blotches * swatch.grain(0.016, 0.021, layer=35)
    return strength * log_factor + 0.035 * swatch.grain(0.09, 0.13, layer=36)


def woven(swatch: Swatch) -> np.ndarray:
    """Returns the linear albedo (...,3) of a swatch: its pattern on uneven yarn."""
    color = WEAVES[swatch.fabric.kind].paint(swatch) * np.exp(unevenness(swatch))[..., None]
    return np.clip(color, 0.008, 0.88)
