"""Writes figures for other programs: binary glTF with embedded textures.

trimesh writes glTF too, but rounds colors of materials and vertices to 8 bits of linear light, which turns an albedo
of .0036 (of lashes) into .0039. This module writes floats.
"""

import io
import json
import struct
from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.files import atomic_write
from relight.meshes import Material, Mesh, vertex_normals
from relight.meshes.gltf_file import BINARY_CHUNK, JSON_CHUNK

LICENCE = "CC0-1.0"  # of generated figures
CC0 = {
    "copyright": "No rights reserved: dedicated to the public domain under CC0 1.0",
    "extras": {"license": LICENCE, "url": "https://creativecommons.org/publicdomain/zero/1.0/"},
}
FLOAT, UINT32 = 5126, 5125  # glTF 2.0, component types
ARRAY, ELEMENT = 34962, 34963  # buffer targets
MAGIC, VERSION, HEADER_BYTES = 0x46546C67, 2, 12  # "glTF" in ASCII; of the file's header, without those of its chunks
SPECULAR = "KHR_materials_specular"


def corners(mesh: Mesh, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Splits the vertices of one material's faces where a vertex has several texture coordinates.

    Args:
        mesh: with F faces.
        number: number of the material.

    Returns:
        Vertices of the mesh (n,) and their uv (n,2); the material's faces (m,3) as indices into these.
    """
    chosen = mesh.material == number
    index, uv = mesh.faces[chosen].reshape(-1), mesh.uv[chosen].reshape(-1, 2)
    key = np.column_stack([index.astype(np.int64), np.ascontiguousarray(uv, np.float32).view(np.int32)])
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return index[first], uv[first], inverse.reshape(-1, 3)


class Document:
    """A glTF document under construction.

    Attributes:
        blob: its binary data.
        lists: its lists ("meshes", "nodes", ...) by name.
    """

    def __init__(self):
        self.blob = bytearray()
        self.lists: dict[str, list[dict]] = {}
        self._textures: dict[bytes, int] = {}  # index of a texture by its PNG

    def append(self, name: str, entry: dict) -> int:
        """Appends an entry to a list of the document, "meshes" or "nodes", and returns its index there."""
        entries = self.lists.setdefault(name, [])
        entries.append(entry)
        return len(entries) - 1

    def view(self, data: bytes, target: int | None = None) -> int:
        """Appends binary data, and returns the index of its buffer view; `target` is ARRAY, ELEMENT or None."""
        self.blob.extend(b"\0" * (-len(self.blob) % 4))
        entry = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)}
        self.blob.extend(data)
        return self.append("bufferViews", entry | ({"target": target} if target else {}))

    def accessor(self, array: np.ndarray, kind: str, component: int, target: int) -> int:
        """Appends an array.

        Args:
            array: (N,) or (N,width).
            kind: of its elements, such as VEC3.
            component: FLOAT or UINT32.
            target: ARRAY for attributes of vertices, ELEMENT for indices.

        Returns:
            The index of its accessor.
        """
        view = self.view(array.tobytes(), target)
        entry = {"bufferView": view, "componentType": component, "count": len(array), "type": kind}
        if kind == "VEC3":  # glTF wants the bounds of positions
            entry |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        return self.append("accessors", entry)

    def texture(self, pixels: np.ndarray) -> int:
        """Returns the index of a texture (H,W,3) uint8, appended unless the document has one with the same pixels."""
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "png", compress_level=6)
        data = file.getvalue()
        if data not in self._textures:
            image = self.append("images", {"bufferView": self.view(data), "mimeType": "image/png"})
            self._textures[data] = self.append("textures", {"source": image})
        return self._textures[data]

    def material(self, material: Material) -> int:
        """Appends a double-sided material, and returns its index."""
        surface = {
            "baseColorFactor": [*map(float, material.color), 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": material.roughness,
        }
        if material.texture is not None:
            surface["baseColorTexture"] = {"index": self.texture(material.texture)}
        named = {"name": material.name} if material.name else {}
        gloss = {"extensions": {SPECULAR: {"specularFactor": material.specular}}}
        return self.append("materials", named | {"pbrMetallicRoughness": surface, "doubleSided": True} | gloss)

    def write(self, path: Path, root: int, licence: str | None) -> None:
        """Writes the document as .glb, whole or not at all, with node `root` (an index) as that of the scene."""
        self.blob.extend(b"\0" * (-len(self.blob) % 4))  # chunks are multiples of 4 bytes
        asset = {"version": "2.0", "generator": "relight", **(CC0 if licence == LICENCE else {})}
        head = {"asset": asset, "extensionsUsed": [SPECULAR], "scene": 0, "scenes": [{"nodes": [root]}]}
        head |= {"buffers": [{"byteLength": len(self.blob)}]}
        text = json.dumps(head | self.lists).encode()
        text += b" " * (-len(text) % 4)
        json_chunk = struct.pack("<II", len(text), JSON_CHUNK) + text
        binary_chunk = struct.pack("<II", len(self.blob), BINARY_CHUNK) + self.blob
        header = struct.pack("<III", MAGIC, VERSION, HEADER_BYTES + len(json_chunk) + len(binary_chunk))
        with atomic_write(path) as tmp:
            tmp.write_bytes(header + json_chunk + binary_chunk)


def write_glb(mesh: Mesh, path: Path) -> None:
    """Writes binary glTF 2.0: a node named after the figure, with a child named after each material.

    Units and frame are those of glTF: metres, y up, facing +z. The root node's `extras` are the mesh's info, those of
    the asset are its licence if that is CC0.

    Args:
        mesh: a generated figure, in its own outfit.
        path: path of the .glb.
    """
    normals, document = vertex_normals(mesh), Document()
    parts: list[int] = []  # nodes
    for number, material in enumerate(mesh.materials):
        index, uv, faces = corners(mesh, number)
        if not len(faces):
            continue
        uv_from_top = np.stack([uv[:, 0], 1 - uv[:, 1]], 1)  # glTF counts v from the top
        attributes = {
            "POSITION": document.accessor(mesh.vertices[index].astype(np.float32), "VEC3", FLOAT, ARRAY),
            "NORMAL": document.accessor(normals[index].astype(np.float32), "VEC3", FLOAT, ARRAY),
            "TEXCOORD_0": document.accessor(uv_from_top.astype(np.float32), "VEC2", FLOAT, ARRAY),
        }
        triangles = document.accessor(faces.astype(np.uint32).reshape(-1), "SCALAR", UINT32, ELEMENT)
        primitive = {"attributes": attributes, "indices": triangles, "material": document.material(material)}
        name = material.name or f"part {number}"
        part = document.append("meshes", {"name": name, "primitives": [primitive]})
        parts.append(document.append("nodes", {"name": name, "mesh": part}))
    root = {"name": mesh.info.get("name", "figure"), "children": parts, "extras": mesh.info}
    document.write(path, document.append("nodes", root), mesh.info.get("licence"))
