"""Repairs meshes with PyMeshLab; keeps uv and materials, and counts the repairs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from relight.core.errors import UserError
from relight.core.libraries import with_libraries
from relight.meshes.geometry import connected_parts, edges, face_areas, solidity
from relight.meshes.mesh import Mesh

if TYPE_CHECKING:
    import pymeshlab

MIN_DISTANCE = 0.01  # of small parts from all large ones, over the figure's diagonal, to count as floating
MAX_FACES = 0.0005  # largest share of the faces of a dropped part
MAX_FLOATING = 0.03  # largest size of a dropped part over the figure's diagonal (a shoe has .15, an eye .013)
MIN_KEPT = 0.5  # least share of the surface that must remain
MAIN_PART = 0.5  # least share of the surface of a part that is most of the figure
MIN_SOLIDITY = 0.1  # of a part that has an inside; hair cards and collars have about 0
MAX_DEGENERATE = 0.1  # share of faces without area above which there is a warning


def clean(mesh: Mesh) -> Mesh:
    """Repairs a mesh.

    Merges vertices at the same position; drops faces with non-finite corners, without area, and duplicates; splits
    non-manifold edges; orients faces coherently and outward; drops small floating parts.

    Args:
        mesh: in any frame and unit.

    Returns:
        The repaired mesh. Its info["repairs"] has the numbers of repairs, and of holes, boundary edges and parts.

    Raises:
        UserError: if less than half of the surface is left.
    """
    given = len(mesh.faces)
    repairs = {"unused vertices": len(mesh.vertices) - len(np.unique(mesh.faces))}
    finite = np.isfinite(mesh.vertices).all(axis=-1)[mesh.faces].all(axis=-1)
    repairs["faces with non-finite corners"] = int((~finite).sum())
    if finite.mean() < MIN_KEPT:
        raise UserError(f"{_name(mesh)}: {(~finite).mean():.0%} of the faces have corners that are no finite numbers")
    mesh = submesh(mesh, np.flatnonzero(finite))
    mesh = _without_floating(_repair(mesh, repairs), repairs)
    mesh.info = {**mesh.info, "repairs": {what: count for what, count in repairs.items() if count}}
    if repairs["faces without area"] > MAX_DEGENERATE * given:
        share = repairs["faces without area"] / given
        warning = f"{share:.0%} of its {given} faces have no area and were dropped: look at what is left"
        mesh.info["warnings"] = [*mesh.info.get("warnings", []), warning]
    return mesh


def count_opposed_faces(mesh: Mesh) -> int:
    """Returns how many faces lie on another one, turned the other way: vertex normals cancel there."""
    # One opaque value of 12 bytes for each position sorts faster than rows; + 0.0 makes negative zeros positive.
    position = np.ascontiguousarray(mesh.vertices + 0.0, np.float32).view("V12").reshape(-1)
    faces = np.unique(position, return_inverse=True)[1].reshape(-1)[mesh.faces].astype(np.int64)
    faces = np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)  # the least first
    is_turned = faces[:, 1] > faces[:, 2]
    faces.sort(axis=1)  # faces of the same corners are equal rows now, whatever their winding
    group = np.unique(faces, axis=0, return_inverse=True)[1].reshape(-1)
    counts = np.stack([np.bincount(group, winding, minlength=len(faces)) for winding in (is_turned, ~is_turned)])
    return int(counts.min(axis=0).sum())


def submesh(mesh: Mesh, faces: np.ndarray) -> Mesh:
    """Returns the mesh of the faces with these indices (N,) and of the vertices that they use."""
    kept = mesh.faces[faces]
    used = np.zeros(len(mesh.vertices), bool)
    used[kept] = True
    number = np.cumsum(used, dtype=np.int32) - 1
    vertices, uv, material = mesh.vertices[used], mesh.uv[faces], mesh.material[faces]
    color = None if mesh.color is None else mesh.color[faces]
    return replace(mesh, vertices=vertices, faces=number[kept], uv=uv, material=material, color=color, normal=None)


def _repair(mesh: Mesh, repairs: dict[str, int]) -> Mesh:
    """Merges, drops, splits and orients with PyMeshLab's filters.

    Indices of faces are carried through the filters as scalars, those of corners as wedge coordinates: by them, the
    result gets uv, material and colors of the given mesh. It needs finite vertices, and raises UserError if no face has
    an area.
    """
    corner = np.tile([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], (len(mesh.faces), 1))
    work = _mesh_set(mesh.vertices.astype(np.float64), mesh.faces, np.arange(len(mesh.faces), dtype=np.float64), corner)

    def face_count() -> int:
        return work.current_mesh().face_number()

    work.meshing_remove_duplicate_vertices()
    repairs["merged vertices"] = len(mesh.vertices) - work.current_mesh().vertex_number()
    work.meshing_remove_null_faces()
    repairs["faces without area"] = len(mesh.faces) - face_count()
    work.meshing_remove_duplicate_faces()
    repairs["duplicate faces"] = len(mesh.faces) - face_count() - repairs["faces without area"]
    work.meshing_remove_unreferenced_vertices()
    if not face_count():
        raise UserError(f"{_name(mesh)}: no face has an area")
    repairs["non-manifold edges"] = int((edges(work.current_mesh().face_matrix())[2] > 2).sum())
    if repairs["non-manifold edges"]:
        work = _split_non_manifold_edges(work.current_mesh())
    work.meshing_repair_non_manifold_vertices(vertdispratio=0)
    before = work.current_mesh().face_matrix()
    work.meshing_re_orient_faces_coherently()
    after = work.current_mesh().face_matrix()
    topology = work.get_topological_measures()
    repairs["holes"] = max(topology["number_holes"], 0)  # -1 if edges are not manifold
    repairs["boundary edges"] = topology["boundary_edges"]
    result = work.current_mesh()
    face = result.face_scalar_array().astype(np.int64)
    corner = result.wedge_tex_coord_matrix()[:, 0].reshape(-1, 3).round().astype(np.int64)
    # Flipping moves a face's vertices, but not its wedges: find where each corner was before.
    was_corner = (before[:, :, None] == after[:, None, :]).argmax(axis=1)
    corner = np.take_along_axis(corner, was_corner, axis=1)
    vertices, faces = result.vertex_matrix().astype(np.float32), after.astype(np.int32)
    uv, material = mesh.uv[face[:, None], corner], mesh.material[face]
    color = None if mesh.color is None else mesh.color[face[:, None], corner]
    mesh = replace(mesh, vertices=vertices, faces=faces, uv=uv, material=material, color=color)
    return _oriented(mesh, (before != after).any(axis=1), repairs)


def _mesh_set(vertices: np.ndarray, faces: np.ndarray, face: np.ndarray, corner: np.ndarray) -> pymeshlab.MeshSet:
    """Returns PyMeshLab's mesh with a scalar (F,) for each face and a pair (3F,2) for each corner."""
    pymeshlab = with_libraries("pymeshlab")
    work = pymeshlab.MeshSet()
    work.add_mesh(pymeshlab.Mesh(vertices, faces, f_scalar_array=face, w_tex_coords_matrix=corner))
    return work


def _split_non_manifold_edges(mesh: pymeshlab.Mesh) -> pymeshlab.MeshSet:
    """Returns a MeshSet in which no edge has more than two faces, with the scalars and wedges of the given mesh.

    At an edge of more, the third and later faces get copies of its vertices; that may leave other edges with more than
    two, so it is repeated until there are none. (PyMeshLab's own filter loses the scalars of faces.)
    """
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64)
    source = np.arange(len(vertices))  # the original of each vertex
    edge_corners = np.array([[0, 1], [1, 2], [2, 0]])
    while True:
        edges = np.sort(faces[:, edge_corners], axis=-1).reshape(-1, 2)
        key = edges[:, 0] << 32 | edges[:, 1]
        order = np.argsort(key, kind="stable")  # brings the sides of one edge together
        extra = order[2:][key[order[2:]] == key[order[:-2]]]
        if not len(extra):
            break
        corners = np.stack([(extra // 3).repeat(2), edge_corners[extra % 3].ravel()], 1)
        face, corner = np.unique(corners, axis=0).T
        source = np.concatenate([source, source[faces[face, corner]]])
        faces[face, corner] = np.arange(len(source) - len(face), len(source))
    return _mesh_set(vertices[source], faces.astype(np.int32), mesh.face_scalar_array(), mesh.wedge_tex_coord_matrix())


def _oriented(mesh: Mesh, changed: np.ndarray, repairs: dict[str, int]) -> Mesh:
    """Orients each coherent part: solid ones outward, sheets as most of their faces were before.

    Solid parts are closed ones, and an open one that is most of the figure, as of a scan without soles; small open
    parts may face inward, as linings do. The mesh itself is changed; `changed` (F,) tells which faces were flipped to
    make its parts coherent.
    """
    part = connected_parts(mesh.faces, len(mesh.vertices))
    area = face_areas(mesh.vertices, mesh.faces)
    volume = solidity(mesh.vertices, mesh.faces, part)  # negative where faces point inward
    _, face_edge, uses = edges(mesh.faces)
    is_closed = np.bincount(part, uses[face_edge].min(axis=-1) < 2) == 0
    is_main = np.bincount(part, area) > MAIN_PART * area.sum()
    is_solid = (np.abs(volume) > MIN_SOLIDITY) & (is_closed | is_main)
    most_changed = np.bincount(part, changed) > 0.5 * np.bincount(part)
    turn = np.where(is_solid, volume < 0, most_changed)[part]
    repairs["faces turned"] = int((changed ^ turn).sum())
    mesh.faces[turn] = mesh.faces[turn][:, ::-1]
    for corners in (mesh.uv, mesh.color):
        if corners is not None:
            corners[turn] = corners[turn][:, ::-1]
    return mesh


def _without_floating(mesh: Mesh, repairs: dict[str, int]) -> Mesh:
    """Drops parts that have few faces, are small, and float; eyes and lashes touch the body."""
    from scipy.spatial import cKDTree

    part = connected_parts(mesh.faces, len(mesh.vertices))
    count = part.max() + 1
    repairs["parts"] = int(count)
    diagonal = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    corners = mesh.vertices[mesh.faces]
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, part, corners.min(axis=1))
    np.maximum.at(high, part, corners.max(axis=1))
    large = np.bincount(part) >= MAX_FACES * len(part)
    large |= np.linalg.norm(high - low, axis=-1) > MAX_FLOATING * diagonal
    if large.all():
        return mesh
    if not large.any():
        raise UserError(f"{_name(mesh)} has no main part: its {count} parts are under {MAX_FLOATING:.0%} of the whole")
    tree = cKDTree(mesh.vertices[np.unique(mesh.faces[large[part]])])
    distance = np.full(count, np.inf)
    small = ~large[part]
    np.minimum.at(distance, part[small], tree.query(corners[small].mean(axis=1))[0])
    floating = ~large & (distance > MIN_DISTANCE * diagonal)
    repairs["floating parts"] = int(floating.sum())
    area = face_areas(mesh.vertices, mesh.faces)
    if area[floating[part]].sum() > (1 - MIN_KEPT) * area.sum():
        raise UserError(f"{_name(mesh)}: over half of its surface is in small floating parts")
    return submesh(mesh, np.flatnonzero(~floating[part])) if floating.any() else mesh


def _name(mesh: Mesh) -> str:
    return str(mesh.info.get("name", "the mesh"))
