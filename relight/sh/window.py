"""A window against ringing: a lamp in few harmonics has negative lobes, which give shadows a wrong color.

Where red light rings below zero and blue light does not, clipping leaves blue. So the side away from a warm lamp turns
navy. A window damps the bands above 0 until nothing is negative; it belongs to a light, and not to the points that it
shines on (Sloan, "Stupid Spherical Harmonics Tricks", 2008).
"""

import numpy as np

from relight.sh.harmonics import order_of, sphere_spiral, unoccluded

LEAST = 0.05  # of the mean irradiance of a channel: what a windowed light leaves in its darkest direction
DIRECTIONS = 1000  # in which irradiance is looked at; between them it is lower by less than 0.01 of the mean


def deringed(light: np.ndarray) -> np.ndarray:
    """Windows a light just so far that the irradiance of no channel falls below LEAST of its mean.

    All channels and all bands above 0 have the same factor. So the mean color stays; soft light stays as it is, and so
    does light that was windowed before. Other windows, which damp high bands more, keep less of a lamp and are not
    nearer to the true irradiance (docs/lab/tried.md). A distant lamp alone gets the factor 0.82; a surface that faces
    it keeps 0.86 of its irradiance.

    Args:
        light: (K,3) radiance.

    Returns:
        (K,3) float64.

    >>> lamp = np.array([[0.282], [0], [0.489], [0], [0], [0], [0.631], [0], [0]]) * [1, 1, 1]
    >>> (deringed(lamp)[2] / lamp[2]).round(2).tolist()
    [0.82, 0.82, 0.82]
    """
    light = np.asarray(light, np.float64)
    transport = unoccluded(sphere_spiral(DIRECTIONS), order_of(len(light)))
    mean = transport[0, 0] * light[0]  # irradiance of each channel, (3,)
    depth = -(transport[:, 1:] @ light[1:]).min(0, initial=0)  # how far each channel falls below its mean, (3,)
    falls = depth > 1e-12 * max(mean.max(), 0)  # a channel without light does not
    if not falls.any() or (mean <= 0).all():
        return light
    factors = (1 - LEAST) * np.maximum(mean[falls], 0) / depth[falls]  # with its factor, a channel falls to LEAST
    windowed = light.copy()
    windowed[1:] *= min(factors.min(), 1)
    return windowed
