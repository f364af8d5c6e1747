"""Maps of one view of a figure, and their OpenEXR files, whose layers Blender, Nuke and tev can show.

Channels are half floats except `depth.Z`, a float: `albedo.R/G/B`, `normal.X/Y/Z`, `ao.Y`, `mask.A`, `coverage.A`,
`transport.L0M0.Y`, `transport.L1Mn1.Y`, ...; for glossy surfaces `roughness.Y` and `specular.Y`; with bounces
`bounced.L0M0.R/G/B`, ... "n" stands for a minus sign. Names end in one letter, since Blender drops channels with a
longer last part, and consist of letters and digits because of Nuke.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from relight.core.errors import UserError
from relight.core.files import atomic_write, existing_file
from relight.core.version import __version__
from relight.sh import order_of

FRAME = "right-handed, +x image right, +y up, +z toward the camera"
CONVENTION = "real orthonormal spherical harmonics, no Condon-Shortley phase, index l*l+l+m; transport without 1/pi"
MAX_SIZE = 8192  # pixels; such maps have 3 GB at order 2
MAX_ORDER = 30


@dataclass
class Maps:
    """Maps of one view of a figure: square images of S px, row 0 at the top, zero outside the mask.

    The image under a light is albedo * ((transport[..., None] + bounced) . light, summed over K).

    Attributes:
        mask: (S,S) bool, whether the centre of a pixel shows the figure.
        coverage: (S,S) float32 in [0,1], the share of a pixel that the figure covers; without supersampling, the mask.
        albedo: (S,S,3) float32, linear.
        normal: (S,S,3) float32 unit shading normals in the camera frame (+x right, +y up, +z toward the camera).
        depth: (S,S) float32 distance from the camera plane along -z, in scene units.
        ao: (S,S) float32 in [0,1], ambient occlusion T_00 / .8862.
        transport: (S,S,K) float32, direct, without 1/pi, index l*l + l + m.
        bounced: (S,S,K,3) float32 bounced transport of each color channel; None if the maps were baked without
            bounces.
        gloss: (S,S,2) float32 in [0,1], roughness and specular (`relight.meshes.Material`); None if all is matt.
        info: plain JSON values (name, subject, rays, order, ...) of the file's header (docs/transport.md).
    """

    mask: np.ndarray
    coverage: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    depth: np.ndarray
    ao: np.ndarray
    transport: np.ndarray
    bounced: np.ndarray | None = None
    gloss: np.ndarray | None = None
    info: dict[str, Any] = field(default_factory=dict)


class LeftOut(Exception):
    """Raised on reading the file of a left-out figure; the message is the reason."""


def coefficient_names(order: int) -> list[str]:
    """Returns the names of the coefficients in their order; "n" stands for a minus sign.

    >>> coefficient_names(1)
    ['L0M0', 'L1Mn1', 'L1M0', 'L1M1']
    """
    return [f"L{l}M{'n' if m < 0 else ''}{abs(m)}" for l in range(order + 1) for m in range(-l, l + 1)]


def write_maps(path: Path | str, maps: Maps) -> None:
    """Writes maps as an OpenEXR file, whole or not at all.

    Depth is stored as float32; the other maps as half floats, with a relative error of at most 2^-11.

    Args:
        path: path of the file (.exr).
        maps: to be written; size, order, number of pixels in the mask and gloss are added to its `info`.
    """
    layers = {f"albedo.{c}": maps.albedo[..., i] for i, c in enumerate("RGB")}
    layers |= {f"normal.{c}": maps.normal[..., i] for i, c in enumerate("XYZ")}
    layers |= {"ao.Y": maps.ao, "mask.A": maps.mask, "coverage.A": maps.coverage}
    names = coefficient_names(order_of(maps.transport.shape[2]))
    layers |= {f"transport.{name}.Y": maps.transport[..., i] for i, name in enumerate(names)}
    if maps.bounced is not None:
        layers |= {
            f"bounced.{name}.{c}": maps.bounced[..., i, j] for i, name in enumerate(names) for j, c in enumerate("RGB")
        }
    if maps.gloss is not None:
        layers |= {"roughness.Y": maps.gloss[..., 0], "specular.Y": maps.gloss[..., 1]}
    channels = {name: np.ascontiguousarray(layer, np.float16) for name, layer in layers.items()}
    channels["depth.Z"] = np.ascontiguousarray(maps.depth, np.float32)
    derived: dict[str, Any] = {} if maps.gloss is None else {"gloss": True}
    derived |= {"size": len(maps.mask), "order": order_of(maps.transport.shape[2]), "pixels": int(maps.mask.sum())}
    write_exr(path, channels, {"relight": json.dumps({**maps.info, **derived})})


def write_left_out(path: Path | str, info: dict[str, Any], reason: str) -> None:
    """Writes a file of 1 x 1 px in place of the maps of a left-out figure.

    Args:
        path: path of the file.
        info: as `Maps.info`.
        reason: why the figure has no maps.
    """
    write_exr(path, {"mask.A": np.zeros((1, 1), np.float16)}, {"relight": json.dumps({**info, "left_out": reason})})


def read_info(path: Path | str) -> dict[str, Any]:
    """Reads the header only: `Maps.info` and `pixels`, the number of pixels in the mask.

    Raises:
        UserError: if the file does not exist or is not a file of maps.
    """
    return _read(path, header_only=True)[0]


def read_maps(path: Path | str) -> Maps:
    """Reads maps.

    Raises:
        LeftOut: if the figure was left out of the data set.
        UserError: if the file does not exist, is damaged or is not a file of maps.
    """
    info, channels = _read(path)
    if "left_out" in info:
        raise LeftOut(info["left_out"])

    def layer(*names: str) -> np.ndarray:
        """Returns the channels of these names as (H,W,C) float32, one channel as (H,W); UserError if one is missing."""
        if missing := [name for name in names if name not in channels]:
            raise UserError(f"{path} is not a complete file of maps: it lacks {', '.join(missing)}")
        stack = [channels[name].pixels for name in names]
        return np.stack(stack, -1).astype(np.float32) if len(stack) > 1 else stack[0].astype(np.float32)

    names = coefficient_names(info["order"])
    transport = layer(*(f"transport.{name}.Y" for name in names))
    bounced = None
    if any(name.startswith("bounced.") for name in channels):
        bounced = np.stack([layer(*(f"bounced.{name}.{c}" for c in "RGB")) for name in names], 2)
    return Maps(
        mask=layer("mask.A") > 0.5,
        coverage=layer("coverage.A"),
        albedo=layer("albedo.R", "albedo.G", "albedo.B"),
        normal=layer("normal.X", "normal.Y", "normal.Z"),
        depth=layer("depth.Z"),
        ao=layer("ao.Y"),
        transport=transport.reshape(*transport.shape[:2], -1),
        bounced=bounced,
        gloss=layer("roughness.Y", "specular.Y") if "specular.Y" in channels else None,
        info=info,
    )


def write_exr(path: Path | str, channels: dict[str, np.ndarray], header: dict[str, Any]) -> None:
    """Writes an OpenEXR file of maps, whole or not at all.

    Args:
        path: path of the file (.exr).
        channels: (H,W) by name, float16 or float32.
        header: attributes beside those that state relight's version and conventions.
    """
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    conventions = {"software": f"relight {__version__}", "frame": FRAME, "convention": CONVENTION}
    with atomic_write(path) as temporary:
        OpenEXR.File({**kind, **conventions, **header}, channels).write(str(temporary))


def _read(path: Path | str, header_only: bool = False) -> tuple[dict[str, Any], dict[str, OpenEXR.Channel]]:
    """Reads and checks an OpenEXR file of maps.

    Returns `Maps.info` from the header, and the channels by name; with `header_only` none, since pixels take most of
    the time. Raises UserError if the file does not exist, is damaged or is not a file of maps.
    """
    path = existing_file(path, "maps")
    try:
        header = OpenEXR.File(str(path), separate_channels=True, header_only=True).header()
    except Exception as error:  # the binding raises many types on damaged files
        raise UserError(f"{path} is not a readable OpenEXR file ({error})") from None
    try:
        info = json.loads(header["relight"])
        side, order = (1, 0) if "left_out" in info else (info["size"], info["order"])  # one pixel is written for these
        if not (type(side) is type(order) is int and 1 <= side <= MAX_SIZE and 0 <= order <= MAX_ORDER):
            raise ValueError
    except (KeyError, ValueError, TypeError, RecursionError):
        if "relight" not in header and str(header.get("software")).startswith("relight "):
            raise UserError(f"{path} was inferred from a photo: give `relight view` the photo itself") from None
        raise UserError(f"{path} is not a file of maps of relight: its header lacks a valid 'relight' record") from None
    (low, high), (start, end) = header["dataWindow"], header["displayWindow"]
    (left, top), (width, height), (across, down) = low - start, high - low + 1, end - start + 1
    if (left, top, width, height) != (0, 0, across, side) or height != down or width > MAX_SIZE:
        raise UserError(
            f"{path} was cropped, moved or scaled by another program: its pixels are {width} x {height} at "
            f"({left}, {top}) of a picture of {across} x {down}, but its maps fill one that is {side} high"
        )
    if header_only:
        return info, {}
    try:
        return info, OpenEXR.File(str(path), separate_channels=True).channels()
    except Exception:  # damaged pixels only fail when channels are accessed; OpenEXR prints the reason
        raise UserError(f"{path} is damaged: OpenEXR cannot read all of its pixels; bake the maps again") from None
