"""Reading photos and masks. What is wrong with a file is one sentence, before pixels are decoded where possible."""

import glob
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image, ImageOps

from relight.errors import UserError
from relight.files import PHOTO_SUFFIXES, existing_file, require_readable
from relight.photos.color import to_srgb8
from relight.photos.deep import is_exr, read_16_bits, read_linear
from relight.photos.mask.coverage import coverage_of
from relight.photos.opening import bits_of, coding_of, decoding_errors, open_picture, require_still
from relight.photos.profile import to_srgb

FEW_BITS = 1 << 12  # codes of cameras that write 12 bits into 16
NUMBER = re.compile(r"(\d+)")


@dataclass
class Photo:
    """A photograph.

    Attributes:
        pixels: (H,W,3) upright; uint8 or uint16 sRGB, or float32 linear Rec. 709 of an OpenEXR file.
        alpha: (H,W) uint8, or None if the file has no alpha channel that varies.
        name: of the file, without its suffix.
        suffix: of pictures that are written in kind: .png, .tif or .exr.
        notes: what was chosen where the file, or that of its mask, can mean two things, one sentence each.
        what: its name in errors, such as "photo me.jpg".
    """

    pixels: np.ndarray = field(repr=False)
    alpha: np.ndarray | None = field(repr=False)
    name: str
    suffix: str = ".png"
    notes: list[str] = field(default_factory=list)
    what: str = "the image"

    @property
    def codes(self) -> np.ndarray:
        """(H,W,3) uint8 sRGB."""
        return as_codes(self.pixels)


def as_codes(pixels: np.ndarray) -> np.ndarray:
    """Returns pixels of any type that `Photo` has as uint8 sRGB."""
    if pixels.dtype == np.uint8:
        return pixels
    return to_srgb8(pixels) if pixels.dtype.kind == "f" else np.round(pixels / np.float32(257)).astype(np.uint8)


def read_photo(path: Path | str, what: str = "photo") -> Photo:
    """Reads a photo, turned upright by its EXIF and converted from its color profile to sRGB.

    Args:
        path: of the file.
        what: its name in errors.

    Raises:
        UserError: if it is no picture, damaged, CMYK, animated or too large, or has more than 16 bits.
    """
    path = existing_file(path, what)
    if is_exr(path):
        pixels, alpha, notes = read_linear(path, f"{what} {path}")
        return _checked(Photo(pixels, alpha, path.stem, ".exr", notes, f"{what} {path}"))
    with decoding_errors(f"{what} {path}"), open_picture(path, what) as image:
        return photo_from_image(image, f"{what} {path}", path.stem, path)


def photo_from_image(
    image: Image.Image, what: str = "the image", name: str = "image", file: Path | None = None
) -> Photo:
    """Converts an image of Pillow, turned upright by its EXIF and converted from its color profile to sRGB.

    Args:
        image: of any mode.
        what: its name in errors.
        name: of the photo.
        file: of the image, if it has one, from which 16 bits are read.

    Raises:
        UserError: if it is CMYK, animated or too small, or has more than 16 bits.
    """
    require_still(image, what)
    is_deep_grey = image.mode.startswith("I;16")
    if image.mode in ("CMYK", "YCCK", "LAB", "HSV"):
        raise UserError(f"{what} is {image.mode}: convert it to RGB (sRGB)")
    bits = bits_of(image, file)
    if not is_deep_grey and (bits > 16 or image.mode.startswith(("I", "F"))):
        raise UserError(f"{what} has more than 16 bits per channel: save it in 16 bits, or as OpenEXR if it is linear")
    stored, orientation = image, image.getexif().get(ExifTags.Base.Orientation, 1)
    image = ImageOps.exif_transpose(image)
    alpha = None
    if "A" in image.getbands() or "transparency" in image.info:
        image = image.convert("RGBA")
        alpha = np.asarray(image.getchannel("A"))
        if alpha.min() == alpha.max():
            alpha = None
    if is_deep_grey:
        pixels = np.repeat(np.asarray(image, np.uint16)[..., None], 3, axis=2)
    elif bits == 16 and file is not None:
        pixels = read_16_bits(file, image, orientation, what)
    else:
        pixels = np.asarray(image.convert("RGB"))
    largest = int(pixels.max())
    pixels, notes = to_srgb(pixels, stored, what, coding_of(stored, file))
    if pixels.dtype == np.uint16 and largest < FEW_BITS:
        notes.append(f"its largest code is {largest} of 65535, as if it held fewer than 16 bits: it is taken as dark")
    suffix = ".tif" if pixels.dtype == np.uint16 and stored.format == "TIFF" else ".png"
    return _checked(Photo(pixels, alpha, name, suffix, notes, what))


def checked_size(pixels: np.ndarray, what: str) -> np.ndarray:
    """Returns the pixels (H,W,3) of `what`; raises UserError if a side has fewer than 8."""
    height, width = pixels.shape[:2]
    if min(height, width) < 8:
        raise UserError(f"{what} is only {width}x{height} pixels: 8 a side are the least")
    return pixels


def _checked(photo: Photo) -> Photo:
    """Returns the photo, with a note if it is grey; raises UserError if a side has fewer than 8 pixels."""
    checked_size(photo.pixels, photo.what)
    if np.array_equal(photo.pixels[..., 1:], photo.pixels[..., :2]):
        photo.notes.append("the photo is grey: a colored light tints the people as a whole")
    return photo


def read_mask(path: Path | str, size: tuple[int, int], notes: list[str] | None = None) -> np.ndarray:
    """Reads a mask: the file's alpha channel if that varies, else its brightness, or its two labels or colors.

    Args:
        path: of the file.
        size: (height, width) of the upright photo.
        notes: gets what was chosen where the file can mean two things, one sentence each.

    Returns:
        Coverage (H,W) uint8.

    Raises:
        UserError: if it is no still picture of that size, or a map of several labels.
    """
    path = existing_file(path, "mask")
    with decoding_errors(f"mask {path}"), open_picture(path, "mask") as image:
        return mask_from_image(image, size, f"mask {path}", notes)


def mask_from_image(
    image: Image.Image, size: tuple[int, int], what: str = "the mask", notes: list[str] | None = None
) -> np.ndarray:
    """Converts an image of Pillow to a mask: alpha if that varies, else its brightness, or two labels or colors.

    Args:
        image: of any mode.
        size: (height, width) of the upright photo.
        what: its name in errors.
        notes: gets what was chosen where the image can mean two things, one sentence each.

    Returns:
        Coverage (H,W) uint8.

    Raises:
        UserError: if it is no still picture of that size, or a map of several labels.
    """
    require_still(image, what)
    image = ImageOps.exif_transpose(image)
    if image.mode.startswith(("I", "F")):
        values = np.asarray(image)
    else:
        rgba = np.asarray(image.convert("RGBA"))
        varies = rgba[..., 3].min() != rgba[..., 3].max()
        values = rgba[..., 3] if varies else rgba[..., :3]
    if values.shape[:2] != tuple(size):
        turned = ", which is the photo before its EXIF rotation" if values.shape[1::-1] == tuple(size) else ""
        raise UserError(
            f"{what} is {values.shape[1]}x{values.shape[0]} pixels{turned}, "
            f"but the photo is {size[1]}x{size[0]}: they must be equal"
        )
    mask, chosen = coverage_of(values, what)
    if notes is not None:
        notes += chosen
    return mask


def mask_beside(photo: Path | str) -> Path | None:
    """Returns the mask file in the folder of a photo, me_mask.png for me.jpg; None if there is none."""
    photo = Path(photo)
    beside = photo.with_name(f"{photo.stem}_mask.png")
    return beside if beside.is_file() else None


def mask_in(masks: Path | str, name: str) -> Path | None:
    """Returns the mask of the photo `name` in a folder of masks, name.png or name_mask.png; None if there is none."""
    for stem in (name, f"{name}_mask"):
        if found := sorted(file for file in Path(masks).glob(f"{glob.escape(stem)}.*") if is_picture(file)):
            return found[0]
    return None


def is_picture(path: Path | str) -> bool:
    """Returns whether a name is that of a picture, and not of a light or a panorama, as .exr is where it may be one."""
    return Path(path).suffix.lower() in PHOTO_SUFFIXES


def list_pictures(folder: Path | str) -> list[Path]:
    """Lists the pictures in a folder by name, 2 before 10. Raises UserError if there is none."""
    folder = Path(folder)
    require_readable(folder, "folder")
    found = [
        path
        for path in folder.iterdir()
        if (is_picture(path) or path.suffix.lower() == ".exr") and path.is_file() and not path.name.startswith(".")
    ]
    if not found:
        raise UserError(f"folder {folder} holds no photo ({', '.join([*PHOTO_SUFFIXES, '.exr'])})")
    return sorted(found, key=lambda path: [int(part) if part.isdecimal() else part for part in NUMBER.split(path.name)])


def list_photos(folder: Path | str) -> list[Path]:
    """Lists the pictures in a folder without masks (x_mask.png). Raises UserError if there is none."""
    found = [path for path in list_pictures(folder) if not path.stem.endswith("_mask")]
    if not found:
        raise UserError(f"folder {folder} holds masks only")
    return found
