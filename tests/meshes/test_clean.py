"""Repairs: each flaw is put into a sound figure, and must be found, counted and gone, everything else as it was."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from samples import mesh_of

from relight.core.errors import UserError
from relight.meshes import Mesh, clean, vertex_normals
from relight.meshes.cleaning import count_opposed_faces
from relight.meshes.geometry import connected_parts, edges


def corners(mesh: Mesh) -> np.ndarray:
    """Each face as its three corners (place, uv, color) and its material, sorted: the same for the same surface."""
    corner = np.concatenate([mesh.vertices[mesh.faces], mesh.uv, mesh.color], axis=-1)
    first = np.lexsort(corner[:, :, :3].transpose(2, 0, 1)[::-1], axis=-1)[:, 0]  # begin at the least corner
    corner = np.stack([corner[np.arange(len(corner)), (first + k) % 3] for k in range(3)], axis=1)
    rows = np.concatenate([corner.reshape(len(corner), -1), mesh.material[:, None]], axis=-1)
    return rows[np.lexsort(rows.T[::-1])]


def with_faces(mesh: Mesh, faces) -> Mesh:
    """`mesh` with more faces, whose uv is the planar chart of the figure."""
    faces = np.asarray(faces, np.int32)
    more = {"faces": faces, "uv": mesh.vertices[faces][..., :2] / 2 + 0.5, "material": np.zeros(len(faces))}
    more["color"] = (mesh.vertices[faces] / 2).clip(0, 1)
    fields = {name: (getattr(mesh, name), values) for name, values in more.items()}
    return replace(mesh, **{name: np.concatenate(pair).astype(pair[0].dtype) for name, pair in fields.items()})


def with_vertices(mesh: Mesh, vertices) -> Mesh:
    vertices = np.asarray(vertices, np.float32).reshape(-1, 3)
    return replace(mesh, vertices=np.concatenate([mesh.vertices, vertices]))


def add_ball(mesh: Mesh, ball) -> Mesh:
    vertices, faces = ball
    return with_faces(with_vertices(mesh, vertices), faces + len(mesh.vertices))


def test_a_clean_figure_is_unchanged_but_for_faces_without_area_and_unused_vertices(person):
    result = clean(person())
    np.testing.assert_array_equal(corners(result), corners(person()))
    assert result.info["repairs"] == {"parts": 10} and result.info["name"] == "person"
    assert result.faces.dtype == np.int32 and result.vertices.dtype == np.float32 and result.uv.dtype == np.float32
    result = clean(with_faces(with_vertices(person(), [[5, 5, 5], [6, 6, 6]]), [[0, 0, 1], [2, 2, 2]]))
    assert [result.info["repairs"][kind] for kind in ("faces without area", "unused vertices")] == [2, 2]
    np.testing.assert_array_equal(corners(result), corners(person()))


def test_colors_of_faces_survive_the_merging_of_their_vertices():
    """A box of six colors, each side with vertices of its own, as .ply and .glb of flat colors are written."""
    box = trimesh.creation.box()
    side = np.abs(box.face_normals).argmax(1) + 3 * (box.face_normals.sum(1) > 0)
    color = np.eye(6, 3, dtype=np.float32)[side] + np.float32(side[:, None] / 8)
    result = clean(mesh_of(box.triangles.reshape(-1, 3), np.arange(36), color=color[:, None].repeat(3, 1)))
    assert len(result.vertices) == 8 and result.info["repairs"] == {"merged vertices": 28, "parts": 1}
    normal = np.cross(*(np.diff(result.vertices[result.faces], axis=1).swapaxes(0, 1)))
    side = np.abs(normal).argmax(1) + 3 * (normal.sum(1) > 0)
    want = np.eye(6, 3, dtype=np.float32)[side] + np.float32(side[:, None] / 8)
    np.testing.assert_array_equal(result.color, want[:, None].repeat(3, 1))


def test_duplicate_faces_are_dropped_in_either_orientation(person):
    mesh = person()
    double = with_faces(with_vertices(mesh, mesh.vertices), mesh.faces[:, ::-1] + len(mesh.vertices))
    result = clean(with_faces(double, mesh.faces[:5, [1, 2, 0]]))
    assert result.info["repairs"]["duplicate faces"] == len(mesh.faces) + 5 and len(result.faces) == len(mesh.faces)
    np.testing.assert_array_equal(corners(result)[:, :3], corners(mesh)[:, :3])


def test_non_finite_corners_are_dropped_and_counted(person):
    mesh = person()
    mesh.vertices[7] = np.nan
    mesh.vertices[1000, 1] = np.inf
    touched = np.isin(mesh.faces, [7, 1000]).any(axis=-1)
    result = clean(mesh)
    assert result.info["repairs"]["faces with non-finite corners"] == touched.sum()
    assert np.isfinite(result.vertices).all() and len(result.faces) == (~touched).sum()
    assert result.info["repairs"]["holes"] == 2


@pytest.mark.parametrize("share", [0.2, 0.8, 1.0])
def test_inward_faces_are_flipped_with_their_uv(person, share):
    mesh = person()
    turned = np.random.default_rng(0).random(len(mesh.faces)) < share
    mesh.faces[turned] = mesh.faces[turned][:, ::-1]
    mesh.uv[turned], mesh.color[turned] = mesh.uv[turned][:, ::-1], mesh.color[turned][:, ::-1]
    np.testing.assert_array_equal(corners(clean(mesh)), corners(person()))


def test_linings_face_inward_and_an_open_scan_is_flipped(person, ellipsoid):
    vertices, faces = ellipsoid((0, 1, 0), (0.5, 0.9, 0.4), rings=30)
    cut = faces[vertices[faces][..., 1].min(axis=1) > 0.2]  # open at the feet
    nothing = {"uv": np.zeros((0, 3, 2)), "material": np.zeros(0, np.int16), "color": np.zeros((0, 3, 3))}
    points = with_vertices(replace(person(), faces=np.zeros((0, 3), np.int32), **nothing), vertices)
    result = clean(with_faces(points, cut[:, ::-1] + 2660))
    assert result.info["repairs"]["faces turned"] == len(cut)
    band = cut[(np.abs(vertices[cut][..., 1] - 1) < 0.15).all(axis=1)]
    lining, lined = band[:, ::-1], with_vertices(person(), vertices * [0.3, 1, 0.3])
    result = clean(with_faces(lined, lining + 2660))
    assert "faces turned" not in result.info["repairs"]


def test_floating_parts_are_dropped_and_eyes_shoes_and_strands_stay(person, ellipsoid):
    mesh, dust = person(24), [((0.6, 1.5 + 0.02 * k, 0.3), (0.005, 0.004, 0.003)) for k in range(5)]
    for speck in dust:
        mesh = add_ball(mesh, ellipsoid(*speck, rings=2))
    button = ellipsoid((0, 1.2, 0.125), (0.006, 0.006, 0.003), rings=2)  # as small, but on the chest
    glove = ellipsoid((0.45, 0.75, 0), (0.05, 0.09, 0.03), rings=2)  # as few faces, and in the air, but large
    result = clean(add_ball(add_ball(mesh, button), glove))
    assert result.info["repairs"]["floating parts"] == 5 and result.info["repairs"]["parts"] == 17
    assert connected_parts(result.faces, len(result.vertices)).max() + 1 == 12 and result.vertices[:, 0].max() > 0.49
    assert not (np.abs(result.vertices - [0.6, 1.5, 0.3]) < 0.02).all(axis=-1).any()


def test_holes_are_reported(person):
    mesh = person()
    torso = np.flatnonzero((np.abs(mesh.vertices - [0, 1.15, 0.1]) < 0.2).all(axis=-1))
    ring = np.isin(mesh.faces, torso[:1]).any(axis=-1)  # the faces around a vertex: a hole of six edges
    opened = replace(mesh, faces=mesh.faces[~ring], uv=mesh.uv[~ring], material=mesh.material[~ring])
    found = clean(opened).info["repairs"]
    assert found["holes"] == 1 and found["boundary edges"] == ring.sum()


def test_what_is_no_figure_is_refused(person, ellipsoid):
    mesh = person()
    mesh.vertices[: int(0.7 * len(mesh.vertices))] = np.nan
    with pytest.raises(UserError, match=r"person: .*finite"):
        clean(mesh)
    with pytest.raises(UserError, match="no face has an area"):
        clean(mesh_of(person().vertices, np.zeros((4, 3), np.int32)))
    random = np.random.default_rng(0)
    dust = mesh_of(np.zeros((0, 3)), [], color=np.zeros((0, 3, 3), np.float32), info={"name": "dust"})
    grains = random.random((3000, 1, 3)) + [[0, 0, 0], [0, 0.002, 0], [0.002, 0, 0]]
    dust = add_ball(dust, (grains.reshape(-1, 3), np.arange(9000).reshape(-1, 3)))
    with pytest.raises(UserError, match="no main part"):
        clean(dust)


def test_faces_keep_their_uv_at_non_manifold_edges(monkeypatch):
    """Fins on the edges of a sphere: three and four faces to an edge, and every face with a uv of its own."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    faces, vertices = ball.faces, ball.vertices
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(faces), 300, replace=False)
    tips = vertices[faces[chosen]].mean(1) * 1.01  # near enough not to count as floating
    fins = np.concatenate([faces[chosen][:, :2], len(vertices) + np.arange(300)[:, None]], 1)
    faces, vertices = rng.permutation(np.concatenate([faces, fins])), np.concatenate([vertices, tips])
    mesh = mesh_of(vertices, faces, uv=rng.random((len(faces), 3, 2)).astype(np.float32))
    monkeypatch.setattr("relight.meshes.cleaning.MAX_FACES", 0.0)  # no part is dropped
    cleaned = clean(mesh)
    assert cleaned.info["repairs"]["non-manifold edges"] >= 290 and edges(cleaned.faces)[2].max() <= 2

    def by_place(mesh):
        """uv of each corner, in the order of the corner's place and its face's centre."""
        corner = mesh.vertices[mesh.faces]
        keys = np.concatenate([corner, corner.mean(1, keepdims=True).repeat(3, 1)], -1).reshape(-1, 6)
        return mesh.uv.reshape(-1, 2)[np.lexsort(np.round(keys, 5).T)]

    assert len(cleaned.faces) == len(mesh.faces)
    np.testing.assert_array_equal(by_place(cleaned), by_place(mesh))


def test_faces_turned_both_ways_are_counted(person):
    """Second faces of vertices of their own, turned over; turned as the first, they are none."""
    mesh = person()
    assert count_opposed_faces(mesh) == 0
    double = with_vertices(mesh, mesh.vertices[mesh.faces[:7]].reshape(-1, 3))
    again = len(mesh.vertices) + np.arange(21).reshape(7, 3)
    assert count_opposed_faces(with_faces(double, again[:, [1, 2, 0]])) == 0
    assert count_opposed_faces(with_faces(double, again[:, [1, 0, 2]])) == 7
    assert count_opposed_faces(clean(with_faces(double, again[:, [1, 0, 2]]))) == 0


def test_a_mesh_of_which_repairs_leave_little_is_warned_of(person):
    """Coordinates rounded to a coarse grid, as single precision far from the origin does."""
    mesh = person()
    result = clean(replace(mesh, vertices=np.round(mesh.vertices * 16).astype(np.float32) / 16))
    assert len(result.faces) < 0.9 * len(mesh.faces)
    (warning,) = result.info["warnings"]
    assert f"of its {len(mesh.faces)} faces have no area" in warning and "warnings" not in clean(person()).info


def test_vertex_normals_are_those_of_trimesh_and_of_length_1_without_faces_or_area(person):
    mesh = person()
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    np.testing.assert_allclose(vertex_normals(mesh), other.vertex_normals, atol=1e-5)
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9], [1, 0, 0], [2, 2, 2], [np.nan, 0, 0]]
    normals = vertex_normals(mesh_of(vertices, [[0, 1, 2], [0, 1, 4], [5, 5, 5], [0, 0, 2], [6, 0, 1]]))
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 7, atol=1e-6)
