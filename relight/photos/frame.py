"""The square that the network sees of a photo, and the way back to the photo's own pixels.

The square is that of the training images (docs/conventions.md): the figure's box centred, its larger side
1 - 2 * padding of the square's. Its corners fall between the photo's pixels and may lie outside the photo; both
directions use the same real-valued square and pixel centres, so what is placed back lies where it was taken from.
"""

from dataclasses import dataclass

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt

from relight.files import UserError

SOLID = 128  # coverage (of 255) from which a pixel belongs to the figure


@dataclass(frozen=True)
class Frame:
    """top, left, side: the square in photo pixels (real numbers; pixel i spans [i, i+1)).

    rows, columns: the half-open part of the photo that holds all of the figure's coverage, soft edges that reach past
    the square included (by half its side at most); size: pixels of the network's square image.
    """

    top: float
    left: float
    side: float
    rows: tuple[int, int]
    columns: tuple[int, int]
    size: int

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w) of the part of the photo that `place` fills."""
        return self.rows[1] - self.rows[0], self.columns[1] - self.columns[0]

    @property
    def window(self) -> tuple[slice, slice]:
        """The same part, as an index into the photo."""
        return slice(*self.rows), slice(*self.columns)

    def crop(self, image: np.ndarray) -> np.ndarray:
        """Photo-sized (H,W) or (H,W,C) -> (size,size[,C]) float32; what lies outside the photo is 0."""
        top, left = int(np.floor(self.top)) - 1, int(np.floor(self.left)) - 1  # an integer canvas around the square
        reach = int(np.ceil(self.side)) + 3
        rows = slice(max(top, 0), min(top + reach, image.shape[0]))
        columns = slice(max(left, 0), min(left + reach, image.shape[1]))
        canvas = np.zeros((reach, reach), np.float32)
        box = (self.left - left, self.top - top, self.left - left + self.side, self.top - top + self.side)
        kind = Image.Resampling.BILINEAR  # a tent as wide as two of the coarser pixels: no ringing, hardly any shift
        image = image if image.ndim == 3 else image[..., None]
        out = np.empty((self.size, self.size, image.shape[2]), np.float32)
        for channel in range(image.shape[2]):
            canvas[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = image[
                rows, columns, channel
            ]
            out[..., channel] = np.asarray(
                Image.fromarray(canvas).resize((self.size, self.size), kind, box, reducing_gap=None)
            )
        return out[..., 0] if out.shape[2] == 1 else out

    def place(
        self,
        maps: np.ndarray,
        rows: tuple[int, int] | None = None,
        cubic: bool = True,
        where: np.ndarray | None = None,
    ) -> np.ndarray:
        """(size,size) or (size,size,C) -> (h,w[,C]) float32 at the photo's pixels in `self.window`.

        where: flat indices (N,) into (h,w), to get only those pixels, (N[,C]).
        rows: only these rows of the photo (half-open, within self.rows), for pictures too large to hold at once;
        strips equal the whole but for rounding. cubic: when enlarging; else linear, which is cheaper and does not ring.
        """
        first, last = rows or self.rows
        scale = self.size / self.side
        margin = self._beyond(scale)
        box = (self.columns[0] - self.left, first - self.top, self.columns[1] - self.left, last - self.top)
        box = tuple(edge * scale + margin for edge in box)
        shape = (self.columns[1] - self.columns[0], last - first)
        kind = Image.Resampling.BICUBIC if scale < 1 and cubic else Image.Resampling.BILINEAR
        maps = maps if maps.ndim == 3 else maps[..., None]
        size = (shape[1], shape[0]) if where is None else where.shape
        out = np.empty((maps.shape[2], *size), np.float32)  # channel by channel, as it is filled and read
        for channel in range(maps.shape[2]):
            padded = np.pad(maps[..., channel].astype(np.float32), margin, mode="edge")
            placed = np.asarray(Image.fromarray(padded).resize(shape, kind, box))
            out[channel] = placed if where is None else placed.ravel()[where]
        return out[0] if len(out) == 1 else np.moveaxis(out, 0, -1)

    def _beyond(self, scale: float) -> int:
        """How many of the square's own pixels the window reaches past its edges, on the side where it does so most."""
        low = min(self.rows[0] - self.top, self.columns[0] - self.left)
        high = max(self.rows[1] - self.top, self.columns[1] - self.left) - self.side
        return max(int(np.ceil(max(-low, high) * scale)), 0) + 2


def frame(coverage: np.ndarray, size: int, padding: float = 0.05) -> Frame:
    """The square around the solid part of `coverage` (H,W) uint8. Raises UserError when nothing is solid."""
    rows, columns = _extent(coverage >= SOLID)
    height, width = rows[1] - rows[0], columns[1] - columns[0]
    side = max(height, width) / (1 - 2 * padding)
    top, left = (sum(rows) - side) / 2, (sum(columns) - side) / 2
    rows, columns = _extent(coverage > 0)

    def near(span: tuple[int, int], start: float) -> tuple[int, int]:
        return max(span[0], int(start - side / 2)), min(span[1], int(start + 1.5 * side) + 1)

    return Frame(top, left, side, near(rows, top), near(columns, left), size)


def extend(maps: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """`maps` (S,S[,C]) with every pixel outside `mask` set to the nearest one inside.

    What is outside is not known; without this, placing back would bleed it into the figure's edge.
    """
    nearest = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return maps[tuple(nearest)]


def _extent(mask: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        raise UserError("the mask is empty: no pixel of it is at least half white")
    return (int(rows[0]), int(rows[-1]) + 1), (int(columns[0]), int(columns[-1]) + 1)
