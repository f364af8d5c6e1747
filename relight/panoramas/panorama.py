"""The panorama record and the limit of its size."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from relight.core.errors import UserError

LAYOUTS = {  # and the aspects, across and down, that their images have; a lat-long may be squeezed
    "latlong": [(2, 1)], "angular": [(1, 1)], "ball": [(1, 1)], "cross": [(3, 4), (4, 3)], "strip": [(1, 6), (6, 1)],
    "strip-gl": [(1, 6), (6, 1)],
}  # fmt: skip
MAX_PIXELS = 2**25  # 8192 x 4096


@dataclass(frozen=True)
class Panorama:
    """The radiance that arrives at a point from all directions, as an image.

    Attributes:
        pixels: (H,W,3) float32 radiance, linear Rec. 709, row 0 at the top, finite and not negative.
        layout: one of LAYOUTS, how pixels map to directions (relight.panoramas.projection).
        corners: whether the outermost samples lie on the edges of the image, as in OpenEXR environment maps; otherwise
            they lie half a pixel inside.
        flip: whether the light is mirrored left to right, before the rotation.
        yaw: degrees by which the light is rotated about the vertical, from +z toward +x.
        front: the axis at the centre of a lat-long image: "-z" (Debevec, Laval, Poly Haven) or "+z" (OpenEXR).
        repairs: what the reader changed, one sentence each.
    """

    pixels: np.ndarray
    layout: str = "latlong"
    corners: bool = False
    flip: bool = False
    yaw: float = 0.0
    front: str = "-z"
    repairs: list[str] = field(default_factory=list)


def check_size(path: Path, width: int, height: int) -> None:
    """Raises UserError for an image without pixels or with more than MAX_PIXELS; call it before reading pixels."""
    if width <= 0 or height <= 0:
        raise UserError(f"{path}: its size is {width} x {height}; a panorama has pixels")
    if width * height > MAX_PIXELS:
        raise UserError(f"{path}: {width} x {height} pixels are more than 8192 x 4096: scale it down first")
