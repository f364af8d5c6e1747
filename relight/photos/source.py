"""The light that a user names for a photo: a panorama, coefficients, a room, a key light, or another photo."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from relight.panoramas import Panorama
from relight.photos.infer import Figure
from relight.photos.mask import mask_of
from relight.photos.read import is_picture, read_photo

if TYPE_CHECKING:
    from relight.photos.api import Relighter


@dataclass(frozen=True)
class Source:
    """name as the user gave it; coefficients (K,3) radiance; panorama where the light has one, in the same units;
    notes: what a user should know about it.
    """

    name: str
    coefficients: np.ndarray
    panorama: Panorama | None = None
    notes: list[str] = field(default_factory=list)


def light_source(
    text: str,
    relighter: "Relighter",
    mask: Path | str | None = None,
    mask_model: Path | str | None = None,
    **layout,
) -> Source:
    """Reads the light called `text` (docs/photos.md lists the kinds). Raises UserError for what is no light.

    mask, mask_model: of the photo, when the light is that of another photo. layout: how to read a panorama or
    coefficients, as `relight.lights.load_light` takes it.
    """
    if is_picture(text):
        photo = read_photo(text)
        figures = relighter.infer(photo.pixels, mask_of(photo, mask or mask_beside(text), mask_model))
        return Source(text, mean_light(figures))
    from relight.lights import load_light

    light = load_light(text, order=relighter.order, **layout)
    return Source(text, light.coefficients.astype(np.float32), light.panorama, light.notes)


def mean_light(figures: Sequence[Figure]) -> np.ndarray:
    """The light (K,3) of a photo: its people's, weighted by their areas."""
    areas = np.array([f.mask.sum() * (f.frame.side / f.frame.size) ** 2 for f in figures])
    return np.tensordot(areas / areas.sum(), np.stack([f.light for f in figures]), 1).astype(np.float32)


def mask_beside(photo: Path | str) -> Path | None:
    """me_mask.png for me.jpg, when it is there."""
    photo = Path(photo)
    beside = photo.with_name(f"{photo.stem}_mask.png")
    return beside if beside.is_file() else None
