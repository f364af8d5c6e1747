"""Contact sheets: every figure of a data set, its maps side by side, with its name."""

from pathlib import Path

import numpy as np
from PIL import Image

from relight.evaluation.canvas import CELL, FAINT, Canvas, ball, box_of, cut_out
from relight.evaluation.metrics import shade
from relight.files import UserError
from relight.lights import measure
from relight.maps import LeftOut, Maps, read_info, read_maps
from relight.photos.crop import fill_outside
from relight.progress import progress
from relight.srgb import encode

VIEWS = ("lit", "albedo", "normal", "AO", "shading")
CELL_HEIGHT = 240
ASPECT = 0.6  # of a cell: wide enough for all but spread arms, which are shown smaller
GAP, WORDS, TOP = 3, 26, 48
WIDTH = 2400  # pixels that a sheet should not exceed


def contact_sheet(maps_paths: list[Path], light: np.ndarray, out: Path, height: int = CELL_HEIGHT) -> None:
    """Draws figures side by side, each lit, its albedo, normals, AO and shading.

    Light and shading are linear and sRGB-encoded, white being the 99.5th percentile of a figure's shading; normals are
    shown as (n+1)/2. A figure that was left out has its reason in its place.

    Args:
        maps_paths: their maps (EXR).
        light: (K,3), which lights them.
        out: the picture (.png).
        height: of a cell, in pixels.

    Raises:
        UserError: there are no maps.
    """
    if not maps_paths:
        raise UserError(f"{out}: there are no maps to show")
    figures = [read(path) for path in progress(maps_paths, "maps read")]
    masks = [maps.mask for _, maps in figures if isinstance(maps, Maps)]
    rows = box_of(masks)[0] if masks else slice(0, 1)
    width = round(ASPECT * height)
    tile = len(VIEWS) * (width + GAP) + 6 * GAP
    across = max(1, min(len(figures), WIDTH // tile))
    down = -(-len(figures) // across)
    sheet = Canvas(across * tile + 3 * GAP, TOP + down * (height + WORDS))
    for a in range(across):
        for v, words in enumerate(VIEWS):
            sheet.text(words, 4 * GAP + a * tile + v * (width + GAP) + width // 2, TOP // 2, 16, "mm", bold=True)
    sheet.put(ball(light, TOP - 18, 1, linear=True), 4 * GAP + width // 2 + 20, 9)  # beside the word "lit"
    for i, (name, maps) in enumerate(figures):
        x, y = 4 * GAP + i % across * tile, TOP + i // across * (height + WORDS)
        sheet.text(name, x, y + height + 5, 14, color=FAINT)
        if isinstance(maps, Maps):
            for v, colors in enumerate(views(maps, light)):
                cell = Image.new("RGB", (width, height), CELL)
                # Extended, for pixels that a figure covers in part but not at their centre.
                cell.paste(*placed(fill_outside(colors, maps.mask), maps, rows, (width, height)))
                sheet.cell(cell, x + v * (width + GAP), y)
        else:
            room = len(VIEWS) * (width + GAP) - GAP
            sheet.cell(Image.new("RGB", (room, height), CELL), x, y)
            sheet.text(f"left out: {maps}", x + room // 2, y + height // 2, 15, "mm", color=FAINT, width=room - 40)
    sheet.save(out)


def clearest(lights: np.ndarray) -> np.ndarray:
    """Of lights (N,K,3) the one (K,3) that shows forms and colours best: directed, from the front, nearly white."""
    of = measure(lights)
    return lights[int(np.argmax(of["first"] + of["toward"] - np.abs(of["red"]) - np.abs(of["blue"])))]


def read(path: Path) -> tuple[str, Maps | str]:
    """The figure's name and its maps, or the reason for which it was left out."""
    name = read_info(path).get("name", Path(path).stem)
    try:
        return name, read_maps(path)
    except LeftOut as reason:
        return name, str(reason)


def placed(colors: np.ndarray, maps: Maps, rows: slice, size: tuple[int, int]) -> tuple[Image.Image, tuple[int, int]]:
    """The figure's own columns of a picture, and their place in a cell that `rows` fill, if they are not too wide."""
    box = rows, box_of([maps.mask])[1]
    high, wide = (side.stop - side.start for side in box)
    scale = min(size[1] / high, size[0] / wide)
    shown = max(1, round(wide * scale)), max(1, round(high * scale))
    return cut_out(colors[box], maps.coverage[box], shown), ((size[0] - shown[0]) // 2, size[1] - shown[1])


def views(maps: Maps, light: np.ndarray) -> list[np.ndarray]:
    """The pictures of VIEWS (H,W,3), display-coded."""
    shading = shade(maps.transport, light)
    white = max(1e-6, float(np.percentile(shading[maps.mask], 99.5)))
    grey = np.repeat(maps.ao[..., None], 3, -1)
    return [
        encode(maps.albedo * shading / white),
        encode(maps.albedo),
        (maps.normal + 1) / 2,
        grey,
        encode(shading / white),
    ]
