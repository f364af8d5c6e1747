"""Samples albedo, gloss and shading normals at points of the surface."""

import numpy as np

from relight.core.errors import UserError
from relight.core.srgb import LINEAR
from relight.meshes import Mesh
from relight.meshes.mesh import CLAMP, MIRROR, REPEAT


def _wrapped(texel: np.ndarray, size: int, mode: str) -> np.ndarray:
    """Returns the numbers of texels in [0,size) that stand for texels beyond the edges, in one direction.

    >>> [_wrapped(np.arange(-2, 4), 2, mode).tolist() for mode in (REPEAT, CLAMP, MIRROR)]
    [[0, 1, 0, 1, 0, 1], [0, 0, 0, 1, 1, 1], [1, 0, 0, 1, 1, 0]]
    """
    if mode == CLAMP:
        return texel.clip(0, size - 1)
    if mode == MIRROR:
        there = texel % (2 * size)
        return np.minimum(there, 2 * size - 1 - there)
    return texel % size


def _sample_texture(texture: np.ndarray, uv: np.ndarray, wrap: tuple[str, str] = (REPEAT, REPEAT)) -> np.ndarray:
    """Looks up a texture (H,W,3) uint8 sRGB bilinearly at uv (N,2): (N,3) float32 linear.

    Texels are decoded before they are interpolated; (0,0) is the bottom left corner of the texture.
    """
    height, width = texture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x), np.floor(y)
    weight_x, weight_y = (x - left).astype(np.float32)[:, None], (y - top).astype(np.float32)[:, None]
    columns = [_wrapped((left + k).astype(np.int64), width, wrap[0]) for k in (0, 1)]
    rows = [_wrapped((top + k).astype(np.int64), height, wrap[1]) for k in (0, 1)]
    upper_row, lower_row = (
        LINEAR[texture[row, columns[0]]] * (1 - weight_x) + LINEAR[texture[row, columns[1]]] * weight_x for row in rows
    )
    return upper_row * (1 - weight_y) + lower_row * weight_y


def sample_albedo(mesh: Mesh, face: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Returns the albedo of points: texture times material color times interpolated corner color.

    Args:
        mesh: with materials.
        face: (N,) of the points.
        weights: (N,3) barycentric.

    Returns:
        (N,3) float32 in [0,1], linear.

    Raises:
        UserError: if a face's material does not exist, or colors or texture coordinates are not finite.
    """
    material = mesh.material[face]
    if len(material) and not 0 <= material.min() <= material.max() < len(mesh.materials):
        raise UserError(f"the mesh has {len(mesh.materials)} materials, but its faces use up to {material.max()}")
    result = np.empty((len(face), 3), np.float32)
    for index in np.unique(material):
        entry = mesh.materials[index]
        selected = material == index
        albedo = np.broadcast_to(np.asarray(entry.color, np.float32), (selected.sum(), 3))
        if entry.texture is not None:
            uv = np.einsum("nc,ncx->nx", weights[selected], mesh.uv[face[selected]])
            if not np.isfinite(uv).all():
                raise UserError("the mesh has texture coordinates that are not finite: repair or drop them")
            albedo = albedo * _sample_texture(entry.texture, uv, entry.wrap)
        result[selected] = albedo
    if mesh.color is not None:
        result *= np.einsum("nc,ncx->nx", weights, mesh.color[face]).astype(np.float32)
    if not np.isfinite(result).all():
        raise UserError("the mesh has colors that are not finite: repair or drop them")
    return result.clip(0, 1)


def sample_gloss(mesh: Mesh, face: np.ndarray) -> np.ndarray:
    """Returns roughness and specular (N,2) float32 of the materials of faces (N,)."""
    gloss = np.array([(material.roughness, material.specular) for material in mesh.materials], np.float32)
    return gloss[mesh.material[face]]


def shading_normals(
    vertex_normals: np.ndarray, faces: np.ndarray, face: np.ndarray, weights: np.ndarray, geometric: np.ndarray
) -> np.ndarray:
    """Interpolates vertex normals.

    Where the result vanishes or is more than 78 degrees from the geometric normal, the geometric normal is returned.
    This happens on torn or inconsistently wound scans, never on smooth surfaces.

    Args:
        vertex_normals: (V,3) of the mesh.
        faces: (F,3) of the mesh.
        face: (N,) of the points.
        weights: (N,3) barycentric.
        geometric: (N,3) unit normals of the faces of the points.

    Returns:
        (N,3) float64 unit normals.
    """
    normal = np.einsum("nc,ncx->nx", weights, vertex_normals[faces[face]].astype(np.float64))
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.einsum("nx,nx->n", normal, geometric)[:, None]
    usable = (length > 1e-6) & (facing > 0.2 * length)
    return np.where(usable, normal / np.where(usable, length, 1), geometric)
