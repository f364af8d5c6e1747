"""The maps of one view of a figure: what baking makes and training reads."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Maps:
    """Maps of one view of a figure on a square image, row 0 at the top; zero outside the mask.

    mask (H,W) bool; coverage (H,W) float32 in [0,1], the antialiased mask (equals mask without supersampling);
    albedo (H,W,3) float32 linear; normal (H,W,3) float32 unit shading normals in the camera frame (+x right, +y up,
    +z toward the camera); depth (H,W) float32, distance toward -z from the camera plane in scene units;
    ao (H,W) float32 = T00/.8862 (clipped to [0,1]); transport (H,W,K) float32, direct, no 1/pi, index l*l+l+m;
    bounced (H,W,K,3) float32: what further bounces add per colour channel, None when none were asked for:
    image = albedo * ((transport[..., None] + bounced) . light, summed over K).
    info: plain JSON values (name, subject, rays, seed, order, offset, versions, ...), kept in the EXR header.
    """

    mask: np.ndarray
    coverage: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    depth: np.ndarray
    ao: np.ndarray
    transport: np.ndarray
    bounced: np.ndarray | None = None
    info: dict = field(default_factory=dict)
