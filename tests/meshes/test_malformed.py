"""Broken files: one sentence that names the file, in little time and memory, whatever is wrong with them."""

import base64
import json
import os
import struct
import tracemalloc

import numpy as np
import pytest
from PIL import Image
from samples import encoded, glb_of, png_of_size

from relight.core.errors import UserError
from relight.meshes import read_mesh

PLY = b"ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
FACE = b"element face %d\nproperty list uchar int vertex_indices\n"
END, POINTS = b"end_header\n", np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")
TRIANGLES = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
FACES = "f 1/1 3/2 2/3\nf 1/1 2/2 4/3\nf 2/1 3/2 4/3\nf 1/1 4/2 3/3\n"


def binary_ply(vertices=4, faces=4, points=POINTS, triangles=TRIANGLES, tail=b"") -> bytes:
    body = points.tobytes() + b"".join(struct.pack(f"<B{len(t)}i", len(t), *t) for t in triangles)
    return PLY % (b"binary_little_endian", vertices) + FACE % faces + END + body + tail


def ascii_ply(rows: str, vertices=4, faces=4) -> bytes:
    return PLY % (b"ascii", vertices) + FACE % faces + END + rows.encode()


ROWS = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"


def picture(size=(2, 2)) -> bytes:
    return encoded(Image.new("RGB", size, (200, 100, 50)), "png")


def gltf(change=lambda scene: None, binary=None, **top) -> dict:
    """The description of a tetrahedron in one node, its buffer inside; `change` breaks it."""
    data = POINTS.tobytes() + np.array(TRIANGLES, "<u2").tobytes() if binary is None else binary
    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        ],
        "buffers": [{"byteLength": 72, "uri": "data:;base64," + base64.b64encode(data).decode()}],
        **top,
    }
    change(scene)
    return scene


def textured(uri: str):
    def change(scene):
        scene["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        scene["textures"], scene["images"] = [{"source": 0}], [{"uri": uri}]
        scene["meshes"][0]["primitives"][0].update(material=0)
        scene["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 0

    return change


def setting(*path_and_value):
    *path, last, value = path_and_value

    def change(scene):
        for key in path:
            scene = scene[key]
        scene[last] = value

    return change


def obj(*lines: str, head=OBJ, faces=FACES) -> bytes:
    return (head + "".join(f"{line}\n" for line in lines) + faces).encode()


MTL = "newmtl skin\nmap_Kd {}\n"
USE = ("mtllib a.mtl", "usemtl skin")
SKIN = {"a.obj": obj(*USE), "a.mtl": MTL.format("t.png").encode()}

# name -> (files, what the sentence must say). The first file is the one that is read.
BROKEN = {
    # PLY
    "ply of zero bytes": ({"a.ply": b""}, "is empty"),
    "ply without end_header": ({"a.ply": PLY % (b"ascii", 3)}, "not a PLY"),
    "ply of negative count": ({"a.ply": PLY % (b"ascii", -4) + FACE % 4 + END}, "means nothing"),
    "ply of unknown format": ({"a.ply": PLY % (b"binary_middle_endian", 4) + END}, "format"),
    "ply with a property twice": ({"a.ply": PLY % (b"ascii", 1) + b"property float x\n" + END + b"0 0 0 0"}, "twice"),
    "ply promising billions of vertices": ({"a.ply": binary_ply(vertices=4_000_000_000)}, "promises"),
    "ply promising billions of nothing": (
        {"a.ply": PLY % (b"ascii", 4) + b"element void 4000000000\n" + END + ROWS.encode()}, "no faces"),
    "ply truncated in faces": ({"a.ply": binary_ply()[:-5]}, "truncated"),
    "ascii ply of words": ({"a.ply": ascii_ply(ROWS + "3 0 two 1\n" * 4)}, "not a number"),
    "ply with a list of 4 billion": (
        {"a.ply": PLY % (b"binary_little_endian", 4) + b"element face 1\nproperty list uint int vertex_indices\n" + END
         + POINTS.tobytes() + b"\xff\xff\xff\xfe" + b"\0" * 16}, "damaged"),
    "ply with an index out of range": ({"a.ply": binary_ply(triangles=[[0, 1, 4]] * 4)}, "names vertex 4"),
    "ply of NaN": ({"a.ply": binary_ply(points=POINTS * np.float32(np.nan))}, "not finite"),
    "ply of astronomic numbers": ({"a.ply": ascii_ply(ROWS.replace("1", "1e300") + "3 0 1 2\n" * 4)}, "beyond 1e+12"),
    "ply at one point": ({"a.ply": binary_ply(points=POINTS * 0)}, "one point"),
    "ply of points": ({"a.ply": PLY % (b"binary_little_endian", 4) + END + POINTS.tobytes()}, "no faces"),
    "ply without z": (
        {"a.ply": PLY.replace(b"float z", b"float w") % (b"ascii", 1) + FACE % 1 + END + b"0 0 0\n3 0 0 0"},
         "x, y and z"),
    "ply of strips": (
        {"a.ply": PLY % (b"ascii", 4) + FACE.replace(b"face", b"tristrips") % 1 + END + ROWS.encode() + b"4 0 1 2 3"},
        "save it with faces",
    ),
    "ply naming a missing texture": (
        {"a.ply": binary_ply().replace(b"element vertex", b"comment TextureFile skin.png\nelement vertex", 1)},
         "skin.png"),
    # OBJ
    "obj of a texture in tiles": (SKIN | {"a.mtl": MTL.format("t.<UDIM>.png").encode(), "t.1001.png": picture()},
                                  "bake them into one picture"),
    "obj of points": ({"a.obj": OBJ.encode()}, "no faces"),
    "obj that is binary": ({"a.obj": b"\x80" * (3 << 20)}, "not an .obj"),
    "obj truncated in a vertex": ({"a.obj": b"v 0 0 0\nv 1 0\nf 1 2 1\n"}, "has 2 numbers"),
    "obj with an index out of range": ({"a.obj": obj(faces="f 1 2 5\n")}, "names vertex 4"),
    "obj with a huge index": ({"a.obj": obj(faces="f 1 2 99999999999999999999999\n")}, "names vertex"),
    "obj with index 0": ({"a.obj": obj(faces="f 0 1 2\n")}, "vertex 0"),
    "obj with an index before the first": ({"a.obj": obj(faces="f -1 -2 -9\n")}, "before the first"),
    "obj with a texture index out of range": (
        {"a.obj": obj(*USE, faces="f 1/1 2/2 3/9\n"), "a.mtl": MTL.format("t.png").encode(), "t.png": picture()},
         "texture coordinate 9"),
    "obj without its .mtl": ({"a.obj": obj(*USE)}, "a.mtl"),
    "obj whose .mtl is a looped link": (
        {"a.obj": obj(*USE), "a.mtl": "-> b.mtl", "b.mtl": "-> a.mtl"}, "leads nowhere"),
    "obj whose .mtl lies outside": ({"in/a.obj": obj("mtllib ../a.mtl"), "a.mtl": b"newmtl skin\n"}, "outside"),
    "obj using an undefined material": ({"a.obj": obj(*USE), "a.mtl": b"newmtl hair\n"}, "'skin'"),
    "mtl naming a missing texture": (SKIN, "t.png"),
    "mtl whose only texture is missing": ({"a.obj": obj(*USE), "a.mtl": b"newmtl skin\nmap_Ka gone.png\n"}, "gone.png"),
    "mtl naming no texture": ({"a.obj": obj(*USE), "a.mtl": b"newmtl skin\nmap_Kd\n"}, "names no file"),
    **{f"mtl of the color {color}": (
        {"a.obj": obj(*USE), "a.mtl": f"newmtl skin\nKd {color}\n".encode()}, f"`Kd {color}` is not three numbers")
       for color in ("", "1 0", "1,0 0 0", "xyz .4 .2 .02", "spectral a.rfl", "#ff0000")},
    "mtl naming a texture outside": (
        {"in/a.obj": obj(*USE), "in/a.mtl": MTL.format("../t.png").encode(), "t.png": picture()}, "outside the folder"),
    "texture that is a link out": (
        {**{f"in/{name}": content for name, content in SKIN.items()}, "in/t.png": "-> ../t.png", "t.png": picture()},
         "out of the folder"),
    "texture truncated": ({**SKIN, "t.png": picture((64, 64))[:-60]}, "damaged"),
    "texture of text": ({**SKIN, "t.png": b"hello"}, "is damaged, or no .png that is read here: save it as PNG"),
    "texture that is a bomb": ({**SKIN, "t.png": png_of_size(60000, 60000)}, "million pixels"),
    "texture in two subfolders": (
        {**SKIN, "x/t.png": picture(), "y/t.png": picture()}, "2 files"),
    "textured obj without coordinates": (
        {"a.obj": obj(*USE, faces="f 1 2 3\n"), "a.mtl": MTL.format("t.png").encode(), "t.png": picture()},
        "no texture coordinates",
    ),
    # glTF
    "glb truncated": ({"a.glb": glb_of(gltf())[:-30]}, "truncated"),
    "glb of version 1": ({"a.glb": glb_of(gltf(), version=1)}, "version 2"),
    "glb with a chunk past its end": (
        {"a.glb": glb_of(gltf())[:12] + b"\xff\xff\xff\x7f" + glb_of(gltf())[16:]}, "over the end"),
    "glb of broken JSON": ({"a.glb": glb_of(gltf()).replace(b'"asset"', b'"asset\\')}, "JSON"),
    "gltf of nested brackets": ({"a.gltf": b"[" * 200_000}, "JSON"),
    "gltf without version": ({"a.gltf": b"{}"}, "not glTF"),
    "gltf needing compression": ({"a.gltf": gltf(extensionsRequired=["KHR_draco_mesh_compression"])}, "draco"),
    "gltf of compressed data only": (
        {"a.gltf": gltf(lambda s: s["accessors"][0].pop("bufferView"), extensionsUsed=["EXT_meshopt_compression"])},
        "without data; save it without EXT_meshopt_compression"),
    "gltf of a truncated .bin": (
        {"a.gltf": gltf(setting("buffers", 0, "uri", "a.bin")), "a.bin": b"\0" * 50}, "over the end"),
    "gltf of broken base64": ({"a.gltf": gltf(setting("buffers", 0, "uri", "data:;base64,@@@"))}, "base64"),
    "gltf on the network": ({"a.gltf": gltf(setting("buffers", 0, "uri", "https://example.org/a.bin"))}, "network"),
    "gltf promising billions": ({"a.gltf": gltf(setting("accessors", 0, "count", 4_000_000_000))}, "promises"),
    "gltf promising zeros": (
        {"a.gltf": gltf(lambda s: s["accessors"][0].update(count=50_000_000) or s["accessors"][0].pop("bufferView"))},
         "without data"),
    "gltf accessor of negative offset": ({"a.gltf": gltf(setting("accessors", 0, "byteOffset", -8))}, "over the end"),
    "gltf of a texture that is not read": (
        {"a.gltf": gltf(lambda s: textured("t.png")(s) or s.update(
            textures=[{"extensions": {"KHR_texture_basisu": {"source": 0}}}]))},
        "given as KHR_texture_basisu only: save it as PNG"),
    "gltf with a sparse accessor": ({"a.gltf": gltf(setting("accessors", 0, "sparse", {}))}, "sparse"),
    "gltf with an index out of range": (
        {"a.gltf": gltf(binary=POINTS.tobytes() + np.full(12, 9, "<u2").tobytes())}, "names vertex 9"),
    "gltf with nodes in a circle": ({"a.gltf": gltf(setting("nodes", [{"children": [1]}, {"children": [0]}]))}, "tree"),
    "gltf with a missing node": ({"a.gltf": gltf(setting("scenes", 0, "nodes", [7]))}, "entry 7"),
    "gltf with a mesh of text": ({"a.gltf": gltf(setting("meshes", "none"))}, "damaged"),
    "gltf of lines": ({"a.gltf": gltf(setting("meshes", 0, "primitives", 0, "mode", 1))}, "no triangles"),
    "gltf of 11 indices": ({"a.gltf": gltf(setting("accessors", 1, "count", 11))}, "whole triangles"),
    "gltf textured without coordinates": (
        {"a.gltf": gltf(lambda s: textured("t.png")(s) or setting("meshes", 0, "primitives", 0, "attributes",
                                                                   {"POSITION": 0})(s)),
         "t.png": picture()}, "have no TEXCOORD_0"),
    # other
    **{f"{kind} called .{suffix}": ({f"a.{suffix}": content}, says) for suffix in ("obj", "ply", "stl", "glb", "gltf")
       for kind, content, says in (("a pointer", b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
                                   ("an archive", b"PK\x03\x04" + bytes(99), "unpack it"),
                                   ("a page", b"\n<!DOCTYPE html>", "web page"))},
    "a kind that is not read": ({"a.fbx": b"Kaydara FBX Binary"}, ".glb"),
    "no suffix": ({"figure": b"ply\n"}, "no suffix"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_give_one_sentence(tmp_path, name):
    files, says = BROKEN[name]
    for file, content in files.items():
        path = tmp_path / file
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, str) and content.startswith("-> "):
            os.symlink(content[3:], path)
        else:
            path.write_bytes(json.dumps(content).encode() if isinstance(content, dict) else content)
    first = tmp_path / next(iter(files))
    tracemalloc.start()
    try:
        with pytest.raises(UserError) as error:
            read_mesh(first)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    sentence = str(error.value)
    assert says in sentence and "\n" not in sentence and str(tmp_path) in sentence
    assert len(sentence.replace(str(tmp_path), "")) < 200 and peak < 64 << 20
