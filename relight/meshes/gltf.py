"""Reads glTF 2.0 (.glb and .gltf) with node transforms, base colors and vertex colors."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from relight.core.errors import UserError
from relight.meshes.gltf_file import PICTURE_FORMATS, Gltf
from relight.meshes.mesh import CLAMP, MIRROR, REPEAT, Material
from relight.meshes.raw import MAX_FACES, RawMesh, unit_colors
from relight.pictures.texture import read_texture

DEFAULT_WRAP = 10497
WRAPS = {DEFAULT_WRAP: REPEAT, 33071: CLAMP, 33648: MIRROR}  # of a sampler
TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = 4, 5, 6  # modes of a primitive


class Surface(NamedTuple):
    """A material and its texture coordinates.

    Attributes:
        material: None where the file gives no color.
        placement: (2,3) transform of the texture coordinates.
        channel: number of their set, as in TEXCOORD_0.
    """

    material: Material | None
    placement: np.ndarray
    channel: int


def read_gltf(path: Path) -> RawMesh:
    """Reads the triangles of the default scene; raises UserError if the file is malformed or a texture is missing."""
    try:
        with np.errstate(invalid="ignore"):  # `checked_mesh` handles NaN
            return _read(Gltf(path))
    except (KeyError, TypeError, AttributeError, IndexError, ValueError, OverflowError) as error:
        raise UserError(f"{path}: the glTF description is damaged ({type(error).__name__}: {error})") from None


def _read(gltf: Gltf) -> RawMesh:
    """Concatenates the primitives of the default scene."""
    surfaces: dict[int | None, Surface] = {}  # by the number of the material in the file
    notes: list[str] = []
    parts: list[RawMesh] = []  # points and normals in the frame of the scene, faces from 0 in each
    total, is_colored = 0, False
    for node, primitive, matrix in _primitives(gltf):
        notes += _poses(gltf, node)
        attributes = primitive["attributes"]
        points = gltf.accessor(attributes["POSITION"]).astype(np.float64)
        corners = gltf.accessor(primitive["indices"]) if "indices" in primitive else np.arange(len(points))
        faces = _triangles(gltf, corners.astype(np.int64), primitive.get("mode", TRIANGLES))
        total += len(faces)
        if total > MAX_FACES:
            raise UserError(f"{gltf.path} has over {MAX_FACES} faces: decimate it first")
        if faces.size and faces.max() >= len(points):
            raise UserError(f"{gltf.path}: a face names vertex {faces.max()}, but the part has {len(points)}")
        linear = matrix[..., :3, :3]
        side = np.sign(np.linalg.det(linear))
        if np.sum(side) < 0:  # a mirrored node turns its faces inside out
            faces = faces[:, ::-1]
        if (number := primitive.get("material")) not in surfaces:
            surfaces[number] = _surface(gltf, number, notes)
        index = list(surfaces).index(number)
        color, normal = np.ones((len(faces), 3, 3), np.float32), np.zeros_like(points)
        if "COLOR_0" in attributes:
            # Integers are codes, although a file may have forgotten to mark them as normalised.
            codes, unusual = unit_colors(gltf.accessor(attributes["COLOR_0"])[:, :3], "its vertex colors")
            color = (codes / np.float32(255) if codes.dtype == np.uint8 else codes).astype(np.float32)[faces]
            notes += unusual
            is_colored = True
        if "NORMAL" in attributes:
            normal = _turned(gltf.accessor(attributes["NORMAL"]), linear) * side[..., None]
        placed, uv = _times(linear, points) + matrix[..., :3, 3], _uv(gltf, primitive, surfaces[number], faces)
        parts.append(RawMesh(placed, faces, [], uv, np.full(len(faces), index), color, normal=normal))
    if not total:
        raise UserError(f"{gltf.path} has no triangles: relight needs a surface")
    start = np.cumsum([0] + [len(part.vertices) for part in parts])
    joined = ("vertices", "uv", "material", "normal", *(["color"] if is_colored else []))
    arrays: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in joined}
    return RawMesh(
        **arrays,
        faces=np.concatenate([part.faces + offset for part, offset in zip(parts, start)]),
        materials=[surface.material for surface in surfaces.values()],
        warnings=list(dict.fromkeys(notes)),
        axes={"up": "+y", "front": "+z"} if gltf.json["asset"].get("generator") == "relight" else None,
    )


def _times(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Returns vectors (V,3) after one linear map (3,3), or after one for each (V,3,3)."""
    return np.einsum("...ij,...j->...i", matrix, vectors)


def _turned(normal: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Returns normals of any length after `_times` of the points, but for the sign of the determinant."""
    rows = np.moveaxis(matrix, -2, 0)
    cofactors = np.stack([np.cross(rows[(k + 1) % 3], rows[(k + 2) % 3]) for k in range(3)], axis=-2)  # det times M^-T
    return _times(cofactors, normal.astype(np.float64))


def _uv(gltf: Gltf, primitive: dict[str, Any], surface: Surface, faces: np.ndarray) -> np.ndarray:
    """Returns the texture coordinates (F,3,2) of faces (F,3), zeros if the surface has no texture."""
    if surface.material is None or surface.material.texture is None:
        return np.zeros((len(faces), 3, 2))
    if (name := f"TEXCOORD_{surface.channel}") not in primitive["attributes"]:
        raise UserError(f"{gltf.path}: faces of the textured material {primitive['material']} have no {name}")
    uv = gltf.accessor(primitive["attributes"][name])
    if uv.dtype.kind in "iu" and "KHR_mesh_quantization" not in gltf.json.get("extensionsUsed", []):
        uv = uv / np.iinfo(uv.dtype.char).max  # whole numbers mean nothing else without that extension
    uv = uv @ surface.placement[:, :2].T + surface.placement[:, 2]
    return np.stack([uv[:, 0], 1 - uv[:, 1]], axis=-1)[faces]  # glTF counts v from the top


def _poses(gltf: Gltf, node: dict[str, Any]) -> list[str]:
    """Returns warnings of what moves the vertices of a node's mesh, and is not read: morphs, instances, animations."""
    weights = node.get("weights") or gltf.item("meshes", node["mesh"]).get("weights") or []
    left_out = {
        "animations": gltf.json.get("animations"),
        "morph targets": any(weights),
        "switches of visibility (KHR_node_visibility)": "KHR_node_visibility" in gltf.json.get("extensionsUsed", []),
        "copies (EXT_mesh_gpu_instancing)": "EXT_mesh_gpu_instancing" in node.get("extensions", {}),
    }
    return [f"its {what} are left out: apply them before export" for what, is_used in left_out.items() if is_used]


def _primitives(gltf: Gltf) -> Iterator[tuple[dict[str, Any], dict[str, Any], np.ndarray]]:
    """Yields the primitives of the default scene, or of all nodes if there is none, depth first.

    Each has its node, and the transform to the scene's frame: (4,4), or (V,4,4) for vertices of a skin.
    """
    placed = _transforms(gltf)
    for index, matrix in placed.items():
        node = gltf.item("nodes", index)
        if "mesh" in node:
            for primitive in gltf.item("meshes", node["mesh"])["primitives"]:
                yield node, primitive, _skinning(gltf, node, primitive, placed) if "skin" in node else matrix


def _transforms(gltf: Gltf) -> dict[int, np.ndarray]:
    """Returns the nodes that `_primitives` describes, and the transform (4,4) from the frame of each to the scene's."""
    nodes = gltf.json.get("nodes", [])
    if gltf.json.get("scenes"):
        roots = gltf.item("scenes", gltf.json.get("scene", 0)).get("nodes", [])
    else:
        roots = sorted(set(range(len(nodes))) - {child for node in nodes for child in node.get("children", [])})
    stack = [(root, np.eye(4)) for root in reversed(roots)]
    placed: dict[int, np.ndarray] = {}
    while stack:
        index, above = stack.pop()
        node = gltf.item("nodes", index)
        if index in placed:
            raise UserError(f"{gltf.path}: node {index} is reached twice; nodes must form a tree")
        placed[index] = above @ _matrix(node)
        stack += [(child, placed[index]) for child in reversed(node.get("children", []))]
    return placed


def _skinning(gltf: Gltf, node: dict[str, Any], primitive: dict[str, Any], placed: dict[int, np.ndarray]) -> np.ndarray:
    """Returns the transforms (V,4,4) of a primitive's vertices by the joints of its node's skin, in the pose as stored.

    By the standard, joints alone move a skin: the transform of the node with the mesh, and of its parents, is ignored.
    """
    skin, attributes = gltf.item("skins", node["skin"]), primitive["attributes"]
    joints = np.stack([placed[joint] for joint in skin["joints"]])
    if "inverseBindMatrices" in skin:
        joints = joints @ gltf.accessor(skin["inverseBindMatrices"])[: len(joints)].reshape(-1, 4, 4).swapaxes(1, 2)
    if not (sets := [number for number in range(len(attributes)) if f"JOINTS_{number}" in attributes]):
        return np.eye(4)
    index, weight = (
        np.concatenate([gltf.accessor(attributes[f"{name}_{number}"]) for number in sets], axis=1)
        for name in ("JOINTS", "WEIGHTS")
    )
    weight = weight.astype(np.float64)
    weight[~weight.any(axis=1), 0] = 1
    weight /= weight.sum(axis=1, keepdims=True)
    return sum((w[:, None, None] * joints[j] for w, j in zip(weight.T, index.T)), np.zeros((len(weight), 4, 4)))


def _matrix(node: dict[str, Any]) -> np.ndarray:
    """Returns a node's transform (4,4), from a column-major matrix or translation, rotation (x,y,z,w) and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    rotation = node.get("rotation", ())
    turned = Rotation.from_quat(rotation if any(rotation) else (0, 0, 0, 1)).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = turned * np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _triangles(gltf: Gltf, index: np.ndarray, mode: int) -> np.ndarray:
    """Returns the triangles (F,3), counter-clockwise, of a primitive's vertices; points and lines have none."""
    if mode == TRIANGLES:
        if len(index) % 3:
            raise UserError(f"{gltf.path}: {len(index)} indices do not make whole triangles")
        return index.reshape(-1, 3)
    if mode == TRIANGLE_STRIP and len(index) > 2:
        faces = np.stack([index[:-2], index[1:-1], index[2:]], axis=-1)
        faces[1::2] = faces[1::2, ::-1]  # every second one is wound the other way
        return faces
    if mode == TRIANGLE_FAN and len(index) > 2:
        return np.stack([np.broadcast_to(index[0], len(index) - 2), index[1:-1], index[2:]], axis=-1)
    return np.zeros((0, 3), np.int64)


def _surface(gltf: Gltf, number: int | None, notes: list[str]) -> Surface:
    """Reads a material of the file.

    It is matt unless the file gives its reflection (KHR_materials_specular): the defaults of glTF, which writers leave
    as they are, would make all scans glossy. `number` is None for faces without a material, and `notes` gets a warning
    if the color is out of range.
    """
    placement = np.eye(2, 3)
    if number is None:
        return Surface(None, placement, 0)
    entry = gltf.item("materials", number)
    base = entry.get("pbrMetallicRoughness", {})
    extensions = entry.get("extensions", {})
    legacy = extensions.get("KHR_materials_pbrSpecularGlossiness", {})  # in place of it
    given = {f"baseColor{key[7:]}": value for key, value in legacy.items() if key.startswith("diffuse")} or base
    factor, slot = given.get("baseColorFactor"), given.get("baseColorTexture")
    name = str(entry.get("name", ""))
    glow = entry.get("emissiveFactor"), entry.get("emissiveTexture")
    if slot is None and factor is not None and not any(factor[:3]) and (glow[1] or any(glow[0] or ())):
        factor, slot = glow if any(glow[0] or ()) else (None, glow[1])
        notes.append(f"the material {name or number!r} is black but for what it emits: this is taken as its color")
    if factor is None and slot is None:
        return Surface(None, placement, 0)
    color = np.array((factor or (1, 1, 1))[:3], np.float32)
    if color.max() > 1 or color.min() < 0:
        notes.append(f"the color of the material {name or number!r} is outside 0 to 1: it is clipped")
    gloss: dict[str, Any] = {}
    if (specular := extensions.get("KHR_materials_specular")) is not None:
        gloss = {"roughness": base.get("roughnessFactor", 1.0), "specular": specular.get("specularFactor", 1.0)}
        gloss = {key: min(1.0, max(0.0, float(value))) for key, value in gloss.items()}
    if slot is None:
        return Surface(Material(color, name=name, **gloss), placement, 0)
    texture, wrap = _texture(gltf, slot["index"])
    moved = slot.get("extensions", {}).get("KHR_texture_transform", {})
    c, s = np.cos(moved.get("rotation", 0)), np.sin(moved.get("rotation", 0))
    placement[:, :2] = np.array([[c, s], [-s, c]]) * np.array(moved.get("scale", (1, 1)))
    placement[:, 2] = moved.get("offset", (0, 0))
    channel = moved.get("texCoord", slot.get("texCoord", 0))
    return Surface(Material(color, texture, name, **gloss, wrap=wrap), placement, channel)


def _texture(gltf: Gltf, index: int) -> tuple[np.ndarray, tuple[str, str]]:
    """Reads the picture (H,W,3) of a texture, uint8 sRGB, and its wrap modes along u and v."""
    texture = gltf.item("textures", index)
    others = [texture.get("extensions", {}).get(name, {}).get("source") for name in PICTURE_FORMATS]
    source = next((image for image in (texture.get("source"), *others) if image is not None), None)
    if source is None:
        forms = ", ".join(texture.get("extensions", {})) or "no picture"
        raise UserError(f"{gltf.path}: texture {index} is given as {forms} only: save it as PNG or JPEG")
    sampler = gltf.item("samplers", texture["sampler"]) if "sampler" in texture else {}
    wrap = WRAPS[sampler.get("wrapS", DEFAULT_WRAP)], WRAPS[sampler.get("wrapT", DEFAULT_WRAP)]
    image = gltf.item("images", source)
    what = f"{gltf.path}: texture {image.get('name') or image.get('uri', '')[:60] or source}"
    data = gltf.resource(image["uri"]) if "uri" in image else bytes(gltf.view(image["bufferView"])[0])
    return read_texture(data, what, by_profile=False), wrap
