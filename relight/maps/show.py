"""Draws maps as one picture."""

from pathlib import Path

import numpy as np
from PIL import Image

from relight.files import atomic_write
from relight.maps.exr import Maps
from relight.srgb import encode, to_bytes

LIGHT_DIRECTION = np.array([0.5, 0.6, 0.62])  # toward the light of the shaded view: upper right, in front
BACKGROUND = 0.2  # grey, on which white albedo and zero coefficients are visible


def draw_maps(maps: Maps) -> np.ndarray:
    """Draws maps in two rows, cropped to the figure.

    The first row shows albedo, normal, AO and a shaded view, the second up to nine transport coefficients, red where
    positive and blue where negative.

    Returns:
        (height,width,3) uint8 sRGB.
    """
    rows, columns = np.nonzero(maps.mask)
    margin = max(1, len(maps.mask) // 50)
    crop = tuple(slice(max(0, at.min() - margin), at.max() + 1 + margin) for at in (rows, columns))
    inside = maps.mask[crop][..., None]
    transport = maps.transport[crop]
    k = min(transport.shape[2], 9)
    light = np.zeros(transport.shape[2])
    light[0] = 0.6
    if k >= 4:
        light[1:4] = 0.6 * LIGHT_DIRECTION[[1, 2, 0]] / np.linalg.norm(LIGHT_DIRECTION)  # y, z, x
    shading = transport @ light
    if maps.bounced is not None:
        shading = shading[..., None] + np.einsum("hwkc,k->hwc", maps.bounced[crop], light)
    else:
        shading = np.repeat(shading[..., None], 3, 2)
    panels = [
        encode(maps.albedo[crop]),
        maps.normal[crop] * 0.5 + 0.5,
        np.repeat(maps.ao[crop][..., None], 3, 2),
        encode(maps.albedo[crop] * shading),
    ]
    first_row = np.concatenate([np.where(inside, panel, BACKGROUND) for panel in panels], 1)
    signed = [transport[..., i : i + 1] / 1.03 for i in range(k)]
    red, blue = np.array([0.70, 0.09, 0.17]), np.array([0.13, 0.40, 0.67])
    panels = [np.where(value > 0, 1 - value * (1 - red), 1 + value * (1 - blue)) for value in signed]
    coefficient_row = np.concatenate([np.where(inside, panel, BACKGROUND) for panel in panels], 1)
    height = round(coefficient_row.shape[0] * first_row.shape[1] / coefficient_row.shape[1])
    second_row = Image.fromarray(to_bytes(coefficient_row)).resize(
        (first_row.shape[1], height), Image.Resampling.LANCZOS
    )
    return np.concatenate([to_bytes(first_row), np.asarray(second_row)])


def write_maps_picture(path: Path | str, maps: Maps) -> None:
    """Writes the picture of `draw_maps` as PNG, whole or not at all."""
    with atomic_write(path) as temporary:
        Image.fromarray(draw_maps(maps)).save(temporary)
