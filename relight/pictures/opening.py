"""Finds and opens the files of pictures: what is wrong is one sentence, before pixels are decoded where possible."""

import io
import re
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image, TiffImagePlugin

from relight.core.errors import UserError
from relight.core.files import PHOTO_SUFFIXES, VIDEO_SUFFIXES, require_readable
from relight.core.names import find_path, folded

MAX_PIXELS = 178_000_000  # as Pillow; decoders allocate memory before they find that a file is a decompression bomb
TOO_LARGE = f"at most {MAX_PIXELS // 10**6} million pixels are read"
MAX_BYTES = 500_000_000
READ = (*PHOTO_SUFFIXES, ".exr")  # suffixes where no panorama could be meant
PHOTO_KINDS = f"{', '.join(PHOTO_SUFFIXES)} or .exr; a clip for relight movie is {', '.join(VIDEO_SUFFIXES)} or .gif"
FREE_PIXELS, MOST_PACKED = 2**22, 2**13  # pixels that are believed of any file, and of each of its bytes
HEIC = (".heic", ".heif")
CAMERAS = "3fr arw cr2 cr3 crw dcr dng erf fff gpr iiq kdc mef mos mrw nef nrw orf pef raf raw rw2 rwl sr2 srf srw x3f"
RAW = tuple(f".{name}" for name in CAMERAS.split())  # files of cameras
DEVELOP = "the RAW file of a camera: develop it first, and save it as JPEG, or as TIFF of 16 bits"
DNG_VERSION, SUB_DIRECTORIES = 50706, 330  # tags of RAW files that may be called .tif; their first picture is a preview
NUMBER = re.compile(r"(\d+)")
ANIMATIONS = ("GIF", "WEBP", "PNG", "AVIF")  # formats whose further pictures are frames; in others they are previews
REDUCED, TRANSPARENCY = 1, 4  # bits of a TIFF page's NewSubfileType: a preview, a mask


def open_picture(source: Path | bytes, what: str, kinds: str = PHOTO_KINDS) -> Image.Image:
    """Reads the header of a file and checks the size; no pixel is decoded yet.

    Args:
        source: the file, or its bytes.
        what: its name in errors, such as "photo me.jpg".
        kinds: that could be given, for the error.

    Raises:
        UserError: if it is not a picture, a camera's RAW file, or too large.
    """
    stored = source.stat().st_size if isinstance(source, Path) else len(source)
    if stored > MAX_BYTES:
        raise UserError(f"{what} is larger than {MAX_BYTES // 10**6} MB: give a smaller file")
    with open(source, "rb") if isinstance(source, Path) else io.BytesIO(source) as file:
        head = file.read(12)
    suffix = source.suffix.lower() if isinstance(source, Path) else ""
    if suffix in HEIC or head[4:10] == b"ftyphe":  # phones and messengers call HEIC files .jpg, too
        try:
            from pi_heif import register_heif_opener
        except ImportError:
            raise UserError(f"{what} is HEIC, which needs pi-heif: pip install '.[heic]', or save it as JPEG") from None
        register_heif_opener()
    if suffix in RAW or (head[:4] == b"II*\0" and head[8:10] == b"CR"):  # the mark of .cr2
        raise UserError(f"{what} is {DEVELOP}")
    try:
        with warnings.catch_warnings(action="ignore"):  # Pillow only warns of large pictures; here they are an error
            image = Image.open(source if isinstance(source, Path) else io.BytesIO(source))
    except Image.DecompressionBombError:
        raise UserError(f"{what} is too large: {TOO_LARGE}") from None
    except Exception:
        if suffix in PHOTO_SUFFIXES:
            linear = ", or as OpenEXR if it is linear" * suffix.startswith(".tif")
            raise UserError(f"{what} is damaged, or no {suffix} that is read here: save it as PNG{linear}") from None
        raise UserError(f"{what} cannot be read as a picture: give {kinds}") from None
    width, height = image.size
    if width * height > MAX_PIXELS:
        raise UserError(f"{what} is too large, {width}x{height}: {TOO_LARGE}")
    if width * height > max(FREE_PIXELS, MOST_PACKED * stored):
        raise UserError(f"{what} is damaged: it promises {width}x{height} pixels in {stored} bytes")
    return image


@contextmanager
def decoding_errors(what: str) -> Iterator[None]:
    """Turns what Pillow's decoders raise for damaged files, a dozen types, into a UserError.

    A package that is missing is not the file's fault: `ImportError` passes. Warnings, as of EXIF data, are left out.
    """
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    except (UserError, ImportError):
        raise
    except Exception as error:
        raise UserError(f"{what} is damaged or cut short ({str(error).split(chr(10))[0]})") from None


def require_still(image: Image.Image, what: str) -> None:
    """Goes to the first picture of a file that is no preview; raises UserError for films, pages, and previews alone."""
    count = getattr(image, "n_frames", 1)
    if count > 1 and image.format in ANIMATIONS:
        raise UserError(f"{what} is animated ({count} frames): save one, or all in a folder for `relight movie`")
    if isinstance(image, TiffImagePlugin.TiffImageFile):
        image.filename, pages = "", []  # else Pillow maps the file, and what lies on its side becomes a jumble
        for page in range(count):
            image.seek(page)
            if DNG_VERSION in image.tag_v2:
                raise UserError(f"{what} is {DEVELOP}")
            if not image.tag_v2.get(254, 0) & (REDUCED | TRANSPARENCY):
                pages.append(page)
        if len(pages) > 1:
            raise UserError(f"{what} has {len(pages)} pages: save one of them")
        image.seek(pages[0] if pages else 0)
        if not pages and SUB_DIRECTORIES in image.tag_v2:
            raise UserError(f"{what} holds a preview of another picture, as RAW files do: save the picture itself")


def orientation_of(image: Image.Image) -> int:
    """Returns the orientation in the EXIF data of an image, 1 to 8: 1 if they are damaged, as browsers take it."""
    try:
        return image.getexif().get(ExifTags.Base.Orientation, 1)
    except Exception:  # Pillow raises a dozen types
        return 1


def stored(image: Image.Image) -> np.ndarray:
    """Returns the pixels of an image, black as 0; Pillow leaves those of a grey TIFF of 16 bits as they are coded."""
    is_negative = isinstance(image, TiffImagePlugin.TiffImageFile) and image.tag_v2.get(262) == 0  # white is zero
    pixels = np.asarray(image)
    return 65535 - pixels.astype(np.uint16) if is_negative and image.mode.startswith("I;16") else pixels


def upright(pixels: np.ndarray, image: Image.Image) -> np.ndarray:
    """Returns pixels (H,W) or (H,W,C) of an image turned and mirrored as its EXIF says: not a TIFF's that it turned."""
    if (orientation := orientation_of(image)) in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    down, right = (-1 if orientation in mirrored else 1 for mirrored in ((3, 4, 7, 8), (2, 3, 6, 7)))
    return np.ascontiguousarray(pixels[::down, ::right])


def bits_of(image: Image.Image, file: Path | None) -> int:
    """Returns the bits per channel of a file, of which Pillow drops the lower half silently."""
    if image.format == "PNG" and file is not None:
        return _png_chunk(file, b"IHDR")[8]  # after width and height
    if isinstance(image, TiffImagePlugin.TiffImageFile):
        bits = image.tag_v2.get(258, 8)  # BitsPerSample
        return max(bits) if isinstance(bits, tuple) else int(bits)
    return 8


def coding_of(image: Image.Image, file: Path | None) -> tuple[int, int] | None:
    """Returns the color space that a PNG, AVIF or HEIC codes for its picture: primaries and transfer of ITU-T H.273.

    None if it codes none, or if an AVIF or HEIC has an ICC profile, which counts there; in a PNG the codes do.
    `file` is that of the image; by default the one that Pillow opened, if it had a name.
    """
    file = file or Path(getattr(image, "filename", ""))
    if image.format == "PNG" and file.is_file():
        codes = _png_chunk(file, b"cICP")
        return (codes[0], codes[1]) if len(codes) == 4 else None
    if image.format == "HEIF" and (profile := image.info.get("nclx_profile")):
        return profile["color_primaries"], profile["transfer_characteristics"]
    if image.format == "AVIF" and file.is_file() and not image.info.get("icc_profile"):
        for kind, content in _primary_properties(memoryview(file.read_bytes())):
            if kind == b"colr" and bytes(content[:4]) == b"nclx":
                return struct.unpack_from(">HH", content, 4)
    return None


def _png_chunk(file: Path, name: bytes) -> bytes:
    """Returns the content of a PNG's first chunk of this name in front of the pixels, or nothing."""
    with open(file, "rb") as data:
        data.seek(8)
        while len(head := data.read(8)) == 8 and head[4:] != b"IDAT":
            size = int.from_bytes(head[:4])
            if head[4:] == name:
                return data.read(size)
            data.seek(size + 4, 1)
    return b""


def _boxes(data: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Yields kind and content of each box in some data (ISO 14496-12, 4.2)."""
    while len(data) >= 8:
        size, start = int.from_bytes(data[:4]), 8
        if size == 1:
            size, start = int.from_bytes(data[8:16]), 16
        yield bytes(data[4:8]), data[start : size or None]
        data = data[max(size, start) if size else len(data) :]


def _primary_properties(data: memoryview) -> list[tuple[bytes, memoryview]]:
    """Returns kind and content of the properties of an AVIF's primary picture (ISO 14496-12, 8.11; 23008-12, 9.3)."""
    meta = dict(_boxes(next(content for kind, content in _boxes(data) if kind == b"meta")[4:]))
    parts = list(_boxes(meta[b"iprp"]))
    properties = list(_boxes(dict(parts)[b"ipco"]))
    primary = int.from_bytes(meta[b"pitm"][4:])
    for table in (content for kind, content in parts if kind == b"ipma"):
        wide_items, wide_indices, place = table[0] > 0, table[3] & 1, 8
        for _ in range(int.from_bytes(table[4:8])):
            count = place + (4 if wide_items else 2)
            start, end = count + 1, count + 1 + table[count] * (1 + wide_indices)
            if int.from_bytes(table[place:count]) == primary:
                indices = np.frombuffer(table[start:end], ">u2" if wide_indices else "u1")
                return [properties[i - 1] for i in indices & (0x7FFF if wide_indices else 0x7F) if i]  # without a flag
            place = end
    return []


def mask_beside(photo: Path) -> Path | None:
    """Returns the mask file in the folder of a photo, me_mask.png for me.jpg; None if there is none."""
    beside = find_path(photo.parent, (f"{photo.stem}_mask.png",))
    return beside if beside is not None and beside.is_file() else None


def mask_in(masks: Path, name: str) -> Path | None:
    """Returns the mask of the photo `name` in a folder of masks, name.png or name_mask.png; None if there is none."""
    files = {folded(file.stem): file for file in sorted(masks.iterdir(), reverse=True) if file.suffix.lower() in READ}
    return files.get(folded(name)) or files.get(folded(f"{name}_mask"))


def is_picture(path: Path | str) -> bool:
    """Returns whether a name is that of a picture, and not of a light or a panorama, as .exr is where it may be one."""
    return Path(path).suffix.lower() in PHOTO_SUFFIXES


def list_pictures(folder: Path) -> list[Path]:
    """Lists the pictures in a folder by name, 2 before 10. Raises UserError if there is none."""
    require_readable(folder, "folder")
    files = (path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    if not (found := [path for path in files if path.suffix.lower() in READ]):
        raise UserError(f"folder {folder} holds no photo ({', '.join(READ)})")
    return sorted(found, key=lambda path: [int(part) if part.isdecimal() else part for part in NUMBER.split(path.name)])


def list_photos(folder: Path) -> list[Path]:
    """Lists the pictures in a folder without masks (x_mask.png). Raises UserError if there is none."""
    if not (found := [path for path in list_pictures(folder) if not path.stem.endswith("_mask")]):
        raise UserError(f"folder {folder} holds no photo beside its masks")
    return found
