"""Colours of black bodies and daylight, and luminance."""

import numpy as np

from relight.srgb import LUMINANCE

# CIE XYZ to linear Rec. 709, white D65 (ITU-R BT.709).
XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Returns the relative luminance (...) of linear Rec. 709 colours (...,3)."""
    return rgb @ LUMINANCE


def blackbody(temperature: float) -> np.ndarray:
    """Returns the colour of a black body of 1,667 to 25,000 K, (3,) linear Rec. 709 of luminance 1.

    Chromaticity by the cubic splines of Kim et al. 2002 (J. Korean Phys. Soc. 41, 865). Below 1,900 K blue would be
    negative and is zero.
    """
    t = 1000 / temperature
    if temperature <= 4000:
        x = np.polyval((-0.2661239, -0.2343589, 0.8776956, 0.179910), t)
    else:
        x = np.polyval((-3.0258469, 2.1070379, 0.2226347, 0.240390), t)
    if temperature <= 2222:
        y = np.polyval((-1.1063814, -1.34811020, 2.18555832, -0.20219683), x)
    elif temperature <= 4000:
        y = np.polyval((-0.9549476, -1.37418593, 2.09137015, -0.16748867), x)
    else:
        y = np.polyval((3.0817580, -5.87338670, 3.75112997, -0.37001483), x)
    return from_chromaticity(float(x), float(y))


def daylight(temperature: float) -> np.ndarray:
    """Returns the colour of a phase of daylight of 4,000 to 25,000 K, (3,) linear Rec. 709 of luminance 1.

    These are the CIE's D illuminants (CIE 15:2004, equations 3.3 and 3.4).
    """
    t = 1000 / temperature
    if temperature <= 7000:
        x = np.polyval((-4.6070, 2.9678, 0.09911, 0.244063), t)
    else:
        x = np.polyval((-2.0064, 1.9018, 0.24748, 0.237040), t)
    return from_chromaticity(float(x), float(np.polyval((-3.0, 2.870, -0.275), x)))


def from_chromaticity(x: float, y: float) -> np.ndarray:
    """Returns the colour of a CIE 1931 chromaticity, (3,) linear Rec. 709 of luminance 1, clipped to the gamut."""
    colour = np.maximum(XYZ_TO_RGB @ np.array([x / y, 1.0, (1 - x - y) / y]), 0)
    return colour / luminance(colour)
