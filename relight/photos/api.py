"""The Python interface: `relight.load()` and its `Relighter`. Pictures are arrays, images of Pillow, or files."""

import base64
import io
import math
import warnings
from collections.abc import Iterable
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Unpack

import numpy as np
from PIL import Image

from relight.errors import UserError
from relight.lights import Light, LightOptions, load_light
from relight.maps.square import Crop
from relight.photos.background import Background, read_background
from relight.photos.load import LoadedPhoto, Picture, load_photo, photo_notes
from relight.photos.mask.find import split_people
from relight.photos.network import PhotoNetwork, read_network
from relight.photos.person import (
    AUTO,
    Person,
    balanced,
    infer_person,
    mean_exposure_factor,
    mean_light,
    opposite_lamp,
)
from relight.photos.place import PREFIX, default_light, is_of_person
from relight.photos.read import Photo, as_codes
from relight.photos.render import render
from relight.photos.trust import Trust, assess
from relight.sh import deringed, rotate_y
from relight.sh.conventions import as_table

MODES = ("ratio", "full")
WHITE_BALANCES = ("keep", "scene")
MAX_STOPS = 8
PREVIEW = 480  # pixels of the longer side of a picture in a notebook


class RelitPhoto(np.ndarray):
    """A relit photo (H,W,3) or (H,W,4) uint8 sRGB that notebooks show beside the original.

    Results of computations with it are plain arrays.

    Attributes:
        before: (H,W,3) uint8, the photo; None for a part of a picture.
    """

    before: np.ndarray | None

    @classmethod
    def of(cls, pixels: np.ndarray, before: np.ndarray) -> "RelitPhoto":
        """Views pixels, without a copy, as the relit version of the photo `before`."""
        relit = pixels.view(cls)
        relit.before = before
        return relit

    def __array_finalize__(self, source: np.ndarray | None) -> None:
        self.before = None

    def __array_wrap__(self, array: np.ndarray, *_: object) -> np.ndarray:  # type: ignore[override]
        return array

    def _repr_html_(self) -> str | None:
        """Returns both pictures side by side; None for a part of a picture, which is shown as numbers."""
        if self.before is None:
            return None
        return "".join(
            f'<figure style="display:inline-block;margin:0 8px 0 0"><img alt="{name}" src="data:image/webp;base64,'
            f'{_webp(pixels)}"><figcaption>{name}</figcaption></figure>'
            for name, pixels in (("before", self.before), ("after", self))
        )


def _webp(pixels: np.ndarray) -> str:
    """Returns a preview of an image (H,W,3), at most PREVIEW pixels a side, as WebP in base64."""
    image = Image.fromarray(as_codes(np.asarray(pixels)))
    image.thumbnail((PREVIEW, PREVIEW), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, "WEBP", quality=90)
    return base64.b64encode(file.getvalue()).decode()


class Relighter:
    """A network that is ready for photos.

    Attributes:
        network: that infers.
    """

    def __init__(self, network: PhotoNetwork):
        self.network = network

    def __repr__(self) -> str:
        return f"Relighter({self.network.size} x {self.network.size} pixels, order {self.order})"

    @property
    def order(self) -> int:
        """Of the spherical harmonics."""
        return self.network.order

    def infer(
        self,
        image: Picture | Photo | LoadedPhoto,
        mask: Picture | None = None,
        split: bool = True,
        white_balance: str = "keep",
    ) -> list[Person]:
        """Infers the light, albedo and transport of each person in a photo.

        Args:
            image: (H,W,3) uint8 or uint16 sRGB, an image of Pillow, a file, a `Photo`, or what `load_photo` returned.
            mask: (H,W) bool, uint8 of 0 to 255 or float in [0,1]; an image of Pillow, or a file. By default the file
                beside the photo, its alpha, or an automatic mask.
            split: whether people who do not touch are inferred one by one.
            white_balance: `keep` takes the photo's light to be white on average (relight.photos.person.balanced),
                `scene` to have the color that the network infers.

        Returns:
            The people from left to right.

        Raises:
            UserError: if an argument is none of these, or the mask is empty.

        Warns:
            UserWarning: of a doubtful or automatic mask, and of what was chosen where the file can mean two things;
                not for what `load_photo` returned, whose notes `photo_notes` gives.
        """
        require_white_balance(white_balance)
        photo = image if isinstance(image, LoadedPhoto) else load_photo(image, mask)
        coverages = split_people(photo.coverage) if split else [photo.coverage]
        people = [self.infer_person(photo.pixels, coverage) for coverage in coverages]
        if not isinstance(image, LoadedPhoto):
            _warn(f"{photo.name}: {note}" for note in photo_notes(photo, people))
        return balanced(people) if white_balance == "keep" else people

    def infer_person(self, pixels: np.ndarray, coverage: np.ndarray, crop: Crop | None = None) -> Person:
        """Infers one person.

        Args:
            pixels: (H,W,3) uint8 or uint16 sRGB, or float32 linear Rec. 709.
            coverage: (H,W) uint8 of the person.
            crop: the square to use; by default the one around the coverage.

        Raises:
            UserError: if the coverage is empty.
        """
        return infer_person(self.network, pixels, coverage, crop)

    def read_light(
        self,
        text: str,
        mask: Path | str | None = None,
        mask_model: Path | str | None = None,
        white_balance: str = "keep",
        **options: Unpack[LightOptions],
    ) -> Light:
        """Reads a light as a user names it (docs/photos.md).

        Args:
            text: a panorama, a file of coefficients, "room:12", "key:#ffeedd@45,30", "place:street.jpg", or a
                photo of somebody.
            mask: of that photo.
            mask_model: for its automatic mask.
            white_balance: of that photo, `keep` (its light is white on average) or `scene` (as inferred).
            **options: of `relight.lights.load_light`, for panoramas and coefficients.

        Returns:
            The light, float32, of the order of the network; `relight.sh.deringed` unless it is that of a photo.

        Raises:
            UserError: if it is no light.
        """
        if is_of_person(text):
            photo = load_photo(text, mask, mask_model)
            people = self.infer(photo, white_balance=white_balance)
            notes = [f"{Path(text).name}: {note}" for note in photo_notes(photo, people)]
            if photo.automatic:
                notes.append(f"{text} is taken for a photo of somebody; the light of a place is {PREFIX}{text}")
            return Light(mean_light(people), text, notes=notes)
        return self._usable(load_light(text, self.order, **options))

    def _usable(self, light: Light) -> Light:
        """Returns a light, float32, of the order of the network, and deringed unless it is that of a photo."""
        coefficients = light.at_order(self.order).coefficients
        if not is_of_person(light.source):
            coefficients = deringed(coefficients)
        return replace(light, coefficients=coefficients.astype(np.float32))

    def relight(
        self,
        image: Picture,
        mask: Picture | None = None,
        light: Light | np.ndarray | Path | str = AUTO,
        mode: str = "ratio",
        background: Background | Path | str = "keep",
        turn: float = 0.0,
        match: bool = True,
        stops: float = 0.0,
        white_balance: str = "keep",
    ) -> RelitPhoto:
        """Relights the people of a photo.

        Args:
            image: (H,W,3) uint8 or uint16 sRGB, an image of Pillow, or a file.
            mask: (H,W) bool, uint8 of 0 to 255 or float in [0,1]; an image of Pillow, or a file. By default the file
                beside the photo, its alpha, or an automatic mask.
            light: a light, a text for `read_light`, (K,3) radiance coefficients (docs/conventions.md), which alone are
                not deringed, or `auto`: the light of the place in the background if this is a picture file, else a warm
                lamp from the darker side (`opposite_lamp`).
            mode: `ratio` keeps all detail of the photo, `full` is albedo * shading.
            background: "keep", "transparent", "panorama" (the light's), a color or a picture file; or a `Background`.
            turn: of the light about the vertical axis, its front toward +x, degrees.
            match: whether the light is scaled to the photo's exposure.
            stops: exposure, as a power of two, from -8 to 8.
            white_balance: `keep` (the light is white on average) or `scene` (as inferred); also of a photo that
                `light` names.

        Returns:
            (H,W,3) of the photo's type, or (H,W,4) for a transparent background; linear floats for OpenEXR.

        Raises:
            UserError: if an argument is none of these.

        Warns:
            UserWarning: as `infer` does, and of a light that no place can have.
        """
        if mode not in MODES:
            raise UserError(f"mode {mode!r} is neither ratio nor full")
        if not (isinstance(turn, Real) and math.isfinite(turn)):
            raise UserError(f"turn is {turn!r}: give degrees, a finite number")
        if not (isinstance(stops, Real) and abs(stops) <= MAX_STOPS):
            raise UserError(f"stops is {stops!r}: give a number from -{MAX_STOPS} to {MAX_STOPS}")
        if isinstance(background, Path):
            background = str(background)
        if not isinstance(background, Background | str):
            raise UserError(f"the background is a {type(background).__name__}: give a text, a file or a Background")
        photo = load_photo(image, mask)
        people = self.infer(photo, white_balance=white_balance)
        _warn(f"{photo.name}: {note}" for note in photo_notes(photo, people))
        if isinstance(light, str) and light == AUTO and isinstance(background, str):
            light = default_light(background)
        if isinstance(light, str | Path):
            name = opposite_lamp(people) if light == AUTO else str(light)
            light = self.read_light(name, white_balance=white_balance)
        elif isinstance(light, Light):
            light = self._usable(replace(light, coefficients=as_table(light, light.source)).checked())
        else:
            light = Light(as_table(light, "the light"), "the light").checked().at_order(self.order)
        _warn(light.notes)
        background = read_background(background, light.panorama) if isinstance(background, str) else background
        coefficients = light.coefficients.astype(np.float32)
        coefficients, background = match_exposure(people, coefficients, background, match)
        turned = rotate_y(coefficients, np.radians(turn)).astype(np.float32)
        relit = render(photo.pixels, people, turned, mode, background, np.radians(turn), stops)
        return RelitPhoto.of(relit, photo.pixels)

    def trust(self, person: Person) -> Trust:
        """Assesses how far an inference can be trusted."""
        return assess(person, self.network.lights, self.network.config.get("augment", {}).get("exposure", [0.0])[-1])


def _warn(notes: Iterable[str]) -> None:
    """Shows notes to the caller of a method of `Relighter`."""
    for note in notes:
        warnings.warn(note, stacklevel=3)


def require_white_balance(white_balance: str) -> None:
    """Raises UserError if this is no white balance."""
    if white_balance not in WHITE_BALANCES:
        raise UserError(f"white balance {white_balance!r} is neither keep nor scene")


def match_exposure(
    people: list[Person], light: np.ndarray, background: Background, match: bool = True
) -> tuple[np.ndarray, Background]:
    """Scales a light to the exposure of a photo, and matches a background to it.

    Args:
        people: of the photo.
        light: (K,3).
        background: that is read.
        match: otherwise the light keeps its own strength.

    Returns:
        The light (K,3) and the background.
    """
    needed = mean_exposure_factor(people, light)
    factor = needed if match else 1.0
    light = light * np.float32(factor)
    return light, background.matched(light, factor, factor / needed)


def load(path: Path | str | None = None, threads: int = 0) -> Relighter:
    """Loads a network.

    Args:
        path: an .onnx file that `relight export` wrote; by default the network that comes with the package.
        threads: of the inference; 0 for one per core.

    Raises:
        UserError: if it is no such network.
    """
    return Relighter(read_network(path, threads))
