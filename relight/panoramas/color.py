"""Colors of black bodies and daylight, luminance, and conversion between primaries."""

import numpy as np
from numpy.typing import ArrayLike

from relight.core.srgb import LUMINANCE

# CIE XYZ to linear Rec. 709, white D65 (ITU-R BT.709).
XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # x and y of the primaries and of white
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)  # the same of CIE XYZ, whose primaries are imaginary
# XYZ to responses of the cones (Lam 1985, "Metamerism and Colour Constancy").
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Returns the relative luminance (...) of linear Rec. 709 colors (...,3)."""
    return rgb @ LUMINANCE


def blackbody(temperature: float) -> np.ndarray:
    """Returns the color of a black body of 1,667 to 25,000 K, (3,) linear Rec. 709 of luminance 1.

    Chromaticity by the cubic splines of Kim et al. 2002 (J. Korean Phys. Soc. 41, 865). Below 1,900 K blue would be
    negative and is zero.
    """
    t = 1000 / temperature  # 1 / kilokelvin
    warm, cool = (-0.2661239, -0.2343589, 0.8776956, 0.179910), (-3.0258469, 2.1070379, 0.2226347, 0.240390)
    x = np.polyval(warm if temperature <= 4000 else cool, t)
    if temperature <= 2222:
        y = np.polyval((-1.1063814, -1.34811020, 2.18555832, -0.20219683), x)
    elif temperature <= 4000:
        y = np.polyval((-0.9549476, -1.37418593, 2.09137015, -0.16748867), x)
    else:
        y = np.polyval((3.0817580, -5.87338670, 3.75112997, -0.37001483), x)
    return from_chromaticity(float(x), float(y))


def daylight(temperature: float) -> np.ndarray:
    """Returns the color of a phase of daylight of 4,000 to 25,000 K, (3,) linear Rec. 709 of luminance 1.

    These are the CIE's D illuminants (CIE 15:2004, equations 3.3 and 3.4).
    """
    t = 1000 / temperature  # 1 / kilokelvin
    warm, cool = (-4.6070, 2.9678, 0.09911, 0.244063), (-2.0064, 1.9018, 0.24748, 0.237040)
    x = np.polyval(warm if temperature <= 7000 else cool, t)
    return from_chromaticity(float(x), float(np.polyval((-3.0, 2.870, -0.275), x)))


def from_chromaticity(x: float, y: float) -> np.ndarray:
    """Returns the color of a CIE 1931 chromaticity, (3,) linear Rec. 709 of luminance 1, clipped to the gamut."""
    color = np.maximum(XYZ_TO_RGB @ np.array([x / y, 1.0, (1 - x - y) / y]), 0)
    return color / luminance(color)


def convert_primaries(pixels: np.ndarray, chromaticities: ArrayLike | None) -> list[str]:
    """Converts pixels to Rec. 709, in place.

    Args:
        pixels: (H,W,3) float32, linear.
        chromaticities: x and y of the primaries and of white (8,) of the pixels; None for those of Rec. 709.

    Returns:
        What was changed as one sentence, or an empty list.
    """
    if chromaticities is None:
        return []
    if (matrix := chromaticity_matrix(chromaticities)) is None:
        return ["its chromaticities are not those of a color space: they were taken for Rec. 709"]
    if np.allclose(chromaticities, REC709, atol=2e-3):
        return []
    for row in range(0, len(pixels), 256):  # 256 rows at a time, to limit memory
        pixels[row : row + 256] = pixels[row : row + 256] @ matrix.T.astype(np.float32)
    return ["colors were converted to Rec. 709 from the file's chromaticities"]


def chromaticity_matrix(chromaticities: ArrayLike) -> np.ndarray | None:
    """Returns the matrix (3,3) from RGB of these primaries and white to linear Rec. 709; None if they are degenerate.

    White is adapted by the Bradford transform, except for XYZ, whose values are absolute.
    """
    xy = np.array(chromaticities)
    if xy.shape != (8,) or not np.all(np.isfinite(xy)):
        return None
    target, source = rgb_to_xyz(np.array(REC709)), rgb_to_xyz(xy)
    if target is None or source is None:
        return None
    adapt = np.eye(3)
    if not np.allclose(xy, XYZ, atol=2e-3):
        cone_gains = (BRADFORD @ target.sum(1)) / (BRADFORD @ source.sum(1))
        adapt = np.linalg.inv(BRADFORD) @ np.diag(cone_gains) @ BRADFORD
    return np.linalg.inv(target) @ adapt @ source


def rgb_to_xyz(xy: np.ndarray) -> np.ndarray | None:
    """Returns the matrix (3,3) from RGB to XYZ, for chromaticities (8,) of primaries and white; white has luminance 1.

    Returns None if the primaries are degenerate.
    """
    points = xy.reshape(4, 2)
    xyz = np.concatenate([points, 1 - points.sum(1, keepdims=True)], 1).T
    if abs(np.linalg.det(xyz[:, :3])) < 1e-6 or abs(xyz[1, 3]) < 1e-6:
        return None
    return xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3] / xyz[1, 3])
