"""The light set: one table of lights, as lights.npz for programs and lights.csv for people."""

import csv
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from relight.files import UserError, whole
from relight.lights.statistics import reference_brightness
from relight.npz import read_npz
from relight.sh.basis import bands, count, order_of

CONVENTION = "relight"  # radiance, orthonormal, no Condon-Shortley, l*l+l+m, +z toward the camera, linear Rec. 709 RGB
SPLITS = ("train", "test", "unusual", "rich")


@dataclass(frozen=True)
class LightSet:
    """N lights, every field an array with a row per light.

    coefficients  (N, K, 3) float32, radiance
    split         "train", "test"; of what the rules removed "unusual" (for its own test) or "rich" (to train on)
    source        the panorama: "room:12", "sky:3", or a file's path inside its folder
    yaw           degrees by which the panorama's light was turned, +z toward +x
    seed          of the draw of the light's brightness
    scale         factor from the panorama's units
    cluster       number of the k-means cluster that the light stands for
    reason        the rules that an unusual light breaks, separated by spaces; empty otherwise
    """

    coefficients: np.ndarray
    split: np.ndarray
    source: np.ndarray
    yaw: np.ndarray
    seed: np.ndarray
    scale: np.ndarray
    cluster: np.ndarray
    reason: np.ndarray

    def __len__(self) -> int:
        return len(self.coefficients)

    @property
    def order(self) -> int:
        return order_of(self.coefficients.shape[1])

    def rows(self, which: np.ndarray) -> "LightSet":
        """The lights that `which` (a mask or indices) selects."""
        return replace(self, **{f.name: getattr(self, f.name)[which] for f in fields(self)})

    def of(self, split: str) -> "LightSet":
        """The lights of one split."""
        return self.rows(self.split == split)


def table_paths(path: Path | str) -> tuple[Path, Path]:
    """The .npz and the .csv of a set that is named by its folder or by either file."""
    path = Path(path)
    if path.suffix not in (".npz", ".csv"):
        path = path / "lights.npz"
    return path.with_suffix(".npz"), path.with_suffix(".csv")


def save(lights: LightSet, path: Path | str) -> None:
    """Writes lights.npz and lights.csv into the folder `path`, or beside each other when `path` names one of them."""
    packed, table = table_paths(path)
    with whole(packed) as temporary, open(temporary, "wb") as file:
        arrays = {f.name: getattr(lights, f.name) for f in fields(lights)}
        np.savez(file, convention=np.array(CONVENTION), **arrays)
    k = np.arange(count(lights.order))
    l = bands(lights.order)
    names = [f"L{a}{b:+d}_{c}" for a, b in zip(l, k - l * l - l) for c in "RGB"]
    plain = [f.name for f in fields(lights) if f.name != "coefficients"]
    reference = reference_brightness(lights.coefficients)
    with whole(table) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*plain, "reference", "convention", *names])
        for i in range(len(lights)):
            own = [getattr(lights, name)[i] for name in plain]
            numbers = [f"{value:.7g}" for value in lights.coefficients[i].ravel()]
            writer.writerow([*own, f"{reference[i]:.4f}", CONVENTION, *numbers])


def load(path: Path | str) -> LightSet:
    """Reads lights.npz, named by itself, by its folder or by the .csv beside it."""
    packed, _ = table_paths(path)
    stored = read_npz(packed, "light set")
    names = [f.name for f in fields(LightSet)]
    if missing := {"convention", *names} - set(stored):
        raise UserError(f"{packed} is not a light set of relight (it lacks {', '.join(sorted(missing))})")
    if str(stored["convention"]) != CONVENTION:
        said = str(stored["convention"])
        raise UserError(f"{packed}: its convention is {said!r}, a light set of relight says {CONVENTION!r}")
    lights = LightSet(**{name: stored[name] for name in names})
    table = lights.coefficients
    if table.ndim != 3 or table.shape[2] != 3 or table.dtype.kind != "f" or not np.isfinite(table).all():
        raise UserError(f"{packed} is not a light set of relight (its coefficients are no finite numbers (N, K, 3))")
    if any(getattr(lights, name).shape != (len(lights),) for name in names if name != "coefficients"):
        raise UserError(f"{packed} is not a light set of relight (its columns differ in length)")
    lights.order  # noqa: B018  (raises where K is no number of coefficients)
    return lights
