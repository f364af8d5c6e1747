"""Decimation by quadric edge collapse that keeps uv, materials and colors."""

from dataclasses import replace

import numpy as np

from relight.core.libraries import with_libraries
from relight.meshes.mesh import Mesh


def decimate(mesh: Mesh, faces: int) -> Mesh:
    """Decimates a mesh; its vertices are a subset of the given ones.

    Seams of uv, material and color are kept like borders, so textures stay in place and no cracks open. A texture atlas
    with very many small charts can therefore stop the decimation early.

    Args:
        mesh: in any frame and unit.
        faces: number of faces that is aimed at.
    """
    pymeshlab = with_libraries("pymeshlab")
    wedge, first = _wedges(mesh)
    work = pymeshlab.MeshSet()
    work.add_mesh(
        pymeshlab.Mesh(
            mesh.vertices[mesh.faces.reshape(-1)[first]].astype(np.float64),
            wedge.astype(np.int32),
            v_scalar_array=np.arange(len(first), dtype=np.float64),
        )
    )
    # Without optimal placement, every vertex is one of the old, and has its uv, material and color.
    work.meshing_decimation_quadric_edge_collapse(
        targetfacenum=faces,
        optimalplacement=False,
        preserveboundary=True,
        preservenormal=True,
        planarquadric=True,
        autoclean=False,
    )
    result = work.current_mesh()
    kept = first[result.vertex_scalar_array().astype(np.int64)[result.face_matrix()]]  # corners of the given mesh
    number, index = np.unique(mesh.faces.reshape(-1)[kept], return_inverse=True)
    return replace(
        mesh,
        vertices=mesh.vertices[number],
        faces=index.reshape(-1, 3).astype(np.int32),
        uv=mesh.uv.reshape(-1, 2)[kept],
        material=mesh.material[kept[:, 0] // 3],
        color=None if mesh.color is None else mesh.color.reshape(-1, 3)[kept],
    )


def _wedges(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Numbers the distinct (vertex, uv, material, color) of the corners.

    Returns the number (F,3) of each corner, and for each number (N,) one of its corners, as 3 * face + corner.
    """
    columns = [
        mesh.faces.reshape(-1).astype(np.uint32),
        *np.ascontiguousarray(mesh.uv.reshape(-1, 2)).view(np.uint32).T,
        np.repeat(mesh.material, 3).astype(np.uint32),
    ]
    if mesh.color is not None:
        columns += [*np.ascontiguousarray(mesh.color.reshape(-1, 3)).view(np.uint32).T]
    # One opaque value for each corner, which sorts faster than a row of numbers.
    rows = np.ascontiguousarray(np.stack(columns, axis=-1)).view(f"V{4 * len(columns)}").reshape(-1)
    _, first, number = np.unique(rows, return_index=True, return_inverse=True)
    return number.reshape(-1, 3), first
