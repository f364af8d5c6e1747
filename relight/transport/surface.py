"""What the surface looks like at a hit: albedo and shading normal."""

import numpy as np

from relight.files import UserError
from relight.meshes.mesh import Mesh
from relight.srgb import LINEAR


def sample(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Bilinear lookup in `texture` (H, W, 3) uint8 sRGB at `uv` (N, 2), as (N, 3) linear float32.

    uv (0, 0) is the bottom left corner of the picture, and it repeats. Texels are decoded before they are mixed.
    """
    height, width = texture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x), np.floor(y)
    across, down = (x - left).astype(np.float32)[:, None], (y - top).astype(np.float32)[:, None]
    columns = [(left + k).astype(np.int64) % width for k in (0, 1)]
    rows = [(top + k).astype(np.int64) % height for k in (0, 1)]
    upper, lower = (
        LINEAR[texture[row, columns[0]]] * (1 - across) + LINEAR[texture[row, columns[1]]] * across for row in rows
    )
    return upper * (1 - down) + lower * down


def albedo(mesh: Mesh, face: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Linear albedo (N, 3) float32 at faces (N,) and barycentric weights (N, 3).

    Texture times material colour times interpolated vertex colour. UserError when a face's material is missing or
    what it looks up is not finite.
    """
    material = mesh.material[face]
    if len(material) and not 0 <= material.min() <= material.max() < len(mesh.materials):
        raise UserError(
            f"the mesh has {len(mesh.materials)} materials but its faces use others, up to {material.max()}"
        )
    result = np.empty((len(face), 3), np.float32)
    for index in np.unique(material):
        surface = mesh.materials[index]
        chosen = material == index
        value = np.broadcast_to(np.asarray(surface.color, np.float32), (chosen.sum(), 3))
        if surface.texture is not None:
            uv = np.einsum("nc,ncx->nx", weights[chosen], mesh.uv[face[chosen]])
            if not np.isfinite(uv).all():
                raise UserError("the mesh has texture coordinates that are not finite: repair or drop them")
            value = value * sample(surface.texture, uv)
        result[chosen] = value
    if mesh.color is not None:
        result *= np.einsum("nc,ncx->nx", weights, mesh.color[mesh.faces[face]]).astype(np.float32)
    if not np.isfinite(result).all():
        raise UserError("the mesh has colours that are not finite: repair or drop them")
    return result.clip(0, 1)


def shading_normals(
    vertex_normals: np.ndarray, faces: np.ndarray, face: np.ndarray, weights: np.ndarray, geometric: np.ndarray
) -> np.ndarray:
    """Interpolated unit normals (N, 3) float64 on the side of the `geometric` normals (N, 3).

    Where interpolation gives no direction, or one more than 78 degrees from the face's own, which smooth surfaces
    never do (torn or inconsistently wound scans), the geometric normal stands in.
    """
    normal = np.einsum("nc,ncx->nx", weights, vertex_normals[faces[face]].astype(np.float64))
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.einsum("nx,nx->n", normal, geometric)[:, None]
    usable = (length > 1e-6) & (facing > 0.2 * length)
    return np.where(usable, normal / np.where(usable, length, 1), geometric)
