"""Statistics of lights: brightness, contrast, direction, color, and whether the light is physically possible."""

import numpy as np

from relight.panoramas import luminance
from relight.sh import order_of, sphere_spiral, unoccluded
from relight.sh.conventions import POLYNOMIALS

FRONT = np.array([0.0, 0.0, 1.0])
NORMAL_COUNT = 1000  # on which the irradiance is sampled
BATCH = 4096  # lights that are measured at a time, to limit memory
MAX_BELOW = 1.1  # irradiance from below over that from above; lights beyond it get a note


def reference_brightness(lights: np.ndarray) -> np.ndarray:
    """Returns the irradiance E(0,0,1) of the brightest channel (...,) of lights (...,K,3) (method.md section 1)."""
    return np.max(unoccluded(FRONT, order_of(lights.shape[-2])) @ lights, axis=-1)


def moment_eigenvalue(lights: np.ndarray) -> np.ndarray:
    """Returns the smallest eigenvalue of the 4 x 4 moment matrix over m0; of the channels, the smallest.

    Nine coefficients are those of a non-negative radiance if and only if it is not negative (method.md section 1). At
    higher orders, the first nine coefficients are tested. At orders 0 and 1, which have no second moments, it is the
    sign of m0, or 1 - |m| / m0. Black channels are skipped unless all are black.

    Args:
        lights: (...,K,3).

    Returns:
        (...,) float64; -1 for a light that is black.
    """
    c = np.moveaxis(np.asarray(lights, np.float64), -1, -2)  # (..., 3, K)
    # Moments are integrals of radiance times 1, x, x y ...: coefficients over the factors of these in the harmonics.
    m0, *moments = np.moveaxis(c[..., :9] / POLYNOMIALS[: c.shape[-1]], -1, 0)
    positive = np.where(m0 > 0, m0, np.inf)
    if c.shape[-1] == 1:
        return np.sign(m0).min(-1)
    y, z, x = moments[:3]
    if c.shape[-1] == 4:
        return (1 - np.linalg.norm(np.stack([x, y, z], -1), axis=-1) / positive).min(-1)
    xy, yz, three_zz_minus_1, xz, xx_minus_yy = moments[3:]
    zz = (three_zz_minus_1 + m0) / 3
    xx, yy = ((m0 - zz) + xx_minus_yy) / 2, ((m0 - zz) - xx_minus_yy) / 2  # xx + yy + zz = m0
    matrix = np.stack([m0, x, y, z, x, xx, xy, xz, y, xy, yy, yz, z, xz, yz, zz], -1).reshape(*m0.shape, 4, 4)
    smallest = np.linalg.eigvalsh(matrix)[..., 0]
    black = (c == 0).all(-1)  # e.g. the green and blue channels of a red lamp, which are valid
    normalised = np.where(black, np.inf, np.where(m0 > 0, smallest / positive, -1.0)).min(-1)
    return np.where(black.all(-1), -1.0, normalised)


def measure(lights: np.ndarray) -> dict[str, np.ndarray]:
    """Computes the statistics of lights.

    Args:
        lights: (N,K,3).

    Returns:
        Arrays (N,) by name, of luminance unless a channel is named:

        reference: irradiance E(0,0,1) of the brightest channel
        front: irradiance E(0,0,1)
        mean: irradiance, mean over all normals
        least, most: irradiance of the darkest and of the brightest normal
        front_least, front_most, front_mean: the same over the normals that face the camera (z > 0)
        back_mean: mean over the other normals
        channel_most: irradiance of the brightest channel on the normals that face the camera
        up, down: irradiance of the normals (0,1,0) and (0,-1,0), over the mean
        first, second: |L1| / L00 and |L2| / L00, norms of bands 1 and 2
        elevation: elevation of the main direction, degrees above the horizon
        azimuth: azimuth of the main direction, degrees from the camera toward +x
        toward: cosine between the main direction and the direction to the camera
        red, blue: ln(R/G) and ln(B/G) of the mean radiance
        moment: `moment_eigenvalue`; no physically possible light has a negative one
    """
    if len(lights) > BATCH:
        parts = [measure(lights[start : start + BATCH]) for start in range(0, len(lights), BATCH)]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    lights = np.asarray(lights, np.float64)
    order = order_of(lights.shape[-2])
    normals = sphere_spiral(NORMAL_COUNT)
    transport = unoccluded(normals, order)
    luminances = luminance(lights)
    irradiances = luminances @ transport.T
    faces_camera = normals[:, 2] > 0
    mean = luminances[:, 0] * unoccluded(FRONT, 0)[0]
    positive_mean = np.where(mean > 0, mean, np.inf)
    up, down, front = (luminances @ unoccluded(np.array(d, float), order) for d in ((0, 1, 0), (0, -1, 0), (0, 0, 1)))
    positive_l00 = np.where(luminances[:, 0] > 0, luminances[:, 0], np.inf)
    direction = luminances[:, [3, 1, 2]] if order else np.zeros((len(luminances), 3))
    length = np.maximum(np.linalg.norm(direction, axis=-1), 1e-12)
    color = np.log(np.maximum(lights[:, 0], 1e-9))
    return {
        "reference": reference_brightness(lights),
        "front": front,
        "mean": mean,
        "least": irradiances.min(1),
        "most": irradiances.max(1),
        "front_most": irradiances[:, faces_camera].max(1),
        "front_least": irradiances[:, faces_camera].min(1),
        "front_mean": irradiances[:, faces_camera].mean(1),
        "back_mean": irradiances[:, ~faces_camera].mean(1),
        "channel_most": np.max([(lights[..., c] @ transport[faces_camera].T).max(1) for c in range(3)], axis=0),
        "up": up / positive_mean,
        "down": down / positive_mean,
        "first": np.linalg.norm(direction, axis=-1) / positive_l00,
        "second": np.linalg.norm(luminances[:, 4:9], axis=-1) / positive_l00,
        "elevation": np.degrees(np.arcsin(np.clip(direction[:, 1] / length, -1, 1))),
        "azimuth": np.degrees(np.arctan2(direction[:, 0], direction[:, 2])),
        "toward": direction[:, 2] / length,
        "red": color[:, 0] - color[:, 1],
        "blue": color[:, 2] - color[:, 1],
        "moment": moment_eigenvalue(lights),
    }


def is_lit_from_below(measured: dict[str, np.ndarray]) -> np.ndarray:
    """Returns whether lights are brighter from below than from above, as (N,) bool.

    The rows of such panoramas usually run from the bottom up.

    Args:
        measured: statistics of `measure`.
    """
    return measured["down"] > MAX_BELOW * measured["up"]
