"""Pictures of masked maps side by side: cells, labels and the colours that maps are shown in."""

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from relight.files import atomic_write
from relight.lights import lit_ball
from relight.sh import unoccluded

PAPER, CELL, INK, FAINT = (255, 255, 255), (243, 243, 240), (28, 28, 30), (120, 120, 124)
MARGIN = 0.04  # of the picture's height, around figures


@lru_cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, from matplotlib's files: no font need be installed."""
    matplotlib = find_spec("matplotlib")
    assert matplotlib is not None and matplotlib.origin is not None
    folder = Path(matplotlib.origin).parent / "mpl-data" / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / f"DejaVuSans{'-Bold' if bold else ''}.ttf"), size)


def transport_bands(transport: np.ndarray) -> list[np.ndarray]:
    """Three pictures (...,3) in [0,1] of transport (...,K): how much light arrives (band 0, grey), from where
    (band 1: x, y, z as red, green, blue, 0 at middle grey), and how it is spread (band 2: xz, yz, 3z^2-1 alike)."""
    # The most that a surface without occlusion has: of x, y, z in the direction of each, of band 2 less, by its middle.
    peak = unoccluded(np.array([0.0, 0, 1]))[[0, 2, 6]]
    grey = np.repeat(transport[..., :1] / peak[0], 3, -1)
    return [grey.clip(0, 1)] + [
        (0.5 + 0.5 * transport[..., picks] / limit).clip(0, 1)
        for picks, limit in (([3, 1, 2], peak[1]), ([7, 5, 6], peak[2]))
    ]


def heat(error: np.ndarray, most: float) -> np.ndarray:
    """Maps errors to colours, from pale (none) over orange to dark red.

    Args:
        error: per pixel, any shape (...), not negative.
        most: the error that the darkest colour stands for; larger ones get it, too.

    Returns:
        (...,3) display-coded colours in [0,1].
    """
    stops = np.array([[0.97, 0.95, 0.90], [0.99, 0.70, 0.35], [0.80, 0.20, 0.15], [0.30, 0.02, 0.10]])
    place = np.clip(error / most, 0, 1) * (len(stops) - 1)
    return np.stack([np.interp(place, np.arange(len(stops)), channel) for channel in stops.T], -1)


def box_of(masks: list[np.ndarray]) -> tuple[slice, slice]:
    """Rows and columns that hold every mask (S,S) with a margin, the same for all so that figures keep their scale."""
    together = np.any(masks, 0)
    size = together.shape[0]
    pad = round(MARGIN * size)
    sides = []
    for axis in (1, 0):
        found = np.flatnonzero(together.any(axis))
        sides.append(slice(max(0, found[0] - pad), min(size, found[-1] + 1 + pad)))
    return sides[0], sides[1]


def cut_out(colors: np.ndarray, alpha: np.ndarray, size: tuple[int, int]) -> Image.Image:
    """Display-coded colours (H,W,3) in [0,1] on the cell's ground through alpha (H,W), at `size` (width, height)."""
    ground = np.array(CELL, np.float32) / 255
    alpha = np.asarray(alpha, np.float32)
    premultiplied = np.concatenate([np.clip(colors, 0, 1) * alpha[..., None], alpha[..., None]], -1)
    planes = [
        np.asarray(Image.fromarray(np.ascontiguousarray(plane, np.float32)).resize(size, Image.Resampling.BICUBIC))
        for plane in np.moveaxis(premultiplied, -1, 0)
    ]
    over = np.stack(planes[:3], -1) + (1 - planes[3][..., None]) * ground
    return Image.fromarray((over.clip(0, 1) * 255).round().astype(np.uint8))


def ball(light: np.ndarray, size: int, white: float, linear: bool) -> Image.Image:
    """A ball under a light, see `lights.lit_ball`, as an RGBA picture."""
    return Image.fromarray((lit_ball(light, size, white=white, linear=linear) * 255).round().astype(np.uint8))


class Canvas:
    """A white sheet on which cells and words are put."""

    def __init__(self, width: int, height: int):
        self.image = Image.new("RGB", (width, height), PAPER)
        self.draw = ImageDraw.Draw(self.image)

    def cell(self, picture: Image.Image, x: int, y: int, width: int | None = None, height: int | None = None) -> None:
        """Puts a picture in the middle of a cell with the ground's colour (the picture's own size if not given)."""
        width, height = width or picture.width, height or picture.height
        self.draw.rectangle((x, y, x + width - 1, y + height - 1), fill=CELL)
        self.put(picture, x + (width - picture.width) // 2, y + (height - picture.height) // 2)

    def put(self, picture: Image.Image, x: int, y: int) -> None:
        """Puts a picture on what is there, through its alpha if it has one."""
        self.image.paste(picture, (x, y), picture if picture.mode == "RGBA" else None)

    def text(
        self, words: str, x: int, y: int, size: int, anchor: str = "la", bold=False, color=INK, width=None
    ) -> None:
        """Writes words at (x,y), PIL's anchors; broken into lines and then shrunk to fit `width` pixels."""
        if width:
            words, size = fitted(words, size, width, bold)
        multiline = "\n" in words
        anchor = anchor.replace("t", "a") if multiline else anchor
        align = {"l": "left", "m": "center", "r": "right"}[anchor[0]]
        self.draw.text((x, y), words, color, font(size, bold), anchor=anchor, align=align, spacing=3)

    def save(self, path: Path) -> None:
        """PNG, whole or not at all."""
        with atomic_write(path) as tmp:
            self.image.save(tmp, "PNG", optimize=True)


def fitted(words: str, size: int, width: int, bold: bool) -> tuple[str, int]:
    """The words broken at blanks into lines of at most `width` pixels, at the largest size up to `size` that fits."""
    while True:
        lines = [""]
        for word in words.split():
            longer = f"{lines[-1]} {word}".strip()
            if font(size, bold).getlength(longer) <= width or not lines[-1]:
                lines[-1] = longer
            else:
                lines.append(word)
        if size <= 9 or all(font(size, bold).getlength(line) <= width for line in lines):
            return "\n".join(lines), size
        size -= 1
