"""Pictures of experiments: a row per figure and network, a column per view (as the paper's figures 5 and 7)."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from relight import config
from relight.evaluation.canvas import FAINT, Canvas, ball, box_of, cut_out, heat, transport_bands
from relight.evaluation.evaluate import chosen_pairs, dense, has_pairs, infer, load, pixels, truth
from relight.evaluation.labels import label
from relight.evaluation.metrics import Inferred, Truth, shade
from relight.evaluation.scores import gather
from relight.learning.data import RelitSet
from relight.progress import progress
from relight.srgb import encode

COLUMNS = (
    "picture",
    "albedo",
    "normal",
    "AO",
    "shading",
    "shading error",
    "light",
    "transport 0",
    "transport 1",
    "transport 2",
    "relit",
)
CELL_HEIGHT = 300  # pixels of a cell
GAP, GUTTER, TOP, LINE = 6, 150, 60, 24
WORST = 0.5  # shading error (vector norm) at the dark end of the scale
EXTREMES = 2  # figures at either end of the errors
LIGHTS = 8  # that a figure is relit by
NOTE = (
    "Picture: what the networks see (truth), and their albedo x shading. Normals (x, y, z as red, green, blue) and "
    "AO of the networks that infer them, empty where not. Relit: albedo and transport under the light "
    "of the small sphere. Transport by band of spherical harmonics: 0 how much light arrives; 1 from where (x, y, z as "
    "red, green, blue); 2 how it is spread (xz, yz, 3z²-1)."
)

NOTE_RELIT = (
    "Relit by the lights of the small spheres: the truth, and what each network makes of the first picture alone."
)


@dataclass
class Subject:
    """A test figure.

    Attributes:
        name: of the figure.
        truth: under the input light and the new one.
        pixel: (P,) flat indices of its mask into an image of `size` x `size`.
        white: the shading that is shown as white.
        linear: whether its colours are linear, and so sRGB-encoded where they are shown; else they are codes.
    """

    name: str
    truth: Truth
    pixel: np.ndarray
    size: int
    white: float
    linear: bool

    @classmethod
    def of(cls, data: RelitSet, figure: int, lights: np.ndarray) -> "Subject":
        """The figure of this index under the lights of these indices (N,)."""
        true = truth(data, figure, lights)
        white = max(1.0, float(np.percentile(true.maps["shading"], 99.5)))
        return cls(data.names[figure], true, pixels(data, figure), data.size, white, data.color == "photo")

    @property
    def mask(self) -> np.ndarray:
        """Where the figure is, (H,W) bool."""
        return dense(np.ones((len(self.pixel), 1)), self.pixel, self.size)[..., 0] > 0

    def picture(self, light: int) -> "View":
        """The true picture under its light of this number, with that light."""
        return View(self.truth.maps["reconstruction"][light], light=self.truth.lights[light])


@dataclass
class View:
    """What a cell shows.

    Attributes:
        colors: (P,3) of the subject's pixels.
        error: (P,), in their place.
        light: (K,3), a small sphere in the corner; alone it fills the cell, and without anything the cell stays empty.
        coded: whether the colours are display codes whatever the subject's are.
    """

    colors: np.ndarray | None = None
    error: np.ndarray | None = None
    light: np.ndarray | None = None
    coded: bool = False


@dataclass
class Line:
    """A row of views; `first`: of its subject, with space above it."""

    label: str
    subject: Subject
    views: list[View] = field(default_factory=list)
    first: bool = False


def draw(heads: list[str], lines: list[Line], worst: float | None, note: str) -> Canvas:
    """Draws rows of views, with heads above and a scale of errors below.

    Args:
        heads: of the columns.
        lines: the rows, with a view for each column.
        worst: the error at the dark end of the scale; None where no view is an error.
        note: what the views are.
    """
    box = box_of([line.subject.mask for line in lines])
    tall, wide = box[0].stop - box[0].start, box[1].stop - box[1].start
    height, width = CELL_HEIGHT, max(100, round(CELL_HEIGHT * wide / tall))
    apart = 4 * GAP * sum(line.first for line in lines)
    sheet = Canvas(GUTTER + len(heads) * (width + GAP) + GAP, TOP + len(lines) * (height + GAP) + apart + 4 * LINE)
    for c, head in enumerate(heads):
        sheet.text(head, GUTTER + c * (width + GAP) + width // 2, TOP // 2, 18, "mm", bold=True, width=width)
    y = TOP
    for line in lines:
        y += 4 * GAP * line.first
        sheet.text(line.label, GUTTER - 14, y + height // 2, 18, "rm", bold=line.first, width=GUTTER - 24)
        for c, view in enumerate(line.views):
            draw_view(sheet, view, line.subject, box, GUTTER + c * (width + GAP), y, (width, height), worst)
        y += height + GAP
    if worst:
        bar = np.repeat(heat(np.linspace(0, worst, 160), worst)[None], 14, 0)
        sheet.put(Image.fromarray((bar * 255).round().astype(np.uint8)), GUTTER, y + 8)
        sheet.text(f"error, 0 to {worst:g} (vector norm)", GUTTER + 170, y + 5, 14, color=FAINT)
    sheet.text(note, GUTTER, y + LINE + 8, 14, color=FAINT, width=sheet.image.width - GUTTER - 2 * GAP)
    return sheet


def draw_view(
    sheet: Canvas,
    view: View,
    subject: Subject,
    box: tuple[slice, slice],
    x: int,
    y: int,
    size: tuple[int, int],
    worst: float | None,
) -> None:
    """Draws a view of a subject.

    Args:
        sheet: to draw on.
        view: what is shown.
        subject: whose pixels these are.
        box: rows and columns of its image that are shown.
        x, y: place of the cell on the sheet.
        size: width and height of the cell in pixels.
        worst: the error at the dark end of the scale.
    """
    width, height = size
    if view.colors is not None:
        colors = view.colors if view.coded else np.clip(view.colors, 0, 1)
        colors = encode(colors) if subject.linear and not view.coded else colors
    elif view.error is not None and worst is not None:
        colors = heat(view.error, worst)
    else:
        if view.light is not None:
            sheet.cell(ball(view.light, round(0.8 * width), subject.white, subject.linear), x, y, width, height)
        return
    sheet.cell(cut_out(dense(colors, subject.pixel, subject.size)[box], subject.mask[box], size), x, y)
    if view.light is not None:
        corner = ball(view.light, round(0.26 * width), subject.white, subject.linear)
        sheet.put(corner, x + width - corner.width - 5, y + 5)


def plates(
    networks: dict[str, Path], packed: Path, lights: Path, split: Path, settings: config.Evaluate, out: Path
) -> None:
    """Draws `settings.plates` figures, spread over those of `settings.figures`, as a PNG: truth, then each network.

    Each figure is seen under one light of `settings.lights` and relit by the next. Values are shown sRGB-encoded where
    the network's colour model is linear (photo) and as they are where it takes coded values as linear (paper); what no
    loss asked for is the truth.

    Args:
        networks: row -> checkpoint.
        packed, lights, split: the data, as for `evaluate.evaluate`.
        settings: which figures, lights, and how many.
        out: the picture (.png).

    Raises:
        UserError: as `evaluate.evaluate`.
    """
    draw_plates(networks, packed, lights, split, settings, lambda names: spaced(len(names), settings.plates), out)


def overview(
    networks: dict[str, Path], packed: Path, lights: Path, split: Path, settings: config.Evaluate, out: Path
) -> None:
    """The same for one figure and the last network."""
    last = dict([list(networks.items())[-1]])
    draw_plates(last, packed, lights, split, settings, lambda names: [len(names) // 2], out)


def extremes(
    networks: dict[str, Path],
    scores: list[Path],
    packed: Path,
    lights: Path,
    split: Path,
    settings: config.Evaluate,
    out: Path,
) -> None:
    """The same for the figures with the least and the largest shading error, mean over the networks.

    scores: those of the networks, on the figures and lights of `settings`.
    """
    found = [one for trainings in gather(scores).values() for one in trainings]

    def ends(names: list[str]) -> list[int]:
        means = dict(zip(found[0].figures, np.mean([one.figure_means("shading_rmse") for one in found], 0)))
        order = sorted(range(len(names)), key=lambda place: means[names[place]])
        return list(dict.fromkeys([*order[:EXTREMES], *order[-EXTREMES:]]))

    draw_plates(networks, packed, lights, split, settings, ends, out)


def relit(
    networks: dict[str, Path], packed: Path, lights: Path, split: Path, settings: config.Evaluate, out: Path
) -> None:
    """Draws one figure relit by up to LIGHTS lights of `settings.lights` as a PNG: truth, then each network.

    Args:
        networks: row -> checkpoint.
        packed, lights, split: the data, as for `evaluate.evaluate`.
        settings: which figures and lights.
        out: the picture (.png).

    Raises:
        UserError: as `evaluate.evaluate`.
    """
    lines: list[Line] = []
    for name, checkpoint in progress(list(networks.items()), "networks relit"):
        network, data = load(checkpoint, packed, lights, settings)
        if not has_pairs(data, split, settings):
            break
        figures, lit = chosen_pairs(data, split, settings.lights, settings.figures)
        figure, chosen = int(figures[len(figures) // 2]), lit[spaced(len(lit), LIGHTS)]
        if not lines:
            one = Subject.of(data, figure, chosen)
            lines = [Line(f"truth {one.name}", one, [one.picture(light) for light in range(len(chosen))], first=True)]
        one = lines[0].subject
        inferred = infer(network, data, figure, chosen[:1])
        albedo, transport, light = (values[0] for values in one.truth.complete(inferred))
        shadings = [shade(transport, each) for each in (light, *one.truth.lights[1:])]
        lines.append(Line(label(name), one, [View(albedo * shading) for shading in shadings]))
    if not lines:
        return empty_sheet().save(out)
    heads = ["picture", *(f"relit {light}" for light in range(1, len(lines[0].views)))]
    draw(heads, lines, None, NOTE_RELIT).save(out)


def draw_plates(
    networks: dict[str, Path],
    packed: Path,
    lights: Path,
    split: Path,
    settings: config.Evaluate,
    choose: Callable[[list[str]], list[int]],
    out: Path,
) -> None:
    """Draws the figures whose places `choose` picks from the names of those that are tested."""
    blocks: list[list[Line]] = []
    for name, checkpoint in progress(list(networks.items()), "networks drawn"):
        network, data = load(checkpoint, packed, lights, settings)
        if not has_pairs(data, split, settings):
            break
        figures, lit = chosen_pairs(data, split, settings.lights, settings.figures)
        chosen = figures[choose([data.names[f] for f in figures])].tolist()
        pairs = [(f, lit[[i % len(lit), (i + 1) % len(lit)]]) for i, f in enumerate(chosen)]
        if not blocks:
            subjects = [Subject.of(data, *pair) for pair in pairs]
            blocks = [[Line(f"truth {one.name}", one, true_views(one), first=True)] for one in subjects]
        for block, (figure, two) in zip(blocks, pairs):
            one = block[0].subject
            block.append(Line(label(name), one, inferred_views(one, infer(network, data, figure, two[:1]))))
    if not blocks:
        return empty_sheet().save(out)
    draw(list(COLUMNS), [line for block in blocks for line in block], WORST, NOTE).save(out)


def empty_sheet() -> Canvas:
    """A sheet that says that there is nothing to show."""
    sheet = Canvas(2 * GUTTER, TOP)
    sheet.text("nothing to show", GUTTER, TOP // 2, 15, "mm", color=FAINT)
    return sheet


def spaced(items: int, count: int) -> list[int]:
    """At most `count` places among `items`, from first to last."""
    return np.unique(np.linspace(0, items - 1, count).round().astype(int)).tolist()


def true_views(s: Subject) -> list[View]:
    """The views of COLUMNS, the mask in the place of an error."""
    made = views(s, s.truth.maps["albedo"][0], s.truth.transport[0], *s.truth.lights)
    made["shading error"] = View(np.full((len(s.pixel), 3), 0.2), coded=True)
    made["relit"].light = s.truth.lights[1]
    made |= surface_views(s.truth.maps["normal"][0], s.truth.maps["ao"][0, :, 0])
    return [made[column] for column in COLUMNS]


def inferred_views(s: Subject, inferred: Inferred) -> list[View]:
    """The views of COLUMNS of what a network infers of the subject in its first light."""
    albedo, transport, light = s.truth.complete(inferred)
    made = views(s, albedo[0], transport[0], light[0], s.truth.lights[1])
    made |= surface_views(*(None if part is None else part[0] for part in (inferred.normal, inferred.ao)))
    return [made[column] for column in COLUMNS]


def surface_views(normal: np.ndarray | None, ao: np.ndarray | None) -> dict[str, View]:
    """Normals (P,3) as colours and ambient occlusion (P,) as grey; empty views in the place of None."""
    return {
        "normal": View() if normal is None else View((normal + 1) / 2, coded=True),
        "AO": View() if ao is None else View(np.repeat(ao[:, None].clip(0, 1), 3, 1), coded=True),
    }


def views(s: Subject, albedo: np.ndarray, transport: np.ndarray, light: np.ndarray, new: np.ndarray) -> dict[str, View]:
    """All views of COLUMNS but for those of the surface."""
    shading = shade(transport, light)
    error = np.linalg.norm(shading - s.truth.maps["shading"][0], axis=-1)
    return {
        "picture": View(albedo * shading),
        "albedo": View(albedo),
        "shading": View(shading / s.white),
        "shading error": View(error=error),
        "light": View(light=light),
        **{f"transport {band}": View(colors, coded=True) for band, colors in enumerate(transport_bands(transport))},
        "relit": View(albedo * shade(transport, new)),
    }
