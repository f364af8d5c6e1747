"""The relit photo: the people under a new light, composited over the background in small parts.

All in linear values. Parts keep the memory for an 8k photo small, and what is nobody's costs nothing.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, uniform_filter1d

from relight.core.srgb import to_linear
from relight.maps.square import Window, extent, tiles
from relight.photos.background import Background
from relight.photos.ground import ground_under
from relight.photos.guide import FittedMap, luma
from relight.photos.person import Person
from relight.photos.tone import CLIPPING, apply_gain, clipping_excess, roll_off
from relight.pictures.codes import convert_alpha, to_codes, with_alpha
from relight.sh import order_of

RADII = 45, 6  # of the two passes of `estimate_foreground`, pixels: hair, then detail
REACH = sum(RADII)  # pixels around a part that its result depends on
Fits = tuple[FittedMap, ...]  # of a person: the gain, or albedo and shading


@dataclass(repr=False)
class _Own:
    """A person's pixels in a part of a photo.

    Attributes:
        person: whose they are.
        window: of the photo, within the person's and the part.
        inside: the same as an index of the part.
        share: (h,w) the person's, of the people's, in [0,1].
        detail: (h,w,3), from `Person.detail`.
        excess: (h,w,3), as `color.clipping_excess`, or 0 if nothing is clipped.
    """

    person: Person
    window: Window
    inside: Window
    share: np.ndarray
    detail: np.ndarray
    excess: np.ndarray | float


class _Layers:
    """A part of a photo, separated into people and background; the cut does not show. Channels come first in memory.

    Attributes:
        linear: (h,w,3) the photo's values.
        alpha: (h,w) the people's share of each pixel, in [0,1].
        share: (h,w) their share of what is opaque of it.
        foreground: (h,w,3) the people's own color.
        people: the pixels of those who are in this part, by their number.
    """

    def __init__(
        self,
        pixels: np.ndarray,
        people: Sequence[Person],
        coverage: np.ndarray,
        window: Window,
        opaque: bool,
        visible: np.ndarray | None,
    ):
        """Separates a window into people, who may be made `opaque`, and background.

        Colors are those of what is `visible`, (H,W) alpha: a person who covers all of it has them alone.
        """
        wide = tuple(slice(max(part.start - REACH, 0), part.stop + REACH) for part in window)
        inside = tuple(slice(part.start - all.start, part.stop - all.start) for part, all in zip(window, wide))
        share = alpha = coverage[wide] / np.float32(255)
        if visible is not None:
            shown = convert_alpha(visible[wide], np.uint8) / np.float32(255)  # of the bits that coverage has
            share = alpha / np.maximum(np.maximum(shown, alpha), 1e-9)
        self.alpha, self.share = alpha[inside], share[inside]
        if ((self.share > 0) & (self.share < 1)).any():
            linear = _planes(pixels[wide])
            self.foreground, self.linear = estimate_foreground(linear, share)[inside], linear[inside]
        else:
            self.foreground = self.linear = _planes(pixels[window])
        self.people = {
            number: own
            for number, person in enumerate(people)
            if (own := _own_pixels(person, coverage, window, self.foreground))
        }
        if opaque:
            self.linear, self.share = self.foreground, np.ones_like(self.share)


def frames(
    pixels: np.ndarray,
    people: Sequence[Person],
    lights: Sequence[tuple[np.ndarray, float]],
    mode: str = "ratio",
    background: Background | None = None,
    stops: float = 0.0,
    alpha: np.ndarray | None = None,
) -> Iterator[np.ndarray]:
    """Relights the people of a photo by one light after the other; what these do not change is computed once.

    Args:
        pixels: (H,W,3) uint8 or uint16 sRGB, or float32 linear Rec. 709.
        people: as inferred from it.
        lights: (K,3) radiance coefficients, already turned, with the turn of a panorama behind, radians.
        mode: `ratio` multiplies the photo by new / old shading and keeps all its detail; `full` is albedo * shading.
        background: the photo's own by default.
        stops: exposure of the people and of the background, as powers of two.
        alpha: (H,W), as `Picture.alpha`, of a photo that is transparent in places; its colors are not multiplied by it.

    Yields:
        (H,W,3) of the same type, or (H,W,4) for a transparent background, or the photo's own with `alpha`. Values of a
        linear photo are not rolled off.
    """
    background = background or Background()
    shape = pixels.shape[:2]
    coverage = total_coverage(people) if people else np.zeros(shape, np.uint8)
    transparent = background.kind == "transparent"
    shown = coverage if transparent else alpha if background.kind == "keep" else None
    ground = None
    if people and background.replaced and background.shadow:
        coverages, bodies = zip(*((person.coverage, person.body) for person in people))
        ground = ground_under(coverages, order_of(people[0].transport.shape[-1]), bodies)
    still = background.linear(shape, stops=stops) if background.replaced and not background.moves else None
    parts = list(tiles((0, shape[0]), (0, shape[1])))
    layers: Iterable[_Layers | None] = (
        _Layers(pixels, people, coverage, window, transparent, alpha) if coverage[window].any() else None
        for window in parts
    )
    if len(lights) > 1:
        layers = list(layers)  # of a single picture, which may be large, there is one at a time
    for light, turn in lights:
        maps = [
            (person.fit_gain(light),) if mode == "ratio" else (person.fitted_albedo, person.fit_shading(light))
            for person in people
        ]
        behind = background.linear(shape, turn, stops) if background.moves else still
        if ground and behind is not None:
            behind = ground.with_shadows(behind, light)
        out = pixels.copy() if shown is None else with_alpha(pixels, shown)
        for window, part in zip(parts, layers):
            under = None if behind is None else behind[window]
            values = under if part is None else _compose(part, maps, under, stops, scene=out.dtype.kind == "f")
            if values is not None:
                out[window][..., :3] = to_codes(values, out.dtype)
        yield out


def total_coverage(people: Sequence[Person]) -> np.ndarray:
    """Returns the coverage (H,W) uint8 of all people together, each of whom has a part of it."""
    return np.add.reduce([person.coverage for person in people], dtype=np.uint8)


def _planes(pixels: np.ndarray) -> np.ndarray:
    """Returns the linear values of pixels, with the channels first in memory."""
    return np.moveaxis(to_linear(np.ascontiguousarray(np.moveaxis(pixels, -1, 0))), 0, -1)


def _own_pixels(person: Person, total: np.ndarray, window: Window, foreground: np.ndarray) -> _Own | None:
    own = tuple(
        slice(max(part.start, whole.start), min(part.stop, whole.stop))
        for part, whole in zip(window, person.crop.window)
    )
    share = person.coverage[own] / np.maximum(total[own], np.float32(1))
    if not share.any():  # also of no pixels, where a slice ends before it starts
        return None
    inside = tuple(slice(part.start - all.start, part.stop - all.start) for part, all in zip(own, window))
    colors = foreground[inside]
    excess: np.ndarray | float = 0.0
    clipped = (colors > CLIPPING).any(-1)
    if clipped.any():
        excess = np.zeros_like(colors)
        excess[clipped] = clipping_excess(colors[clipped], person.crop.place(person.chroma, own, cubic=False)[clipped])
    return _Own(person, own, inside, share, person.detail(colors, own), excess)


def _compose(part: _Layers, maps: Sequence[Fits], behind: np.ndarray | None, stops: float, scene: bool) -> np.ndarray:
    """Returns the linear values (h,w,3) of a part of a photo, relit, before something if it is `behind` it."""
    front = np.copy(part.foreground)
    for number, own in part.people.items():
        old, share = part.foreground[own.inside], own.share[..., None]
        values = _relight(own, old, maps[number], np.float32(2**stops), scene)
        np.copyto(front[own.inside], front[own.inside] + share * (values - old), where=share > 0)
    if behind is not None:
        return over(front, part.alpha, behind)
    return part.linear + part.share[..., None] * (front - part.foreground)


def _relight(own: _Own, foreground: np.ndarray, fits: Fits, factor: np.float32, scene: bool) -> np.ndarray:
    """Relights the person's own color; highlights are rolled off unless the photo is linear (`scene`)."""
    *albedo, last = fits
    values = last.place(own.person.crop, luma(own.detail), own.window) * factor
    if not albedo:
        return foreground * values if scene else apply_gain(foreground, values, own.excess)
    product = albedo[0].place(own.person.crop, own.detail, own.window) ** 2 * values
    return product if scene else roll_off(product)


def estimate_foreground(linear: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Estimates the color of the people at pixels that they cover in part.

    Such a pixel is alpha F + (1 - alpha) B. Relit as if it were all F, it would carry the old background along as a
    halo. F and B start as local means of the two sides and are corrected so that together they give the pixel, in a
    wide and a narrow pass (Forte, "Approximate fast foreground color estimation", 2021).

    Args:
        linear: (H,W,3) the photo.
        alpha: (H,W) in [0,1].

    Returns:
        F (H,W,3); where alpha is 0 or 1, the photo.
    """
    soft = (alpha > 0) & (alpha < 1)
    if not soft.any():
        return linear
    part = tuple(slice(max(first - REACH, 0), last + REACH) for first, last in extent(soft))
    a, soft = alpha[part], soft[part]
    wide, narrow = RADII
    near = np.flatnonzero(maximum_filter(soft, 2 * narrow + 1))  # where the second pass looks at the first one's result
    passes = [
        (radius, where, a.take(where), _box_mean(a, radius).take(where))
        for radius, where in ((wide, near), (narrow, np.flatnonzero(soft)))
    ]
    out = np.copy(linear)  # in its order
    for channel in range(3):
        plane = np.ascontiguousarray(linear[part][..., channel])
        front = behind = plane
        for radius, where, covered, share in passes:
            mean_front = _box_mean(front * a, radius).take(where) / np.maximum(share, 1e-4)
            mean_behind = _box_mean(behind * (1 - a), radius).take(where) / np.maximum(1 - share, 1e-4)
            error = plane.take(where) - covered * mean_front - (1 - covered) * mean_behind
            front, behind = np.zeros_like(plane), np.zeros_like(plane)
            most = plane.take(where) / np.maximum(covered, 1e-4)  # else the background would be less than black
            front.put(where, np.clip(mean_front + covered * error, 0, most))
            behind.put(where, mean_behind)
        np.copyto(out[part][..., channel], front, where=soft)
    return out


def over(front: np.ndarray, alpha: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """Composites linear images (H,W,3) with alpha (H,W): alpha F + (1 - alpha) B (Porter and Duff 1984)."""
    return behind + alpha[..., None] * (front - behind)


def _box_mean(image: np.ndarray, radius: int) -> np.ndarray:
    """Returns means over squares of 2 radius + 1 pixels; border pixels are replicated."""
    for axis in (0, 1):
        image = uniform_filter1d(image, 2 * radius + 1, axis=axis, mode="nearest")
    return image
