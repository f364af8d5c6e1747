"""Transport per vertex, and the files that hold it."""

import json
import re

import numpy as np
import pytest
import trimesh
from samples import mesh_of

from relight.core.errors import UserError
from relight.lights import load_light, write_light
from relight.maps import coefficient_names
from relight.meshes import Material, read_mesh
from relight.settings import ROOT
from relight.sh import basis, unoccluded
from relight.transport import bake_vertices
from relight.transport.bounce import MAX_EDGE


def two_balls():
    """A small ball above a large one, off the origin, and a vertex that no face uses."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    n = len(ball.vertices)
    vertices = np.concatenate([ball.vertices, ball.vertices * 0.3 + [0, 1.6, 0], [[np.nan] * 3]]) + 3
    faces = np.concatenate([ball.faces, ball.faces + n])
    half = np.repeat([0, 1], len(ball.faces)).astype(np.int16)
    materials = [Material(np.float32([0.2, 0.4, 0.6])), Material(np.float32([0.9, 0.8, 0.7]))]
    return mesh_of(vertices, faces, material=half, materials=materials), n


def test_balls():
    mesh, n = two_balls()
    baked = bake_vertices(mesh, 256)
    low = baked.vertices[:n, 1] < 3  # the lower half of the large ball sees nothing of the small one
    np.testing.assert_allclose(baked.transport[:n][low], unoccluded(baked.normals[:n][low]), atol=1e-6)
    top = np.argmax(baked.vertices[:n, 1])
    blocked = 0.3**2 / 0.6**2  # a ball of radius .3 straight above, its centre at distance .6: sin^2 of its half-angle
    assert baked.transport[top, 0] / 0.886227 == pytest.approx(1 - blocked, abs=4e-3)
    np.testing.assert_array_equal(baked.albedo[[0, n]], np.float32([[0.2, 0.4, 0.6], [0.9, 0.8, 0.7]]))
    assert not baked.transport[-1].any() and np.isnan(baked.vertices[-1]).all()


def rectangles(*corners):
    """Rectangles (4,3) that share no vertices."""
    first = 4 * np.arange(len(corners))[:, None]
    return np.concatenate(corners).astype(float), np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])


FLOOR = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
WALL = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]])  # faces +y


def turned(quarters):
    x, y, z = (WALL - [0.5, 0.5, 0]).T
    for _ in range(quarters):
        x, y = -y, x
    return np.stack([x + 0.5, y + 0.5, z], -1)


def random_rotation(seed):
    return trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))[:3, :3]


@pytest.mark.parametrize("seed", range(2))
def test_the_corners_of_a_room_see_what_is_left_of_the_sky(seed):
    """Closed forms of the view factor from a point at the corner of an open-top cube to its opening."""
    vertices, faces = rectangles(FLOOR, *(turned(quarters) for quarters in range(4)))
    rotation = random_rotation(seed) if seed else np.eye(3)
    occlusion = bake_vertices(mesh_of(vertices @ rotation.T, faces), 1024).transport[:, 0] / 0.886227
    slant = np.arctan(np.sqrt(0.5)) * np.sqrt(0.5)
    np.testing.assert_allclose(occlusion[:4], slant / np.pi, atol=6e-3)  # parallel to the opening
    foot = vertices[4:, 2] == 0
    np.testing.assert_allclose(occlusion[4:][foot], (np.pi / 4 - slant) / (2 * np.pi), atol=6e-3)  # perpendicular
    # At the top, between two walls, 45 of the 180 degrees of azimuth above a wall are behind the other.
    np.testing.assert_allclose(occlusion[4:][~foot], 3 / 8, atol=6e-3)


@pytest.mark.parametrize("seed", range(2))
def test_a_box_on_a_floor_has_no_black_rim(seed):
    box = [side - [0.5, 0.5, 0] for side in map(turned, range(4))]
    sides = [side[::-1] for side in box]  # they face outward
    vertices, faces = rectangles(1000 * (FLOOR - [0.5, 0.5, 0]), FLOOR - [0.5, 0.5, -1], *sides)
    rotation = random_rotation(seed) if seed else np.eye(3)
    occlusion = bake_vertices(mesh_of(vertices @ rotation.T, faces), 1024).transport[:, 0] / 0.886227
    np.testing.assert_allclose(occlusion[4:8], 1, atol=1e-6)  # the top
    np.testing.assert_allclose(occlusion[8:], 0.5, atol=0.03)  # of the sides: the floor takes half


def test_bounces_in_a_bowl_of_long_edges():
    """From any point of a hemisphere's inside, half of what the cosine weighs is sky, and half the inside itself."""
    rings, sectors, albedo, bounces = 10, 32, 0.8, 3
    theta = np.linspace(np.pi / 2, np.pi, rings + 1)[:-1].repeat(sectors)
    phi = np.tile(np.arange(sectors), rings) + 0.5 * np.repeat(np.arange(rings) % 2, sectors)
    phi *= 2 * np.pi / sectors
    ring = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    vertices = np.concatenate([ring, [[0, 0, -1]]])
    faces = trimesh.convex.convex_hull(vertices).faces  # outward; the lid goes
    faces = faces[(vertices[faces][:, :, 2] < 0).any(axis=1)][:, ::-1]
    mesh = mesh_of(vertices, faces, materials=[Material(np.float32([albedo, albedo / 2, 0]))])
    edges = vertices[faces] - np.roll(vertices[faces], 1, 1)
    assert np.linalg.norm(edges, axis=2).max() > MAX_EDGE * np.linalg.norm(np.ptp(vertices, axis=0))  # they are split
    baked = bake_vertices(mesh, 1024, bounces=bounces)
    inside = vertices[:, 2] < -1e-6  # at the rim, faces and normals are on one side
    np.testing.assert_allclose(baked.transport[inside, 0] / 0.886227, 0.5, atol=0.02)
    for channel, rho in enumerate((albedo, albedo / 2, 0)):
        expected = 0.5 * sum((rho / 2) ** k for k in range(1, bounces + 1))
        found = baked.bounced[inside, 0, channel] / 0.886227
        np.testing.assert_allclose(found, expected, atol=0.02 * max(expected, 0.01))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("seed", range(3))
def test_shared_vertices_stay_on_their_side(sign, seed):
    """Uneven pyramids, seen from outside and from inside: rays start neither below the faces nor beyond them."""
    generator = np.random.default_rng(seed)
    base = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]) * generator.uniform(0.3, 2, (4, 1))
    vertices = np.concatenate([np.c_[base, np.zeros(4)], [[0.1, 0.1, generator.uniform(0.1, 1)]]])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])[:, ::sign]
    baked = bake_vertices(mesh_of(vertices @ random_rotation(seed).T, faces), 1024)
    if sign == 1:
        np.testing.assert_allclose(baked.transport[4], unoccluded(baked.normals[4:])[0], atol=1e-6)
    else:  # a ray from the tip is blocked where it leaves on the outer side of any face
        n = baked.normals[4] @ random_rotation(seed)
        directions = generator.normal(size=(200_000, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        sides = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
        seen = (directions @ sides.T > 0).all(axis=1)
        expected = 4 * (np.clip(directions @ n, 0, None) * seen).mean()
        assert baked.transport[4, 0] / 0.886227 == pytest.approx(expected, abs=0.015)


def test_normals_of_the_file_count(tmp_path):
    """Else each vertex would have the normal of its one face, 4 degrees from that of the ball; three point inward."""
    points = trimesh.creation.icosphere(subdivisions=3).triangles.reshape(-1, 3)
    faces, normals = np.arange(len(points)).reshape(-1, 3), np.concatenate([-points[:3], points[3:]])
    mesh = trimesh.Trimesh(points, faces, vertex_normals=normals, process=False)
    (tmp_path / "ball.ply").write_bytes(trimesh.exchange.ply.export_ply(mesh, vertex_normal=True))
    baked = bake_vertices(read_mesh(tmp_path / "ball.ply"), 64)
    np.testing.assert_allclose(baked.normals[3:], points[3:], atol=1e-6)
    np.testing.assert_allclose(baked.transport[3:], unoccluded(points[3:]), atol=0.02)  # facets hide some sky
    assert (np.einsum("vx,vx->v", baked.normals[:3], points[:3]) > 0.99).all()  # those inward do not fit the face


def test_a_vertex_of_several_colors_is_noted_and_a_mesh_too_small_for_single_precision_refused():
    mesh, n = two_balls()
    assert not bake_vertices(mesh, 1).notes
    mesh.material[0] = 1  # one face of the large ball in the color of the small one
    (note,) = bake_vertices(mesh, 1).notes
    assert note.startswith(f"3 of {2 * n:,} vertices have faces of several colors: each has the color of the first")
    mesh.vertices = mesh.vertices * np.float32(1e-9)
    with pytest.raises(UserError, match="scale it up"):
        bake_vertices(mesh, 16)


def test_files(tmp_path):
    mesh, _ = two_balls()
    baked = bake_vertices(mesh, 16, order=1, bounces=1)
    baked.save(tmp_path / "a.npz")
    stored = np.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(stored["transport"], baked.transport)
    assert "1/pi" in str(stored["convention"])
    baked.save(tmp_path / "a.ply")
    loaded = trimesh.load(tmp_path / "a.ply", process=False)  # a reader that knows nothing of us
    np.testing.assert_array_equal(np.float32(loaded.vertices), baked.vertices)
    np.testing.assert_array_equal(loaded.faces, baked.faces)
    data = loaded.metadata["_ply_raw"]["vertex"]["data"]
    for i, name in enumerate(coefficient_names(1)):
        np.testing.assert_array_equal(data[name], baked.transport[:, i])
        np.testing.assert_array_equal(data[f"bounced_b_{name}"], baked.bounced[:, i, 2])
    np.testing.assert_array_equal(data["albedo_g"], baked.albedo[:, 1])
    baked.save(tmp_path / "a.glb")
    content = (tmp_path / "a.glb").read_bytes()
    size = int.from_bytes(content[12:16], "little")
    scene, buffer = json.loads(content[20 : 20 + size]), content[28 + size :]
    (primitive,) = scene["meshes"][0]["primitives"]
    wanted = {f"_SH{i}": column for i, column in enumerate(baked.transport.T)}
    assert not baked.normals[-1].any()  # of a vertex that no face uses, for which glTF wants one of length 1
    normals = np.concatenate([baked.normals[:-1], [[0, 0, 1]]])
    wanted |= {"POSITION": np.nan_to_num(baked.vertices), "NORMAL": normals, "_ALBEDO": baked.albedo}
    wanted["_BOUNCED3"] = baked.bounced[:, 3]
    for name, values in wanted.items():
        accessor = scene["accessors"][primitive["attributes"][name]]
        start = scene["bufferViews"][accessor["bufferView"]].get("byteOffset", 0)
        assert accessor["type"] == ("SCALAR" if values.ndim == 1 else "VEC3") and accessor["componentType"] == 5126
        stored = np.frombuffer(buffer, "<f4", values.size, start).reshape(values.shape)
        np.testing.assert_allclose(stored, values, atol=1e-6)
    with pytest.raises(UserError, match=r"\.ply, \.npz or \.glb"):
        baked.save(tmp_path / "a.stl")
    with pytest.raises(UserError, match="rays is 0"):
        bake_vertices(mesh, 0)


def test_the_code_of_the_page_shades_a_sphere_as_the_closed_form_does(tmp_path, monkeypatch):
    """Unoccluded, T_lm = A_l Y_lm(n), with A = pi, 2 pi / 3, pi / 4 (Ramamoorthi & Hanrahan 2001)."""
    monkeypatch.chdir(tmp_path)
    trimesh.creation.icosphere(subdivisions=3).export("room.obj")
    bake_vertices(read_mesh("room.obj"), 16).save("room.npz")
    write_light(load_light("room:3"), tmp_path / "kitchen.json")
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "transport.md").read_text(), re.S)
    (code,) = [block for block in blocks if 'np.load("room.npz")' in block]
    page: dict[str, np.ndarray] = {}
    exec(code, page)
    lobes = np.repeat([np.pi, 2 * np.pi / 3, np.pi / 4], [1, 3, 5])
    irradiance = np.maximum(lobes * basis(page["baked"]["normals"], 2) @ page["light"], 0)
    np.testing.assert_allclose(page["radiance"], page["baked"]["albedo"] * irradiance / np.pi, atol=1e-6)
