"""A data set for training: the foreground pixels of all figures in one memory-mapped safetensors file.

25 bytes per foreground pixel and a bit per pixel of the image, so that 345 figures at 1024 px take 1.35 GB:
`mask` (F, ceil(size^2 / 8)) uint8 bits in raster order; `offset` (F+1,) int64, the pixels of figure i are
offset[i] to offset[i+1]; `transport` (P, K) f16; `albedo` (P, 3) uint8 sRGB codes, as textures are; `normal` (P, 2)
int16, octahedral (Cigolle et al. 2014), which holds a unit vector to 7e-5 in 4 bytes. AO is T00/.8862.
"""

import json
import math
from pathlib import Path

import numpy as np
from safetensors import safe_open

from relight.files import UserError, existing, whole
from relight.progress import progress
from relight.srgb import LINEAR, encode, to_bytes

OPEN = math.sqrt(math.pi) / 2  # T00 of a point that nothing occludes, .8862
TYPES = {"uint8": "U8", "int16": "I16", "int64": "I64", "float16": "F16"}


def pack(exr_paths: list[Path], out: Path) -> list[str]:
    """Packs the maps in `exr_paths` into `out`, whole or not at all; returns the names of the packed maps.

    Maps are called like their figure, or like the view or the outfit of it that they are. Figures that were left out
    are skipped. With bounces, the packed transport is the direct one plus the mean over colour channels of the bounced
    one. One figure is in memory at a time. UserError when the sizes or orders differ, or when nothing is left to pack.
    """
    from relight.maps.exr import read_info, read_maps  # readers of the set need no OpenEXR

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
    layout = {
        "offset": (np.int64, offset.shape),
        "transport": (np.float16, (offset[-1], coefficients)),
        "albedo": (np.uint8, (offset[-1], 3)),
        "normal": (np.int16, (offset[-1], 2)),
        "mask": (np.uint8, (len(found), -(-size * size // 8))),
    }
    notes = {"names": names, "subjects": subjects, "size": size, "order": first["order"]}
    if any("figure" in info for _, info in found):
        notes["figures"] = [info.get("figure", name) for name, (_, info) in zip(names, found)]
        notes["views"] = [info.get("view") for _, info in found]
    with whole(out) as temporary:
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
        for array in arrays.values():
            array.flush()
    return names


class Packed:
    """A packed data set, memory-mapped: a figure is read from disk when it is asked for.

    names, subjects: of each of its maps; figures: the figure that each shows, called like the maps of its frontal view
    in its own outfit; views: how it is seen (relight.transport.view.record), None for the frontal view.
    """

    def __init__(self, path: Path | str):
        """Raises UserError when `path` is not a packed data set."""
        try:
            self._file = safe_open(str(existing(path, "packed maps")), framework="np")
            notes = {key: json.loads(value) for key, value in (self._file.metadata() or {}).items()}
            self.names: list[str] = notes["names"]
            self.subjects: list[str] = notes["subjects"]
            self.figures: list[str] = notes.get("figures", self.names)
            self.views: list[dict | None] = notes.get("views", [None] * len(self.names))
            self.size: int = notes["size"]
            self.order: int = notes["order"]
            self.offset: np.ndarray = self._file.get_tensor("offset")
        except UserError:
            raise
        except Exception as error:  # safetensors has an exception type of its own beside KeyError and ValueError
            raise UserError(f"{path} is not a packed data set of relight ({error})") from None

    def __len__(self) -> int:
        return len(self.names)

    def figure(self, index: int) -> dict[str, np.ndarray]:
        """The foreground pixels of one figure: `pixel` (P,) int32 flat indices in raster order, `transport` (P, K),
        `albedo` (P, 3) linear, `normal` (P, 3) unit and `ao` (P,), all float16."""
        if not 0 <= index < len(self):
            raise IndexError(f"figure {index} of {len(self)}")
        return self._read(index, index + 1)

    def arrays(self) -> dict[str, np.ndarray]:
        """The same for all figures at once, one after the other, with `offset` (F+1,) int64."""
        return {"offset": self.offset, **self._read(0, len(self))}

    def _read(self, begin: int, end: int) -> dict[str, np.ndarray]:
        part = slice(int(self.offset[begin]), int(self.offset[end]))
        stored = {name: self._file.get_slice(name)[part] for name in ("transport", "albedo", "normal")}
        bits = np.unpackbits(self._file.get_slice("mask")[begin:end], axis=1, count=self.size**2)
        return {
            "pixel": np.concatenate([np.flatnonzero(row) for row in bits]).astype(np.int32),
            "transport": stored["transport"],
            "albedo": LINEAR.astype(np.float16)[stored["albedo"]],
            "normal": decode_normals(stored["normal"]).astype(np.float16),
            "ao": (stored["transport"][:, 0].astype(np.float32) / np.float32(OPEN)).clip(0, 1).astype(np.float16),
        }


def encode_normals(normals: np.ndarray) -> np.ndarray:
    """Unit vectors (P, 3) on the octahedron, unfolded to a square: (P, 2) int16."""
    flat = normals / np.abs(normals).sum(1, keepdims=True)
    square = np.where(flat[:, 2:] < 0, _fold(flat[:, :2]), flat[:, :2])
    return np.round(square * 32767).astype(np.int16)


def decode_normals(encoded: np.ndarray) -> np.ndarray:
    """Unit vectors (P, 3) float32 of what `encode_normals` gave."""
    square = encoded.astype(np.float32) / np.float32(32767)
    z = 1 - np.abs(square[:, 0]) - np.abs(square[:, 1])
    behind = z < 0
    square[behind] = _fold(square[behind])
    normals = np.concatenate([square, z[:, None]], 1)
    return normals / np.sqrt(np.einsum("nc,nc->n", normals, normals))[:, None]


def _fold(square: np.ndarray) -> np.ndarray:
    """Reflects points of the square about the nearest edge of its inner diamond: z > 0 lies inside, z < 0 outside."""
    return (1 - np.abs(square[:, ::-1])) * np.where(square < 0, np.float32(-1), np.float32(1))


def _create(path: Path, layout: dict[str, tuple], notes: dict[str, str]) -> dict[str, np.memmap]:
    """A safetensors file of this layout, as arrays mapped for writing.

    The library's own writer wants every array in memory; the format is a length, a JSON header and the raw arrays.
    """
    header, end = {"__metadata__": notes}, 0
    for name, (kind, shape) in layout.items():
        begin, end = end, end + math.prod(map(int, shape)) * np.dtype(kind).itemsize
        shape = [int(n) for n in shape]
        header[name] = {"dtype": TYPES[np.dtype(kind).name], "shape": shape, "data_offsets": [begin, end]}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)  # tensors start on a multiple of 8 bytes
    base = 8 + len(text)
    with open(path, "wb") as file:
        file.write(len(text).to_bytes(8, "little") + text)
        file.truncate(base + end)
    return {
        name: np.memmap(path, kind, "r+", base + header[name]["data_offsets"][0], tuple(map(int, shape)))
        for name, (kind, shape) in layout.items()
    }
