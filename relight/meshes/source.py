"""What a reader found in a file, and the checks that make a mesh record of it."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from relight.files import UserError
from relight.meshes.mesh import Material, Mesh

LARGEST = 1e12  # of a coordinate
COARSE = 1e-4  # of the size: steps of a figure's coordinates from which on its small faces are lost
MAX_FACES = 20_000_000  # 2.5 GB as a record; the largest body scans have 5 to 10 million


@dataclass
class Source:
    """Triangles as a file has them: vertices (V,3) float64, faces (F,3) of any integer type, the rest as in Mesh.

    uv (F,3,2), material (F,) and color (V,3) may be None; `warnings` are sentences for the report.
    """

    vertices: np.ndarray
    faces: np.ndarray
    materials: list[Material]
    uv: np.ndarray | None = None
    material: np.ndarray | None = None
    color: np.ndarray | None = None
    warnings: list[str] = field(default_factory=list)


def record(source: Source, path: Path) -> Mesh:
    """The mesh record of `source`, checked: what passes here can be indexed and computed with.

    A few non-finite vertices are left to `clean`; more than 1 %, faces out of range or none at all raise UserError.
    Coordinates far from the origin (geographic ones) are moved there before they are rounded to float32;
    info["origin"] is where they came from.
    """
    vertices, faces = np.asarray(source.vertices, np.float64), np.asarray(source.faces)
    if not len(faces) or not len(vertices):
        raise UserError(f"{path} has no faces: relight needs a surface")
    if len(faces) > MAX_FACES:
        raise UserError(f"{path} has {len(faces)} faces; up to {MAX_FACES} are read: decimate it first")
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= len(vertices):
        wrong = low if low < 0 else high
        raise UserError(f"{path}: a face names vertex {wrong} (counted from 0), but there are {len(vertices)} vertices")
    finite = np.isfinite(vertices).all(axis=-1)
    usable = finite & (np.abs(vertices) < LARGEST).all(axis=-1)
    if (~usable).sum() > 0.01 * len(vertices):
        count, what = int((~finite).sum()), "are not finite numbers"
        if not count:
            count, what = int((~usable).sum()), f"have coordinates beyond {LARGEST:g}"
        raise UserError(f"{path}: {count} of {len(vertices)} vertices {what}; 1 % is let pass")
    vertices = np.where(usable[:, None], vertices, np.nan)
    lowest, highest = np.nanmin(vertices, axis=0), np.nanmax(vertices, axis=0)
    size = float((highest - lowest).max())
    if size == 0:
        raise UserError(f"{path}: all vertices lie at one point")
    centre = (lowest + highest) / 2
    warnings = [*source.warnings, *_rounded(vertices, size)]
    info = {"name": path.stem, "source": path.name, "warnings": warnings}
    if np.abs(centre).max() > 1000 * size:  # float32 would leave under 14 bits for the figure itself
        vertices = vertices - centre
        info["origin"] = centre.tolist()
    uv = np.zeros((len(faces), 3, 2)) if source.uv is None else np.where(np.isfinite(source.uv), source.uv, 0)
    return Mesh(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        uv=uv.astype(np.float32),
        material=np.zeros(len(faces), np.int16) if source.material is None else source.material.astype(np.int16),
        materials=source.materials,
        color=None if source.color is None else np.nan_to_num(source.color).clip(0, 1).astype(np.float32),
        info=info,
    )


def _rounded(vertices: np.ndarray, size: float) -> list[str]:
    """A warning where whoever wrote the file rounded the coordinates (V,3) to single precision far from the origin."""
    step = float(np.spacing(np.float32(np.nanmax(np.abs(vertices)))))
    if step < COARSE * size or not (np.isnan(vertices) | (vertices.astype(np.float32) == vertices)).all():
        return []
    return [
        f"its coordinates are rounded to steps of {step:.2g}, {step / size:.1%} of its size: move it to the origin "
        "before it is exported in single precision"
    ]
