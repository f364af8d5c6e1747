"""The tables of docs/lab/files.md: every file is written, read, and compared with what the page says."""

import io
import json
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image, ImageCms

from relight.meshes import read_mesh
from relight.panoramas import read_panorama
from relight.photos.mask.find import read_mask
from relight.photos.picture import Picture
from relight.photos.write import write_picture
from relight.srgb import encode
from relight.transport.surface import sample_albedo

PAGE = (Path(__file__).parents[1] / "docs" / "lab" / "files.md").read_text()
ROWS = re.findall(r"^\| (`?[\w.]+`?) \| (.+?) \| ([\d. ]+) \| ?(.*?) ?\|$", PAGE, re.M)
P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)
PIXEL = np.array([200, 100, 50], np.uint8)


def png(*colors) -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.array([colors], np.uint8)).save(file, "PNG")
    return file.getvalue()


def albedo(path):
    mesh = read_mesh(path)
    face = np.array([len(mesh.faces) - 1])
    return sample_albedo(mesh, face, np.full((1, 3), 1 / 3))[0], mesh.info["warnings"]


def ply(folder, vertex=("", ""), face=("", ""), comment=""):
    """Columns and values of vertices and faces, separated by commas and blanks."""
    head = f"ply\nformat ascii 1.0\n{comment}element vertex 3\n" + "".join(f"property float {c}\n" for c in "xyz")
    head += "".join(f"property {line}\n" for line in vertex[0].split(",") if line) + "element face 1\n"
    head += "property list uchar int vertex_indices\n"
    head += "".join(f"property {line}\n" for line in face[0].split(",") if line) + "end_header\n"
    points = "".join(f"{point} {vertex[1]}\n" for point in ("0 0 0", "1 0 0", "0 1 0"))
    (folder / "a.ply").write_text(head + points + f"3 0 1 2 {face[1]}\n")
    (folder / "t.png").write_bytes(png((188, 188, 188)))
    return albedo(folder / "a.ply")


def rgb(kind, names="red green blue"):
    return ",".join(f"{kind} {name}" for name in names.split())


def obj(folder, color="", library="", use="usemtl A", named="mtllib a.mtl", some=False):
    corners = [f"v {point} {color if not (some and k) else ''}" for k, point in enumerate(("0 0 0", "1 0 0", "0 1 0"))]
    (folder / "a.obj").write_text("\n".join([named, *corners, "vt .5 .5", use, "f 1/1 2/1 3/1", ""]))
    (folder / "a.mtl").write_text(f"newmtl A\n{library}\n")
    (folder / "t.png").write_bytes(png((188, 188, 188)))
    return albedo(folder / "a.obj")


def glb(folder, texture=None, factor=None, color=None, wrap=None, u=0.5, weights=None, emits=False):
    color = None if color is None else np.array([color] * 3)
    parts = [np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes(), np.full((3, 2), (u, 0.5), "<f4").tobytes(),
             texture or b"", b"" if color is None else color.tobytes()]  # fmt: skip
    start = np.cumsum([0, *map(len, parts)]).tolist()
    attributes = {"POSITION": 0, "TEXCOORD_0": 1} | ({} if color is None else {"COLOR_0": 2})
    base = {} if texture is None or emits else {"baseColorTexture": {"index": 0}}
    base |= {} if factor is None else {"baseColorFactor": [factor] * 3 + [1]}
    scene = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0} | ({} if weights is None else {"weights": weights})],
        "meshes": [{"primitives": [{"attributes": attributes} | ({"material": 0} if base else {})]}],
        "materials": [{"pbrMetallicRoughness": base} | ({"emissiveTexture": {"index": 0}} if emits else {})],
        "textures": [{"source": 0} | ({"sampler": 0} if wrap else {})],
        "samplers": [{"wrapS": wrap or 10497}],
        "images": [{"bufferView": 2}],
        "accessors": [{"bufferView": k, "componentType": 5126, "count": 3, "type": f"VEC{3 - k}"} for k in (0, 1)],
        "bufferViews": [{"buffer": 0, "byteOffset": s, "byteLength": len(p)} for s, p in zip(start, parts)],
        "buffers": [{"byteLength": start[-1]}],
    }  # fmt: skip
    if color is not None:
        kind = {"f": 5126, "u": 5121}[color.dtype.kind]
        scene["accessors"].append({"bufferView": 3, "componentType": kind, "count": 3, "type": "VEC3"})
    text, data = json.dumps(scene).encode(), b"".join(parts)
    text, data = text + b" " * (-len(text) % 4), data + b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    (folder / "a.glb").write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    return albedo(folder / "a.glb")


def radiance(path):
    panorama = read_panorama(path)
    return panorama.pixels[0, 0], panorama.repairs


def hdr(folder, *lines):
    head = "".join(f"{line}\n" for line in ("#?RADIANCE", *lines, "FORMAT=32-bit_rle_rgbe", "", "-Y 32 +X 64"))
    (folder / "a.hdr").write_bytes(head.encode() + bytes([*PIXEL, 128]) * (32 * 64))
    return radiance(folder / "a.hdr")


def exr(folder, channels, header=()):
    planes = {name: np.full((32, 64), value, np.float32) for name, value in channels.items()}
    OpenEXR.File(dict(header), planes).write(str(folder / "a.exr"))
    return folder / "a.exr"


def pfm(folder, end, scale=b"-1.0", size=b"64 32"):
    body = np.full((32, 64, 3), PIXEL / 256, "<f4").tobytes()
    (folder / "a.pfm").write_bytes(b"PF" + end + size + end + scale + end + body)
    return radiance(folder / "a.pfm")


def primaries(values):
    return "PRIMARIES=" + " ".join(map(str, values))


RGB = dict(zip("RGB", PIXEL / 256))


def codes(path):
    photo = Picture.of(path)
    return photo.codes[0, 0], photo.notes


def photo(folder, form="PNG", chunk=None, **options):
    path = folder / f"a.{form.lower()}"
    Image.fromarray(np.full((16, 16, 3), PIXEL)).save(path, form, **options)
    if chunk:
        data, (kind, body) = path.read_bytes(), chunk
        place, check = data.index(b"IDAT") - 4, zlib.crc32(kind + body)
        path.write_bytes(
            data[:place] + struct.pack(">I", len(body)) + kind + body + struct.pack(">I", check) + data[place:]
        )
    return codes(path)


def icc(name, space=b"RGB ", linear=True):
    """An ICC profile with the primaries of sRGB."""
    xyz = lambda *v: b"XYZ \0\0\0\0" + b"".join(struct.pack(">i", round(x * 65536)) for x in v)  # noqa: E731
    curve = b"curv\0\0\0\0" + struct.pack(">I", 0)
    text = b"desc\0\0\0\0" + struct.pack(">I", len(name) + 1) + name + b"\0" * 79
    tags = [(b"desc", text + b"\0" * (-len(text) % 4)), (b"cprt", b"text\0\0\0\0none\0\0\0\0"),
            (b"wtpt", xyz(0.9642, 1, 0.8249))]  # fmt: skip
    if space == b"RGB ":
        tags += [(b"rXYZ", xyz(0.4361, 0.2225, 0.0139)), (b"gXYZ", xyz(0.3851, 0.7169, 0.0971)),
                 (b"bXYZ", xyz(0.1431, 0.0606, 0.7141)), *((bytes([c]) + b"TRC", curve) for c in b"rgb")]  # fmt: skip
    else:
        tags.append((b"kTRC", curve))
    table, body, start = struct.pack(">I", len(tags)), b"", 132 + 12 * len(tags)
    for key, value in tags:
        table += key + struct.pack(">II", start + len(body), len(value))
        body += value
    size = 128 + len(table) + len(body)
    head = struct.pack(">I4sI4s4s4s6H", size, b"none", 0x2100000, b"mntr", space, b"XYZ ", 2020, 1, 1, 0, 0, 0)
    return (head + b"acsp" + b"\0" * 28 + xyz(0.9642, 1, 0.8249)[8:]).ljust(128, b"\0") + table + body


def srgb(folder):
    data = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    return photo(folder, icc_profile=data.replace(b"sRGB", b"mine"))


def adobe(folder):
    exif = Image.Exif()
    exif[0x8769] = {0xA001: 0xFFFF, 0xA005: {1: "R03"}}
    return photo(folder, exif=exif)


def sixteen(folder):
    write_picture(folder / "a.png", np.full((16, 16, 3), PIXEL.astype(np.uint16) * 257))
    return codes(folder / "a.png")


def preview(folder):
    big, small = (Image.fromarray(np.full((size, size, 3), PIXEL)) for size in (16, 8))
    big.save(folder / "a.jpg", "MPO", save_all=True, append_images=[small], quality=100, subsampling=0)
    return codes(folder / "a.jpg")


def mask(folder, person, edge=None):
    """A mask whose person, at (3, 3), has a value or color, and nothing elsewhere."""
    image = person
    if not isinstance(person, Image.Image):
        values = np.zeros((16, 16, *np.shape(person)), np.asarray(person).dtype)
        values[2:9, 2:9] = person
        if edge is not None:
            values[9, 2:9] = edge
        image = Image.fromarray(values)
    image.save(folder / "m.png")
    found, notes = read_mask(folder / "m.png", (16, 16))
    return found[9 if edge is not None else 3, 3], notes


def labels():
    values = np.zeros((16, 16), np.uint8)
    values[2:9, 2:9] = 15
    image = Image.fromarray(values, "L")
    image.putpalette([0] * 45 + [192, 128, 128])
    return image


def shaded(person, background, last):
    """An area of each value."""
    values = np.full((16, 16), background, np.uint8)
    values[:8], values[15] = person, last
    return Image.fromarray(values)


STRIPES = png((255, 0, 0), (255, 0, 0), (0, 0, 255), (0, 0, 255))
GREY = png((188, 188, 188))
ORANGE = "1 .50196 0"
FILES = {
    "`.ply`": {
        "vertex colors, `uchar` 255 128 0": lambda f: ply(f, (rgb("uchar"), "255 128 0")),
        "vertex colors, `ushort` 65535 32896 0": lambda f: ply(f, (rgb("ushort"), "65535 32896 0")),
        "vertex colors, `ushort` 255 128 0": lambda f: ply(f, (rgb("ushort"), "255 128 0")),
        "vertex colors, `int` 255 128 0": lambda f: ply(f, (rgb("int"), "255 128 0")),
        "vertex colors, `float` 1 0.502 0": lambda f: ply(f, (rgb("float"), ORANGE)),
        "vertex colors, `float` 255 128 0": lambda f: ply(f, (rgb("float"), "255 128 0")),
        "vertex colors named `r g b`, 255 128 0": lambda f: ply(f, (rgb("uchar", "r g b"), "255 128 0")),
        "vertex colors, `float` 1 -0.5 0": lambda f: ply(f, (rgb("float"), "1 -0.5 0")),
        "vertex colors, `float` 1 nan 0": lambda f: ply(f, (rgb("float"), "1 nan 0")),
        "colors of faces, 255 128 0": lambda f: ply(f, face=(rgb("uchar"), "255 128 0")),
        "colors of vertices 255 128 0 and of faces 0 0 255": lambda f: ply(
            f, (rgb("uchar"), "255 128 0"), (rgb("uchar"), "0 0 255")
        ),
        "`TextureFile` of code 188, vertex colors 128": lambda f: ply(
            f, (rgb("float", "s t") + "," + rgb("uchar"), "0 0 128 128 128"), comment="comment TextureFile t.png\n"
        ),
        "no colors": ply,
        "texture coordinates, but no texture": lambda f: ply(f, (rgb("float", "s t"), "0 0")),
    },
    "`.obj`": {
        "`map_Kd` of code 188, `Kd .2 .2 .2`": lambda f: obj(f, library="Kd .2 .2 .2\nmap_Kd t.png"),
        "`map_Kd` of code 188, vertex colors .5": lambda f: obj(f, ".5 .5 .5", "map_Kd t.png"),
        "`map_Ka` of code 188 alone, `Kd 1 1 1`": lambda f: obj(f, library="Kd 1 1 1\nmap_Ka t.png"),
        "`map_Ke` of code 188 alone, `Kd 0 0 0`": lambda f: obj(f, library="Kd 0 0 0\nmap_Ke t.png"),
        "`Kd 0 0 0`": lambda f: obj(f, library="Kd 0 0 0"),
        "`Kd 1 .502 0`": lambda f: obj(f, library=f"Kd {ORANGE}"),
        "`Kd 255 128 0`": lambda f: obj(f, library="Kd 255 128 0"),
        "a material that is defined twice, red and blue": lambda f: obj(f, library="Kd 1 0 0\nnewmtl A\nKd 0 0 1"),
        "`Kd 1 .502 0`, vertex colors 0 0 1": lambda f: obj(f, "0 0 1", f"Kd {ORANGE}"),
        "`v x y z r g b` of 1 .502 0": lambda f: obj(f, ORANGE, use="", named=""),
        "`v x y z r g b` of 255 128 0": lambda f: obj(f, "255 128 0", use="", named=""),
        "`v x y z w r g b` of 1 1 .502 0": lambda f: obj(f, f"1 {ORANGE}", use="", named=""),
        "`v x y z r g b a` of 0 0 1 1": lambda f: obj(f, "0 0 1 1", use="", named=""),
        "vertex colors of some vertices": lambda f: obj(f, "1 0 0", use="", named="", some=True),
        "`usemtl` without a name": lambda f: obj(f, library="Kd 1 0 0", use="usemtl A\nf 1 2 3\nusemtl"),
        "a material of a library that is not named": lambda f: obj(f, library="Kd 1 0 0", named=""),
        "no materials, no colors": lambda f: obj(f, use="", named=""),
    },
    "`.glb`": {
        "texture of code 188, factor .5, vertex colors .4": lambda f: glb(f, GREY, 0.5, np.full(3, 0.4, "<f4")),
        "vertex colors of integers, not marked as normalised, 255 51 0": lambda f: glb(
            f, color=np.array([255, 51, 0], "<u1")
        ),
        "texture red on the left, blue on the right, at u = 1.25, wrap `REPEAT`": lambda f: glb(f, STRIPES, u=1.25),
        "the same, wrap `CLAMP_TO_EDGE`": lambda f: glb(f, STRIPES, u=1.25, wrap=33071),
        "the same, wrap `MIRRORED_REPEAT`": lambda f: glb(f, STRIPES, u=1.25, wrap=33648),
        "factor 2": lambda f: glb(f, factor=2),
        "a morph target in use, factor .5": lambda f: glb(f, factor=0.5, weights=[1]),
        "factor 0, `emissiveTexture` of code 188": lambda f: glb(f, GREY, 0, emits=True),
        "no material, no colors": glb,
    },
    "`.hdr`": {
        "nothing more": hdr,
        "`EXPOSURE=2`": lambda f: hdr(f, "EXPOSURE=2"),
        "`EXPOSURE=4` after a tab": lambda f: hdr(f, "\tEXPOSURE=4"),
        "`GAMMA=2.2`": lambda f: hdr(f, "GAMMA=2.2"),
        "`PRIMARIES` of Display P3": lambda f: hdr(f, primaries(P3)),
        "`PRIMARIES` of Radiance, or zeros": lambda f: (
            hdr(f, primaries([0] * 8))[0], hdr(f, primaries((0.64, 0.33, 0.29, 0.6, 0.15, 0.06, 0.333, 0.333)))[1]
        ),
    },
    "`.exr`": {
        "channels `R` `G` `B`": lambda f: radiance(exr(f, RGB)),
        "`chromaticities` of Display P3": lambda f: radiance(exr(f, RGB, {"chromaticities": P3})),
        "`oiio:ColorSpace` ACEScg, no `chromaticities`": lambda f: radiance(exr(f, RGB, {"oiio:ColorSpace": "ACEScg"})),
        "`colorspace` sRGB": lambda f: radiance(exr(f, RGB, {"colorspace": "sRGB"})),
        "channels `X` `Y` `Z` of white, .9505 1 1.089": lambda f: radiance(exr(f, {"X": 0.9505, "Y": 1, "Z": 1.089})),
        "channel `Y`": lambda f: radiance(exr(f, {"Y": 100 / 256})),
    },
    "`.pfm`": {"header in LF": lambda f: pfm(f, b"\n"), "header in CR LF": lambda f: pfm(f, b"\r\n"),
              "a scale of 2": lambda f: pfm(f, b"\n", b"-2.0"),
              "width and height on two lines": lambda f: pfm(f, b"\n", size=b"64\n32")},
    "photo": {
        "nothing more": photo,
        "an ICC profile of sRGB, under any name": srgb,
        "a linear ICC profile called sRGB": lambda f: photo(f, icc_profile=icc(b"built-in Linear sRGB")),
        "an ICC profile of grey pictures": lambda f: photo(f, icc_profile=icc(b"Dot Gain", b"GRAY")),
        "PNG's gamma of 1": lambda f: photo(f, chunk=(b"gAMA", struct.pack(">I", 100000))),
        "PNG's `cICP` of linear values": lambda f: photo(f, chunk=(b"cICP", bytes([1, 8, 0, 1]))),
        "EXIF of a camera: Adobe RGB": adobe,
        "16 bits, 51400 25700 12850": sixteen,
        "OpenEXR, .5776 .1274 .0319": lambda f: codes(exr(f, dict(zip("RGB", (0.5776, 0.1274, 0.0319))))),
        "a preview in the same file": preview,
    },
    "mask": {
        "white on black": lambda f: mask(f, np.uint8(255)),
        "0 and 1": lambda f: mask(f, np.uint8(1)),
        "labels of a palette, the person pink": lambda f: mask(f, labels()),
        "green on black": lambda f: mask(f, np.array([0, 255, 0], np.uint8)),
        "a soft edge in red, half": lambda f: mask(f, np.array([255, 0, 0], np.uint8), np.array([128, 0, 0], np.uint8)),
        "16 bits of 0 and 65535": lambda f: mask(f, np.uint16(65535)),
        "an area of 128 beside white and black": lambda f: mask(f, shaded(128, 0, 255)),
        "nothing above 200": lambda f: mask(f, shaded(200, 0, 100)),
    },
}  # fmt: skip


def test_the_page_and_this_table_have_the_same_rows():
    assert {(file, says) for file, says, *_ in ROWS} == {(file, says) for file, rows in FILES.items() for says in rows}


@pytest.mark.parametrize(("file", "says", "value", "words"), ROWS, ids=[f"{row[0]} {row[1]}" for row in ROWS])
def test_a_file_is_read_as_the_page_says(tmp_path, file, says, value, words):
    found, notes = FILES[file][says](tmp_path)
    shown = np.array(value.split(), float)
    np.testing.assert_allclose(found, shown, atol=1.5 if shown.max() > 2 and "linear ICC" in says else 6e-4)
    assert words in " ".join(notes) and bool(words) == bool(notes)


def test_the_codes_of_linear_values_on_the_page():
    np.testing.assert_array_equal(np.round(encode(PIXEL / 255) * 255), [229, 168, 122])
