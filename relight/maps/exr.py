"""Maps as OpenEXR files with named layers, which Blender, Nuke and tev open.

`albedo.R/G/B`, `normal.X/Y/Z`, `ao.Y`, `mask.A`, `coverage.A`, `transport.L0M0.Y`, `transport.L1Mn1.Y` ... half
floats, `depth.Z` a float, and with bounces `bounced.L0M0.R/G/B` ... "n" stands for a minus sign. A name ends in one
letter because Blender drops channels whose last part is longer; letters and digits only because Nuke wants those.
"""

import json
from pathlib import Path

import numpy as np
import OpenEXR

from relight import __version__
from relight.files import UserError, existing, whole
from relight.maps.maps import Maps
from relight.sh.basis import order_of

FRAME = "right-handed, +x image right, +y up, +z toward the camera"
CONVENTION = "real orthonormal spherical harmonics, no Condon-Shortley phase, index l*l+l+m; transport without 1/pi"
LARGEST_SIZE, LARGEST_ORDER = 8192, 30  # of maps that are read: 3 GB at order 2


class LeftOut(Exception):
    """The file stands for a figure that was left out of the data set; the message is the reason."""


def coefficient_names(order: int) -> list[str]:
    """L0M0, L1Mn1, L1M0, L1M1, L2Mn2 ... in the order of the coefficients."""
    return [f"L{l}M{'n' if m < 0 else ''}{abs(m)}" for l in range(order + 1) for m in range(-l, l + 1)]


def write_maps(path: Path | str, maps: Maps) -> None:
    """Writes `maps` whole or not at all. Half floats hold transport to 2^-11 of its value, depth is kept in full."""
    layers = {f"albedo.{c}": maps.albedo[..., i] for i, c in enumerate("RGB")}
    layers |= {f"normal.{c}": maps.normal[..., i] for i, c in enumerate("XYZ")}
    layers |= {"ao.Y": maps.ao, "mask.A": maps.mask, "coverage.A": maps.coverage}
    names = coefficient_names(order_of(maps.transport.shape[2]))
    layers |= {f"transport.{name}.Y": maps.transport[..., i] for i, name in enumerate(names)}
    if maps.bounced is not None:
        layers |= {
            f"bounced.{name}.{c}": maps.bounced[..., i, j] for i, name in enumerate(names) for j, c in enumerate("RGB")
        }
    channels = {name: np.ascontiguousarray(layer, np.float16) for name, layer in layers.items()}
    channels["depth.Z"] = np.ascontiguousarray(maps.depth, np.float32)
    _write(path, channels, {**maps.info, "pixels": int(maps.mask.sum())})


def write_left_out(path: Path | str, info: dict, reason: str) -> None:
    """Writes a 1 x 1 file whose header says why the figure has no maps, so that a data set can go on without it."""
    _write(path, {"mask.A": np.zeros((1, 1), np.float16)}, {**info, "left_out": reason})


def read_info(path: Path | str) -> dict:
    """What the header says about the figure (`Maps.info`, and `pixels`, the size of the mask), without the pixels."""
    return _read(path, header_only=True)[0]


def read_maps(path: Path | str) -> Maps:
    """Reads what `write_maps` wrote. Raises LeftOut for a figure that was left out, UserError on any other file."""
    info, channels = _read(path)
    if "left_out" in info:
        raise LeftOut(info["left_out"])

    def layer(*names: str) -> np.ndarray:
        missing = [name for name in names if name not in channels]
        if missing:
            raise UserError(f"{path} is not a whole file of maps: it lacks {', '.join(missing)}")
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
        info=info,
    )


def _write(path: Path | str, channels: dict[str, np.ndarray], info: dict) -> None:
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "relight": json.dumps(info),
        "software": f"relight {__version__}",
        "frame": FRAME,
        "convention": CONVENTION,
    }
    with whole(path) as temporary:
        OpenEXR.File(header, channels).write(str(temporary))


def _read(path: Path | str, header_only: bool = False) -> tuple[dict, dict[str, OpenEXR.Channel]]:
    """The figure's record and the channels (empty when only the header is asked for)."""
    path = existing(path, "maps")

    try:
        header = OpenEXR.File(str(path), separate_channels=True, header_only=True).header()
    except Exception as error:  # the library raises RuntimeError, ValueError and worse on broken files
        raise UserError(f"{path} is not a readable OpenEXR file ({error})") from None
    try:
        info = json.loads(header["relight"])
        low, high = header["dataWindow"]
        side = 1 if "left_out" in info else info["size"]
        sound = "left_out" in info or (type(info["order"]) is int and 0 <= info["order"] <= LARGEST_ORDER)
        if not (sound and 1 <= side <= LARGEST_SIZE and (high - low + 1 == side).all()):
            raise ValueError
    except (KeyError, ValueError, TypeError, RecursionError):
        raise UserError(
            f"{path} holds no maps of relight: its header lacks the 'relight' record, or contradicts it"
        ) from None
    if header_only:
        return info, {}
    try:
        return info, OpenEXR.File(str(path), separate_channels=True).channels()
    except Exception:  # it prints why, and goes on without the pixels until they are asked for
        raise UserError(f"{path} is damaged: OpenEXR cannot read all of its pixels; make it again") from None
