"""Draws sheets of masked maps: cells, labels, and the display colors of maps."""

from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from relight.core.files import atomic_write
from relight.core.srgb import to_bytes
from relight.lights import lit_ball
from relight.maps.square import extent
from relight.sh import unoccluded

PAPER, CELL, INK, FAINT = (255, 255, 255), (243, 243, 240), (28, 28, 30), (120, 120, 124)
MARGIN = 0.04  # of the picture's height, around figures
WHITE_PERCENTILE = 99.5  # of a figure's shading, which is displayed as white
MIN_FONT = 9  # pixels, to which text is shrunk at most


@lru_cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Loads DejaVu Sans from matplotlib's files, so that no font need be installed."""
    file = Path(matplotlib.get_data_path(), "fonts", "ttf", f"DejaVuSans{'-Bold' if bold else ''}.ttf")
    return ImageFont.truetype(str(file), size)


def transport_bands(transport: np.ndarray) -> list[np.ndarray]:
    """Returns pictures (...,3) in [0,1] of bands 0 to 2 of transport (...,K).

    Band 0, the amount of light that arrives, is grey. Band 1, the direction from which it arrives, has x, y, z as red,
    green, blue, with 0 at middle grey. Band 2 has xz, yz, 3z^2-1 likewise.
    """
    # Values of an unoccluded surface that faces +z: the largest of band 0, and of z in band 1.
    peak = unoccluded(np.array([0.0, 0, 1]))[[0, 2, 6]]
    grey = np.repeat(transport[..., :1] / peak[0], 3, -1)
    return [grey.clip(0, 1)] + [
        (0.5 + 0.5 * transport[..., picks] / limit).clip(0, 1)
        for picks, limit in (([3, 1, 2], peak[1]), ([7, 5, 6], peak[2]))
    ]


def heat(error: np.ndarray, max_error: float) -> np.ndarray:
    """Returns display colors (...,3) in [0,1] of errors (...): pale for 0, over orange to dark red for `max_error`."""
    stops = np.array([[0.97, 0.95, 0.90], [0.99, 0.70, 0.35], [0.80, 0.20, 0.15], [0.30, 0.02, 0.10]])
    position = np.clip(error / max_error, 0, 1) * (len(stops) - 1)
    return np.stack([np.interp(position, np.arange(len(stops)), channel) for channel in stops.T], -1)


def bounding_box(masks: list[np.ndarray]) -> tuple[slice, slice]:
    """Returns the rows and columns of the common bounding box of masks (S,S), with a margin."""
    union = np.any(masks, axis=0)
    size = len(union)
    margin = round(MARGIN * size)
    rows, columns = (slice(max(0, first - margin), min(size, stop + margin)) for first, stop in extent(union))
    return rows, columns


def composite(colors: np.ndarray, alpha: np.ndarray, size: tuple[int, int]) -> Image.Image:
    """Composites sRGB-coded colors (H,W,3) by alpha (H,W) over the background of cells, at a size (width, height)."""
    rgba = Image.fromarray(to_bytes(np.dstack([colors, alpha]))).resize(size, Image.Resampling.BICUBIC)
    picture = Image.new("RGB", size, CELL)
    picture.paste(rgba, mask=rgba)
    return picture


def ball(light: np.ndarray, size: int, white: float, linear: bool) -> Image.Image:
    """Draws a diffuse white ball of `size` pixels under a light (K,3), RGBA; arguments are those of `lit_ball`."""
    return Image.fromarray(to_bytes(lit_ball(light, size, white=white, linear=linear)))


class Canvas:
    """A white sheet for cells and words."""

    def __init__(self, width: int, height: int):
        self.image = Image.new("RGB", (width, height), PAPER)
        self.draw = ImageDraw.Draw(self.image)

    def cell(self, picture: Image.Image, x: int, y: int, width: int | None = None, height: int | None = None) -> None:
        """Draws a cell at (x,y) with a picture in its middle; pixels; its size is that of the picture by default."""
        width, height = width or picture.width, height or picture.height
        self.draw.rectangle((x, y, x + width - 1, y + height - 1), fill=CELL)
        self.put(picture, x + (width - picture.width) // 2, y + (height - picture.height) // 2)

    def put(self, picture: Image.Image, x: int, y: int) -> None:
        """Pastes a picture with its top left corner at (x,y), pixels, by its alpha if it has one."""
        self.image.paste(picture, (x, y), picture if picture.mode == "RGBA" else None)

    def text(
        self,
        words: str,
        x: int,
        y: int,
        size: int,
        anchor: str = "la",
        bold: bool = False,
        color: tuple[int, int, int] = INK,
        width: int | None = None,
    ) -> None:
        """Draws words.

        Args:
            words: the text.
            x, y: of the anchor, pixels.
            size: of the font, pixels.
            anchor: what of the text is there, such as "mm" for its middle (Pillow's text anchors).
            bold: whether the font is bold.
            color: RGB, 0 to 255.
            width: pixels that the text may take; it is broken into lines and shrunk to fit. None for any.
        """
        if width:
            words, size = fit_text(words, size, width, bold)
        if "\n" in words:  # for which Pillow does not have the anchor "top"
            anchor = anchor.replace("t", "a")
        align = {"l": "left", "m": "center", "r": "right"}[anchor[0]]
        self.draw.text((x, y), words, color, font(size, bold), anchor=anchor, align=align, spacing=3)

    def save(self, path: Path) -> None:
        """Writes the sheet as a PNG, atomically."""
        with atomic_write(path) as tmp:
            self.image.save(tmp, "PNG", optimize=True)


def fit_text(words: str, size: int, width: int, bold: bool) -> tuple[str, int]:
    """Breaks words into lines of `width` pixels, in the largest font up to `size` in which no word is longer.

    Returns:
        The lines as one text, and the size of the font.
    """
    while True:
        lines = [""]
        for word in words.split():
            longer = f"{lines[-1]} {word}".strip()
            if font(size, bold).getlength(longer) <= width or not lines[-1]:
                lines[-1] = longer
            else:
                lines.append(word)
        if size <= MIN_FONT or all(font(size, bold).getlength(line) <= width for line in lines):
            return "\n".join(lines), size
        size -= 1
