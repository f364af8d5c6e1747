"""The light set: a table of lights, stored as lights.npz for programs and as lights.csv for people."""

import csv
import io
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.files import atomic_write, existing_file, write_text
from relight.core.npz import read_npz
from relight.lights.statistics import reference_brightness
from relight.sh import bands, coefficient_count, order_of
from relight.sh.conventions import MAX_COEFFICIENT

CONVENTION = "relight"  # radiance, orthonormal, no Condon-Shortley, l*l+l+m, +z toward the camera, linear Rec. 709 RGB
SPLITS = ("train", "validation", "test", "unusual", "rich")


@dataclass(frozen=True)
class LightSet:
    """N lights; every attribute is an array with one row per light.

    Attributes:
        coefficients: (N,K,3) float32 radiance.
        split: (N,) str, "train", "validation" or "test"; for unusual lights "unusual" (for tests) or "rich" (for
            training).
        source: (N,) str, the panorama: "room:12", "sky:3", or a file's path within its folder.
        yaw: (N,) degrees by which the panorama's light was rotated about the vertical, from +z toward +x.
        scale: (N,) factor from the panorama's units.
        reason: (N,) str, the rules that an unusual light breaks, separated by spaces; empty for usual lights.
    """

    coefficients: np.ndarray
    split: np.ndarray
    source: np.ndarray
    yaw: np.ndarray
    scale: np.ndarray
    reason: np.ndarray

    def __len__(self) -> int:
        return len(self.coefficients)

    @property
    def order(self) -> int:
        """The highest band of the spherical harmonics."""
        return order_of(self.coefficients.shape[1])

    def rows(self, which: np.ndarray) -> "LightSet":
        """Selects lights by a mask (N,) or by indices."""
        return replace(self, **{f.name: getattr(self, f.name)[which] for f in fields(self)})

    def of(self, split: str) -> "LightSet":
        """Selects the lights of one split."""
        return self.rows(self.split == split)


def table_paths(path: Path | str) -> tuple[Path, Path]:
    """Returns the .npz and the .csv of a light set, given its folder or either file."""
    path = Path(path)
    if path.suffix.lower() not in (".npz", ".csv"):
        path = path / "lights.npz"
    archive = path if path.suffix.lower() == ".npz" else path.with_suffix(".npz")
    return archive, path.with_suffix(".csv")


def write_light_set(lights: LightSet, path: Path | str) -> None:
    """Writes a light set as .npz and as .csv.

    Args:
        lights: to write.
        path: either file, or a folder, which gets lights.npz and lights.csv.
    """
    archive, table = table_paths(path)
    with atomic_write(archive) as temporary, open(temporary, "wb") as file:
        arrays = {f.name: getattr(lights, f.name) for f in fields(lights)}
        np.savez(file, convention=np.array(CONVENTION), **arrays)
    write_text(table, _text(lights))


def _text(lights: LightSet) -> str:
    k = np.arange(coefficient_count(lights.order))
    l = bands(lights.order)
    names = [f"L{a}{b:+d}_{c}" for a, b in zip(l, k - l * l - l) for c in "RGB"]
    plain = [f.name for f in fields(lights) if f.name != "coefficients"]
    reference = reference_brightness(lights.coefficients)
    writer = csv.writer(text := io.StringIO())
    writer.writerow([*plain, "reference", "convention", *names])
    for i in range(len(lights)):
        columns = [getattr(lights, name)[i] for name in plain]
        numbers = [f"{value:.7g}" for value in lights.coefficients[i].ravel()]
        writer.writerow([*columns, f"{reference[i]:.4f}", CONVENTION, *numbers])
    return text.getvalue()


def read_light_set(path: Path | str) -> LightSet:
    """Reads the .npz of a light set.

    Args:
        path: the .npz, the .csv beside it, or a folder that holds lights.npz.

    Raises:
        UserError: if there is no such file, if it is not a light set, or of another convention, or if a .csv that is
            named has been changed.
    """
    archive, text = table_paths(path)
    stored = read_npz(archive, "light set")
    names = [f.name for f in fields(LightSet)]
    if missing := {"convention", *names} - set(stored):
        raise UserError(f"{archive} is not a light set of relight (it lacks {', '.join(sorted(missing))})")
    if (convention := str(stored["convention"])) != CONVENTION:
        raise UserError(f"{archive}: its convention is {convention!r}; that of a light set is {CONVENTION!r}")
    lights = LightSet(**{name: stored[name] for name in names})
    table = lights.coefficients
    has_shape = table.ndim == 3 and table.shape[2] == 3 and table.dtype.kind == "f"
    if not (has_shape and (np.abs(table) <= MAX_COEFFICIENT).all()):
        raise UserError(f"{archive} is not a light set of relight: coefficients must be finite, of shape (N, K, 3)")
    if any(getattr(lights, name).shape != (len(lights),) for name in names if name != "coefficients"):
        raise UserError(f"{archive} is not a light set of relight (its columns differ in length)")
    order_of(table.shape[1])  # raises where K is no number of coefficients
    if text == Path(path) and existing_file(text, "light set").read_bytes() != _text(lights).encode():
        raise UserError(f"{text} has been changed, but {archive}, whose text it was, is read: name that")
    return lights
