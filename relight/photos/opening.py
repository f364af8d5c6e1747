"""Finds and opens the files of pictures: what is wrong is one sentence, before pixels are decoded where possible."""

import glob
import re
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image, TiffImagePlugin

from relight.core.errors import UserError
from relight.core.files import PHOTO_SUFFIXES, require_readable

MAX_PIXELS = 100_000_000  # of a photo; decoders allocate memory before they find that a file is a decompression bomb
TOO_LARGE = f"at most {MAX_PIXELS // 10**6} million pixels are read"
MAX_BYTES = 500_000_000
FREE_PIXELS, MOST_PACKED = 2**22, 2**13  # pixels that are believed of any file, and of each of its bytes
HEIC = (".heic", ".heif")
RAW = (".dng", ".nef", ".nrw", ".arw", ".cr2", ".cr3", ".raf", ".orf", ".rw2", ".pef", ".srw", ".raw")  # of cameras
DNG_VERSION = 50706  # tag of a RAW file that may be called .tif; its first picture is a thumbnail
NUMBER = re.compile(r"(\d+)")
NCLX = re.compile(rb"colrnclx(.{6})", re.DOTALL)  # the box of AVIF and HEIC that codes the color space
HEAD = 1 << 16  # bytes, in which files say what their colors mean
ANIMATIONS = ("GIF", "WEBP", "PNG", "AVIF")  # formats whose further pictures are frames; in others they are previews
REDUCED, TRANSPARENCY = 1, 4  # bits of a TIFF page's NewSubfileType: a preview, a mask


def open_picture(path: Path, what: str) -> Image.Image:
    """Reads the header of a file and checks the size; no pixel is decoded yet.

    Args:
        path: of the file.
        what: its name in errors, such as "photo me.jpg".

    Raises:
        UserError: if it is no picture, a camera's RAW file, or too large.
    """
    if path.stat().st_size > MAX_BYTES:
        raise UserError(f"{what} is larger than {MAX_BYTES // 10**6} MB: give a smaller file")
    if path.suffix.lower() in HEIC:
        try:
            from pillow_heif import register_heif_opener
        except ImportError:
            raise UserError(
                f"{what} is HEIC, which needs pillow-heif: pip install '.[heic]', or save it as JPEG"
            ) from None
        register_heif_opener()
    raw = f"{what} is the RAW file of a camera: develop it first, and save it as JPEG, or as TIFF of 16 bits"
    if path.suffix.lower() in RAW:
        raise UserError(raw)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow only warns of large pictures; here they are an error
            image = Image.open(path)
    except Image.DecompressionBombError:
        raise UserError(f"{what} is too large: {TOO_LARGE}") from None
    except Exception:
        forms = "JPEG, PNG, WebP or AVIF, or TIFF of 8 or 16 bits"
        raise UserError(f"{what} cannot be read as a picture: give {forms}") from None
    (width, height), stored = image.size, path.stat().st_size
    reason = ""
    if isinstance(image, TiffImagePlugin.TiffImageFile) and DNG_VERSION in image.tag_v2:
        reason = raw
    elif width * height > MAX_PIXELS:
        reason = f"{what} is too large, {width}x{height}: {TOO_LARGE}"
    elif width * height > max(FREE_PIXELS, MOST_PACKED * stored):
        reason = f"{what} is damaged: it promises {width}x{height} pixels in {stored} bytes"
    if reason:
        image.close()
        raise UserError(reason)
    return image


@contextmanager
def decoding_errors(what: str) -> Iterator[None]:
    """Turns what Pillow's decoders raise for damaged files, a dozen types, into a UserError.

    A package that is missing is not the file's fault: `ImportError` passes.
    """
    try:
        yield
    except (UserError, ImportError):
        raise
    except Exception as error:
        raise UserError(f"{what} is damaged or cut short ({str(error).split(chr(10))[0]})") from None


def require_still(image: Image.Image, what: str) -> None:
    """Goes to the first picture of a file that is no preview; raises UserError if the file is a film or has pages."""
    count = getattr(image, "n_frames", 1)
    if count == 1:
        return
    if image.format in ANIMATIONS:
        raise UserError(f"{what} is animated ({count} frames): save one, or use `relight movie`")
    if isinstance(image, TiffImagePlugin.TiffImageFile):
        pages = []
        for page in range(count):
            image.seek(page)
            if not image.tag_v2.get(254, 0) & (REDUCED | TRANSPARENCY):
                pages.append(page)
        if len(pages) > 1:
            raise UserError(f"{what} has {len(pages)} pages: save one of them")
        image.seek(pages[0] if pages else 0)


def bits_of(image: Image.Image, file: Path | None) -> int:
    """Returns the bits per channel of a file, of which Pillow drops the lower half silently."""
    if image.format == "PNG" and file is not None:
        with open(file, "rb") as data:
            return data.read(25)[24]  # of the header IHDR: width, height, bit depth
    if isinstance(image, TiffImagePlugin.TiffImageFile):
        bits = image.tag_v2.get(258, 8)  # BitsPerSample
        return max(bits) if isinstance(bits, tuple) else int(bits)
    return 8


def coding_of(image: Image.Image, file: Path | None) -> tuple[int, int] | None:
    """Returns the color space that a PNG, AVIF or HEIC names, as codes of ITU-T H.273: primaries and transfer.

    None if it names none. `file` is that of the image, None if it has none.
    """
    if file is None or image.format not in ("PNG", "AVIF", "HEIF"):
        return None
    with open(file, "rb") as data:
        start = data.read(HEAD)
    if image.format != "PNG":
        box = NCLX.search(start)
        return struct.unpack(">HH", box[1][:4]) if box else None
    place = start.find(b"cICP", 0, start.find(b"IDAT"))
    return (start[place + 4], start[place + 5]) if 0 <= place < len(start) - 5 else None


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
