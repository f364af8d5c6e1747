"""Draws maps as one picture."""

from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.files import atomic_write
from relight.core.srgb import encode, to_bytes
from relight.maps.exr import Maps
from relight.maps.square import extent

LIGHT_DIRECTION = np.array([0.5, 0.6, 0.62])  # toward the light of the shaded view: upper right, in front
STRENGTH = 0.6  # of its constant and of its linear coefficients
MAX_COEFFICIENT = 1.03  # transport coefficient that is drawn in full color: about the largest, 2 pi/3 Y_10
RED, BLUE = np.array([0.70, 0.09, 0.17]), np.array([0.13, 0.40, 0.67])  # of positive and negative coefficients
BACKGROUND = 0.2  # grey, on which white albedo and zero coefficients are visible


def _draw_maps(maps: Maps) -> np.ndarray:
    """Draws maps in two rows, cropped to the figure: (height,width,3) uint8 sRGB.

    The first row shows albedo, normal, AO and a shaded view, the second up to nine transport coefficients (all of order
    2), red where positive and blue where negative.
    """
    margin = max(1, len(maps.mask) // 50)  # pixels around the figure: 2 % of the image
    window = tuple(slice(max(0, first - margin), last + margin) for first, last in extent(maps.mask))
    inside, transport = maps.mask[window][..., None], maps.transport[window]
    light = shading_light(transport.shape[2])
    shading = np.repeat((transport @ light)[..., None], 3, 2)
    if maps.bounced is not None:
        shading = shading + np.einsum("hwkc,k->hwc", maps.bounced[window], light)
    panels = [
        encode(maps.albedo[window]),
        maps.normal[window] * 0.5 + 0.5,  # from [-1,1] to [0,1]
        np.repeat(maps.ao[window][..., None], 3, 2),
        encode(maps.albedo[window] * shading),
    ]
    first_row = np.concatenate([np.where(inside, panel, BACKGROUND) for panel in panels], 1)
    coefficients = [transport[..., k : k + 1] / MAX_COEFFICIENT for k in range(min(transport.shape[2], 9))]
    # From white at 0 to RED at 1 and to BLUE at -1.
    panels = [np.where(value > 0, 1 - value * (1 - RED), 1 + value * (1 - BLUE)) for value in coefficients]
    coefficient_row = np.concatenate([np.where(inside, panel, BACKGROUND) for panel in panels], 1)
    size = first_row.shape[1], round(coefficient_row.shape[0] * first_row.shape[1] / coefficient_row.shape[1])
    second_row = Image.fromarray(to_bytes(coefficient_row)).resize(size, Image.Resampling.LANCZOS)
    return np.concatenate([to_bytes(first_row), np.asarray(second_row)])


def shading_light(coefficients: int) -> np.ndarray:
    """Returns the light (K,) of the shaded view: even light, and from order 1 on a lamp at LIGHT_DIRECTION."""
    light = np.zeros(coefficients)
    light[0] = STRENGTH
    if coefficients >= 4:
        light[1:4] = STRENGTH * LIGHT_DIRECTION[[1, 2, 0]] / np.linalg.norm(LIGHT_DIRECTION)  # y, z, x
    return light


def write_maps_picture(path: Path | str, maps: Maps) -> None:
    """Writes the picture of `_draw_maps` as PNG, whole or not at all."""
    with atomic_write(path) as temporary:
        Image.fromarray(_draw_maps(maps)).save(temporary)
