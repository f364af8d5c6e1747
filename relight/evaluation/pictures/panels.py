"""Draws the plates of experiments: a row per figure and network, a column per view (as the paper's figures 5 and 7)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.progress import progress
from relight.core.srgb import encode
from relight.evaluation.pictures import canvas
from relight.evaluation.pictures.canvas import FAINT, Canvas
from relight.evaluation.scoring.evaluate import dense, infer, load, pixels, select_pairs, truth
from relight.evaluation.scoring.truth import Inferred
from relight.learning.data import RelitSet
from relight.photos.shading import shade

COLUMNS = (
    "picture", "albedo", "normal", "AO", "shading", "shading error", "light",
    "transport 0", "transport 1", "transport 2", "relit",
)  # fmt: skip
CELL_HEIGHT = 300  # pixels
LARGE_BALL, SMALL_BALL = 0.8, 0.26  # diameter over the width of a cell: alone in it, and in its corner
GAP, GUTTER, TOP, LINE = 6, 150, 60, 24  # pixels: between cells, left of them, above them, of a line of text
MAX_ERROR = 0.5  # error (vector norm) at the dark end of the color scale
LIGHTS = 8  # number of lights by which a figure is relit
PLATE_FIGURES, SWAPS = 6, 3  # test figures on a plate, and pairs of them that swap lights
NOTE = (
    "Picture: what the networks see (truth), and their albedo x shading. Normals (x, y, z as red, green, blue) and "
    "AO of the networks that infer them, empty where not. Relit: albedo and transport under the light "
    "of the small sphere. Transport by band of spherical harmonics: 0 how much light arrives; 1 from where (x, y, z as "
    "red, green, blue); 2 how it is spread (xz, yz, 3z²-1)."
)
NOTE_RELIT = (
    "Relit by the lights of the small spheres: the truth, and what each network makes of the first picture alone."
)
NOTE_SWAPPED = (
    "Two people in two lights, each relit by the light inferred from the other's picture. The spheres show the light "
    "of each picture: the true one in picture and truth, the inferred one where it was relit."
)
NOTE_SHADINGS = (
    "Each network infers normals or light transport from the picture; its shading here is under the true light (small "
    "sphere), so that only occlusion and shape are compared."
)


class Subject:
    """A figure of a data set under N lights.

    Attributes:
        name: name of the figure.
        truth: under these lights.
        pixel: (P,) flat indices of the mask in an image of `size` x `size`.
        size: side of the image, pixels.
        white: the shading that is displayed as white.
        linear: whether colors are linear and must be sRGB-encoded for display.
    """

    def __init__(self, data: RelitSet, figure: int, lights: np.ndarray):
        """Takes a figure and lights (N,), by their indices in the set; the first light is that of the input."""
        self.name, self.size, self.linear = data.names[figure], data.size, data.color == "photo"
        self.truth, self.pixel = truth(data, figure, lights), pixels(data, figure)
        self.white = max(1.0, float(np.percentile(self.truth.maps["shading"], canvas.WHITE_PERCENTILE)))

    @property
    def mask(self) -> np.ndarray:
        """The mask (H,W) bool."""
        return dense(np.ones((len(self.pixel), 1)), self.pixel, self.size)[..., 0] > 0

    def picture(self, light: int) -> "Cell":
        """Returns the true picture under light number `light` of the subject, from 0, with the light in the corner."""
        return Cell(self.truth.maps["reconstruction"][light], light=self.truth.lights[light])


@dataclass
class Cell:
    """The content of a cell; without attributes the cell is empty.

    Attributes:
        colors: (P,3) of the subject's pixels.
        error: (P,) of the subject's pixels, displayed in place of colors.
        light: (K,3), displayed as a small sphere in the corner, or as a large one if there is nothing else.
        coded: whether `colors` are display codes, even if the subject's are linear.
    """

    colors: np.ndarray | None = None
    error: np.ndarray | None = None
    light: np.ndarray | None = None
    coded: bool = False


@dataclass
class Line:
    """A row of views.

    Attributes:
        label: label of the row.
        subject: whose views these are.
        views: one for each column.
        first: whether it is the first row of its subject, which has space above it.
    """

    label: str
    subject: Subject
    views: list[Cell] = field(default_factory=list)
    first: bool = False


def draw(heads: list[str], lines: list[Line], note: str) -> Canvas:
    """Draws rows of views, with heads above and, if a view is an error, the scale of errors below.

    Args:
        heads: titles of the columns, of which there may be too many.
        lines: the rows, with a view for each column; the sheet says so if there are none.
        note: explains the views.
    """
    if not lines:
        sheet = Canvas(4 * GUTTER, TOP)
        sheet.text(
            "nothing to show: too few figures or lights", 2 * GUTTER, TOP // 2, size=15, anchor="mm", color=FAINT
        )
        return sheet
    heads = heads[: len(lines[0].views)]
    box = canvas.bounding_box([line.subject.mask for line in lines])
    box_height, box_width = box[0].stop - box[0].start, box[1].stop - box[1].start
    height, width = CELL_HEIGHT, max(100, round(CELL_HEIGHT * box_width / box_height))
    spacing = 4 * GAP * sum(line.first for line in lines)
    sheet = Canvas(GUTTER + len(heads) * (width + GAP) + GAP, TOP + len(lines) * (height + GAP) + spacing + 4 * LINE)
    for c, head in enumerate(heads):
        middle = GUTTER + c * (width + GAP) + width // 2, TOP // 2
        sheet.text(head, *middle, size=18, anchor="mm", bold=True, width=width)
    y = TOP
    for line in lines:
        y += 4 * GAP * line.first
        left_of_cells = GUTTER - 14, y + height // 2
        sheet.text(line.label, *left_of_cells, size=18, anchor="rm", bold=line.first, width=GUTTER - 24)
        for c, view in enumerate(line.views):
            _draw_view(sheet, view, line.subject, box, (GUTTER + c * (width + GAP), y), (width, height))
        y += height + GAP
    if any(view.error is not None for line in lines for view in line.views):
        color_scale = np.repeat(canvas.heat(np.linspace(0, MAX_ERROR, 160), MAX_ERROR)[None], 14, 0)  # 160 x 14 pixels
        sheet.put(Image.fromarray((color_scale * 255).round().astype(np.uint8)), GUTTER, y + 8)
        sheet.text(f"error, 0 to {MAX_ERROR:g} (vector norm)", GUTTER + 170, y + 5, size=14, color=FAINT)
    sheet.text(note, GUTTER, y + LINE + 8, size=14, color=FAINT, width=sheet.image.width - GUTTER - 2 * GAP)
    return sheet


def _draw_view(
    sheet: Canvas, view: Cell, subject: Subject, box: tuple[slice, slice], place: tuple[int, int], size: tuple[int, int]
) -> None:
    """Draws the part `box` (rows, columns) of a view of a subject in a cell of a sheet, at a place (x,y)."""
    (x, y), (width, height) = place, size
    if view.colors is not None:
        colors = encode(view.colors) if subject.linear and not view.coded else view.colors
    elif view.error is not None:
        colors = canvas.heat(view.error, MAX_ERROR)
    else:
        if view.light is not None:
            picture = canvas.ball(view.light, round(LARGE_BALL * width), subject.white, subject.linear)
            sheet.cell(picture, x, y, width, height)
        return
    sheet.cell(canvas.composite(dense(colors, subject.pixel, subject.size)[box], subject.mask[box], size), x, y)
    if view.light is not None:
        corner = canvas.ball(view.light, round(SMALL_BALL * width), subject.white, subject.linear)
        sheet.put(corner, x + width - corner.width - 5, y + 5)


@dataclass(frozen=True)
class Shown:
    """What is drawn: networks on a test set.

    Attributes:
        networks: label of the row -> checkpoint.
        packed, lights, split: the data set (.safetensors, .npz, .json).
        condition: the figures and lights to choose from, as `select_pairs` takes them.
    """

    networks: dict[str, Path]
    packed: Path
    lights: Path
    split: Path
    condition: str

    def inferred(
        self, choose: Callable[[int, np.ndarray], list[tuple[int, np.ndarray]]]
    ) -> Iterator[tuple[str, list[tuple[Subject, Inferred]]]]:
        """Infers chosen figures by each network, from their pictures under their first light.

        Args:
            choose: from the number of figures and the indices (L,) of the lights, returns the places of figures, each
                with the indices (N,) of its lights.

        Yields:
            The label of each network, and the chosen figures with what it infers; nothing if the condition has no
            figures or lights.

        Raises:
            UserError: if a file has other contents, or there are no test figures or lights.
        """
        subjects: list[Subject] = []
        for row, checkpoint in progress(list(self.networks.items()), "networks drawn"):
            network, data = load(checkpoint, self.packed, self.lights)
            figures, light_indices = select_pairs(data, self.split, self.condition)
            if not len(figures) or not len(light_indices):
                return
            chosen = [(int(figures[place]), its_lights) for place, its_lights in choose(len(figures), light_indices)]
            subjects = subjects or [Subject(data, *pair) for pair in chosen]
            inferred = [infer(network, data, figure, its_lights[:1]) for figure, its_lights in chosen]
            yield row, list(zip(subjects, inferred))

    def of_the_middle_figure(self, count: int) -> Iterator[tuple[str, Subject, Inferred]]:
        """Yields each label, the middle figure under at most `count` lights of all kinds, and the inference of it."""

        def middle(figures: int, lights: np.ndarray) -> list[tuple[int, np.ndarray]]:
            return [(figures // 2, lights[evenly_spaced(len(lights), count)])]

        for row, ((subject, inferred),) in self.inferred(middle):
            yield row, subject, inferred


def relit(shown: Shown, out: Path) -> None:
    """Draws one figure relit by up to LIGHTS lights: the truth, then each network."""
    lines: list[Line] = []
    for row, subject, inferred in shown.of_the_middle_figure(LIGHTS):
        if not lines:
            pictures = [subject.picture(light) for light in range(len(subject.truth.lights))]
            lines.append(Line(f"truth {subject.name}", subject, pictures, first=True))
        albedo, transport, (light, *_) = subject.truth.complete(inferred)  # or the true ones
        shadings = [shade(transport[0], each_light) for each_light in (light, *subject.truth.lights[1:])]
        lines.append(Line(row, subject, [Cell(albedo[0] * shading) for shading in shadings]))
    draw(["picture", *(f"relit {light}" for light in range(1, LIGHTS))], lines, NOTE_RELIT).save(out)


def plates(shown: Shown, out: Path) -> None:
    """Draws test figures: the truth, then each network.

    Each figure is seen under one light and relit by the next. Values are displayed sRGB-encoded if the network's color
    model is `photo`, and unchanged if it is `paper`. Maps without a loss are true.
    """

    def with_two_lights(figures: int, lights: np.ndarray) -> list[tuple[int, np.ndarray]]:
        """Gives each figure two lights, which differ between figures."""
        places, count = evenly_spaced(figures, PLATE_FIGURES), len(lights)
        return [(place, lights[[i % count, (i + 1) % count]]) for i, place in enumerate(places)]

    blocks: list[list[Line]] = []
    for row, answers in shown.inferred(with_two_lights):
        if not blocks:
            blocks = [
                [Line(f"truth {subject.name}", subject, _true_views(subject), first=True)] for subject, _ in answers
            ]
        for block, (subject, inferred) in zip(blocks, answers):
            block.append(Line(row, subject, _views(subject, inferred)))
    draw(list(COLUMNS), [line for block in blocks for line in block], NOTE).save(out)


def swapped(shown: Shown, out: Path) -> None:
    """Draws pairs of people who swap lights, each relit by the light inferred from the other (the paper's figure 9)."""

    def in_pairs(figures: int, lights: np.ndarray) -> list[tuple[int, np.ndarray]]:
        """Pairs figures of the first half with those of the second, who are other people; the second sees the swap."""
        half, count = figures // 2 if len(lights) > 1 else 0, len(lights)
        pairs = [(place, lights[[i % count, (i + 1) % count]]) for i, place in enumerate(evenly_spaced(half, SWAPS))]
        return [one for place, swap in pairs for one in ((place, swap), (place + half, np.roll(swap, 1)))]

    lines: list[Line] = []
    for _, answers in shown.inferred(in_pairs):
        if not lines:
            lines = [Line(each.name, each, [each.picture(0)], first=i % 2 == 0) for i, (each, _) in enumerate(answers)]
        lights = [subject.truth.complete(inferred)[2][0] for subject, inferred in answers]
        for i, (subject, inferred) in enumerate(answers):
            albedo, transport, _ = subject.truth.complete(inferred)
            picture = albedo[0] * shade(transport[0], lights[i ^ 1])
            error = np.linalg.norm(picture - subject.truth.maps["reconstruction"][1], axis=-1)
            lines[i].views += [Cell(picture, light=lights[i ^ 1]), Cell(error=error)]
    for line in lines:
        line.views.append(line.subject.picture(1))
    heads = ["picture", *(head for row in shown.networks for head in (f"relit by {row}", "its error")), "truth"]
    draw(heads, lines, NOTE_SWAPPED).save(out)


def shadings(shown: Shown, out: Path) -> None:
    """Draws the shading of one figure under the true light: a column per network, and the errors below."""
    lines: list[Line] = []
    for _, subject, inferred in shown.of_the_middle_figure(1):
        true_shading = subject.truth.maps["shading"][0]
        if not lines:
            true_cells = [subject.picture(light=0), Cell(true_shading / subject.white)]
            lines = [Line(subject.name, subject, true_cells, first=True), Line("error", subject, [Cell(), Cell()])]
        _, transport, _ = subject.truth.complete(inferred)  # the true one if the network infers none
        shading = shade(transport[0], subject.truth.lights[0])
        lines[0].views.append(Cell(shading / subject.white))
        lines[1].views.append(Cell(error=np.linalg.norm(shading - true_shading, axis=-1)))
    draw(["picture", "true shading", *shown.networks], lines, NOTE_SHADINGS).save(out)


def evenly_spaced(items: int, count: int) -> list[int]:
    """Returns at most `count` evenly spaced indices of `items` items, including the first and the last."""
    return np.unique(np.linspace(0, items - 1, min(items, count)).round().astype(int)).tolist()


def _true_views(subject: Subject) -> list[Cell]:
    """Returns the views of COLUMNS of the truth, with the new light beside the relit figure."""
    maps = subject.truth.maps
    all_views = _views(subject, Inferred(normal=maps["normal"], ao=maps["ao"][..., 0]))
    all_views[COLUMNS.index("relit")].light = subject.truth.lights[1]
    return all_views


def _views(subject: Subject, inferred: Inferred) -> list[Cell]:
    (albedo, *_), (transport, *_), (light, *_) = subject.truth.complete(inferred)
    normal, ao = inferred.normal, inferred.ao
    shading = shade(transport, light)
    return [
        Cell(albedo * shading),
        Cell(albedo),
        Cell() if normal is None else Cell((normal[0] + 1) / 2, coded=True),
        Cell() if ao is None else Cell(np.repeat(ao[0][:, None].clip(0, 1), 3, 1), coded=True),
        Cell(shading / subject.white),
        Cell(error=np.linalg.norm(shading - subject.truth.maps["shading"][0], axis=-1)),
        Cell(light=light),
        *(Cell(colors, coded=True) for colors in canvas.transport_bands(transport)),
        Cell(albedo * shade(transport, subject.truth.lights[1])),
    ]
