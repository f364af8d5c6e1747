"""Maps of the network's square at the photo's own resolution, with the photo as guide.

The guided filter (He, Sun and Tang 2013; its fast form, He and Sun 2015) explains a map by the picture: in each small
window map = slope * guide + offset. The slopes are found on the network's square and carried to the photo's pixels,
where they multiply what the photo shows beyond the square's resolution: a map that changes where the photo has an edge
changes at that edge, and not a network pixel beside it. The map itself is kept: where the photo shows no more than the
square, the result is the map.

The rim of the figure, where the network sees least and is wrong most, is held to the figure's inside.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion, distance_transform_edt, maximum_filter, minimum_filter, uniform_filter

from relight.photos.frame import Frame
from relight.srgb import LUMINANCE

RADIUS = 2  # of a window, pixels of the square
RIM = 1  # pixels of the square along the silhouette
NEAR = 5  # width of the square in which the inside beside the rim is looked at
SLACK = 0.5
SMOOTH = 1e-3  # variance of the guide under which a window counts as flat: texture that weak is not copied
ALIKE = 1e-4  # the same for a map that is as fine as the photo: albedo


class Guide:
    """A picture (S,S,1) or (S,S,C) by which maps are brought to the photo's pixels, over a figure's mask (S,S).

    What the windows hold of it is found once, for any number of maps.
    """

    def __init__(self, values: np.ndarray, mask: np.ndarray):
        self.values, self.mask = values.astype(np.float64), mask
        self._weight = mask[..., None].astype(np.float64)
        self._total = np.maximum(_sum(self._weight), 1e-12)
        self._average = self._mean(self.values)
        self._spread = np.maximum(self._mean(self.values**2) - self._average**2, 0)
        self._nearest = tuple(distance_transform_edt(~mask, return_distances=False, return_indices=True))

    def slope(self, maps: np.ndarray, smooth: float) -> np.ndarray:
        """(S,S,C): of `maps` on the guide by weighted least squares in windows, averaged over windows. To a guide of
        several channels maps are fitted channel by channel.
        """
        maps = maps.astype(np.float64)
        level = self._mean(maps)
        return self._mean((self._mean(self.values * maps) - self._average * level) / (self._spread + smooth))

    def extended(self, maps: np.ndarray) -> np.ndarray:
        """`maps` (S,S,C) with what is nearest inside the mask in place of what is outside."""
        return np.asarray(maps, np.float32)[self._nearest]

    def _mean(self, what: np.ndarray) -> np.ndarray:
        return _sum(self._weight * what) / self._total


@dataclass(frozen=True)
class Fitted:
    """A map on the square, (S,S,C), and how it goes with the guide: slope, and the least and most that it has near.

    low and high are None for what is as fine as the photo, and a share: it is only held between 0 and 1.
    """

    base: np.ndarray
    slope: np.ndarray
    low: np.ndarray | None
    high: np.ndarray | None

    def place(
        self, frame: Frame, detail: np.ndarray, rows: tuple[int, int], where: np.ndarray | None = None
    ) -> np.ndarray:
        """(h,w,C) at the photo's pixels of `rows`, or (N,C) at those with the flat indices `where` (N,).

        detail: what the guide has beyond the square at the same pixels, (h,w,1) or (h,w,C), or (N,...). The result is
        held between the values that the map has near: a highlight in the photo does not become a halo in the map.
        """

        def place(maps: np.ndarray, cubic: bool = False) -> np.ndarray:
            placed = frame.place(maps, rows, cubic, where)
            return placed if maps.shape[2] > 1 else placed[..., None]

        values = place(self.base, cubic=True) + place(self.slope) * detail
        if self.low is None:
            return np.clip(values, 0, 1, out=values)
        return np.clip(values, place(self.low), place(self.high), out=values)


def fitted(maps: np.ndarray, guide: Guide, fine: bool = False) -> Fitted:
    """Fits `maps` (S,S,C) to `guide`. Outside its mask the nearest inside is taken.

    fine: the map has the photo's own texture, as albedo has.
    """
    base, slope = guide.extended(maps), guide.extended(guide.slope(maps, ALIKE if fine else SMOOTH))
    return Fitted(base, slope, *((None, None) if fine else _extremes(base, np.ones_like(guide.mask), 3)))


def from_inside(maps: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """`maps` (S,S,C) with the figure's rim, RIM pixels wide, held to what the inside beside it has.

    What differs from the inside's least or most by more than SLACK of their difference is cut there, so that a
    gradient toward the silhouette goes on and a wrong pixel does not stand out. A part as thin as its own rim, such as
    a finger, stays as it is.
    """
    inside = binary_erosion(mask, iterations=RIM)
    low, high = _extremes(maps, inside, NEAR)
    rim = (mask & ~inside & (low[..., 0] < np.inf))[..., None]
    low, high = (np.where(rim, each, maps) for each in (low, high))
    slack = SLACK * (high - low)
    return np.clip(maps, low - slack, high + slack).astype(np.float32)


def _extremes(values: np.ndarray, where: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest of `values` (S,S,C) over `where` (S,S) in squares of `width`; +-inf where there is none."""
    size = (width, width, 1)
    low = minimum_filter(np.where(where[..., None], values, np.inf), size, mode="nearest")
    return low, maximum_filter(np.where(where[..., None], values, -np.inf), size, mode="nearest")


def _sum(values: np.ndarray) -> np.ndarray:
    """Means over windows, without regard to what counts."""
    size = 2 * RADIUS + 1
    return uniform_filter(values, (size, size, 1), mode="constant")


def root(linear: np.ndarray) -> np.ndarray:
    """The guide (...,3) of linear values: their square roots, in which the eye and noise are about uniform."""
    return np.sqrt(np.maximum(linear, 0))


def luma(guide: np.ndarray) -> np.ndarray:
    """(...,3) -> (...,1)."""
    return (guide @ LUMINANCE.astype(np.float32))[..., None]
