"""What is composited behind the people: the photo's own background, a color, a picture, a panorama, or nothing."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import count, repeat
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor, ImageOps

from relight.core.errors import UserError
from relight.core.numbers import finite
from relight.core.srgb import LINEAR
from relight.panoramas import Panorama, luminance
from relight.photos.backdrop import blurred, camera_view
from relight.photos.tone import apply_gain, roll_off
from relight.pictures.codes import on_white
from relight.pictures.opening import is_picture
from relight.pictures.picture import Given, Picture
from relight.pictures.video import at_constant_rate, is_video, read_frames

MAX_BLUR = 60  # degrees
KINDS = ("keep", "transparent", "color", "picture", "panorama")


@dataclass
class Background:
    """What is composited behind the people.

    Attributes:
        kind: keep | transparent | color | picture | panorama.
        color: (3,) uint8 sRGB.
        picture: (h,w,3) uint8 sRGB; of a clip, its first frame.
        clip: a video or a folder of frames.
        film: what it shows at each frame of a movie, such pictures.
        panorama: in the unit of the light that it was projected to.
        gain: factor on the panorama's radiance.
        tint: (3,) factor on the picture's linear values.
        blur: of the panorama or picture, degrees.
        shadow: whether people cast shadows on a background that is not the photo's own.
        name: as the user gave it.

    Raises:
        UserError: for another kind, or if what has no detail is to be blurred.
    """

    kind: str = "keep"
    color: np.ndarray | None = None
    picture: np.ndarray | None = field(default=None, repr=False)
    clip: Path | None = None
    film: Iterator[np.ndarray] | None = field(default=None, repr=False)
    panorama: Panorama | None = field(default=None, repr=False)
    gain: float = 1.0
    tint: np.ndarray | float = 1.0
    blur: float = 0.0
    shadow: bool = True
    name: str = "keep"

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UserError(f"a background of the kind {self.kind!r} is none of {', '.join(KINDS)}")
        finite("blur", self.blur, 0, MAX_BLUR)
        if self.blur and self.kind not in ("picture", "panorama"):
            raise UserError(f"a panorama or a picture behind can be blurred, not the background {self.name}")

    @property
    def moves(self) -> bool:
        """Whether it is another one in the next frame, as a panorama is that turns with the light."""
        return self.kind == "panorama" or self.film is not None

    @property
    def replaced(self) -> bool:
        """Whether the photo's own background is covered."""
        return self.kind not in ("keep", "transparent")

    def playing(self, fps: float) -> "Background":
        """Returns this for the frames of one movie: a clip plays at its own speed, again from its start at its end."""

        def film(clip: Path) -> Iterator[np.ndarray]:
            numbers = count()
            while True:
                frames, shown, rate = read_frames(clip)
                for frame, i in zip(at_constant_rate(frames, shown), numbers):
                    yield from repeat(on_white(frame.rgba), round((i + 1) * fps / rate) - round(i * fps / rate))

        return replace(self, film=film(self.clip)) if self.clip else self

    def matched(self, light: np.ndarray, factor: float, level: float = 1.0) -> "Background":
        """Matches exposure and white balance to people under a new light.

        A panorama is that light. A picture is taken to be as well exposed as the photo; its white goes half-way to that
        of the light. A color stays.

        Args:
            light: (K,3), in the photo's exposure.
            factor: the one that brought the light there; a panorama is shown by it, which other kinds ignore.
            level: how much brighter the people become than in the photo; a picture, exposed like the photo, follows.
        """
        tint: np.ndarray | float = 1.0
        if self.kind == "picture" and self.picture is not None:
            tint = level * np.sqrt(_hue(np.maximum(light[0], 0)) / _hue(estimate_white(self.picture)))
        return replace(self, gain=factor, tint=tint)

    def linear(self, shape: tuple[int, int], turn: float = 0.0, stops: float = 0.0) -> np.ndarray:
        """Renders a color, picture or panorama behind a photo.

        A radiance L is shown as pi L: images here are albedo times irradiance, so a matte white person in the open is
        as bright as the surroundings.

        Args:
            shape: (H, W) of the photo.
            turn: of the light, radians.
            stops: exposure of pictures and panoramas, as powers of two.

        Returns:
            (H,W,3) float32 in [0,1].
        """
        if self.kind == "color":
            return np.broadcast_to(LINEAR[self.color], (*shape, 3))
        if self.kind == "picture" and self.picture is not None:
            gain = np.float32(self.tint) * np.ones(3, np.float32) * 2**stops
            shown = Image.fromarray(next(self.film) if self.film else self.picture)
            behind = LINEAR[np.asarray(ImageOps.fit(shown, shape[::-1], Image.Resampling.LANCZOS))]  # it covers all
            return apply_gain(blurred(behind, self.blur) if self.blur else behind, gain)
        assert self.panorama is not None  # the one kind that is left
        view = camera_view(self.panorama, shape, turn=turn, blur=self.blur)
        return roll_off(view * np.float32(np.pi * self.gain * 2**stops))


def read_background(
    given: Background | Given, blur: float = 0.0, shadow: bool = True, moving: bool = False
) -> Background:
    """Reads a background as a user gives it.

    Args:
        given: keep, transparent, panorama (the light's), a color (#223344, white), a picture's file, or a picture as
            `Picture.of` takes it; or a `Background`.
        blur: of the panorama or picture, degrees.
        shadow: whether people cast shadows on it.
        moving: whether it may be a clip, too: a video or a folder of frames.

    Raises:
        UserError: if it is none of these.
    """
    if isinstance(given, Background):
        return replace(given, blur=blur or given.blur, shadow=shadow and given.shadow)
    if not isinstance(given, str | Path):
        picture = Picture.of(given, "the background")
        return Background("picture", picture=on_white(picture.rgba), blur=blur, shadow=shadow, name=picture.name)
    text = str(given)
    if text in ("keep", "transparent", "panorama"):
        return Background(text, blur=blur, shadow=shadow, name=text)
    path = Path(text)
    is_clip = is_video(path) if path.is_file() else path.is_dir() and text not in ImageColor.colormap
    if is_clip and not moving:
        raise UserError(f"background {text} is a clip, which is for `relight movie`: give a picture")
    if is_clip or is_picture(text):
        codes = on_white((next(read_frames(path)[0]) if is_clip else Picture.of(text, "background")).rgba)
        return Background("picture", None, codes, path if is_clip else None, blur=blur, shadow=shadow, name=text)
    try:
        color = np.array(ImageColor.getcolor(text, "RGBA"), np.uint8)
    except ValueError:
        if re.search(r"\.\w+$", text) and Path(text).is_file():
            raise UserError(f"background {text} is not a picture: give JPEG, PNG, WebP or TIFF") from None
        words = f"keep, transparent, panorama, a color (#334455) or a picture file{', or a clip' * moving}"
        raise UserError(f"background {text!r} is not {words}") from None
    if color[3] < 255:
        raise UserError(f"background {text} is not opaque: give a color without alpha, or transparent")
    return Background("color", color=color[:3], blur=blur, shadow=shadow, name=text)


def estimate_white(picture: np.ndarray) -> np.ndarray:
    """Estimates the linear color (3,) of the light in a picture (h,w,3) uint8 by "shades of grey".

    That is a mean of the sixth powers of its values, between the average and the largest (Finlayson and Trezzi 2004).
    """
    every = max(int(np.sqrt(picture[..., 0].size / 40_000)), 1)  # some 40,000 pixels are enough
    return (LINEAR[picture[::every, ::every]].astype(np.float64) ** 6).mean((0, 1)) ** (1 / 6)


def _hue(color: np.ndarray) -> np.ndarray:
    """Returns a color (3,) scaled to luminance 1, with no channel below a fifth."""
    return np.maximum(color / max(float(luminance(color)), 1e-6), 0.2)
