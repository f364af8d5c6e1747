"""What the readers of all formats share: triangles as a file has them, their checks, colors and textures."""

import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.srgb import LINEAR, decode
from relight.meshes.mesh import Material, Mesh

MAX_COORDINATE = 1e12  # units; larger ones are damage
MAX_STEP = 1e-4  # of the size, between neighbouring coordinates; above it a figure's small faces are lost
MAX_MATERIALS = 32767  # int16
MAX_FACES = 20_000_000  # 2.5 GB in memory; the largest body scans have 5 to 10 million


@dataclass
class RawMesh:
    """Triangles as a file has them, not yet checked.

    Attributes:
        vertices: (V,3) float64.
        faces: (F,3) of any integer type.
        materials: as in `Mesh`; None where the file says nothing of the color.
        uv: (F,3,2) or None.
        material: (F,) or None.
        color: (F,3,3) linear, per corner, or None.
        warnings: sentences for the report.
        normal: (V,3), zeros where the file has none, or None.
        axes: `up` and `front`, such as "+y", of a file that tells them.
    """

    vertices: np.ndarray
    faces: np.ndarray
    materials: list[Material | None]
    uv: np.ndarray | None = None
    material: np.ndarray | None = None
    color: np.ndarray | None = None
    warnings: list[str] = field(default_factory=list)
    normal: np.ndarray | None = None
    axes: dict[str, str] | None = None


def checked_mesh(raw: RawMesh, path: Path) -> Mesh:
    """Checks what a reader found, and makes a mesh of it.

    Up to 1 % of non-finite vertices are left for `clean`. Coordinates far from the origin (geographic ones) are moved
    to it before they are rounded to float32; info["origin"] is where they were.

    Args:
        raw: of the reader.
        path: of the file.

    Raises:
        UserError: if there are no faces, too many, or ones out of range; if too many vertices are not finite, or all
            are at one point.
    """
    vertices, faces = np.asarray(raw.vertices, np.float64), np.asarray(raw.faces)
    if not len(faces) or not len(vertices):
        raise UserError(f"{path} has no faces: relight needs a surface")
    if len(faces) > MAX_FACES:
        raise UserError(f"{path} has {len(faces)} faces; up to {MAX_FACES} are read: decimate it first")
    if len(raw.materials) > MAX_MATERIALS:
        raise UserError(f"{path} has {len(raw.materials)} materials; up to {MAX_MATERIALS} are read: join them")
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= len(vertices):
        wrong = low if low < 0 else high
        raise UserError(f"{path}: a face names vertex {wrong} (counted from 0), but there are {len(vertices)} vertices")
    finite = np.isfinite(vertices).all(axis=-1)
    usable = np.asarray(finite & (np.abs(vertices) < MAX_COORDINATE).all(axis=-1))
    if (~usable).sum() > 0.01 * len(vertices):
        count, what = int((~finite).sum()), "are not finite numbers"
        if not count:
            count, what = int((~usable).sum()), f"have coordinates beyond {MAX_COORDINATE:g}"
        raise UserError(f"{path}: {count} of {len(vertices)} vertices {what}; 1 % is let pass")
    if not usable.all():
        vertices = np.where(usable[:, None], vertices, np.nan)
    lowest, highest = np.fmin.reduce(vertices, axis=0), np.fmax.reduce(vertices, axis=0)
    if (size := float((highest - lowest).max())) == 0:
        raise UserError(f"{path}: all vertices lie at one point")
    centre = (lowest + highest) / 2
    warnings = [*raw.warnings, *_colorless(raw), *_rounding(vertices, size)]
    info: dict[str, Any] = {"name": path.stem, "source": path.name, "warnings": warnings}
    if raw.axes:
        info["axes"] = raw.axes
    if np.abs(centre).max() > 1000 * size:  # float32 would leave under 14 bits for the figure itself
        vertices = vertices - centre
        info["origin"] = centre.tolist()
        warnings.append("it is far from 0: ({:.9g}, {:.9g}, {:.9g}) is subtracted from its coordinates".format(*centre))
    uv = np.zeros((len(faces), 3, 2), np.float32) if raw.uv is None else np.where(np.isfinite(raw.uv), raw.uv, 0)
    return Mesh(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32, copy=False),
        uv=uv.astype(np.float32, copy=False),
        material=np.zeros(len(faces), np.int16) if raw.material is None else raw.material.astype(np.int16),
        materials=[material or Material() for material in raw.materials],
        color=None if raw.color is None else np.nan_to_num(raw.color).clip(0, 1).astype(np.float32),
        info=info,
        normal=None if raw.normal is None else np.nan_to_num(raw.normal).astype(np.float32),
    )


def _colorless(raw: RawMesh) -> list[str]:
    """Returns warnings of faces without any color, of a mesh that is white, and of one that is mostly black."""
    of_face = np.zeros(len(raw.faces), int) if raw.material is None else raw.material
    given = [material or Material() for material in raw.materials]
    black = np.array([not (m.color.any() and (m.texture is None or m.texture.any())) for m in given])[of_face]
    if raw.color is not None:
        black |= ~raw.color.any(axis=(1, 2))
    if 2 * black.sum() > len(black):
        return [f"{int(black.sum())} of {len(black)} faces are black: see where the file keeps its colors"]
    if raw.color is None and None in raw.materials:
        if not any(raw.materials):
            return ["the file has neither materials nor vertex colors: the albedo is white"]
        bare = np.array([material is None for material in raw.materials])[of_face]
        return [f"{int(bare.sum())} of {len(bare)} faces have neither a material nor vertex colors: they are white"]
    is_white = all(m.texture is None and m.color.min() > 0.999 for m in given)
    if is_white and (raw.color is None or np.fmin.reduce(raw.color, axis=None) > 0.999):
        return ["its materials and vertex colors are all white: see where the file keeps its colors"]
    return []


def _rounding(vertices: np.ndarray, size: float) -> list[str]:
    """Returns a warning, or none, about coordinates far from the origin that were exported in single precision."""
    step = float(np.spacing(np.float32(np.nanmax(np.abs(vertices)))))
    if step < MAX_STEP * size or not (np.isnan(vertices) | (vertices.astype(np.float32) == vertices)).all():
        return []
    return [f"its coordinates are rounded to steps of {step:.2g}, {step / size:.1%} of its size: export it nearer to 0"]


def unit_colors(values: np.ndarray, what: str) -> tuple[np.ndarray, list[str]]:
    """Scales colors, whose writers give them in [0,1] or as codes of 8 or 16 bits, to [0,1].

    Integers are codes. Floats are codes if one is above 2; up to there they are rounding errors, which are clipped.

    Args:
        values: of any shape and type.
        what: names the colors in warnings.

    Returns:
        uint8 codes as they are, else floats in [0,1]; and warnings where the numbers can mean two things.
    """
    if values.dtype.itemsize == 1:
        codes, unlikely = values.view(np.uint8), f"{what}: values up to 1 are taken as codes of 0 to 255"
        return codes, [unlikely] if codes.max(initial=0) == 1 else []
    is_integer = values.dtype.kind in "iu"
    least, largest = (float(extreme.reduce(values, axis=None, initial=0)) for extreme in (np.fmin, np.fmax))
    not_numbers = 0 if is_integer else int(np.isnan(values).sum())
    notes = []
    if not_numbers:
        notes.append(f"{what}: {not_numbers} values are not numbers; they are treated as 0")
    if least < -0.001:
        notes.append(f"{what}: values down to {least:g} are clipped to 0")
    if not is_integer and (largest <= 2 or not np.isfinite(largest)):
        if largest > 1.001:
            notes.append(f"{what}: values up to {largest:g} are clipped to 1")
        return np.nan_to_num(values, nan=0).clip(0, 1), notes
    scales = (2**8 - 1, 2**16 - 1, 2**31 - 1, 2**32 - 1)
    scale = next((scale for scale in scales if largest <= scale), scales[-1])
    if largest <= 1 or (scale == 255 and values.dtype.itemsize == 2) or scale > 65535:
        notes.append(f"{what}: values up to {largest:g} are taken as codes of 0 to {scale}")
    return np.nan_to_num(values / scale, nan=0).clip(0, 1), notes


def without_tints(raw: RawMesh) -> RawMesh:
    """Leaves one color to each face where a format may give several that mean the same: .obj and .ply.

    A texture counts before vertex colors, and these before the material's color unless they are all white. glTF
    multiplies them; programs that write both into other formats mean the same color twice.
    """
    if raw.color is None:
        return raw
    has_texture = np.array([material is not None and material.texture is not None for material in raw.materials])
    is_tinted = any(m is not None and m.texture is None and (m.color < 1).any() for m in raw.materials)
    colored = np.full(len(raw.faces), True) if raw.material is None else ~has_texture[raw.material]
    colored &= not has_texture.all()  # (F,) whether a face is shown in its vertex colors
    if (is_tinted or has_texture.any()) and np.fmin.reduce(raw.color, axis=None, initial=1) > 0.999:  # all white
        return replace(raw, color=None)
    if not colored.any():
        return replace(raw, color=None, warnings=[*raw.warnings, "its vertex colors are left out: it has textures"])
    notes = ["its vertex colors are used in place of the colors of its materials"] if is_tinted else []
    materials = [m if m is None or m.texture is not None else Material() for m in raw.materials]
    if not has_texture.any():
        return replace(raw, materials=materials, warnings=raw.warnings + notes)
    notes.append(f"its vertex colors are used on the {int(colored.sum())} faces that have no texture")
    color = np.where(colored[:, None, None], raw.color, 1)
    return replace(raw, color=color, materials=materials, warnings=raw.warnings + notes)


def parse_numbers(path: Path, text: bytes, type: type) -> np.ndarray:
    """Parses the numbers between spaces in a part of a file, (N,) of a type of NumPy.

    Raises:
        UserError: if a word is no number.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # numpy warns when it stops at a word that is no number
        try:
            return np.fromstring(text, type, sep=" ")
        except (DeprecationWarning, ValueError):
            raise UserError(f"{path} is damaged: it holds something that is not a number") from None


def linear(srgb: np.ndarray) -> np.ndarray:
    """Decodes sRGB codes of any shape, uint8 or floats that are clipped to [0,1], to linear float32."""
    return LINEAR[srgb] if srgb.dtype == np.uint8 else decode(np.clip(srgb, 0, 1)).astype(np.float32)
