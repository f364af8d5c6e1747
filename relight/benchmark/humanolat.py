"""HumanOLAT (Teufel et al., ICCV 2025): captures of whole people in a light stage, one lamp at a time, as published.

    SUBJECT_*/POSE_*/images_processed/Cam*/{capture}.{number}.avif   sRGB, undistorted, masked
    SUBJECT_*/POSE_*/segmentations/masks/000/Cam*.png
    SUBJECT_*/POSE_*/model/model.obj                                 millimetres
    SUBJECT_*/shared/cameras.calib                                   millimetres, one section for each camera
    SUBJECT_*/shared/LSX_light_positions_aligned.pc                  metres, lines "v x y z"
    SUBJECT_*/shared/LSX3_light_z_spiral.txt                         which lamp is lit when, counted from 1

Frames below FIRST are white, gradients and environments. From there on every CYCLE frames begin with a full-bright one,
but the first cycle, which is shorter by one lamp; the others show the lamps one by one in the order of the spiral.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from PIL import features

from relight.benchmark.lightstage import LightStage, Pinhole
from relight.files import UserError, existing_file
from relight.photos.read import read_mask, read_photo
from relight.srgb import LINEAR

FIRST, CYCLE = 14, 21
POSITIONS, ORDER, CALIBRATION = "LSX_light_positions_aligned.pc", "LSX3_light_z_spiral.txt", "cameras.calib"
SUFFIXES = (".avif", ".png")  # the latter for those who converted theirs
MILLIMETRES = 1000.0  # of a metre
LEAST = 0.8  # of the lamps must have a frame
BRIGHTER = 1.2  # a full-bright frame is so many times as bright as those beside it, at least


@dataclass(frozen=True)
class Capture:
    """One camera's frames of one pose.

    Attributes:
        name: such as C003.P00.Cam07.
        subject: such as C003.
        camera: calibrated, its world in millimetres.
        lamps: (L,3) positions of the lamps whose frame is there, in the same frame.
        frames: of these lamps.
        full_bright: each full-bright frame with the one-lamp frames before and after it.
        absent: how many lamps have no frame.
        mask: file.
        model: file, or None.
    """

    name: str
    subject: str
    camera: Pinhole
    lamps: np.ndarray
    frames: list[Path]
    full_bright: list[tuple[Path, list[Path]]]
    absent: int
    mask: Path
    model: Path | None

    def stage(self) -> LightStage:
        """Returns the lamps in the camera's frame. Raises UserError if they do not span a sphere."""
        return LightStage.of((self.lamps - self.camera.eye) @ self.camera.rotation.T)

    def read_mask(self) -> np.ndarray:
        """Returns the person's mask (H,W) uint8. Raises UserError for another size than the frames'."""
        return read_mask(self.mask, self.camera.size)

    def read_frames(self, inside: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Yields each lamp with its frame at the pixels of `inside` (H,W) bool, (P,3) uint8; holds one at a time.

        Raises:
            UserError: if a frame is no picture, or has another size.
        """
        for lamp, path in enumerate(self.frames):
            yield lamp, read_frame(path, self.camera.size)[inside]

    def check_order(self, inside: np.ndarray) -> None:
        """Raises UserError unless full-bright frames are brighter than their neighbours: a wrong count shows here."""
        for path, around in self.full_bright:
            bright, *others = (LINEAR[read_frame(one, self.camera.size)[inside]].mean() for one in (path, *around))
            if bright < BRIGHTER * np.mean(others):
                raise UserError(
                    f"{path} should be full-bright and is not brighter than its neighbours: frames are missing or have "
                    f"other numbers; from {FIRST} on, one full-bright frame and {CYCLE - 1} lamps are expected in turn"
                )


def captures(folder: Path | str, only: str = "") -> Iterator[Capture]:
    """Yields the captures in a folder of subjects, by name.

    Args:
        folder: with SUBJECT_* folders, or such a folder itself.
        only: a regular expression that the names match anywhere; all by default.

    Raises:
        UserError: if there is none, or the files of one are missing, broken, or do not fit each other.
    """
    yield from map(read_capture, list_captures(folder, only).values())


def list_captures(folder: Path | str, only: str = "") -> dict[str, Path]:
    """Lists the captures in a folder of subjects without opening their files; arguments and errors as for `captures`.

    Returns:
        The folder of each capture's frames, by name.
    """
    folder = Path(folder)
    subjects = [folder] if folder.name.startswith("SUBJECT_") else sorted(folder.glob("SUBJECT_*"))
    try:
        wanted = re.compile(only)
    except re.error as error:
        raise UserError(f"{only!r} is no regular expression ({error}); it is for the names of captures") from None
    places = (place for one in subjects for place in sorted(one.glob("POSE_*/images_processed/Cam*")) if place.is_dir())
    found = {name: place for place in places if wanted.search(name := name_of(place))}
    if not found:
        which = f" whose name matches {only}" if only else ""
        raise UserError(f"{folder} holds no SUBJECT_*/POSE_*/images_processed/Cam*{which}")
    return found


def name_of(place: Path) -> str:
    """The name of the capture whose frames are in a folder."""
    return f"{subject_of(place)}.{place.parents[1].name.replace('POSE_', 'P')}.{place.name}"


def subject_of(place: Path) -> str:
    """Who is in the frames of a folder."""
    return place.parents[2].name.removeprefix("SUBJECT_")


def files_of(place: Path) -> list[Path]:
    """What a capture is read from: the folder of its frames, and the files beside it."""
    pose, subject = place.parents[1], place.parents[2]
    mask, model = pose / "segmentations" / "masks" / "000" / f"{place.name}.png", pose / "model" / "model.obj"
    shared = [subject / "shared" / name for name in (POSITIONS, ORDER, CALIBRATION)]
    return [place, mask, *shared, *([model] if model.is_file() else [])]


def read_capture(place: Path) -> Capture:
    """Reads what there is to know of the capture whose frames are in a folder; the frames later. Raises UserError."""
    _, mask, positions, order, calibration, *model = files_of(place)
    lamps = read_lamps(positions, order)
    cameras = from_world(read_cameras(calibration), lamps.mean(0), calibration)
    number = re.fullmatch(r"Cam(\d+)", place.name)
    if not number or not 1 <= int(number[1]) <= len(cameras):
        raise UserError(f"{place}: {calibration} has the cameras Cam01 to Cam{len(cameras):02d}")
    files = numbered(place)
    lit, bright = schedule(len(lamps))
    there = [(lamp, files[frame]) for lamp, frame in enumerate(lit) if frame in files]
    if len(there) < LEAST * len(lit):
        raise UserError(
            f"{place} holds the frames of {len(there)} of {len(lit)} lamps (frames {lit[0]} to {lit[-1]}): "
            f"{int(np.ceil(LEAST * len(lit)))} at least are needed"
        )
    around = [(files[n], [files[m] for m in (n - 1, n + 1) if m in files and m in lit]) for n in bright if n in files]
    return Capture(
        name_of(place),
        subject_of(place),
        pinhole(*cameras[int(number[1]) - 1], read_frame(there[0][1]).shape[:2]),
        lamps[[lamp for lamp, _ in there]],
        [path for _, path in there],
        [(path, beside) for path, beside in around if beside],
        len(lit) - len(there),
        existing_file(mask, "mask"),
        model[0] if model else None,
    )


def schedule(lamps: int) -> tuple[list[int], list[int]]:
    """Returns the numbers of the frames that show each lamp alone, in their order, and of the full-bright ones.

    >>> lit, bright = schedule(331)
    >>> lit[:2], lit[18:20], lit[-1], bright[:3], bright[-1]
    ([15, 16], [33, 35], 361, [14, 34, 55], 349)
    """
    lit: list[int] = []
    bright, number = [FIRST], FIRST + 1
    while len(lit) < lamps:
        (bright if (number - FIRST) % CYCLE == CYCLE - 1 else lit).append(number)
        number += 1
    return lit, bright


def numbered(place: Path) -> dict[int, Path]:
    """Returns the frames in a camera's folder by their number. Raises UserError if two have the same, or none any."""
    found: dict[int, Path] = {}
    captures = set()
    for path in sorted(place.iterdir()):
        match = re.fullmatch(r"(.+)\.(\d+)", path.stem)
        if path.suffix.lower() not in SUFFIXES or not match:
            continue
        captures.add(match[1])
        if len(captures) > 1 or int(match[2]) in found:
            raise UserError(f"{place} holds frames of two captures, {found[min(found)].name} and {path.name}: keep one")
        found[int(match[2])] = path
    if not found:
        raise UserError(f"{place} holds no frames named like CAPTURE.000014.avif")
    return found


def read_frame(path: Path, size: tuple[int, int] | None = None) -> np.ndarray:
    """Reads a frame (H,W,3) uint8 sRGB. Raises UserError if it is no picture or, with a size, of another one."""
    if path.suffix.lower() == ".avif" and not features.check("avif"):
        raise UserError(
            f"{path}: this Pillow reads no AVIF; pip install --upgrade pillow (11.3 or later), or save as PNG"
        )
    pixels = read_photo(path, "frame").pixels
    if size and pixels.shape[:2] != tuple(size):
        height, width = pixels.shape[:2]
        raise UserError(f"{path} is {width}x{height} pixels and the first frame {size[1]}x{size[0]}: give equal ones")
    return pixels


def read_lamps(positions: Path, order: Path) -> np.ndarray:
    """Reads where the lamps stand: (L,3) millimetres, in the order in which they are lit. Raises UserError."""
    rows = []
    for number, line in lines_of(positions, "positions of the lamps"):
        if line.split()[:1] == ["v"]:
            rows.append(numbers(line.split()[1:], 3, f"{positions}, line {number}: a lamp is `v x y z`"))
    spiral = [
        int(numbers(line.split(), 1, f"{order}, line {number}: the number of a lamp is expected")[0])
        for number, line in lines_of(order, "order of the lamps")
    ]
    if not rows or sorted(spiral) != list(range(1, len(rows) + 1)):
        raise UserError(
            f"{order} must name each of the {len(rows)} lamps of {positions} once, and has {len(spiral)} lines"
        )
    return MILLIMETRES * np.array(rows)[np.array(spiral) - 1]


def read_cameras(path: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Reads the intrinsics (3,3), in units of the image's width, and extrinsics (3,4) of each camera.

    They stand below headings, three lines each, as comments of the format.

    Raises:
        UserError: if a section lacks one or has another number of numbers.
    """
    cameras: list[dict[str, np.ndarray]] = []
    lines = iter(lines_of(path, "calibration"))
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
                wrong = f"{path}, below line {number}: {words[0]} are three lines of {width} numbers"
                block += [[]] * (3 - len(block))
                cameras[-1][what] = np.array([numbers(row, width, wrong) for row in block])
    if not cameras:
        raise UserError(f"{path} names no camera")
    for index, found in enumerate(cameras):
        if len(found) < 2:
            raise UserError(f"{path}: camera {index} lacks its {' and '.join({'extrinsic', 'intrinsic'} - set(found))}")
        rotation = found["extrinsic"][:, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
            raise UserError(f"{path}: the extrinsics of camera {index} are no rotation and translation")
        if not (found["intrinsic"].diagonal() > 0).all():
            raise UserError(f"{path}: the focal lengths of camera {index} must be positive")
    return [(found["intrinsic"], found["extrinsic"]) for found in cameras]


def from_world(
    cameras: list[tuple[np.ndarray, np.ndarray]], centre: np.ndarray, path: Path
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns the cameras with extrinsics from world to camera, whichever way the file has them.

    The published tools disagree on the way. A light stage's cameras look at its centre (3,): the way in which more of
    them do, within 45 degrees, is the file's.

    Raises:
        UserError: if as many do either way, or most do in neither.
    """
    inverted = []
    for _, extrinsic in cameras:
        turn = extrinsic[:, :3].T
        inverted.append(np.concatenate([turn, -turn @ extrinsic[:, 3:]], 1))

    def looking(extrinsics: list[np.ndarray]) -> int:
        seen = [one[:, :3] @ centre + one[:, 3] for one in extrinsics]
        return sum(bool(z > np.hypot(x, y)) for x, y, z in seen)

    ways = [[extrinsic for _, extrinsic in cameras], inverted]
    votes = [looking(way) for way in ways]
    if votes[0] == votes[1] or max(votes) <= len(cameras) / 2:
        raise UserError(
            f"{path}: its cameras do not look at the lamps' centre; calibration in millimetres and lamps in metres, in "
            "one frame, are expected"
        )
    return [(intrinsic, way) for (intrinsic, _), way in zip(cameras, ways[int(votes[1] > votes[0])])]


def pinhole(intrinsic: np.ndarray, extrinsic: np.ndarray, size: tuple[int, int]) -> Pinhole:
    """Returns a camera for images of a size (height, width); OpenCV's y points down and its z away."""
    scaled = intrinsic * size[1]
    rotation = np.diag([1.0, -1, -1]) @ extrinsic[:, :3]
    eye = -extrinsic[:, :3].T @ extrinsic[:, 3]
    return Pinhole((size[0], size[1]), scaled[[0, 1], [0, 1]], scaled[:2, 2], rotation, eye)


def lines_of(path: Path, what: str) -> list[tuple[int, str]]:
    """Returns the lines of a text file that are not empty, stripped, with their numbers. Raises UserError."""
    try:
        text = existing_file(path, what).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise UserError(f"{path} is no text file") from None
    return [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1) if line.strip()]


def numbers(words: list[str], count: int, wrong: str) -> np.ndarray:
    """Returns `count` finite numbers; raises UserError that says what is `wrong` otherwise."""
    try:
        found = np.array([float(word) for word in words])
    except ValueError:
        found = np.zeros(0)
    if len(found) != count or not np.isfinite(found).all():
        raise UserError(f"{wrong}, not {' '.join(words)[:60]!r}")
    return found
