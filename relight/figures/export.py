"""Figures for other programs: binary glTF with the textures inside."""

import io
import json
import struct
from pathlib import Path

import numpy as np
from PIL import Image

from relight.files import UserError, atomic_write
from relight.meshes import Mesh

FORMATS = ("glb", "npz")
FLOAT, UINT32 = 5126, 5125  # glTF 2.0, component types
ARRAY, ELEMENT = 34962, 34963  # buffer targets


def corners(mesh: Mesh, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices of the mesh (n,), uv (n,2) and faces (m,3) of one material, split where a vertex has several uv."""
    mine = mesh.material == number
    index, uv = mesh.faces[mine].reshape(-1), mesh.uv[mine].reshape(-1, 2)
    key = np.column_stack([index.astype(np.int64), np.ascontiguousarray(uv, np.float32).view(np.int32)])
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return index[first], uv[first], inverse.reshape(-1, 3)


def write_glb(mesh: Mesh, path: Path) -> None:
    """Binary glTF 2.0: one node, a primitive and a double-sided matte material for each of the mesh's; the mesh's info
    as `extras`. Units and frame are glTF's own: metres, y up, facing +z."""
    from relight.meshes import vertex_normals

    normals = vertex_normals(mesh)
    blob, views, accessors, primitives, materials, images = bytearray(), [], [], [], [], []

    def view(data: bytes, target: int | None) -> int:
        blob.extend(b"\0" * (-len(blob) % 4))
        views.append(
            {"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)} | ({"target": target} if target else {})
        )
        blob.extend(data)
        return len(views) - 1

    def accessor(array: np.ndarray, kind: str, component: int, target: int) -> int:
        record = {
            "bufferView": view(array.tobytes(), target),
            "componentType": component,
            "count": len(array),
            "type": kind,
        }
        if kind == "VEC3":
            record |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        accessors.append(record)
        return len(accessors) - 1

    for number, material in enumerate(mesh.materials):
        index, uv, faces = corners(mesh, number)
        if not len(faces):
            continue
        surface = {"baseColorFactor": [*map(float, material.color), 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9}
        if material.texture is not None:
            picture = io.BytesIO()
            Image.fromarray(material.texture).save(picture, "png", compress_level=6)
            images.append({"bufferView": view(picture.getvalue(), None), "mimeType": "image/png"})
            surface["baseColorTexture"] = {"index": len(images) - 1}
        materials.append({"pbrMetallicRoughness": surface, "doubleSided": True})
        attributes = {
            "POSITION": accessor(mesh.vertices[index].astype(np.float32), "VEC3", FLOAT, ARRAY),
            "NORMAL": accessor(normals[index].astype(np.float32), "VEC3", FLOAT, ARRAY),
            "TEXCOORD_0": accessor(np.stack([uv[:, 0], 1 - uv[:, 1]], 1).astype(np.float32), "VEC2", FLOAT, ARRAY),
        }
        if mesh.color is not None:
            attributes["COLOR_0"] = accessor(mesh.color[index].astype(np.float32), "VEC3", FLOAT, ARRAY)
        triangles = accessor(faces.astype(np.uint32).reshape(-1), "SCALAR", UINT32, ELEMENT)
        primitives.append({"attributes": attributes, "indices": triangles, "material": len(materials) - 1})
    scene = {
        "asset": {"version": "2.0", "generator": "relight"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": mesh.info.get("name", "figure"), "extras": mesh.info}],
        "meshes": [{"primitives": primitives}],
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob) + (-len(blob) % 4)}],
    }
    if images:
        scene |= {"images": images, "textures": [{"source": i} for i in range(len(images))]}
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    blob.extend(b"\0" * (-len(blob) % 4))
    with atomic_write(path) as tmp:
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
        tmp.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)


def export(mesh: Mesh, path: Path) -> None:
    """Writes .glb or relight's own .npz, by the suffix."""
    kind = path.suffix[1:].lower()
    if kind not in FORMATS:
        raise UserError(f"{path}: figures are written as {' or '.join(FORMATS)}")
    write_glb(mesh, path) if kind == "glb" else mesh.save(path)
