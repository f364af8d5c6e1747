"""Reads glTF 2.0 (.glb and .gltf) with node transforms, base colors and vertex colors."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from relight.errors import UserError
from relight.meshes.gltf_file import READERS, Gltf, read_extension, reads_extension
from relight.meshes.mesh import CLAMP, MIRROR, REPEAT, Material
from relight.meshes.raw import MAX_FACES, RawMesh, read_texture, unit_colors

WRAPS = {10497: REPEAT, 33071: CLAMP, 33648: MIRROR}  # of a sampler


def read_gltf(path: Path) -> RawMesh:
    """Reads the triangles of the default scene; raises UserError if the file is malformed or a texture is missing."""
    try:
        with np.errstate(invalid="ignore"):  # `checked_mesh` handles NaN
            return _read(Gltf(path))
    except (KeyError, TypeError, AttributeError, IndexError, ValueError, OverflowError) as error:
        raise UserError(f"{path}: the glTF description is damaged ({type(error).__name__}: {error})") from None


def _read(gltf: Gltf) -> RawMesh:
    """Concatenates the primitives of the default scene."""
    materials: list[tuple[Material | None, np.ndarray, int]] = []
    notes: list[str] = []
    parts, slots, total = [], {}, 0
    for node, primitive, matrix in _primitives(gltf):
        notes += _poses(gltf, node)
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
            materials.append(_material(gltf, number, notes))
        material, placement, channel = materials[slots[number]]
        uv = np.zeros((len(faces), 3, 2))
        if material is not None and material.texture is not None:
            name = f"TEXCOORD_{channel}"
            if name not in primitive["attributes"]:
                raise UserError(f"{gltf.path}: faces of the textured material {number} have no {name}")
            uv = gltf.accessor(primitive["attributes"][name])
            if uv.dtype.kind in "iu" and "KHR_mesh_quantization" not in gltf.json.get("extensionsUsed", []):
                uv = uv / np.iinfo(uv.dtype.char).max  # whole numbers mean nothing else without that extension
            uv = uv @ placement[:, :2].T + placement[:, 2]
            uv = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=-1)[faces]  # glTF counts v from the top
        color = primitive["attributes"].get("COLOR_0")
        color = None if color is None else _colors(gltf.accessor(color)[:, :3], notes)
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
        warnings=list(dict.fromkeys(notes)),
    )


def _colors(values: np.ndarray, notes: list[str]) -> np.ndarray:
    """Returns linear vertex colors (V,3) float32 in [0,1]; integers that are not marked as normalised are, too."""
    codes, unusual = unit_colors(values, "its vertex colors")
    notes += unusual
    return (codes / np.float32(255) if codes.dtype == np.uint8 else codes).astype(np.float32)


def _poses(gltf: Gltf, node: dict[str, Any]) -> list[str]:
    """Returns notes on what moves the vertices of a node's mesh, and is not read."""
    weights = node.get("weights") or gltf.item("meshes", node["mesh"]).get("weights") or []
    left_out = {
        "skeleton and pose": "skin" in node,
        "morph targets": any(weights),
        "copies (EXT_mesh_gpu_instancing)": "EXT_mesh_gpu_instancing" in node.get("extensions", {}),
    }
    return [f"its {what} are left out: apply them before export" for what, there in left_out.items() if there]


def _primitives(gltf: Gltf) -> Iterator[tuple[dict[str, Any], dict[str, Any], np.ndarray]]:
    """Yields node, primitive and 4 x 4 matrix of the default scene, or of all nodes if there is none."""
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
                yield node, primitive, matrix
        stack += [(child, matrix) for child in reversed(node.get("children", []))]


def _matrix(node: dict[str, Any]) -> np.ndarray:
    """Returns a node's transform (4,4), from a column-major matrix or translation, rotation (x,y,z,w) and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    rotation = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    x, y, z, w = rotation / (float(np.linalg.norm(rotation)) or 1.0)
    turned = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    matrix = np.eye(4)
    matrix[:3, :3] = turned * np.array(node.get("scale", (1, 1, 1)), np.float64)
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


def _material(gltf: Gltf, number: int | None, notes: list[str]) -> tuple[Material | None, np.ndarray, int]:
    """Returns a material, the transform (2,3) of its texture coordinates, and the number of their set.

    The material is None where the file gives no color. It is matt unless the file gives its reflection
    (KHR_materials_specular): the defaults of glTF, which writers leave as they are, would make all scans glossy.
    """
    placement = np.eye(2, 3)
    if number is None:
        return None, placement, 0
    entry = gltf.item("materials", number)
    base = entry.get("pbrMetallicRoughness", {})
    given = (read_extension(entry, "KHR_materials_pbrSpecularGlossiness") or {}) | base
    factor, slot = given.get("baseColorFactor"), given.get("baseColorTexture")
    if factor is None and slot is None:
        return None, placement, 0
    color, name = np.array((factor or (1, 1, 1))[:3], np.float32), str(entry.get("name", ""))
    if color.max() > 1 or color.min() < 0:
        notes.append(f"the color of the material {name or number!r} is outside 0 to 1: it is clipped")
    gloss = read_extension(entry, "KHR_materials_specular", base) or {}
    if slot is None:
        return Material(color, name=name, **gloss), placement, 0
    moved, channel = read_extension(slot, "KHR_texture_transform") or (placement, None)
    texture, wrap = _texture(gltf, slot["index"])
    channel = slot.get("texCoord", 0) if channel is None else channel
    return Material(color, texture, name, **gloss, wrap=wrap), moved, channel


@reads_extension("KHR_materials_pbrSpecularGlossiness")
def _legacy_base(extension: dict[str, Any]) -> dict[str, Any]:
    names = {"diffuseFactor": "baseColorFactor", "diffuseTexture": "baseColorTexture"}
    return {new: extension[old] for old, new in names.items() if old in extension}


@reads_extension("KHR_materials_specular")
def _gloss(extension: dict[str, Any], base: dict[str, Any]) -> dict[str, float]:
    gloss = {"roughness": base.get("roughnessFactor", 1.0), "specular": extension.get("specularFactor", 1.0)}
    return {key: min(1.0, max(0.0, float(value))) for key, value in gloss.items()}


@reads_extension("KHR_texture_transform")
def _placement(extension: dict[str, Any]) -> tuple[np.ndarray, int | None]:
    c, s = np.cos(extension.get("rotation", 0)), np.sin(extension.get("rotation", 0))
    turned = np.array([[c, s], [-s, c]]) * np.array(extension.get("scale", (1, 1)))
    offset = np.array(extension.get("offset", (0, 0)))[:, None]
    return np.concatenate([turned, offset], axis=1), extension.get("texCoord")


@reads_extension("EXT_texture_webp")
@reads_extension("EXT_texture_avif")
@reads_extension("MSFT_texture_dds")
def _other_source(extension: dict[str, Any]) -> int | None:
    return extension.get("source")


def _texture(gltf: Gltf, index: int) -> tuple[np.ndarray, tuple[str, str]]:
    """Reads a texture (H,W,3) from a file, or from the binary data; also returns its wrap modes."""
    texture = gltf.item("textures", index)
    known = [read_extension(texture, name) for name, reader in READERS.items() if reader is _other_source]
    source = next((one for one in (texture.get("source"), *known) if one is not None), None)
    if source is None:
        forms = ", ".join(texture.get("extensions", {})) or "no picture"
        raise UserError(f"{gltf.path}: texture {index} is given as {forms} only: save it as PNG or JPEG")
    sampler = gltf.item("samplers", texture["sampler"]) if "sampler" in texture else {}
    wrap = WRAPS[sampler.get("wrapS", 10497)], WRAPS[sampler.get("wrapT", 10497)]
    image = gltf.item("images", source)
    what = f"{gltf.path}: texture {image.get('name') or image.get('uri', '')[:60] or source}"
    if "uri" in image:
        return read_texture(gltf.resource(image["uri"]), what), wrap
    return read_texture(bytes(gltf.view(image["bufferView"])[0]), what), wrap
