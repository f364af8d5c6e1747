"""The mesh record of generated figures and scans."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from relight.files import UserError, whole


@dataclass
class Material:
    """A diffuse albedo, colour times texture.

    Attributes:
        color: (3,) linear RGB in [0,1].
        texture: (H,W,3) uint8 sRGB, row 0 at the top, or None; uv (0,0) is its bottom left corner, as in OBJ.
    """

    color: np.ndarray = field(default_factory=lambda: np.ones(3, np.float32))
    texture: np.ndarray | None = None


@dataclass
class Mesh:
    """Triangles with albedo. Units and frame are those of the file until `align`, then of docs/conventions.md.

    Attributes:
        vertices: (V,3) float32.
        faces: (F,3) int32, counter-clockwise outward.
        uv: (F,3,2) float32 texture coordinates per corner; zeros where unused.
        material: (F,) int16, indices into `materials`.
        materials: of the faces.
        color: (V,3) float32, linear vertex colours that the materials are multiplied by, or None.
        info: plain JSON values that are carried from stage to stage: name, subject, source, repairs and so on.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    material: np.ndarray
    materials: list[Material]
    color: np.ndarray | None = None
    info: dict = field(default_factory=dict)

    def save(self, path: Path) -> None:
        """Writes the mesh as .npz, whole or not at all."""
        arrays = {"vertices": self.vertices, "faces": self.faces, "uv": self.uv, "material": self.material}
        if self.color is not None:
            arrays["color"] = self.color
        for i, material in enumerate(self.materials):
            arrays[f"color{i}"] = material.color
            if material.texture is not None:
                arrays[f"texture{i}"] = material.texture
        with whole(path) as tmp, open(tmp, "wb") as file:
            np.savez(file, **arrays, info=np.array(json.dumps(self.info)), count=np.array(len(self.materials)))

    @classmethod
    def load(cls, path: Path) -> "Mesh":
        """Reads a mesh that `save` wrote; raises UserError on any other file."""
        try:
            with np.load(path, allow_pickle=False) as data:
                materials = [
                    Material(data[f"color{i}"], data[f"texture{i}"] if f"texture{i}" in data else None)
                    for i in range(int(data["count"]))
                ]
                return cls(
                    vertices=data["vertices"],
                    faces=data["faces"],
                    uv=data["uv"],
                    material=data["material"],
                    materials=materials,
                    color=data["color"] if "color" in data else None,
                    info=json.loads(str(data["info"])),
                )
        except (OSError, KeyError, ValueError, EOFError, BadZipFile) as error:
            raise UserError(f"{path} is not a mesh record of relight ({error})") from None
