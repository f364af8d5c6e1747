"""What the readers of all formats share: triangles as a file has them, their checks, polygons and textures."""

import io
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from relight.files import UserError
from relight.meshes.mesh import Material, Mesh
from relight.srgb import LINEAR, decode

MAX_COORDINATE = 1e12
MAX_STEP = 1e-4  # of the size, between neighbouring coordinates; above it a figure's small faces are lost
MAX_FACES = 20_000_000  # 2.5 GB in memory; the largest body scans have 5 to 10 million


@dataclass
class RawMesh:
    """Triangles as a file has them, not yet checked.

    Attributes:
        vertices: (V,3) float64.
        faces: (F,3) of any integer type.
        materials: as in `Mesh`.
        uv: (F,3,2) or None.
        material: (F,) or None.
        color: (V,3) or None.
        warnings: sentences for the report.
    """

    vertices: np.ndarray
    faces: np.ndarray
    materials: list[Material]
    uv: np.ndarray | None = None
    material: np.ndarray | None = None
    color: np.ndarray | None = None
    warnings: list[str] = field(default_factory=list)


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
    vertices = np.where(usable[:, None], vertices, np.nan)
    lowest, highest = np.nanmin(vertices, axis=0), np.nanmax(vertices, axis=0)
    size = float((highest - lowest).max())
    if size == 0:
        raise UserError(f"{path}: all vertices lie at one point")
    centre = (lowest + highest) / 2
    info = {"name": path.stem, "source": path.name, "warnings": [*raw.warnings, *_rounding(vertices, size)]}
    if np.abs(centre).max() > 1000 * size:  # float32 would leave under 14 bits for the figure itself
        vertices = vertices - centre
        info["origin"] = centre.tolist()
    uv = np.zeros((len(faces), 3, 2)) if raw.uv is None else np.where(np.isfinite(raw.uv), raw.uv, 0)
    return Mesh(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        uv=uv.astype(np.float32),
        material=np.zeros(len(faces), np.int16) if raw.material is None else raw.material.astype(np.int16),
        materials=raw.materials,
        color=None if raw.color is None else np.nan_to_num(raw.color).clip(0, 1).astype(np.float32),
        info=info,
    )


def _rounding(vertices: np.ndarray, size: float) -> list[str]:
    """Returns a warning if coordinates (V,3) far from the origin were rounded to single precision before they came."""
    step = float(np.spacing(np.float32(np.nanmax(np.abs(vertices)))))
    if step < MAX_STEP * size or not (np.isnan(vertices) | (vertices.astype(np.float32) == vertices)).all():
        return []
    return [
        f"its coordinates are rounded to steps of {step:.2g}, {step / size:.1%} of its size: move it to the origin "
        "before it is exported in single precision"
    ]


def fan(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cuts polygons, whose corners are in one flat list, into triangle fans.

    Args:
        counts: (P,) of the polygons' corners; polygons of fewer than three give no triangle.

    Returns:
        Positions (F,3) of the triangles' corners in the flat list, and the polygon (F,) of each triangle.

    >>> fan(np.array([3, 4]))[0].tolist()
    [[0, 1, 2], [3, 4, 5], [3, 5, 6]]
    """
    counts = np.asarray(counts, np.int64)
    start = np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(counts) else counts
    if len(counts) and (counts == 3).all():
        return start[:, None] + np.arange(3), np.arange(len(counts))
    pieces = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), pieces)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first = start[polygon]
    return np.stack([first, first + step + 1, first + step + 2], axis=-1), polygon


def linear(srgb: np.ndarray) -> np.ndarray:
    """Decodes sRGB codes of any shape, uint8 or floats that are clipped to [0,1], to linear float32."""
    if srgb.dtype == np.uint8:
        return LINEAR[srgb]
    return decode(np.clip(srgb, 0, 1)).astype(np.float32)


def read_texture(source: Path | bytes, what: str) -> np.ndarray:
    """Reads a picture; alpha is dropped, 16 bits become 8.

    Args:
        source: a file, or its bytes.
        what: names the picture in error messages.

    Returns:
        (H,W,3) uint8 sRGB, row 0 at the top.

    Raises:
        UserError: if it is not a whole picture of at most 178 million pixels (Pillow's bound for decompression bombs).
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # warns from half the bound on
            image = Image.open(source if isinstance(source, Path) else io.BytesIO(source))
        with image:
            if image.mode.startswith("I"):  # Pillow clips 16-bit grey to 8 bits instead of scaling it
                grey = np.clip(np.asarray(image).astype(np.int64) // 256, 0, 255).astype(np.uint8)
                return np.repeat(grey[..., None], 3, axis=-1)
            return np.ascontiguousarray(np.asarray(image.convert("RGB")))
    except UnidentifiedImageError:
        raise UserError(f"{what} is not a picture; PNG, JPEG, TIFF, TGA, BMP and WebP are read") from None
    except Image.DecompressionBombError:
        raise UserError(f"{what} has more than 178 million pixels: scale it down") from None
    except PermissionError:
        raise UserError(f"{what} cannot be read: permission denied") from None
    except Exception as error:  # Pillow's decoders raise a dozen types over damaged files
        reason = str(error).split("\n")[0] or type(error).__name__
        raise UserError(f"{what} cannot be read ({reason}): it is damaged") from None
