"""The relit photo: every person's light replaced, and the figures put before the background, strip by strip."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from relight.photos.background import Background
from relight.photos.color import CLIPPING, excess, relit, rolled, to_srgb8
from relight.photos.composite import REACH, foreground, over, strips
from relight.photos.ground import Ground, ground
from relight.photos.infer import Figure
from relight.photos.upsample import Fitted, luma
from relight.sh.basis import order_of
from relight.srgb import LINEAR


@dataclass
class Layers:
    """Rows [first, last) of a photo, linear: its values (h,W,3), alpha (h,W) in [0,1], the figures' own colour."""

    first: int
    last: int
    linear: np.ndarray
    alpha: np.ndarray
    front: np.ndarray


def layers(pixels: np.ndarray, coverage: np.ndarray, first: int, last: int) -> Layers:
    """Rows of a photo, taken apart. Equal for every way of cutting the photo into strips."""
    top, bottom = max(first - REACH, 0), min(last + REACH, len(pixels))
    linear = LINEAR[pixels[top:bottom]]
    alpha = coverage[top:bottom].astype(np.float32) / 255
    own = slice(first - top, last - top)
    return Layers(first, last, linear[own], alpha[own], foreground(linear, alpha)[own])


def coverage_of(figures: Sequence[Figure]) -> np.ndarray:
    """(H,W) uint8 coverage of all the people together."""
    total = figures[0].coverage
    for figure in figures[1:]:
        total = np.maximum(total, figure.coverage)
    return total


def ground_of(figures: Sequence[Figure]) -> Ground | None:
    """The ground that the people stand on, for their shadows; None when nobody's feet are in the picture."""
    return ground([figure.coverage for figure in figures], order_of(figures[0].transport.shape[-1]))


def relight_maps(
    figures: Sequence[Figure], light: np.ndarray | Sequence[np.ndarray], mode: str
) -> list[tuple[Fitted, ...]]:
    """The gain of each figure, or its albedo and shading, under one light (K,3) or under one each."""
    lights = light if isinstance(light, list | tuple) else [light] * len(figures)
    if mode == "ratio":
        return [(figure.gain(l),) for figure, l in zip(figures, lights)]
    return [(figure.fitted_albedo(), figure.fitted_shading(l)) for figure, l in zip(figures, lights)]


def compose(
    part: Layers,
    figures: Sequence[Figure],
    maps: Sequence[tuple[Fitted, ...]],
    behind: np.ndarray | None,
    stops: float = 0.0,
) -> np.ndarray:
    """Linear values (h,W,3) of some rows. behind: of the same rows, or None for the photo's own background."""
    front = part.front.copy()
    for figure, fits in zip(figures, maps):
        rows = max(part.first, figure.frame.rows[0]), min(part.last, figure.frame.rows[1])
        if rows[0] >= rows[1]:
            continue
        window = slice(rows[0] - part.first, rows[1] - part.first), slice(*figure.frame.columns)
        mine = figure.coverage[slice(*rows), slice(*figure.frame.columns)] > 0
        value = _lit(figure, fits, front[window], rows, np.float32(2**stops))
        front[window] = np.where(mine[..., None], value, front[window])
    if behind is None:
        return part.linear + part.alpha[..., None] * (front - part.front)
    return over(front, part.alpha, behind)


def _lit(figure: Figure, fits: tuple[Fitted, ...], own: np.ndarray, rows: tuple[int, int], factor: float) -> np.ndarray:
    """A figure's own linear colour (h,w,3) in `rows`, relit: by its gain, or as albedo and shading say."""
    detail = figure.detail(own, rows)
    if len(fits) == 1:
        gain = fits[0].place(figure.frame, luma(detail), rows) * factor
        clipped = (own > CLIPPING).any(-1)
        above = np.zeros_like(own)
        if clipped.any():
            above[clipped] = excess(own[clipped], figure.frame.place(figure.chroma, rows, cubic=False)[clipped])
        return relit(own, gain, above)
    albedo, shading = fits
    lit = albedo.place(figure.frame, detail, rows) ** 2 * shading.place(figure.frame, luma(detail), rows)
    return rolled(lit * factor)


def render(
    pixels: np.ndarray,
    figures: Sequence[Figure],
    light: np.ndarray | Sequence[np.ndarray],
    mode: str = "ratio",
    background: Background | None = None,
    turn: float = 0.0,
    stops: float = 0.0,
) -> np.ndarray:
    """The photo (H,W,3) uint8 sRGB with its figures under `light`: (H,W,3) uint8, or (H,W,4) when transparent.

    mode: `ratio` multiplies the photo by new / old shading and so keeps all its detail; `full` shows albedo * new
    shading. turn: of the panorama behind, radians (the light comes turned already). stops: exposure of the figures
    and of a panorama behind, as powers of two.
    """
    background = background or Background()
    maps = relight_maps(figures, light, mode)
    coverage = coverage_of(figures)
    transparent = background.kind == "none"
    behind = None
    if background.replaced:
        behind = background.linear(pixels.shape[:2], turn, stops)
        floor = ground_of(figures) if background.shadow else None
        if floor:
            behind = floor.darkened(behind, np.mean(light, 0) if isinstance(light, list | tuple) else light)
    out = np.empty((*pixels.shape[:2], 4 if transparent else 3), np.uint8)
    for first, last in strips(0, len(pixels)):
        if behind is None and not coverage[first:last].any():  # nobody there: the photo, untouched
            out[first:last, :, :3] = pixels[first:last]
            continue
        part = layers(pixels, coverage, first, last)
        if transparent:
            part.linear, part.alpha = part.front, np.ones_like(part.alpha)
        out[first:last, :, :3] = to_srgb8(
            compose(part, figures, maps, None if behind is None else behind[first:last], stops)
        )
    if transparent:
        out[..., 3] = coverage
    return out
