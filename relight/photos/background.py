"""What stands behind the relit figure: the photo's own background, a colour, a picture, the panorama, or nothing."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor

from relight.files import UserError
from relight.panoramas import Panorama
from relight.photos.color import rolled
from relight.photos.environment import see
from relight.photos.read import is_picture, read_photo
from relight.srgb import LINEAR


@dataclass
class Background:
    """kind: keep | color | picture | panorama | none (transparent). color (3,) uint8 sRGB; picture (h,w,3) uint8;
    panorama, times `gain`; blur in degrees.
    """

    kind: str = "keep"
    color: np.ndarray | None = None
    picture: np.ndarray | None = None
    panorama: Panorama | None = None
    gain: float = 1.0
    blur: float = 0.0

    def linear(self, shape: tuple[int, int], turn: float = 0.0, stops: float = 0.0) -> np.ndarray:
        """Linear values (H,W,3) float32 in [0,1] behind a photo of `shape`, when the light is turned by `turn` radians
        and a panorama exposed by `stops` more.

        Not for `keep`, which is the photo itself, nor for `none`.
        """
        if self.kind == "color":
            return np.broadcast_to(LINEAR[self.color], (*shape, 3))
        if self.kind == "picture":
            return LINEAR[cover(self.picture, shape)]
        return rolled(see(self.panorama, shape, turn, self.blur) * np.float32(self.gain * 2**stops))


def background(text: str, panorama: Panorama | None = None, blur: float = 0.0) -> Background:
    """A background as a user names it: keep, transparent, panorama, a colour (#223344, white) or a picture file.

    panorama: that of the light, when the light has one. Raises UserError.
    """
    if text == "keep":
        return Background("keep")
    if text in ("transparent", "none"):
        return Background("none")
    if text == "panorama":
        if panorama is None:
            raise UserError(
                "background panorama: this light has no panorama; give one with --light, or another background"
            )
        return Background("panorama", panorama=panorama, blur=blur)
    if is_picture(text):
        return Background("picture", picture=read_photo(text, "background").pixels)
    try:
        return Background("color", color=np.array(ImageColor.getrgb(text)[:3], np.uint8))
    except ValueError:
        pass
    if re.search(r"\.\w+$", text) and Path(text).is_file():
        raise UserError(f"background {text} is not a picture: give JPEG, PNG, WebP or TIFF")
    raise UserError(f"background {text!r} is not keep, transparent, panorama, a colour (#334455) or a picture file")


def cover(picture: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """`picture` (h,w,3) uint8, scaled to fill `shape` (H,W) and cut at the middle."""
    height, width = shape
    scale = max(height / picture.shape[0], width / picture.shape[1])
    rows, columns = height / scale, width / scale
    top, left = (picture.shape[0] - rows) / 2, (picture.shape[1] - columns) / 2
    box = (left, top, min(left + columns, picture.shape[1]), min(top + rows, picture.shape[0]))
    return np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS, box))
