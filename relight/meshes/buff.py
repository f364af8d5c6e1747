"""BUFF: sequences of clothed scans, and a choice of frames that stand for them.

BUFF (Zhang et al. 2017) is unpacked as `sequences/<subject>/<outfit>_<motion>/<...><frame>.ply`: subjects are numbers
of five digits, outfits such as `shortlong` and `shortshort`, motions such as `hips` and `tilt_twist_left`. Frames
follow each other closely in time, so that a random choice of 74 among 9,613 would show the same few stances; the
paper's authors picked theirs by hand. Here k-means clusters the silhouettes of each subject and outfit, from the front
and from the side, and the frame nearest to each centre is chosen.
"""

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight.files import UserError, whole
from relight.meshes.read import READERS, read_mesh
from relight.progress import progress

SUBJECT = re.compile(r"\d{5}")
SEQUENCE = re.compile(r"([a-z]+)_(\w+)", re.IGNORECASE)
FRAME = re.compile(r"(\d+)$")
CELLS = 40  # of a silhouette's height and width; 4.5 cm at 1.8 m


@dataclass(frozen=True)
class Frame:
    """One scan of a sequence."""

    path: Path
    subject: str
    outfit: str
    motion: str
    number: int

    @property
    def name(self) -> str:
        return f"{self.subject}_{self.outfit}_{self.motion}_{self.number:06d}"


def list_frames(folder: Path | str) -> list[Frame]:
    """The frames of a BUFF folder (the release, its `sequences`, or one subject's folder above sequences), in order.

    The release's minimal body shapes are not frames. Raises UserError where nothing has BUFF's layout.
    """
    frames = []
    for path in Path(folder).rglob("*"):
        if path.suffix.lower() not in READERS or len(path.parts) < 3:
            continue
        subject, sequence, number = path.parts[-3], SEQUENCE.fullmatch(path.parts[-2]), FRAME.search(path.stem)
        if SUBJECT.fullmatch(subject) and sequence and number:
            frames.append(Frame(path, subject, sequence[1].lower(), sequence[2].lower(), int(number[1])))
    if not frames:
        raise UserError(f"{folder} holds no BUFF sequences; <subject>/<outfit>_<motion>/<frame>.ply is their layout")
    return sorted(frames, key=lambda frame: frame.name)


def silhouettes(vertices: np.ndarray) -> np.ndarray:
    """Blurred silhouettes from the front and the side (2 * CELLS * CELLS,) of vertices (V,3), y up, at one height.

    The vertices of a scan are dense, so that the cells that hold one are the silhouette; the blur makes the distance
    of two of them grow with how far an arm has moved.
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


def pick(folder: Path | str, out: Path | str, count: int = 74, stride: int = 5, seed: int = 0) -> int:
    """Chooses `count` frames of a BUFF folder and writes them as a table; returns how many were chosen.

    Every `stride`-th frame of a sequence is looked at. Subjects and outfits share the choice evenly, and by chance
    where it does not divide. `out` (scans.csv, best in `folder`) has one row per chosen frame: use, name, subject,
    path, outfit, motion, frame, stands_for (how many frames its cluster has). A person may edit it: set `use` to 0, add
    a row, change a path; `list_scans` reads it. Frames that cannot be read are passed over. Raises UserError when no
    frame can be read, and when `out` is there already.
    """
    folder, out = Path(folder), Path(out)
    if out.exists():
        raise UserError(f"{out} is there already, and may have been edited: delete it, or name another file")
    groups: dict[tuple[str, str], dict[Frame, np.ndarray]] = {}
    for frame in progress(list(_every(list_frames(folder), stride)), "BUFF frames"):
        try:
            shape = silhouettes(read_mesh(frame.path).vertices)
        except UserError:
            continue
        groups.setdefault((frame.subject, frame.outfit), {})[frame] = shape
    if not groups:
        raise UserError(f"{folder}: no frame can be read")
    shares = _shares([len(group) for group in groups.values()], count, seed)
    chosen = [row for group, share in zip(groups.values(), shares) for row in representatives(group, share, seed)]
    _write(sorted(chosen, key=lambda row: row[0].name), stride, out)
    return len(chosen)


def representatives(shapes: dict[Frame, np.ndarray], count: int, seed: int) -> list[tuple[Frame, int]]:
    """The frames nearest to the centres of `count` clusters, and how many frames each cluster has."""
    from sklearn.cluster import KMeans

    frames, features = list(shapes), np.stack(list(shapes.values()))
    count = min(count, len(np.unique(features, axis=0)))  # frames may be alike to the last vertex
    if not count:
        return []
    means = KMeans(count, n_init=4, random_state=seed).fit(features)
    distance = np.linalg.norm(features - means.cluster_centers_[means.labels_], axis=-1)
    members = [np.flatnonzero(means.labels_ == cluster) for cluster in range(count)]
    return [(frames[inside[distance[inside].argmin()]], len(inside)) for inside in members]


def _write(rows: list[tuple[Frame, int]], stride: int, out: Path) -> None:
    """The table; paths start at its folder where they can."""
    home = out.parent.resolve()
    with whole(out) as tmp, open(tmp, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["use", "name", "subject", "path", "outfit", "motion", "frame", "stands_for"])
        for frame, size in rows:
            path = frame.path.resolve()
            path = (path.relative_to(home) if path.is_relative_to(home) else path).as_posix()
            table.writerow(
                [1, frame.name, frame.subject, path, frame.outfit, frame.motion, frame.number, size * stride]
            )


def _every(frames: list[Frame], stride: int) -> Iterator[Frame]:
    """Every `stride`-th frame of each sequence."""
    seen: dict[tuple[str, str, str], int] = {}
    for frame in frames:
        key = (frame.subject, frame.outfit, frame.motion)
        if seen.setdefault(key, 0) % stride == 0:
            yield frame
        seen[key] += 1


def _shares(sizes: list[int], count: int, seed: int) -> list[int]:
    """`count` shared out evenly over groups of these sizes, none above its size."""
    shares = [0] * len(sizes)
    order = np.random.default_rng(seed).permutation(len(sizes))
    while sum(shares) < min(count, sum(sizes)):
        for group in order:
            if shares[group] < sizes[group] and sum(shares) < count:
                shares[group] += 1
    return shares
