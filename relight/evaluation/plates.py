"""The qualitative figure: what each network makes of test figures, beside the truth (the paper's figures 5 and 7)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from relight import config
from relight.evaluation.canvas import FAINT, Sheet, box_of, cut_out, heat, light_sphere, transport_bands
from relight.evaluation.evaluate import chosen_pairs, infer, load, nothing, truth
from relight.evaluation.metrics import Inferred, Truth, shade
from relight.evaluation.tables import LABELS
from relight.learning.data import RelitSet
from relight.progress import progress
from relight.srgb import encode

HEAD = ("picture", "albedo", "shading", "shading error", "light", "transport 0", "transport 1", "transport 2", "relit")
CELL_HEIGHT = 300  # pixels of a cell
GAP, GUTTER, TOP, FOOT = 6, 150, 60, 76
WORST = 0.5  # shading error (vector norm) at the dark end of the scale


@dataclass
class Subject:
    """A test figure with its truth under the input light and the new one; pixel: flat indices (P,) of its mask."""

    name: str
    truth: Truth
    pixel: np.ndarray
    size: int
    white: float  # shading that is shown as white

    def dense(self, values: np.ndarray) -> np.ndarray:
        """(P,C) -> (S,S,C), zero outside the mask."""
        image = np.zeros((self.size**2, values.shape[-1]), np.float32)
        image[self.pixel] = values
        return image.reshape(self.size, self.size, -1)

    @property
    def mask(self) -> np.ndarray:
        return self.dense(np.ones((len(self.pixel), 1)))[..., 0] > 0


def plates(
    checkpoints: dict[str, Path], packed: Path, lights: Path, split: Path, settings: config.Evaluate, out: Path
) -> None:
    """Draws `settings.plates` figures, spread over those of `settings.figures`, as a PNG: rows of truth and networks.

    checkpoints: row name (see tables.LABELS) -> network. Each figure is seen under one light of `settings.lights` and
    relit by the next. Values are shown sRGB-encoded where the network's colour model is linear (photo) and as they are
    where it takes coded values as linear (paper); what no loss asked for is the truth. Raises UserError as `evaluate`.
    """
    subjects: list[Subject] = []
    rows: dict[str, list[list]] = {}
    linear = False
    for name, checkpoint in progress(list(checkpoints.items()), "networks drawn"):
        network, data = load(checkpoint, packed, lights, settings)
        if nothing(data, split, settings):
            break
        figures, lit = chosen_pairs(data, split, settings.lights, settings.figures)
        chosen = figures[np.unique(np.linspace(0, len(figures) - 1, settings.plates).round().astype(int))]
        pairs = [(f, lit[[i % len(lit), (i + 1) % len(lit)]]) for i, f in enumerate(chosen.tolist())]
        if not subjects:
            subjects, linear = [subject(data, f, two) for f, two in pairs], data.color == "photo"
        label = LABELS.get(name, name)
        rows[label] = [
            inferred_cells(s, infer(network, data, f, two[:1]), linear) for s, (f, two) in zip(subjects, pairs)
        ]
    if not subjects:
        sheet = Sheet(GUTTER, TOP)
        sheet.text("nothing to show", GUTTER // 2, TOP // 2, 15, "mm", color=FAINT)
        return sheet.save(out)
    draw(subjects, {"truth": [true_cells(s, linear) for s in subjects], **rows}, linear).save(out)


def subject(data: RelitSet, figure: int, lit: np.ndarray) -> Subject:
    start, count = int(data.offset[figure]), int(data.counts[figure])
    true = truth(data, figure, lit)
    white = max(1.0, float(np.percentile(true.maps["shading"], 99.5)))
    return Subject(data.names[figure], true, data.pixel[start : start + count].cpu().numpy(), data.size, white)


def maps_of(s: Subject, albedo, transport, light, new, linear: bool, error) -> list[np.ndarray]:
    """The cells of a row, (P,3) display-coded, or (K,3) for the light."""
    code = encode if linear else (lambda values: np.clip(values, 0, 1))
    shading = shade(transport, light)
    relit = albedo * shade(transport, new)
    bands = transport_bands(transport)
    return [code(albedo * shading), code(albedo), code(shading / s.white), error, light, *bands, code(relit)]


def true_cells(s: Subject, linear: bool) -> list[np.ndarray]:
    transport, albedo = s.truth.transport[0], s.truth.maps["albedo"][0]
    mask = np.full((len(s.pixel), 3), 0.2)
    return maps_of(s, albedo, transport, *s.truth.lights, linear, mask)


def inferred_cells(s: Subject, inferred: Inferred, linear: bool) -> list[np.ndarray]:
    transport = inferred.transport[0] * (inferred.ao[0][:, None] if inferred.occlude else 1)
    albedo = (s.truth.maps["albedo"] if inferred.albedo is None else inferred.albedo)[0]
    light = (s.truth.lights if inferred.light is None else inferred.light)[0]
    error = heat(np.linalg.norm(shade(transport, light) - s.truth.maps["shading"][0], axis=-1), WORST)
    return maps_of(s, albedo, transport, light, s.truth.lights[1], linear, error)


def draw(subjects: list[Subject], rows: dict[str, list[list]], linear: bool) -> Sheet:
    """Lays out the sheet: a block per figure, a line per row, a column per entry of HEAD."""
    box = box_of([s.mask for s in subjects])
    tall, wide = box[0].stop - box[0].start, box[1].stop - box[1].start
    height, width = CELL_HEIGHT, round(CELL_HEIGHT * wide / tall)
    block = len(rows) * (height + GAP) + 4 * GAP
    sheet = Sheet(GUTTER + len(HEAD) * (width + GAP) + GAP, TOP + len(subjects) * block + FOOT)
    for c, words in enumerate(HEAD):
        sheet.text(words, GUTTER + c * (width + GAP) + width // 2, TOP // 2, 18, "mm", bold=True, width=width)
    for b, s in enumerate(subjects):
        for r, (label, cells) in enumerate(rows.items()):
            y = TOP + b * block + r * (height + GAP)
            sheet.text(label, GUTTER - 14, y + height // 2, 19, "rm", bold=r == 0, width=GUTTER - 24)
            if r == 0:
                sheet.text(s.name, GUTTER - 14, y + height // 2 + 28, 15, "rm", color=FAINT, width=GUTTER - 24)
            for c, values in enumerate(cells[b]):
                x = GUTTER + c * (width + GAP)
                if HEAD[c] == "light":
                    sheet.cell(light_sphere(values, round(0.8 * width), s.white, linear), x, y, width, height)
                    continue
                sheet.cell(cut_out(s.dense(values)[box], s.mask[box], (width, height)), x, y)
                if r == 0 and HEAD[c] == "relit":
                    ball = light_sphere(s.truth.lights[1], round(0.24 * width), s.white, linear)
                    sheet.put(ball, x + width - ball.width - 5, y + 5)
                if r == 0 and HEAD[c] == "shading error":
                    sheet.text("mask", x + 7, y + 6, 14, color=FAINT)
    legend(sheet, TOP + len(subjects) * block)
    return sheet


def legend(sheet: Sheet, y: int) -> None:
    """What the columns show, and the scale of the errors."""
    bar = np.repeat(heat(np.linspace(0, WORST, 160), WORST)[None], 14, 0)
    sheet.put(Image.fromarray((bar * 255).round().astype(np.uint8)), GUTTER, y + 4)
    sheet.text(f"shading error, 0 to {WORST}", GUTTER + 170, y + 1, 14, color=FAINT)
    words = (
        "Picture: what the networks see (truth), and their albedo x shading. Relit: albedo and transport under the "
        "light of the small sphere. Transport by band of spherical harmonics: 0 how much light arrives; 1 from where "
        "(x, y, z as red, green, blue); 2 how it is spread (xz, yz, 3z²-1)."
    )
    sheet.text(words, GUTTER, y + 28, 14, color=FAINT, width=sheet.image.width - GUTTER - 2 * GAP)
