"""Reads HumanOLAT (Teufel et al., ICCV 2025): full-body captures in a light stage, one lamp at a time.

    SUBJECT_*/POSE_*/images_processed/Cam*/{capture}.{number}.avif   sRGB, undistorted, masked
    SUBJECT_*/POSE_*/segmentations/masks/000/Cam*.png
    SUBJECT_*/POSE_*/model/model.obj                                 millimetres
    SUBJECT_*/shared/cameras.calib                                   millimetres, one section for each camera
    SUBJECT_*/shared/LSX_light_positions_aligned.pc                  metres, lines "v x y z"
    SUBJECT_*/shared/LSX3_light_z_spiral.txt                         lamps in the order of lighting, counted from 1

Frames before FIRST_FRAME show white, gradients and environments. The rest comes in cycles of CYCLE frames: a
full-bright frame, then one frame per lamp in the order of the spiral. The first cycle has one lamp less.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from PIL import features

from relight.benchmark.files import capture_pattern
from relight.benchmark.lightstage import LightStage, Pinhole
from relight.files import UserError, existing_file
from relight.photos.read import read_mask, read_photo
from relight.srgb import LINEAR

FIRST_FRAME = 14  # the first full-bright one
CYCLE = 21  # frames from one full-bright frame to the next
POSITIONS_FILE, ORDER_FILE, CALIBRATION_FILE = (
    "LSX_light_positions_aligned.pc",
    "LSX3_light_z_spiral.txt",
    "cameras.calib",
)
SUFFIXES = (".avif", ".png")  # PNG: converted by the user
MM_PER_METRE = 1000.0
MIN_LAMP_SHARE = 0.8  # share of the lamps that must have a frame
MIN_BRIGHTNESS_RATIO = 1.2  # of a full-bright frame over its neighbours


@dataclass(frozen=True)
class Capture:
    """One camera's frames of one pose.

    Attributes:
        name: such as C003.P00.Cam07.
        subject: such as C003.
        camera: calibrated; its world is in millimetres.
        lamps: (L,3) positions of the lamps that have a frame, in the camera's world.
        frames: (L) files, one per lamp.
        full_bright: each full-bright frame with the one-lamp frames before and after it.
        missing: number of lamps without a frame.
        mask: file of the person's mask.
        model: file of the mesh, or None.
    """

    name: str
    subject: str
    camera: Pinhole
    lamps: np.ndarray
    frames: list[Path]
    full_bright: list[tuple[Path, list[Path]]]
    missing: int
    mask: Path
    model: Path | None

    def stage(self) -> LightStage:
        """Returns the light stage in the camera's frame. Raises UserError if the lamps do not span a sphere."""
        return LightStage.from_positions((self.lamps - self.camera.eye) @ self.camera.rotation.T)

    def read_mask(self) -> np.ndarray:
        """Returns the person's mask (H,W) uint8. Raises UserError if its size differs from that of the frames."""
        return read_mask(self.mask, self.camera.size)

    def read_frames(self, inside: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Yields the number of each lamp and its frame (P,3) uint8 at the pixels of `inside` (H,W) bool.

        Raises:
            UserError: if a frame is not a picture, or has another size.
        """
        for lamp, path in enumerate(self.frames):
            yield lamp, read_frame(path, self.camera.size)[inside]

    def check_order(self, inside: np.ndarray) -> None:
        """Raises UserError unless full-bright frames are brighter than their neighbours: checks the numbering."""
        for path, around in self.full_bright:
            bright, *others = (LINEAR[read_frame(one, self.camera.size)[inside]].mean() for one in (path, *around))
            if bright < MIN_BRIGHTNESS_RATIO * np.mean(others):
                raise UserError(
                    f"{path} should be full-bright and is not brighter than its neighbours: frames are missing or have "
                    f"other numbers; from {FIRST_FRAME} on, a full-bright frame must be followed by {CYCLE - 1} lamps"
                )


def captures(folder: Path | str, only: str = "") -> Iterator[Capture]:
    """Yields the captures in a folder, in the order of their names.

    Args:
        folder: contains SUBJECT_* folders, or is one.
        only: a regular expression that names must match anywhere; by default all do.

    Raises:
        UserError: if there are none, or the files of one are missing, broken or inconsistent.
    """
    yield from map(read_capture, list_captures(folder, only).values())


def list_captures(folder: Path | str, only: str = "") -> dict[str, Path]:
    """Lists the captures in a folder without opening their files; arguments and errors as for `captures`.

    Returns:
        name -> folder of the frames.
    """
    folder = Path(folder)
    subjects = [folder] if folder.name.startswith("SUBJECT_") else sorted(folder.glob("SUBJECT_*"))
    wanted = capture_pattern(only)
    cameras = (path for subject in subjects for path in sorted(subject.glob("POSE_*/images_processed/Cam*")))
    found = {name: path for path in cameras if path.is_dir() and wanted.search(name := capture_name(path))}
    if not found:
        which = f" whose name matches {only}" if only else ""
        raise UserError(f"{folder} holds no SUBJECT_*/POSE_*/images_processed/Cam*{which}")
    return found


def capture_name(folder: Path) -> str:
    """Returns the name of the capture whose frames are in a folder."""
    return f"{capture_subject(folder)}.{folder.parents[1].name.replace('POSE_', 'P')}.{folder.name}"


def capture_subject(folder: Path) -> str:
    """Returns the name of the person in the frames of a folder."""
    return folder.parents[2].name.removeprefix("SUBJECT_")


def capture_files(folder: Path) -> list[Path]:
    """Returns a capture's inputs: the folder of its frames, mask, positions, order, calibration, the mesh if any."""
    pose, subject = folder.parents[1], folder.parents[2]
    mask, model = pose / "segmentations" / "masks" / "000" / f"{folder.name}.png", pose / "model" / "model.obj"
    shared = [subject / "shared" / name for name in (POSITIONS_FILE, ORDER_FILE, CALIBRATION_FILE)]
    return [folder, mask, *shared, *([model] if model.is_file() else [])]


def read_capture(folder: Path) -> Capture:
    """Reads a capture from the folder of its frames, but not yet the frames. Raises UserError as `captures`."""
    _, mask, positions, order, calibration, *model = capture_files(folder)
    lamps = read_lamps(positions, order)
    cameras = world_to_camera(read_cameras(calibration), lamps.mean(0), calibration)
    number = re.fullmatch(r"Cam(\d+)", folder.name)
    if not number or not 1 <= int(number[1]) <= len(cameras):
        raise UserError(f"{folder}: {calibration} has the cameras Cam01 to Cam{len(cameras):02d}")
    files = frames_by_number(folder)
    lit, bright = schedule(len(lamps))
    present = [(lamp, files[frame]) for lamp, frame in enumerate(lit) if frame in files]
    if len(present) < MIN_LAMP_SHARE * len(lit):
        raise UserError(
            f"{folder} holds the frames of {len(present)} of {len(lit)} lamps (frames {lit[0]} to {lit[-1]}): "
            f"{int(np.ceil(MIN_LAMP_SHARE * len(lit)))} at least are needed"
        )
    full_bright = []
    for frame in filter(files.__contains__, bright):
        if neighbours := [files[n] for n in (frame - 1, frame + 1) if n in files and n in lit]:
            full_bright.append((files[frame], neighbours))
    return Capture(
        capture_name(folder),
        capture_subject(folder),
        pinhole(*cameras[int(number[1]) - 1], read_frame(present[0][1]).shape[:2]),
        lamps[[lamp for lamp, _ in present]],
        [path for _, path in present],
        full_bright,
        len(lit) - len(present),
        existing_file(mask, "mask"),
        model[0] if model else None,
    )


def schedule(lamps: int) -> tuple[list[int], list[int]]:
    """Returns the numbers of the frames that show one lamp each, in the order of lighting, and of the full-bright ones.

    >>> lit, bright = schedule(331)
    >>> lit[:2], lit[18:20], lit[-1], bright[:3], bright[-1]
    ([15, 16], [33, 35], 361, [14, 34, 55], 349)
    """
    lit: list[int] = []
    bright, number = [FIRST_FRAME], FIRST_FRAME + 1
    while len(lit) < lamps:
        (bright if (number - FIRST_FRAME) % CYCLE == CYCLE - 1 else lit).append(number)
        number += 1
    return lit, bright


def frames_by_number(folder: Path) -> dict[int, Path]:
    """Returns the frames in a camera's folder by number. Raises UserError if two have one number, or there are none."""
    found: dict[int, Path] = {}
    captures = set()
    for path in sorted(folder.iterdir()):
        match = re.fullmatch(r"(.+)\.(\d+)", path.stem)
        if path.suffix.lower() not in SUFFIXES or not match:
            continue
        captures.add(match[1])
        if len(captures) > 1 or int(match[2]) in found:
            raise UserError(
                f"{folder} holds frames of two captures, {found[min(found)].name} and {path.name}: keep one"
            )
        found[int(match[2])] = path
    if not found:
        raise UserError(f"{folder} holds no frames named like CAPTURE.000014.avif")
    return found


def read_frame(path: Path, size: tuple[int, int] | None = None) -> np.ndarray:
    """Reads a frame (H,W,3) uint8 sRGB. Raises UserError if it is no picture, or not of the size (height, width)."""
    if path.suffix.lower() == ".avif" and not features.check("avif"):
        raise UserError(
            f"{path}: this Pillow reads no AVIF; pip install --upgrade pillow (11.3 or later), or convert to PNG"
        )
    pixels = read_photo(path, "frame").codes
    if size and pixels.shape[:2] != tuple(size):
        height, width = pixels.shape[:2]
        raise UserError(
            f"{path} is {width}x{height} pixels and the first frame {size[1]}x{size[0]}: all must have one size"
        )
    return pixels


def read_lamps(positions: Path, order: Path) -> np.ndarray:
    """Reads the lamps' positions (L,3) in millimetres, in the order of lighting. Raises UserError."""
    rows = []
    for number, line in read_lines(positions, "positions of the lamps"):
        if line.split()[:1] == ["v"]:
            rows.append(parse_numbers(line.split()[1:], 3, f"{positions}, line {number}: a lamp is `v x y z`"))
    spiral = [
        int(parse_numbers(line.split(), 1, f"{order}, line {number}: the number of a lamp is expected")[0])
        for number, line in read_lines(order, "order of the lamps")
    ]
    if not rows or sorted(spiral) != list(range(1, len(rows) + 1)):
        raise UserError(
            f"{order} must name each of the {len(rows)} lamps of {positions} once, and has {len(spiral)} lines"
        )
    return MM_PER_METRE * np.array(rows)[np.array(spiral) - 1]


def read_cameras(path: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Reads the intrinsics (3,3), in units of the image's width, and extrinsics (3,4) of each camera.

    In the file, they are comments of three lines each, below a heading.

    Raises:
        UserError: if a camera lacks one of them, or a matrix has the wrong size.
    """
    cameras: list[dict[str, np.ndarray]] = []
    lines = iter(read_lines(path, "calibration"))
    for number, line in lines:
        words = line.strip("# \t").split()
        if not words:
            continue
        if words[0] == "camera" and not line.startswith("#"):
            cameras.append({})
        for what, width in (("extrinsic", 4), ("intrinsic", 3)):
            if words[0] in (what, f"{what}s"):
                if not cameras:
                    raise UserError(f"{path}, line {number}: {words[0]} before the first camera")
                block = [row.strip("# \t").split() for _, row in islice(lines, 3)]
                expected = f"{path}, below line {number}: {words[0]} are three lines of {width} numbers"
                block += [[]] * (3 - len(block))
                cameras[-1][what] = np.array([parse_numbers(row, width, expected) for row in block])
    if not cameras:
        raise UserError(f"{path} names no camera")
    for index, found in enumerate(cameras):
        if len(found) < 2:
            raise UserError(f"{path}: camera {index} lacks its {' and '.join({'extrinsic', 'intrinsic'} - set(found))}")
        rotation = found["extrinsic"][:, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
            raise UserError(f"{path}: the extrinsics of camera {index} are not a rotation and a translation")
        if not (found["intrinsic"].diagonal() > 0).all():
            raise UserError(f"{path}: the focal lengths of camera {index} must be positive")
    return [(found["intrinsic"], found["extrinsic"]) for found in cameras]


def world_to_camera(
    cameras: list[tuple[np.ndarray, np.ndarray]], centre: np.ndarray, path: Path
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns the cameras with extrinsics from world to camera, whatever the direction of those in the file.

    The published tools disagree about the direction. A light stage's cameras look at its centre, so the direction is
    chosen in which more cameras see the centre within 45 degrees of their axis.

    Args:
        cameras: intrinsics (3,3) and extrinsics (3,4) of each.
        centre: (3,) of the lamps.
        path: of the calibration, for errors.

    Raises:
        UserError: if neither direction has a majority.
    """
    inverted = []
    for _, extrinsic in cameras:
        turn = extrinsic[:, :3].T
        inverted.append(np.concatenate([turn, -turn @ extrinsic[:, 3:]], 1))

    def count_facing(extrinsics: list[np.ndarray]) -> int:
        centres = [extrinsic[:, :3] @ centre + extrinsic[:, 3] for extrinsic in extrinsics]
        return sum(bool(z > np.hypot(x, y)) for x, y, z in centres)

    candidates = [[extrinsic for _, extrinsic in cameras], inverted]
    votes = [count_facing(extrinsics) for extrinsics in candidates]
    if votes[0] == votes[1] or max(votes) <= len(cameras) / 2:
        raise UserError(
            f"{path}: its cameras do not look at the lamps' centre; the calibration must be in millimetres and the "
            "lamps in metres, in one frame"
        )
    chosen = candidates[int(votes[1] > votes[0])]
    return [(intrinsic, extrinsic) for (intrinsic, _), extrinsic in zip(cameras, chosen)]


def pinhole(intrinsic: np.ndarray, extrinsic: np.ndarray, size: tuple[int, int]) -> Pinhole:
    """Returns a camera for images of a size (height, width) from OpenCV's matrices (y points down, z forward)."""
    scaled = intrinsic * size[1]
    rotation = np.diag([1.0, -1, -1]) @ extrinsic[:, :3]
    eye = -extrinsic[:, :3].T @ extrinsic[:, 3]
    return Pinhole((size[0], size[1]), scaled[[0, 1], [0, 1]], scaled[:2, 2], rotation, eye)


def read_lines(path: Path, what: str) -> list[tuple[int, str]]:
    """Returns the non-empty lines of a text file, stripped, with their numbers. Raises UserError if it is not text."""
    try:
        text = existing_file(path, what).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise UserError(f"{path} is not a text file in UTF-8") from None
    return [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1) if line.strip()]


def parse_numbers(words: list[str], count: int, expected: str) -> np.ndarray:
    """Returns `count` finite numbers; raises UserError otherwise, which begins with what is `expected`."""
    try:
        found = np.array([float(word) for word in words])
    except ValueError:
        found = np.zeros(0)
    if len(found) != count or not np.isfinite(found).all():
        raise UserError(f"{expected}, not {' '.join(words)[:60]!r}")
    return found
