"""What meshes may say, and the right value: names, code pages, colors, polygons, extensions, wrap modes, tables."""

import base64
import codecs
import json
import struct

import numpy as np
import pytest
from PIL import Image
from samples import encoded, glb_of

from relight.core.errors import UserError
from relight.meshes import Mesh, list_scans, read_mesh
from relight.meshes.gltf_file import READ, WITHOUT_EFFECT
from relight.meshes.polygons import triangulate
from relight.transport.surface import sample_albedo

POINTS = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
FACE, RED = b"f 1 2 3\n", b"newmtl %s\nKd 1 0 0\n"
ORANGE = (1, 0.2159, 0)  # 255 128 0


def write(folder, files):
    """Writes files by name, str or bytes; returns the first."""
    for name, content in files.items():
        with open(bytes(folder) + b"/" + (name if isinstance(name, bytes) else name.encode()), "wb") as file:
            file.write(content)
    first = next(iter(files))
    return folder / (first if isinstance(first, str) else first.decode())


def png(*colors) -> bytes:
    return encoded(Image.fromarray(np.array([colors], np.uint8)), "png")


def albedo(mesh, face=0, weights=(1 / 3, 1 / 3, 1 / 3)):
    return sample_albedo(mesh, np.array([face]), np.array([weights]))[0]


def used(name: bytes, library: bytes = b"a.mtl") -> bytes:
    return b"mtllib " + library + b"\n" + POINTS + b"usemtl " + name + b"\n" + FACE


def says(text: bytes, page: str) -> bytes:
    return text.decode("utf-8").encode(page)


# Files by which the triangle is red.
TEXTS = {
    "utf-8 mark in .obj": {"a.obj": codecs.BOM_UTF8 + used(b"A"), "a.mtl": RED % b"A"},
    "utf-16 .obj": {"a.obj": used(b"A").decode().encode("utf-16"), "a.mtl": RED % b"A"},
    "utf-16 .mtl without a mark": {"a.obj": used(b"A"), "a.mtl": (RED % b"A").decode().encode("utf-16-le")},
    "marks where files were joined": {
        "a.obj": used(b"A").replace(b"usemtl", codecs.BOM_UTF8 + b"usemtl"), "a.mtl": RED % b"A"},
    "lines that end in CR CR LF": {"a.obj": used(b"A").replace(b"\n", b"\r\r\n"), "a.mtl": RED % b"A"},
    "tabs and blanks": {"a.obj": used(b"A \t").replace(b"\n", b" \n\t"), "a.mtl": (RED % b"A").replace(b" ", b"\t")},
    "a comment that ends in a folder": {"a.obj": b"# C:\\scans\\\n" + used(b"A"),
                                        "a.mtl": b"# C:\\scans\\\r\n" + RED % b"A"},
    "a name with accents in two parts": {"a.obj": used("Zoë".encode()), "a.mtl": RED % "Zoe\u0308".encode()},
    "a library on another computer": {"a.obj": used(b"A", b"C:\\My scans\\A.MTL"), "a.mtl": RED % b"A"},
    "zeros at the end": {"a.obj": used(b"A") + bytes(9), "a.mtl": RED % b"A" + b"\x1a"},
    "a name that ends in 5C in Shift-JIS": {"a.obj": used("表".encode("cp932")), "a.mtl": RED % "表".encode("cp932")},
    "# in a name": {"a.obj": used(b"Grey #1"), "a.mtl": RED % b"Grey #1"},
    "# in the name of a library": {"a.obj": used(b"A", b"c#1.mtl"), "c#1.mtl": RED % b"A"},
    "a comment after a name": {"a.obj": used(b"A # the skin"), "a.mtl": RED % b"A"},
    "a comment after numbers": {"a.obj": used(b"A").replace(b"v 0 0 0", b"v 0 0 0# first"), "a.mtl": RED % b"A"},
    "a library in quotes": {"a.obj": used(b"A", b'"my lib.mtl"'), "my lib.mtl": RED % b"A"},
    "a name in quotes": {"a.obj": used(b'"A"'), "a.mtl": RED % b"A"},
    "a library of another code page": {"a.obj": used(b"A", b"K\xf6rper.mtl"), "Körper.mtl": RED % b"A"},
    "a library whose name is no text": {"a.obj": used(b"A", b"K\xf6rper.mtl"), b"K\xf6rper.mtl": RED % b"A"},
    "a texture in Shift-JIS": {
        "a.obj": used(b"A").replace(b"f 1 2 3", b"vt 0 0\nf 1/1 2/1 3/1"),
        "a.mtl": b"newmtl A\nmap_Kd tex\\" + "表.png".encode("cp932"),
        "表.png": png((255, 0, 0)),
    },
    "a texture with # and a blank": {
        "a.obj": used(b"A").replace(b"f 1 2 3", b"vt 0 0\nf 1/1 2/1 3/1"),
        "a.mtl": b"newmtl A\nmap_Kd skin #2.png\n",
        "skin #2.png": png((255, 0, 0)),
    },
}  # fmt: skip


COLORED = b"v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\n"
SOME, FOUR = b"v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0\n", b"v 0 0 0 %s\nv 1 0 0 %s\nv 0 1 0 %s\n"
TWICE = b"vt 0 0\nv 0 0 0 %s\nv 1 0 0 %s\nv 0 1 0 %s\nusemtl B\nf 1/1 2/1 3/1\n"
# The text of an .obj beside a red material A and a textured B; the albedo of its last face, and what a warning says.
SYNTAX = {
    "no materials, no colors": (POINTS + FACE, (1, 1, 1), "neither materials nor vertex colors"),
    "a material of a library that is not named": (POINTS + b"usemtl A\n" + FACE, (1, 1, 1), "names no .mtl file"),
    "`v x y z r g b` of 1 .502 0": (FOUR % (3 * (b"1 .50196 0",)) + FACE, ORANGE, ""),
    "`v x y z r g b` of 255 128 0": (FOUR % (3 * (b"255 128 0",)) + FACE, ORANGE, ""),
    # Programs write the same color twice, or black or random colors beside a texture.
    **{f"`map_Kd` of code 188, vertex colors {color.decode()}": (
        b"mtllib a.mtl\n" + TWICE % (3 * (b" ".join(3 * [color]),)), 3 * (0.5029,), "vertex colors are left out")
        for color in (b".7373", b".5", b"0")},
    "coordinates that are not there": (POINTS + b"f 1/7 2/8 3/9\n", (1, 1, 1), "neither materials"),
    "`usemtl` without a name": (
        used(b"A") + b"usemtl\nf 1 3 2\n", (1, 1, 1), "1 of 2 faces have neither a material nor vertex colors"),
    "a face before the first material": (used(b"A").replace(b"usemtl", b"f 1 2 3\nusemtl"), (1, 0, 0), "1 of 2 faces"),
    "a library that no face needs": (b"mtllib gone.mtl\n" + COLORED + FACE, (1, 0, 0), "no face needs it"),
    "a material that no face uses": (b"mtllib gone.mtl\n" + COLORED + FACE + b"usemtl B\n", (1, 0, 0), "no face needs"),
    "vertex colors of some vertices": (SOME + FACE, (1, 1, 1), "some vertices have colors and others none"),
    "`v x y z w r g b` of 1 1 0 0": (FOUR % (3 * (b"1 1 0 0",)) + FACE, (1, 0, 0), "a weight and red, green and blue"),
    "x y z w": (FOUR % (3 * (b"1",)) + FACE, (1, 1, 1), "neither"),
    "`v x y z r g b a` of 0 1 0 1": (FOUR % (3 * (b"0 1 0 1",)) + FACE, (0, 1, 0), "red, green, blue and alpha"),
    "colors of 0 to 65535": (COLORED.replace(b" 1 0 0\n", b" 65535 0 0\n") + FACE, (1, 0, 0), ""),
    "`Kd 1 0 0`, vertex colors 0 0 1": (
        b"mtllib a.mtl\n" + COLORED.replace(b"1 0 0\n", b"0 0 1\n") + b"usemtl A\n" + FACE,
        (0, 0, 1), "in place of the colors of its materials"),
    "white colors beside a material": (used(b"A").replace(b"0\n", b"0 1 1 1\n"), (1, 0, 0), ""),
}  # fmt: skip


# libraries of the material A -> its color, and what a warning says
LIBRARIES = {
    "`Kd 1 .502 0`": ({"a.mtl": b"newmtl A\nKd 1 .50196 0\n"}, ORANGE, ""),
    "`Kd 255 128 0`": ({"a.mtl": b"newmtl A\nKd 255 128 0\n"}, ORANGE, ""),
    "a material that is defined twice, red and green": (
        {"a.mtl": RED % b"A" + b"newmtl A\nKd 0 1 0\n"}, (0, 1, 0), "material 'A' twice: the last one counts"),
    "in two files": ({"a.mtl": RED % b"A", "b.mtl": b"newmtl A\nKd 0 1 0\n"}, (0, 1, 0), "b.mtl defines the material"),
    "one file twice": ({"a.mtl": RED % b"A", "./a.mtl": RED % b"A"}, (1, 0, 0), ""),
    "one number": ({"a.mtl": b"newmtl A\nKd 1\n"}, (1, 1, 1), "are all white"),
    "`Kd 0 0 1`, `map_Kd` of a red picture": (
        {"a.mtl": b"newmtl A\nKd 0 0 1\nmap_Kd -bm 1 -s 2 2 2 t.png # skin\n"}, (1, 0, 0), ""),
}  # fmt: skip


def ply(rows, properties="", face="", form="ascii", comment="") -> bytes:
    """An ascii .ply of a triangle; `rows` are what follows the coordinates of each vertex, and the corners."""
    head = f"ply\nformat {form} 1.0\n{comment}element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "".join(f"property {line}\n" for line in properties.split(", ") if line)
    head += "element face 1\nproperty list uchar int vertex_indices\n"
    head += "".join(f"property {line}\n" for line in face.split(", ") if line) + "end_header\n"
    points = "".join(f"{point} {rows[0]}\n" for point in ("0 0 0", "1 0 0", "0 1 0"))
    return (head + points + f"3 0 1 2 {rows[1]}\n").encode()


def channels(kind: str, names: str = "red green blue") -> str:
    return ", ".join(f"{kind} {name}" for name in names.split())


# name -> (file, albedo, what a warning says)
PLYS = {
    "vertex colors, `uchar` 255 128 0": (ply(("255 128 0", ""), channels("uchar")), ORANGE, ""),
    "vertex colors, `uchar` 1 1 0": (ply(("1 1 0", ""), channels("uchar")), (3e-4, 3e-4, 0), "taken as codes"),
    "vertex colors, `ushort` 65535 32896 0": (ply(("65535 32896 0", ""), channels("ushort")), ORANGE, ""),
    "vertex colors, `ushort` 255 128 0": (ply(("255 128 0", ""), channels("ushort")), ORANGE, "codes of 0 to 255"),
    "vertex colors, `int` 255 128 0": (ply(("255 128 0", ""), channels("int")), ORANGE, ""),
    "uint of 32 bits": (ply(("4294967295 2155905152 0", ""), channels("uint")), ORANGE, "0 to 4294967295"),
    "vertex colors, `float` 1 0.502 0": (ply(("1 0.50196 0", ""), channels("float")), ORANGE, ""),
    "vertex colors, `float` 255 128 0": (ply(("255 128 0", ""), channels("float")), ORANGE, ""),
    "double a little above 1": (ply(("1.5 0.50196 0", ""), channels("double")), ORANGE, "clipped to 1"),
    "char, the sign bit of 255": (ply(("-1 -128 0", ""), channels("char")), ORANGE, ""),
    "vertex colors named `r g b`, 255 128 0": (ply(("255 128 0", ""), channels("uchar", "r g b")), ORANGE, ""),
    "diffuse": (ply(("255 128 0", ""), channels("uchar", "diffuse_red diffuse_green diffuse_blue")), ORANGE, ""),
    "colors of faces, 255 128 0": (ply(("", "255 128 0"), face=channels("uchar")), ORANGE, ""),
    "colors of vertices 255 128 0 and of faces 0 0 255": (
        ply(("255 128 0", "0 0 255"), channels("uchar"), channels("uchar")), ORANGE, "colors of faces are left out"),
    "no colors": (ply(("", "")), (1, 1, 1), "neither materials nor vertex colors"),
    "texture coordinates, but no texture": (ply(("0 0", ""), channels("float", "s t")), (1, 1, 1), "names no texture"),
    "`TextureFile` in quotes, of 255 128 0, vertex colors 9 9 9": (
        ply(("0 0 9 9 9", ""), channels("float", "u v") + ", " + channels("uchar"),
            comment='comment TextureFile "t.png"\n'), ORANGE, "vertex colors are left out"),
    "vertex colors, `float` 1 -0.5 0": (
        ply(("1 -0.5 0", ""), channels("float")), (1, 0, 0), "values down to -0.5 are clipped to 0"),
    "vertex colors, `float` 1 nan 0": (ply(("1 nan 0", ""), channels("float")), (1, 0, 0), "3 values are not numbers"),
    "of two types": (ply(("1 128 0", ""), "float red, uchar green, uchar blue"), (1, 1, 1), "of different types"),
    "blue first, and alpha": (ply(("0 128 255 9", ""), channels("uchar", "blue green red alpha")), ORANGE, ""),
    **{f"{count} textures for no face": (
        ply(("", "6 0 0 0 0 0 0 -1"), face="list uchar float texcoord, int texnumber",
            comment="comment TextureFile t.png\n" * count), (1, 1, 1), "1 of 1 faces have neither")
        for count in (1, 2)},
    "byte order mark": (codecs.BOM_UTF8 + ply(("255 128 0", ""), channels("uchar")), ORANGE, ""),
    "CR": (ply(("255 128 0", ""), channels("uchar")).replace(b"\n", b"\r"), ORANGE, ""),
}  # fmt: skip


@pytest.mark.parametrize(("face", "values", "says"), [
    ("list uchar float texcoord", "6 0 0 0 0 0 0", "names 2 textures, but its faces have no `texnumber`"),
    ("list uchar float texcoord, int texnumber", "6 0 0 0 0 0 0 2", r"has texture 2 \(counted from 0\), but there"),
    ("list uchar float texcoord, int texnumber", "6 0 0 0 0 0 0 -2", "has texture -2"),
])  # fmt: skip
def test_ply_of_several_textures_that_does_not_say_which_is_refused(tmp_path, face, values, says):
    text = ply(("", values), face=face, comment="comment TextureFile t.png\n" * 2)
    with pytest.raises(UserError, match=says):
        read_mesh(write(tmp_path, {"a.ply": text, "t.png": png((255, 0, 0))}))


@pytest.mark.parametrize("order", ["<", ">"])
def test_ply_with_faces_before_vertices_that_begin_with_a_list(tmp_path, order):
    form = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = f"ply\nformat {form} 1.0\nelement face 1\nproperty list uchar int vertex_index\nelement vertex 3\n"
    head += "property list uchar short tags\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    head += "".join(f"property ushort {name}\n" for name in ("red", "green", "blue")) + "end_header\n"
    body = struct.pack(order + "B3i", 3, 0, 1, 2)
    for tags, point in zip(((), (7,), (7, 8)), ((0, 0, 0), (1, 0, 0), (0, 1, 0))):
        body += struct.pack(f"{order}B{len(tags)}h3f3H", len(tags), *tags, *point, 65535, 32896, 0)
    mesh = read_mesh(write(tmp_path, {"a.ply": head.encode() + body}))
    np.testing.assert_allclose(albedo(mesh), ORANGE, atol=1e-4)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_binary_ply_begins_after_its_own_line_end(tmp_path, end):
    """The first byte of the data is a line feed, which no line end of the header may take."""
    head = ply(("", ""), form="binary_little_endian").split(b"end_header\n")[0] + b"end_header\n"
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    points[0, 0] = np.frombuffer(b"\n\0\0\0", "<f4")[0]
    body = points.tobytes() + struct.pack("<B3i", 3, 0, 1, 2)
    mesh = read_mesh(write(tmp_path, {"a.ply": head.replace(b"\n", end) + body}))
    np.testing.assert_array_equal(mesh.vertices, points)


# Corners of polygons in a plane, and their area by the shoelace formula.
POLYGONS = {
    "arrow": [(0, 0), (0.2, 0.2), (1, 0), (0, 1)],
    "arrow from its reflex corner": [(0.2, 0.2), (1, 0), (0, 1), (0, 0)],
    "L": [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)],
    "star": [(r * np.cos(a), r * np.sin(a)) for a, r in zip(np.arange(10) * np.pi / 5, [1, 0.3] * 5)],
    "comb": [(0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (4, 1), (4, 3), (3, 3), (3, 1), (1, 1), (1, 3), (0, 3)],
    "a corner in a straight line": [(0, 0), (1, 0), (2, 0), (2, 2), (1, 1), (0, 2)],
    "twice the same corner": [(0, 0), (2, 0), (2, 0), (2, 2), (1, 0.5), (0, 2)],
    "hole with a bridge": [(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)],
    "convex": [(0, 0), (2, 0), (3, 1), (2, 2), (0, 2)],
}


@pytest.mark.parametrize("name", POLYGONS)
@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (0, 2, 1)])
def test_polygons_are_cut_inside(tmp_path, name, axes):
    flat = np.array(POLYGONS[name], float)
    corners = np.column_stack([flat, 0.3 * flat[:, 0]])[:, axes]
    lines = [" ".join(map(str, corner)) for corner in corners.tolist()]
    text = "".join(f"v {line}\n" for line in lines) + "f " + " ".join(map(str, range(1, len(lines) + 1)))
    mesh = read_mesh(write(tmp_path, {"a.obj": text.encode()}))
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    normals, whole = np.cross(b - a, c - a), np.cross(corners, np.roll(corners, -1, axis=0)).sum(0)
    assert len(mesh.faces) == len(lines) - 2
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1).sum(), np.linalg.norm(whole), rtol=1e-6)
    assert (normals @ whole >= -1e-6).all()


def test_triangulate_refuses_what_would_take_minutes():
    zigzag = np.column_stack([np.arange(1200), np.arange(1200) % 2, np.zeros(1200)])
    corners = np.concatenate([zigzag, zigzag[::-1] + [0, 3, 0]])
    with pytest.raises(UserError, match="2400 corners: cut it into triangles"):
        triangulate("a", np.array([2400]), np.arange(2400), corners)


DARK_RED = png((200, 0, 0))
STRIPES = png((255, 0, 0), (255, 0, 0), (0, 0, 255), (0, 0, 255))
RED_, BLUE_ = (1, 0, 0), (0, 0, 1)


def glb(change=lambda scene: None, picture=DARK_RED, uv=(0.5, 0.5), color=b"", pad=b" ") -> bytes:
    """A textured triangle; `change` alters its description."""
    parts = [np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes(), np.full((3, 2), uv, "<f4").tobytes(),
             picture, color]  # fmt: skip
    start = np.cumsum([0, *map(len, parts)]).tolist()
    scene = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 2}],
        "samplers": [{}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": s, "byteLength": len(p)} for s, p in zip(start, parts)],
        "buffers": [{"byteLength": start[-1]}],
    }
    change(scene)
    return glb_of(scene, b"".join(parts), pad)


def legacy(scene):
    texture = scene["materials"][0].pop("pbrMetallicRoughness")["baseColorTexture"]
    extension = {"diffuseTexture": texture, "diffuseFactor": [1, 1, 1, 1]}
    scene["materials"][0]["extensions"] = {"KHR_materials_pbrSpecularGlossiness": extension}


def source_in(name):
    def change(scene):
        scene["textures"] = [{"extensions": {name: {"source": 0}}}]

    return change


REQUIRED = {
    "EXT_texture_webp": (source_in("EXT_texture_webp"), "WEBP"),
    "EXT_texture_avif": (source_in("EXT_texture_avif"), "AVIF"),
    "MSFT_texture_dds": (source_in("MSFT_texture_dds"), "DDS"),
    "KHR_materials_pbrSpecularGlossiness": (legacy, "PNG"),
    "KHR_texture_transform": (lambda scene: None, "PNG"),
    "KHR_materials_specular": (lambda scene: None, "PNG"),
    **{name: (lambda scene: None, "PNG") for name in sorted(WITHOUT_EFFECT)},
}


@pytest.mark.parametrize("name", REQUIRED)
def test_gltf_may_require_each_extension_that_is_read(tmp_path, name):
    assert READ | WITHOUT_EFFECT == REQUIRED.keys()
    change, kind = REQUIRED[name]

    def require(scene):
        change(scene)
        scene["extensionsRequired"] = [name]

    mesh = read_mesh(write(tmp_path, {"a.glb": glb(require, encoded(Image.new("RGB", (4, 4), (200, 0, 0)), kind))}))
    np.testing.assert_allclose(albedo(mesh), [0.578, 0, 0], atol=0.01)


def node(**values):
    return lambda scene: scene["nodes"][0].update(values)


def placed(**values):
    """KHR_texture_transform."""
    texture = {"index": 0, "extensions": {"KHR_texture_transform": values}}
    return lambda scene: scene["materials"][0]["pbrMetallicRoughness"].update(baseColorTexture=texture)


def picture_at(uri):
    return lambda scene: scene.update(images=[{"uri": uri}])


def two_meshes(scene):
    scene["meshes"].append({"primitives": [{"attributes": {"POSITION": 0}}]})
    scene["nodes"].insert(0, {"mesh": 1})


def factor(*values):
    return lambda scene: scene["materials"][0].update(pbrMetallicRoughness={"baseColorFactor": values})


def emitting(base, factor=None, textured=True, legacy=False):
    def change(scene):
        color = {"diffuseFactor" if legacy else "baseColorFactor": base} if base else {}
        scene["materials"][0] = {"extensions": {"KHR_materials_pbrSpecularGlossiness": color}} if legacy else {
            "pbrMetallicRoughness": color}  # fmt: skip
        scene["materials"][0] |= {"emissiveFactor": factor} if factor else {}
        scene["materials"][0] |= {"emissiveTexture": {"index": 0}} if textured else {}

    return change


def both(extension, base):
    """Both workflows in one material; readers that know the extension take it in place of the other."""
    known = {"extensions": {"KHR_materials_pbrSpecularGlossiness": extension}}
    return lambda scene: scene.update(materials=[{"pbrMetallicRoughness": base} | known])


def bare(material):
    def change(scene):
        scene["materials"] = [] if material is None else [material]
        if material is None:
            scene["meshes"][0]["primitives"][0].pop("material")

    return change


def wrapped(wrap):
    return lambda scene: wrap and scene.update(samplers=[{"wrapS": wrap}], textures=[{"source": 0, "sampler": 0}])


def colored(component, normalized):
    def change(scene):
        scene["meshes"][0]["primitives"][0] = {"attributes": {"POSITION": 0, "COLOR_0": 2}}
        accessor = {"bufferView": 3, "componentType": component, "count": 3, "type": "VEC3"}
        scene["accessors"].append({**accessor, "normalized": normalized})

    return change


def text_of(content: bytes) -> str:
    """A .glb as the text of a .gltf."""
    end = 20 + struct.unpack_from("<I", content, 12)[0]
    scene, data = json.loads(content[20:end]), base64.b64encode(content[end + 8 :]).decode()
    scene["buffers"][0]["uri"] = "data:application/octet-stream;base64," + data
    return json.dumps(scene, ensure_ascii=False)


def tinted(scene):
    scene["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 0.5, 0.5, 1]
    scene["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2
    scene["accessors"].append({"bufferView": 3, "byteOffset": 4, "componentType": 5126, "count": 3, "type": "VEC3"})


COPIES = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}
CODED_PICTURE = base64.b64encode(DARK_RED).decode()
DARK = (0.5776, 0, 0)
SLOT, BASE = {"diffuseTexture": {"index": 0}}, {"baseColorTexture": {"index": 0}}
# what a description says -> albedo of the last face, and what a warning says
SCENES = {
    "factor 255 128 0": (factor(255, 128, 0, 255), (1, 1, 0), "outside 0 to 1: it is clipped"),
    "a factor": (factor(0.5, 0.2, 0, 1), (0.5, 0.2, 0), ""),
    "factor 0, `emissiveTexture` of 200 0 0": (emitting((0, 0, 0, 1)), DARK, "is black but for what it emits"),
    "black that emits a texture by half": (emitting((0, 0, 0, 1), (0.5, 1, 1)), (0.2888, 0, 0), "black but for"),
    "black that emits a texture by 0": (emitting((0, 0, 0, 1), (0, 0, 0)), DARK, "black but for"),
    "black that emits a color": (emitting((0, 0, 0, 1), (0.5, 0.2, 0), False), (0.5, 0.2, 0), "black but for"),
    "legacy black that emits a texture": (emitting((0, 0, 0, 1), legacy=True), DARK, "is black but for"),
    "a stand-in of red, legacy texture": (both(SLOT, {"baseColorFactor": [1, 0.5, 0, 1]}), DARK, ""),
    "a stand-in texture, legacy factor .2": (both({"diffuseFactor": [0.2, 0.2, 0.2, 1]}, BASE), (0.2, 0.2, 0.2), ""),
    "a stand-in of green, legacy texture and factor": (
        both(SLOT | {"diffuseFactor": [0.5, 1, 1, 1]}, {"baseColorFactor": [0, 1, 0, 1]}), (0.2888, 0, 0), ""),
    "a color, legacy gloss alone": (both({"glossinessFactor": 0.1}, {"baseColorFactor": [0, 1, 0, 1]}), (0, 1, 0), ""),
    "a color that emits a texture": (emitting((0.5, 0.2, 0, 1)), (0.5, 0.2, 0), ""),
    "white that emits a little": (emitting((1, 1, 1, 1), (0.1, 0, 0), False), (1, 1, 1), "are all white"),
    "factor 0": (factor(0, 0, 0, 1), (0, 0, 0), "1 of 1 faces are black"),
    "a texture of 200 0 0, factor .5, vertex colors .4": (tinted, (0.1155, 0, 0), ""),
    "no material, no colors": (bare(None), (1, 1, 1), "neither materials nor vertex colors"),
    "an empty material": (bare({}), (1, 1, 1), "neither materials nor vertex colors"),
    "morph targets at rest": (lambda scene: scene["meshes"][0].update(weights=[0, 0]), DARK, ""),
    "morph targets of the mesh": (lambda scene: scene["meshes"][0].update(weights=[0, 1]), DARK, "morph targets are"),
    "a texture of 200 0 0, a morph target in use": (
        node(weights=[0.5]), DARK, "morph targets are left out: apply them before export"),
    "hidden nodes": (lambda scene: scene.update(extensionsUsed=["KHR_node_visibility"]), DARK, "switches of vis"),
    "copies": (node(extensions=COPIES), DARK, "copies (EXT_mesh_gpu_instancing) are left out"),
    "animations": (lambda scene: scene.update(animations=[{"channels": []}]), DARK, "its animations are left out"),
    "a texture moved to the right": (placed(offset=[0.5, 0]), BLUE_, ""),
    "a texture turned by half": (placed(rotation=np.pi), BLUE_, ""),
    "a texture scaled": (placed(scale=[3, 1]), BLUE_, ""),
    "a second mesh without material": (two_meshes, DARK, "1 of 2 faces have neither"),
    "a picture in capitals": (picture_at("DATA:image/png;base64," + CODED_PICTURE), DARK, ""),
    "a picture in lines": (picture_at("data:image/png;base64,\n" + CODED_PICTURE.replace("g", "g\r\n ")), DARK, ""),
    "a picture in a folder of Windows": (picture_at("textures\\T.PNG"), DARK, ""),
}  # fmt: skip


@pytest.mark.parametrize(("values", "corner", "up"), [
    ({"rotation": [0, 0, 2, 2]}, (0, 1, 0), 1),  # a quaternion that is not of length 1
    ({"rotation": [0, 0, 0, 0]}, (1, 0, 0), 1),
    ({"scale": [-1, 1, 1]}, (-1, 0, 0), 1),
    ({"scale": [-1, -1, 1]}, (-1, 0, 0), 1),
    ({"matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}, (-1, 0, 0), 1),
])  # fmt: skip
def test_gltf_node_turns_and_mirrors(tmp_path, values, corner, up):
    """The second corner, and the side that the triangle shows, which a mirror image keeps."""
    mesh = read_mesh(write(tmp_path, {"a.glb": glb(node(**values))}))
    np.testing.assert_allclose(mesh.vertices[1], corner, atol=1e-6)
    a, b, c = mesh.vertices[mesh.faces[0]]
    assert np.sign(np.cross(b - a, c - a)[2]) == up


WRAP = {"nothing": None, "`REPEAT`": 10497, "`CLAMP_TO_EDGE`": 33071, "`MIRRORED_REPEAT`": 33648}
# how a texture, red on the left and blue on the right, is wrapped at u -> u, wrap, albedo, no warning
WRAPS = {
    f"a texture red on the left, blue on the right, at u = {u}, wrap {wrap}": (u, WRAP[wrap], color, "")
    for u, wrap, color in (
        (1.25, "nothing", RED_), (1.25, "`REPEAT`", RED_), (-0.3, "`REPEAT`", BLUE_),
        (1.25, "`CLAMP_TO_EDGE`", BLUE_), (-0.3, "`CLAMP_TO_EDGE`", RED_), (0.01, "`CLAMP_TO_EDGE`", RED_),
        (0.99, "`CLAMP_TO_EDGE`", BLUE_), (1.25, "`MIRRORED_REPEAT`", BLUE_), (-0.3, "`MIRRORED_REPEAT`", RED_),
        (2.25, "`MIRRORED_REPEAT`", RED_), (-1.25, "`MIRRORED_REPEAT`", BLUE_),
    )
}  # fmt: skip


@pytest.mark.parametrize(("kind", "component"), [("<u1", 5121), ("<u2", 5123)])
@pytest.mark.parametrize("normalized", [True, False])
def test_gltf_texture_coordinates_of_integers(tmp_path, kind, component, normalized):
    """0.8 of the largest integer is on the right; as whole numbers they would repeat the texture."""
    right = int(0.8 * np.iinfo(kind).max)

    def change(scene):
        scene["bufferViews"][1]["byteLength"] = 6 * np.dtype(kind).itemsize
        scene["accessors"][1].update(componentType=component, normalized=normalized)

    content = glb(change, STRIPES)
    place = content.index(np.full(6, 0.5, "<f4").tobytes())
    numbers = np.array([(right, np.iinfo(kind).max // 2)] * 3, kind).tobytes()
    path = write(tmp_path, {"a.glb": content[:place] + numbers + content[place + len(numbers) :]})
    np.testing.assert_allclose(albedo(read_mesh(path)), BLUE_, atol=1e-6)


TEXTURED = used(b"A").replace(b"f 1 2 3", b"vt .25 .5\nf 1/1 2/1 3/1")
# Statements beside t.png, red on the left and blue on the right -> albedo at u = .25, and what a warning says.
STATEMENTS = {
    "Ka 1 1 1\nKd 1 1 1\nmap_Ka t.png": (RED_, "its only texture t.png is of map_ka: taken as the color"),
    "Kd 0 0 0\nKe 1 1 1\nmap_Ke t.png": (RED_, "is of map_ke: taken as the color"),
    "map_Ke black.png\nmap_Ka t.png": (RED_, "is of map_ka"),
    "map_Ka gone.png\nmap_Kd t.png\nmap_Ke gone.png": (RED_, ""),
    "map_Kd t.png\nmap_Ka black.png\nKd 0 0 0": (RED_, ""),
    "map_Kd\nmap_Ka t.png": (RED_, "is of map_ka"),
    "KD 0 0 0\nMAP_KA -O .5 T.PNG": (BLUE_, "is of map_ka"),
    "map_Ka -s 3 1 1 -blendu off -o 0 0 0 t.png": (BLUE_, "is of map_ka"),
    "map_Ka C:\\scans\\my body\\t.png": (RED_, "is of map_ka"),
    "map_Ka \"my skin.png\"": (BLUE_, "texture my skin.png is of map_ka"),
    "Kd 0 0 0\nmap_Kd -S 5 -CLAMP OFF t.png": (RED_, ""),
    "map_Kd -s 5 t.png": (RED_, ""),
    "map_Kd -s 5 -clamp on t.png": (BLUE_, ""),
    "Kd 0 0 0\nmap_d t.png\nbump t.png": ((0, 0, 0), "1 of 1 faces are black"),
    "Kd 1 1 1\nmap_Ks t.png\nrefl -type sphere t.png": ((1, 1, 1), "are all white"),
    "Kd 0 0 0\nKe 1 .5 .2": ((0, 0, 0), "faces are black"),
}  # fmt: skip


TINT = (1, 0.2, 0)  # linear, by the standard
# vertex colors -> type of numbers, its code, whether it is marked as normalised, values, albedo, no warning
COLORS = {
    "vertex colors of bytes": ("<u1", 5121, True, (255, 51, 0), TINT, ""),
    "vertex colors of integers, not marked as normalised, 255 51 0": ("<u1", 5121, False, (255, 51, 0), TINT, ""),
    "vertex colors of 16 bits": ("<u2", 5123, True, (65535, 13107, 0), TINT, ""),
    "vertex colors of 16 bits, not marked": ("<u2", 5123, False, (65535, 13107, 0), TINT, ""),
    "vertex colors of floats": ("<f4", 5126, False, (1, 0.2, 0), TINT, ""),
    "vertex colors of floats up to 255": ("<f4", 5126, False, (255, 51, 0), TINT, ""),
}


def black_or_white(first: bytes, second: bytes) -> dict:
    faces = b"f 1 2 3\nf 1 2 3\nf 1 2 3\nusemtl B\nf 1 2 3\nf 1 2 3\n"
    library = b"newmtl A\nKd " + first + b"\nnewmtl B\nKd " + second
    return {"a.obj": used(b"A").replace(FACE, faces), "a.mtl": library}


FURTHER = b"\2\0\0\0" + np.full((3, 3), 0.4, "<f4").tobytes()
NAMES = {"t%20#1.png": "t #1.png", "t #1.png": "t #1.png", "K%F6.png": "Kö.png", "K%C3%B6.png": "Kö.png"}
AUTHOR = glb(lambda scene: scene["asset"].update(generator="Müller"))
# name -> files of which the first is read; albedo of the last face, or of the last faces; what a warning says
CASES = {
    **{name: (files, RED_, "") for name, files in TEXTS.items()},
    **{name: ({"a.obj": text, "a.mtl": RED % b"A" + b"newmtl B\nKd .1 .1 .1\nmap_Kd t.png\n",
               "t.png": png((188, 188, 188))}, *rest) for name, (text, *rest) in SYNTAX.items()},
    **{name: ({"a.obj": b"".join(b"mtllib %s\n" % file.encode() for file in files) + b"vt 0 0\n" + POINTS
               + b"usemtl A\nf 1/1 2/1 3/1\n", **files, "t.png": png((255, 0, 0))}, *rest)
       for name, (files, *rest) in LIBRARIES.items()},
    **{name: ({"a.ply": content, "t.png": png((255, 128, 0))}, *rest) for name, (content, *rest) in PLYS.items()},
    **{name: ({"a.glb": glb(change, STRIPES, (0.25, 0.5), FURTHER) if color == BLUE_ else
               glb(change, DARK_RED, (0.5, 0.5), FURTHER), "t.png": DARK_RED}, color, warned)
       for name, (change, color, warned) in SCENES.items()},
    **{name: ({"a.glb": glb(wrapped(wrap), STRIPES, (u, 0.5))}, *rest) for name, (u, wrap, *rest) in WRAPS.items()},
    **{name: ({"a.glb": glb(colored(component, normalized), color=np.array([values] * 3, kind).tobytes())}, *rest)
       for name, (kind, component, normalized, values, *rest) in COLORS.items()},
    **{library: ({"a.obj": TEXTURED, "a.mtl": f"newmtl A\n{library}\n".encode(), "t.png": STRIPES,
                  "my skin.png": png((0, 0, 255)), "black.png": png((0, 0, 0))}, *rest)
       for library, rest in STATEMENTS.items()},
    **{f"a picture called {name}": ({"a.glb": glb(picture_at(name)), stored: png((255, 0, 0))}, RED_, "")
       for name, stored in NAMES.items()},
    **{f"a .gltf in {code}": ({"a.gltf": text_of(AUTHOR).encode(code)}, DARK, "")
       for code in ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "cp1252")},
    "a binary file called .gltf": ({"a.gltf": AUTHOR}, DARK, ""),
    **{f"a description padded with {pad}": ({"a.glb": glb(pad=pad)}, DARK, "") for pad in (b"\0", b" ", b"\n")},
    "3 faces black, 2 red": (black_or_white(b"0 0 0", b"1 0 0"), RED_, "3 of 5 faces are black"),
    "3 faces red, 2 black": (black_or_white(b"1 0 0", b"0 0 0"), (0, 0, 0), ""),
    "3 faces white, 2 nearly": (black_or_white(b"1 1 1", b"1 1 .9"), (1, 1, 0.7874), ""),
    "all faces white": (black_or_white(b"1 1 1", b"1 1 1"), (1, 1, 1), "all white"),
    **{f"vertex colors {color}": ({"a.obj": POINTS.replace(b"\n", f" {color}\n".encode()) + FACE}, *rest)
       for color, *rest in (("0 0 0", (0, 0, 0), "1 of 1 faces are black"), ("1 1 1", (1, 1, 1), "all white"),
                            (".5 .5 .5", (0.2140, 0.2140, 0.2140), ""))},
    "materials whose names differ in one byte": (
        {"a.obj": b"mtllib a.mtl\n" + POINTS + b"v 1 1 0\nusemtl K\xf6rper\nf 1 2 3\nusemtl K\xe4rper\nf 2 4 3\n",
         "a.mtl": RED % b"K\xf6rper" + b"newmtl K\xe4rper\nKd 0 0 1\n"}, [RED_, BLUE_], ""),
    "a texture, and vertex colors of the face that has none": (
        {"a.obj": b"mtllib a.mtl\nvt 0 0\n" + COLORED + b"usemtl A\nf 1/1 2/1 3/1\nusemtl B\nf 1 3 2\n",
         "a.mtl": b"newmtl A\nmap_Kd t.png\nnewmtl B\nKd 0 1 0\n", "t.png": png((0, 0, 255))},
        [BLUE_, RED_], "used on the 1 faces that have no texture"),
    "colors of faces that share vertices": (
        {"a.ply": ply(("", "255 0 0"), face=channels("uchar")).replace(b"face 1", b"face 2") + b"3 0 2 1 0 0 255\n"},
        [RED_, BLUE_], ""),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_file_of_this_kind_has_this_albedo_and_warning_and_keeps_them_in_its_record(tmp_path, name):
    files, color, warned = CASES[name]
    mesh, colors = read_mesh(write(tmp_path, files)), np.atleast_2d(color)
    assert warned in " ".join(mesh.info["warnings"]) and bool(warned) == bool(mesh.info["warnings"])
    assert len(mesh.vertices) == 3 or name != "colors of faces that share vertices"
    mesh.save(tmp_path / "a.npz")
    for one in (mesh, Mesh.load(tmp_path / "a.npz")):
        last = range(len(one.faces))[-len(colors) :]
        np.testing.assert_allclose([albedo(one, face) for face in last], colors, atol=1e-4)


def test_the_page_of_files_shows_kinds_of_these_tables(check_page):
    statements = {
        "`Kd 1 1 1`, `map_Ka` of a red picture alone": STATEMENTS["Ka 1 1 1\nKd 1 1 1\nmap_Ka t.png"],
        "`Kd 0 0 0`, `map_Ke` of a red picture alone": STATEMENTS["Kd 0 0 0\nKe 1 1 1\nmap_Ke t.png"],
        "`Kd 0 0 0`": STATEMENTS["Kd 0 0 0\nmap_d t.png\nbump t.png"],
    }
    obj = SYNTAX | LIBRARIES | statements
    check_page("Meshes", {"`.ply`": PLYS, "`.obj`": obj, "`.glb`": SCENES | WRAPS | COLORS})


# The bytes of scans.csv beside Zoë.obj, 人.obj and a,b.obj; the files that it chooses.
TABLES = {
    "utf-8 with a mark": (codecs.BOM_UTF8 + "path,use\nZoë.obj,1\n".encode(), ["Zoë.obj"]),
    "cp1252": ("path\nZoë.obj\n".encode("cp1252"), ["Zoë.obj"]),
    "Shift-JIS": ("path\n人.obj\n".encode("cp932"), ["人.obj"]),
    "semicolons": (b"use;path\n1;a,b.obj\n", ["a,b.obj"]),
    "Excel's own line": (b"sep=;\r\nuse;path\r\n1;a,b.obj\r\n", ["a,b.obj"]),
    "quotes": (b'use,path\r\n1,"a,b.obj"\r\n', ["a,b.obj"]),
    "capitals and accents in two parts": ("path\nzOe\u0308.obj\n".encode(), ["Zoë.obj"]),
    "utf-16 without a mark": ("path\tuse\nZoë.obj\t1\n".encode("utf-16-le"), ["Zoë.obj"]),
    "a spreadsheet's empty rows and columns": ("path;use;;\n\nZoë.obj;1;;\n;;;\n;;;\n".encode(), ["Zoë.obj"]),
    "the end of a file of DOS": ("path\r\nZoë.obj\r\n\x1a".encode(), ["Zoë.obj"]),
    "a backslash and a capital": ("path\n.\\ZOË.OBJ\n".encode(), ["Zoë.obj"]),
    "cells beyond the last column": ("path\nZoë.obj,1,2\n".encode(), ["Zoë.obj"]),
    "empty lines before the head": ("\r\n\r\npath\r\nZoë.obj\r\n".encode(), ["Zoë.obj"]),
    "n": ("use,path\nn,Zoë.obj\ny,人.obj\n".encode(), ["人.obj"]),
}


@pytest.mark.parametrize("name", TABLES)
def test_scans_table_of_every_spelling(tmp_path, name):
    data, chosen = TABLES[name]
    write(tmp_path, {"scans.csv": data, "Zoë.obj": b"", "人.obj": b"", "a,b.obj": b""})
    assert [scan.path.name for scan in list_scans(tmp_path).values()] == chosen


@pytest.mark.parametrize(("text", "says"), [
    (b"use;path\n1;\n", "has a row without a path"),
    (b"file\na.obj\n", "no column `path`"),
    (b"path|use\na.obj|1\n", "no column `path`"),
    (b"", "no column `path`"),
    (b"path\na%20b.obj\n", "names a%20b.obj, which is not there"),
    (b"use,path\nmaybe,a.obj\n", "use is 'maybe' for a.obj; give 1 or 0, yes or no"),
    (b"use,path\n2,a.obj\n", "use is '2' for a.obj"),
])  # fmt: skip
def test_scans_table_without_paths_or_a_use_is_refused(tmp_path, text, says):
    write(tmp_path, {"scans.csv": text, "a.obj": b"", "a b.obj": b""})
    with pytest.raises(UserError, match=says):
        list_scans(tmp_path)


def test_a_cube_of_stl_is_one_surface_in_both_forms(tmp_path):
    """Eight corners, which STL names 36 times."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]  # counter-clockwise
    cube = corners[[(a, *pair) for a, b, c, d in sides for pair in ((b, c), (c, d))]]
    facets = ["\n".join(f"vertex {x} {y} {z}" for x, y, z in triangle) for triangle in cube]
    text = "".join(f"facet normal 0 0 0\nouter loop\n{facet}\nendloop\nendfacet\n" for facet in facets)
    records = np.zeros(12, [("normal", "<f4", 3), ("triangle", "<f4", (3, 3)), ("attributes", "<u2")])
    records["triangle"] = cube
    data = b"solid".ljust(80) + struct.pack("<I", 12) + records.tobytes()
    whole = f"solid cube\n{text}endsolid cube\n".encode()
    for content in (whole, whole.upper().replace(b"\n", b"\r\n\t"), data):
        mesh = read_mesh(path := write(tmp_path, {"cube.stl": content}))
        assert len(mesh.vertices) == 8 and mesh.faces.shape == (12, 3)
        a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
        assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(1)  # its volume, positive where faces look outward
        assert "the albedo is white" in mesh.info["warnings"][0]
    broken = data[:-7], data + b"a stamp", whole[:-14], whole.replace(b"vertex 0", b"0", 1)
    for content in (*broken, whole[: whole.rindex(b"facet normal")], whole.replace(b"vertex 0.0", b"vertex", 1)):
        write(tmp_path, {"cube.stl": content})
        with pytest.raises(UserError, match=r"cube\.stl is damaged"):
            read_mesh(path)
