"""Reading photos and masks: everything that can be wrong with a picture file is said in one line before pixels load."""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageCms, ImageOps

from relight.files import UserError, existing_file

MAX_PIXELS = 100_000_000  # of a photo; a decoder asks for memory before it finds out that the file is a bomb
MOST = f"{MAX_PIXELS // 10**6} million pixels"
MAX_BYTES = 500_000_000
SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp", ".avif", ".heic", ".heif")
HEIC = (".heic", ".heif")


@dataclass
class Photo:
    """pixels (H,W,3) uint8 sRGB, upright; alpha (H,W) uint8 or None when the file has no alpha that varies; name."""

    pixels: np.ndarray
    alpha: np.ndarray | None
    name: str


def read_photo(path: Path | str, what: str = "photo") -> Photo:
    """A photo as 8-bit sRGB, turned upright by its EXIF and converted from its colour profile.

    what: it is called in errors. Raises UserError in one sentence for what is no picture, is damaged, grey, CMYK,
    16-bit, animated or too large.
    """
    path = existing_file(path, what)
    with _whole(f"{what} {path}"), _opened(path, what) as image:
        if _bits(path, image) > 8:
            raise UserError(f"{what} {path} has more than 8 bits per channel: save it as an 8-bit sRGB picture")
        return photo_of(image, f"{what} {path}", path.stem)


def photo_of(image: Image.Image, what: str = "the image", name: str = "image") -> Photo:
    """The same of Pillow's image. what: it is called in errors, which are those of `read_photo`."""
    if getattr(image, "n_frames", 1) > 1 and image.format != "HEIF":  # there the first is the photo
        raise UserError(f"{what} is animated ({image.n_frames} frames): save one, or use `relight movie`")
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
    """A mask file as (H,W) uint8 coverage: its alpha channel where that varies, else its brightness.

    size: (height, width) of the upright photo, which the mask must share. Raises UserError.
    """
    path = existing_file(path, "mask")
    with _whole(f"mask {path}"), _opened(path, "mask") as image:
        return mask_image(image, size, f"mask {path}")


def mask_image(image: Image.Image, size: tuple[int, int], what: str = "the mask") -> np.ndarray:
    """The same of Pillow's image. what: it is called in errors."""
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


def is_picture(path: Path | str) -> bool:
    """Whether the name is that of a photo (and not of a panorama or a light), for `--light other.jpg`."""
    return Path(path).suffix.lower() in SUFFIXES


def _opened(path: Path, what: str) -> Image.Image:
    """The file's header, with its size checked; no pixel is decoded yet."""
    if path.stat().st_size > MAX_BYTES:
        raise UserError(f"{what} {path} is larger than {MAX_BYTES // 10**6} MB: give a smaller file")
    if path.suffix.lower() in HEIC:
        try:
            from pillow_heif import register_heif_opener
        except ImportError:
            raise UserError(
                f"{what} {path} is HEIC, which needs pillow-heif: pip install 'relight[heic]', or save it as JPEG"
            ) from None
        register_heif_opener()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's own warning of large pictures; ours is an error
            image = Image.open(path)
    except Image.DecompressionBombError:
        raise UserError(f"{what} {path} is too large: at most {MOST} are read") from None
    except Exception:
        raise UserError(f"{what} {path} cannot be read as a picture: give JPEG, PNG, WebP, TIFF or AVIF") from None
    width, height = image.size
    if width * height > MAX_PIXELS:
        image.close()
        raise UserError(f"{what} {path} is too large, {width}x{height}: at most {MOST} are read")
    return image


@contextmanager
def _whole(what: str) -> Iterator[None]:
    """Turns whatever Pillow raises over a damaged file into a UserError; its decoders raise a dozen types."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        raise UserError(f"{what} is damaged or cut short ({str(error).split(chr(10))[0]})") from None


def _bits(path: Path, image: Image.Image) -> int:
    """Bits per channel as the file states them; Pillow drops the lower half of a 16-bit RGB PNG without a word."""
    if image.format == "PNG":
        with open(path, "rb") as file:
            return file.read(25)[24]
    if image.format == "TIFF":
        bits = image.tag_v2.get(258, 8)  # BitsPerSample
        return max(bits) if isinstance(bits, tuple) else int(bits)
    return 8


def _to_srgb(image: Image.Image, what: str) -> Image.Image:
    """RGB in sRGB. Phones write Display P3: read as sRGB it would come out pale."""
    profile = image.info.get("icc_profile")
    image = image.convert("RGB")
    if not profile:
        return image
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        if "sRGB" in ImageCms.getProfileDescription(source):
            return image
        return ImageCms.profileToProfile(image, source, ImageCms.createProfile("sRGB"), outputMode="RGB")
    except (ImageCms.PyCMSError, OSError):
        raise UserError(f"{what} holds a colour profile that is damaged: save it as sRGB") from None
