"""The files of the benchmark: what methods read and what they answer, both checked (docs/benchmark.md)."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from PIL import Image

from relight.benchmark.measures import Intrinsics
from relight.benchmark.shots import Shot
from relight.files import UserError, atomic_write, existing_file
from relight.photos.crop import MASK_THRESHOLD, Crop, crop_around

INDEX = "index.json"
PICTURES = ("ratio", "full")  # relit pictures: made from the photograph's own pixels, and drawn from maps alone
MAPS = {"albedo": 3, "shading": 3, "transport": 9}  # channels, on the square
KEYS = (*PICTURES, *MAPS, "light")


@dataclass(frozen=True)
class Entry:
    """A picture of a set, or a variant of one: its folder, and what index.json says about it.

    of: the picture that it is a variant of, None for the pictures themselves; photo: the SHA-256 of photo.png.
    """

    folder: Path
    name: str
    figure: str
    of: str | None
    photo: str
    size: tuple[int, int]
    side: int
    square: tuple[float, float, float]
    new: int

    @property
    def variant(self) -> str:
        """Name of what was changed in it, such as `mirror`; "" for the photograph itself."""
        return self.name.partition("+")[2]

    def shot(self) -> Shot:
        """The photograph with its mask and square. UserError when a file is missing or broken."""
        photo, mask = (picture(self.folder / f"{name}.png") for name in ("photo", "mask"))
        return Shot(photo, mask, square_of(mask, self.square, self.side))

    def panoramas(self) -> list[Path]:
        """The new lights."""
        return [self.folder / f"new_{number}.exr" for number in range(self.new)]


def square_of(mask: np.ndarray, square: tuple[float, float, float], side: int) -> Crop:
    """The square with this (top, left, side) in the photograph of a mask, to be sampled with `side` pixels."""
    top, left, length = square
    return replace(crop_around(mask, side), top=top, left=left, side=length)


def picture(path: Path) -> np.ndarray:
    """The pixels of a file of the set. UserError where it is missing or damaged."""
    try:
        return np.asarray(Image.open(existing_file(path, "benchmark")))
    except OSError:
        raise UserError(f"{path} is no whole picture: make the benchmark again") from None


class Set:
    """A set of pictures in a folder."""

    def __init__(self, folder: Path | str):
        """UserError where `relight benchmark make` has not finished a set."""
        self.folder = Path(folder)
        try:
            self.index = json.loads((self.folder / INDEX).read_text())
        except (OSError, ValueError):
            raise UserError(
                f"{folder}: there is no finished benchmark there (relight benchmark make --out {folder})"
            ) from None
        self.hash: str = self.index["sha256"]
        self.scaled: bool = self.index.get("scale") != "unknown"  # whether it is known how bright albedo is

    @cached_property
    def entries(self) -> list[Entry]:
        """The photographs of the set and their variants, in its order."""
        inputs = self.folder / "inputs"
        return [
            Entry(
                inputs / one["name"],
                one["name"],
                one["figure"],
                one["of"],
                one["files"][f"inputs/{one['name']}/photo.png"],
                tuple(one["size"]),
                self.index["settings"]["size"] // 2,
                tuple(one["square"]),
                one["new"],
            )
            for one in self.index["pictures"]
        ]

    def verify(self) -> None:
        """UserError unless every file is there, and is what it was when the set was made."""
        for one in self.index["pictures"]:
            for name, expected in one["files"].items():
                path = self.folder / name
                if sha256(existing_file(path, "benchmark")) != expected:
                    raise UserError(f"{path} has changed since the benchmark was made: make it again")

    def truth(self, entry: Entry) -> tuple[Intrinsics, np.ndarray]:
        """The truth on the square, and the true pictures (N,H,W,3) uint8 in the new lights."""
        arrays = arrays_of(self.folder / "truth" / f"{entry.name}.npz")
        return intrinsics_of(arrays, inside_of(entry)), arrays["full"]

    def maps(self, entry: Entry) -> Path:
        """The true maps at the photograph's pixels (docs/maps.md). UserError for a set without."""
        path = self.folder / "truth" / f"{entry.name}.exr"
        if not path.is_file():
            raise UserError(f"{self.folder} has no true maps: answer it by --method network or as_it_is")
        return path


def inside_of(entry: Entry) -> np.ndarray:
    """The figure (S,S) bool on the square of a picture."""
    shot = entry.shot()
    return shot.square.extract(shot.mask) >= MASK_THRESHOLD


def intrinsics_of(arrays: Mapping[str, np.ndarray], inside: np.ndarray) -> Intrinsics:
    """An answer or a truth as float64; `inside` (S,S) is the figure."""
    return Intrinsics(inside, **{name: arrays[name].astype(np.float64) for name in (*MAPS, "light") if name in arrays})


def sha256(path: Path) -> str:
    """The SHA-256 of a file, in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write_arrays(path: Path, photo: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Writes an answer, or a truth, whole or not at all: half floats but for pictures and light."""
    kinds = {name: np.float16 for name in MAPS} | dict.fromkeys(PICTURES, np.uint8) | {"light": np.float32}
    with atomic_write(path) as tmp, open(tmp, "wb") as file:
        typed = {name: np.asarray(values).astype(kinds[name]) for name, values in arrays.items()}
        np.savez_compressed(file, photo=np.array(photo), **typed)  # type: ignore[arg-type]  # none is allow_pickle


def arrays_of(path: Path) -> dict[str, np.ndarray]:
    """What an .npz holds. UserError on another file."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored}
    except FileNotFoundError:
        raise UserError(f"there is no {path}: a folder of answers has one .npz for each picture") from None
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise UserError(f"{path} is not an .npz of arrays ({error})") from None


def read_answer(folder: Path, entry: Entry) -> dict[str, np.ndarray]:
    """Reads and checks a method's answer to a picture.

    Raises UserError when it is missing, belongs to another picture, has arrays of another name or size, or none.
    """
    path = Path(folder) / f"{entry.name}.npz"
    arrays = arrays_of(path)
    if str(arrays.pop("photo", "")) != entry.photo:
        raise UserError(
            f"{path} answers another picture: its `photo` must be the SHA-256 of {entry.folder / 'photo.png'}"
        )
    shapes: dict[str, tuple[int, ...]] = {name: (entry.new, *entry.size, 3) for name in PICTURES if entry.new}
    shapes |= {name: (entry.side, entry.side, channels) for name, channels in MAPS.items()} | {"light": (9, 3)}
    if not entry.new:  # relit pictures of variants are not asked for
        arrays = {name: values for name, values in arrays.items() if name not in PICTURES}
    if not arrays:
        raise UserError(f"{path} answers nothing: give one at least of {', '.join(shapes)}")
    for name, values in arrays.items():
        if name not in shapes:
            raise UserError(f"{path} holds {name}: it may hold photo, {', '.join(shapes)}")
        if values.shape != shapes[name]:
            raise UserError(f"{path}: {name} has the shape {values.shape}, and {shapes[name]} is asked for")
        if name in PICTURES and values.dtype != np.uint8:
            raise UserError(f"{path}: {name} is {values.dtype}; pictures are uint8, sRGB")
        if values.dtype.kind not in "uif" or not np.isfinite(values).all():
            raise UserError(f"{path}: {name} has values that are no finite numbers")
    return arrays
