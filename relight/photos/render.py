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
from relight.sh import order_of
from relight.srgb import LINEAR


@dataclass
class Layers:
    """A part of a photo, its first row and column `top` and `left`; linear: its values (h,w,3), alpha (h,w) in [0,1],
    the figures' own colour, and what relighting needs of each figure; None for those that are not in it.
    """

    top: int
    left: int
    linear: np.ndarray
    alpha: np.ndarray
    front: np.ndarray
    seen: list["Seen | None"]


@dataclass
class Seen:
    """The N pixels of a figure in a part of a photo: flat indices `where` (N,) into a window of that part, which is in
    `rows` of the photo, and their `place` in the part. Their arrays lie channel by channel, as placed maps do.

    linear (N,3): the photo's values; share (N,1): of the figure in them; own (N,3): its own colour; detail (N,3): as
    `Figure.detail`; above (N,3): as `color.excess`.
    """

    figure: Figure
    rows: tuple[int, int]
    where: np.ndarray
    place: tuple[np.ndarray, np.ndarray]
    linear: np.ndarray
    share: np.ndarray
    own: np.ndarray
    detail: np.ndarray
    above: np.ndarray


def layers(
    pixels: np.ndarray, figures: Sequence[Figure], rows: tuple[int, int], columns: tuple[int, int] | None = None
) -> Layers:
    """Part of a photo, taken apart, with the figures' frames within `columns`. Equal for every way of cutting rows."""
    (first, last), columns = rows, slice(*(columns or (0, pixels.shape[1])))
    top, bottom = max(first - REACH, 0), min(last + REACH, len(pixels))
    linear = LINEAR[pixels[top:bottom]]
    alpha = coverage_of(figures, slice(top, bottom)).astype(np.float32) / 255
    own = slice(first - top, last - top), columns
    part = Layers(first, columns.start, linear[own], alpha[own], foreground(linear, alpha)[own], [])
    part.seen = [_seen(figure, part) for figure in figures]
    return part


def _seen(figure: Figure, part: Layers) -> Seen | None:
    rows = max(part.top, figure.frame.rows[0]), min(part.top + len(part.front), figure.frame.rows[1])
    if rows[0] >= rows[1]:
        return None
    first, last = figure.frame.columns
    where = np.flatnonzero(figure.coverage[slice(*rows), first:last])
    down, right = np.divmod(where, last - first)
    place = down + rows[0] - part.top, right + first - part.left
    linear, own = (np.asfortranarray(image[place]) for image in (part.linear, part.front))
    window = part.front[rows[0] - part.top : rows[1] - part.top, first - part.left : last - part.left]
    detail = np.asfortranarray(figure.detail(window, rows)[down, right])
    above = np.zeros_like(own)
    clipped = (own > CLIPPING).any(-1)
    if clipped.any():
        chroma = figure.frame.place(figure.chroma, rows, cubic=False, where=where[clipped])
        above[clipped] = excess(own[clipped], chroma)
    return Seen(figure, rows, where, place, linear, part.alpha[place][:, None], own, detail, above)


def coverage_of(figures: Sequence[Figure], rows: slice = slice(None)) -> np.ndarray:
    """(H,W) uint8 coverage of all the people together, or its `rows`."""
    return np.maximum.reduce([figure.coverage[rows] for figure in figures])


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
    return [(figure.fitted_albedo, figure.fitted_shading(l)) for figure, l in zip(figures, lights)]


def compose(
    out: np.ndarray, part: Layers, maps: Sequence[tuple[Fitted, ...]], behind: np.ndarray | None, stops: float = 0.0
) -> None:
    """Writes a part of a photo, (h,w,3) uint8, its figures relit by their `maps`, into `out`.

    behind: linear values (h,w,3) of the same part; None leaves the photo's own background, which `out` holds.
    """
    front = None if behind is None else part.front.copy()
    for seen, fits in zip(part.seen, maps):
        if seen is None:
            continue
        values = _lit(seen, fits, np.float32(2**stops))
        if behind is None:
            out[seen.place] = to_srgb8(seen.linear + seen.share * (values - seen.own))
        else:
            front[seen.place] = values
    if behind is not None:
        out[:] = to_srgb8(over(front, part.alpha, behind))


def _lit(seen: Seen, fits: tuple[Fitted, ...], factor: float) -> np.ndarray:
    """A figure's own linear colour (N,3), relit: by its gain, or as albedo and shading say."""
    *albedo, last = fits
    values = last.place(seen.figure.frame, luma(seen.detail), seen.rows, seen.where) * factor
    if not albedo:
        return relit(seen.own, values, seen.above)
    return rolled(albedo[0].place(seen.figure.frame, seen.detail, seen.rows, seen.where) ** 2 * values)


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
            behind = np.require(behind, requirements="W")
            floor.darken(behind, np.mean(light, 0) if isinstance(light, list | tuple) else light)
    out = np.empty((*pixels.shape[:2], 4 if transparent else 3), np.uint8)
    for first, last in strips(0, len(pixels)):
        rows = out[first:last, :, :3]
        rows[:] = pixels[first:last]
        if behind is None and not coverage[first:last].any():  # nobody there: the photo, untouched
            continue
        part = layers(pixels, figures, (first, last))
        if transparent:
            rows[:] = to_srgb8(part.front)
            for seen in filter(None, part.seen):
                seen.linear, seen.share = seen.own, np.ones_like(seen.share)
        compose(rows, part, maps, None if behind is None else behind[first:last], stops)
    if transparent:
        out[..., 3] = coverage
    return out
