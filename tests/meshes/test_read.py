"""Meshes as each source delivers them, written by the test, read back as what they are."""

import json
import re
import struct

import numpy as np
import pytest
import trimesh
from PIL import Image, PngImagePlugin

from relight.core.srgb import encode
from relight.meshes import align, read_mesh
from relight.meshes.raw import linear
from relight.pictures.picture import Picture
from relight.pictures.texture import read_texture
from relight.settings import Align
from relight.transport import bake_vertices

RED, GREEN = (200, 30, 20), (30, 180, 40)


def picture(path, color=RED, mode="RGB"):
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.new("RGB", (4, 3), color)
    image.putpixel((0, 0), (255, 255, 255))  # the top left corner, so that a flip shows
    image.convert(mode).save(path)
    return path


def quad_obj(path, *materials, faces=("f 1/1 2/2 3/3 4/4", "f 5/1 6/2 7/3 8/4"), extra=""):
    """Two squares, the second behind the first, a material for each."""
    lines = [f"v {x} {y} {z}" for z in (0, -1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", extra]
    for face, material in zip(faces, materials):
        lines += [f"usemtl {material}", face]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def truth():
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.apply_scale([0.3, 0.9, 0.2])
    mesh.visual.vertex_colors = np.random.default_rng(0).integers(0, 256, (len(mesh.vertices), 3)).astype(np.uint8)
    return mesh


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_of_another_writer(tmp_path, truth, encoding):
    (tmp_path / "a.ply").write_bytes(trimesh.exchange.ply.export_ply(truth, encoding=encoding))
    mesh = read_mesh(tmp_path / "a.ply")
    np.testing.assert_allclose(mesh.vertices, truth.vertices, atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, truth.faces)
    colors = linear(np.asarray(truth.visual.vertex_colors[:, :3]))
    np.testing.assert_allclose(mesh.color, colors[truth.faces], atol=1e-7)
    assert mesh.info["name"] == "a" and mesh.info["source"] == "a.ply" and mesh.materials[0].texture is None


@pytest.mark.parametrize("order", ["<", ">"])
def test_ply_of_mixed_polygons_and_unknown_properties(tmp_path, order):
    """Normals, alpha, quality, edges, big-endian, a comment, windows line ends, a quad among triangles."""
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    kinds = "double x,double y,double z,float nx,float ny,float nz,uchar red,uchar green,uchar blue,uchar alpha"
    head = f"ply\r\nformat {name} 1.0\r\ncomment VCGLIB generated\r\nobj_info from a scanner\r\nelement vertex 5\r\n"
    head += "".join(f"property {kind}\r\n" for kind in kinds.split(","))
    head += "element face 2\r\nproperty float quality\r\nproperty list uchar uint vertex_index\r\n"
    head += "property uchar flags\r\nelement edge 1\r\nproperty int vertex1\r\nproperty int vertex2\r\nend_header\r\n"
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 2, 0)]
    body = b"".join(struct.pack(order + "3d3f4B", *p, 0, 0, 1, *RED, 255) for p in points)
    body += struct.pack(order + "fB4IB", 0.5, 4, 0, 1, 2, 3, 7) + struct.pack(order + "fB3IB", 0.5, 3, 3, 2, 4, 7)
    (tmp_path / "a.PLY").write_bytes(head.encode() + body + struct.pack(order + "2i", 0, 1))
    mesh = read_mesh(tmp_path / "a.PLY")
    np.testing.assert_array_equal(mesh.vertices, points)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [3, 2, 4]])
    np.testing.assert_allclose(mesh.color, np.tile(linear(np.array(RED, np.uint8)), (len(mesh.faces), 3, 1)))


def test_ply_of_two_textures(tmp_path):
    """MeshLab's uv per corner with the number of the texture."""
    picture(tmp_path / "skin one.png")
    picture(tmp_path / "skin two.png", GREEN)
    text = "ply\nformat ascii 1.0\ncomment TextureFile skin one.png\ncomment TextureFile skin two.png\n"
    text += "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    text += "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
    text += "property int texnumber\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
    text += "".join(f"3 {face} 6{3 * ' 0.25 0.5'} {k}\n" for k, face in enumerate(("0 1 2", "0 2 3")))
    (tmp_path / "a.ply").write_text(text)
    mesh = read_mesh(tmp_path / "a.ply")
    np.testing.assert_array_equal(mesh.uv, np.broadcast_to([0.25, 0.5], (2, 3, 2)))
    assert [tuple(material.texture[-1, -1]) for material in mesh.materials] == [RED, GREEN]
    assert mesh.material.tolist() == [0, 1]


@pytest.mark.parametrize("statement", [
    "tex/A b.png", "tex\\A b.png", "TEX/a B.PNG", "C:\\Users\\artist\\Desktop\\final\\A b.png",
    "/home/artist/final/A b.png", "..\\..\\maps\\A b.png", "./tex/./A b.png", "A b.png", '"A b.png"',
    "-clamp on tex/A b.png", "-s 1 1 A b.png",
    "-blendu on -blendv off -s 1 1 1 -o 0 0 0 -mm 0 1 -bm 1.0 -texres 512 A b.png",
])  # fmt: skip
def test_textures_are_found_by_any_spelling(tmp_path, statement):
    """What trimesh loses silently: options, backslashes, capitals, the folders of somebody else's disk."""
    picture(tmp_path / "tex" / "A b.png")
    text = f"newmtl skin\nKa 0 0 0\nKd 0.8 0.8 0.8\nillum 2\n\tmap_Kd {statement}\nmap_Bump none.png\n"
    (tmp_path / "a.mtl").write_text(text)
    mesh = read_mesh(quad_obj(tmp_path / "a.obj", "skin", "skin", extra="mtllib a.mtl"))
    (material,) = mesh.materials
    assert tuple(material.texture[-1, -1]) == RED and tuple(material.texture[0, 0]) == (255, 255, 255)
    np.testing.assert_array_equal(material.color, 1)  # Kd beside a texture is an exporter's leftover
    np.testing.assert_array_equal(mesh.uv[0], [[0, 0], [1, 0], [1, 1]])


def test_a_texture_is_read_by_its_profile_as_a_photo_is_but_not_turned_and_in_glb_without_it(tmp_path):
    """A gamma of 1 says that the codes are linear; orientation 3 turns a photo upside down."""
    codes, exif = np.random.default_rng(0).integers(60, 200, (16, 16, 3), np.uint8), Image.Exif()
    exif[274] = 3
    info = PngImagePlugin.PngInfo()
    info.add(b"gAMA", (100000).to_bytes(4))  # linear
    Image.fromarray(codes).save(tmp_path / "t.png", pnginfo=info, exif=exif)
    (tmp_path / "a.mtl").write_text("newmtl skin\nmap_Kd t.png\n")
    read = read_mesh(quad_obj(tmp_path / "a.obj", "skin", "skin", extra="mtllib a.mtl")).materials[0].texture
    assert np.abs(read - encode(codes / 255) * 255).max() < 0.51
    np.testing.assert_array_equal(Picture.of(tmp_path / "t.png").pixels, read[::-1, ::-1])
    np.testing.assert_array_equal(read_texture((tmp_path / "t.png").read_bytes(), "t", by_profile=False), codes)


def test_obj_of_several_materials(tmp_path):
    """Two libraries, one in Latin-1, a name with a blank, a color without texture, and a texture scaled and moved."""
    picture(tmp_path / "t.png", GREEN)
    (tmp_path / "a.mtl").write_bytes("# \xe9t\xe9\r\nnewmtl jeans blue\r\nKd 0.5 0.25 1\r\n".encode("latin-1"))
    (tmp_path / "b.mtl").write_text("newmtl shirt\nmap_Kd -s 2 3 -o 0.5 t.png\n")
    mesh = read_mesh(quad_obj(tmp_path / "a.obj", "shirt", "jeans blue", extra="mtllib a.mtl b.mtl"))
    assert mesh.material.tolist() == [0, 0, 1, 1]
    np.testing.assert_allclose(mesh.materials[1].color, linear(np.array([0.5, 0.25, 1])))
    np.testing.assert_array_equal(mesh.uv[0], [[0.5, 0], [2.5, 0], [2.5, 3]])


@pytest.mark.parametrize("faces", [
    ("f 1 2 3 4", "f 5 6 7 8"),
    ("f 1//1 2//1 3//1 4//1", "f 5//1 6//1 7//1 8//1"),
    ("f 1/1/1 2/2/1 3/3/1 4/4/1", "f 5/1/1 6/2/1 7/3/1 8/4/1"),
    ("f 1/1 2/2 3/3 4/4", "f 5//1 6//1 7//1 8//1"),
    ("f -8 -7 -6 -5", "f -4/-4 -3/-3 -2/-2 -1/-1"),
    ("f 1 2 \\\n 3 4", "f  5/  6/\t7/ 8/ # the last"),
])  # fmt: skip
def test_obj_corners_in_every_form(tmp_path, faces):
    mesh = read_mesh(quad_obj(tmp_path / "a.obj", "none", "none", faces=faces, extra="vn 0 0 1"))
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    assert "names no .mtl" in mesh.info["warnings"][0]


def test_obj_indices_count_back_from_their_own_line(tmp_path):
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "f -3 -2 -1", "v 5 5 5", "f -4 -3 -1"]
    (tmp_path / "a.obj").write_text("\r\n".join(lines))
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.obj").faces, [[0, 1, 2], [0, 1, 3]])


def test_long_obj_is_the_same_in_chunks(tmp_path, truth, monkeypatch):
    truth.export(tmp_path / "a.obj")
    whole = read_mesh(tmp_path / "a.obj")
    monkeypatch.setattr("relight.meshes.obj_lines.CHUNK", 7)
    pieces = read_mesh(tmp_path / "a.obj")
    np.testing.assert_array_equal(whole.vertices, pieces.vertices)
    np.testing.assert_array_equal([whole.faces, pieces.faces], [truth.faces] * 2)
    np.testing.assert_allclose(whole.vertices, truth.vertices, atol=1e-6)


def test_gltf_features_by_hand(tmp_path):
    """Strided and normalised data, an external file with a blank, nested nodes, the second coordinates, a strip."""
    picture(tmp_path / "my tex.png")
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 5]], "<f4")
    strided = np.concatenate([points, np.full((4, 1), 9, "<f4")], axis=1).tobytes()
    uv = np.array([[0, 0], [255, 0], [0, 255], [255, 255]], "u1").tobytes()
    color = np.array([[65535, 0, 0, 65535]] * 4, "<u2").tobytes()
    (tmp_path / "a b.bin").write_bytes(data := strided + uv + color)
    views = [(0, 64, {"byteStride": 16}), (64, 8, {"byteStride": 2}), (72, 32, {})]
    scene = {
        "asset": {"version": "2.0"},
        "nodes": [{"children": [1], "scale": [2, 2, 2]},
                  {"mesh": 0, "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)], "translation": [1, 0, 0]}],
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_1": 1, "COLOR_0": 2}, "material": 0, "mode": 5}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "my%20tex.png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5121, "normalized": True, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "normalized": True, "count": 4, "type": "VEC4"},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": size, **more} for start, size, more in views],
        "buffers": [{"byteLength": len(data), "uri": "a%20b.bin"}],
    }  # fmt: skip
    (tmp_path / "a.gltf").write_text(json.dumps(scene))
    mesh = read_mesh(tmp_path / "a.gltf")
    np.testing.assert_allclose(mesh.vertices, [[2, 0, 0], [2, 2, 0], [0, 0, 0], [0, 2, 10]], atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [3, 2, 1]])
    np.testing.assert_allclose(mesh.uv[0], [[0, 1], [1, 1], [0, 0]], atol=1e-6)
    np.testing.assert_allclose(mesh.color, np.tile([1, 0, 0], (2, 3, 1)))  # glTF's vertex colors are linear


def test_coordinates_far_from_the_origin_keep_their_shape(tmp_path, truth):
    """Geographic coordinates in doubles: as float32 they would lie in steps of half a metre."""
    far = np.array([3.5e6, 5.4e6, 400.0])
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in truth.vertices + far]
    lines += [f"f {a} {b} {c}" for a, b, c in truth.faces + 1]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    mesh = read_mesh(tmp_path / "a.obj")
    np.testing.assert_allclose(mesh.vertices + np.array(mesh.info["origin"]) - far, truth.vertices, atol=2e-6)
    baked, aligned = bake_vertices(mesh, 1), align(mesh, Align("+y", "+z"))
    np.testing.assert_allclose(baked.vertices + baked.origin - far, truth.vertices, atol=2e-6)
    record = aligned.info["align"]
    back = aligned.vertices / record["scale"] @ np.array(record["rotation"]) + record["centre"]
    np.testing.assert_allclose(back - far, truth.vertices, atol=1e-5)
    told = " ".join(mesh.info["warnings"])
    assert re.search(r"far from 0: \(3500\d{3}\S*, 5400\d{3}\S*, \d\S*\) is subtracted", told)


@pytest.mark.parametrize(("far", "kind", "warned"), [(1e6, "f4", True), (1e6, "f8", False), (100, "f4", False)])
def test_coordinates_rounded_far_from_the_origin_are_warned_of(tmp_path, truth, far, kind, warned):
    vertices = (truth.vertices + far).astype(kind)
    lines = [*("v {} {} {}".format(*map(repr, map(float, place))) for place in vertices)]
    lines += ["f {} {} {}".format(*face) for face in truth.faces + 1]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    told = " ".join(read_mesh(tmp_path / "a.obj").info["warnings"])
    assert ("rounded to steps of 0.062, 3.6% of its size" in told) == ("rounded" in told) == warned
