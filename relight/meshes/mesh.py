"""The mesh record that generated figures and scans share."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from relight.files import UserError, whole
from relight.npz import read_npz


@dataclass
class Material:
    """A diffuse albedo: `color` (3,) linear RGB in [0,1], times `texture` (H,W,3) uint8 sRGB when there is one.

    Texture rows run from the top; uv (0,0) is the bottom-left corner of the picture, as in OBJ.
    """

    color: np.ndarray = field(default_factory=lambda: np.ones(3, np.float32))
    texture: np.ndarray | None = None


@dataclass
class Mesh:
    """Triangles with albedo.

    vertices (V,3) float32; faces (F,3) int32; material (F,) int16 indexes `materials`; uv (F,3,2) float32 per corner
    (zeros where unused); color (V,3) float32 linear vertex albedo or None, multiplied onto the material's;
    info: plain JSON values: `name`, `subject`, `source`, `repairs`, ... , carried from stage to stage.
    Units and frame are the source's until `align`; after it, those of docs/conventions.md.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    material: np.ndarray
    materials: list[Material]
    color: np.ndarray | None = None
    info: dict = field(default_factory=dict)

    def save(self, path: Path) -> None:
        """Writes an .npz, whole or not at all."""
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
        """Reads what `save` wrote. Raises UserError on anything else."""
        data = read_npz(path, "mesh record")
        try:
            materials = [Material(data[f"color{i}"], data.get(f"texture{i}")) for i in range(int(data["count"]))]
            info = json.loads(str(data["info"]))
            names = ("vertices", "faces", "uv", "material")
            return cls(**{name: data[name] for name in names}, materials=materials, color=data.get("color"), info=info)
        except (KeyError, ValueError, TypeError, RecursionError) as error:
            raise UserError(f"{path} is not a mesh record of relight ({error})") from None
