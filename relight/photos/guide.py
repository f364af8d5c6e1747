"""Maps of the network's square at the resolution of the photo, with the photo as guide.

The guided filter (He, Sun and Tang 2013; its fast form, He and Sun 2015) explains a map by an image: in each small
window map = slope * guide + offset. The slopes are fitted on the square and applied to the detail that the photo has
beyond the square's resolution, so a map that changes at an edge of the photo changes at that edge and not up to a
network pixel beside it. Without such detail, the result is the map itself.
"""

import numpy as np
from scipy.ndimage import distance_transform_edt, maximum_filter, minimum_filter, uniform_filter

from relight.core.srgb import LUMINANCE
from relight.maps.square import Crop, Window

RADIUS = 2  # of a window, pixels of the square
SMOOTH = 1e-3  # variance of the guide under which a window counts as flat: weaker texture is not copied
SMOOTH_ALBEDO = 1e-4  # the same for albedo, whose texture is the photo's


class Guide:
    """An image that guides maps to the photo's pixels. Its window statistics are computed once, for any number of maps.

    Attributes:
        values: (S,S,1) or (S,S,C) float64.
        mask: (S,S) bool, of the person.
        filled: (S,S,...) float32, the values with those of the nearest pixel of the mask outside of it.
    """

    def __init__(self, values: np.ndarray, mask: np.ndarray):
        self.values, self.mask = values.astype(np.float64), mask
        self._weight = mask[..., None].astype(np.float64)
        self._total = np.maximum(_window_mean(self._weight), 1e-12)
        self._average = self._mean(self.values)
        self._variance = np.maximum(self._mean(self.values**2) - self._average**2, 0)
        self._nearest = tuple(distance_transform_edt(~mask, return_distances=False, return_indices=True))
        self.filled = self.fill_outside(values)

    def slope(self, maps: np.ndarray, smooth: float) -> np.ndarray:
        """Fits maps to the guide by least squares over the mask in each window, averaged over windows.

        Args:
            maps: (S,S,C). If the guide has several channels, each is fitted to its own.
            smooth: ridge penalty, in units of the guide's variance.

        Returns:
            (S,S,C) change of the maps per change of the guide.
        """
        maps = maps.astype(np.float64)
        level = self._mean(maps)
        return self._mean((self._mean(self.values * maps) - self._average * level) / (self._variance + smooth))

    def fill_outside(self, maps: np.ndarray) -> np.ndarray:
        """Returns maps (S,S,C) as float32, with the value of the nearest pixel of the mask outside of it."""
        return np.asarray(maps, np.float32)[self._nearest]

    def _mean(self, values: np.ndarray) -> np.ndarray:
        """Returns means (S,S,C) of values over the pixels inside of each window."""
        return _window_mean(self._weight * values) / self._total


class FittedMap:
    """A map on the square and its slope along the guide; pixels outside the guide's mask take the nearest value inside.

    Attributes:
        base: (S,S,C) the map.
        slope: (S,S,C).
        range: the least and the largest value of the map nearby, (S,S,C) each; empty if it is only kept within [0,1].
    """

    def __init__(self, maps: np.ndarray, guide: Guide, textured: bool = False):
        """Fits a map to a guide.

        Args:
            maps: (S,S,C).
            guide: of the same size.
            textured: whether the map has the photo's own texture and lies in [0,1], as albedo does.
        """
        self.base = guide.fill_outside(maps)
        self.slope = guide.fill_outside(guide.slope(maps, SMOOTH_ALBEDO if textured else SMOOTH))
        extremes = () if textured else (minimum_filter, maximum_filter)
        self.range = [extreme(self.base, (3, 3, 1), mode="nearest") for extreme in extremes]

    def place(self, crop: Crop, detail: np.ndarray, window: Window) -> np.ndarray:
        """Resamples the map to a window of the photo, (h,w,C), with detail: as `Crop.place` does.

        The result stays within the values that the map has nearby, so a highlight of the photo leaves no halo. `detail`
        (h,w,1) or (h,w,C) is the guide at those pixels minus that of the square.
        """
        values = crop.place(self.base, window) + crop.place(self.slope, window, cubic=False) * detail
        low, high = [crop.place(maps, window, cubic=False) for maps in self.range] or (0, 1)
        return np.clip(values, low, high, out=values)


def _window_mean(values: np.ndarray) -> np.ndarray:
    """Returns means (S,S,C) over windows of 2 RADIUS + 1 pixels a side; values beyond the border are 0."""
    size = 2 * RADIUS + 1
    return uniform_filter(values, (size, size, 1), mode="constant")


def square_root(linear: np.ndarray) -> np.ndarray:
    """Returns the square roots of linear values (...,3), a scale on which noise and visible steps are about uniform."""
    return np.sqrt(np.maximum(linear, 0))


def luma(guide: np.ndarray) -> np.ndarray:
    """Returns the weighted sum of the channels: (...,3) -> (...,1)."""
    return sum(weight * guide[..., c] for c, weight in enumerate(LUMINANCE.astype(np.float32)))[..., None]
