"""One light, whatever it came from."""

from dataclasses import dataclass, field, replace

import numpy as np

from relight.files import UserError
from relight.lights.statistics import moment_eigenvalue, reference_brightness
from relight.panoramas.panorama import Panorama
from relight.sh.basis import count, order_of

TOLERANCE = -1e-3  # of the moment eigenvalue: rounding of stored files, and of truncated colour


@dataclass(frozen=True)
class Light:
    """Radiance coefficients (K, 3) float64 in relight's convention; where they came from; the panorama if there is one.

    `notes` are sentences for the user: what was mended on the way, and whether such a light can exist.
    """

    coefficients: np.ndarray
    source: str
    panorama: Panorama | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def order(self) -> int:
        return order_of(len(self.coefficients))

    def normalised(self, target: float = 0.8) -> "Light":
        """The light scaled to the reference brightness `target`: E(0, 0, 1) of the brightest channel.

        A light that leaves the front dark is scaled by its mean irradiance, so that it does not blow up the rest.
        """
        brightness = float(reference_brightness(self.coefficients))
        mean = float(self.coefficients[0].max()) * np.pi * 0.28209479177387814
        if mean <= 0:
            raise UserError(f"{self.source}: a light without light: its mean is not positive")
        scale = target / max(brightness, 0.25 * mean)
        return replace(self, coefficients=self.coefficients * scale)

    def at_order(self, order: int) -> "Light":
        """The light cut to `order`, or filled up with zeros to it."""
        coefficients = np.zeros((count(order), 3))
        kept = min(len(coefficients), len(self.coefficients))
        coefficients[:kept] = self.coefficients[:kept]
        return replace(self, coefficients=coefficients)

    def judged(self) -> "Light":
        """With a note if no real light has these coefficients (method.md section 1)."""
        if moment_eigenvalue(self.coefficients) >= TOLERANCE:
            return self
        note = (
            f"{self.source}: no real light has these coefficients (they need negative light somewhere); they may be in "
            "another convention, or sharpened"
        )
        return replace(self, notes=[*self.notes, note])
