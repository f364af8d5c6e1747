"""The Python interface: `relight.load()` and its `Relighter`. Pictures are arrays, images of Pillow, or files."""

import base64
import io
from dataclasses import replace
from pathlib import Path
from typing import Unpack

import numpy as np
from PIL import Image

from relight.crop import MASK_THRESHOLD, Crop
from relight.files import UserError, existing_file
from relight.inference import PhotoNetwork, read_onnx
from relight.lights import Light, LightOptions
from relight.photos.background import Background, read_background
from relight.photos.coverage import coverage_of
from relight.photos.infer import Person, balanced, infer_person, mean_exposure_factor, mean_light
from relight.photos.mask import find_mask, split_people
from relight.photos.place import PREFIX, default_light, load_any_light
from relight.photos.read import Photo, as_codes, is_picture, mask_beside, mask_from_image, photo_from_image, read_photo
from relight.photos.render import render
from relight.photos.trust import Trust, assess
from relight.sh import rotate_y

WEIGHTS = Path(__file__).parent.parent / "weights" / "photo.onnx"
MODES = ("ratio", "full")
WHITE_BALANCES = ("keep", "scene")
PREVIEW = 480  # pixels of the longer side of a picture in a notebook
Picture = np.ndarray | Image.Image | Path | str


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
    image = Image.fromarray(as_codes(np.asarray(pixels)))
    image.thumbnail((PREVIEW, PREVIEW), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, "WEBP", quality=90)
    return base64.b64encode(file.getvalue()).decode()


class Relighter:
    """A network that is ready for photos.

    Attributes:
        network: that infers.
        lights: (N,K,3) of its training, or None if unknown.
    """

    def __init__(self, network: PhotoNetwork):
        self.network = network
        lights = network.config.get("lights")
        self.lights = np.asarray(lights, np.float32).reshape(-1, (self.order + 1) ** 2, 3) if lights else None

    @property
    def order(self) -> int:
        """Of the spherical harmonics."""
        return self.network.order

    def infer(
        self, image: Picture | Photo, mask: Picture | None = None, split: bool = True, white_balance: str = "keep"
    ) -> list[Person]:
        """Infers the light, albedo and transport of each person in a photo.

        Args:
            image: (H,W,3) uint8 or uint16 sRGB, an image of Pillow, a file, or a `Photo`.
            mask: (H,W) bool, uint8 of 0 to 255 or float in [0,1], soft edges included; an image of Pillow, or a file.
                By default it is found as for `relight photo` (docs/photos.md).
            split: whether people who do not touch are inferred one by one.
            white_balance: `keep` takes the photo's light to be white on average (relight.photos.infer.balanced),
                `scene` to have the colour that the network infers.

        Returns:
            The people from left to right.

        Raises:
            UserError: if an argument is none of these, or the mask is empty.
        """
        require_white_balance(white_balance)
        photo, coverage = _read_inputs(image, mask)
        coverages = split_people(coverage) if split else [coverage]
        people = [self.infer_person(photo.pixels, coverage) for coverage in coverages]
        return balanced(people) if white_balance == "keep" else people

    def infer_person(self, pixels: np.ndarray, coverage: np.ndarray, crop: Crop | None = None) -> Person:
        """Infers one person, in a given square or the one around the coverage (relight.photos.infer.infer_person)."""
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
            white_balance: of that photo, as in `infer`.
            **options: of `relight.lights.load_light`, for panoramas and coefficients.

        Returns:
            The light, float32, of the order of the network.

        Raises:
            UserError: if it is no light.
        """
        if is_picture(text) and not text.startswith(PREFIX):
            photo = read_photo(text)
            coverage = find_mask(photo, mask or mask_beside(text), mask_model)
            people = self.infer(photo, coverage, white_balance=white_balance)
            return Light(mean_light(people), text)
        light = load_any_light(text, self.order, **options)
        return replace(light, coefficients=light.coefficients.astype(np.float32))

    def relight(
        self,
        image: Picture,
        mask: Picture | None = None,
        light: np.ndarray | str | None = None,
        mode: str = "ratio",
        background: Background | str = "keep",
        turn: float = 0.0,
        match: bool = True,
        stops: float = 0.0,
        white_balance: str = "keep",
    ) -> RelitPhoto:
        """Relights the people of a photo.

        Args:
            image: as in `infer`.
            mask: as in `infer`.
            light: (K,3) radiance coefficients (docs/conventions.md), or a text as in `read_light`; by default that of
                the place in the background, if this is a picture file, else room:7.
            mode: `ratio` keeps all detail of the photo, `full` is albedo * shading.
            background: "keep", "transparent", "panorama", a colour or a picture file; or a `Background`.
            turn: of the light about the vertical axis, its front toward +x, degrees.
            match: whether the light is scaled to the photo's exposure.
            stops: exposure, as a power of two.
            white_balance: as in `infer`; also of a photo that `light` names.

        Returns:
            (H,W,3) of the photo's type, or (H,W,4) for a transparent background; linear floats for OpenEXR.

        Raises:
            UserError: if an argument is none of these.
        """
        if mode not in MODES:
            raise UserError(f"mode {mode!r} is neither ratio nor full")
        photo, coverage = _read_inputs(image, mask)
        people = self.infer(photo, coverage, white_balance=white_balance)
        if light is None:
            light = default_light(background if isinstance(background, str) else "")
        background = read_background(background) if isinstance(background, str) else background
        if not isinstance(light, np.ndarray):
            light = self.read_light(str(light), white_balance=white_balance).coefficients
        light, background = match_exposure(people, light.astype(np.float32), background, match)
        turned = rotate_y(light, np.radians(turn)).astype(np.float32)
        relit = render(photo.pixels, people, turned, mode, background, np.radians(turn), stops)
        return RelitPhoto.of(relit, photo.pixels)

    def trust(self, person: Person) -> Trust:
        """Assesses how far an inference can be trusted."""
        return assess(person, self.lights, self.network.config.get("augment", {}).get("exposure", [0.0])[-1])


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
        path: an .onnx file that `relight export` wrote, a checkpoint (.safetensors), or a model in MLflow, such as
            models:/relight@photo; by default the network that comes with the package. All but .onnx need torch.
        threads: of the inference; 0 for one per core.

    Raises:
        UserError: if it is no such network.
    """
    if path is None and not WEIGHTS.is_file():
        raise UserError("this installation has no weights: give a network with --weights FILE")
    if str(path).startswith("models:/"):
        from relight.tracking.registry import download_network

        path = download_network(str(path))
    path = existing_file(path or WEIGHTS, "network")
    if path.suffix == ".onnx":
        return Relighter(read_onnx(path, threads))
    if path.suffix != ".safetensors":
        raise UserError(f"{path} is no network of relight: give an .onnx or .safetensors file")
    from relight.learning.export import photo_network

    return Relighter(photo_network(path, threads))


def _read_inputs(image: Picture | Photo, mask: Picture | None) -> tuple[Photo, np.ndarray]:
    """Reads a photo and its coverage (H,W) uint8. Raises UserError."""
    if isinstance(image, Photo):
        photo = image
    elif isinstance(image, str | Path):
        photo = read_photo(image)
    elif isinstance(image, Image.Image):
        photo = photo_from_image(image)
    else:
        photo = Photo(_checked_image(image), None, "image")
    if mask is None or isinstance(mask, str | Path):
        return photo, find_mask(photo, mask or (mask_beside(image) if isinstance(image, str | Path) else None))
    shape = photo.pixels.shape[:2]
    coverage = _checked_mask(mask_from_image(mask, shape) if isinstance(mask, Image.Image) else mask)
    if shape != coverage.shape:
        raise UserError(f"the mask is {coverage.shape[::-1]} pixels, the image {shape[::-1]}: they must be equal")
    return photo, coverage


def _checked_image(image: np.ndarray) -> np.ndarray:
    image = np.asarray(image)
    if image.dtype not in (np.uint8, np.uint16) or image.ndim != 3 or image.shape[2] != 3:
        raise UserError(f"the image is {image.dtype} {image.shape}: give (height, width, 3) uint8 sRGB, or uint16")
    return image


def _checked_mask(mask: np.ndarray) -> np.ndarray:
    mask = np.asarray(mask)
    if mask.ndim != 2:
        raise UserError(f"the mask has shape {mask.shape}: give (height, width)")
    mask, _ = coverage_of(mask * np.uint8(255) if mask.dtype == bool else mask, "the mask")
    if not (mask >= MASK_THRESHOLD).any():
        raise UserError("the mask is empty: no pixel of it is at least half white")
    return mask
