"""The light record and its files."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.files import atomic_write, write_json
from relight.core.numbers import finite
from relight.lights.statistics import moment_eigenvalue, reference_brightness
from relight.panoramas import Panorama
from relight.sh import CONVENTIONS, UNOCCLUDED_T00, coefficient_count, from_relight, order_of
from relight.sh.conventions import require_bounded

MIN_EIGENVALUE = -1e-3  # moment eigenvalue of a valid light; below 0, as coefficients in files are rounded
FACTORS = 1e-12, 1e12  # on the radiance, whose products single precision holds
MIN_FRONT = 0.25  # reference brightness over the mean irradiance, below which the front of a light is dark
FRAME = "x right, y up, z toward the camera, unless the convention says otherwise"


@dataclass(frozen=True)
class Light:
    """Distant illumination in spherical harmonics.

    Attributes:
        coefficients: (K,3) float64 radiance, RGB, in relight's convention (docs/conventions.md).
        source: origin of the light, such as a file's path or "room:7".
        panorama: from which the coefficients were projected, or None.
        notes: sentences for the user: repairs, and whether the light is physically possible.
    """

    coefficients: np.ndarray
    source: str
    panorama: Panorama | None = field(default=None, repr=False)
    notes: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return self.source

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Returns the coefficients, so that functions of NumPy and relight take a light for them."""
        return np.array(self.coefficients, dtype, copy=copy)

    @property
    def order(self) -> int:
        """The highest band of the spherical harmonics."""
        return order_of(len(self.coefficients))

    def normalised(self, target: float = 0.8) -> "Light":
        """Returns the light scaled to the reference brightness `target`: E(0,0,1) of the brightest channel.

        A light with a dark front is scaled so that MIN_FRONT of its mean irradiance has this brightness, which limits
        that of the other sides.

        Raises:
            UserError: if the target is out of range, or as `require_usable` does.
        """
        target = finite("the brightness of a light", target, *FACTORS)
        self.require_usable()
        mean = float(self.coefficients[0].max()) * UNOCCLUDED_T00  # irradiance, over all normals
        scale = target / max(float(reference_brightness(self.coefficients)), MIN_FRONT * mean)
        seen = self.panorama and replace(self.panorama, pixels=self.panorama.pixels * np.float32(scale))
        return replace(self, coefficients=self.coefficients * scale, panorama=seen)

    def require_usable(self) -> None:
        """Raises UserError if the mean radiance is not positive, or a coefficient not finite or too large."""
        require_bounded(self.coefficients, self.source)
        if not self.coefficients[0].max() > 0:
            raise UserError(f"{self.source} is black: the mean radiance of a light must be positive")

    def at_order(self, order: int) -> "Light":
        """Returns the light truncated, or padded with zeros, to `order`."""
        coefficients = np.zeros((coefficient_count(order), 3))
        kept = min(len(coefficients), len(self.coefficients))
        coefficients[:kept] = self.coefficients[:kept]
        return replace(self, coefficients=coefficients)

    def checked(self) -> "Light":
        """Returns the light, with one note if no non-negative radiance has its coefficients (`moment_eigenvalue`).

        Raises:
            UserError: as `require_usable`.
        """
        self.require_usable()
        if moment_eigenvalue(self.coefficients) >= MIN_EIGENVALUE:
            return self
        note = (
            f"{self.source}: no real light has these coefficients (they need negative light somewhere); they may be in "
            "another convention, or sharpened"
        )
        return self if note in self.notes else replace(self, notes=[*self.notes, note])


def parts_of(text: str) -> list[str]:
    """Returns the names of the lights whose sum `text` names, such as "room:7 + key:#ffffff@90,0"; mostly one."""
    return [text] if os.path.exists(text) else re.split(r"\s+\+\s+", text)  # no pathlib: it raises for long texts


def total(lights: Sequence[Light], source: str) -> Light:
    """Adds lights of one order.

    Args:
        lights: in any unit that they share.
        source: of the sum.

    Returns:
        Their sum, with the notes of all, and the panorama of the one that has one, if others have none.
    """
    panoramas = [light.panorama for light in lights if light.panorama is not None]
    coefficients = np.sum([light.coefficients for light in lights], 0)
    notes = [note for light in lights for note in light.notes]
    return Light(coefficients, source, panoramas[0] if len(panoramas) == 1 else None, notes)


def direction(azimuth: float | str, elevation: float | str, name: str) -> np.ndarray:
    """Returns the unit vector (3,) toward a lamp.

    Args:
        azimuth: degrees from the camera toward +x, -360 to 360.
        elevation: degrees above the horizon, -90 to 90.
        name: name of the light in errors.

    Raises:
        UserError: if an angle is out of range.
    """
    a = np.radians(finite(f"{name}: azimuth", azimuth, -360, 360))
    e = np.radians(finite(f"{name}: elevation", elevation, -90, 90))
    return np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])


def light_file(path: Path, convention: str) -> Path:
    """Returns the file that a light given as `path` is written to.

    Args:
        path: .json or .npy. Since .npy cannot store the convention, it becomes part of the name: kitchen.npy is written
            as kitchen.relight.npy.
        convention: of the coefficients in the file.

    Raises:
        UserError: if the path has another suffix or names another convention.
    """
    suffix, named = path.suffix.lower(), path.stem.rpartition(".")[2].lower()
    if suffix not in (".json", ".npy"):
        raise UserError(f"{path}: a light is written as .json or .npy, and drawn as .png")
    if suffix == ".json" or named == convention:
        return path
    if named in CONVENTIONS:
        raise UserError(f"{path}: its name says {named}, but the light would be written in {convention}")
    return path.with_name(f"{path.stem}.{convention}.npy")


def write_light(light: Light, path: Path, convention: str = "relight") -> Path:
    """Writes a light, whole or not at all.

    Args:
        light: to write.
        path: .json (coefficients, convention, frame and source) or .npy ((K,3) float64), as `light_file` takes it.
        convention: convention of the coefficients in the file (relight.sh.conventions).

    Returns:
        The path of the file.

    Raises:
        UserError: if the path is invalid, or the convention cannot express the light.
    """
    coefficients, path = from_relight(light.coefficients, convention), light_file(path, convention)
    if path.suffix.lower() == ".json":
        content = {"convention": convention, "frame": FRAME, "order": light.order, "source": light.source}
        write_json(path, content | {"coefficients": coefficients.tolist()})
    else:
        with atomic_write(path) as temporary, open(temporary, "wb") as file:
            np.save(file, coefficients)
    return path
