"""The command `photo` for a folder: in parallel and resumable. A photo that fails does not stop the others."""

import hashlib
import json
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from relight import __version__
from relight.errors import UserError
from relight.files import writable_folder
from relight.lights.light import parts_of
from relight.photos.mask.find import automatic_model
from relight.photos.photo import Options, relight_file
from relight.photos.place import split_place
from relight.photos.read import list_photos, list_pictures, mask_beside, mask_in
from relight.photos.trust import notes_of
from relight.photos.write import write_json
from relight.processes import has_semaphores
from relight.progress import progress

if TYPE_CHECKING:
    from relight.lights.light import Light
    from relight.photos.api import Relighter

RECORD = "photo.json"
MOST_LINES = 12  # of notes in a summary


@dataclass
class Summary:
    """What became of the photos of a folder.

    Attributes:
        done: names of those that were relit.
        kept: names of those whose results were up to date.
        failed: reasons by name.
        notes: on those that were relit now, by name.
        skipped: numbers of what else is in the folder, by its kind.
    """

    done: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    notes: dict[str, list[str]] = field(default_factory=dict)
    skipped: dict[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        lines = [f"{len(self.done)} relit, {len(self.kept)} already there, {len(self.failed)} failed"]
        lines += [f"  {name}: {reason}" for name, reason in self.failed.items()]
        if skipped := ", ".join(f"{kind}: {count}" for kind, count in self.skipped.items() if count):
            lines.append(f"skipped, since only photos in the folder itself are relit: {skipped}")
        return "\n".join(lines + note_lines(self.notes))


def note_lines(notes: dict[str, list[str]]) -> list[str]:
    """Returns a line for each distinct note on photos, the commonest first: at most MOST_LINES, and what is left out.

    Args:
        notes: sentences by the photo's name.
    """
    names_by_note: dict[str, list[str]] = {}
    for name, own in notes.items():
        for note in own:
            names_by_note.setdefault(note, []).append(name)
    ranked = sorted(names_by_note.items(), key=lambda item: -len(item[1]))
    lines = [f"note: {names[0] if len(names) == 1 else f'{len(names)} photos'}: {note}" for note, names in ranked]
    rest = len(lines) - MOST_LINES
    return lines[:MOST_LINES] + [f"note: {rest} more are in {RECORD} of the photos"] * (rest > 0)


def relight_folder(
    folder: Path | str,
    out: Path | str,
    options: Options,
    masks: Path | str | None = None,
    weights: Path | None = None,
    jobs: int | None = None,
) -> Summary:
    """Relights every photo of a folder into `out`/<file name>/.

    A photo whose results were made with the same options, weights, files and version is skipped.

    Args:
        folder: of photos.
        out: folder of the results.
        options: of the command.
        masks: a folder with a mask of the same stem for each photo; by default <stem>_mask.png beside the photo, its
            alpha, or an automatic mask.
        weights: of the network (.onnx or .safetensors); None for the one that comes with relight.
        jobs: processes; by default as many as there are cores.

    Raises:
        UserError: if something is wrong with the arguments, and not with a single photo.
    """
    from relight.photos.api import load

    photos = list_photos(folder)
    writable_folder(out, "--out")
    if masks and not Path(masks).is_dir():
        raise UserError(f"mask {masks}: for a folder of photos give a folder of masks")
    relighter = load(weights)
    network = relighter.network.digest
    options.read_background(options.named_light(relighter))  # errors of the options come once, not for each photo
    others = {path for path in Path(folder).iterdir() if not path.name.startswith(".")}
    others -= {*photos, *map(mask_beside, photos)}
    folders, unused = {path for path in others if path.is_dir()}, others.intersection(list_pictures(folder))
    skipped = {"folders": folders, "masks without a photo": unused, "files of other kinds": others - folders - unused}
    summary = Summary(skipped={kind: len(paths) for kind, paths in skipped.items()})
    tasks = {}
    for photo in photos:
        mask = (mask_in(masks, photo.stem) or Path(masks) / f"{photo.stem}.png") if masks else mask_beside(photo)
        fingerprint = _fingerprint(options, photo, mask, network)
        if _recorded(Path(out) / photo.name) == fingerprint:
            summary.kept.append(photo.name)
        else:
            tasks[photo.name] = (photo, Path(out) / photo.name, mask, fingerprint)
    Path(out).mkdir(parents=True, exist_ok=True)  # else each process would make it for its check, and remove it again
    jobs = max(1, min(jobs or os.cpu_count() or 1, len(tasks)))
    for name, reason in progress(_run(tasks, jobs, options, weights), "photos", total=len(tasks)):
        if reason is None:
            summary.done.append(name)
            summary.notes[name] = notes_of(json.loads((Path(out) / name / RECORD).read_text()))
        else:
            summary.failed[name] = reason
    return summary


def _run(tasks: dict, jobs: int, options: Options, weights: Path | None) -> Iterator[tuple[str, str | None]]:
    """Runs the tasks in processes, in the order in which they end.

    `tasks` holds, by the photo's name, what `_relight_one` takes after `options`; yields each name with the reason of
    its failure, or None. When a process dies, for want of memory for example, its pool dies with it: the remaining
    tasks are then run one process at a time, and a photo that kills this one has failed.
    """
    if not has_semaphores():
        _start(weights, os.cpu_count() or 1, options)
        yield from ((name, _relight_one(options, *task)) for name, task in tasks.items())
        return
    left = dict(tasks)
    spawn = multiprocessing.get_context("spawn")  # threads of the inference do not survive a fork
    while left:
        threads = max(1, (os.cpu_count() or 1) // jobs)
        with ProcessPoolExecutor(jobs, spawn, initializer=_start, initargs=(weights, threads, options)) as pool:
            waiting = {}
            queue = iter(list(left.items()))
            try:
                while True:
                    for name, task in queue:  # at most `jobs` wait at a time, so that few are lost with a pool
                        waiting[pool.submit(_relight_one, options, *task)] = name
                        if len(waiting) >= jobs:
                            break
                    if not waiting:
                        break
                    for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                        reason = future.result()
                        name = waiting.pop(future)
                        del left[name]
                        yield name, reason
            except BrokenProcessPool:
                if jobs == 1:  # the first of those left was running
                    name = next(iter(left))
                    del left[name]
                    yield name, "its process died, perhaps for want of memory"
                jobs = 1


_worker: "tuple[Relighter, Light | None] | None" = None  # those of this process


def _start(weights: Path | None, threads: int, options: Options) -> None:
    """Loads the network and the light once for each process, which `_relight_one` uses there."""
    from relight.photos.api import load

    global _worker
    relighter = load(weights, threads)
    _worker = relighter, options.named_light(relighter)


def _relight_one(options: Options, photo: Path, out: Path, mask: Path | None, fingerprint: str) -> str | None:
    """Relights one photo in a process that `_start` prepared, and records what its results depend on.

    If `mask` is None, the photo's alpha or an automatic mask is used; a later run with the same `fingerprint` skips the
    photo. Returns the reason of a failure, or None.
    """
    assert _worker is not None  # `_start` ran before
    relighter, light = _worker
    try:
        record = relight_file(relighter, photo, out, options, mask, light)
        write_json(out / RECORD, {**record, "fingerprint": fingerprint})
        return None
    except UserError as error:
        return str(error)
    except Exception as error:  # a bug with one photo must not stop the others
        return f"unexpected {type(error).__name__}: {error}"


def _fingerprint(options: Options, photo: Path, mask: Path | None, network: str) -> str:
    """Returns a hash of all that the results depend on: version, options, network, and the files' sizes and times.

    `network` is the hash of the network.
    """
    model = automatic_model(options.mask_model)
    lights = [split_place(part)[0] for part in parts_of(options.light)]
    files = [photo, mask, *lights, options.background, options.light_mask, model]
    stamps = []
    for path in files:
        stat = Path(path).stat() if path and Path(path).is_file() else None
        stamps.append([stat.st_size, stat.st_mtime_ns] if stat else None)
    parts = [__version__, asdict(options), stamps, network]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def _recorded(out: Path) -> str | None:
    """Returns the fingerprint in the record of a folder of results, or None if there is none."""
    try:
        return json.loads((out / RECORD).read_text()).get("fingerprint")
    except (OSError, ValueError, AttributeError):
        return None
