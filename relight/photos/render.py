"""The relit photo: every person's light replaced, and the figures put before the background, strip by strip."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from relight.photos.background import Background
from relight.photos.color import SCENE, develop
from relight.photos.composite import REACH, foreground, over, strips
from relight.photos.infer import Figure


@dataclass
class Layers:
    """Rows [first, last) of a photo: scene values (h,W,3), alpha (h,W) in [0,1], the figures' own colour (h,W,3)."""

    first: int
    last: int
    scene: np.ndarray
    alpha: np.ndarray
    front: np.ndarray


def layers(pixels: np.ndarray, coverage: np.ndarray, first: int, last: int) -> Layers:
    """Rows of a photo, taken apart. Equal for every way of cutting the photo into strips."""
    top, bottom = max(first - REACH, 0), min(last + REACH, len(pixels))
    scene = SCENE[pixels[top:bottom]]
    alpha = coverage[top:bottom].astype(np.float32) / 255
    own = slice(first - top, last - top)
    return Layers(first, last, scene[own], alpha[own], foreground(scene, alpha)[own])


def coverage_of(figures: Sequence[Figure]) -> np.ndarray:
    """(H,W) uint8 coverage of all the people together."""
    total = figures[0].coverage
    for figure in figures[1:]:
        total = np.maximum(total, figure.coverage)
    return total


def relight_maps(figures: Sequence[Figure], light: np.ndarray | Sequence[np.ndarray], mode: str) -> list[np.ndarray]:
    """The (S,S,3) gain or relit colour of each figure under one light (K,3), or under one each."""
    lights = light if isinstance(light, list | tuple) else [light] * len(figures)
    return [figure.gain(l) if mode == "ratio" else figure.full(l) for figure, l in zip(figures, lights)]


def compose(
    part: Layers, figures: Sequence[Figure], maps: Sequence[np.ndarray], mode: str, behind: np.ndarray | None
) -> np.ndarray:
    """Scene values (h,W,3) of some rows. behind: of the same rows, or None for the photo's own background."""
    front = part.front.copy()
    for figure, relit in zip(figures, maps):
        first, last = max(part.first, figure.frame.rows[0]), min(part.last, figure.frame.rows[1])
        if first >= last:
            continue
        window = slice(first - part.first, last - part.first), slice(*figure.frame.columns)
        placed = np.maximum(figure.frame.place(relit, (first, last)), 0)
        mine = figure.coverage[first:last, slice(*figure.frame.columns)] > 0
        value = front[window] * placed if mode == "ratio" else placed
        front[window] = np.where(mine[..., None], value, front[window])
    if behind is None:
        return part.scene + part.alpha[..., None] * (front - part.front)
    return over(front, part.alpha, behind)


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
    if stops:
        maps = [relit * np.float32(2**stops) for relit in maps]
    coverage = coverage_of(figures)
    transparent = background.kind == "none"
    behind = None
    if background.kind not in ("keep", "none"):
        behind = background.scene(pixels.shape[:2], turn)
        if stops and background.kind == "panorama":
            behind = behind * np.float32(2**stops)
    out = np.empty((*pixels.shape[:2], 4 if transparent else 3), np.uint8)
    for first, last in strips(0, len(pixels)):
        if behind is None and not coverage[first:last].any():  # nobody there: the photo, untouched
            out[first:last, :, :3] = pixels[first:last]
            continue
        part = layers(pixels, coverage, first, last)
        if transparent:
            part.scene, part.alpha = part.front, np.ones_like(part.alpha)
        values = compose(part, figures, maps, mode, None if behind is None else behind[first:last])
        out[first:last, :, :3] = develop(values)
    if transparent:
        out[..., 3] = coverage
    return out
