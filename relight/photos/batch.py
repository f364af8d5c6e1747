"""A folder of photos: side by side, resumable, and none stops the others."""

import hashlib
import json
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field
from pathlib import Path

from relight import __version__
from relight.files import UserError, writable_folder
from relight.photos.mask import automatic_model
from relight.photos.movie import photos_in
from relight.photos.photo import Wish, relight_file
from relight.photos.save import save_json
from relight.photos.source import mask_beside
from relight.progress import progress

RECORD = "photo.json"


@dataclass
class Summary:
    """Names of the photos that were relit now, that were there already, and those that failed, with the reason."""

    done: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        lines = [f"{len(self.done)} relit, {len(self.kept)} already there, {len(self.failed)} failed"]
        return "\n".join(lines + [f"  {name}: {reason}" for name, reason in self.failed.items()])


def batch(
    folder: Path | str,
    out: Path | str,
    wish: Wish,
    masks: Path | str | None = None,
    weights: Path | None = None,
    jobs: int | None = None,
) -> Summary:
    """Relights every photo of `folder` into `out`/<file name>/.

    masks: a folder with a mask of the same stem for each photo; else <stem>_mask.png beside the photo, its alpha, or
    the automatic mask. A photo whose results were made by the same wish, weights, files and version is left alone.
    """
    from relight.photos.api import load

    photos = photos_in(folder)
    writable_folder(out, "--out")
    if masks and not Path(masks).is_dir():
        raise UserError(f"mask {masks}: for a folder of photos give a folder of masks")
    wish.behind(wish.source(load(weights)))  # what is wrong with the wish is said once, not for each photo
    summary = Summary()
    tasks = {}
    for photo in photos:
        mask = _mask_in(Path(masks), photo) if masks else mask_beside(photo)
        seal = _seal(wish, photo, mask, weights)
        if _sealed(Path(out) / photo.name) == seal:
            summary.kept.append(photo.name)
        else:
            tasks[photo.name] = (photo, Path(out) / photo.name, mask, seal)
    jobs = max(1, min(jobs or os.cpu_count() or 1, len(tasks)))
    for name, reason in progress(_run(tasks, jobs, wish, weights), "photos", total=len(tasks)):
        if reason is None:
            summary.done.append(name)
        else:
            summary.failed[name] = reason
    return summary


def _run(tasks: dict, jobs: int, wish: Wish, weights: Path | None) -> Iterator[tuple[str, str | None]]:
    """Runs the tasks in processes; yields (name, reason of failure or None) as they end.

    When a process dies, as for want of memory, the pool dies with it: the rest is done again by one process at a time,
    and a photo that kills that one is the culprit.
    """
    left = dict(tasks)
    spawn = multiprocessing.get_context("spawn")  # torch's threads do not survive a fork
    while left:
        threads = max(1, (os.cpu_count() or 1) // jobs)
        with ProcessPoolExecutor(jobs, spawn, initializer=_start, initargs=(weights, threads, wish)) as pool:
            waiting = {}
            queue = iter(list(left.items()))
            try:
                while True:
                    for name, task in queue:
                        waiting[pool.submit(_one, wish, *task)] = name
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
                if jobs == 1:
                    name = next(iter(left))
                    del left[name]
                    yield name, "its process died, perhaps for want of memory"
                jobs = 1


_worker = None  # the relighter and the light of this process


def _start(weights: Path | None, threads: int, wish: Wish) -> None:
    from relight.photos.api import load

    global _worker
    relighter = load(weights, threads)
    _worker = relighter, wish.source(relighter)


def _one(wish: Wish, photo: Path, out: Path, mask: Path | None, seal: str) -> str | None:
    try:
        relighter, source = _worker
        record = relight_file(relighter, photo, out, wish, mask, source)
        save_json(out / RECORD, {**record, "seal": seal})
        return None
    except UserError as error:
        return str(error)
    except Exception as error:  # a bug with one photo must not take the others' night away
        return f"unexpected {type(error).__name__}: {error}"


def _mask_in(masks: Path, photo: Path) -> Path:
    found = sorted(masks.glob(f"{photo.stem}.*")) + sorted(masks.glob(f"{photo.stem}_mask.*"))
    return found[0] if found else masks / f"{photo.stem}.png"  # which is not there, and will be said so


def _seal(wish: Wish, photo: Path, mask: Path | None, weights: Path | None) -> str:
    """A digest of all that the results depend on; files count by size and time."""
    model = automatic_model(wish.mask_model)
    files = [photo, mask, weights, wish.light, wish.background, wish.light_mask, model]
    stamps = []
    for path in files:
        stat = Path(path).stat() if path and Path(path).is_file() else None
        stamps.append([stat.st_size, stat.st_mtime_ns] if stat else None)
    return hashlib.sha256(json.dumps([__version__, asdict(wish), stamps]).encode()).hexdigest()


def _sealed(out: Path) -> str | None:
    try:
        return json.loads((out / RECORD).read_text()).get("seal")
    except (OSError, ValueError, AttributeError):
        return None
