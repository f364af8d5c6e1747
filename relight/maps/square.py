"""The square of a photo that the network is given, and the way back to the photo's pixels.

The square is that of the training images (docs/conventions.md): the person's box is centred in it, and the longer side
of the box is 1 - 2 * PADDING of its side. Its corners fall between the pixels of the photo and may lie outside of it.
Both directions use the same real-valued square and pixel centres, so maps return to the place they were taken from.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import product

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt
from threadpoolctl import ThreadpoolController

from relight.core.errors import UserError
from relight.core.srgb import to_bytes

MASK_THRESHOLD = 128  # coverage (of 255) from which a pixel counts as the person's
PADDING = 0.05  # margin around the person's box, as a share of the square's side
TILE = 256  # pixels of a part's side: the maps of a part stay in the processor's cache
Window = tuple[slice, ...]  # rows and columns of a photo
_threads = cache(ThreadpoolController)  # it looks for all libraries that are loaded, once


@dataclass(frozen=True)
class Crop:
    """A square of a photo, resampled to the network's size.

    Attributes:
        top, left: the square's upper left corner, in pixels of the photo: real numbers, where pixel i spans [i, i+1).
        side: side of the square, in pixels of the photo, real.
        rows, columns: half-open ranges of the photo's pixels with coverage of the person. Soft edges may reach past the
            square, by half of its side at most.
        size: S, the side of the network's image in pixels.
    """

    top: float
    left: float
    side: float
    rows: tuple[int, int]
    columns: tuple[int, int]
    size: int

    @property
    def window(self) -> Window:
        """The rows and columns of the photo that `place` fills, as an index of its pixels."""
        return slice(*self.rows), slice(*self.columns)

    def extract(self, image: np.ndarray) -> np.ndarray:
        """Resamples a photo to the square.

        Args:
            image: (H,W) or (H,W,C), in the size of the photo.

        Returns:
            (S,S) or (S,S,C) float32; 0 outside of the photo.
        """
        # A canvas of whole pixels that holds the square, with a pixel to spare on each side; zero outside of the photo.
        top, left = int(np.floor(self.top)) - 1, int(np.floor(self.left)) - 1
        reach = int(np.ceil(self.side)) + 3
        rows, columns = (
            slice(max(start, 0), min(start + reach, count)) for start, count in zip((top, left), image.shape)
        )
        on_canvas = slice(columns.start - left, columns.stop - left)
        above, beside = self.top - top, self.left - left
        kind = Image.Resampling.BILINEAR  # a tent as wide as two of the coarser pixels: no ringing, hardly any shift
        image = image if image.ndim == 3 else image[..., None]
        out = np.empty((self.size, self.size, image.shape[2]), np.float32)
        for channel in range(image.shape[2]):
            narrow = np.zeros((reach, self.size), np.float32)  # resampled along the rows, as Pillow does first
            for first in range(rows.start, rows.stop, TILE):
                part = image[first : min(first + TILE, rows.stop), columns, channel]
                canvas = np.zeros((len(part), reach), np.float32)
                canvas[:, on_canvas] = part
                size, across = (self.size, len(part)), (beside, 0, beside + self.side, len(part))
                narrow[first - top :][: len(part)] = np.asarray(Image.fromarray(canvas).resize(size, kind, across))
            down = (0, above, self.size, above + self.side)
            out[..., channel] = np.asarray(Image.fromarray(narrow).resize((self.size, self.size), kind, down))
        return out[..., 0] if out.shape[2] == 1 else out

    def place(self, maps: np.ndarray, window: Window | None = None, cubic: bool = True) -> np.ndarray:
        """Resamples maps of the square to the pixels of the photo.

        Args:
            maps: (S,S) or (S,S,C).
            window: some of the photo's rows and columns, `self.window` by default; it costs h w S, so large ones are
                parted (`tiles`). Parts equal the whole but for rounding.
            cubic: interpolation where maps are enlarged; bilinear otherwise, which is cheaper and does not ring.

        Returns:
            (h,w) or (h,w,C) float32; channels come first in memory.
        """
        scale = self.size / self.side  # pixels of the square per pixel of the photo
        kind = Image.Resampling.BICUBIC if scale < 1 and cubic else Image.Resampling.BILINEAR

        def weights(part: slice, origin: float) -> tuple[slice, np.ndarray]:
            span = (part.start - origin) * scale, (part.stop - origin) * scale
            return _resampling(self.size, span, part.stop - part.start, kind)

        (rows, down), (columns, across) = map(weights, window or self.window, (self.top, self.left))
        planes = np.ascontiguousarray(np.moveaxis(np.atleast_3d(maps[rows, columns]), -1, 0), np.float32)
        with _threads().limit(limits=1, user_api="blas"):  # others spin while they wait: tenfold on busy cores
            placed = down @ planes @ across.T
        return placed[0] if maps.ndim == 2 else np.moveaxis(placed, 0, -1)


@lru_cache(maxsize=256)
def _resampling(size: int, span: tuple[float, float], count: int, kind: Image.Resampling) -> tuple[slice, np.ndarray]:
    """Returns the weights (count, n) by which Pillow resamples a line, and which n of its `size` values they are of.

    They are its results for unit vectors. The line goes on with copies of its ends; `span` is in its values.
    """
    margin = int(np.ceil(max(-span[0], span[1] - size, 0))) + 2
    units = np.pad(np.eye(size, dtype=np.float32), ((margin, margin), (0, 0)), mode="edge")
    box = (0, span[0] + margin, size, span[1] + margin)
    weights = np.asarray(Image.fromarray(units).resize((size, count), kind, box))
    used = np.flatnonzero(weights.any(0))
    line = slice(int(used[0]), int(used[-1]) + 1)
    return line, np.ascontiguousarray(weights[:, line])


def tiles(rows: tuple[int, int], columns: tuple[int, int]) -> Iterator[Window]:
    """Yields the parts, of at most TILE x TILE pixels, of half-open ranges of rows and columns."""
    down, across = (
        [slice(start, min(start + TILE, last)) for start in range(first, last, TILE)] for first, last in (rows, columns)
    )
    yield from product(down, across)


def crop_around(coverage: np.ndarray, size: int) -> Crop:
    """Finds the square around a person, whose box is that of the pixels that reach MASK_THRESHOLD.

    Args:
        coverage: (H,W) uint8, of the photo's pixels by the person.
        size: side of the network's image, pixels.

    Returns:
        The square; `rows` and `columns` also hold soft edges, to half of its side past it.

    Raises:
        UserError: if no pixel reaches MASK_THRESHOLD.
    """
    rows, columns = extent(coverage >= MASK_THRESHOLD)
    height, width = rows[1] - rows[0], columns[1] - columns[0]
    side = max(height, width) / (1 - 2 * PADDING)
    top, left = (sum(rows) - side) / 2, (sum(columns) - side) / 2
    covered_rows, covered_columns = extent(coverage > 0)

    def near_square(covered: tuple[int, int], start: float) -> tuple[int, int]:
        """Limits a half-open range to half of the square's side before `start`, where it begins, and after its end."""
        return max(covered[0], int(start - side / 2)), min(covered[1], int(start + 1.5 * side) + 1)

    return Crop(top, left, side, near_square(covered_rows, top), near_square(covered_columns, left), size)


def figure_means(
    coverage: np.ndarray, mask: np.ndarray, box: Crop
) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Returns the figure's mask on a square, and a function that averages maps over the figure in each of its pixels.

    Args:
        coverage: (H,W) of the photo's pixels by the figure, in [0,1].
        mask: (H,W) bool, where maps are known.
        box: the square, of S pixels.

    Returns:
        The mask (S,S) bool; a function from values (H,W,C) to their means (S,S,C), zero outside the mask.
    """
    inside = box.extract(to_bytes(coverage)) >= MASK_THRESHOLD
    weight = coverage * mask
    total = np.maximum(box.extract(weight), 1e-3)[..., None]  # not 0, by which it divides

    def mean(values: np.ndarray) -> np.ndarray:
        sums = box.extract(values * weight[..., None]).reshape(*inside.shape, -1)  # `extract` drops a single channel
        return sums / total * inside[..., None]

    return inside, mean


def fill_outside(maps: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Replaces every pixel of `maps` (S,S[,C]) outside `mask` (S,S) by the nearest one inside.

    Maps are unknown outside. Without this, interpolation would mix what stands there into the person's edge.
    """
    return maps[tuple(distance_transform_edt(~mask, return_distances=False, return_indices=True))]


def extent(mask: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    """Returns the half-open ranges of rows and of columns that hold what is true in a mask (H,W).

    Raises:
        UserError: if there is nothing.
    """
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        raise UserError("the mask is empty: no pixel of it is at least half white")
    return (int(rows[0]), int(rows[-1]) + 1), (int(columns[0]), int(columns[-1]) + 1)
