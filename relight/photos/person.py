"""The network's inference for each person of a photo."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from relight.core.srgb import decode, encode, to_linear
from relight.maps.square import MASK_THRESHOLD, Crop, Window, crop_around
from relight.panoramas import luminance
from relight.photos.guide import FittedMap, Guide, luma, square_root
from relight.photos.mask.pose import Body
from relight.photos.network import PhotoNetwork
from relight.photos.shading import exposure_factor, gain, shade, steady
from relight.photos.tone import chroma

OPAQUE = 240  # coverage (of 255) from which a pixel shows hardly anything but the person
BRIGHTEST = 0.99  # quantile of a person's values that the network sees as white, if it exceeds that
LEAST_CHANNEL = 0.2  # of the luminance: lower bound of the channels of `Person.white`, which lights are divided by
PAPER_GAMMA = 2.2  # a factor on coded values is its power on linear ones, for networks trained with color=paper


@dataclass(frozen=True, repr=False)
class Person:
    """A person of a photo and what was inferred of them. Maps are (S,S,...) float32, zero outside of `mask`.

    Attributes:
        crop: the square of the photo that the network was given.
        coverage: (H,W) uint8, of this person in the photo.
        mask: (S,S) bool.
        image: (S,S,3) the photo, linear.
        albedo: (S,S,3).
        transport: (S,S,K).
        light: (K,3) inferred radiance coefficients.
        gamma: 1, or PAPER_GAMMA for networks of coded values.
        white: (3,) color that `balanced` moved from the inferred light to the albedo; 1 without it.
        exposure: factor on `image` for the network, below 1 for linear photos whose values exceed white.
        body: what networks found of them, if the mask is automatic.
    """

    crop: Crop
    coverage: np.ndarray
    mask: np.ndarray
    image: np.ndarray
    albedo: np.ndarray
    transport: np.ndarray
    light: np.ndarray
    gamma: float = 1.0
    white: np.ndarray = field(default_factory=lambda: np.ones(3, np.float32))
    exposure: float = 1.0
    body: Body | None = None

    def __repr__(self) -> str:
        rows, columns = (f"{part.start} to {part.stop}" for part in self.crop.window)
        return f"Person(rows {rows}, columns {columns}; {len(self.light)} coefficients)"

    @cached_property
    def shading(self) -> np.ndarray:
        """(S,S,3) under the inferred light."""
        return shade(self.transport, self.light)

    @property
    def error(self) -> float:
        """Reconstruction error: RMSE of albedo * shading against the image over the mask, as the network sees it."""
        rebuilt, image = (self.exposure * values[self.mask] for values in (self.albedo * self.shading, self.image))
        difference = np.clip(rebuilt, 0, 1) - np.clip(image, 0, 1)
        return float(np.sqrt((difference**2).mean()))

    def fit_gain(self, light: np.ndarray) -> FittedMap:
        """Fits the gain of mode `ratio` on the photo's linear values, under a new light (K,3)."""
        return self.fit(gain(self.transport, self.mask, self.light, light) ** self.gamma)

    def fit_shading(self, light: np.ndarray) -> FittedMap:
        """Fits the shading of mode `full`, as a factor on linear values, under a new light (K,3)."""
        return self.fit(steady(shade(self.transport, light), light) ** self.gamma)

    @cached_property
    def fitted_albedo(self) -> FittedMap:
        """The square root of the linear albedo, which is nearly linear in that of the photo where the light is even."""
        return FittedMap(square_root(self._linear(self.albedo)), self._color_guide, textured=True)

    def fit(self, values: np.ndarray) -> FittedMap:
        """Fits values (S,S,C), such as transport or shading, on the photo's luma."""
        return FittedMap(values, self._grey_guide)

    def detail(self, linear: np.ndarray, window: Window) -> np.ndarray:
        """Returns the detail of the photo beyond the square's resolution, as `FittedMap.place` takes it.

        Where the person covers a pixel in part, the photo's value is not their own and there is no detail.

        Args:
            linear: (h,w,3) values of the photo.
            window: their rows and columns, within the crop's.

        Returns:
            (h,w,3) difference of square roots.
        """
        solid = np.maximum(self.coverage[window].astype(np.float32) - OPAQUE, 0) / (255 - OPAQUE)
        return (square_root(linear) - self.crop.place(self._color_guide.filled, window)) * solid[..., None]

    @cached_property
    def chroma(self) -> np.ndarray:
        """(S,S,3): the color around each pixel, by which clipped values are rebuilt (relight.photos.tone.chroma)."""
        return chroma(self._linear(self.image), self.mask)

    @cached_property
    def _color_guide(self) -> Guide:
        """The guide of maps that follow the colors of the photo, such as albedo: square roots of linear RGB."""
        return Guide(square_root(self._linear(self.image)), self.mask)

    @cached_property
    def _grey_guide(self) -> Guide:
        """The guide of maps that follow its brightness, such as shading: luma of the square roots of linear RGB."""
        return Guide(luma(square_root(self._linear(self.image))), self.mask)

    def _linear(self, values: np.ndarray) -> np.ndarray:
        """Returns linear values, given those of the network: networks of the paper take sRGB codes as linear."""
        return values if self.gamma == 1 else decode(values).astype(np.float32)


def infer_person(
    network: PhotoNetwork, pixels: np.ndarray, coverage: np.ndarray, crop: Crop | None = None, body: Body | None = None
) -> Person:
    """Infers the light, albedo and transport of one person.

    Args:
        network: `train.color` of its config says which values its images have.
        pixels: (H,W,3) uint8 or uint16 sRGB, or float32 linear Rec. 709.
        coverage: (H,W) uint8 of the person.
        crop: the square to use; by default the one around the coverage.
        body: of the person, if networks found it.

    Raises:
        UserError: if the coverage is empty.
    """
    crop = crop or crop_around(coverage, network.size)
    image, mask = network_input(pixels, coverage, crop)
    exposure = 1 / max(1.0, float(np.quantile(image[mask], BRIGHTEST)))
    seen = np.minimum(image * np.float32(exposure), 1)
    paper = network.config.get("train", {}).get("color") == "paper"
    if paper:  # these networks were trained with coded values as if they were linear
        image = seen = encode(seen).astype(np.float32)
        exposure = 1.0
    albedo, transport, light = network.infer(seen, mask)
    light, gamma = light / np.float32(exposure), PAPER_GAMMA if paper else 1.0
    return Person(crop, coverage, mask, image, albedo, transport, light, gamma, exposure=exposure, body=body)


def network_input(pixels: np.ndarray, coverage: np.ndarray, crop: Crop) -> tuple[np.ndarray, np.ndarray]:
    """Resamples a photo to the network's square.

    Linear values are averaged over the person alone, so that neither dark edges nor the color of the background enter
    at the silhouette.

    Args:
        pixels: (H,W,3) uint8 or uint16 sRGB, or float32 linear Rec. 709.
        coverage: (H,W) uint8.
        crop: the square.

    Returns:
        The image (S,S,3), linear and zero outside of the mask, and the mask (S,S) bool.
    """
    window = crop.window  # nothing is covered elsewhere
    inside = replace(crop, top=crop.top - window[0].start, left=crop.left - window[1].start)
    pixels, coverage = pixels[window], coverage[window]
    share = inside.extract(coverage)
    mask = share >= min(MASK_THRESHOLD, share.max())  # thinner than the network's pixels: keep the largest share
    image = np.empty((*mask.shape, 3), np.float32)
    for channel in range(3):  # one at a time: an 8k photo in float32 is 800 MB
        image[..., channel] = inside.extract(to_linear(pixels[..., channel]) * coverage) / np.maximum(share, 1e-3)
    return np.maximum(image * mask[..., None], 0), mask


def with_light(person: Person, light: np.ndarray) -> Person:
    """Returns a person whose light is known: it replaces the inferred one, in the exposure of this one.

    The product of albedo and shading stays.

    Args:
        person: as inferred.
        light: (K,3) in any exposure.
    """
    known = light * np.float32(exposure_factor(person.light, light, person.transport, person.mask))
    factor = gain(person.transport, person.mask, known, person.light)
    return replace(person, albedo=np.clip(person.albedo * factor, 0, 1), light=known)


def balanced(people: Sequence[Person]) -> list[Person]:
    """Moves the mean color of the light from the light to the albedo, as if the camera had balanced it to white.

    A camera balances its pictures to about white, while the network takes a part of warm cloth for warm light. The
    product of light and albedo, and the luminance of the mean shading, stay. The mean is over the people of a photo.
    """
    areas = [(person.crop.side / person.crop.size) ** 2 for person in people]
    total = sum(area * person.shading[person.mask].sum(0, dtype=np.float64) for area, person in zip(areas, people))
    white = np.maximum(total / max(float(luminance(total)), 1e-6), LEAST_CHANNEL).astype(np.float32)
    return [
        replace(person, albedo=person.albedo * white, light=person.light / white, white=person.white * white)
        for person in people
    ]
