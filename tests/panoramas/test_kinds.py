import codecs

import numpy as np
import OpenEXR
import pytest

from relight.core.errors import UserError
from relight.panoramas import read_panorama
from relight.panoramas.color import REC709, XYZ

P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)
E = (1 / 3, 1 / 3)
SHARP = (0.6898, 0.3206, 0.0736, 0.9003, 0.1166, 0.0374, *E)  # Radiance's, for spectral accuracy
PLAIN = (0.640, 0.330, 0.290, 0.600, 0.150, 0.060, *E)  # Radiance's default
ORANGE = np.array([200, 100, 50, 128], np.uint8)
CODES = (200 / 256, 100 / 256, 50 / 256)


def hdr(lines: bytes, pixel=ORANGE, start=b"#?RADIANCE\n") -> bytes:
    return start + lines + b"FORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 64\n" + pixel.tobytes() * (32 * 64)


def primaries(values) -> bytes:
    return b"PRIMARIES=" + " ".join(map(str, values)).encode() + b"\n"


def to_709(xy) -> np.ndarray:
    """The matrix to Rec. 709, written out: RGB to XYZ by the definition, Bradford's cones of both whites."""

    def to_xyz(xy):
        points = np.array([(x / y, 1, (1 - x - y) / y) for x, y in np.reshape(xy, (4, 2))]).T
        return points[:, :3] * np.linalg.solve(points[:, :3], points[:, 3]), points[:, 3]

    cones = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
    (source, white), (target, own) = to_xyz(xy), to_xyz(REC709)
    return np.linalg.inv(target) @ np.linalg.inv(cones) @ np.diag(cones @ own / (cones @ white)) @ cones @ source


CONVERTED = "from the file's chromaticities"
# lines of the header -> radiance of a pixel that is stored as CODES, and what a note says
HEADERS = {
    "nothing more": (b"", CODES, ""),
    "`EXPOSURE=2`": (b"EXPOSURE=2\n", np.divide(CODES, 2), ""),
    "EXPOSURE twice": (b"EXPOSURE=2\nEXPOSURE=.5\n", CODES, ""),
    "an indented EXPOSURE": (
        b"in.hdr:\n\tpfilt -e 4\n\tEXPOSURE=4\npcomb in.hdr\nEXPOSURE=2\n", np.divide(CODES, 2), ""),
    "`EXPOSURE=4` after a tab": (b"\tEXPOSURE=4\n", CODES, ""),
    "EXPOSURE in a comment": (b"# EXPOSURE=2\n", CODES, ""),
    "an indented COLORCORR": (b"\tCOLORCORR=2 4 8\n", CODES, ""),
    "COLORCORR": (b"COLORCORR=1 2 4\n", np.divide(CODES, (1, 2, 4)), ""),
    "PRIMARIES of Rec. 709": (primaries(REC709), CODES, ""),
    "`PRIMARIES` of Radiance": (primaries(PLAIN), CODES, ""),
    "`PRIMARIES` of zeros": (primaries([0] * 8), CODES, ""),
    "`PRIMARIES` of Display P3": (primaries(P3), to_709(P3) @ CODES, CONVERTED),
    "impossible PRIMARIES": (
        primaries([0.3] * 8), CODES, "its chromaticities are not those of a color space: they were taken for Rec. 709"),
    "PRIMARIES with white E": (primaries(SHARP), to_709(SHARP) @ CODES, CONVERTED),
    "PRIMARIES of CIE XYZ": (primaries(XYZ), np.linalg.solve(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]], CODES), CONVERTED),
    "PRIMARIES and EXPOSURE": (primaries(P3) + b"EXPOSURE=2\n", to_709(P3) @ CODES / 2, CONVERTED),
    "CR LF": (b"EXPOSURE=2\r\n" + primaries(P3).replace(b"\n", b"\r\n"), to_709(P3) @ CODES / 2, CONVERTED),
    "`GAMMA=2.2`": (b"GAMMA=2.2\n", CODES, "its GAMMA of 2.2 is left out: pixels are taken as linear"),
    "a view": (b"VIEW= -vtv -vh 90\nPIXASPECT=1\nCAPDATE= 2020:01:01\n", CODES, ""),
}  # fmt: skip


@pytest.mark.parametrize(
    "line",
    [b"EXPOSURE=", b"EXPOSURE=2,0", b"EXPOSURE=0", b"COLORCORR=1 1", b"FORMAT=float",
     b"PRIMARIES=1 2 3", b"PRIMARIES=a b c d e f g h", b"PRIMARIES=" + b"nan " * 8],
)  # fmt: skip
def test_hdr_of_a_line_that_says_nothing_is_refused(tmp_path, line):
    (tmp_path / "a.hdr").write_bytes(hdr(line + b"\n"))
    with pytest.raises(UserError, match=r"not a whole Radiance picture: (a header value|its FORMAT) is"):
        read_panorama(tmp_path / "a.hdr")


@pytest.mark.parametrize("name", HEADERS)
def test_hdr_of_this_header(tmp_path, name):
    lines, radiance, says = HEADERS[name]
    (tmp_path / "a.hdr").write_bytes(hdr(lines))
    found = read_panorama(tmp_path / "a.hdr")
    np.testing.assert_allclose(found.pixels[0, 0], np.maximum(radiance, 0), rtol=1e-3, atol=1e-4)
    assert says in " ".join(found.repairs) and bool(says) == bool(found.repairs)


SPELLINGS = {
    "a mark": hdr(b"", start=codecs.BOM_UTF8 + b"#?RADIANCE\n"),
    "blanks around =": hdr(b"EXPOSURE = 2\n").replace(b"FORMAT=", b"FORMAT = "),
    "an empty line with blanks": hdr(b"").replace(b"rgbe\n\n", b"rgbe\n \t\n"),
    "two blanks in the resolution": hdr(b"").replace(b"-Y 32 +X 64", b"-Y  32  +X  64 "),
    "a line of 9,000 bytes": hdr(b"pcomb " + b"-e r=1 " * 1300 + b"\n"),
    "XYZE": hdr(b"").replace(b"rgbe", b"xyze"),
    "two numbers": hdr(b"COLORCORR=1 2\n"),
    "no end": hdr(b"")[:40],
    "no pixels": hdr(b"")[:80],
}


def test_hdr_on_the_page_is_read_as_here_or_refused(on_the_page, tmp_path):
    """The viewer's reader in JavaScript: the same pixels and notes, but that other primaries are an error."""
    files = {name: hdr(lines) for name, (lines, *_) in HEADERS.items()} | SPELLINGS
    files |= {lines.decode(): hdr(lines) for lines in [b"EXPOSURE=2,0\n", b"EXPOSURE=\n", b"FORMAT=float\n"]}
    answers = on_the_page([*files.values()])
    refused_there = []
    for number, (name, (pixels, shape, said)) in enumerate(zip(files, answers)):
        try:
            found = read_panorama(tmp_path / f"{number}.hdr")
        except UserError:
            assert pixels is None and said.startswith("The .hdr"), name
            continue
        if pixels is None:
            refused_there.append(name)
        else:
            np.testing.assert_allclose(np.reshape(pixels, shape), found.pixels, rtol=1e-6, err_msg=name)
            assert bool(said) == bool(found.repairs), name
    assert refused_there == [*(name for name, (*_, says) in HEADERS.items() if "chromaticities" in says), "XYZE"]


WHITE, RED = (0.9505, 1.0, 1.089), (0.4124, 0.2126, 0.0193)
PIXEL = dict(zip("RGB", CODES))
# channels with their values, header -> the color of a pixel, and what a note says
EXRS = {
    "channels `X` `Y` `Z` of white, .9505 1 1.089": (dict(zip("XYZ", WHITE)), {}, (1, 1, 1), "taken as CIE XYZ"),
    "X Y Z and alpha": ({**dict(zip("XYZ", WHITE)), "A": 1}, {}, (1, 1, 1), "CIE XYZ"),
    "R G B beside X Y Z": (PIXEL | dict(zip("XYZ", WHITE)), {}, CODES, ""),
    "channel `Y`": ({"Y": 100 / 256}, {}, 3 * (100 / 256,), ""),
    "Y beside a depth": ({"Y": 0.5, "Z": 9}, {}, (0.5, 0.5, 0.5), ""),
    "channels `R` `G` `B`": (PIXEL, {}, CODES, ""),
    "`chromaticities` of Display P3": (PIXEL, {"chromaticities": P3}, to_709(P3) @ CODES, CONVERTED),
    "`oiio:ColorSpace` ACEScg, no `chromaticities`": (
        PIXEL, {"oiio:ColorSpace": "ACEScg"}, CODES,
        "names the color space ACEScg without chromaticities: taken for linear Rec. 709"),
    "`colorspace` sRGB": (
        PIXEL, {"colorspace": "sRGB"}, ((np.array(CODES) + 0.055) / 1.055) ** 2.4, "its codes were decoded"),
    "sRGB and Display P3, decoded first": (
        {"R": 0.5, "G": 0.5, "B": 0}, {"colorspace": "sRGB", "Chromaticities": P3},
        np.maximum(to_709(P3) @ [0.2140, 0.2140, 0], 0), "its codes were decoded"),
    "ACES": (PIXEL, {"acesImageContainerFlag": 1}, CODES, "color space ACES"),
    "lin_srgb": (PIXEL, {"oiio:ColorSpace": "lin_srgb"}, CODES, ""),
    "lin_rec709_scene": (PIXEL, {"colorInteropID": "lin_rec709_scene"}, CODES, ""),
    "ACEScg and chromaticities": (PIXEL, {"oiio:ColorSpace": "ACEScg", "chromaticities": REC709}, CODES, ""),
    **{" ".join(map(str, header.items())): (PIXEL, header, CODES, says) for header, says in (
        ({"oiio:ColorSpace": "Utility - Linear - sRGB"}, ""),
        ({"oiio:ColorSpace": "Linear Rec.709 (sRGB)"}, ""),
        ({"oiio:ColorSpace": "Filmic sRGB"}, "color space Filmic sRGB without chromaticities: taken for linear"),
        ({"oiio:ColorSpace": "sRGB", "colorInteropID": "lin_rec709_scene"}, ""),  # the newer one counts
        ({"colorspace": "ACEScg"}, "color space ACEScg"),
        ({"color_space": "ACEScg"}, "color space ACEScg"),
        ({"oiio:colorspace": "lin_rec2020_scene"}, "color space lin_rec2020_scene"),
        ({"exr/oiio:ColorSpace": "ACES2065-1"}, "color space ACES2065-1"),
        ({"colorinteropid": "srgb_p3d65_scene"}, "color space srgb_p3d65_scene"),
        ({"colorspace": "Rec709"}, "color space Rec709"),  # by OpenImageIO, codes of BT.709
        ({"colorspace": "Non-linear sRGB"}, "color space Non-linear sRGB"),
        ({"colorspace": "ACEScct", "chromaticities": REC709}, "color space ACEScct: taken as linear"),
        ({"colorspace": ""}, ""),
        ({"Chromaticities": "0.64 0.33"}, "its chromaticities are not those of a color space"),
    )},
}  # fmt: skip


def exr(path, values, **header):
    """A panorama whose channels have one value each."""
    OpenEXR.File(header, {c: np.full((32, 64), value, np.float32) for c, value in values.items()}).write(str(path))
    return path


@pytest.mark.parametrize("name", EXRS)
def test_exr_of_these_channels_and_this_header(tmp_path, name):
    values, header, color, says = EXRS[name]
    found = read_panorama(exr(tmp_path / "a.exr", values, **header))
    np.testing.assert_allclose(found.pixels[0, 0], color, atol=3e-4)
    assert says in " ".join(found.repairs) and bool(says) == bool(found.repairs)


SRGB = ["sRGB", "srgb", "srgb_rec709_scene", "srgb_tx", "sRGB - Texture", "sRGB Encoded Rec.709 (sRGB)"]


@pytest.mark.parametrize("name", SRGB)
@pytest.mark.parametrize("attribute", ["oiio:ColorSpace", "colorspace", "colorInteropID"])
def test_exr_of_srgb_codes_is_decoded(tmp_path, name, attribute):
    """.5 is the code of .2140, and .03 lies on the straight part; above 1 there are no codes, so the name is wrong."""
    for brightest, pixel in ((1.0, (0.2140, 0.03 / 12.92, 1)), (1.5, (0.5, 0.03, 1.5))):
        found = read_panorama(exr(tmp_path / "a.exr", dict(zip("RGB", (0.5, 0.03, brightest))), **{attribute: name}))
        np.testing.assert_allclose(found.pixels[0, 0], pixel, rtol=1e-3)
        (note,) = found.repairs
        assert f"names the color space {name}" in note and ("decoded" in note) == (brightest == 1)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"X": -1, "Y": 0.5, "Z": 2}, "negative values, as positions"),
        ({"X": 1, "Y": 1}, "R, G and B, or X, Y and Z"),
        *((dict.fromkeys(names.split(), 1), "save the layer that you mean under these names")
          for names in ("r g b", "diffuse.R diffuse.G diffuse.B", "View.Combined.R View.Combined.G", "R G")),
    ],
)  # fmt: skip
def test_exr_of_other_channels_says_what_to_do(tmp_path, values, says):
    with pytest.raises(UserError, match=says):
        read_panorama(exr(tmp_path / "a.exr", values))


@pytest.mark.parametrize(
    ("data", "display", "says"),
    [(((8, 8), (71, 39)), ((0, 0), (95, 47)), ["do not fill its display window"]),
     (((-8, -8), (55, 23)), ((0, 0), (31, 15)), ["beyond its display window are left out"]),
     (((-8, 0), (55, 31)), ((0, 0), (63, 31)), ["do not fill", "beyond its display window"]),
     (((100, 50), (163, 81)), ((100, 50), (163, 81)), [])],
)  # fmt: skip
def test_exr_windows(tmp_path, data, display, says):
    planes = {c: np.arange(32 * 64, dtype=np.float32).reshape(32, 64) for c in "RGB"}
    OpenEXR.File({"dataWindow": data, "displayWindow": display}, planes).write(str(tmp_path / "a.exr"))
    found = read_panorama(tmp_path / "a.exr", layout="latlong")
    (x, y), (left, top) = data[0], display[0]
    row, column = max(y - top, 0) + 1, max(x - left, 0) + 2
    assert found.pixels[row, column, 0] == 64 * (row + top - y) + column + left - x
    assert len(found.repairs) == len(says) and all(a in b for a, b in zip(says, found.repairs))


def test_the_page_of_files_shows_kinds_of_these_tables(check_page):
    check_page("Panoramas", {"`.hdr`": HEADERS, "`.exr`": EXRS})
