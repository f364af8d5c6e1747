"""Pictures of experiments: a row per figure, a column per thing to compare, lights as small spheres in the corner."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from relight.evaluation.canvas import FAINT, Sheet, box_of, cut_out, heat, light_sphere
from relight.evaluation.plates import Subject
from relight.srgb import encode

CELL_HEIGHT = 300  # pixels of a cell
GAP, GUTTER, TOP, LINE = 6, 120, 64, 24


@dataclass
class Cell:
    """colors (P,3) of the subject's pixels, or error (P,) in place of them; light (K,3): a sphere in the corner."""

    colors: np.ndarray | None = None
    error: np.ndarray | None = None
    light: np.ndarray | None = None


@dataclass
class Line:
    """A row of the panel; `apart`: with space above it."""

    label: str
    subject: Subject
    cells: list[Cell]
    apart: bool = False


def draw_panel(heads: list[str], lines: list[Line], linear: bool, worst: float, words: str) -> Sheet:
    """The sheet. Colours and lights are sRGB-encoded if `linear`; errors run to `worst`; `words` stand at the foot."""
    box = box_of([line.subject.mask for line in lines])
    tall, wide = box[0].stop - box[0].start, box[1].stop - box[1].start
    height, width = CELL_HEIGHT, max(100, round(CELL_HEIGHT * wide / tall))
    apart = 4 * GAP * sum(line.apart for line in lines)
    errors = any(cell.error is not None for line in lines for cell in line.cells)
    foot = LINE * (errors + 2) + 4 * GAP
    sheet = Sheet(GUTTER + len(heads) * (width + GAP) + GAP, TOP + len(lines) * (height + GAP) + apart + foot)
    for c, head in enumerate(heads):
        sheet.text(head, GUTTER + c * (width + GAP) + width // 2, TOP // 2, 17, "mm", bold=True, width=width)
    y = TOP
    for line in lines:
        y += 4 * GAP * line.apart
        s = line.subject
        sheet.text(line.label, GUTTER - 12, y + height // 2, 17, "rm", width=GUTTER - 20)
        for c, cell in enumerate(line.cells):
            x = GUTTER + c * (width + GAP)
            colors = heat(cell.error, worst) if cell.error is not None else coded(cell.colors, linear)
            sheet.cell(cut_out(s.dense(colors)[box], s.mask[box], (width, height)), x, y)
            if cell.light is not None:
                ball = light_sphere(cell.light, round(0.26 * width), s.white, linear)
                sheet.put(ball, x + width - ball.width - 5, y + 5)
        y += height + GAP
    if errors:
        bar = np.repeat(heat(np.linspace(0, worst, 160), worst)[None], 14, 0)
        sheet.put(Image.fromarray((bar * 255).round().astype(np.uint8)), GUTTER, y + 8)
        sheet.text(f"error, 0 to {worst:g} (vector norm)", GUTTER + 170, y + 5, 14, color=FAINT)
        y += LINE
    sheet.text(words, GUTTER, y + 8, 14, color=FAINT, width=sheet.image.width - GUTTER - 2 * GAP)
    return sheet


def coded(colors: np.ndarray, linear: bool) -> np.ndarray:
    """Values as they are shown: sRGB-encoded if they are linear, clipped otherwise."""
    return encode(np.clip(colors, 0, 1)) if linear else np.clip(colors, 0, 1)
