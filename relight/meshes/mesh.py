"""The mesh record of generated figures and scans."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.core.npz import read_npz

REPEAT, CLAMP, MIRROR = "repeat", "clamp", "mirror"  # how a texture goes on beyond its edge

ARRAYS = ("vertices", "faces", "uv", "material")  # of a mesh; it always has them


@dataclass
class Material:
    """A diffuse albedo, color times texture, and the gloss on top of it, as glTF 2.0 defines both.

    Attributes:
        color: (3,) linear RGB in [0,1].
        texture: (H,W,3) uint8 sRGB, row 0 at the top, or None; uv (0,0) is its bottom left corner, as in OBJ.
        name: what the surface is, "skin" or "jeans"; "" where a file does not say.
        roughness: in [0,1], the square root of GGX's alpha.
        specular: in [0,1], reflectance at right angles as a share of 4 %; 0 is matt.
        wrap: how the texture goes on along u and v: REPEAT, CLAMP or MIRROR.
    """

    color: np.ndarray = field(default_factory=lambda: np.ones(3, np.float32))
    texture: np.ndarray | None = None
    name: str = ""
    roughness: float = 1.0
    specular: float = 0.0
    wrap: tuple[str, str] = (REPEAT, REPEAT)


@dataclass
class Mesh:
    """Triangles with albedo. Units and frame are those of the file until `align`, then of docs/conventions.md.

    Attributes:
        vertices: (V,3) float32.
        faces: (F,3) int32, counter-clockwise outward.
        uv: (F,3,2) float32 texture coordinates per corner; zeros where unused.
        material: (F,) int16, indices into `materials`.
        materials: of the faces.
        color: (F,3,3) float32, linear colors per corner that the materials are multiplied by, or None.
        info: plain JSON values that are carried from rule to rule: name, subject, source, repairs and so on.
        outfits: further looks of the same surface: for each, the materials that differ from `materials`, by number.
        normal: (V,3) float32 normals of the file, zeros where it has none; or None. Baking per vertex takes them; what
            changes the mesh drops them.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    material: np.ndarray
    materials: list[Material]
    color: np.ndarray | None = None
    info: dict[str, Any] = field(default_factory=dict)
    outfits: list[dict[int, Material]] = field(default_factory=list)
    normal: np.ndarray | None = None

    def dressed(self, outfit: int) -> "Mesh":
        """Returns the mesh in one of its outfits: 0 is its own, which it comes with."""
        other = self.outfits[outfit - 1] if outfit else {}
        materials = [other.get(i, material) for i, material in enumerate(self.materials)]
        return replace(self, materials=materials, outfits=[])

    def save(self, path: Path) -> None:
        """Writes the mesh as .npz, whole or not at all.

        Properties of a material have its number in their name, and after a point the number of a further outfit. What
        has its default is left out.
        """
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ARRAYS}
        if self.color is not None:
            arrays["color"] = self.color
        for outfit, materials in enumerate([dict(enumerate(self.materials)), *self.outfits]):
            for i, material in materials.items():
                name = f"{i}.{outfit}" if outfit else f"{i}"
                arrays[f"color{name}"], arrays[f"name{name}"] = material.color, np.array(material.name)
                if material.texture is not None:
                    arrays[f"texture{name}"] = material.texture
                if material.specular:
                    arrays[f"gloss{name}"] = np.array([material.roughness, material.specular], np.float32)
                if material.wrap != (REPEAT, REPEAT):
                    arrays[f"wrap{name}"] = np.array(material.wrap)
        arrays["info"] = np.array(json.dumps(self.info))
        arrays |= {"count": np.array(len(self.materials)), "outfits": np.array(len(self.outfits))}
        with atomic_write(path) as tmp, open(tmp, "wb") as file:
            np.savez(file, **arrays)

    @classmethod
    def load(cls, path: Path) -> "Mesh":
        """Reads a mesh that `save` wrote; raises UserError on any other file."""
        data = read_npz(path, "mesh record")
        try:
            materials = [_material(data, f"{i}") for i in range(int(data["count"]))]
            outfits = [
                {i: _material(data, f"{i}.{k}") for i in range(len(materials)) if f"color{i}.{k}" in data}
                for k in range(1, int(data.get("outfits", 0)) + 1)
            ]
            info = json.loads(str(data["info"]))
            arrays = {name: data[name] for name in ARRAYS}
            return cls(**arrays, materials=materials, color=data.get("color"), info=info, outfits=outfits)
        except (KeyError, ValueError, TypeError, RecursionError) as error:
            raise UserError(f"{path} is not a mesh record of relight ({error})") from None


def _material(data: dict[str, np.ndarray], name: str) -> Material:
    """Returns the material whose arrays `Mesh.save` named so: "2" is material 2, "2.1" that in outfit 1."""
    roughness, specular = map(float, data.get(f"gloss{name}", (1, 0)))
    color, texture = data[f"color{name}"], data.get(f"texture{name}")
    u, v = map(str, data.get(f"wrap{name}", (REPEAT, REPEAT)))
    return Material(color, texture, str(data.get(f"name{name}", "")), roughness, specular, (u, v))
