"""Reads and writes the files of the benchmark: sets of pictures, and methods' answers (docs/benchmark.md)."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from relight.benchmark.measures import Intrinsics
from relight.benchmark.shots import Shot
from relight.core.errors import UserError
from relight.core.files import atomic_write, existing_file, file_hash, read_record, write_json
from relight.core.npz import read_npz
from relight.maps.square import MASK_THRESHOLD, crop_around
from relight.sh.conventions import MAX_COEFFICIENT

INDEX = "index.json"
PICTURES = ("ratio", "full")  # relit pictures: the photograph times a gain, and rendered from maps alone
MAPS = {"albedo": 3, "shading": 3, "transport": 9}  # number of channels, on the square
Answer = dict[str, np.ndarray]  # arrays of PICTURES, MAPS and `light`


class Entry:
    """A picture of a set, or a variant of one, from index.json.

    Attributes:
        folder: folder of its inputs.
        name: name of the picture, or picture+variant.
        figure: the name of the person.
        of: the picture that this is a variant of; None for a picture itself.
        photo: SHA-256 of photo.png.
        size: (height, width) of the photograph.
        side: pixels of the square.
        square: (top, left, side) of the square in the photograph, pixels.
        new: number of new lights.
    """

    def __init__(self, inputs: Path, side: int, record: dict[str, Any]):
        """Takes the folder of all inputs, the pixels of a square, and the picture's record in the index."""
        self.name: str = record["name"]
        self.figure: str = record["figure"]
        self.of: str | None = record["of"]
        self.photo: str = record["files"][f"inputs/{self.name}/photo.png"]
        self.size, self.square = tuple(record["size"]), tuple(record["square"])
        self.new: int = record["new"]
        self.folder, self.side = inputs / self.name, side

    @property
    def variant(self) -> str:
        """The part of the name after "+", such as "mirror"; "" for the picture itself."""
        return self.name.partition("+")[2]

    def shot(self) -> Shot:
        """Reads the photograph with its mask and square. Raises UserError if a file is missing or broken."""
        photo, mask = (_read_picture(self.folder / f"{name}.png") for name in ("photo", "mask"))
        top, left, length = self.square
        return Shot(photo, mask, replace(crop_around(mask, self.side), top=top, left=left, side=length))

    def panoramas(self) -> list[Path]:
        """Returns the files of the new lights."""
        return [self.folder / f"new_{number}.exr" for number in range(self.new)]


def _read_picture(path: Path) -> np.ndarray:
    """Reads the pixels of a picture file. Raises UserError if it is missing or damaged."""
    try:
        return np.asarray(Image.open(existing_file(path, "benchmark")))
    except OSError:
        raise UserError(f"{path} is damaged: make the benchmark again") from None


class BenchmarkSet:
    """A set of pictures in a folder.

    Attributes:
        folder: folder of the benchmark's set.
        index: content of index.json.
        hash: SHA-256 of the set.
    """

    def __init__(self, folder: Path | str):
        """Opens a set. Raises UserError if `relight benchmark make` has not finished it."""
        self.folder = Path(folder)
        self.index = read_record(self.folder / INDEX)
        if not {"settings", "sha256", "pictures"} <= set(self.index):
            raise UserError(f"{folder}: there is no finished benchmark there (relight benchmark make --out {folder})")
        self.hash: str = self.index["sha256"]

    @cached_property
    def entries(self) -> list[Entry]:
        """The pictures of the set and their variants, in the order of the index."""
        side = self.index["settings"]["size"] // 2  # as of `picture.Settings.side`
        return [Entry(self.folder / "inputs", side, record) for record in self.index["pictures"]]

    def verify(self) -> None:
        """Raises UserError if a file is missing or has changed since the set was made."""
        for picture in self.index["pictures"]:
            for name, expected in picture["files"].items():
                path = self.folder / name
                if file_hash(existing_file(path, "benchmark")) != expected:
                    raise UserError(f"{path} has changed since the benchmark was made: make it again")

    def truth(self, entry: Entry) -> tuple[Intrinsics, np.ndarray]:
        """Reads the ground truth on the square, and the true pictures (N,H,W,3) uint8 in the new lights."""
        arrays = read_npz(self.folder / "truth" / f"{entry.name}.npz", "benchmark file")
        return to_intrinsics(arrays, square_mask(entry)), arrays["full"]

    def light(self, entry: Entry) -> Path:
        """Returns the panorama of the light of a picture. Raises UserError if it is missing."""
        return existing_file(self.folder / "truth" / f"{entry.name}.light.exr", "true light")

    def maps(self, entry: Entry) -> Path:
        """Returns the file of the true maps at the photograph's pixels. Raises UserError if it is missing."""
        return existing_file(self.folder / "truth" / f"{entry.name}.exr", "true maps")


def keep_record(path: Path, record: dict[str, Any], problem: str) -> None:
    """Writes what makes the files of a folder, or raises UserError about a `problem` if something else made them."""
    if not path.is_file():
        write_json(path, record)
    elif read_record(path) != record:
        raise UserError(problem)


def square_mask(entry: Entry) -> np.ndarray:
    """Reads the mask (S,S) bool of the figure on the square of a picture."""
    shot = entry.shot()
    return shot.square.extract(shot.mask) >= MASK_THRESHOLD


def to_intrinsics(arrays: Mapping[str, np.ndarray], inside: np.ndarray) -> Intrinsics:
    """Returns the maps and the light of an answer or of a ground truth as float64; `inside` (S,S) is the mask."""
    return Intrinsics(inside, **{name: arrays[name].astype(np.float64) for name in (*MAPS, "light") if name in arrays})


def write_arrays(path: Path, photo: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Writes arrays of PICTURES, MAPS and `light`, atomically: maps as float16, pictures as uint8, light as float32.

    `photo` is the SHA-256 of photo.png.
    """
    dtypes = {name: np.float16 for name in MAPS} | dict.fromkeys(PICTURES, np.uint8) | {"light": np.float32}
    with atomic_write(path) as tmp, open(tmp, "wb") as file:
        typed = {name: np.asarray(values).astype(dtypes[name]) for name, values in arrays.items()}
        np.savez_compressed(file, photo=np.array(photo), **typed)  # type: ignore[arg-type]  # none is allow_pickle


def read_answer(folder: Path, entry: Entry) -> Answer:
    """Reads a method's answer to a picture from a folder: the arrays by name, without `photo`.

    Raises:
        UserError: if it is missing, is for another picture, or its arrays have wrong names, shapes or types.
    """
    path = Path(folder) / f"{entry.name}.npz"
    if not path.is_file():
        raise UserError(f"there is no {path}: a folder of answers must have one .npz for each picture")
    arrays = read_npz(path, "benchmark file")
    if str(arrays.pop("photo", "")) != entry.photo:
        raise UserError(
            f"{path} answers another picture: its `photo` must be the SHA-256 of {entry.folder / 'photo.png'}"
        )
    shapes: dict[str, tuple[int, ...]] = {name: (entry.new, *entry.size, 3) for name in PICTURES if entry.new}
    shapes |= {name: (entry.side, entry.side, channels) for name, channels in MAPS.items()} | {"light": (9, 3)}
    if not entry.new:  # relit pictures of variants are not asked for
        arrays = {name: values for name, values in arrays.items() if name not in PICTURES}
    if not arrays:
        raise UserError(f"{path} is empty: it must hold at least one of {', '.join(shapes)}")
    for name, values in arrays.items():
        if name not in shapes:
            raise UserError(f"{path} holds {name}: it may hold photo, {', '.join(shapes)}")
        if values.shape != shapes[name]:
            raise UserError(f"{path}: {name} has the shape {values.shape}, but must have {shapes[name]}")
        if values.dtype != np.uint8 if name in PICTURES else values.dtype.kind != "f":
            kind = "uint8 (sRGB)" if name in PICTURES else "float (linear)"
            raise UserError(f"{path}: {name} is {values.dtype}, but must be {kind}")
        if not float(np.abs(values).max()) <= MAX_COEFFICIENT:
            raise UserError(f"{path}: {name} has values that are not finite numbers, or beyond {MAX_COEFFICIENT:.0e}")
    return arrays
