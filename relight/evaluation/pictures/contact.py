"""Draws contact sheets: the maps of every figure of a data set side by side, with its name; all lights of a set."""

import math
from contextlib import suppress
from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.progress import progress
from relight.core.srgb import encode
from relight.evaluation.pictures.canvas import CELL, FAINT, WHITE_PERCENTILE, Canvas, ball, bounding_box, composite
from relight.lights import LightSet, measure
from relight.lights.table import SPLITS
from relight.maps import LeftOut, Maps, read_maps
from relight.maps.square import fill_outside
from relight.photos.shading import shade

VIEWS = ("lit", "albedo", "normal", "AO", "shading")
CELL_HEIGHT = 240  # pixels
ASPECT = 0.6  # width over height of a cell; figures with spread arms are scaled down
GAP, WORDS, TOP = 3, 26, 48  # pixels: between cells, for a name, above the cells
WIDTH = 2400  # pixels, largest width of a sheet with several figures in a row
BALL, BALLS = 110, 10  # pixels of a ball, and balls in a row, on the sheet of lights


def contact_sheet(maps_paths: list[Path], light: np.ndarray, out: Path) -> None:
    """Draws figures side by side: lit, albedo, normals, AO and shading.

    Colors are sRGB-encoded; white is the 99.5th percentile of a figure's shading. Normals are displayed as (n+1)/2.
    Figures that were left out are not shown.

    Args:
        maps_paths: maps of the figures (EXR).
        light: (K,3).
        out: the picture (.png).

    Raises:
        UserError: if there are no maps.
    """
    figures = []
    for path in progress(maps_paths, "maps read"):
        with suppress(LeftOut):
            figures.append(read_maps(path))
    if not figures:
        raise UserError(f"{out}: there are no maps to show")
    rows, _ = bounding_box([maps.mask for maps in figures])  # of all figures
    height, width = CELL_HEIGHT, round(ASPECT * CELL_HEIGHT)
    tile = len(VIEWS) * (width + GAP) + 6 * GAP
    across = max(1, min(len(figures), WIDTH // tile))
    sheet = Canvas(across * tile + 3 * GAP, TOP + math.ceil(len(figures) / across) * (height + WORDS))
    for column in range(across):
        for v, words in enumerate(VIEWS):
            x = 4 * GAP + column * tile + v * (width + GAP) + width // 2
            sheet.text(words, x, TOP // 2, size=16, anchor="mm", bold=True)
    beside_lit = 4 * GAP + width // 2 + 20
    sheet.put(ball(light, TOP - 18, white=1, linear=True), beside_lit, y=9)
    for i, maps in enumerate(figures):
        x, y = 4 * GAP + i % across * tile, TOP + i // across * (height + WORDS)
        sheet.text(maps.info["name"], x, y + height + 5, size=14, color=FAINT)
        for v, colors in enumerate(views(maps, light)):
            # Extended to pixels that a figure covers in part, but not at their centre.
            sheet.put(_cell(fill_outside(colors, maps.mask), maps, rows, width), x + v * (width + GAP), y)
    sheet.save(out)


def light_sheet(lights: LightSet, out: Path) -> None:
    """Draws a light set: a ball for each light, all at the same exposure, with source, heading and broken rules."""
    parts = {f"{split}: {len(rows)}": rows for split in SPLITS if len(rows := np.flatnonzero(lights.split == split))}
    side = BALL + 2 * WORDS
    down = [math.ceil(len(rows) / BALLS) for rows in parts.values()]
    sheet, top = Canvas(BALLS * side, TOP * len(parts) + side * sum(down)), 0
    for (title, rows), count in zip(parts.items(), down):
        sheet.text(title, WORDS, top + TOP // 2, size=16, anchor="lm", bold=True)
        for i, row in enumerate(rows):
            x, y = i % BALLS * side + side // 2, top + TOP + i // BALLS * side
            sheet.cell(ball(lights.coefficients[row], BALL, white=2, linear=True), x - BALL // 2, y)
            words = f"{lights.source[row].rsplit('/', 1)[-1]} {lights.yaw[row]:.0f}° {lights.reason[row]}"
            sheet.text(words, x, y + BALL + GAP, size=12, anchor="mt", color=FAINT, width=side - 4 * GAP)
        top += TOP + count * side
    sheet.save(out)


def clearest_light(lights: np.ndarray) -> np.ndarray:
    """Returns the light (K,3) of lights (N,K,3) that is best for display: directed, from the front, nearly white."""
    statistics = measure(lights)
    directed = statistics["first"] + statistics["toward"]  # contrast, and how far it comes from the camera
    return lights[int(np.argmax(directed - np.abs(statistics["red"]) - np.abs(statistics["blue"])))]


def _cell(colors: np.ndarray, maps: Maps, rows: slice, width: int) -> Image.Image:
    """Returns a cell where a figure of colors (H,W,3) stands in the middle; `rows` fill it unless that is too wide."""
    box = rows, bounding_box([maps.mask])[1]
    box_height, box_width = (side.stop - side.start for side in box)
    scale = min(CELL_HEIGHT / box_height, width / box_width)
    size = max(1, round(box_width * scale)), max(1, round(box_height * scale))
    cell = Image.new("RGB", (width, CELL_HEIGHT), CELL)
    cell.paste(composite(colors[box], maps.coverage[box], size), ((width - size[0]) // 2, CELL_HEIGHT - size[1]))
    return cell


def views(maps: Maps, light: np.ndarray) -> list[np.ndarray]:
    """Returns a figure in each of VIEWS (H,W,3), display-coded, under a light (K,3)."""
    shading = shade(maps.transport, light)
    white = max(1e-6, float(np.percentile(shading[maps.mask], WHITE_PERCENTILE)))  # not 0, by which it divides
    lit, albedo, shading = map(encode, (maps.albedo * shading / white, maps.albedo, shading / white))
    return [lit, albedo, (maps.normal + 1) / 2, np.repeat(maps.ao[..., None], 3, -1), shading]
