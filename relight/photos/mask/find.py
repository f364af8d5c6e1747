"""Masks: where the people of a picture are."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.files import existing_file
from relight.maps.square import MASK_THRESHOLD
from relight.photos.mask import networks, selfie, u2net
from relight.photos.mask.coverage import WANTED, coverage_of
from relight.photos.mask.edge import fit_edge
from relight.photos.mask.people import NobodyFound, is_inverted, mask_doubts
from relight.photos.mask.pose import Body
from relight.pictures.codes import as_codes, convert_alpha
from relight.pictures.deep import is_linear
from relight.pictures.opening import decoding_errors, mask_beside, open_picture, require_still, stored, upright
from relight.pictures.picture import Given, Picture

AUTOMATIC = "the mask is automatic; `relight mask draw` writes it for correction"
BY_HAND = "draw a mask, white on the person ({}_mask.png beside it), or give a PNG that is transparent elsewhere"
NO_OUTLINE = "its alpha channel is no outline of people, and was not taken for their mask"


class NoMaskNetwork(UserError):
    """A picture needs an automatic mask, and no network for it has been set up."""


def masked(picture: Picture, mask: Given | None = None, model: Path | str | None = None) -> Picture:
    """Finds where the people of a picture are.

    Args:
        picture: without a mask.
        mask: a file; an image of Pillow; (H,W) bool, uint8 of 0 to 255 or float in [0,1]. By default the file beside
            the picture's, the picture's alpha, or an automatic mask.
        model: ONNX network for automatic masks, instead of `automatic_model`'s choice.

    Returns:
        The picture with its `coverage`, its `bodies` if the mask is automatic, and notes on the mask. Its edge is
        fitted to the picture, unless it is the picture's alpha: colors where that is 0 mean nothing. What is
        transparent is not covered.

    Raises:
        UserError: if there is no mask, or it is empty (NobodyFound), full, of another size, or the picture itself.
    """
    alpha = None if picture.alpha is None else convert_alpha(picture.alpha, np.uint8)
    if mask is None and picture.file is not None:
        mask = mask_beside(picture.file)
    notes = picture.notes
    bodies: list[Body] = []
    if mask is not None:
        what = f"mask {mask}" if isinstance(mask, str | Path) else "the mask"
        coverage, said = read_mask(mask, picture.shape)
        notes, solid = [*notes, *said], coverage >= MASK_THRESHOLD
        if solid.all():
            raise UserError(f"{what} covers the whole photo: {WANTED}")
        if not solid.any():
            raise NobodyFound(f"{what} is empty: no pixel of it is at least half white")
        if _is_the_photo(coverage, picture.pixels):
            raise UserError(f"{what} is the photo itself: {WANTED}")
        coverage = fit_edge(picture.pixels, coverage)
    else:
        if alpha is not None and not (alpha >= MASK_THRESHOLD).any():
            raise NobodyFound(f"{picture.what} has an alpha channel without any opaque pixel: nobody to relight")
        if alpha is not None and has_outline(alpha):
            with suppress(UserError):  # of labels
                coverage, said = coverage_of(alpha, "its alpha channel")
                return replace(picture, coverage=coverage, notes=[*notes, "its alpha channel is its mask", *said])
        notes = [*notes, *[NO_OUTLINE] * (alpha is not None), AUTOMATIC]
        coverage, bodies = automatic_mask(picture, model)
    coverage = coverage if alpha is None else np.minimum(coverage, alpha)
    if mask is None and model is None:
        notes += mask_doubts(coverage, bodies)
    return replace(picture, coverage=coverage, notes=notes, bodies=bodies)


def has_outline(alpha: np.ndarray) -> bool:
    """Returns whether an alpha channel (H,W) uint8 may be a mask: neither nearly empty or full, nor rounded corners."""
    solid = alpha >= MASK_THRESHOLD
    return bool(solid.any()) and not is_inverted(solid)


def read_mask(mask: Given, size: tuple[int, int]) -> tuple[np.ndarray, list[str]]:
    """Reads a mask: alpha if that varies, else the brightness, or two labels or colors.

    Args:
        mask: a file, an image of Pillow, or an array (H,W).
        size: (height, width) of the upright picture.

    Returns:
        Coverage (H,W) uint8; what was chosen where the mask can mean two things, one sentence each.

    Raises:
        UserError: if it is no still picture of that size, or a map of several labels.
    """
    what = "the mask"
    if isinstance(mask, str | Path):
        path = existing_file(mask, "mask")
        what = f"mask {path}"
        if is_linear(path):
            picture = Picture.of(path, "mask")
            values = picture.pixels.max(-1) if picture.alpha is None else picture.alpha
        else:
            with decoding_errors(what), open_picture(path, what) as image:
                values = _values(image, what)
    elif isinstance(mask, Image.Image):
        values = _values(mask, what)
    else:
        values = np.asarray(mask)
        values = values * np.uint8(255) if values.dtype == bool else values
        if values.ndim != 2 or values.dtype.kind not in "uif":
            raise UserError(f"the mask has shape {values.shape} of {values.dtype}: give (height, width) of numbers")
    (height, width), (rows, columns) = size, values.shape[:2]
    if (rows, columns) != (height, width):
        turned = ", which is the photo before its EXIF rotation" if (columns, rows) == (height, width) else ""
        raise UserError(
            f"{what} is {columns}x{rows} pixels{turned}, but the photo is {width}x{height}: they must be equal"
        )
    return coverage_of(values, what)


def _values(image: Image.Image, what: str) -> np.ndarray:
    require_still(image, what)
    is_plain = image.mode.startswith(("I", "F")) or (image.mode == "L" and "transparency" not in image.info)
    values = upright(stored(image if is_plain else image.convert("RGBA")), image)
    if is_plain:
        return values
    return values[..., 3] if has_outline(values[..., 3]) else values[..., :3]


def automatic_mask(picture: Picture, model: Path | str | None = None) -> tuple[np.ndarray, list[Body]]:
    """Segments the people of a picture with the built-in networks, or another one.

    Args:
        picture: of any size.
        model: an ONNX segmentation model, as `u2net.segment` takes it; None for the built-in ones.

    Returns:
        Coverage (H,W) uint8, its edge fitted to the picture; and the people whom the built-in networks find.

    Raises:
        UserError: if there is no such network (NoMaskNetwork), or it finds nobody (NobodyFound).
    """
    by_hand = BY_HAND.format(picture.name)
    if automatic_model(model) is None:
        raise NoMaskNetwork(f"{picture.what} has no mask: `relight mask setup` brings automatic ones; or {by_hand}")
    mask, bodies = selfie.segment(picture.codes) if model is None else (u2net.segment(picture.codes, model), [])
    if not (mask >= MASK_THRESHOLD).any() or (mask >= MASK_THRESHOLD).all():
        raise NobodyFound(f"the automatic mask found nobody in {picture.what}: {by_hand}")
    return (mask if model is None else fit_edge(picture.pixels, mask, automatic=True)), bodies


def automatic_model(model: Path | str | None = None) -> Path | None:
    """Returns the file of a network for automatic masks: `model`, else a built-in one where they are set up."""
    if model is not None:
        return u2net.named_model(model)[0]
    return networks.network_file(networks.LANDMARKS) if networks.is_set_up() else None


def _is_the_photo(mask: np.ndarray, pixels: np.ndarray) -> bool:
    """Returns whether a mask is a grey version of the photo, saved by mistake: grey in places, and like its brightness.

    `mask` is (H,W) uint8, and `pixels` (H,W,3) are those of the photo, as `Picture` has them.
    """
    part = np.s_[:: max(len(mask) // 256, 1), :: max(mask.shape[1] // 256, 1)]
    mask, grey = mask[part].astype(np.float64), as_codes(pixels[part]).astype(np.float64) @ [0.299, 0.587, 0.114]
    if ((mask > 15) & (mask < 240)).mean() < 0.2 or mask.std() < 1 or grey.std() < 1:
        return False
    return abs(np.corrcoef(mask.ravel(), grey.ravel())[0, 1]) > 0.98
