"""A photo with its mask, however they are given: read once, before anything else is done."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from relight.errors import UserError
from relight.maps.square import MASK_THRESHOLD
from relight.photos.mask.coverage import coverage_of
from relight.photos.mask.edge import fit_edge
from relight.photos.mask.find import AUTOMATIC, find_mask, mask_warnings
from relight.photos.read import (
    Photo,
    as_codes,
    checked_size,
    mask_beside,
    mask_from_image,
    photo_from_image,
    read_photo,
)

if TYPE_CHECKING:
    from relight.photos.person import Person

Picture = np.ndarray | Image.Image | Path | str


@dataclass(frozen=True, repr=False)
class LoadedPhoto:
    """A photo and where its people are.

    Attributes:
        pixels: (H,W,3) uint8 or uint16 sRGB, or float32 linear Rec. 709.
        coverage: (H,W) uint8 of all people, its edge fitted to the photo (relight.photos.mask.edge).
        name: of the file, without its suffix.
        suffix: of pictures that are written in kind.
        notes: what was chosen where a file can mean two things.
        automatic: whether a network made the mask.
    """

    pixels: np.ndarray
    coverage: np.ndarray
    name: str = "image"
    suffix: str = ".png"
    notes: tuple[str, ...] = ()
    automatic: bool = False

    def __repr__(self) -> str:
        height, width = self.coverage.shape
        return f"LoadedPhoto({self.name}, {width} x {height} {self.pixels.dtype})"

    def downscaled(self, size: int) -> "LoadedPhoto":
        """Returns the photo as uint8 sRGB, scaled down so that its longer side is at most `size`."""
        height, width = self.coverage.shape
        scale, codes = size / max(height, width), as_codes(self.pixels)
        if scale >= 1:
            return replace(self, pixels=codes)
        shape = max(8, round(width * scale)), max(8, round(height * scale))
        pixels, coverage = (
            np.asarray(Image.fromarray(values).resize(shape, Image.Resampling.LANCZOS, reducing_gap=3))
            for values in (codes, self.coverage)
        )
        return replace(self, pixels=pixels, coverage=coverage)


def load_photo(
    image: Picture | Photo, mask: Picture | None = None, mask_model: Path | str | None = None
) -> LoadedPhoto:
    """Loads a photo and its mask.

    Args:
        image: (H,W,3) uint8 or uint16 sRGB (a grey one may be (H,W)), an image of Pillow, a file, or a `Photo`.
        mask: (H,W) bool, uint8 of 0 to 255 or float in [0,1]; an image of Pillow, or a file. By default the file beside
            the photo, its alpha, or an automatic mask.
        mask_model: file of the network (.onnx) that finds the people; None for the one that is installed.

    Raises:
        UserError: if an argument is none of these, or the mask is empty or of another size.
    """
    if isinstance(image, str | Path):
        photo, mask = read_photo(image), mask if mask is not None else mask_beside(image)
    elif isinstance(image, Image.Image):
        photo = photo_from_image(image)
    else:
        photo = image if isinstance(image, Photo) else Photo(_checked_image(image), None, "image")
    notes: list[str] = []  # on a mask that is no file
    if mask is None or isinstance(mask, str | Path):
        coverage = find_mask(photo, mask, mask_model)
    else:
        coverage, notes = _checked_mask(mask, photo.pixels.shape[:2])
    is_automatic = mask is None and photo.alpha is None
    coverage = coverage if is_automatic else fit_edge(photo.pixels, coverage)
    return LoadedPhoto(photo.pixels, coverage, photo.name, photo.suffix, (*photo.notes, *notes), is_automatic)


def _checked_image(image: np.ndarray) -> np.ndarray:
    """Returns the image as (H,W,3); raises UserError unless it is (H,W,3), or (H,W) if grey, and uint8 or uint16."""
    image = np.asarray(image)
    if image.ndim == 2:
        image = np.repeat(image[..., None], 3, axis=2)
    if image.dtype not in (np.uint8, np.uint16) or image.ndim != 3 or image.shape[2] != 3:
        raise UserError(f"the image is {image.dtype} {image.shape}: give (height, width, 3) uint8 sRGB, or uint16")
    return checked_size(image, "the image")


def _checked_mask(mask: np.ndarray | Image.Image, shape: tuple[int, ...]) -> tuple[np.ndarray, list[str]]:
    """Converts a mask to coverage.

    The mask is (H,W) bool, uint8 of 0 to 255 or float in [0,1], or an image of Pillow. Returns coverage (H,W) uint8 and
    notes on it; raises UserError if it is empty, covers the whole photo or is of another size.
    """
    values = mask_from_image(mask, (shape[0], shape[1])) if isinstance(mask, Image.Image) else np.asarray(mask)
    if values.ndim != 2:
        raise UserError(f"the mask has shape {values.shape}: give (height, width)")
    coverage, notes = coverage_of(values * np.uint8(255) if values.dtype == bool else values, "the mask")
    if not (coverage >= MASK_THRESHOLD).any():
        raise UserError("the mask is empty: no pixel of it is at least half white")
    if (coverage >= MASK_THRESHOLD).all():
        raise UserError("the mask covers the whole photo: it must be white on the person and black elsewhere")
    if shape != coverage.shape:
        (height, width), (rows, columns) = shape, coverage.shape
        raise UserError(f"the mask is {columns}x{rows} pixels, but the image is {width}x{height}: they must be equal")
    return coverage, notes


def photo_notes(photo: LoadedPhoto, people: Sequence["Person"]) -> list[str]:
    """Returns what a user should know about a photo and its mask, one sentence each."""
    return [*photo.notes, *mask_notes(photo, people)]


def mask_notes(photo: LoadedPhoto, people: Sequence["Person"]) -> list[str]:
    """Returns what a user should know about the mask of a photo, one sentence each."""
    return mask_warnings(people) + [AUTOMATIC] * photo.automatic
