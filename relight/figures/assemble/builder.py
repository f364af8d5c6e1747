"""Collects the parts of a mesh, with materials that may depend on the outfit."""

from typing import Any

import numpy as np

from relight.figures.draw.outfits import Outfit
from relight.figures.dye.gloss import with_gloss
from relight.figures.dye.paints import Paint
from relight.meshes import Material, Mesh


class Builder:
    """Collects the parts of a mesh. Parts share no vertices, so normals are smooth within a part only.

    Attributes:
        vertices, faces, uv, material, layers: of each part, as in `Mesh`; (F,) layers as in `add`.
        paints: the materials, or functions that give them, by number.
        offset: number of the vertices so far.
    """

    def __init__(self) -> None:
        self.vertices: list[np.ndarray] = []
        self.faces: list[np.ndarray] = []
        self.uv: list[np.ndarray] = []
        self.material: list[np.ndarray] = []
        self.layers: list[np.ndarray] = []
        self.paints: list[Paint] = []
        self.offset = 0

    def add(
        self, vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None, paint: Paint, layer: int = -1
    ) -> None:
        """Adds a part.

        Args:
            vertices: (V,3) metres; those without faces are dropped.
            faces: (F,3).
            uv: (F,3,2) per corner, or None.
            paint: parts that are given the same object share their material.
            layer: for `checks.poke_through`: 0 the skin, 1, 2, ... the clothes outward, -1 anything else.
        """
        number = next((k for k, known in enumerate(self.paints) if known is paint), len(self.paints))
        if number == len(self.paints):
            self.paints.append(paint)
        used, inverse = np.unique(faces, return_inverse=True)
        self.vertices.append(vertices[used].astype(np.float32))
        self.faces.append(inverse.reshape(-1, 3).astype(np.int32) + self.offset)
        self.uv.append(np.zeros((len(faces), 3, 2), np.float32) if uv is None else uv.astype(np.float32))
        self.material.append(np.full(len(faces), number, np.int16))
        self.layers.append(np.full(len(faces), layer, np.int16))
        self.offset += len(used)

    def mesh(self, info: dict[str, Any], outfits: list[Outfit]) -> Mesh:
        """Returns the mesh, moved to stand on y = 0.

        Args:
            info: its record.
            outfits: the first gives the materials of the mesh, the others those of its further outfits.
        """
        painted = [  # for each outfit the materials by number; those that no outfit changes in the first one only
            {
                number: with_gloss(paint if isinstance(paint, Material) else paint(outfit), outfit)
                for number, paint in enumerate(self.paints)
                if outfit is outfits[0] or not isinstance(paint, Material)
            }
            for outfit in outfits
        ]
        vertices = np.concatenate(self.vertices)
        vertices[:, 1] -= vertices[:, 1].min()
        faces, uv, material = map(np.concatenate, (self.faces, self.uv, self.material))
        first, *others = painted
        return Mesh(vertices, faces, uv, material, list(first.values()), info=info, outfits=others)
