"""Fewer faces, by quadric edge collapse that keeps uv, materials and colours exact."""

from dataclasses import replace

import numpy as np

from relight.meshes.mesh import Mesh


def decimate(mesh: Mesh, faces: int) -> Mesh:
    """The mesh at about `faces` faces; its vertices are a subset of the given ones.

    The surface is cut where uv or material jump, and cuts and borders are kept as they are, so that a texture stays
    where it was to the last texel and no crack opens. A texture atlas of very many small charts can stop the collapse
    above `faces` for that reason.
    """
    import pymeshlab

    wedge, first = _wedges(mesh)
    work = pymeshlab.MeshSet()
    work.add_mesh(
        pymeshlab.Mesh(
            mesh.vertices[mesh.faces.reshape(-1)[first]].astype(np.float64),
            wedge.astype(np.int32),
            v_scalar_array=np.arange(len(first), dtype=np.float64),
        )
    )
    # With vertices that stay where they are (no optimal placement) every kept vertex is one of the old, and its number
    # tells its uv, material and colour.
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
        color=None if mesh.color is None else mesh.color[number],
    )


def _wedges(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """(F,3) numbers of the distinct (vertex, uv, material) among the corners, and one corner of each."""
    columns = [
        mesh.faces.reshape(-1).astype(np.uint32),
        *np.ascontiguousarray(mesh.uv.reshape(-1, 2)).view(np.uint32).T,
        np.repeat(mesh.material, 3).astype(np.uint32),
    ]
    rows = np.ascontiguousarray(np.stack(columns, axis=-1)).view("V16").reshape(-1)
    _, first, number = np.unique(rows, return_index=True, return_inverse=True)
    return number.reshape(-1, 3), first
