import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import ExifTags, Image, ImageCms, PngImagePlugin
from samples import encoded, png_chunks

from relight.core.errors import UserError
from relight.core.srgb import decode, encode, to_linear
from relight.photos.look import Look
from relight.photos.mask.edge import fit_edge
from relight.photos.mask.find import NoMaskNetwork, masked, read_mask
from relight.photos.write import write_picture
from relight.pictures.codes import as_codes, convert_alpha, to_codes, with_alpha
from relight.pictures.picture import Picture
from relight.pictures.profile import _curve, to_srgb

RNG = np.random.default_rng(0)
RGB, DEEP = (RNG.integers(0, top, (40, 30, 3)).astype(kind) for top, kind in ((256, np.uint8), (65536, np.uint16)))
SMOOTH = np.stack(np.broadcast_arrays(np.arange(30) * 8, np.arange(40)[:, None] * 6, 99), -1).astype(np.uint8)
SRGB = np.array([[0.4361, 0.3851, 0.1431], [0.2225, 0.7169, 0.0606], [0.0139, 0.0971, 0.7141]])  # to XYZ with D50
P3 = np.array([[0.5151, 0.2920, 0.1571], [0.2412, 0.6922, 0.0666], [-0.0011, 0.0419, 0.7841]])
ADOBE = np.array([[0.6097, 0.2053, 0.1492], [0.3111, 0.6257, 0.0632], [0.0195, 0.0609, 0.7446]])
LINEAR = b"curv\0\0\0\0" + struct.pack(">I", 0)
GAMMA = b"curv\0\0\0\0" + struct.pack(">IH", 1, 563) + b"\0\0"  # 2.19921875
TABLE = b"curv\0\0\0\0" + struct.pack(">I256H", 256, *np.round(np.linspace(0, 1, 256) ** 1.8 * 65535).astype(int))


def fixed(*values) -> bytes:
    return b"".join(struct.pack(">i", round(float(value) * 65536)) for value in values)


CURVE = b"para\0\0\0\0" + struct.pack(">HH", 3, 0) + fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)


def profile(name: str, matrix: np.ndarray | None, curve: bytes) -> bytes:
    """An ICC profile of RGB by the standard; of grey without a matrix."""
    text = name.encode()
    desc = b"desc\0\0\0\0" + struct.pack(">I", len(text) + 1) + text + b"\0" * 79
    white = b"XYZ \0\0\0\0" + fixed(0.9642, 1, 0.8249)
    tags = [(b"desc", desc + b"\0" * (-len(desc) % 4)), (b"cprt", b"text\0\0\0\0none\0\0\0\0"), (b"wtpt", white)]
    if matrix is None:
        tags.append((b"kTRC", curve))
    else:
        tags += [(bytes([c]) + b"XYZ", b"XYZ \0\0\0\0" + fixed(*matrix[:, i])) for i, c in enumerate(b"rgb")]
        tags += [(bytes([c]) + b"TRC", curve) for c in b"rgb"]
    table, body, start = struct.pack(">I", len(tags)), b"", 132 + 12 * len(tags)
    for key, value in tags:
        table += key + struct.pack(">II", start + len(body), len(value))
        body += value
    space = b"GRAY" if matrix is None else b"RGB "
    size = 128 + len(table) + len(body)
    head = struct.pack(">I4sI4s4s4s6H", size, b"none", 0x2100000, b"mntr", space, b"XYZ ", 2020, 1, 1, 0, 0, 0)
    return (head + b"acsp" + b"\0" * 28 + fixed(0.9642, 1, 0.8249)).ljust(128, b"\0") + table + body


def converted(codes, matrix, curve) -> np.ndarray:
    """sRGB codes in [0,1] of codes in [0,1], by the definition of a profile of curves and a matrix."""
    return encode(curve(np.asarray(codes, float)) @ (np.linalg.inv(SRGB) @ matrix).T)


def adobe(codes):
    return converted(codes, ADOBE, lambda x: x ** (563 / 256))


def icc(data):
    return b"iCCP", b"a\0\0" + zlib.compress(data)


def gama(gamma):
    return b"gAMA", struct.pack(">I", round(gamma * 100000))


def cicp(primaries, transfer):
    return b"cICP", bytes([primaries, transfer, 0, 1])


def camera(space, mark):
    exif = Image.Exif()
    exif[0x8769] = {0xA001: space, 0xA005: {1: mark}}
    return b"eXIf", exif.tobytes().removeprefix(b"Exif\0\0")


LINEAR_SRGB, DISPLAY_P3 = profile("built-in Linear sRGB", SRGB, LINEAR), profile("Display P3", P3, CURVE)
REC2020 = np.array([[0.6735, 0.1656, 0.1251], [0.2790, 0.6753, 0.0456], [-0.0019, 0.0300, 0.7968]])
XY_709, XY_P3 = (
    (b"cHRM", struct.pack(">8I", 31270, 32900, *xy))
    for xy in ((64000, 33000, 30000, 60000, 15000, 6000), (68000, 32000, 26500, 69000, 15000, 6000))
)
CODED, LEFT_OUT, GIVEN = "that its file codes", "it was left out", "gamma that the file gives"
# chunks of a PNG, the codes in [0,1] that a picture of codes in [0,1] becomes, and what a note says
PNGS = {
    "nothing more": ([], lambda c: c, ""),
    "a linear ICC profile called sRGB": ([icc(LINEAR_SRGB)], lambda c: converted(c, SRGB, lambda x: x), ""),
    "gamma, called e-sRGB": (
        [icc(profile("e-sRGB", SRGB, GAMMA))], lambda c: converted(c, SRGB, lambda x: x ** (563 / 256)), ""),
    "a table, called sRGB": (
        [icc(profile("sRGB-elle-V2-g18", SRGB, TABLE))], lambda c: converted(c, SRGB, lambda x: x**1.8), ""),
    "Display P3": ([icc(DISPLAY_P3)], lambda c: converted(c, P3, decode), ""),
    "Adobe RGB": ([icc(profile("not sRGB", ADOBE, GAMMA))], adobe, ""),
    "an ICC profile of sRGB, under any name": ([icc(profile("c2", SRGB, CURVE))], lambda c: c, ""),
    "sRGB of LittleCMS": (
        [icc(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())], lambda c: c, ""),
    "an ICC profile of grey pictures": ([icc(profile("Dot Gain 20%", None, GAMMA))], lambda c: c, LEFT_OUT),
    "no profile": ([icc(b"no profile" * 9)], lambda c: c, LEFT_OUT),
    "cut short": ([icc(DISPLAY_P3[:200])], lambda c: c, LEFT_OUT),
    "PNG's gamma of 1": ([gama(1)], lambda c: encode(c), GIVEN),
    "gamma of old Macintoshes": ([gama(0.55556)], lambda c: encode(c**1.8), GIVEN),
    "gamma of sRGB": ([gama(0.45455)], lambda c: c, ""),
    "gamma of sRGB with its primaries": ([gama(0.45455), XY_709], lambda c: c, ""),
    "gamma of 1, but sRGB": ([gama(1), (b"sRGB", b"\0")], lambda c: c, ""),
    "gamma of 1, primaries of P3": ([gama(1), XY_P3], lambda c: converted(c, P3, lambda x: x), GIVEN),
    "codes of sRGB before gamma": ([cicp(1, 13), gama(1)], lambda c: c, ""),
    "codes of sRGB before a profile": ([icc(DISPLAY_P3), cicp(1, 13)], lambda c: c, ""),  # unlike AVIF and HEIC
    "codes of BT.709": ([cicp(1, 1), gama(1)], lambda c: c, ""),
    "codes that say nothing": ([cicp(2, 2)], lambda c: c, ""),
    "codes of P3": ([cicp(12, 13), gama(1)], lambda c: converted(c, P3, decode), CODED),
    "codes of BT.2020": ([cicp(9, 1), gama(1)], lambda c: converted(c, REC2020, decode), CODED),
    "PNG's `cICP` of linear values": ([cicp(1, 8), gama(1)], lambda c: converted(c, SRGB, lambda x: x), CODED),
    "codes of gamma 2.2": ([cicp(1, 4), gama(1)], lambda c: converted(c, SRGB, lambda x: x**2.2), CODED),
    "EXIF of a camera: Adobe RGB": ([camera(0xFFFF, "R03")], adobe, "Adobe RGB"),
    "EXIF of an older camera": ([camera(2, "")], adobe, "Adobe RGB"),
    "EXIF of sRGB": ([camera(1, "R98")], lambda c: c, ""),
    "EXIF, not calibrated": ([camera(0xFFFF, "R98")], lambda c: c, ""),
}  # fmt: skip


def png_of(path, chunks, pixels=RGB):
    """A PNG with these chunks alone between its header and its data."""
    write_picture(path, pixels)
    data = path.read_bytes()
    path.write_bytes(data[:33] + png_chunks(*chunks) + data[data.index(b"IDAT") - 4 :])
    return path


@pytest.mark.parametrize("name", PNGS)
@pytest.mark.parametrize("type", [np.uint8, np.uint16])
def test_read_photo_converts_by_what_a_png_says(tmp_path, name, type):
    """By cICP before iCCP and gAMA, by the third edition of PNG."""
    chunks, right, says = PNGS[name]
    pixels, top = (RGB, 255) if type == np.uint8 else (DEEP, 65535)
    photo, want = Picture.of(png_of(tmp_path / "a.png", chunks, pixels)), right(pixels / top) * top
    away = np.abs(photo.pixels - want)
    assert photo.pixels.dtype == type and away.max() < 140  # half an 8-bit code: profiles have four digits
    if type == np.uint8:
        np.testing.assert_array_equal(Picture.of(Image.open(tmp_path / "a.png")).pixels, photo.pixels)
        by_littlecms = chunks and chunks[0][0] in (b"iCCP", b"eXIf")  # which computes in 8 bits
        assert away.mean() < 0.7 and away.max() <= (0 if np.allclose(want, RGB) else 8 if by_littlecms else 1.5)
    assert says in " ".join(photo.notes) and bool(says) == bool(photo.notes)


def test_to_srgb_of_a_16_bit_profile_without_curves_is_refused(monkeypatch):
    monkeypatch.setattr("relight.pictures.profile._curve", lambda profile, name: None)
    image = Image.new("RGB", (2, 2))
    image.info["icc_profile"] = DISPLAY_P3
    with pytest.raises(UserError, match=r"a\.tif has 16 bits and a color profile of tables"):
        to_srgb(DEEP, image, "a.tif")


X = np.linspace(0, 1, 11)
# the numbers of a parametric curve -> its values (ICC.1:2022, table 68)
CURVES = {
    (2.2,): X**2.2,
    (2.0, 1.25, -0.25): np.maximum(1.25 * X - 0.25, 0) ** 2,
    (2.0, 0.75, -0.15, 0.1): np.where(X >= 0.2, np.maximum(0.75 * X - 0.15, 0) ** 2, 0) + 0.1,
    (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045): decode(X),
    (2.0, 1.0, 0.0, 0.5, 0.35, 0.1, 0.05): np.where(X >= 0.35, X**2 + 0.1, 0.5 * X + 0.05),
}


@pytest.mark.parametrize("numbers", CURVES)
def test_curve_of_every_parametric_type(numbers):
    data = b"para\0\0\0\0" + struct.pack(">HH", {1: 0, 3: 1, 4: 2, 5: 3, 7: 4}[len(numbers)], 0) + fixed(*numbers)
    np.testing.assert_allclose(_curve(profile("a", P3, data), b"gTRC")(X), CURVES[numbers], atol=1e-4)


SMPTE_C = np.array([[0.4163, 0.3931, 0.1547], [0.2217, 0.7033, 0.0750], [0.0137, 0.0914, 0.7202]])  # Lindbloom's
PAL = np.array([[0.4553, 0.3676, 0.1414], [0.2323, 0.7078, 0.0599], [0.0145, 0.1049, 0.7057]])
FLAT = np.full((16, 16, 3), (200, 100, 50), np.uint8)


def flat_file(suffix):
    if suffix == "heic":
        pytest.importorskip("pi_heif")
        return (Path(__file__).parent / "flat.heic").read_bytes()  # as libheif writes it
    return encoded(Image.fromarray(FLAT), suffix, quality=100, subsampling="4:4:4")


def box(kind, content):
    return struct.pack(">I", 8 + len(content)) + kind + content


def boxes(data):
    while data:
        size = int.from_bytes(data[:4])
        yield data[4:8], data[8:size]
        data = data[size:]


def recolored(data, own, others=(), wide=False):
    """An AVIF or HEIC whose picture has its `own` colr boxes; those of another picture stand in front of them.

    The table of which picture has which box has numbers of one byte, or is `wide`.
    """
    (_, start), (_, meta), (_, pixels) = boxes(data)
    place = meta.index(b"iprp")
    (_, stored), _ = boxes(meta[place + 4 :])
    colors = [(b"colr", content) for content in (*others, *own)]
    properties = colors + [(kind, content) for kind, content in boxes(stored) if kind != b"colr"]
    item, index, essential = (">I", ">H", 0x8000) if wide else (">H", ">B", 0x80)
    table = struct.pack(">BBBBI", wide, 0, 0, wide, 2)
    for picture in (1, 2):
        found = [
            struct.pack(index, number | essential * (kind in (b"av1C", b"hvcC", b"clap")))
            for number, (kind, _) in enumerate(properties, 1)
            if (number <= len(others)) == (picture == 2)
        ]
        table += struct.pack(item, picture) + bytes([len(found)]) + b"".join(found)
    tail = box(b"iprp", box(b"ipco", b"".join(box(*each) for each in properties)) + box(b"ipma", table))
    head = meta[: place - 4]
    old, new = (struct.pack(">I", 24 + len(start) + size) for size in (len(meta), len(head + tail)))
    return box(b"ftyp", start) + box(b"meta", head.replace(old, new) + tail) + box(b"mdat", pixels)


def nclx(primaries, transfer):
    return b"nclx" + struct.pack(">HHHB", primaries, transfer, 6, 0x80)


PROF_P3, PROF_SRGB = b"prof" + DISPLAY_P3, b"prof" + profile("a profile", SRGB, CURVE)
# own colr boxes, those of another picture, whether the table is wide -> the codes in [0,1] that a picture becomes
COLORED = {
    "codes of sRGB": ([nclx(1, 13)], [], False, lambda c: c),
    "codes of Display P3": ([nclx(12, 13)], [], False, lambda c: converted(c, P3, decode)),
    "codes of BT.2020": ([nclx(9, 1)], [], False, lambda c: converted(c, REC2020, decode)),
    "codes of BT.601, 525 lines": ([nclx(6, 6)], [], False, lambda c: converted(c, SMPTE_C, decode)),
    "codes of BT.601, 625 lines": ([nclx(5, 6)], [], False, lambda c: converted(c, PAL, decode)),
    "no codes, another picture's are P3": ([], [nclx(12, 13)], False, lambda c: c),
    "codes of sRGB behind another picture's of PQ": ([nclx(1, 13)], [nclx(9, 16)], False, lambda c: c),
    "codes of P3 behind another picture's of sRGB": (
        [nclx(12, 13)], [nclx(1, 13)], False, lambda c: converted(c, P3, decode)),
    "the same in a wide table": ([nclx(12, 13)], [nclx(1, 13)], True, lambda c: converted(c, P3, decode)),
    "a profile of P3 and codes of sRGB": ([PROF_P3, nclx(1, 13)], [], False, lambda c: converted(c, P3, decode)),
    "codes of P3 and a profile of sRGB": ([nclx(12, 13), PROF_SRGB], [], False, lambda c: c),
    "another picture's profile of P3": ([nclx(1, 13)], [PROF_P3], False, lambda c: c),
}  # fmt: skip


@pytest.mark.parametrize("name", COLORED)
@pytest.mark.parametrize("suffix", ["avif", "heic"])
def test_read_photo_takes_the_colors_of_the_primary_picture(tmp_path, suffix, name):
    *given, right = COLORED[name]
    (tmp_path / f"a.{suffix}").write_bytes(recolored(flat_file(suffix), *given))
    want = right(FLAT[0, 0] / 255) * 255
    photo = Picture.of(tmp_path / f"a.{suffix}")  # which registers the reader of HEIC
    for each in (photo, Picture.of(Image.open(tmp_path / f"a.{suffix}"))):
        assert np.abs(each.pixels - want).max() <= 3


@pytest.mark.parametrize("suffix", ["avif", "heic"])
def test_read_photo_says_that_a_file_names_no_color_space(tmp_path, suffix):
    (tmp_path / f"a.{suffix}").write_bytes(flat_file(suffix).replace(b"colr", b"free"))
    assert ["has no color space" in note for note in Picture.of(tmp_path / f"a.{suffix}").notes] == [True]


@pytest.mark.parametrize(
    ("suffix", "coding", "says"),
    [("png", (12, 18), "high dynamic range"), ("png", (10, 13), "kinds 10 and 13"),
     *((suffix, (9, 16), "high dynamic range: save it as sRGB") for suffix in ("png", "avif", "heic"))],
)  # fmt: skip
def test_read_photo_refuses_a_picture_coded_for_other_displays(tmp_path, suffix, coding, says):
    path = png_of(tmp_path / "a.png", [cicp(*coding)])
    if suffix != "png":
        path = tmp_path / f"a.{suffix}"
        path.write_bytes(recolored(flat_file(suffix), [nclx(*coding)]))
    with pytest.raises(UserError, match=says):
        Picture.of(path)


@pytest.mark.parametrize("word", [b"colrnclx\0\x09\0\x10\0\x09\x80", b"cICP\x09\x10\0\1", b"iCCP", b"metaiprpipco"])
@pytest.mark.parametrize("suffix", ["avif", "png"])
def test_read_photo_takes_no_color_from_a_comment(tmp_path, suffix, word):
    options = {"xmp": word} if suffix == "avif" else {"pnginfo": PngImagePlugin.PngInfo()}
    if suffix == "png":
        options["pnginfo"].add_text("Comment", word)
    Image.fromarray(FLAT).save(tmp_path / f"a.{suffix}", **options)
    photo = Picture.of(tmp_path / f"a.{suffix}")
    assert np.abs(photo.pixels.astype(int) - FLAT).max() <= 2 and not photo.notes


# blocks of EXIF that are none, or that break off
DAMAGED = {
    "no TIFF": b"\0\0\x11\0\0\1\4\0\0\0\0\0",
    "empty": b"Exif\0\0",
    "a directory beyond the end": b"Exif\0\0II*\0\xff\xff\xff\x7f",
    "a directory cut short": b"Exif\0\0II*\0\x08\0\0\0\xff\xff\x12\1\3\0",
    "an orientation that is text": b"Exif\0\0II*\0\x08\0\0\0\1\0\x12\1\2\0\4\0\0\0abc\0\0\0\0\0",
    "an orientation of 9": b"Exif\0\0II*\0\x08\0\0\0\1\0\x12\1\3\0\1\0\0\0\x09\0\0\0\0\0\0\0",
    "cut text": b"Raw profile type exif\0\nexif\n      20\n4578696600004d4d002\n",
    "an EXIF directory that is no number": b"Exif\0\0II*\0\x08\0\0\0\1\0\x69\x87\2\0\4\0\0\0abc\0\0\0\0\0",
}


@pytest.mark.parametrize("name", DAMAGED)
@pytest.mark.parametrize("suffix", ["png", "webp", "jpg", "16 bits"])
def test_read_photo_shows_a_picture_with_damaged_exif(tmp_path, suffix, name):
    options = {"webp": {"lossless": True}, "jpg": {"quality": 100, "subsampling": 0}}.get(suffix, {})
    pixels, path, block = SMOOTH, tmp_path / f"a.{suffix}", DAMAGED[name]
    if suffix == "16 bits" or name == "cut text":
        pixels, kind = DEEP, b"tEXt" if name == "cut text" else b"eXIf"
        path = png_of(tmp_path / "a.png", [(kind, block.removeprefix(b"Exif\0\0"))], DEEP)
    else:
        Image.fromarray(SMOOTH).save(path, exif=block, **options)
    assert np.abs(Picture.of(path).pixels.astype(int) - pixels).max() <= (4 if suffix == "jpg" else 0)


def saved(path, frames, **options):
    images = [Image.fromarray(frame) for frame in frames]
    images[0].save(path, save_all=True, append_images=images[1:], **options)
    return path


def pages(path, pixels, *kinds):
    """A TIFF whose pages have these NewSubfileTypes; those that have one are small."""
    with tifffile.TiffWriter(path) as file:
        for kind in kinds:
            file.write(pixels[::2, ::2].copy() if kind else pixels, photometric="rgb", subfiletype=bool(kind))
    with tifffile.TiffFile(path, mode="r+b") as file:
        for page, kind in zip(file.pages, kinds):
            page.tags[254].overwrite(kind)
    return path


TWO = [RGB, 255 - RGB]
# file of several pictures -> the first of a picture and its previews, or what is said of films and pages
SEVERAL = {
    "a.jpg": (lambda p: saved(p, [SMOOTH, RGB[::2, ::2]], format="MPO", quality=95), SMOOTH),
    "preview.tif": (lambda p: pages(p, RGB, 0, 1), RGB),
    "preview in front.tif": (lambda p: pages(p, DEEP, 1, 0), DEEP),
    "mask.tif": (lambda p: pages(p, RGB, 0, 4), RGB),
    "one.gif": (lambda p: saved(p, [SMOOTH]), SMOOTH),
    "a.webp": (lambda p: saved(p, TWO, lossless=True), "animated"),
    **{f"a.{kind}": (lambda p: saved(p, TWO), "animated") for kind in ("png", "gif", "avif")},
    "pages.tif": (lambda p: pages(p, RGB, 0, 0), "has 2 pages: save one of them"),
}


@pytest.mark.parametrize("name", SEVERAL)
def test_read_photo_of_several_pictures(tmp_path, name):
    make, found = SEVERAL[name]
    path = make(tmp_path / name)
    if isinstance(found, str):
        with pytest.raises(UserError, match=found):
            Picture.of(path)
    else:
        photo = Picture.of(path)
        assert photo.pixels.shape == found.shape and np.abs(photo.pixels.astype(int) - found).mean() < 3


TIFFS = [{}, {"compression": "zlib", "predictor": True}, {"tile": (16, 16)}, {"planarconfig": "separate"}]


@pytest.mark.parametrize("options", TIFFS)
def test_read_photo_keeps_16_bits_of_tiff(tmp_path, options):
    stored = DEEP.transpose(2, 0, 1) if "planarconfig" in options else DEEP
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="rgb", **options)
    photo = Picture.of(tmp_path / "a.tif")
    np.testing.assert_array_equal(photo.pixels, DEEP)
    assert photo.suffix == ".tif" and photo.codes.dtype == np.uint8


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("orientation", [3, 6])
def test_a_grey_tiff_may_be_turned_and_0_may_be_white(tmp_path, kind, orientation):
    for name, shown in (("a", DEEP[..., 0].astype(kind)), ("m", SOFT.astype(kind) * kind(np.iinfo(kind).max // 255))):
        turned = np.iinfo(kind).max - np.rot90(shown, {3: 2, 6: 1}[orientation])
        tags = [(274, "H", 1, orientation, True)]
        tifffile.imwrite(tmp_path / f"{name}.tif", turned, photometric="miniswhite", extratags=tags)
    np.testing.assert_array_equal(Picture.of(tmp_path / "a.tif").pixels[..., 0], DEEP[..., 0].astype(kind))
    np.testing.assert_array_equal(read_mask(tmp_path / "m.tif", (40, 30))[0], SOFT)


def test_read_photo_of_16_bits_without_its_package_blames_no_file(tmp_path, monkeypatch):
    tifffile.imwrite(tmp_path / "a.tif", np.full((12, 12, 3), 40000, np.uint16), photometric="rgb")
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)  # as if it were not installed
    with pytest.raises(ModuleNotFoundError) as error:
        Picture.of(tmp_path / "a.tif")
    assert error.value.name == "OpenImageIO"


def test_read_photo_of_16_bits_divides_by_the_alpha_that_multiplies(tmp_path):
    alpha = np.full((40, 30, 1), 65535, np.uint16)
    alpha[:20] = 20000
    values = np.concatenate([np.round(DEEP * (alpha / 65535)).astype(np.uint16), alpha], -1)
    for kind, expected in (("assocalpha", DEEP), ("unassalpha", values[..., :3])):
        tifffile.imwrite(tmp_path / "a.tif", values, photometric="rgb", extrasamples=[kind])
        photo = Picture.of(tmp_path / "a.tif")
        np.testing.assert_allclose(photo.pixels, expected.astype(float), atol=2 if kind == "assocalpha" else 0)
        np.testing.assert_array_equal(photo.alpha, alpha[..., 0])


@pytest.mark.parametrize("values", [RGB[..., 0], RGB, DEEP[..., 0], DEEP], ids="grey rgb deep-grey deep-rgb".split())
def test_a_png_may_have_one_color_that_is_transparent(tmp_path, values):
    color = values[20, 10]
    photo = Picture.of(png_of(tmp_path / "a.png", [(b"tRNS", np.atleast_1d(color).astype(">u2").tobytes())], values))
    clear = (values == color).reshape(40, 30, -1).all(-1)
    np.testing.assert_array_equal(photo.alpha, np.where(clear, 0, np.iinfo(values.dtype).max))
    assert photo.pixels.dtype == values.dtype


@pytest.mark.parametrize("suffix", [".png", ".tif", ".PNG", ".Tif", ".exr"])
@pytest.mark.parametrize("has_alpha", [False, True])
def test_write_picture_of_16_bits_and_of_openexr_is_read_back(tmp_path, suffix, has_alpha):
    alpha = np.linspace(0.1, 1, 1200, dtype=np.float32).reshape(40, 30)
    values, alpha = (SCENE, alpha) if suffix == ".exr" else (DEEP, (65535 * alpha).astype(np.uint16))
    values = np.dstack([values, alpha]) if has_alpha else values
    write_picture(tmp_path / f"a{suffix}", values)
    photo = Picture.of(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(photo.rgba, values, rtol=1e-5 if suffix == ".exr" and has_alpha else 0)
    np.testing.assert_array_equal(photo.rgba[..., 3:], values[..., 3:])
    assert photo.suffix == suffix.lower() and (photo.alpha is None) != has_alpha
    if suffix == ".tif":
        np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tif"), values)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["8 bits", "png", "tif"])
def test_read_photo_turns_pictures_upright(tmp_path, orientation, kind):
    path, stored = tmp_path / f"a.{'tif' if kind == 'tif' else 'png'}", RGB if kind == "8 bits" else DEEP
    if kind == "tif":
        tifffile.imwrite(path, DEEP, photometric="rgb", extratags=[(274, "H", 1, orientation, True)])
    else:
        exif = Image.Exif()
        exif[274] = orientation
        png_of(path, [(b"eXIf", exif.tobytes().removeprefix(b"Exif\0\0"))], stored)
    upright = {
        1: stored, 2: stored[:, ::-1], 3: stored[::-1, ::-1], 4: stored[::-1], 5: stored.transpose(1, 0, 2),
        6: np.rot90(stored, -1), 7: np.rot90(stored, 2).transpose(1, 0, 2), 8: np.rot90(stored),
    }[orientation]  # fmt: skip
    np.testing.assert_array_equal(Picture.of(path).pixels, upright)


@pytest.mark.parametrize("type", [np.uint8, np.uint16])
def test_to_codes_is_the_inverse_of_to_linear(type):
    codes = np.arange(np.iinfo(type).max + 1).astype(type)
    np.testing.assert_array_equal(to_codes(to_linear(codes), type), codes)
    np.testing.assert_allclose(to_linear(codes), decode(codes / np.iinfo(type).max), rtol=1e-6)
    np.testing.assert_array_equal(as_codes(np.arange(256).astype(np.uint16) * 257), np.arange(256))


def exr(path, pixels, header=(), **channels):
    planes = {name: np.ascontiguousarray(pixels[..., i]) for i, name in enumerate("RGB")} | channels
    OpenEXR.File(dict(header), planes).write(str(path))
    return path


SCENE = RNG.uniform(0, 4, (40, 30, 3)).astype(np.float32)


def test_read_photo_of_openexr_divides_by_alpha_without_nan_and_converts_primaries(tmp_path):
    alpha = np.zeros((40, 30), np.float32)
    alpha[:20], alpha[20:30] = 1, 0.5
    photo = Picture.of(exr(tmp_path / "a.exr", SCENE * alpha[..., None], A=alpha))
    np.testing.assert_array_equal(photo.alpha, alpha)
    np.testing.assert_allclose(photo.pixels[:30], SCENE[:30], rtol=1e-6)
    alpha[3, 4], alpha[20:] = np.nan, 1
    np.testing.assert_array_equal(Picture.of(exr(tmp_path / "a.exr", SCENE, A=alpha)).alpha, np.nan_to_num(alpha))
    p3 = {"chromaticities": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)}
    photo = Picture.of(exr(tmp_path / "b.exr", np.ones_like(SCENE), p3))
    np.testing.assert_allclose(photo.pixels, 1, atol=1e-4)
    assert "chromaticities" in photo.notes[0]


@pytest.mark.parametrize("name", "a.png a.jpg alpha.png deep.png deep.tif color.png turned.jpg a.exr".split())
def test_read_photo_of_grey_pictures(tmp_path, name):
    grey = np.round(255 * SCENE[..., 0] / SCENE.max()).astype(np.uint8)
    path, deep, color = tmp_path / name, grey.astype(np.uint16) * 257, np.dstack([grey] * 3)
    alpha = np.dstack([grey, np.arange(grey.size).reshape(grey.shape).astype(np.uint8)])
    if name == "a.exr":
        OpenEXR.File({}, {"Y": np.ascontiguousarray(SCENE[..., 0])}).write(str(path))
    else:
        stored = {"alpha.png": alpha, "color.png": color, "deep.png": deep, "deep.tif": deep}.get(name, grey)
        exif = Image.Exif()
        exif[ExifTags.Base.Orientation] = 6 if name == "turned.jpg" else 1
        Image.fromarray(stored).save(path, exif=exif, **({"quality": 100} if name.endswith("jpg") else {}))
    photo = Picture.of(path)
    expected = {"a.exr": SCENE[..., 0], "turned.jpg": np.rot90(grey, -1)}.get(name, deep if "deep" in name else grey)
    atol = 3 if name.endswith("jpg") else 0
    np.testing.assert_allclose(photo.pixels, np.dstack([expected] * 3), rtol=1e-6, atol=atol)
    assert photo.pixels.dtype == {"a.exr": np.float32, "deep.png": np.uint16, "deep.tif": np.uint16}.get(name, np.uint8)
    assert (photo.alpha is not None) == (name == "alpha.png")
    assert ["the photo is grey" in note for note in photo.notes] == [True]


@pytest.mark.parametrize(("bits", "says"), [(10, "largest code is"), (12, "of 65535, as if it held fewer"), (16, "")])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_read_photo_of_fewer_bits_in_16_says_so(tmp_path, suffix, bits, says):
    write_picture(tmp_path / f"a{suffix}", DEEP >> (16 - bits))
    photo = Picture.of(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(photo.pixels, DEEP >> (16 - bits))
    assert says in " ".join(photo.notes) and bool(says) == bool(photo.notes)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".exr"])
@pytest.mark.slow
def test_photo_command_writes_in_kind(tmp_path, run, weights, draw, suffix):
    """Relit as the 8-bit picture is, but finer: more codes than 8 bits have, each within half a step and rounding."""
    codes, mask = draw()
    values = decode(codes / 255).astype(np.float32) if suffix == ".exr" else codes.astype(np.uint16) * 257
    for name, pixels in (("eight.png", codes), (f"a{suffix}", values)):
        write_picture(tmp_path / name, pixels)
        Image.fromarray(mask).save(tmp_path / f"{name[:-4]}_mask.png")
        options = ("--light", "key:#ffffff@60,20", "--stops", "-1", "--maps", "--weights", weights)
        says = run("photo", tmp_path / name, "--out", tmp_path / name[:-4], *options)
    found, eight = Picture.of(tmp_path / "a" / f"relit{suffix}"), Picture.of(tmp_path / "eight" / "relit.png")
    assert f"relit{suffix}" in says and found.pixels.dtype == values.dtype
    assert np.abs(found.codes.astype(int) - eight.pixels).max() <= 1
    assert len(np.unique(found.pixels[mask == 255])) > 300
    outside = np.asarray(Image.open(tmp_path / "a" / "albedo.png"))[..., 3] == 0
    assert outside.mean() > 0.3
    np.testing.assert_array_equal(found.pixels[outside], values[outside])


@pytest.mark.parametrize("suffix", [".png", ".tif", ".exr"])
def test_a_deep_cutout_comes_back_under_its_own_light(tmp_path, relighter, draw, suffix):
    """With all bits of its alpha; colors that OpenEXR multiplies by it are rounded once more."""
    codes, mask = draw()
    values = np.dstack([decode(codes / 255), (mask / 255) ** 1.5]).astype(np.float32)
    if suffix != ".exr":
        values = np.round(values * 65535).astype(np.uint16)
    write_picture(tmp_path / f"a{suffix}", values)
    scene = relighter.scene(tmp_path / f"a{suffix}")
    relit, seen = scene.relit(Look(scene.people[0].light)), mask > 0
    np.testing.assert_array_equal(relit[..., 3], values[..., 3])
    np.testing.assert_allclose(relit[seen], values[seen], rtol=2e-7 if suffix == ".exr" else 0)


PERSON = np.zeros((40, 30), bool)
PERSON[10:30, 8:20] = True
SOFT = np.where(PERSON, 255, 0).astype(np.uint8)
SOFT[9, 8:20] = 100


def painted(color, background=(0, 0, 0)):
    return np.where(PERSON[..., None], np.array(color, np.uint8), np.array(background, np.uint8))


VOC = Image.fromarray(PERSON * np.uint8(15))
VOC.putpalette([0, 0, 0] * 15 + [192, 128, 128])
AREA = np.zeros((40, 30), bool)
AREA[18:26, 9:18] = True  # in the person
# image of a mask -> coverage in AREA, and what a note says
MASKS = {
    "white on black": (SOFT, 255, ""),
    "in three equal channels": (np.dstack([SOFT] * 3), 255, ""),
    "in a palette of grey": (Image.fromarray(SOFT).convert("P"), 255, ""),
    "in 16 bits": (SOFT.astype(np.uint16) * 257, 255, ""),
    "labels of a palette, the person pink": (VOC, 255, "two colors: #c08080"),
    "green on black": (painted((0, 255, 0)), 255, "two colors"),
    "dark blue": (painted((0, 0, 90)), 255, "two colors"),
    "white on blue": (painted((255, 255, 255), (0, 0, 255)), 255, "#ffffff is taken for the person"),
    "0 and 1": (PERSON.astype(np.uint8), 255, "the two values 0 and 1"),
    "0 and 1 in 16 bits": (PERSON.astype(np.uint16), 255, ""),
    "16 bits of 0 and 255": (PERSON.astype(np.uint16) * 255, 255, ""),
    "0 and 100": (PERSON.astype(np.uint8) * 100, 255, "two values 0 and 100"),
    "0 and 1 as floats": (PERSON.astype(np.float32), 255, ""),
    "0 and 0.4 as floats": (PERSON.astype(np.float32) * 0.4, 255, "two values 0 and 0.4"),
    "grey and white": (np.where(PERSON, 255, 60).astype(np.uint8), 255, "two values 60 and 255"),
    "one bit": (PERSON, 255, ""),
    "red with a soft edge": (np.stack([SOFT, SOFT * 0, SOFT * 0], -1), 255, "drawn in one color"),
    "alpha of 0 and 255": (np.dstack([RGB, np.where(PERSON, 255, 0)]).astype(np.uint8), 255, ""),
    "an area of 128 beside white and black": (
        np.where(AREA, np.uint8(128), SOFT), 128, "areas of the value 128, which are taken as covered in part"),
    "nothing above 200": (np.where(PERSON, np.uint8(200), SOFT), 200, "nowhere white: its largest value is 200"),
    "floats up to 0.6": ((SOFT / np.float32(425)), 153, "nowhere white"),
    "12 bits": (SOFT.astype(np.uint16) * 16, 255, ""),
    "floats up to 255": (SOFT.astype(np.float32), 255, ""),
    "alpha of grey": (np.dstack([np.full_like(SOFT, 255), SOFT]), 255, ""),
    "black, with alpha": (np.dstack([0 * SOFT, 0 * SOFT, 0 * SOFT, SOFT]), 255, ""),
}  # fmt: skip


@pytest.mark.parametrize("name", MASKS)
def test_read_mask_of_every_kind(tmp_path, name):
    image, inside, says = MASKS[name]
    image = image if isinstance(image, Image.Image) else Image.fromarray(image)
    path = tmp_path / ("m.tif" if image.mode == "F" else "m.png")
    image.save(path)
    mask, notes = read_mask(path, (40, 30))
    assert mask.dtype == np.uint8 and (mask[AREA] == inside).all() and (mask[~PERSON & (SOFT == 0)] == 0).all()
    assert (mask[PERSON & ~AREA] == (255 if inside == 128 else inside)).all()
    assert says in " ".join(notes) and bool(says) == bool(notes)
    if name in ("white on black", "red with a soft edge") or name.startswith("in "):
        np.testing.assert_array_equal(mask, SOFT)


STEPS = (np.indices((40, 30)).sum(0) // 18).astype(np.uint8)
NOISY = np.clip(painted((255, 255, 255), (0, 0, 30)) + RNG.integers(0, 9, (40, 30, 3)), 0, 255).astype(np.uint8)
BORDER = painted((192, 128, 128)) + (SOFT[..., None] == 100) * np.array((224, 224, 192), np.uint8)
LABELS = {
    "labels from 0 to 255": (STEPS * 85, "areas of the values 85, 170, as labels have"),
    "labels of a person and its border": (BORDER, "has several colors"),
    "a background that is not black": (NOISY, "a background that is not black"),
    "three labels": (2 * PERSON.astype(np.uint8) + (SOFT == 100), "labels or shades from 0 to 2"),
    "three labels in 16 bits": ((2 * PERSON + (SOFT == 100)).astype(np.uint16), "from 0 to 2 of 255"),
    "two colors": (painted((255, 0, 0), (0, 0, 255)), "#0000ff and #ff0000, neither of which is black or white"),
    "a photo": (RGB, "is the photo itself"),
}  # fmt: skip


@pytest.mark.parametrize("name", ["m.exr", "M.EXR"])
@pytest.mark.parametrize("alpha", [False, True])
def test_read_mask_of_openexr(tmp_path, name, alpha):
    soft = SOFT / np.float32(255)
    write_picture(tmp_path / name, np.dstack([soft / 2, soft / 2, soft / 2, soft] if alpha else [soft] * 3))
    mask, notes = read_mask(tmp_path / name, (40, 30))
    assert not notes
    np.testing.assert_array_equal(mask, SOFT)


@pytest.mark.parametrize("name", LABELS)
def test_read_mask_refuses_what_can_mean_several_things(tmp_path, name):
    image, says = LABELS[name]
    Image.fromarray(image).save(tmp_path / "m.png")
    with pytest.raises(UserError, match=rf"{says}.*white on the person"):
        read_mask(tmp_path / "m.png", (40, 30))


def test_read_mask_with_nan_says_so_without_a_warning_of_numpy(tmp_path, recwarn):
    values = SOFT.astype(np.float32) / 255
    values[0, 0] = np.nan
    Image.fromarray(values).save(tmp_path / "m.tif")
    photo = masked(Picture.of(RGB), tmp_path / "m.tif")
    np.testing.assert_array_equal(photo.coverage, SOFT)
    assert "1 values that are not numbers" in photo.notes[0] and not recwarn.list


CORNER = np.hypot(*np.meshgrid(np.arange(30) - 14.5, np.arange(40) - 19.5))
# alpha of a photo -> coverage in AREA, or None if it is no mask
ALPHAS = {
    "a person": (SOFT, 255),
    "a person of 200": (np.where(PERSON, 200, 0), 255),
    "a person before 40": (np.where(PERSON, 255, 40), 255),
    "a veil of 128": (np.where(AREA, 128, SOFT), 128),
    "one pixel of 254": (np.where(np.arange(1200).reshape(40, 30) == 500, 254, 255), None),
    "one transparent pixel": (np.where(np.arange(1200).reshape(40, 30) == 500, 0, 255), None),
    "rounded corners": (np.where(CORNER > 22, 0, 255), None),
    "a vignette": (np.clip(330 - 8 * CORNER, 0, 255).astype(int), None),
    "specks": (np.where(RNG.random((40, 30)) < 0.02, 0, 255), None),
    "a watermark": (np.where(AREA, 200, 255), None),
    "a strip below": (np.where(np.arange(40)[:, None] > 36, 0, 255) * np.ones(30, int), None),
    "labels": (STEPS * 85, None),
}


@pytest.mark.parametrize("name", ALPHAS)
@pytest.mark.parametrize("suffix", [".png", ".tif", ".exr"])
def test_alpha_is_a_mask_if_it_passes_as_one(tmp_path, suffix, name):
    alpha, inside = ALPHAS[name]
    pixels = {".png": RGB, ".tif": DEEP, ".exr": SCENE}[suffix]
    write_picture(tmp_path / f"a{suffix}", with_alpha(pixels, alpha.astype(np.uint8)))
    photo = Picture.of(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(convert_alpha(photo.alpha, np.uint8), alpha)
    if inside is None:
        with pytest.raises(NoMaskNetwork):
            masked(photo)
    else:
        found = masked(photo).coverage
        assert found[22, 12] == inside and not found[~PERSON & (SOFT == 0)].any()


def test_a_mask_on_a_picture_with_transparent_parts_covers_only_what_is_seen():
    alpha = np.where(np.arange(40)[:, None] < 15, 0, 255) * np.ones((1, 30), int)
    image = Image.fromarray(with_alpha(RGB, alpha.astype(np.uint8)))
    np.testing.assert_array_equal(masked(Picture.of(image), SOFT).coverage, np.minimum(fit_edge(RGB, SOFT), alpha))


@pytest.mark.parametrize(("value", "said"), [(0, True), (128, True), (255, False)])
def test_alpha_that_is_the_same_everywhere_is_left_out(value, said):
    photo = Picture.of(Image.fromarray(with_alpha(RGB, np.full(RGB.shape[:2], value, np.uint8))))
    assert photo.alpha is None and any("alpha is the same everywhere" in note for note in photo.notes) == said


ARRAYS = {"above white": SCENE, "of codes": SCENE / 4, "far above white": SCENE * 1000}


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("type", [np.float16, np.float32, np.float64])
def test_arrays_of_floats_are_linear(name, type):
    values = ARRAYS[name].astype(type)
    photo = Picture.of(values)
    assert photo.pixels.dtype == np.float32 and photo.alpha is None
    np.testing.assert_allclose(photo.pixels, values, rtol=1e-7)
    np.testing.assert_allclose(photo.codes, np.round(encode(values.astype(float)) * 255), atol=1)
    np.testing.assert_array_equal(Picture.of(values[..., 1]).pixels[..., 2], photo.pixels[..., 1])
    assert ["taken as linear" in note for note in photo.notes] == [True]


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e39])
def test_linear_pictures_that_are_not_finite_are_refused(tmp_path, value):
    values = SCENE.astype(float)
    values[3, 3] = value
    with np.errstate(over="ignore"):
        file = exr(tmp_path / "a.exr", values.astype(np.float32))
    for given in (values, file):
        with pytest.raises(UserError, match="not finite"):
            Picture.of(given)
    photo = Picture.of(SCENE - np.float16(1))
    np.testing.assert_array_equal(photo.pixels, np.maximum(SCENE - 1, 0))
    assert "negative values" in " ".join(photo.notes)


@pytest.mark.parametrize("label", [np.uint8(1), np.int64(15), np.float32(0.4), np.uint16(65535), True])
def test_masks_may_be_arrays_of_labels(label):
    photo = masked(Picture.of(RGB), PERSON * np.asarray(label))
    np.testing.assert_array_equal(photo.coverage, fit_edge(RGB, PERSON * np.uint8(255)))


def test_the_page_of_files_shows_kinds_of_these_tables(check_page):
    pixel = np.array([200, 100, 50]) / 255
    photos = {name: (np.round(right(pixel) * 255), says) for name, (_, right, says) in PNGS.items()}
    check_page("Photos", {"photo": photos})
    check_page("Masks", {"mask": MASKS})
