"""Reads UltraStage (Zhou et al., CVPR 2023): people in a light stage under all lamps and under two gradients.

    CAPTURE/full_on/00000.jpg ... 00031.jpg     all lamps, one file per camera, sRGB
    CAPTURE/pos/, CAPTURE/neg/                  the gradients
    CAPTURE/mask/
    CAPTURE/normal_alpha/                       world normals as (n + 1) / 2, with the mask as alpha
    CAPTURE/transforms.json                     camera to world, OpenGL's axes, as for NeRF

In the gradients, the lamp in direction w has (1 + g.w) / 2 and (1 - g.w) / 2 of its radiance under all lamps. For each
colour channel, g is an axis of the world. The axes are not documented, so they are found from pictures and normals.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight.benchmark.files import capture_pattern
from relight.files import UserError, existing_file
from relight.photos.crop import MASK_THRESHOLD
from relight.photos.read import SUFFIXES, read_mask, read_photo
from relight.srgb import LINEAR

PARTS = ("full_on", "pos", "neg", "mask", "normal_alpha")
SNAP_DEGREES = 20.0  # largest angle at which a gradient is rounded to an axis
MIN_FIT = 0.5  # share of the gradients' variance that normals must explain


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
    """The contents of a capture's files, and the gradients found from them.

    Attributes:
        full_on, positive, negative: (H,W,3) uint8 sRGB.
        mask: (H,W) uint8.
        normal: (H,W,3) unit, in the world's axes; zero outside the mask.
        gradients: (3,3), the unit vector g in the world of each colour channel.
        level: (3,), the sum of both gradients over all lamps, by channel.
        fit: fraction of the variance of (pos - neg) / (pos + neg) that the normals explain.
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
    """Yields the captures of all cameras in a folder, in the order of their names.

    Args:
        folder: contains an unpacked folder for each capture.
        only: a regular expression that names must match anywhere; by default all do.

    Raises:
        UserError: if there are none, or files of one are missing or broken.
    """
    wanted = capture_pattern(only)
    found = False
    for capture_folder in sorted(path.parent for path in Path(folder).glob("*/full_on")):
        rotations: dict[int, np.ndarray] = {}
        for path in sorted((capture_folder / "full_on").iterdir()):
            name = f"{capture_folder.name}.{path.stem}"
            if path.suffix.lower() not in SUFFIXES or not path.stem.isdigit() or not wanted.search(name):
                continue
            found = True
            rotations = rotations or read_rotations(capture_folder / "transforms.json")
            if int(path.stem) not in rotations:
                raise UserError(f"{capture_folder / 'transforms.json'} has no camera {path.stem}")
            files = {part: matching_file(path, part) for part in PARTS}
            yield Capture(name, capture_folder.name, files, rotations[int(path.stem)])
    if not found:
        raise UserError(f"{folder} holds no CAPTURE/full_on/00000.jpg{f' whose name matches {only}' if only else ''}")


def matching_file(path: Path, part: str) -> Path:
    """Returns the file of another part of a capture with the number of `path`.

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
    """Reads the rotations (3,3) from the world's axes to those of each camera, by camera number. Raises UserError."""
    try:
        content = json.loads(existing_file(path, "cameras").read_text(encoding="utf-8"))
        found = {}
        for frame in content["frames"]:
            rotation = np.array(frame["transform_matrix"], np.float64)[:3, :3]
            number = re.search(r"(\d+)(\.\w+)?$", frame["file_path"])
            rotation = rotation / np.linalg.norm(rotation, axis=0)  # some have a scale
            if np.abs(rotation.T @ rotation - np.eye(3)).max() > 1e-3 or not number:
                raise ValueError
            found[int(number[1])] = rotation.T
    except (ValueError, KeyError, TypeError, IndexError):
        raise UserError(f"{path}: `frames` with `file_path` and a rigid `transform_matrix` each are expected") from None
    return found


def read(capture: Capture) -> Pictures:
    """Reads a capture's pictures and finds its gradients.

    For an unoccluded diffuse surface, (pos - neg) / (pos + neg) is 2/3 g.n in each channel. So g is its regression on
    the normals, scaled to unit length.

    Raises:
        UserError: if sizes differ, or the normals do not explain the gradients.
    """
    full_on, positive, negative, encoded_normal = (
        read_photo(capture.files[part], part).codes for part in ("full_on", "pos", "neg", "normal_alpha")
    )
    for part, pixels in (("pos", positive), ("neg", negative), ("normal_alpha", encoded_normal)):
        if pixels.shape != full_on.shape:
            (h, w), (height, width) = pixels.shape[:2], full_on.shape[:2]
            raise UserError(f"{capture.files[part]} is {w}x{h} pixels and the picture under all lamps {width}x{height}")
    mask = read_mask(capture.files["mask"], full_on.shape[:2])
    inside = mask >= MASK_THRESHOLD
    normal = encoded_normal / 127.5 - 1
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(inside[..., None] & (length > 0.5), normal / np.maximum(length, 0.5), 0)
    valid = inside & normal.any(-1)
    plus, minus, full = (LINEAR[pixels[valid]].astype(np.float64) for pixels in (positive, negative, full_on))
    total, directions = plus + minus, normal[valid]
    usable = (total > 0.02).all(1)
    if usable.sum() < 100:
        raise UserError(f"{capture.name}: fewer than 100 pixels have a normal and are lit by the gradients")
    ratio = ((plus - minus) / np.maximum(total, 1e-6))[usable]
    slope, *_ = np.linalg.lstsq(directions[usable], ratio, rcond=None)
    fit = float(((directions[usable] @ slope) ** 2).sum() / max((ratio**2).sum(), 1e-12))
    if fit < MIN_FIT:
        raise UserError(
            f"{capture.name}: its normals explain {fit:.0%} of the difference between pos and neg; {MIN_FIT:.0%} are "
            "expected if the gradients are along the axes of the normals"
        )
    gradients = round_to_axes((slope / np.linalg.norm(slope, axis=0)).T)
    level = (total * full).sum(0) / np.maximum((full**2).sum(0), 1e-12)
    return Pictures(full_on, positive, negative, mask, normal, gradients, level, fit)


def round_to_axes(gradients: np.ndarray) -> np.ndarray:
    """Returns gradients (3,3), each rounded to an axis of the world if that is within SNAP_DEGREES.

    Occlusion rotates the regressed gradients, and the true ones are axes.
    """
    axes = np.eye(3)[np.abs(gradients).argmax(1)] * np.sign(gradients)
    near = (axes * gradients).sum(1) > np.cos(np.radians(SNAP_DEGREES))
    return np.where(near[:, None], axes, gradients)
