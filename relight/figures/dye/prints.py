"""Prints on fabrics: scattered motifs, camouflage and tie-dye all over, and emblems with lettering at one place."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from relight.figures.draw.fabrics import Fabric, further_color, trait
from relight.figures.texture import band, lattice, mixed, noise

EDGE = 0.0012  # metres over which the edge of a motif is soft
# Block letters: bit 3 * row + column of each is set where the letter is, in five rows from the top by three columns.
GLYPHS = (31599, 29847, 29671, 31143, 29391, 4687, 31567, 23533, 29847, 24914, 23469, 29257, 23421, 23533, 31599)


def _motifs(shape: str, u: np.ndarray, v: np.ndarray, cell: float, seed: int) -> np.ndarray:
    """Returns the coverage (...) in [0,1] of scattered dots, flowers or leaves, one per cell of `cell` metres."""
    i = np.floor(u / cell)
    j = np.floor(v / cell + 0.5 * (i % 2))  # every other column is shifted by half a cell
    # From the motif's middle, in cells: each is up to an eighth of a cell off the middle of its cell.
    x = u / cell - i - 0.5 - 0.25 * (lattice(i, j, seed) - 0.5)
    y = v / cell + 0.5 * (i % 2) - j - 0.5 - 0.25 * (lattice(i, j, seed + 1) - 0.5)
    turn = 2 * np.pi * lattice(i, j, seed + 2)
    r, angle = np.hypot(x, y), np.arctan2(y, x) + turn
    if shape == "dots":
        size = np.full_like(r, 0.24)
    elif shape == "flowers":
        size = 0.30 * (0.7 + 0.3 * np.cos(5 * angle)) * (0.75 + 0.5 * lattice(i, j, seed + 3))
    else:
        size = 0.36 * np.abs(np.cos(angle)) ** 2.5 + 0.03
    inside = np.clip((size - r) * cell / EDGE + 0.5, 0, 1)
    heart = np.clip((0.07 - r) * cell / EDGE + 0.5, 0, 1) if shape == "flowers" else 0
    return inside - 0.6 * heart


def _camouflage(fabric: Fabric, u: np.ndarray, v: np.ndarray, size: float, offset: float) -> np.ndarray:
    """Returns patches (...,3) of three shades on the ground; `offset` makes those of panels differ."""
    first, second, seed = np.array(fabric.first), np.array(fabric.second), fabric.seed
    color = np.broadcast_to(first, (*u.shape, 3))
    shades = (first + (second - first) * 0.6, first + (second - first) * 1.0, 0.4 * first)
    for number, shade in enumerate(shades):
        coarse = noise(u / (0.07 * size) + offset, v / (0.05 * size), seed + number)
        fine = noise(u / (0.026 * size) + offset, v / (0.02 * size), seed + 10 + number)
        color = mixed(color, shade, np.clip((0.6 * coarse + 0.4 * fine - 0.55) / 0.03, 0, 1))
    return color


def _tie_dye(fabric: Fabric, u: np.ndarray, v: np.ndarray, offset: float) -> np.ndarray:
    """Returns rings (...,3) of the fabric's colors, with patches of a third; `offset` makes those of panels differ."""
    field = noise(u / 0.12 + offset, v / 0.09, fabric.seed)
    field = field + 0.5 * noise(u / 0.035 + offset, v / 0.03, fabric.seed + 1)
    rings = mixed(np.array(fabric.first), np.array(fabric.second), 0.5 + 0.5 * np.sin(9 * field))
    return mixed(rings, further_color(fabric, "third color"), np.clip(2.5 * field - 2.2, 0, 0.8))


def printed(fabric: Fabric, u: np.ndarray, v: np.ndarray, offset: float) -> np.ndarray:
    """Returns an all-over print (...,3): motifs in one or two colors, camouflage, or tie-dye.

    Args:
        fabric: its traits choose the print.
        u, v: (...) cloth coordinates, metres.
        offset: makes the prints of panels differ.
    """
    # 0 to 2: motifs of one shape; 3 to 5: of two shapes; 6: camouflage; 7: tie-dye.
    kind, size = int(trait(fabric, "print") * 8), fabric.size * (0.5 + 1.2 * trait(fabric, "print size") ** 2)
    if kind == 6:
        return _camouflage(fabric, u, v, size, offset)
    if kind == 7:
        return _tie_dye(fabric, u, v, offset)
    shapes, cell = ("dots", "flowers", "leaves"), 0.055 * size
    large = _motifs(shapes[kind % 3], u + offset, v, cell, fabric.seed)
    color = mixed(np.array(fabric.first), np.array(fabric.second), large)
    if kind < 3:
        return color
    shifted = u + offset + 0.37 * cell, v + 0.45 * cell
    small = _motifs(shapes[(kind + 1) % 3], *shifted, 0.61 * cell, fabric.seed + 50)
    return mixed(color, further_color(fabric, "third color"), 0.9 * np.clip(small, 0, 1))


def _lettering(x: np.ndarray, y: np.ndarray, seed: int, count: int) -> np.ndarray:
    """Returns the coverage (...) of a line of `count` block letters, each a unit square, centred at the origin."""
    x = x + count / 2
    number = np.floor(x)  # of the letter
    glyph = np.array(GLYPHS)[(lattice(number, 0 * number, seed) * len(GLYPHS)).astype(int)]
    column, row = np.floor((x - number) * 4), np.floor((0.5 - y) * 5)  # the fourth column is a space
    inside = (column < 3) & (row >= 0) & (row < 5) & (number >= 0) & (number < count)
    bit = np.clip(row * 3 + column, 0, 14).astype(int)
    return (inside & (np.right_shift(glyph, bit) & 1 == 1)).astype(float)


@dataclass(frozen=True)
class PrintArea:
    """The place of an emblem on a panel.

    Attributes:
        fabric: fabric of the panel.
        ground: (...,3) the panel's albedo without the emblem.
        v: (...) cloth coordinate along, metres.
        x, y: (...) coordinates from the emblem's centre, over its reach.
        reach: half the size of the emblem, metres.
        soft: metres over which its edges are soft.
    """

    fabric: Fabric
    ground: np.ndarray
    v: np.ndarray
    x: np.ndarray
    y: np.ndarray
    reach: float
    soft: float

    @property
    def second(self) -> np.ndarray:
        """Returns the color (3,) of the fabric's pattern."""
        return np.array(self.fabric.second)

    @property
    def third(self) -> np.ndarray:
        """Returns a further color (3,)."""
        return further_color(self.fabric, "third color")

    def cover(self, distance: np.ndarray) -> np.ndarray:
        """Returns the coverage (...) of a shape, given the signed distance from its edge over the reach."""
        return np.clip(0.5 - distance * self.reach / self.soft, 0, 1)

    def line(self, height: float, scale: float, seed: int, count: int) -> np.ndarray:
        """Returns the coverage (...) of a line of letters as wide as the emblem.

        Args:
            height: of its middle below the centre, over the reach.
            scale: factor by which letters are lower than the reach.
            seed: chooses the letters, with the fabric's.
            count: number of letters.
        """
        return _lettering(self.x * 0.5 * count / 1.2, (self.y + height) * scale, self.fabric.seed + seed, count)


def _ring_and_bar(area: PrintArea) -> np.ndarray:
    """Paints a ring with a bar in it."""
    ring = area.cover(np.abs(np.hypot(area.x, area.y) - 0.85) - 0.15)
    bar = area.cover(np.maximum(np.abs(area.x) - 0.45, np.abs(area.y) - 0.14))
    return mixed(area.ground, area.second, np.maximum(ring, bar))


def diamond(area: PrintArea) -> np.ndarray:
    """Paints the outline of a diamond."""
    outline = area.cover(np.abs(np.abs(area.y) + 1.2 * np.abs(area.x) - 0.68) - 0.22)
    return mixed(area.ground, area.second, outline)


def _bars(area: PrintArea) -> np.ndarray:
    """Paints a box of bars."""
    box = area.cover(np.maximum(np.abs(area.x) - 1.3, np.abs(area.y) - 0.8))
    return mixed(area.ground, area.second, band(area.v, 0.03, 0.5, area.soft) * box)


def word(area: PrintArea) -> np.ndarray:
    """Paints a word of four to eight letters."""
    count = 4 + int(5 * trait(area.fabric, "letters"))
    return mixed(area.ground, area.second, area.line(height=0.0, scale=1.6, seed=0, count=count))


def _two_lines(area: PrintArea) -> np.ndarray:
    """Paints a word with small print below it."""
    return mixed(word(area), area.third, area.line(height=0.55, scale=5.5, seed=1, count=14))


def _two_figures(area: PrintArea) -> np.ndarray:
    """Paints a number, as on a jersey."""
    return mixed(area.ground, area.second, _lettering(area.x * 0.9, area.y * 0.55, area.fabric.seed, count=2))


def star(area: PrintArea) -> np.ndarray:
    """Paints a star on a disc."""
    r, turn = np.hypot(area.x, area.y), np.arctan2(area.y, area.x)
    points = area.cover(r - 0.55 - 0.4 * np.cos(5 * (turn - np.pi / 2)))
    return mixed(mixed(area.ground, area.third, area.cover(r - 1.1)), area.second, points)


def _landscape(area: PrintArea) -> np.ndarray:
    """Paints a picture of a sun over hills, in a box."""
    x, y = area.x, area.y
    hill = area.cover(y + 0.25 + 0.5 * (noise(x * 1.7 + 9, 0 * x, area.fabric.seed) - 0.5))
    sky = np.broadcast_to(area.second, area.ground.shape)
    picture = mixed(sky, further_color(area.fabric, "fourth color"), np.clip(0.5 + 0.5 * y, 0, 1))
    picture = mixed(picture, area.third, area.cover(np.hypot(x - 0.2, y - 0.3) - 0.35))
    picture = mixed(picture, 0.4 * area.third, hill)
    return mixed(area.ground, picture, area.cover(np.maximum(np.abs(x), np.abs(y)) - 1))


def _chest_band(area: PrintArea) -> np.ndarray:
    """Paints a band across the chest, between two lines."""
    color = mixed(area.ground, area.second, area.cover(np.abs(area.y) - 0.5))
    return mixed(color, area.third, area.cover(np.abs(np.abs(area.y) - 0.72) - 0.07))


EMBLEMS: tuple[Callable[[PrintArea], np.ndarray], ...] = (
    _ring_and_bar, diamond, _bars, word, _two_lines, _two_figures, star, _landscape, _chest_band,
)  # fmt: skip


def emblem(fabric: Fabric, panel: str, u: np.ndarray, v: np.ndarray, soft: float) -> np.ndarray:
    """Returns a plain ground (...,3) with a print on the chest, large or small, or on the back, or on the sleeves.

    Args:
        fabric: its traits choose the emblem and its place.
        panel: its name.
        u, v: (...) cloth coordinates, metres.
        soft: metres over which edges are soft.
    """
    ground = np.broadcast_to(np.array(fabric.first), (*np.broadcast(u, v).shape, 3))
    place = trait(fabric, "emblem place")
    if "sleeve" in panel:
        if trait(fabric, "sleeve stripe") >= 0.25:
            return ground
        return mixed(ground, np.array(fabric.second), band(u, 0.024, 0.45, soft) * (np.abs(u) < 0.036))
    if (panel == "back") != (place > 0.85):
        return ground
    small = 0.55 < place < 0.85  # on one side of the chest; large ones are in its middle
    reach = (0.032 if small else 0.075 + 0.07 * trait(fabric, "emblem size")) * min(fabric.size, 1.3)
    x, y = (u - (0.085 if small else 0.0)) / reach, (v - (0.41 if small else 0.35)) / reach
    paint = EMBLEMS[int(trait(fabric, "emblem") * len(EMBLEMS))]
    return paint(PrintArea(fabric, ground, v, x, y, reach, soft))
