"""Writes figures for other programs: binary glTF with embedded textures."""

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from relight.core.files import atomic_write
from relight.meshes import Mesh, vertex_normals

LICENCE = "CC0-1.0"  # of generated figures
CC0 = {
    "copyright": "No rights reserved: dedicated to the public domain under CC0 1.0",
    "extras": {"license": LICENCE, "url": "https://creativecommons.org/publicdomain/zero/1.0/"},
}
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


def write_glb(mesh: Mesh, path: Path) -> None:
    """Writes binary glTF 2.0, whole or not at all: a node named after the figure, with a child for each material.

    Units and frame are those of glTF: metres, y up, facing +z. The root node's `extras` are the mesh's info, those of
    the asset are its licence if that is CC0.

    Args:
        mesh: a generated figure, in its own outfit.
        path: path of the .glb.
    """
    import trimesh
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    scene, normals = trimesh.Scene(), vertex_normals(mesh)
    shown = []  # the materials of the scene's parts
    for number, material in enumerate(mesh.materials):
        index, uv, faces = corners(mesh, number)
        if not len(faces):
            continue
        picture = None if material.texture is None else Image.fromarray(material.texture)
        # The number tells materials apart, which trimesh would join where only what it rounds differs.
        visual = TextureVisuals(uv, PBRMaterial(name=str(number), baseColorTexture=picture, doubleSided=True))
        points, outward = mesh.vertices[index], normals[index]
        part = trimesh.Trimesh(points, faces, vertex_normals=outward, visual=visual, process=False)
        name = material.name or f"part {number}"
        scene.add_geometry(part, node_name=name, geom_name=name)
        shown.append(material)

    def complete(tree: dict[str, Any]) -> None:
        """Adds to the JSON what trimesh leaves out, and the colors, which it rounds to 8 bits of linear light."""
        for part, material in zip(tree["meshes"], shown):
            entry = tree["materials"][part["primitives"][0]["material"]]
            entry |= {"name": material.name, "extensions": {SPECULAR: {"specularFactor": material.specular}}}
            surface = entry.setdefault("pbrMetallicRoughness", {})
            surface |= {"baseColorFactor": [*map(float, material.color), 1.0], "metallicFactor": 0.0}
            surface["roughnessFactor"] = material.roughness
        root = {"name": mesh.info.get("name", "figure"), "children": tree["scenes"][0]["nodes"], "extras": mesh.info}
        tree["scenes"][0]["nodes"] = [len(tree["nodes"])]
        tree["nodes"].append(root)
        tree["asset"] = {"version": "2.0", "generator": "relight"}
        if mesh.info.get("licence") == LICENCE:
            tree["asset"] |= CC0
        tree["extensionsUsed"] = [SPECULAR]

    data = scene.export(file_type="glb", include_normals=True, unitize_normals=False, tree_postprocessor=complete)
    with atomic_write(path) as tmp:
        tmp.write_bytes(data)
