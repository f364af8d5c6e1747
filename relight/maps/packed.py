"""Packed maps, the data set for training: the foreground pixels of all maps in one memory-mapped safetensors file.

A foreground pixel takes 27 bytes, a pixel of the image one bit; 345 figures at 1024 px take 1.45 GB. For F maps with P
foreground pixels in all, the tensors are

mask       (F, ceil(size^2 / 8)) uint8, bits in raster order
offset     (F+1,) int64; the pixels of map i are offset[i] to offset[i+1]
transport  (P,K) float16
albedo     (P,3) uint8 sRGB codes
normal     (P,2) int16, octahedral (Cigolle et al. 2014): a unit vector to 7e-5 in 4 bytes
gloss      (P,2) uint8, roughness and specular times 255; not there where all surfaces are matt

Ambient occlusion is not stored; it is T_00 / .8862.
"""

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import safe_open

from relight.files import UserError, atomic_write, existing_file
from relight.progress import progress
from relight.sh import UNOCCLUDED_T00
from relight.srgb import LINEAR, encode, to_bytes

TYPES = {"uint8": "U8", "int16": "I16", "int64": "I64", "float16": "F16"}


def pack_maps(exr_paths: list[Path], out: Path) -> list[str]:
    """Packs maps into one file, whole or not at all, with one of them in memory at a time.

    Figures that were left out are skipped. With bounces, the packed transport is the direct one plus the mean over the
    colour channels of the bounced one.

    Args:
        exr_paths: files of maps.
        out: the packed file (.safetensors).

    Returns:
        The names of the packed maps: of the figure, or of a further view or outfit of it.

    Raises:
        UserError: if sizes or orders differ, or all figures were left out.
    """
    from relight.maps.exr import read_info, read_maps

    found = [(path, info) for path in exr_paths if "left_out" not in (info := read_info(path))]
    if not found:
        raise UserError(f"there is nothing to pack in {out}: all {len(exr_paths)} figures were left out")
    for key in ("size", "order"):
        values = sorted({info[key] for _, info in found})
        if len(values) > 1:
            raise UserError(f"maps of one data set must have one {key}: these have {', '.join(map(str, values))}")
    first = found[0][1]
    size, coefficients = first["size"], (first["order"] + 1) ** 2
    offset = np.concatenate([[0], np.cumsum([info["pixels"] for _, info in found])]).astype(np.int64)
    names = [info.get("name", Path(path).stem) for path, info in found]
    subjects = [info.get("subject", name) for name, (_, info) in zip(names, found)]
    pixels = int(offset[-1])
    layout: dict[str, tuple[type, tuple[int, ...]]] = {
        "offset": (np.int64, offset.shape),
        "transport": (np.float16, (pixels, coefficients)),
        "albedo": (np.uint8, (pixels, 3)),
        "normal": (np.int16, (pixels, 2)),
        "mask": (np.uint8, (len(found), -(-size * size // 8))),
    }
    if any(info.get("gloss") for _, info in found):
        layout["gloss"] = (np.uint8, (pixels, 2))
    notes = {"names": names, "subjects": subjects, "size": size, "order": first["order"]}
    if any("figure" in info for _, info in found):
        notes["figures"] = [info.get("figure", name) for name, (_, info) in zip(names, found)]
        notes["views"] = [info.get("view") for _, info in found]
    with atomic_write(out) as temporary:
        arrays = _create(temporary, layout, {key: json.dumps(value) for key, value in notes.items()})
        arrays["offset"][:] = offset
        for i, (path, _) in enumerate(progress(found, "packing")):
            maps = read_maps(path)
            part, inside = slice(offset[i], offset[i + 1]), maps.mask
            arrays["mask"][i] = np.packbits(inside)
            transport = maps.transport[inside]
            arrays["transport"][part] = transport if maps.bounced is None else transport + maps.bounced[inside].mean(-1)
            arrays["albedo"][part] = to_bytes(encode(maps.albedo[inside]))
            arrays["normal"][part] = encode_normals(maps.normal[inside])
            if "gloss" in arrays:
                arrays["gloss"][part] = (255, 0) if maps.gloss is None else np.round(255 * maps.gloss[inside])
        for array in arrays.values():
            array.flush()
    return names


class PackedMaps:
    """Packed maps, memory-mapped: the pixels of a map are read from disk when they are used.

    Attributes:
        names: of the F maps.
        subjects: of the maps.
        figures: the figure that each map shows, by the name of the map of its frontal view in its own outfit.
        views: how each map is seen (`relight.transport.view.view_record`), None for the frontal view.
        size: of the images in pixels.
        order: of the spherical harmonics.
        glossy: whether they hold gloss.
        offset: (F+1,) int64, where the pixels of each map begin.
    """

    def __init__(self, path: Path | str):
        """Opens packed maps.

        Raises:
            UserError: if the file does not exist or holds no packed maps.
        """
        try:
            self._file = safe_open(str(existing_file(path, "packed maps")), framework="np")
            notes = {key: json.loads(value) for key, value in (self._file.metadata() or {}).items()}
            self.names: list[str] = notes["names"]
            self.subjects: list[str] = notes["subjects"]
            self.figures: list[str] = notes.get("figures", self.names)
            self.views: list[dict[str, Any] | None] = notes.get("views", [None] * len(self.names))
            self.size: int = notes["size"]
            self.order: int = notes["order"]
            self.glossy: bool = "gloss" in self._file.keys()
            self.offset: np.ndarray = self._file.get_tensor("offset")
            self._check()
        except UserError:
            raise
        except Exception as error:  # safetensors has an exception type of its own beside KeyError and ValueError
            raise UserError(f"{path} is not a packed data set of relight ({error})") from None

    def _check(self) -> None:
        """Raises ValueError where header and arrays contradict, before anything is made of the sizes they name."""
        maps, pixels = len(self.names), int(self.offset[-1])
        coefficients, bits = (self.order + 1) ** 2, -(-self.size * self.size // 8)
        wanted = {"transport": [pixels, coefficients], "albedo": [pixels, 3], "normal": [pixels, 2]}
        wanted |= {"offset": [maps + 1], "mask": [maps, bits]} | ({"gloss": [pixels, 2]} if self.glossy else {})
        for name, shape in wanted.items():
            found = self._file.get_slice(name).get_shape()
            if found != shape:
                raise ValueError(f"{name} has the shape {found}, not {shape}")
        if self.offset[0] or (np.diff(self.offset) < 0).any():
            raise ValueError("its offsets do not ascend from 0")
        if not len(self.subjects) == len(self.figures) == len(self.views) == maps:
            raise ValueError("its lists of names, subjects, figures and views differ in length")

    def __len__(self) -> int:
        return len(self.names)

    def figure(self, index: int) -> dict[str, np.ndarray]:
        """Reads the foreground pixels of one map.

        Args:
            index: of the map, from 0.

        Returns:
            `pixel` (P,) int32, flat indices in raster order; `transport` (P,K), `albedo` (P,3) linear, `normal` (P,3)
            unit vectors, `ao` (P,) and, if they are `glossy`, `gloss` (P,2), roughness and specular; all float16.

        Raises:
            IndexError: if there is no such map.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"figure {index} of {len(self)}")
        return self._read(index, index + 1)

    def arrays(self) -> dict[str, np.ndarray]:
        """Reads the foreground pixels of all maps, one map after another, and `offset` (F+1,) int64."""
        return {"offset": self.offset, **self._read(0, len(self))}

    def _read(self, begin: int, end: int) -> dict[str, np.ndarray]:
        part = slice(int(self.offset[begin]), int(self.offset[end]))
        names = ("transport", "albedo", "normal", *(("gloss",) if self.glossy else ()))
        stored = {name: self._file.get_slice(name)[part] for name in names}
        bits = np.unpackbits(self._file.get_slice("mask")[begin:end], axis=1, count=self.size**2)
        gloss = {"gloss": (stored["gloss"] / np.float32(255)).astype(np.float16)} if self.glossy else {}
        return {
            "pixel": np.concatenate([np.flatnonzero(row) for row in bits]).astype(np.int32),
            "transport": stored["transport"],
            "albedo": LINEAR.astype(np.float16)[stored["albedo"]],
            "normal": decode_normals(stored["normal"]).astype(np.float16),
            "ao": (stored["transport"][:, 0].astype(np.float32) / np.float32(UNOCCLUDED_T00))
            .clip(0, 1)
            .astype(np.float16),
            **gloss,
        }


def encode_normals(normals: np.ndarray) -> np.ndarray:
    """Encodes unit vectors (P,3) as points (P,2) int16 of the octahedron unfolded to a square.

    >>> encode_normals(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])).tolist()
    [[0, 0], [32767, 0]]
    """
    flat = normals / np.abs(normals).sum(1, keepdims=True)
    square = np.where(flat[:, 2:] < 0, _fold(flat[:, :2]), flat[:, :2])
    return np.round(square * 32767).astype(np.int16)


def decode_normals(encoded: np.ndarray) -> np.ndarray:
    """Decodes points (P,2) int16 of `encode_normals` to unit vectors (P,3) float32."""
    square = encoded.astype(np.float32) / np.float32(32767)
    z = 1 - np.abs(square[:, 0]) - np.abs(square[:, 1])
    behind = z < 0
    square[behind] = _fold(square[behind])
    normals = np.concatenate([square, z[:, None]], 1)
    return normals / np.sqrt(np.einsum("nc,nc->n", normals, normals))[:, None]


def _fold(square: np.ndarray) -> np.ndarray:
    """Reflects points of the square about the nearest edge of the diamond that divides z > 0 inside from z < 0."""
    return (1 - np.abs(square[:, ::-1])) * np.where(square < 0, np.float32(-1), np.float32(1))


def _create(path: Path, layout: dict[str, tuple[type, tuple[int, ...]]], notes: dict[str, str]) -> dict[str, np.memmap]:
    """Creates a safetensors file and maps its arrays for writing.

    The library's own writer needs all arrays in memory. The format is a length, a JSON header and the raw arrays.

    Args:
        path: of the file.
        layout: type and shape of each array, by name.
        notes: metadata of the header.
    """
    header: dict[str, Any] = {"__metadata__": notes}
    end = 0
    for name, (kind, shape) in layout.items():
        begin, end = end, end + math.prod(shape) * np.dtype(kind).itemsize
        header[name] = {"dtype": TYPES[np.dtype(kind).name], "shape": shape, "data_offsets": [begin, end]}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)  # tensors start on a multiple of 8 bytes
    base = 8 + len(text)
    with open(path, "wb") as file:
        file.write(len(text).to_bytes(8, "little") + text)
        if hasattr(os, "posix_fallocate"):  # a full disk is told here; a write to a hole of a mapped file would kill us
            os.posix_fallocate(file.fileno(), 0, base + end)
        else:
            file.truncate(base + end)
    return {
        name: np.memmap(path, kind, "r+", base + header[name]["data_offsets"][0], shape)
        for name, (kind, shape) in layout.items()
    }
