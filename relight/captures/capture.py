"""Reads captures of a light stage, one light at a time. Each capture is a folder:

    PERSON.VIEW/capture.json    the camera, and each frame with the position of its lamp
    PERSON.VIEW/mask.png        the person's mask
    PERSON.VIEW/mesh.obj        the person's mesh, if there is one
    PERSON.VIEW/frames/000.png  one picture for each lamp, 8-bit sRGB, undistorted

docs/scans.md describes them in full.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from relight.captures.camera import Pinhole
from relight.captures.lightstage import LightStage
from relight.errors import UserError
from relight.files import existing_file, is_unsafe_name

INDEX, MASK, MESH = "capture.json", "mask.png", "mesh.obj"


@dataclass(frozen=True)
class Capture:
    """The frames that one camera took of one person in one pose.

    Attributes:
        name: name of the capture, PERSON.VIEW.
        subject: the person, the part of the name before the first dot.
        camera: calibrated.
        lamps: (L,3) positions, in the camera's world.
        frames: (L) files, one per lamp.
        mask: (H,W) uint8 of the person.
        mesh: file of the mesh, or None.
    """

    name: str
    subject: str
    camera: Pinhole
    lamps: np.ndarray
    frames: list[Path]
    mask: np.ndarray
    mesh: Path | None

    def stage(self) -> LightStage:
        """Returns the light stage in the camera's frame. Raises UserError if the lamps do not span a sphere."""
        return LightStage.from_positions((self.lamps - self.camera.eye) @ self.camera.rotation.T)

    def read_frames(self, inside: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Yields the number of each lamp and its frame (P,3) uint8 at the pixels of `inside` (H,W) bool.

        Raises:
            UserError: if a frame is not a picture, or has another size than the mask.
        """
        for lamp, path in enumerate(self.frames):
            yield lamp, read_picture(path, "frame", "RGB", self.camera.size)[inside]


def list_captures(folder: Path | str, only: str = "") -> dict[str, Path]:
    """Lists the captures in a folder without opening their files.

    Args:
        folder: contains a folder for each capture.
        only: a regular expression that names must match anywhere; by default all do.

    Returns:
        name -> folder of the capture, sorted.

    Raises:
        UserError: if there are none.
    """
    try:
        wanted = re.compile(only)
    except re.error as error:
        raise UserError(f"{only!r} is not a regular expression ({error}): give one for the names of captures") from None
    folders = {path.parent.name: path.parent for path in sorted(Path(folder).glob(f"*/{INDEX}"))}
    captures = {name: path for name, path in folders.items() if wanted.search(name) and not is_unsafe_name(name)}
    if not captures:
        raise UserError(f"{folder} holds no PERSON.VIEW/{INDEX}{f' whose name matches {only}' if only else ''}")
    return captures


def capture_files(folder: Path) -> list[Path]:
    """Returns the files of a capture's folder except its frames, and the folder of the frames."""
    files = [folder / INDEX, folder / MASK, folder / "frames"]
    return [*files, *([folder / MESH] if (folder / MESH).is_file() else [])]


def capture_subject(name: str) -> str:
    """Returns the person of a capture."""
    return name.partition(".")[0]


def read_capture(folder: Path) -> Capture:
    """Reads a capture from its folder, but not yet its frames.

    Args:
        folder: of the capture, with the files that the module's docstring lists.

    Raises:
        UserError: if files are missing, broken or inconsistent.
    """
    index = existing_file(folder / INDEX, "capture")
    try:
        content = json.loads(index.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise UserError(f"{index} is not JSON in UTF-8 ({error})") from None
    camera = entry(content, "camera", dict, index)
    lamps = entry(content, "lamps", list, index)
    mask = read_picture(folder / MASK, "mask", "L")
    frames = [frame_path(folder, entry(lamp, "frame", str, index), index) for lamp in lamps]
    positions = [numbers(entry(lamp, "position", list, index), (3,), f"{index}: position") for lamp in lamps]
    if len(set(frames)) < len(frames):
        raise UserError(f"{index} names a frame twice: each lamp has its own")
    return Capture(
        folder.name,
        capture_subject(folder.name),
        read_camera(camera, mask.shape, index),
        np.array(positions).reshape(-1, 3),
        frames,
        mask,
        folder / MESH if (folder / MESH).is_file() else None,
    )


def entry(content: Any, key: str, kind: type[dict | list | str], index: Path) -> Any:
    """Returns a value of a JSON object.

    Args:
        content: the object, as read; anything else has no values.
        key: of the value.
        kind: type that the value must have.
        index: the file, for errors.

    Raises:
        UserError: if the value is missing or of another type.
    """
    value = content.get(key) if isinstance(content, dict) else None
    if not isinstance(value, kind):
        words = {"dict": "an object", "list": "a list", "str": "a text"}[kind.__name__]
        raise UserError(f"{index}: {key} must be {words} (docs/scans.md)")
    return value


def numbers(value: list, shape: tuple[int, ...], what: str) -> np.ndarray:
    """Returns a nested list as an array of float64.

    Args:
        value: as read from JSON.
        shape: that the array must have.
        what: its name in errors.

    Raises:
        UserError: if it has another shape, or holds what is no finite number.
    """
    try:
        array = np.array(value, np.float64)
    except (ValueError, TypeError, OverflowError):
        array = np.zeros(0)  # of no allowed shape
    if array.shape != shape or not np.isfinite(array).all():
        raise UserError(f"{what} must be {' x '.join(map(str, shape))} finite numbers")
    return array


def frame_path(folder: Path, name: str, index: Path) -> Path:
    """Returns the path of a frame.

    Args:
        folder: of the capture.
        name: of the frame, by the index.
        index: the file, for errors.

    Raises:
        UserError: if the frame is not in the capture's folder `frames`, so that an index cannot name other files.
    """
    if "\0" in name or Path(name).parts[:-1] != ("frames",) or Path(name).name in ("", "..") or is_unsafe_name(name):
        raise UserError(f"{index}: {name!r} is not a frame: it must be a file of the folder frames, frames/000.png")
    return folder / name


def read_camera(camera: dict, size: tuple[int, ...], index: Path) -> Pinhole:
    """Returns the camera of a capture from OpenCV's matrices (y points down, z forward).

    Args:
        camera: `intrinsics` (3,3), pixels, and `extrinsics` (3,4), from the world to the camera, as read from JSON.
        size: height and width of the images.
        index: the file, for errors.

    Raises:
        UserError: if these are not those of a camera.
    """
    intrinsics = numbers(entry(camera, "intrinsics", list, index), (3, 3), f"{index}: intrinsics")
    extrinsics = numbers(entry(camera, "extrinsics", list, index), (3, 4), f"{index}: extrinsics")
    rotation = extrinsics[:, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
        raise UserError(f"{index}: extrinsics must be a rotation and a translation, from the world to the camera")
    focal = intrinsics[[0, 1], [0, 1]]
    if not (focal > 0).all():
        raise UserError(f"{index}: the focal lengths in intrinsics must be positive")
    eye = -rotation.T @ extrinsics[:, 3]
    from_opencv = np.diag([1.0, -1, -1])  # Pinhole's y points up, and its z toward the camera
    return Pinhole((size[0], size[1]), focal, intrinsics[:2, 2], from_opencv @ rotation, eye)


def read_picture(path: Path, what: str, mode: str, size: tuple[int, int] | None = None) -> np.ndarray:
    """Reads a picture, (H,W,3) uint8 for the mode RGB and (H,W) for L.

    Args:
        path: path of the file.
        what: its name in errors.
        mode: to which it is converted: RGB, or L for grey.
        size: the height and width that it must have; any, by default.

    Raises:
        UserError: if it is missing, not an 8-bit picture, damaged, or has another size.
    """
    try:
        with Image.open(existing_file(path, what)) as image:
            if size and image.size != size[::-1]:
                width, height = image.size
                raise UserError(f"{path} is {width}x{height} pixels, but the mask is {size[1]}x{size[0]}")
            if image.mode.startswith(("I", "F")):
                raise UserError(f"{path} has more than 8 bits per channel: convert it to 8-bit sRGB")
            return np.asarray(image.convert(mode))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        raise UserError(f"{path} is damaged, or no picture that Pillow reads") from None
