"""Reads glTF 2.0 (.glb and .gltf) with node transforms, base colours and vertex colours."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from relight.files import UserError
from relight.meshes.gltf_file import Gltf
from relight.meshes.mesh import Material
from relight.meshes.raw import MAX_FACES, RawMesh, read_texture


def read_gltf(path: Path) -> RawMesh:
    """Reads the triangles of the default scene; raises UserError if the file is malformed or a texture is missing."""
    try:
        with np.errstate(invalid="ignore"):  # `checked_mesh` handles NaN
            return _read(Gltf(path))
    except (KeyError, TypeError, AttributeError, IndexError, ValueError, OverflowError) as error:
        raise UserError(f"{path}: the glTF description is damaged ({type(error).__name__}: {error})") from None


def _read(gltf: Gltf) -> RawMesh:
    """Concatenates the primitives of the default scene."""
    materials: list[tuple[Material, np.ndarray, int]] = []
    parts, slots, total = [], {}, 0
    for primitive, matrix in _primitives(gltf):
        points = gltf.accessor(primitive["attributes"]["POSITION"]).astype(np.float64)
        index = gltf.accessor(primitive["indices"]) if "indices" in primitive else np.arange(len(points))
        faces = _triangles(gltf, index.astype(np.int64), primitive.get("mode", 4))
        total += len(faces)
        if total > MAX_FACES:
            raise UserError(f"{gltf.path} has over {MAX_FACES} faces: decimate it first")
        if faces.size and faces.max() >= len(points):
            raise UserError(f"{gltf.path}: a face names vertex {faces.max()}, but the part has {len(points)}")
        if np.linalg.det(matrix[:3, :3]) < 0:  # a mirrored node turns its faces inside out
            faces = faces[:, ::-1]
        number = primitive.get("material")
        if number not in slots:
            slots[number] = len(materials)
            materials.append(_material(gltf, number))
        material, placement, channel = materials[slots[number]]
        uv = np.zeros((len(faces), 3, 2))
        if material.texture is not None:
            uv = gltf.accessor(primitive["attributes"][f"TEXCOORD_{channel}"]) @ placement[:, :2].T + placement[:, 2]
            uv = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=-1)[faces]  # glTF counts v from the top
        color = primitive["attributes"].get("COLOR_0")
        color = None if color is None else gltf.accessor(color)[:, :3].astype(np.float32)
        parts.append((points @ matrix[:3, :3].T + matrix[:3, 3], faces, uv, np.full(len(faces), slots[number]), color))
    if not total:
        raise UserError(f"{gltf.path} has no triangles: relight needs a surface")
    start = np.cumsum([0] + [len(points) for points, *_ in parts])
    colored = any(color is not None for *_, color in parts)
    return RawMesh(
        vertices=np.concatenate([points for points, *_ in parts]),
        faces=np.concatenate([faces + offset for (_, faces, *_), offset in zip(parts, start)]),
        uv=np.concatenate([uv for _, _, uv, *_ in parts]),
        material=np.concatenate([material for *_, material, _ in parts]),
        materials=[material for material, _, _ in materials],
        color=np.concatenate([np.ones((len(p), 3)) if c is None else c for p, *_, c in parts]) if colored else None,
    )


def _primitives(gltf: Gltf) -> Iterator[tuple[dict[str, Any], np.ndarray]]:
    """Yields the primitives of the default scene, or of all nodes if there is none, with their nodes' 4 x 4 matrix."""
    nodes = gltf.json.get("nodes", [])
    if gltf.json.get("scenes"):
        roots = gltf.item("scenes", gltf.json.get("scene", 0)).get("nodes", [])
    else:
        roots = sorted(set(range(len(nodes))) - {child for node in nodes for child in node.get("children", [])})
    stack = [(root, np.eye(4)) for root in reversed(roots)]
    seen = set()
    while stack:
        index, above = stack.pop()
        node = gltf.item("nodes", index)
        if index in seen:
            raise UserError(f"{gltf.path}: node {index} is reached twice; nodes must form a tree")
        seen.add(index)
        matrix = above @ _matrix(node)
        if "mesh" in node:
            for primitive in gltf.item("meshes", node["mesh"])["primitives"]:
                yield primitive, matrix
        stack += [(child, matrix) for child in reversed(node.get("children", []))]


def _matrix(node: dict[str, Any]) -> np.ndarray:
    """Returns a node's transform (4,4), from a column-major matrix or translation, rotation (x,y,z,w) and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    rotation = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _triangles(gltf: Gltf, index: np.ndarray, mode: int) -> np.ndarray:
    """Returns the faces (F,3) of a triangle list (4), strip (5) or fan (6); none of points and lines."""
    if mode == 4:
        if len(index) % 3:
            raise UserError(f"{gltf.path}: {len(index)} indices do not make whole triangles")
        return index.reshape(-1, 3)
    if mode == 5 and len(index) > 2:
        faces = np.stack([index[:-2], index[1:-1], index[2:]], axis=-1)
        faces[1::2] = faces[1::2, ::-1]
        return faces
    if mode == 6 and len(index) > 2:
        return np.stack([np.broadcast_to(index[0], len(index) - 2), index[1:-1], index[2:]], axis=-1)
    return np.zeros((0, 3), np.int64)


def _material(gltf: Gltf, number: int | None) -> tuple[Material, np.ndarray, int]:
    """Returns a material, the transform (2,3) of its texture coordinates, and the number of their set.

    It is matt unless the file gives its reflection (KHR_materials_specular): the defaults of glTF, which writers leave
    as they are, would make all scans glossy.
    """
    placement = np.eye(2, 3)
    if number is None:
        return Material(), placement, 0
    entry = gltf.item("materials", number)
    base = entry.get("pbrMetallicRoughness", {})
    legacy = entry.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
    factor = base.get("baseColorFactor", legacy.get("diffuseFactor", (1, 1, 1, 1)))
    slot = base.get("baseColorTexture", legacy.get("diffuseTexture"))
    color, name = np.array(factor[:3], np.float32), str(entry.get("name", ""))
    gloss = {}
    if (specular := entry.get("extensions", {}).get("KHR_materials_specular")) is not None:
        gloss = {"roughness": base.get("roughnessFactor", 1.0), "specular": specular.get("specularFactor", 1.0)}
        gloss = {key: min(1.0, max(0.0, float(value))) for key, value in gloss.items()}
    if slot is None:
        return Material(color, name=name, **gloss), placement, 0
    moved = slot.get("extensions", {}).get("KHR_texture_transform", {})
    if moved:
        c, s = np.cos(moved.get("rotation", 0)), np.sin(moved.get("rotation", 0))
        placement = np.array([[c, s], [-s, c]]) * np.array(moved.get("scale", (1, 1)))
        placement = np.concatenate([placement, np.array(moved.get("offset", (0, 0)))[:, None]], axis=1)
    channel = moved.get("texCoord", slot.get("texCoord", 0))
    return Material(color, _texture(gltf, slot["index"]), name, **gloss), placement, channel


def _texture(gltf: Gltf, index: int) -> np.ndarray:
    """Reads a texture (H,W,3) from a file, or from the binary data."""
    texture = gltf.item("textures", index)
    source = texture.get("source", texture.get("extensions", {}).get("EXT_texture_webp", {}).get("source"))
    image = gltf.item("images", source)
    what = f"{gltf.path}: texture {image.get('name') or image.get('uri', '')[:60] or source}"
    if "uri" in image:
        return read_texture(gltf.resource(image["uri"]), what)
    return read_texture(bytes(gltf.view(image["bufferView"])[0]), what)
