"""Reading photos and masks. What is wrong with a file is one sentence, before pixels are decoded where possible."""

import glob
import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageCms, ImageOps, TiffImagePlugin

from relight.files import UserError, existing_file, require_readable

MAX_PIXELS = 100_000_000  # of a photo; decoders allocate memory before they find that a file is a decompression bomb
TOO_LARGE = f"at most {MAX_PIXELS // 10**6} million pixels are read"
MAX_BYTES = 500_000_000
FREE_PIXELS, MOST_PACKED = 2**22, 2**13  # pixels that are believed of any file, and of each of its bytes
SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp", ".avif", ".heic", ".heif")
HEIC = (".heic", ".heif")
NUMBER = re.compile(r"(\d+)")


@dataclass
class Photo:
    """A photograph.

    Attributes:
        pixels: (H,W,3) uint8 sRGB, upright.
        alpha: (H,W) uint8, or None if the file has no alpha channel that varies.
        name: of the file, without its suffix.
    """

    pixels: np.ndarray
    alpha: np.ndarray | None
    name: str


def read_photo(path: Path | str, what: str = "photo") -> Photo:
    """Reads a photo, turned upright by its EXIF and converted from its colour profile to sRGB.

    Args:
        path: of the file.
        what: its name in errors.

    Raises:
        UserError: if it is no picture, damaged, grey, CMYK, 16-bit, animated or too large.
    """
    path = existing_file(path, what)
    with _decoding_errors(f"{what} {path}"), _open(path, what) as image:
        if _bits(path, image) > 8:
            raise UserError(f"{what} {path} has more than 8 bits per channel: save it as an 8-bit sRGB picture")
        return photo_from_image(image, f"{what} {path}", path.stem)


def photo_from_image(image: Image.Image, what: str = "the image", name: str = "image") -> Photo:
    """Converts an image of Pillow as `read_photo` does.

    Args:
        image: of any mode.
        what: its name in errors.
        name: of the photo.

    Raises:
        UserError: as `read_photo`.
    """
    count = getattr(image, "n_frames", 1)
    if count > 1 and image.format != "HEIF":  # in a HEIF file the first is the photo
        raise UserError(f"{what} is animated ({count} frames): save one, or use `relight movie`")
    if image.mode in ("L", "LA", "1"):
        raise UserError(f"{what} is grey: give a colour picture, for the light's colour is read from it")
    if image.mode in ("CMYK", "YCCK", "LAB", "HSV"):
        raise UserError(f"{what} is {image.mode}: convert it to 8-bit RGB (sRGB)")
    if image.mode.startswith(("I", "F")):
        raise UserError(f"{what} has more than 8 bits per channel: save it as an 8-bit sRGB picture")
    image = ImageOps.exif_transpose(image)
    alpha = None
    if "A" in image.getbands() or "transparency" in image.info:
        image = image.convert("RGBA")
        alpha = np.asarray(image.getchannel("A"))
        if alpha.min() == alpha.max():
            alpha = None
    pixels = np.asarray(_to_srgb(image, what))
    if min(pixels.shape[:2]) < 8:
        raise UserError(f"{what} is only {pixels.shape[1]}x{pixels.shape[0]} pixels: 8 a side are the least")
    return Photo(pixels, alpha, name)


def read_mask(path: Path | str, size: tuple[int, int]) -> np.ndarray:
    """Reads a mask: the file's alpha channel if that varies, else its brightness.

    Args:
        path: of the file.
        size: (height, width) of the upright photo.

    Returns:
        Coverage (H,W) uint8.

    Raises:
        UserError: if it is no still picture of that size.
    """
    path = existing_file(path, "mask")
    with _decoding_errors(f"mask {path}"), _open(path, "mask") as image:
        return mask_from_image(image, size, f"mask {path}")


def mask_from_image(image: Image.Image, size: tuple[int, int], what: str = "the mask") -> np.ndarray:
    """Converts an image of Pillow as `read_mask` does; `what` is its name in errors."""
    if getattr(image, "n_frames", 1) > 1:
        raise UserError(f"{what} is animated: give a still picture")
    image = ImageOps.exif_transpose(image)
    if image.mode.startswith(("I", "F")):
        values = np.asarray(image, np.float32)
        mask = np.round(values * (255 / max(float(values.max()), 1))).astype(np.uint8)
    else:
        rgba = np.asarray(image.convert("RGBA"))
        varies = rgba[..., 3].min() != rgba[..., 3].max()
        mask = rgba[..., 3] if varies else np.asarray(image.convert("RGB").convert("L"))
    if mask.shape != tuple(size):
        turned = ", which is the photo before its EXIF rotation" if mask.shape == tuple(size)[::-1] else ""
        raise UserError(
            f"{what} is {mask.shape[1]}x{mask.shape[0]} pixels{turned}, "
            f"but the photo is {size[1]}x{size[0]}: they must be equal"
        )
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
    """Returns whether a file name is that of a picture, and not of a panorama or a light."""
    return Path(path).suffix.lower() in SUFFIXES


def list_pictures(folder: Path | str) -> list[Path]:
    """Lists the pictures in a folder by name, 2 before 10. Raises UserError if there is none."""
    folder = Path(folder)
    require_readable(folder, "folder")
    found = [p for p in folder.iterdir() if p.is_file() and is_picture(p) and not p.name.startswith(".")]
    if not found:
        raise UserError(f"folder {folder} holds no photo (.jpg, .png, .webp, .tif)")
    return sorted(found, key=lambda path: [int(part) if part.isdecimal() else part for part in NUMBER.split(path.name)])


def list_photos(folder: Path | str) -> list[Path]:
    """Lists the pictures in a folder without masks (x_mask.png). Raises UserError if there is none."""
    found = [path for path in list_pictures(folder) if not path.stem.endswith("_mask")]
    if not found:
        raise UserError(f"folder {folder} holds masks only")
    return found


def _open(path: Path, what: str) -> Image.Image:
    """Reads the header of a file and checks the size; no pixel is decoded yet."""
    if path.stat().st_size > MAX_BYTES:
        raise UserError(f"{what} {path} is larger than {MAX_BYTES // 10**6} MB: give a smaller file")
    if path.suffix.lower() in HEIC:
        try:
            from pillow_heif import register_heif_opener
        except ImportError:
            raise UserError(
                f"{what} {path} is HEIC, which needs pillow-heif: pip install '.[heic]', or save it as JPEG"
            ) from None
        register_heif_opener()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow only warns of large pictures; here they are an error
            image = Image.open(path)
    except Image.DecompressionBombError:
        raise UserError(f"{what} {path} is too large: {TOO_LARGE}") from None
    except Exception:
        raise UserError(f"{what} {path} cannot be read as a picture: give JPEG, PNG, WebP, TIFF or AVIF") from None
    width, height = image.size
    if width * height > MAX_PIXELS:
        image.close()
        raise UserError(f"{what} {path} is too large, {width}x{height}: {TOO_LARGE}")
    stored = path.stat().st_size
    if width * height > max(FREE_PIXELS, MOST_PACKED * stored):
        image.close()
        raise UserError(f"{what} {path} is damaged: it promises {width}x{height} pixels in {stored} bytes")
    return image


@contextmanager
def _decoding_errors(what: str) -> Iterator[None]:
    """Turns what Pillow's decoders raise for damaged files, a dozen types, into a UserError."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        raise UserError(f"{what} is damaged or cut short ({str(error).split(chr(10))[0]})") from None


def _bits(path: Path, image: Image.Image) -> int:
    """Bits per channel in the file; Pillow drops the lower half of a 16-bit RGB PNG silently."""
    if image.format == "PNG":
        with open(path, "rb") as file:
            return file.read(25)[24]
    if isinstance(image, TiffImagePlugin.TiffImageFile):
        bits = image.tag_v2.get(258, 8)  # BitsPerSample
        return max(bits) if isinstance(bits, tuple) else int(bits)
    return 8


def _to_srgb(image: Image.Image, what: str) -> Image.Image:
    """Converts to RGB in sRGB. Phones write Display P3, which would look pale if read as sRGB."""
    profile = image.info.get("icc_profile")
    image = image.convert("RGB")
    if not profile:
        return image
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        if "sRGB" in ImageCms.getProfileDescription(source):
            return image
        converted = ImageCms.profileToProfile(image, source, ImageCms.createProfile("sRGB"), outputMode="RGB")
        assert converted is not None  # as it is where the image is changed in place
        return converted
    except (ImageCms.PyCMSError, OSError):
        raise UserError(f"{what} holds a colour profile that is damaged: save it as sRGB") from None
