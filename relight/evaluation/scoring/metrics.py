"""Measures of errors, which all scores share: those of the tables, of the benchmark, and of benchmarks/photographs.py.

Arrays are (...,P,C): C channels of the P pixels inside a mask. Where a measure is said to be scaled, the values are
first multiplied by the factor that brings them nearest to the truth, since a photograph does not determine a scene's
brightness.
"""

import numpy as np
from skimage.metrics import structural_similarity

from relight.sh import cosine_factors, order_of, per_coefficient

WINDOW = 7  # pixels, side of SSIM's windows: scikit-image's default
MIN_SQUARED_ERROR = 1e-10  # of PSNR, which is at most 100 dB


def rmse(inferred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Returns the RMSE (...) over pixels of the vector norm of differences (...,P,C)."""
    difference = inferred - truth
    return np.sqrt(np.einsum("...pc,...pc->...", difference, difference) / difference.shape[-2])


def scaled_rmse(inferred: np.ndarray, truth: np.ndarray) -> float:
    """Returns the RMSE of values (P,C) that are scaled by the best factor."""
    return float(rmse(best_scale(inferred, truth) * inferred, truth))


def best_scale(inferred: np.ndarray, truth: np.ndarray) -> float:
    """Returns the factor on `inferred` that minimises the squared difference from `truth`, of any equal shape."""
    return float((inferred * truth).sum() / max((inferred**2).sum(), 1e-9))


def psnr(inferred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Returns the peak signal-to-noise ratio (...) in dB of codes (...,P,C) in [0,1], at most 100."""
    return -10 * np.log10(np.maximum(((inferred - truth) ** 2).mean((-2, -1)), MIN_SQUARED_ERROR))


def ssim(inferred: np.ndarray, truth: np.ndarray, span: float, window: int = WINDOW) -> np.ndarray:
    """Returns the mean structural similarity (Wang et al. 2004) over windows and channels, by scikit-image.

    Windows are uniform, and covariances are those of samples.

    Args:
        inferred: (N,H,W,C); H and W at least `window`. `MaskBox.crop` makes such pictures of the pixels of a mask.
        truth: (N,H,W,C), or (1,H,W,C) for all.
        span: data range.
        window: side of the window in pixels.

    Returns:
        (N,).
    """
    truth = np.broadcast_to(truth, (len(inferred), *truth.shape[1:]))
    pairs = zip(inferred.astype(np.float64), truth.astype(np.float64))
    return np.array([structural_similarity(*pair, win_size=window, channel_axis=-1, data_range=span) for pair in pairs])


class MaskBox:
    """The bounding box of a mask, widened to at least one window of SSIM.

    Attributes:
        shape: (height, width).
        inside: (P,) flat indices of the mask's pixels in the box.
    """

    def __init__(self, pixel: np.ndarray, width: int):
        """Finds the box of a mask by the flat indices (P,) of its pixels in an image of a width."""
        row, column = np.divmod(pixel, width)
        top, height = _widen_to_window(row.min(), row.max() + 1)
        left, box_width = _widen_to_window(column.min(), column.max() + 1)
        self.shape = height, box_width
        self.inside = (row - top) * box_width + column - left

    @classmethod
    def of(cls, mask: np.ndarray) -> "MaskBox":
        """Returns the box of a mask (H,W) bool."""
        return cls(np.flatnonzero(mask), mask.shape[1])

    def crop(self, values: np.ndarray) -> np.ndarray:
        """Returns values (N,P,C) as images (N,h,w,C) of the box, zero outside the mask."""
        box = np.zeros((len(values), self.shape[0] * self.shape[1], values.shape[-1]), np.float64)
        box[:, self.inside] = values
        return box.reshape(len(values), *self.shape, -1)

    def ssim(self, inferred: np.ndarray, truth: np.ndarray) -> float:
        """Returns the mean SSIM over windows and channels of values (P,C) in [0,1] at the mask's pixels."""
        return float(ssim(self.crop(inferred[None]), self.crop(truth[None]), span=1.0)[0])


def irradiance_error(inferred: np.ndarray, truth: np.ndarray) -> float:
    """Returns the error of the irradiance of a light (K,3) over all normals, relative to that of the true light.

    If the true light is black, it is 0 where the inferred one is black, too, and else 1.
    """
    inferred, truth = irradiance(inferred), irradiance(truth)
    return float(np.linalg.norm(inferred - truth) / (np.linalg.norm(truth) or np.linalg.norm(inferred) or 1))


def scaled_irradiance_error(inferred: np.ndarray, truth: np.ndarray) -> float:
    """Returns the relative error of the irradiance of a light (K,3) that is scaled by the best factor."""
    return irradiance_error(inferred * best_scale(irradiance(inferred), irradiance(truth)), truth)


def irradiance(light: np.ndarray) -> np.ndarray:
    """Returns the coefficients (K,3) of the irradiance of a light (K,3) of radiance coefficients."""
    return light * per_coefficient(cosine_factors(order_of(len(light))))[:, None]


def contrast(shading: np.ndarray) -> np.ndarray:
    """Returns the coefficient of variation (N,) over pixels of the grey shading (N,P,3)."""
    grey = shading.mean(-1, dtype=np.float64)
    return grey.std(-1) / np.maximum(grey.mean(-1), 1e-9)


def explained_variance(picture: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """Returns the fraction (N,) of a picture's variance over pixels that the albedo explains.

    The albedo is multiplied by the best factor for each color channel. The result is 1 if it then equals the picture,
    and 0 if it is no better than a uniform color.

    Args:
        picture: (N,P,3).
        albedo: (N or 1,P,3).
    """
    albedo = np.broadcast_to(albedo, picture.shape).astype(np.float64)
    factor = (picture * albedo).sum(1) / np.maximum((albedo**2).sum(1), 1e-12)
    residual = ((picture - factor[:, None] * albedo) ** 2).sum((1, 2))
    return 1 - residual / np.maximum(((picture - picture.mean(1, keepdims=True)) ** 2).sum((1, 2)), 1e-12)


def _widen_to_window(start: int, stop: int) -> tuple[int, int]:
    """Widens a side of the bounding box to at least one window, the same at both ends.

    The side is a half-open range of pixels. Returns its new start, which can be negative, and its new length.
    """
    padding = max(0, WINDOW - (stop - start))
    return start - padding // 2, stop - start + padding
