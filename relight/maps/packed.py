"""Packed maps, the data set for training: the foreground pixels of all maps in one memory-mapped safetensors file.

A foreground pixel takes 27 bytes, an image pixel one bit; 345 figures at 1024 px take 1.45 GB. For F maps with P
foreground pixels in total, the tensors are

mask       (F, ceil(size^2 / 8)) uint8, bits in raster order
offset     (F+1,) int64; the pixels of map i are offset[i] to offset[i+1]
transport  (P,K) float16
albedo     (P,3) uint8 sRGB codes
normal     (P,2) int16, octahedral (Cigolle et al. 2014): a unit vector to 7e-5 in 4 bytes
gloss      (P,2) uint8, roughness and specular times 255; absent if all surfaces are matt
ao         (P,) float16, ambient occlusion; absent without bounces, where it is T_00 / .8862
"""

import json
import math
import os
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import safe_open

from relight.core.errors import UserError
from relight.core.files import atomic_write, existing_file, write_json
from relight.core.progress import progress
from relight.core.srgb import LINEAR, encode, to_bytes
from relight.maps.octahedral import fold, octahedral
from relight.sh import UNOCCLUDED_T00, coefficient_count

Tensors = dict[str, tuple[type, tuple[int, ...]]]  # type and shape of arrays by name
DTYPE_NAMES = {"uint8": "U8", "int16": "I16", "int64": "I64", "float16": "F16"}


def pack_maps(exr_paths: list[Path], out: Path) -> list[str]:
    """Packs maps into one file, whole or not at all; only one of them is in memory at a time.

    Left-out figures are skipped. With bounces, the packed transport is the direct transport plus the mean of the
    bounced transport over the color channels.

    Args:
        exr_paths: files of maps.
        out: the packed file (.safetensors).

    Returns:
        The names of the packed maps: of a figure, or of a further view or outfit of it.

    Raises:
        UserError: if sizes or orders differ, or all figures were left out.
    """
    from relight.maps.exr import read_info, read_maps

    included = [(path, info) for path in exr_paths if "left_out" not in (info := read_info(path))]
    if not included:
        raise UserError(f"{out} has nothing to pack: all {len(exr_paths)} figures were left out")
    for key in ("size", "order"):
        values = sorted({info[key] for _, info in included})
        if len(values) > 1:
            raise UserError(f"maps of one data set must have one {key}: these have {', '.join(map(str, values))}")
    first = included[0][1]
    size, order = first["size"], first["order"]
    offset = np.concatenate([[0], np.cumsum([info["pixels"] for _, info in included])]).astype(np.int64)
    names = [info.get("name", Path(path).stem) for path, info in included]
    subjects = [info.get("subject", name) for name, (_, info) in zip(names, included)]
    reasons = {"gloss": "gloss", "ao": "bounces"}  # in the record of a map, for arrays that not all sets have
    optional = [name for name, key in reasons.items() if any(info.get(key) for _, info in included)]
    tensors = _tensors(len(included), int(offset[-1]), size, order, optional)
    metadata = {"names": names, "subjects": subjects, "size": size, "order": order}
    if any("figure" in info for _, info in included):
        metadata["figures"] = [info.get("figure", name) for name, (_, info) in zip(names, included)]
        metadata["views"] = [info.get("view") for _, info in included]
    with atomic_write(out) as temporary:
        arrays = _create_safetensors(temporary, tensors, {key: json.dumps(value) for key, value in metadata.items()})
        arrays["offset"][:] = offset
        for i, (path, _) in enumerate(progress(included, "packing")):
            maps = read_maps(path)
            part, mask = slice(offset[i], offset[i + 1]), maps.mask
            if mask.shape != (size, size):
                height, width = mask.shape
                raise UserError(f"{path} is {width} x {height} pixels: the maps of a data set are square")
            arrays["mask"][i] = np.packbits(mask)
            transport = maps.transport[mask]
            arrays["transport"][part] = transport if maps.bounced is None else transport + maps.bounced[mask].mean(-1)
            arrays["albedo"][part] = to_bytes(encode(maps.albedo[mask]))
            arrays["normal"][part] = encode_normals(maps.normal[mask])
            if "gloss" in arrays:
                arrays["gloss"][part] = (255, 0) if maps.gloss is None else np.round(255 * maps.gloss[mask])
            if "ao" in arrays:
                arrays["ao"][part] = maps.ao[mask]
        for array in arrays.values():
            array.flush()
    return names


def pack_figures(maps: Sequence[Path], least: float, out: Path, record: Path) -> None:
    """Writes the maps of all figures as one packed set, and the record of what was left out (.json).

    Args:
        maps: of all figures, outfits and views (.exr).
        least: least share of usable figures.
        out: the packed set (.safetensors).
        record: `figures`, the record of each figure, and `left_out`, the reasons by name.

    Raises:
        UserError: if too few figures are usable.
    """
    from relight.maps.exr import read_info

    infos = {path.stem: read_info(path) for path in maps}
    # Further views and outfits, which have another name than their figure, do not count as figures.
    figures = {name: info for name, info in infos.items() if info.get("figure", name) == name}
    reasons = {name: info["left_out"] for name, info in figures.items() if "left_out" in info}
    usable = len(figures) - len(reasons)
    needed = max(2, math.ceil(least * len(figures)))  # one to train on and one to test on, at least
    if usable < needed:
        first = "".join(f"; {name}: {reason}" for name, reason in list(reasons.items())[:3])
        raise UserError(f"only {usable} of {len(figures)} are usable: split.least={least} needs {needed}{first}")
    for name, reason in reasons.items():
        print(f"left out: {name}: {reason}", file=sys.stderr)
    pack_maps(list(maps), out)
    write_json(record, {"figures": figures, "left_out": reasons})


class PackedMaps:
    """Packed maps, memory-mapped: the pixels of a map are read from disk when they are used.

    Attributes:
        names: names of the F maps.
        subjects: subjects of the maps.
        figures: the figure of each map, by the name of the maps of its frontal view in its own outfit.
        views: the view of each map (`relight.transport.view.view_record`), None for the frontal view.
        size: side of the square images, pixels.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.
        glossy: whether there is gloss.
        offset: (F+1,) int64, where the pixels of each map begin.
    """

    def __init__(self, path: Path | str):
        """Opens packed maps.

        Raises:
            UserError: if the file does not exist or is not a file of packed maps.
        """
        try:
            self._file = safe_open(str(existing_file(path, "packed maps")), framework="np")
            metadata = {key: json.loads(value) for key, value in (self._file.metadata() or {}).items()}
            self.names: list[str] = metadata["names"]
            self.subjects: list[str] = metadata["subjects"]
            self.figures: list[str] = metadata.get("figures", self.names)
            self.views: list[dict[str, Any] | None] = metadata.get("views", [None] * len(self.names))
            self.size: int = metadata["size"]
            self.order: int = metadata["order"]
            self.glossy: bool = "gloss" in self._file.keys()
            self._has_ao = "ao" in self._file.keys()
            self.offset: np.ndarray = self._file.get_tensor("offset")
            self._check()
        except UserError:
            raise
        except Exception as error:  # KeyError, ValueError and safetensors' own type
            raise UserError(f"{path} is not a packed data set of relight ({error})") from None

    def _check(self) -> None:
        """Raises ValueError if header and arrays contradict each other; runs before arrays are allocated."""
        maps, pixels = len(self.names), int(self.offset[-1])
        for name, (_, expected) in _tensors(maps, pixels, self.size, self.order, self._file.keys()).items():
            if (shape := self._file.get_slice(name).get_shape()) != list(expected):
                raise ValueError(f"{name} has the shape {shape}, not {list(expected)}")
        if self.offset[0] or (np.diff(self.offset) < 0).any():
            raise ValueError("its offsets do not ascend from 0")
        if not len(self.subjects) == len(self.figures) == len(self.views) == maps:
            raise ValueError("its lists of names, subjects, figures and views differ in length")

    def __len__(self) -> int:
        return len(self.names)

    def figure(self, index: int) -> dict[str, np.ndarray]:
        """Reads the foreground pixels of one map.

        Args:
            index: index of the map, from 0.

        Returns:
            `pixel` (P,) int32, flat indices in raster order, and as float16 `transport` (P,K), `albedo` (P,3) linear,
            `normal` (P,3) unit vectors, `ao` (P,) and, if `glossy`, `gloss` (P,2), roughness and specular.

        Raises:
            IndexError: if there is no such map.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"figure {index} of {len(self)}")
        return self._read(index, index + 1)

    def arrays(self) -> dict[str, np.ndarray]:
        """Reads the foreground pixels of all maps.

        Returns:
            The arrays of `figure`, concatenated over the F maps, and `offset` (F+1,) int64: the pixels of map i are
            offset[i] to offset[i+1].
        """
        return {"offset": self.offset, **self._read(0, len(self))}

    def _read(self, begin: int, end: int) -> dict[str, np.ndarray]:
        """Reads and decodes the foreground pixels of maps `begin` to `end`, without the last; arrays as of `figure`."""
        part = slice(int(self.offset[begin]), int(self.offset[end]))
        names = {"transport", "albedo", "normal", "gloss", "ao"}.intersection(self._file.keys())
        stored = {name: self._file.get_slice(name)[part] for name in names}
        bits = np.unpackbits(self._file.get_slice("mask")[begin:end], axis=1, count=self.size**2)
        ao = stored["ao"] if self._has_ao else stored["transport"][:, 0].astype(np.float32) / np.float32(UNOCCLUDED_T00)
        gloss = {"gloss": (stored["gloss"] / np.float32(255)).astype(np.float16)} if self.glossy else {}
        return {
            "pixel": np.concatenate([np.flatnonzero(row) for row in bits]).astype(np.int32),
            "transport": stored["transport"],
            "albedo": LINEAR.astype(np.float16)[stored["albedo"]],
            "normal": decode_normals(stored["normal"]).astype(np.float16),
            "ao": ao.clip(0, 1).astype(np.float16),
            **gloss,
        }


def _tensors(maps: int, pixels: int, size: int, order: int, optional: Collection[str]) -> Tensors:
    """Returns type and shape of each array of the file, in their order; `gloss` and `ao` if they are `optional`."""
    tensors: Tensors = {
        "offset": (np.int64, (maps + 1,)),
        "transport": (np.float16, (pixels, coefficient_count(order))),
        "albedo": (np.uint8, (pixels, 3)),
        "normal": (np.int16, (pixels, 2)),
        "mask": (np.uint8, (maps, math.ceil(size * size / 8))),  # a bit per pixel
    }
    further: Tensors = {"gloss": (np.uint8, (pixels, 2)), "ao": (np.float16, (pixels,))}
    return tensors | {name: value for name, value in further.items() if name in optional}


def encode_normals(normals: np.ndarray) -> np.ndarray:
    """Encodes unit vectors (P,3) as octahedral coordinates (P,2) int16 (Cigolle et al. 2014).

    >>> encode_normals(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])).tolist()
    [[0, 0], [32767, 0]]
    """
    return np.round(octahedral(normals) * 32767).astype(np.int16)


def decode_normals(encoded: np.ndarray) -> np.ndarray:
    """Decodes octahedral coordinates (P,2) int16 to unit vectors (P,3) float32; the inverse of `encode_normals`."""
    square = encoded.astype(np.float32) / np.float32(32767)
    z = 1 - np.abs(square[:, 0]) - np.abs(square[:, 1])
    behind = z < 0
    square[behind] = fold(square[behind])
    normals = np.concatenate([square, z[:, None]], 1)
    return normals / np.sqrt(np.einsum("nc,nc->n", normals, normals))[:, None]


def _create_safetensors(path: Path, tensors: Tensors, metadata: dict[str, str]) -> dict[str, np.memmap]:
    """Creates a safetensors file and maps its arrays into memory for writing.

    The library's writer would need all arrays in memory. The format is the length of the header, the header in JSON,
    and the raw arrays, which the caller flushes when they are filled.
    """
    header: dict[str, Any] = {"__metadata__": metadata}
    end = 0
    for name, (kind, shape) in tensors.items():
        begin, end = end, end + math.prod(shape) * np.dtype(kind).itemsize
        header[name] = {"dtype": DTYPE_NAMES[np.dtype(kind).name], "shape": shape, "data_offsets": [begin, end]}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)  # tensors start on a multiple of 8 bytes
    base = 8 + len(text)
    with open(path, "wb") as file:
        file.write(len(text).to_bytes(8, "little") + text)
        if hasattr(os, "posix_fallocate"):  # raises on a full disk, where writing to a sparse mapping is a SIGBUS
            os.posix_fallocate(file.fileno(), 0, base + end)
        else:
            file.truncate(base + end)
    return {
        name: np.memmap(path, kind, "r+", base + header[name]["data_offsets"][0], shape)
        for name, (kind, shape) in tensors.items()
    }
