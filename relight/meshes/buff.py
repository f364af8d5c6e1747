"""Selects representative frames of BUFF, sequences of scans of clothed people.

BUFF (Zhang et al. 2017) is unpacked as `sequences/<subject>/<outfit>_<motion>/<...><frame>.ply`: subjects are numbers
of five digits, outfits such as `shortlong` and `shortshort`, motions such as `hips` and `tilt_twist_left`. Consecutive
frames hardly differ, so a random selection of 74 of the 9,613 would show the same few poses; the paper's authors
selected theirs by hand. Here k-means clusters the silhouettes of each subject and outfit, from the front and from the
side, and the frame nearest to each mean is selected.
"""

import csv
import re
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby, islice
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.core.progress import progress
from relight.meshes.read import READERS, read_mesh

SUBJECT = re.compile(r"\d{5}")
SEQUENCE = re.compile(r"([a-z]+)_(\w+)", re.IGNORECASE)
FRAME_NUMBER = re.compile(r"(\d+)$")
CELLS = 40  # of a silhouette's height and width; 4.5 cm at 1.8 m


@dataclass(frozen=True)
class BuffFrame:
    """One scan of a sequence.

    Attributes:
        path: of the mesh.
        subject: five digits.
        outfit: such as `shortlong`.
        motion: such as `hips`.
        number: of the frame in the sequence.
    """

    path: Path
    subject: str
    outfit: str
    motion: str
    number: int

    @property
    def name(self) -> str:
        """The figure's name."""
        return f"{self.subject}_{self.outfit}_{self.motion}_{self.number:06d}"


def list_frames(folder: Path | str) -> list[BuffFrame]:
    """Lists the frames of BUFF, sorted by name, without the release's minimal body shapes.

    Args:
        folder: of the release, its `sequences`, or one subject.

    Raises:
        UserError: if no file has BUFF's layout.
    """
    frames = []
    for path in Path(folder).rglob("*"):
        if path.suffix.lower() not in READERS or len(path.parts) < 3:
            continue
        subject, sequence, number = path.parts[-3], SEQUENCE.fullmatch(path.parts[-2]), FRAME_NUMBER.search(path.stem)
        if SUBJECT.fullmatch(subject) and sequence and number:
            frames.append(BuffFrame(path, subject, sequence[1].lower(), sequence[2].lower(), int(number[1])))
    if not frames:
        raise UserError(f"{folder} holds no BUFF sequences; <subject>/<outfit>_<motion>/<frame>.ply is their layout")
    return sorted(frames, key=lambda frame: frame.name)


def silhouettes(vertices: np.ndarray) -> np.ndarray:
    """Returns blurred silhouettes from the front and the side, scaled to one height.

    Scans are dense, so the cells that contain a vertex are the silhouette. With the blur, the distance of two
    silhouettes grows with the distance that an arm has moved.

    Args:
        vertices: (V,3), y up.

    Returns:
        (2 * CELLS * CELLS,) float32.
    """
    from scipy.ndimage import gaussian_filter

    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = (high - low)[1]
    across = (vertices - (low + high) / 2) / size + 0.5
    images = []
    for axis in (0, 2):
        cells = np.clip((across[:, [1, axis]] * CELLS).astype(int), 0, CELLS - 1)
        image = np.zeros((CELLS, CELLS), np.float32)
        image[cells[:, 0], cells[:, 1]] = 1
        images.append(gaussian_filter(image, 1.0))
    return np.stack(images).reshape(-1)


def select_frames(folder: Path | str, out: Path | str, count: int = 74, stride: int = 5) -> int:
    """Selects frames of BUFF and writes them to a table that `list_scans` reads and a user may edit.

    Each combination of subject and outfit gets an equal share of the frames. Frames that cannot be read are skipped.
    The table has one row per frame: use, name, subject, path, outfit, motion, frame, and stands_for, the number of
    frames in its cluster.

    Args:
        folder: of BUFF.
        out: the table, best `scans.csv` in the folder.
        count: of the frames.
        stride: every `stride`-th frame of a sequence is read.

    Returns:
        How many frames were selected.

    Raises:
        UserError: if no frame can be read, or if `out` exists.
    """
    folder, out = Path(folder), Path(out)
    if out.exists():
        raise UserError(f"{out} is there already, and may have been edited: delete it, or name another file")
    sequences = groupby(list_frames(folder), key=lambda frame: (frame.subject, frame.outfit, frame.motion))
    frames = [frame for _, sequence in sequences for frame in islice(sequence, 0, None, stride)]
    groups: dict[tuple[str, str], dict[BuffFrame, np.ndarray]] = {}
    for frame in progress(frames, "BUFF frames"):
        with suppress(UserError):
            shape = silhouettes(read_mesh(frame.path).vertices)
            groups.setdefault((frame.subject, frame.outfit), {})[frame] = shape
    if not groups:
        raise UserError(f"{folder}: no frame can be read")
    shares = map(len, np.array_split(np.arange(count), len(groups)))
    chosen = [row for group, share in zip(groups.values(), shares) for row in cluster_representatives(group, share)]
    _write_table(sorted(chosen, key=lambda row: row[0].name), stride, out)
    return len(chosen)


def cluster_representatives(shapes: dict[BuffFrame, np.ndarray], count: int) -> list[tuple[BuffFrame, int]]:
    """Selects the frames nearest to the means of clusters of silhouettes (k-means).

    Args:
        shapes: silhouettes by frame.
        count: number of clusters; there are fewer if frames are identical.

    Returns:
        For each cluster, its frame and the number of frames in it.
    """
    from sklearn.cluster import KMeans

    frames, features = list(shapes), np.stack(list(shapes.values()))
    count = min(count, len(np.unique(features, axis=0)))  # frames may be identical
    if not count:
        return []
    means = KMeans(count, n_init=4, random_state=0).fit(features)
    distance = np.linalg.norm(features - means.cluster_centers_[means.labels_], axis=-1)
    members = [np.flatnonzero(means.labels_ == cluster) for cluster in range(count)]
    return [(frames[inside[distance[inside].argmin()]], len(inside)) for inside in members]


def _write_table(rows: list[tuple[BuffFrame, int]], stride: int, out: Path) -> None:
    """Writes the table of `select_frames`; paths inside its folder are relative.

    Each row is a frame and the number of read frames that it stands for. One in `stride` frames of a sequence was read.
    """
    home = out.parent.resolve()
    with atomic_write(out) as tmp, open(tmp, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["use", "name", "subject", "path", "outfit", "motion", "frame", "stands_for"])
        for frame, size in rows:
            path = frame.path.resolve()
            file_name = (path.relative_to(home) if path.is_relative_to(home) else path).as_posix()
            table.writerow(
                [1, frame.name, frame.subject, file_name, frame.outfit, frame.motion, frame.number, size * stride]
            )
