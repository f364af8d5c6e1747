"""Conversion of photos to sRGB by what their files say of their colors: ICC profile, PNG's gamma, EXIF.

8-bit pictures are converted by LittleCMS. Pillow's binding of it knows no 16 bits; these are converted by the curves
and primaries of the profile, which those of cameras and photo editors have.
"""

import io
import struct
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from PIL import ExifTags, Image, ImageCms

from relight.core.errors import UserError
from relight.core.srgb import decode, encode
from relight.panoramas.color import REC709, chromaticity_matrix

SRGB_GAMMA = 0.45455  # as PNG writes it
ADOBE = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)  # x and y of the primaries and of white
ADOBE_GAMMA = 563 / 256
Curve = Callable[[np.ndarray], np.ndarray]  # from codes in [0,1] to linear values
Converted = tuple[np.ndarray, list[str]]  # pixels of the same type as before, and notes, one sentence each
# Codes of ITU-T H.273.
UNSPECIFIED = 2
PRIMARIES = {
    1: REC709,
    5: (0.64, 0.33, 0.29, 0.60, 0.15, 0.06, 0.3127, 0.3290),
    **dict.fromkeys((6, 7), (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, 0.3127, 0.3290)),
    9: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    11: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3140, 0.3510),
    12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
}
PQ, HLG = 16, 18  # transfers for displays of high dynamic range
WHITE = 203  # nits of diffuse white in both (ITU-R BT.2408)
HLG_PEAK, HLG_GAMMA = 1000, 1.2  # nits of BT.2100's reference display, and its gamma
HLG_WEIGHTS = np.array([0.2627, 0.6780, 0.0593], np.float32)  # of luminance, in BT.2020
ROWS = 256  # that are converted at a time
PROBE = np.stack(np.meshgrid(*[np.arange(0, 256, 15, dtype=np.uint8)] * 3), axis=-1).reshape(1, -1, 3)


def _pq(code: np.ndarray) -> np.ndarray:
    """The EOTF of SMPTE ST 2084."""
    root = code ** (32 / 2523)
    return (np.maximum(root - 3424 / 4096, 0) / (2413 / 128 - 2392 / 128 * root)) ** (8192 / 1305) * 10000 / WHITE


def _hlg(code: np.ndarray) -> np.ndarray:
    """The inverse OETF of BT.2100, so that luminance ** (HLG_GAMMA - 1) times it is light on the display."""
    scene = np.where(code <= 0.5, code**2 / 3, (np.exp((code - 0.55991073) / 0.17883277) + 0.28466892) / 12)
    return scene * (HLG_PEAK / WHITE) ** (1 / HLG_GAMMA)


TRANSFERS: dict[int, Curve] = {
    **dict.fromkeys((1, 6, 7, 11, 12, 13, 14, 15), decode),
    4: lambda code: code**2.2,
    5: lambda code: code**2.8,
    8: lambda code: code,
    PQ: _pq,
    HLG: _hlg,
}


def to_srgb(pixels: np.ndarray, image: Image.Image, what: str, coding: tuple[int, int] | None = None) -> Converted:
    """Converts the pixels of an image to sRGB. sRGB itself stays as it is, bit for bit.

    Args:
        pixels: (H,W,3) uint8 or uint16.
        image: whose metadata say what the pixels mean.
        what: its name in errors.
        coding: of `coding_of`.

    Returns:
        Pixels of the same type, and notes, one sentence each.

    Raises:
        UserError: if the profile of a 16-bit picture has no curves and primaries, or the picture is coded for displays
            of high dynamic range.
    """
    if coding is not None and not (coding[0] == UNSPECIFIED or coding[1] == UNSPECIFIED):
        return _by_coding(pixels, coding, what)
    if profile := image.info.get("icc_profile"):
        return _by_profile(pixels, profile, what)
    if image.format == "PNG" and "srgb" not in image.info and "gamma" in image.info:
        gamma = image.info["gamma"] or SRGB_GAMMA
        xy = image.info.get("chromaticity")  # white first
        primaries = REC709 if xy is None else (*xy[2:], *xy[:2])
        if abs(gamma - SRGB_GAMMA) < 0.01 and np.allclose(primaries, REC709, atol=0.003):
            return pixels, []
        curve = decode if abs(gamma - SRGB_GAMMA) < 0.01 else lambda code: code ** (1 / gamma)
        return _by_primaries(pixels, primaries, curve, f"by the gamma that the file gives, {gamma:g}")
    if _is_adobe(image):
        return _by_primaries(pixels, ADOBE, lambda code: code**ADOBE_GAMMA, "from its camera's Adobe RGB")
    return pixels, []


def _by_primaries(pixels: np.ndarray, primaries: Sequence[float], curve: Curve, how: str) -> Converted:
    matrix = chromaticity_matrix(primaries)  # None for those of no color space
    return _by_curves(pixels, [curve] * 3, np.eye(3) if matrix is None else matrix), [f"it was converted {how}"]


def _by_coding(pixels: np.ndarray, coding: tuple[int, int], what: str) -> Converted:
    """Converts by the codes of ITU-T H.273. Curves for broadcasting are shown as sRGB, as browsers do."""
    primaries, transfer = coding
    if transfer in (PQ, HLG):
        raise UserError(f"{what} is coded for displays of high dynamic range: save it as sRGB, or linear as OpenEXR")
    if primaries not in PRIMARIES or transfer not in TRANSFERS:
        raise UserError(f"{what} has colors of the kinds {primaries} and {transfer} of ITU-T H.273: convert it to sRGB")
    if primaries == 1 and TRANSFERS[transfer] is decode:
        return pixels, []
    return by_codes(pixels, primaries, transfer), ["it was converted by the color space that its file codes"]


def by_codes(pixels: np.ndarray, primaries: int, transfer: int) -> np.ndarray:
    """Converts pixels (H,W,3), uint8 or uint16, of a known coding of ITU-T H.273; more than white is cut."""
    matrix = chromaticity_matrix(PRIMARIES[primaries])
    assert matrix is not None
    return _by_curves(pixels, [TRANSFERS[transfer]] * 3, matrix, HLG_GAMMA if transfer == HLG else 1.0)


def _is_adobe(image: Image.Image) -> bool:
    """Returns whether EXIF data say Adobe RGB: 2, as some cameras write, or DCF 2.0's uncalibrated and mark R03."""
    try:
        exif = image.getexif()
        space = exif.get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.ColorSpace)
        mark = str(exif.get_ifd(ExifTags.IFD.Interop).get(ExifTags.Interop.InteropIndex, ""))
    except Exception:  # damaged EXIF data, over which Pillow raises a dozen types, say nothing
        return False
    return space == 2 or (space == 0xFFFF and mark.startswith("R03"))


def _by_profile(pixels: np.ndarray, profile: bytes, what: str) -> Converted:
    """Converts by an ICC profile; one that is not of RGB pictures is left out with a note, as browsers do."""
    try:
        source, target = ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
        transform = ImageCms.buildTransform(source, target, "RGB", "RGB")
    except (ImageCms.PyCMSError, OSError):
        return pixels, ["its color profile is damaged, or not one of RGB pictures: it was left out, as by browsers"]

    def convert(values: np.ndarray) -> np.ndarray:
        image = ImageCms.applyTransform(Image.fromarray(values), transform)
        assert image is not None  # as it is where the image is changed in place
        return np.asarray(image)

    if np.abs(convert(PROBE).astype(int) - PROBE).max() <= 1:  # sRGB, whatever it is called
        return pixels, []
    if pixels.dtype == np.uint8:
        return convert(pixels), []
    curves = [_curve(profile, tag) for tag in (b"rTRC", b"gTRC", b"bTRC")]
    to_xyz, srgb_to_xyz = _colorants(source.profile), _colorants(target)
    known = [curve for curve in curves if curve is not None]
    if to_xyz is None or srgb_to_xyz is None or _tag(profile, b"A2B0") or len(known) < 3:
        raise UserError(f"{what} has 16 bits and a color profile of tables: convert it to sRGB, or save it in 8 bits")
    return _by_curves(pixels, known, np.linalg.solve(srgb_to_xyz, to_xyz)), []


def _by_curves(pixels: np.ndarray, curves: Sequence[Curve], matrix: np.ndarray, gamma: float = 1.0) -> np.ndarray:
    """Converts by a curve for each channel, from codes in [0,1], a gamma of luminance, and a matrix to Rec. 709."""
    tables, coded = [_linear(curve, pixels.dtype) for curve in curves], _coded(pixels.dtype)
    out = np.empty_like(pixels)
    for row in range(0, len(pixels), ROWS):
        part = pixels[row : row + ROWS]
        linear = np.stack([table[part[..., channel]] for channel, table in enumerate(tables)], axis=-1)
        if gamma != 1:
            linear *= (linear @ HLG_WEIGHTS)[..., None] ** np.float32(gamma - 1)
        root = np.sqrt(np.clip(linear @ matrix.T.astype(np.float32), 0, 1))
        out[row : row + ROWS] = coded[np.round(root * 65535).astype(np.uint16)]
    return out


@lru_cache(8)
def _linear(curve: Curve, dtype: np.dtype) -> np.ndarray:
    """Returns the float32 value of each code."""
    return curve(np.linspace(0, 1, np.iinfo(dtype).max + 1)).astype(np.float32)


@lru_cache(2)
def _coded(dtype: np.dtype) -> np.ndarray:
    """Returns sRGB codes (65536,) by the square root of the linear value."""
    return np.round(encode(np.linspace(0, 1, 65536) ** 2) * np.iinfo(dtype).max).astype(dtype)


def _colorants(profile: ImageCms.core.CmsProfile) -> np.ndarray | None:
    """Returns the matrix (3,3) from a profile's linear RGB to XYZ of the connection space; None if it has none."""
    found = [getattr(profile, f"{name}_colorant") for name in ("red", "green", "blue")]
    return None if None in found else np.array([xyz for xyz, _ in found]).T


def _tag(profile: bytes, name: bytes) -> bytes | None:
    """Returns the data of a tag of an ICC profile (ICC.1:2022, section 7.3), or None."""
    (count,) = struct.unpack_from(">I", profile, 128)
    for place in range(132, min(132 + 12 * count, len(profile) - 11), 12):
        key, start, size = struct.unpack_from(">4sII", profile, place)
        if key == name:
            return profile[start : start + size]
    return None


def _curve(profile: bytes, name: bytes) -> Curve | None:
    """Returns the function of a curve of an ICC profile (ICC.1:2022, sections 10.6 and 10.18), or None."""
    data = _tag(profile, name) or b""
    if data[:4] == b"curv" and len(data) >= 12:
        (count,) = struct.unpack_from(">I", data, 8)
        if len(data) < 12 + 2 * count:
            return None
        values = np.frombuffer(data, ">u2", count, 12).astype(np.float64)
        if count > 1:
            return lambda code: np.interp(code, np.linspace(0, 1, count), values / 65535)
        return lambda code: code ** (values[0] / 256 if count else 1.0)
    if data[:4] == b"para" and len(data) >= 16:
        kind = struct.unpack_from(">H", data, 8)[0]
        sizes = (1, 3, 4, 5, 7)
        if kind >= len(sizes) or len(data) < 12 + 4 * sizes[kind]:
            return None
        given = np.frombuffer(data, ">i4", sizes[kind], 12) / 65536
        return lambda code: _parametric(kind, given, code)
    return None


def _parametric(kind: int, given: np.ndarray, code: np.ndarray) -> np.ndarray:
    """ICC.1:2022, section 10.18: (a x + b)^g + offset from x = start on, and slope x + constant below."""
    g, a, b, c, d, e, f = np.pad(given, (0, 7 - len(given))).tolist()
    a = a if kind else 1.0
    start = d if kind > 2 else -b / (a or 1.0)
    slope = c if kind > 2 else 0.0
    offset, constant = {2: (c, c), 4: (e, f)}.get(kind, (0.0, 0.0))
    return np.where(code >= start, np.maximum(a * code + b, 0) ** g + offset, slope * code + constant)
