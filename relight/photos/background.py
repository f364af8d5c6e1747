"""What stands behind the relit figure: the photo's own background, a colour, a picture, the panorama, or nothing."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor

from relight.files import UserError
from relight.panoramas import Panorama, luminance
from relight.photos.color import relit, rolled
from relight.photos.environment import see
from relight.photos.read import is_picture, read_photo
from relight.srgb import LINEAR


@dataclass
class Background:
    """kind: keep | color | picture | panorama | none (transparent). color (3,) uint8 sRGB; picture (h,w,3) uint8, its
    linear values times `tint` (3,); panorama, its radiance times `gain`; blur in degrees; shadow: of the figures, on a
    background that is not the photo's own.
    """

    kind: str = "keep"
    color: np.ndarray | None = None
    picture: np.ndarray | None = None
    panorama: Panorama | None = None
    gain: float = 1.0
    tint: np.ndarray | float = 1.0
    blur: float = 0.0
    shadow: bool = True

    @property
    def replaced(self) -> bool:
        """Whether something stands where the photo's own background was."""
        return self.kind not in ("keep", "none")

    def under(self, light: np.ndarray, factor: float, level: float = 1.0) -> "Background":
        """The background in the exposure and white balance of figures under `light` (K,3) times `factor`.

        A panorama is that light. A picture is taken to be as well exposed as the photo is; it follows `level`, by which
        the figures become brighter than in the photo, and its white goes half-way to that of the light. A colour stays.
        """
        tint = 1.0
        if self.kind == "picture":
            tint = level * np.sqrt(_hue(np.maximum(light[0], 0)) / _hue(white(self.picture)))
        return replace(self, gain=factor, tint=tint)

    def linear(self, shape: tuple[int, int], turn: float = 0.0, stops: float = 0.0) -> np.ndarray:
        """Linear values (H,W,3) float32 in [0,1] behind a photo of `shape`, when the light is turned by `turn` radians,
        and all but a colour exposed by `stops` more.

        A radiance L shows as pi L: images here are albedo times irradiance, so a matt white figure in the open is as
        bright as what surrounds it. Not for `keep`, which is the photo itself, nor for `none`.
        """
        if self.kind == "color":
            return np.broadcast_to(LINEAR[self.color], (*shape, 3))
        if self.kind == "picture":
            return relit(LINEAR[cover(self.picture, shape)], np.float32(self.tint) * np.ones(3, np.float32) * 2**stops)
        return rolled(see(self.panorama, shape, turn, self.blur) * np.float32(np.pi * self.gain * 2**stops))


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


def white(picture: np.ndarray) -> np.ndarray:
    """The colour (3,), linear, of the light in a picture (h,w,3) uint8, by its "shades of grey" (Finlayson and Trezzi
    2004): a mean of its values' sixth powers, between the average and the brightest.
    """
    every = max(int(np.sqrt(picture[..., 0].size / 40_000)), 1)
    seen = LINEAR[picture[::every, ::every]].astype(np.float64)
    return (seen**6).mean((0, 1)) ** (1 / 6)


def _hue(color: np.ndarray) -> np.ndarray:
    """`color` (3,) at luminance 1, no channel below a fifth of it."""
    return np.maximum(color / max(float(luminance(color)), 1e-6), 0.2)


def cover(picture: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """`picture` (h,w,3) uint8, scaled to fill `shape` (H,W) and cut at the middle."""
    height, width = shape
    scale = max(height / picture.shape[0], width / picture.shape[1])
    rows, columns = height / scale, width / scale
    top, left = (picture.shape[0] - rows) / 2, (picture.shape[1] - columns) / 2
    box = (left, top, min(left + columns, picture.shape[1]), min(top + rows, picture.shape[0]))
    return np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.LANCZOS, box))
