"""The panorama record."""

from dataclasses import dataclass, field

import numpy as np

LAYOUTS = ("latlong", "angular", "ball", "cross", "strip", "strip-gl")


@dataclass(frozen=True)
class Panorama:
    """All the light that arrives at a point, as an image.

    pixels   (H, W, 3) float32, linear radiance, row 0 at the top, finite and not negative
    layout   one of LAYOUTS: how pixels map to directions (relight.panoramas.layouts)
    corners  the outermost samples lie on the edges of the image, as in OpenEXR environment maps, not half a pixel in
    flip     mirrored left to right (applied first)
    yaw      degrees by which the light is then turned about the vertical, +z toward +x for yaw > 0
    front    the axis at the centre of a lat-long image: "-z" (Debevec, Laval, Poly Haven) or "+z" (OpenEXR)
    source   where it came from, for tables and messages
    repairs  what the reader mended, a sentence each
    """

    pixels: np.ndarray
    layout: str = "latlong"
    corners: bool = False
    flip: bool = False
    yaw: float = 0.0
    front: str = "-z"
    source: str = ""
    repairs: list[str] = field(default_factory=list)
