"""Draws lights: ball, diffuse panorama and statistics of one light; contact sheets of light sets."""

import math
import textwrap
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from relight.core.files import atomic_write
from relight.core.srgb import encode
from relight.lights.light import MIN_EIGENVALUE, Light
from relight.lights.statistics import measure, reference_brightness
from relight.lights.table import LightSet
from relight.panoramas.lookup import lookup
from relight.panoramas.projection import latlong_directions
from relight.sh import irradiance, order_of, unoccluded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ALBEDO = 0.5  # of the balls, so that lights above the reference brightness are not clipped
TEXT, MUTED_TEXT, WHITE, ACCENT, DARK = "#1c1f24", "#7a808a", "#ffffff", "#c2410c", "#15171b"
BRIGHTEST = 0.85  # linear value in the picture of a light at its brightest normal
MAX_UNUSUAL = 20  # on a contact sheet
COLUMNS = 10  # of a contact sheet
CELL = 1.22  # inches of the side of its cells
ROW = 1.28 * CELL  # inches from row to row
HEAD = 0.42  # inches of the title of a part
EVEN = 0.005  # contrast |L1| / L00 that is shown as 0.00: such light has no direction
SAMPLES = 2  # of a ball, per pixel in each direction


def lit_ball(coefficients: np.ndarray, size: int, white: float = 1 / ALBEDO, linear: bool = True) -> np.ndarray:
    """Renders a diffuse ball under a light, as the camera sees it.

    Args:
        coefficients: (K,3) of the light.
        size: side of the square picture, pixels.
        white: the irradiance that is shown as 1.
        linear: whether the light is linear and the result is sRGB-encoded; otherwise, the codes are the light's.

    Returns:
        (size,size,4) float64 codes and alpha in [0,1].
    """
    inside, transport = unoccluded_ball(size * SAMPLES, order_of(len(coefficients)))
    picture = np.zeros((*inside.shape, 4))
    picture[inside, :3] = np.maximum(transport @ coefficients / white, 0)
    picture[inside, 3] = 1
    picture = picture.reshape(size, SAMPLES, size, SAMPLES, 4).mean((1, 3))
    color = picture[..., :3] / np.maximum(picture[..., 3:], 1e-6)
    return np.concatenate([encode(color) if linear else np.minimum(color, 1), picture[..., 3:]], -1)


@lru_cache(maxsize=4)
def unoccluded_ball(size: int, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the disc and the transport of a unit ball seen from the front.

    Args:
        size: side of the square picture, pixels.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.

    Returns:
        The disc, (size,size) bool, and the unoccluded transport (P,K) of its pixels in raster order.
    """
    t = (2 * np.arange(size) + 1) / size - 1
    x, y = np.meshgrid(t, -t)
    inside = x * x + y * y < 1
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    return inside, unoccluded(np.stack([x, y, z], -1)[inside], order)


def diffuse_panorama(coefficients: np.ndarray, height: int) -> np.ndarray:
    """Returns the radiance E(n) / pi of a white diffuse surface for all normals n.

    Args:
        coefficients: (K,3) of the light.
        height: height of the panorama in pixels.

    Returns:
        (height, 2 height,3) linear, lat-long with -z at the centre.
    """
    values = irradiance(coefficients, latlong_directions(height, 2 * height).reshape(-1, 3))
    return np.maximum(values, 0).reshape(height, 2 * height, 3) / np.pi


def write_light_picture(light: Light, path: Path | str) -> None:
    """Writes a picture of a light as PNG: its panorama if known, diffuse panorama, lit ball and statistics.

    Ball and diffuse panorama are exposed for the brightest normal; the statistics are not scaled.
    """
    from matplotlib.figure import Figure

    max_irradiance = float(measure(light.coefficients[None])["most"][0])
    drawn = light.coefficients * BRIGHTEST / (ALBEDO * max(max_irradiance, 1e-12))
    figure = Figure(figsize=(11, 5), dpi=130, facecolor=WHITE)
    title = light.source if len(light.source) <= 70 else "…" + light.source[-69:]
    figure.text(0.03, 0.93, title, color=TEXT, fontsize=14, weight="bold", va="center")
    panes = [("Diffuse panorama", encode(diffuse_panorama(drawn, 128) * np.pi * ALBEDO))]
    if light.panorama is not None:
        is_reoriented = light.panorama.yaw % 360 or light.panorama.flip or light.panorama.front == "+z"
        name = "Panorama, as turned" if is_reoriented else "Panorama"
        panes.insert(0, (name, _tone_mapped(lookup(light.panorama, latlong_directions(256, 512)))))
    # Boxes of axes are left, bottom, width and height in shares of the figure.
    for i, (name, picture) in enumerate(panes):
        axes = figure.add_axes((0.03, 0.51 - 0.45 * i, 0.36, 0.335))
        axes.imshow(picture, aspect="auto", interpolation="bilinear")
        axes.set_title(name, fontsize=9, color=MUTED_TEXT, loc="left", pad=4)
        _label_directions(axes, picture.shape)
    background = figure.add_axes((0.415, 0.06, 0.30, 0.785), facecolor=DARK)
    background.set(xticks=[], yticks=[])
    background.set_title("Matt ball, from the camera", fontsize=9, color=MUTED_TEXT, loc="left", pad=4)
    background.spines[:].set_visible(False)
    axes = figure.add_axes((0.425, 0.06, 0.28, 0.785))
    axes.imshow(lit_ball(drawn, 420))
    axes.axis("off")
    for i, (name, value) in enumerate(format_statistics(light)):
        y = 0.815 - 0.052 * i
        figure.text(0.74, y, name, color=MUTED_TEXT, fontsize=9)
        figure.text(0.975, y, value, color=TEXT, fontsize=9, ha="right", family="monospace")
    for i, note in enumerate(light.notes[:4]):
        figure.text(0.74, 0.20 - 0.09 * i, textwrap.fill(note, 44), color=ACCENT, fontsize=7, va="top")
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png")


def _label_directions(axes: "Axes", shape: tuple[int, ...]) -> None:
    """Labels the directions below a lat-long picture with -z at the centre."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    for i, name in enumerate(("camera", "left", "away", "right", "camera")):
        align = "left" if i == 0 else "right" if i == 4 else "center"
        axes.text(shape[1] * i / 4 - 0.5, shape[0] * 1.075, name, fontsize=7, color=MUTED_TEXT, ha=align)


def _tone_mapped(pixels: np.ndarray) -> np.ndarray:
    """Tone-maps linear pixels (h,w,3) to sRGB codes in [0,1]; the 60th percentile sets the exposure."""
    pixels = pixels.astype(np.float64)
    exposed = pixels * 0.35 / max(float(np.percentile(pixels.mean(-1), 60)), 1e-9)
    return encode(exposed * (1 + exposed / 16) / (1 + exposed * 0.6))


def format_statistics(light: Light) -> list[tuple[str, str]]:
    """Returns the layout of a light's panorama and the light's statistics, as labels and formatted values."""
    stats = {name: float(value[0]) for name, value in measure(light.coefficients[None]).items()}
    is_even = stats["first"] < EVEN
    direction = "none" if is_even else f"{stats['azimuth']:+.0f}°  {stats['elevation']:+.0f}°"
    layout = [("layout of the panorama", light.panorama.layout)] if light.panorama else []
    return [
        *layout,
        ("reference brightness, E(0,0,1)", f"{stats['reference']:.3f}"),
        ("mean irradiance", f"{stats['mean']:.3f}"),
        ("darkest, brightest / mean", f"{stats['least'] / stats['mean']:.2f}  {stats['most'] / stats['mean']:.2f}"),
        ("from above, below / mean", f"{stats['up']:.2f}  {stats['down']:.2f}"),
        ("front, back", f"{stats['front_mean']:.3f}  {stats['back_mean']:.3f}"),
        ("contrast |L1| / L00", f"{stats['first']:.2f}"),
        ("structure |L2| / L00", f"{stats['second']:.2f}"),
        ("main direction: right, up", direction),
        ("color ln R/G, ln B/G", f"{stats['red']:+.2f}  {stats['blue']:+.2f}"),
        ("realisable (moments)", f"{'yes' if stats['moment'] >= MIN_EIGENVALUE else 'NO'}  {stats['moment']:+.3f}"),
        ("order", f"{light.order}"),
    ]


def write_contact_sheet(lights: LightSet, path: Path | str) -> None:
    """Writes a contact sheet of a light set as PNG: all usual lights, and some of the unusual ones.

    Each cell holds a lit ball, all at the same exposure, and the horizon of the diffuse panorama.
    """
    from matplotlib.figure import Figure

    train, validation, test, unusual = (lights.of(split) for split in ("train", "validation", "test", "unusual"))
    # Unusual lights are sampled evenly over all reasons; a random sample would show the commonest one only.
    order = np.argsort([reason.split(" ")[0] for reason in unusual.reason], kind="stable")
    picked = order[np.unique(np.linspace(0, len(order) - 1, min(len(order), MAX_UNUSUAL)).round().astype(int))]
    parts = [
        (f"{len(train)} training lights", train, TEXT),
        (f"{len(validation)} validation lights", validation, TEXT),
        (f"{len(test)} test lights", test, ACCENT),
        (f"Unusual lights, left out: {len(picked)} of the {len(unusual)} kept", unusual.rows(picked), MUTED_TEXT),
    ]
    parts = [part for part in parts if len(part[1])]
    rows = [math.ceil(len(part) / COLUMNS) for _, part, _ in parts]
    width, height = COLUMNS * CELL + 0.4, sum(rows) * ROW + HEAD * len(parts) + 0.25
    figure = Figure(figsize=(width, height), dpi=120, facecolor=WHITE)
    top = height - 0.12
    for (title, part, color), row_count in zip(parts, rows):
        figure.text(0.25 / width, (top - 0.2) / height, title, color=color, fontsize=11, weight="bold", va="center")
        top -= HEAD
        for i in range(len(part)):
            row, column = divmod(i, COLUMNS)
            _draw_cell(figure, part.rows(np.array([i])), 0.2 + column * CELL, top - (row + 1) * ROW, width, height)
        top -= row_count * ROW
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png")


def _draw_cell(figure: "Figure", light: LightSet, x: float, y: float, width: float, height: float) -> None:
    """Draws one light of a contact sheet: ball and horizon on a dark ground, its source and heading, and the reason.

    `x` and `y` are the lower left corner of the cell, and `width` and `height` those of the figure, inches.
    """

    def add_axes(left: float, bottom: float, box_width: float, box_height: float) -> "Axes":
        box = ((x + left) / width, (y + bottom) / height, box_width / width, box_height / height)
        return figure.add_axes(box)

    def add_text(bottom: float, words: str, size: float, color: str) -> None:
        place = (x + CELL / 2) / width, (y + bottom) / height
        figure.text(*place, words, fontsize=size, color=color, ha="center", va="center")

    coefficients = light.coefficients[0]
    background = add_axes(0.05, 0.30, CELL - 0.1, CELL - 0.02)
    background.set(xticks=[], yticks=[], facecolor=DARK)
    background.spines[:].set_visible(False)
    axes = add_axes(0.11, 0.44, CELL - 0.22, CELL - 0.22)
    axes.imshow(lit_ball(coefficients, 120), interpolation="bilinear")
    axes.axis("off")
    band = add_axes(0.11, 0.34, CELL - 0.22, 0.06)
    horizon = diffuse_panorama(coefficients, 24)[11:13].mean(0, keepdims=True)  # the two rows in the middle
    band.imshow(encode(horizon * np.pi * ALBEDO), aspect="auto", interpolation="bilinear")
    band.axis("off")
    source = light.source[0].rsplit("/", 1)[-1]
    name = source if len(source) <= 16 else source[:7] + "…" + source[-8:]
    add_text(0.215, f"{name}  {light.yaw[0]:.0f}°", 6.2, TEXT)
    detail = light.reason[0].replace(" ", ", ") or f"E {reference_brightness(coefficients):.2f}"
    add_text(0.10, detail if len(detail) <= 24 else detail[:23] + "…", 5.6, MUTED_TEXT)
