"""From a photo and its masks to what the network says about each person in it."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from relight.learning.networks import Network
from relight.learning.predict import predict
from relight.photos.color import chroma
from relight.photos.frame import SOLID, Frame, frame
from relight.photos.relight import floor_of, ratio, shading
from relight.photos.upsample import Fitted, Guide, fitted, from_inside, luma, root
from relight.srgb import LINEAR, decode, encode

OPAQUE = 240  # coverage (of 255) from which a pixel shows hardly anything but the figure
PAPER_GAMMA = 2.2  # what a factor on coded values does to linear ones, for networks trained with color=paper


@dataclass(frozen=True)
class Figure:
    """One person of a photo. Maps are (S,S,...) float32 on the network's square, zero outside `mask`.

    coverage (H,W) uint8 of this person in the photo; mask (S,S) bool; image (S,S,3) what the network saw, linear;
    albedo (S,S,3); transport (S,S,K); light (K,3) radiance coefficients, as inferred; gamma: 1, or PAPER_GAMMA where
    the network's values are coded ones.
    """

    frame: Frame
    coverage: np.ndarray
    mask: np.ndarray
    image: np.ndarray
    albedo: np.ndarray
    transport: np.ndarray
    light: np.ndarray
    gamma: float = 1.0

    @cached_property
    def shading(self) -> np.ndarray:
        """(S,S,3) under the inferred light."""
        return shading(self.transport, self.light)

    @property
    def error(self) -> float:
        """Root mean square difference between the photo and albedo * shading over the figure."""
        difference = (np.clip(self.albedo * self.shading, 0, 1) - self.image)[self.mask]
        return float(np.sqrt((difference**2).mean()))

    def gain(self, light: np.ndarray) -> Fitted:
        """For mode `ratio`: the factor on the photo's linear values under `light`."""
        old = self.shading
        gain = ratio(old, shading(self.transport, light), floor_of(old, self.mask))
        return fitted(gain**self.gamma, self.grey)

    @cached_property
    def fitted_albedo(self) -> Fitted:
        """The square root of the linear albedo: near to linear in that of the photo, wherever the light is even."""
        return fitted(root(self._linear(self.albedo)), self.colors, fine=True)

    def fitted_shading(self, light: np.ndarray) -> Fitted:
        """For mode `full`: the shading under `light`, as a factor on linear values."""
        return fitted(shading(self.transport, light) ** self.gamma, self.grey)

    @cached_property
    def fitted_transport(self) -> Fitted:
        return fitted(self.transport, self.grey)

    def detail(self, linear: np.ndarray, rows: tuple[int, int]) -> np.ndarray:
        """(h,w,3): what the guide of the photo's own pixels has beyond that of the square.

        linear (h,w,3): the photo's values in `rows` and in the frame's columns. Where the figure covers a pixel only in
        part, the photo's value is not its own and does not count.
        """
        solid = self.coverage[slice(*rows), slice(*self.frame.columns)].astype(np.float32)
        solid = np.maximum(solid - OPAQUE, 0)[..., None] / (255 - OPAQUE)
        return (root(linear) - self.frame.place(self.colors.extended(self.colors.values), rows)) * solid

    @cached_property
    def colors(self) -> Guide:
        """By which albedo is brought to the photo's pixels."""
        return Guide(root(self._linear(self.image)), self.mask)

    @cached_property
    def grey(self) -> Guide:
        """By which all other maps are."""
        return Guide(luma(root(self._linear(self.image))), self.mask)

    @cached_property
    def chroma(self) -> np.ndarray:
        """(S,S,3): the colour about each pixel, by which what is clipped is rebuilt (relight.photos.color.chroma)."""
        return chroma(self._linear(self.image), self.mask)

    def _linear(self, values: np.ndarray) -> np.ndarray:
        return values if self.gamma == 1 else decode(values).astype(np.float32)

    def with_maps(self, **maps: np.ndarray) -> "Figure":
        """The same figure with other maps or another light, for smoothing over time."""
        return replace(self, **maps)


def infer(network: Network, config: dict, pixels: np.ndarray, coverage: np.ndarray, box: Frame | None = None) -> Figure:
    """What `network` says about the person under `coverage` (H,W) uint8 of `pixels` (H,W,3) uint8 sRGB.

    Albedo and transport of the silhouette are held to those of the inside beside it (`upsample.from_inside`).

    config: the network's, which says what its images' values are (train.color). box: a square to use instead of the
    coverage's own. Raises UserError when the coverage is empty.
    """
    box = box or frame(coverage, network.size)
    image, mask = look(pixels, coverage, box)
    paper = config.get("train", {}).get("color") == "paper"
    if paper:  # these networks were shown coded values as if they were linear
        image = encode(image).astype(np.float32)
    maps = predict(network, image, mask, mirrored=True)
    return Figure(
        frame=box,
        coverage=coverage,
        mask=mask,
        image=image,
        albedo=from_inside(maps["albedo"], mask),
        transport=from_inside(maps["transport"], mask),
        light=maps["light"],
        gamma=PAPER_GAMMA if paper else 1.0,
    )


def look(pixels: np.ndarray, coverage: np.ndarray, box: Frame) -> tuple[np.ndarray, np.ndarray]:
    """The square as the network sees it: image (S,S,3) linear in [0,1], zero outside mask (S,S) bool.

    Averages are taken of linear values and of the figure alone, so neither dark edges nor the background's colour
    come in at the silhouette.
    """
    seen = box.crop(coverage)
    mask = seen >= SOLID
    if not mask.any():  # thinner than the network's pixels everywhere: keep the brightest trace of it
        mask = seen >= seen.max()
    image = np.empty((*mask.shape, 3), np.float32)
    for channel in range(3):  # one at a time: an 8k photo in float32 is 800 MB
        image[..., channel] = box.crop(LINEAR[pixels[..., channel]] * coverage) / np.maximum(seen, 1e-3)
    return np.clip(image * mask[..., None], 0, 1), mask
