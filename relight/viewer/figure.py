"""One figure of a viewer page: its maps as bytes, and what they lose on the way."""

import base64
import json
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.srgb import LINEAR
from relight.core.srgb import encode as encode_srgb
from relight.maps import Maps
from relight.maps.octahedral import octahedral
from relight.maps.square import extent, fill_outside
from relight.photos.backdrop import resized
from relight.photos.render import estimate_foreground
from relight.photos.shading import shade, shading_floor
from relight.photos.tone import CLIPPING, chroma, clipping_excess
from relight.sh import UNOCCLUDED_T00, coefficient_count
from relight.viewer.codec import deflate, encode

ALBEDO_STEPS = 510  # per unit of sRGB-coded albedo: a quarter of an 8-bit code is lost at most
NORMAL_STEPS = 511  # per unit of the octahedral map: .2 degrees
EDGE_STEPS = 4095  # per unit of sRGB-coded half linear values: a soft edge is a small difference of two colors
EXCESS_STEPS = 255  # per unit of the share by which light was above a clipped channel
LARGEST = 1.9  # of transport, which is below 1.1: the codes hold no more of a network that has not learned
MARGIN = 2  # pixels around the figure, room for the browser to carry colors past the edge before it filters
# Steps per unit of transport; the first that fits is taken. The finest keeps even a dark pixel at +1.5 stops within 1.2
# codes (4096: 2.7, 2048: 3.5), for .14 MB a halving at 1024 px.
QUALITIES = (8192, 4096, 2048, 1024)
FAR = 1.3  # over the limit: what is that large does not fit in any of them


@dataclass
class Figure:
    """What a page shows of one figure.

    Attributes:
        title: the name that the page shows.
        maps: (H,W,...), transport of order 2 or more. Bands above order 2 and bounced transport are left out. Normals
            that are all zero, as networks leave them, are not shown.
        photo: (H,W,3) sRGB in [0,1], or None.
        photo_light: (9,3) radiance coefficients of the light of the photo, by which the mode `ratio` divides, or None.
        source: where the maps are from (the truth, a network). Figures of one title that differ in it are one in the
            page's list, with a second list of their sources.
        notes: for the user, one sentence each; the page does not show them.
    """

    title: str
    maps: Maps = field(repr=False)
    photo: np.ndarray | None = field(default=None, repr=False)
    photo_light: np.ndarray | None = field(default=None, repr=False)
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.maps.mask.any():
            raise UserError(f"figure '{self.title}': its mask is empty; a mask with the figure in it would be right")
        if self.maps.transport.shape[-1] < coefficient_count(2):
            raise UserError(
                f"figure '{self.title}': transport has {self.maps.transport.shape[-1]} coefficients; order 2 has 9"
            )


def differences(codes: np.ndarray) -> np.ndarray:
    """Returns green, red - green and blue - green (...,3) of codes (...,3), so that grey detail is coded once."""
    red, green, blue = np.moveaxis(codes.astype(np.int32), -1, 0)
    return np.stack([green, red - green, blue - green], -1)


def pack(figure: Figure, transport_steps: int) -> tuple[dict[str, Any], bytes]:
    """Codes a figure as bytes, which `page/figure.js` decodes.

    Where a soft mask covers more than the maps, these are carried outward (relight.maps.square.fill_outside).

    Args:
        figure: the figure.
        transport_steps: per unit of transport; the error is half a step.

    Returns:
        The header, JSON values: sizes, the box of the figure (left, top, width, height), bytes of the coded region, and
        `planes`, the name, bytes, steps per unit and predictors of each map. And the bytes: the streams of `codec`.
    """
    maps = figure.maps
    height, width = maps.mask.shape
    coverage = np.rint(np.clip(maps.coverage, 0, 1) * 255).astype(np.uint8)
    rows, columns = (slice(max(first - MARGIN, 0), last + MARGIN) for first, last in extent(maps.mask | (coverage > 0)))
    mask, alpha = maps.mask[rows, columns], coverage[rows, columns]
    region = mask | (alpha > 0)
    streams: list[bytes] = [deflate(np.packbits(region).tobytes())]
    header: dict[str, Any] = {"title": figure.title, "width": width, "height": height}
    header["box"] = [columns.start, rows.start, region.shape[1], region.shape[0]]
    header |= {"region": len(streams[0]), "planes": []}
    header["mean"] = maps.transport[maps.mask][:, : coefficient_count(2)].mean(0, dtype=np.float64).round(6).tolist()
    if figure.photo is not None and figure.photo_light is not None:
        light = np.asarray(figure.photo_light, np.float64)
        header["light"] = light.round(6).tolist()
        header["floor"] = shading_floor(shade(maps.transport, light), maps.mask)

    def add(name: str, integers: np.ndarray, steps: int, where: np.ndarray) -> None:
        """Appends the planes (h,w,C) of a map of the box at the pixels `where` (h,w): integers of `steps` per unit."""
        stream, predictors = encode(integers, where)
        streams.append(stream)
        header["planes"].append({"name": name, "bytes": len(stream), "steps": steps, "predictors": predictors})

    def cut(values: np.ndarray) -> np.ndarray:
        """Returns a map (H,W,...) on the box, float32, carried outward past the mask."""
        return fill_outside(np.nan_to_num(np.asarray(values, np.float32)[rows, columns]), mask)

    transport, ao = cut(maps.transport[..., : coefficient_count(2)]).clip(-LARGEST, LARGEST), cut(maps.ao)
    add("transport", np.rint(transport * transport_steps), transport_steps, region)
    add("albedo", np.rint(encode_srgb(cut(maps.albedo)) * ALBEDO_STEPS), ALBEDO_STEPS, region)
    if maps.normal.any():
        add("normal", np.rint(octahedral(cut(maps.normal)) * NORMAL_STEPS), NORMAL_STEPS, region)
    ao_of_transport = np.clip(transport[..., 0] / UNOCCLUDED_T00, 0, 1)  # which the page takes if there is no other
    if np.abs(ao - ao_of_transport)[region].max() > 0.5 / 255:
        add("ao", np.rint(ao * 255)[..., None], steps=255, where=region)
    if (alpha != 255 * region).any():
        add("coverage", alpha[..., None], steps=255, where=np.ones_like(region))
    if figure.photo is not None:
        codes = np.rint(np.clip(figure.photo, 0, 1) * 255).astype(np.uint8)
        soft = (alpha > 0) & (alpha < 255)
        front = linear = LINEAR[codes]
        if soft.any():
            front = estimate_foreground(linear, coverage.astype(np.float32) / 255)
            add("edge", differences(np.rint(encode_srgb(front[rows, columns] / 2) * EDGE_STEPS)), EDGE_STEPS, soft)
        if (front[coverage > 0] > CLIPPING).any():
            above = clipping_excess(front[rows, columns], chroma(linear, maps.mask)[rows, columns])
            add("excess", np.rint(above * EXCESS_STEPS), EXCESS_STEPS, region)
        add("photo", differences(codes), steps=255, where=np.ones_like(maps.mask))
    return header, b"".join(streams)


def embed(figure: Figure, limit: int) -> str:
    """Returns a figure as JSON, its bytes as base64, in at most `limit` bytes.

    It is coded in the finest of QUALITIES that fits, or else made smaller.
    """
    for quality in QUALITIES:
        text = _json(figure, quality)
        if len(text) <= limit:
            return text
        if len(text) > FAR * limit:
            break
    while len(text) > limit:
        figure = smaller(figure, np.sqrt(0.95 * limit / len(text)))
        text = _json(figure, QUALITIES[-1])
    return text


def _json(figure: Figure, quality: int) -> str:
    header, data = pack(figure, quality)
    text = json.dumps(header | {"data": base64.b64encode(data).decode()}, separators=(",", ":"))
    return text.replace("<", "\\u003c")  # a title must not close the script element


def smaller(figure: Figure, scale: float) -> Figure:
    """Returns a figure on fewer pixels, `scale` times as many a side: means of what the mask shows."""
    maps, (height, width) = figure.maps, figure.maps.mask.shape
    size = max(round(height * scale), 1), max(round(width * scale), 1)

    def mean(values: np.ndarray) -> np.ndarray:
        planes = values.reshape(*maps.mask.shape, -1)
        return resized(planes, size, method=Image.Resampling.BOX).reshape(*size, *values.shape[2:])

    shown = mean(maps.mask)
    means: dict[str, Any] = {
        name: (mean(getattr(maps, name)).T / np.maximum(shown.T, 1e-6)).T
        for name in ("albedo", "normal", "depth", "ao", "transport")
    }
    photo = None if figure.photo is None else mean(figure.photo)
    return replace(figure, photo=photo, maps=replace(maps, mask=shown >= 0.5, coverage=mean(maps.coverage), **means))
