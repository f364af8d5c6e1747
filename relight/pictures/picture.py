"""A picture and what its file says of it: one door for a file, an array, an image of Pillow and a frame of a clip."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Union

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.files import existing_file
from relight.core.numbers import finite
from relight.pictures.codes import as_codes, convert_alpha, with_alpha
from relight.pictures.deep import is_linear, of_linear, read_16_bits, read_linear
from relight.pictures.opening import (
    MAX_PIXELS,
    bits_of,
    coding_of,
    decoding_errors,
    open_picture,
    require_still,
    stored,
    upright,
)
from relight.pictures.profile import to_srgb

FEW_BITS = 1 << 12  # codes of cameras that write 12 bits into 16
LEAST_SIDE = 8  # pixels
Given = Union[np.ndarray, Image.Image, Path, str, "Picture"]  # what `Picture.of` takes


@dataclass(repr=False)
class Picture:
    """A picture, upright and in sRGB.

    Attributes:
        pixels: (H,W,3) uint8 or uint16 sRGB, or float32 linear Rec. 709, as OpenEXR has it.
        alpha: (H,W) uint8, uint16, or float32 in [0,1], as the file has it; None if there is none that varies.
        name: of the file, without its suffix.
        notes: what was chosen where a file can mean two things, one sentence each.
        coverage: (H,W) uint8 of its people, once they are found (relight.photos.mask.find).
        bodies: those whom networks found one by one (relight.photos.mask.pose.Body).
        suffix: of pictures that are written in kind: .png, .tif or .exr.
        file: that it was read from, or None.
        what: its name in errors, such as "photo me.jpg".
    """

    pixels: np.ndarray
    alpha: np.ndarray | None = None
    name: str = "image"
    notes: list[str] = field(default_factory=list)
    coverage: np.ndarray | None = None
    bodies: list[Any] = field(default_factory=list)
    suffix: str = ".png"
    file: Path | None = None
    what: str = "the image"

    def __repr__(self) -> str:
        height, width = self.shape
        return f"Picture({self.name}, {width} x {height} {self.pixels.dtype})"

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width (H, W)."""
        return self.pixels.shape[0], self.pixels.shape[1]

    @property
    def codes(self) -> np.ndarray:
        """(H,W,3) uint8 sRGB."""
        return as_codes(self.pixels)

    @property
    def rgba(self) -> np.ndarray:
        """The pixels, with alpha as a fourth channel if there is one."""
        return self.pixels if self.alpha is None else with_alpha(self.pixels, self.alpha)

    @classmethod
    def of(cls, given: Given, what: str = "", name: str = "image") -> "Picture":
        """Takes a picture, however it is given.

        Args:
            given: a file; an image of Pillow; (H,W,3) uint8 or uint16 sRGB, or floats that are linear Rec. 709, with 1
                as white and no bound above; (H,W) of them if grey; or a `Picture`, as it is. What has EXIF data is
                turned upright, and what has a color profile is converted to sRGB.
            what: its name in errors; before the path of a file.
            name: of what is no file.

        Raises:
            UserError: if it is none of these, damaged, CMYK, animated, RAW, too large or too small, or has more than
                16 bits.
        """
        if isinstance(given, Picture):
            return given
        if isinstance(given, str | Path):
            path = existing_file(given, what or "photo")
            what = f"{what or 'photo'} {path}"
            if is_linear(path):
                pixels, alpha, notes = read_linear(path, what)
                picture = cls(pixels, alpha, path.stem, notes, suffix=".exr", file=path, what=what)
            else:
                with decoding_errors(what), open_picture(path, what) as image:
                    picture = replace(_of_image(image, what, path), name=path.stem, file=path)
        elif isinstance(given, Image.Image):
            with decoding_errors(what or "the image"):
                picture = replace(_of_image(given, what or "the image"), name=name)
        else:
            picture = replace(_of_array(np.asarray(given), what or "the image"), name=name)
        height, width = picture.shape
        if picture.alpha is not None and picture.alpha.min() == picture.alpha.max():
            if convert_alpha(picture.alpha[0, 0], np.uint8) < 255:
                picture.notes.append("its alpha is the same everywhere, and less than opaque: it is left out")
            picture.alpha = None
        if min(height, width) < LEAST_SIDE:
            raise UserError(f"{picture.what} is only {width}x{height} pixels: {LEAST_SIDE} a side are the least")
        some = picture.pixels[::64]  # few photos are grey, and few rows are quick
        if all(np.array_equal(rows[..., 1:], rows[..., :2]) for rows in (some, picture.pixels)):
            picture.notes.append("the photo is grey: a colored light tints the people as a whole")
        return picture

    def downscaled(self, size: int) -> "Picture":
        """Returns the picture as uint8 sRGB, scaled down so that its longer side is at most `size`."""
        (height, width), codes = self.shape, self.codes
        if (scale := finite("size", size, LEAST_SIDE, MAX_PIXELS) / max(height, width)) >= 1:
            return replace(self, pixels=codes)
        side = max(LEAST_SIDE, round(width * scale)), max(LEAST_SIDE, round(height * scale))

        def resized(values: np.ndarray) -> np.ndarray:
            return np.asarray(Image.fromarray(values).resize(side, Image.Resampling.LANCZOS, reducing_gap=3))

        pixels = resized(replace(self, pixels=codes).rgba)
        alpha = None if self.alpha is None else pixels[..., 3]
        coverage = None if self.coverage is None else resized(self.coverage)
        return replace(self, pixels=pixels[..., :3], alpha=alpha, coverage=coverage)


def decoded(image: Image.Image, what: str, file: Path | None) -> tuple[np.ndarray, np.ndarray | None]:
    """Returns pixels (H,W,3) and alpha (H,W), or None, as an image stores them: uint8, or uint16 from its `file`.

    Raises:
        UserError: if it is animated, not RGB or grey, or has more than 16 bits.
    """
    require_still(image, what)
    is_deep_grey = image.mode.startswith("I;16")
    if image.mode in ("CMYK", "YCCK", "LAB", "HSV"):
        raise UserError(f"{what} is {image.mode}: convert it to RGB (sRGB)")
    bits = bits_of(image, file)
    if not is_deep_grey and (bits > 16 or image.mode.startswith(("I", "F"))):
        raise UserError(f"{what} has more than 16 bits per channel: save it in 16 bits, or as OpenEXR if it is linear")
    if is_deep_grey:
        grey, alpha = stored(image).astype(np.uint16), None  # of the machine's byte order
        if "transparency" in image.info:
            alpha = np.where(grey == image.info["transparency"], 0, 65535).astype(np.uint16)
        return np.repeat(grey[..., None], 3, axis=2), alpha
    if bits == 16 and file is not None:
        return read_16_bits(file, what, image.tell())
    if "A" in image.getbands() or "transparency" in image.info:
        rgba = np.asarray(image.convert("RGBA"))
        return rgba[..., :3], rgba[..., 3]
    return np.asarray(image.convert("RGB")), None


def _of_image(image: Image.Image, what: str, file: Path | None = None) -> Picture:
    """Converts an image of any mode; 16 bits are read from its `file`."""
    pixels, alpha = decoded(image, what, file)
    pixels, alpha = upright(pixels, image), None if alpha is None else upright(alpha, image)
    largest = int(pixels.max())
    coding = coding_of(image, file)
    pixels, notes = to_srgb(pixels, image, what, coding)
    if image.format in ("AVIF", "HEIF") and not (coding or image.info.get("icc_profile")):
        notes.append("its file has no color space, and is taken as sRGB; that of the coded picture is not read")
    if pixels.dtype == np.uint16 and largest < FEW_BITS:
        notes.append(f"its largest code is {largest} of 65535, as if it held fewer than 16 bits: it is taken as dark")
    suffix = ".tif" if pixels.dtype == np.uint16 and image.format == "TIFF" else ".png"
    return Picture(pixels, alpha, notes=notes, suffix=suffix, what=what)


def _of_array(pixels: np.ndarray, what: str) -> Picture:
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=2)
    is_known = pixels.dtype in (np.uint8, np.uint16) or pixels.dtype.kind == "f"
    if not is_known or pixels.ndim != 3 or pixels.shape[2] != 3:
        kinds = "(height, width, 3) uint8 or uint16 sRGB, or linear floats"
        raise UserError(f"{what} is {pixels.dtype} {pixels.shape}: give {kinds}")
    if pixels.dtype.kind != "f":
        return Picture(pixels, what=what)
    if pixels.size and pixels.max() > 1 and (pixels == np.floor(pixels)).all():
        raise UserError(f"{what} is {pixels.dtype}, but holds whole numbers up to {pixels.max():g}: give uint8")
    pixels, notes = of_linear(pixels, what)
    return Picture(pixels, notes=[f"{what} holds floats, which are taken as linear", *notes], suffix=".exr", what=what)
