"""The relit photo: the people under a new light, composited over the background in strips of rows.

All in linear values. Strips keep the memory for an 8k photo small.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, uniform_filter1d

from relight.core.srgb import to_linear
from relight.maps.square import extent
from relight.photos.background import Background
from relight.photos.color import CLIPPING, apply_gain, clipping_excess, roll_off, to_codes, with_alpha
from relight.photos.ground import ground_under
from relight.photos.guide import FittedMap, luma
from relight.photos.person import Person
from relight.sh import order_of

STRIP = 512  # rows
RADII = 45, 6  # of the two passes of `estimate_foreground`, pixels: hair, then detail
REACH = sum(RADII)  # rows beyond a strip that its result depends on


@dataclass(repr=False)
class _PersonPixels:
    """The N pixels of a person in a part of a photo. Arrays are in Fortran order, as placed maps are.

    Attributes:
        person: whose pixels they are.
        rows: of the photo, half-open.
        where: (N,) flat indices into the crop's window of those rows.
        index: the same pixels as (rows, columns) of the part.
        linear: (N,3) the photo's values.
        alpha: (N,1) the person's share of what is opaque of them, in [0,1].
        foreground: (N,3) the person's own color.
        detail: (N,3), from `Person.detail`.
        excess: (N,3), as `color.clipping_excess`.
    """

    person: Person
    rows: tuple[int, int]
    where: np.ndarray
    index: tuple[np.ndarray, np.ndarray]
    linear: np.ndarray
    alpha: np.ndarray
    foreground: np.ndarray
    detail: np.ndarray
    excess: np.ndarray


@dataclass(repr=False)
class _Layers:
    """A part of a photo, separated into people and background.

    Attributes:
        top: first row of the part.
        linear: (h,w,3) the photo's values.
        alpha: (h,w) the people's share of each pixel, in [0,1].
        foreground: (h,w,3) the people's own color.
        people: the pixels of each person; None for a person who is not in this part.
    """

    top: int
    linear: np.ndarray
    alpha: np.ndarray
    foreground: np.ndarray
    people: list[_PersonPixels | None]


def render(
    pixels: np.ndarray,
    people: Sequence[Person],
    light: np.ndarray,
    mode: str = "ratio",
    background: Background | None = None,
    turn: float = 0.0,
    stops: float = 0.0,
    alpha: np.ndarray | None = None,
) -> np.ndarray:
    """Relights the people of a photo.

    Args:
        pixels: (H,W,3) uint8 or uint16 sRGB, or float32 linear Rec. 709.
        people: as inferred from it.
        light: (K,3) radiance coefficients, already turned.
        mode: `ratio` multiplies the photo by new / old shading and keeps all its detail; `full` is albedo * shading.
        background: the photo's own by default.
        turn: of a panorama behind, radians.
        stops: exposure of the people and of the background, as powers of two.
        alpha: (H,W) uint8 of a photo that is transparent in places; its colors are not multiplied by it.

    Returns:
        (H,W,3) of the same type, or (H,W,4) for a transparent background, or the photo's own with `alpha`. Values of a
        linear photo are not rolled off.
    """
    return next(frames(pixels, people, [(light, turn)], mode, background or Background(), stops, alpha))


def frames(
    pixels: np.ndarray,
    people: Sequence[Person],
    lights: Sequence[tuple[np.ndarray, float]],
    mode: str,
    background: Background,
    stops: float,
    alpha: np.ndarray | None = None,
) -> Iterator[np.ndarray]:
    """Yields what `render` returns for each of `lights`, with its turn. What these do not change is computed once."""
    shape, coverage = pixels.shape[:2], total_coverage(people)
    transparent = background.kind == "none"
    shown = coverage if transparent else alpha if background.kind == "keep" else None
    ground = None
    if background.replaced and background.shadow:
        ground = ground_under([person.coverage for person in people], order_of(people[0].transport.shape[-1]))
    still = background.linear(shape, stops=stops) if background.replaced and not background.turns else None
    rows = [each for each in strips(0, len(pixels)) if background.kind != "keep" or coverage[slice(*each)].any()]
    layers: Iterable[_Layers] = (_split_layers(pixels, people, each, transparent, alpha) for each in rows)
    if len(lights) > 1:
        layers = list(layers)  # of a single picture, which may be large, there is one at a time
    for light, turn in lights:
        maps, behind = _fit_maps(people, light, mode), None if still is None else np.array(still)
        if background.turns:
            behind = background.linear(shape, turn, stops)
        if ground and behind is not None:
            ground.cast_shadows(behind, light)
        out = pixels.copy() if shown is None else with_alpha(pixels, shown)
        for (first, last), part in zip(rows, layers):
            if transparent:
                out[first:last, :, :3] = to_codes(part.foreground, out.dtype)
            _compose(out[first:last, :, :3], part, maps, None if behind is None else behind[first:last], stops)
        yield out


def total_coverage(people: Sequence[Person], rows: slice = slice(None)) -> np.ndarray:
    """Returns the coverage (H,W) uint8 of all people together, or some `rows` of it."""
    return np.maximum.reduce([person.coverage[rows] for person in people])


def _fit_maps(people: Sequence[Person], light: np.ndarray, mode: str) -> list[tuple[FittedMap, ...]]:
    """Fits what relights each person: one map, the gain (`ratio`), or two, albedo and shading (`full`)."""
    if mode == "ratio":
        return [(person.fit_gain(light),) for person in people]
    return [(person.fitted_albedo, person.fit_shading(light)) for person in people]


def _split_layers(
    pixels: np.ndarray,
    people: Sequence[Person],
    rows: tuple[int, int],
    opaque: bool = False,
    visible: np.ndarray | None = None,
) -> _Layers:
    """Separates rows into people, who may be made `opaque`, and background. The cut of the rows does not show.

    Colors are those of what is `visible`, (H,W) uint8: a person who covers all of it has them alone.
    """
    first, last = rows
    top, bottom = max(first - REACH, 0), min(last + REACH, len(pixels))
    linear = to_linear(pixels[top:bottom])
    alpha = total_coverage(people, slice(top, bottom)).astype(np.float32) / 255
    share = (
        alpha if visible is None else alpha / np.maximum(np.maximum(visible[top:bottom] / np.float32(255), alpha), 1e-9)
    )
    window = slice(first - top, last - top)  # without the rows that only the foreground's estimate needs
    part = _Layers(first, linear[window], alpha[window], estimate_foreground(linear, share)[window], [])
    part.people = [_person_pixels(person, part, share[window]) for person in people]
    for person in filter(None, part.people) if opaque else ():
        person.linear, person.alpha = person.foreground, np.ones_like(person.alpha)
    return part


def _person_pixels(person: Person, part: _Layers, share: np.ndarray) -> _PersonPixels | None:
    rows = max(part.top, person.crop.rows[0]), min(part.top + len(part.foreground), person.crop.rows[1])
    if rows[0] >= rows[1]:
        return None
    first, last = person.crop.columns
    where = np.flatnonzero(person.coverage[slice(*rows), first:last])
    down, right = np.divmod(where, last - first)
    index = down + rows[0] - part.top, right + first
    flat = np.ravel_multi_index(index, part.alpha.shape)  # faster to read by
    linear, foreground = (
        np.asfortranarray(image.reshape(-1, 3).take(flat, axis=0)) for image in (part.linear, part.foreground)
    )
    alpha = share.take(flat)[:, None]
    detail = person.detail(foreground, rows, where)
    excess = np.zeros_like(foreground)
    clipped = (foreground > CLIPPING).any(-1)
    if clipped.any():
        chroma = person.crop.place(person.chroma, rows, cubic=False, where=where[clipped])
        excess[clipped] = clipping_excess(foreground[clipped], chroma)
    return _PersonPixels(person, rows, where, index, linear, alpha, foreground, detail, excess)


def _compose(
    out: np.ndarray,
    part: _Layers,
    maps: Sequence[tuple[FittedMap, ...]],
    behind: np.ndarray | None,
    stops: float = 0.0,
) -> None:
    """Relights a part of a photo in `out`, which holds the photo unless there is something `behind`."""
    front = None if behind is None else part.foreground.copy()
    for person, fits in zip(part.people, maps):
        if person is None:
            continue
        values = _relight(person, fits, np.float32(2**stops), scene=out.dtype.kind == "f")
        if front is None:
            out[person.index] = to_codes(person.linear + person.alpha * (values - person.foreground), out.dtype)
        else:
            front[person.index] = values
    if front is not None and behind is not None:
        out[:] = to_codes(over(front, part.alpha, behind), out.dtype)


def _relight(pixels: _PersonPixels, fits: tuple[FittedMap, ...], factor: np.float32, scene: bool) -> np.ndarray:
    """Relights the person's own color; highlights are rolled off unless the photo is linear (`scene`)."""
    *albedo, last = fits
    crop = pixels.person.crop
    values = last.place(crop, luma(pixels.detail), pixels.rows, pixels.where) * factor
    if not albedo:
        return pixels.foreground * values if scene else apply_gain(pixels.foreground, values, pixels.excess)
    product = albedo[0].place(crop, pixels.detail, pixels.rows, pixels.where) ** 2 * values
    return product if scene else roll_off(product)


def strips(first: int, last: int) -> Iterator[tuple[int, int]]:
    """Yields the first row and the end of each part of the rows [first, last), of at most STRIP rows."""
    for row in range(first, last, STRIP):
        yield row, min(row + STRIP, last)


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
    out = linear.copy()
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
