"""The container of glTF 2.0: JSON, extensions, buffers, views, accessors; accesses are checked against the sizes."""

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np

from relight.core.errors import UserError
from relight.core.text import decode
from relight.meshes.find import find_file
from relight.meshes.raw import MAX_FACES

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942  # kinds of a .glb file's chunks: "JSON" and "BIN" in ASCII
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
# Extensions that a file may require although nothing here reads them: they change neither shape nor base color.
WITHOUT_EFFECT = {f"KHR_materials_{name}" for name in (
    "anisotropy", "clearcoat", "diffuse_transmission", "dispersion", "emissive_strength", "ior", "iridescence", "sheen",
    "transmission", "unlit", "variants", "volume",
)} | {"EXT_lights_image_based", "KHR_lights_punctual", "KHR_mesh_quantization", "KHR_xmp_json_ld"}  # fmt: skip
PICTURE_FORMATS = ("EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds")
# Those that `gltf` reads.
READ = {"KHR_materials_pbrSpecularGlossiness", "KHR_materials_specular", "KHR_texture_transform", *PICTURE_FORMATS}


class Gltf:
    """An open glTF file; its buffers are read when they are first used.

    Attributes:
        path: of the file.
        json: its description.
        chunk: binary data of a .glb file, or None.
        advice: an end of messages about missing data.
        buffers: those that were read, by index.
    """

    def __init__(self, path: Path):
        """Reads the description; raises UserError if it is damaged or requires an extension that is not supported."""
        self.path = path
        data = path.read_bytes()
        is_binary = path.suffix.lower() == ".glb" or data.startswith(b"glTF")
        text, self.chunk = self._split(data) if is_binary else (data, None)
        try:
            self.json = json.loads(decode(text.rstrip(b"\0") if is_binary else text))
        except (ValueError, RecursionError):
            raise UserError(f"{path}: the glTF description is not whole JSON") from None
        if not isinstance(self.json, dict) or not str(self.json.get("asset", {}).get("version", "")).startswith("2"):
            raise UserError(f"{path} is not glTF 2.0")
        if required := set(self.json.get("extensionsRequired", [])) - WITHOUT_EFFECT - READ:
            raise UserError(f"{path} needs {', '.join(sorted(required))}; save it without compression or extensions")
        compression = [name for name in self.json.get("extensionsUsed", []) if "compression" in name]
        self.advice = f"; save it without {' or '.join(compression)}" if compression else ""
        self.buffers: dict[int, bytes] = {}

    def _split(self, data: bytes) -> tuple[bytes, bytes | None]:
        """Returns the JSON and the binary chunk of a .glb container, None if there is none."""
        if len(data) < 20 or data[:4] != b"glTF":
            raise UserError(f"{self.path} is not a .glb file: it does not begin with `glTF`")
        version, length = struct.unpack_from("<II", data, 4)
        if version != 2:
            raise UserError(f"{self.path} is glTF {version}; version 2 is read")
        if length > len(data):
            raise UserError(f"{self.path} is truncated: it should have {length} bytes and has {len(data)}")
        chunks: dict[int, bytes] = {}
        start = 12  # after the header of the file; that of a chunk has 8 bytes
        while start + 8 <= length:
            size, kind = struct.unpack_from("<II", data, start)
            if start + 8 + size > length:
                raise UserError(f"{self.path}: a chunk of {size} bytes runs over the end of the file")
            chunks.setdefault(kind, data[start + 8 : start + 8 + size])
            start += 8 + size
        if JSON_CHUNK not in chunks:
            raise UserError(f"{self.path} has no JSON chunk")
        return chunks[JSON_CHUNK], chunks.get(BINARY_CHUNK)

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """Returns entry `index` of the list `kind`; raises UserError if there is none."""
        entries: list[dict[str, Any]] = self.json.get(kind, [])
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(entries):
            raise UserError(f"{self.path} names entry {index} of {kind}, of which there are {len(entries)}")
        return entries[index]

    def resource(self, uri: str) -> bytes:
        """Returns the data of a URI, which holds them itself (data:) or names a file in the folder.

        Raises:
            UserError: if they are damaged, the file is missing, or it would have to be fetched.
        """
        if uri[:5].lower() == "data:":
            try:
                return base64.b64decode("".join(uri.partition(",")[2].split()), validate=True)
            except (binascii.Error, ValueError):
                raise UserError(f"{self.path}: data inside the file are not whole base64") from None
        if "://" in uri:
            raise UserError(f"{self.path} names {uri[:80]}; nothing is fetched from the network")
        return find_file(self.path, unquote_to_bytes(uri), uri).read_bytes()

    def view(self, index: int) -> tuple[memoryview, int | None]:
        """Returns the bytes of a buffer view, and its stride in bytes, None if its values are tightly packed."""
        view = self.item("bufferViews", index)
        number = view["buffer"]
        buffer = self.item("buffers", number)
        if number not in self.buffers:
            data = self.resource(buffer["uri"]) if "uri" in buffer else self.chunk if number == 0 else None
            if data is None:
                raise UserError(f"{self.path}: the binary chunk is missing{self.advice}")
            self.buffers[number] = data
        start, length = view.get("byteOffset", 0), view["byteLength"]
        if start < 0 or length < 0 or start + length > len(self.buffers[number]):
            raise UserError(f"{self.path}: a view of {length} bytes runs over the end of its buffer")
        return memoryview(self.buffers[number])[start : start + length], view.get("byteStride")

    def accessor(self, index: int) -> np.ndarray:
        """Returns the values of an accessor, (N,) or (N,width), with normalised integers as floats."""
        accessor = self.item("accessors", index)
        count, width = accessor["count"], WIDTHS[accessor["type"]]
        type = np.dtype(COMPONENTS[accessor["componentType"]])
        if not 0 <= count <= 3 * MAX_FACES:
            raise UserError(f"{self.path}: an accessor promises {count} values")
        if "sparse" in accessor:
            raise UserError(f"{self.path} has a sparse accessor, which is not read here: export it without")
        if "bufferView" not in accessor:  # zeros by the standard, of any number: no surface needs them
            raise UserError(f"{self.path}: an accessor of {count} values comes without data{self.advice}")
        data, stride = self.view(accessor["bufferView"])
        start, row = accessor.get("byteOffset", 0), type.itemsize * width
        stride = stride or row
        if start < 0 or stride < row or (count and start + stride * (count - 1) + row > len(data)):
            raise UserError(f"{self.path}: an accessor of {count} values runs over the end of its data; truncated?")
        values = np.zeros((0, width), type)
        if count:  # shares the memory of the buffer
            values = np.ndarray((count, width), type, data, start, (stride, type.itemsize))
        if accessor.get("normalized") and type.kind in "iu":
            values = np.maximum(values / np.iinfo(type).max, -1)
        return values[:, 0] if width == 1 else values
