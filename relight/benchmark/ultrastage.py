"""UltraStage (Zhou et al., CVPR 2023): people under all lamps of a stage and under two gradients, as published.

    CAPTURE/full_on/00000.jpg ... 00031.jpg     all lamps, one file for each camera, sRGB
    CAPTURE/pos/, CAPTURE/neg/                  the gradients
    CAPTURE/mask/
    CAPTURE/normal_alpha/                       normals of the world as (n + 1) / 2, with the mask as alpha
    CAPTURE/transforms.json                     of each camera: to the world, with OpenGL's axes, as for NeRF

The gradients' lamps have the radiance (1 + g.w) / 2 and (1 - g.w) / 2 of all lamps in direction w, where g is an axis
of the world for each colour channel. Which axis is not written anywhere: the pictures and the normals tell.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight.files import UserError, existing_file
from relight.photos.crop import MASK_THRESHOLD
from relight.photos.read import SUFFIXES, read_mask, read_photo
from relight.srgb import LINEAR

PARTS = ("full_on", "pos", "neg", "mask", "normal_alpha")
SNAP = 20.0  # degrees within which a gradient is along an axis
EXPLAINED = 0.5  # least share of the gradients' variance that normals explain


@dataclass(frozen=True)
class Capture:
    """One camera's pictures of one capture.

    Attributes:
        name: the capture's folder and the camera's number.
        figure: the capture's folder.
        files: by PARTS.
        rotation: (3,3) from the world's axes to the camera's.
    """

    name: str
    figure: str
    files: dict[str, Path]
    rotation: np.ndarray


@dataclass(frozen=True)
class Pictures:
    """What the files of a capture hold.

    Attributes:
        full_on, positive, negative: (H,W,3) uint8 sRGB.
        mask: (H,W) uint8.
        normal: (H,W,3) unit, in the world's axes; zero outside of the mask.
        gradients: (3,3), for each colour channel the unit vector g of the world along which its light grows.
        level: (3,), of each channel, how bright both gradients together are, over all lamps.
        fit: share of the variance of (pos - neg) / (pos + neg) that the normals explain.
    """

    full_on: np.ndarray
    positive: np.ndarray
    negative: np.ndarray
    mask: np.ndarray
    normal: np.ndarray
    gradients: np.ndarray
    level: np.ndarray
    fit: float


def captures(folder: Path | str, only: str = "") -> Iterator[Capture]:
    """Yields the cameras of all captures in a folder, by name.

    Args:
        folder: with a folder for each capture, unpacked.
        only: a regular expression that the names match anywhere; all by default.

    Raises:
        UserError: if there is none, or files of one are missing or broken.
    """
    try:
        wanted = re.compile(only)
    except re.error as error:
        raise UserError(f"{only!r} is no regular expression ({error}); it is for the names of captures") from None
    found = False
    for place in sorted(path.parent for path in Path(folder).glob("*/full_on")):
        turns: dict[int, np.ndarray] = {}
        for path in sorted((place / "full_on").iterdir()):
            name = f"{place.name}.{path.stem}"
            if path.suffix.lower() not in SUFFIXES or not path.stem.isdigit() or not wanted.search(name):
                continue
            found = True
            turns = turns or read_rotations(place / "transforms.json")
            if int(path.stem) not in turns:
                raise UserError(f"{place / 'transforms.json'} has no camera {path.stem}")
            yield Capture(name, place.name, {part: matching_file(path, part) for part in PARTS}, turns[int(path.stem)])
    if not found:
        raise UserError(f"{folder} holds no CAPTURE/full_on/00000.jpg{f' whose name matches {only}' if only else ''}")


def matching_file(path: Path, part: str) -> Path:
    """Finds the file of another part of a capture that has the number of `path`.

    Args:
        path: a file of one part, CAPTURE/PART/NUMBER.SUFFIX.
        part: folder of the other part, such as masks.

    Returns:
        CAPTURE/part/NUMBER with the same suffix, or with another one of SUFFIXES.

    Raises:
        UserError: if there is none.
    """
    folder = path.parent.parent / part
    for suffix in (path.suffix, *SUFFIXES):
        if (folder / f"{path.stem}{suffix}").is_file():
            return folder / f"{path.stem}{suffix}"
    return existing_file(folder / path.name, part)


def read_rotations(path: Path) -> dict[int, np.ndarray]:
    """Reads the rotations (3,3) from the world's axes to each camera's, by its number. Raises UserError."""
    try:
        content = json.loads(existing_file(path, "cameras").read_text(encoding="utf-8"))
        found = {}
        for frame in content["frames"]:
            turn = np.array(frame["transform_matrix"], np.float64)[:3, :3]
            number = re.search(r"(\d+)(\.\w+)?$", frame["file_path"])
            turn = turn / np.linalg.norm(turn, axis=0)  # some have a scale
            if np.abs(turn.T @ turn - np.eye(3)).max() > 1e-3 or not number:
                raise ValueError
            found[int(number[1])] = turn.T
    except (ValueError, KeyError, TypeError, IndexError):
        raise UserError(f"{path}: `frames` with `file_path` and a rigid `transform_matrix` each are expected") from None
    return found


def read(capture: Capture) -> Pictures:
    """Reads a capture's pictures and finds its gradients.

    For a matt surface that nothing occludes, (pos - neg) / (pos + neg) is 2/3 g.n in each channel: g is its regression
    on the normals, made a unit vector, and an axis where it is nearly one, since occlusion turns it.

    Raises:
        UserError: if sizes differ, or the normals do not explain the gradients.
    """
    full_on, positive, negative, coded = (
        read_photo(capture.files[part], part).pixels for part in ("full_on", "pos", "neg", "normal_alpha")
    )
    for part, pixels in (("pos", positive), ("neg", negative), ("normal_alpha", coded)):
        if pixels.shape != full_on.shape:
            (h, w), (height, width) = pixels.shape[:2], full_on.shape[:2]
            raise UserError(f"{capture.files[part]} is {w}x{h} pixels and the picture under all lamps {width}x{height}")
    mask = read_mask(capture.files["mask"], full_on.shape[:2])
    inside = mask >= MASK_THRESHOLD
    normal = coded / 127.5 - 1
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(inside[..., None] & (length > 0.5), normal / np.maximum(length, 0.5), 0)
    told = inside & normal.any(-1)
    up, down, full = (LINEAR[pixels[told]].astype(np.float64) for pixels in (positive, negative, full_on))
    both, directions = up + down, normal[told]
    usable = (both > 0.02).all(1)
    if usable.sum() < 100:
        raise UserError(f"{capture.name}: fewer than 100 pixels have a normal and are lit by the gradients")
    ratio = ((up - down) / np.maximum(both, 1e-6))[usable]
    slope, *_ = np.linalg.lstsq(directions[usable], ratio, rcond=None)
    fit = float(((directions[usable] @ slope) ** 2).sum() / max((ratio**2).sum(), 1e-12))
    if fit < EXPLAINED:
        raise UserError(
            f"{capture.name}: its normals explain {fit:.0%} of the difference between pos and neg; gradients "
            "along the axes of the normals are expected"
        )
    gradients = (slope / np.linalg.norm(slope, axis=0)).T
    axes = np.eye(3)[np.abs(gradients).argmax(1)] * np.sign(gradients)
    near = (axes * gradients).sum(1) > np.cos(np.radians(SNAP))
    gradients = np.where(near[:, None], axes, gradients)
    level = (both * full).sum(0) / np.maximum((full**2).sum(0), 1e-12)
    return Pictures(full_on, positive, negative, mask, normal, gradients, level, fit)
