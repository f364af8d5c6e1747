"""Moving people: the maps of each frame, steadied by those of the frames around it.

A network that sees frames one by one flickers. The light of a clip hardly changes, so it is averaged over a second;
the square around the figure moves smoothly; transport is averaged over neighbouring frames only where the picture
itself stayed the same, so that a moving arm does not leave a trace.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import TypeVar

import numpy as np

from relight.photos.frame import Frame
from relight.photos.infer import Figure

T = TypeVar("T")
LIGHT, BOX, TRANSPORT = 12, 4, 1  # frames to each side that take part in the averages
CHANGE = 0.06  # of linear picture values: pixels that differ by more from the neighbouring frame count as moved


def steady(
    frames: Iterable[tuple[np.ndarray, np.ndarray]],
    box: Callable[[np.ndarray], Frame],
    look: Callable[[np.ndarray, np.ndarray, Frame], Figure],
) -> Iterator[tuple[np.ndarray, Figure]]:
    """For each (pixels, coverage), the pixels and their Figure with steady square, light and transport.

    box: coverage -> its own square; look: (pixels, coverage, square) -> Figure. Works as a stream: no more than
    LIGHT + BOX frames are held to either side.
    """
    boxed = ((pixels, coverage, box(coverage)) for pixels, coverage in frames)
    looked = (_look_steadily(near, i, look) for near, i in windows(boxed, BOX))
    for near, i in windows(looked, LIGHT):
        weights = _bell(len(near), i, LIGHT)
        light = np.tensordot(weights, np.stack([figure.light for _, figure in near]), 1)
        around = [figure for _, figure in near[max(i - TRANSPORT, 0) : i + TRANSPORT + 1]]
        pixels, figure = near[i]
        yield pixels, figure.with_maps(light=light.astype(np.float32), transport=_steady_transport(figure, around))


def _look_steadily(near: list, i: int, look: Callable) -> tuple[np.ndarray, Figure]:
    pixels, coverage, _ = near[i]
    return pixels, look(pixels, coverage, _steady_box([square for _, _, square in near], i))


def windows(items: Iterable[T], radius: int) -> Iterator[tuple[list[T], int]]:
    """For each item, those at most `radius` before and after it, and its own place among them."""
    stream = iter(items)
    near = list(islice(stream, radius + 1))
    centre = 0
    while centre < len(near):
        yield near, centre
        near = near + list(islice(stream, 1))
        centre += 1
        if centre > radius:
            near, centre = near[1:], centre - 1


def _bell(count: int, centre: int, radius: int) -> np.ndarray:
    """Weights of `count` frames around `centre`, a Gaussian that ends at 2 sigma."""
    weights = np.exp(-2 * ((np.arange(count) - centre) / radius) ** 2)
    return weights / weights.sum()


def _steady_box(boxes: list[Frame], i: int) -> Frame:
    weights = _bell(len(boxes), i, BOX)
    top, left, side = weights @ np.array([[b.top, b.left, b.side] for b in boxes])
    return Frame(float(top), float(left), float(side), boxes[i].rows, boxes[i].columns, boxes[i].size)


def _steady_transport(figure: Figure, around: list[Figure]) -> np.ndarray:
    total = np.zeros_like(figure.transport)
    weight = np.zeros((*figure.mask.shape, 1), np.float32)
    for other in around:
        change = np.abs(other.image - figure.image).max(-1)
        same = np.exp(-0.5 * (change / CHANGE) ** 2) * (figure.mask & other.mask)
        total += same[..., None] * other.transport
        weight += same[..., None]
    return np.where(weight > 0, total / np.maximum(weight, 1e-6), figure.transport)
