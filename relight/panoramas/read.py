"""Reads panoramas: detects format and layout, checks and repairs pixels."""

import codecs
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.files import existing_file, require_readable, require_unpacked
from relight.panoramas.exr import read_exr
from relight.panoramas.hdr import read_hdr
from relight.panoramas.panorama import LAYOUTS, Panorama
from relight.panoramas.repair import repair_pixels, repair_sun

SUFFIXES = (".hdr", ".pic", ".rgbe", ".xyze", ".exr")
# First bytes of files that are not panoramas, and an error message for each.
OTHER_FILES = (
    ((b"\x89PNG", b"\xff\xd8\xff", b"GIF8"), "a PNG, JPEG or GIF, of too low a range for light; use its .hdr or .exr"),
    ((b"II*\x00", b"MM\x00*"), "a TIFF picture; save it as .exr"),
    (b"PF", "a portable float map; save it as .exr"),
)


def read_panorama(path: Path | str, layout: str = "auto", repair: bool = False) -> Panorama:
    """Reads a .hdr or .exr panorama; the format is detected from the content, not the name.

    Args:
        path: of the file.
        layout: one of LAYOUTS; "auto" takes OpenEXR's attribute `envmap`, else decides by the aspect ratio. Square
            pictures are ambiguous and need a layout, as do crosses whose corners are not empty.
        repair: whether non-finite pixels are replaced by the mean of their neighbours (`repair_pixels`), and a sun
            without red is rebuilt (`repair_sun`).

    Returns:
        The panorama, with negative pixels set to zero; `repairs` lists the changes.

    Raises:
        UserError: if the file is damaged, black or has non-finite pixels, or if there is no such layout.
    """
    path = existing_file(path, "panorama")
    if layout != "auto" and layout not in LAYOUTS:
        raise UserError(f"layout={layout}: must be auto or one of {', '.join(LAYOUTS)}")
    pixels, envmap, repairs = _read_pixels(path)
    resolved = decide_layout(path, pixels.shape[1], pixels.shape[0], layout, envmap)
    has_attribute = resolved == envmap
    pixels = np.ascontiguousarray(pixels)
    repairs += repair_pixels(path, pixels, repair) + _clip_negatives(path, pixels) + repair_sun(path, pixels, repair)
    side = (min(pixels.shape[:2]) + 5) // 6  # half of a face
    if layout != resolved == "cross" and np.ptp((pixels[:side, :side], pixels[:side, -side:]), (1, 2)).any():
        which = "relight light --layout cross, or panoramas.layout=cross, says that it is one"
        raise UserError(f"{path}: its aspect is that of a cross, but its corners are not empty, as in a photo; {which}")
    front = "+z" if has_attribute and resolved == "latlong" else "-z"
    return Panorama(pixels, resolved, has_attribute, front=front, repairs=repairs)


def _read_pixels(path: Path) -> tuple[np.ndarray, str | None, list[str]]:
    """Returns the pixels, the layout that OpenEXR's attribute `envmap` tells, or None, and what the reader changed."""
    with open(path, "rb") as file:
        start = file.read(256).removeprefix(codecs.BOM_UTF8)
    if not start:
        raise UserError(f"{path}: an empty file")
    if start.startswith(b"\x76\x2f\x31\x01"):
        picture = read_exr(path)
        return picture.pixels, picture.envmap, picture.repairs
    if start.startswith(b"#?"):
        pixels, repairs = read_hdr(path)
        return pixels, None, repairs
    require_unpacked(path)
    for magic, description in OTHER_FILES:
        if start.startswith(magic):
            raise UserError(f"{path}: {description}")
    raise UserError(f"{path}: not a panorama; Radiance .hdr and OpenEXR are read")


def decide_layout(path: Path, width: int, height: int, layout: str, envmap: str | None) -> str:
    """Returns the layout that the user names, else that of the attribute `envmap`, else that of the aspect ratio.

    Raises:
        UserError: if the layout is ambiguous, or if it does not fit the aspect ratio.
    """
    if layout == "auto" and envmap:
        layout = envmap

    def fits(name: str) -> bool:
        return any(width * down == height * across for across, down in LAYOUTS[name])

    if layout == "auto":
        if abs(width - 2 * height) <= 0.01 * width:
            return "latlong"
        if width == height:
            which = "relight light --layout, or panoramas.layout, names its own: angular, ball or latlong"
            raise UserError(f"{path}: a square picture may have several layouts; {which}")
        if not (layout := next((name for name in ("cross", "strip") if fits(name)), "")):
            raise UserError(f"{path}: {width} x {height} is no aspect of a panorama, such as 2:1, 4:3, 3:4, 6:1, 1:6")
    if (envmap and min(width, height) < 2) or not (layout == "latlong" or fits(layout)):  # with samples on corners
        aspects = " or ".join(f"{across}:{down}" for across, down in LAYOUTS[layout])
        raise UserError(f"{path}: {width} x {height} does not fit the layout {layout}, which is {aspects}")
    return layout


def _clip_negatives(path: Path, pixels: np.ndarray) -> list[str]:
    """Sets negative values of finite pixels (H,W,3) to zero, in place; says so, and refuses a black picture."""
    below = pixels < 0
    pixels[below] = 0
    if not pixels.any():
        raise UserError(f"{path} is black; a panorama must have some light")
    if not below.any():
        return []
    return [f"{below.any(-1).sum()} of {below[..., 0].size} pixels had negative values, set to zero"]


def list_panoramas(folder: Path | str) -> list[str]:
    """Lists the panoramas in a folder and its subfolders, without hidden files, as sorted relative paths.

    Raises:
        UserError: if the folder does not exist or holds no panorama.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise UserError(f"panoramas.folder={folder.resolve()}: there is no such folder")
    require_readable(folder, "panoramas.folder")
    files = (
        file.relative_to(folder) for file in folder.rglob("*") if file.suffix.lower() in SUFFIXES and file.is_file()
    )
    names = sorted(f.as_posix() for f in files if not any(part.startswith((".", "__MACOSX")) for part in f.parts))
    if not names:
        raise UserError(f"{folder} holds no panorama, nor do its subfolders; suffixes are {', '.join(SUFFIXES)}")
    return names
