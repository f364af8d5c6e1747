"""The command `photo`: the folder of results of a photo, and of each photo of a folder, in parallel and resumable."""

import hashlib
import json
import multiprocessing
import os
import re
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.files import atomic_write, read_record, writable_file, writable_folder, write_json
from relight.core.processes import has_semaphores
from relight.core.progress import progress
from relight.core.version import __version__
from relight.lights import Light
from relight.lights.light import parts_of
from relight.lights.place import split_place
from relight.photos.inferred import SceneOptions, require_white_balance
from relight.photos.look import Look
from relight.photos.mask.find import automatic_model
from relight.photos.network import PhotoNetwork, read_network
from relight.photos.scene import Scene
from relight.photos.tone import DISPLAY_STOPS, KNEE
from relight.photos.write import write_before_after, write_light_files, write_maps, write_picture
from relight.pictures.codes import on_white
from relight.pictures.opening import list_photos, list_pictures, mask_beside, mask_in
from relight.pictures.picture import Picture
from relight.sh import rotate_y

RECORD = "photo.json"
BEFORE_AFTER = "before_after.jpg"
RESULTS = ("relit", "before_after", "albedo", "shading", "maps", "light", "new_light")  # names of files, without suffix
BYTES_PER_PIXEL = 54  # of the photo, at most, for the results: three pictures and 19 maps of half floats
JPEG, JPEG_QUALITY, JPEG_SIDE = (".jpg", ".jpeg"), 95, 65500  # libjpeg's most pixels a side
MOST_LINES = 12  # of notes in a summary


def relight_file(
    network: PhotoNetwork,
    path: Path,
    out: Path,
    look: Look,
    mask: Path | None = None,
    maps: bool = False,
    **options: Unpack[SceneOptions],
) -> dict[str, Any]:
    """Relights a photo and writes all results to a folder (docs/photos.md).

    Everything is read and computed before the first file is written.

    Args:
        network: that infers.
        path: of the photo.
        out: the folder.
        look: of the result.
        mask: its file; by default it is found.
        maps: whether the inferred maps are also written.
        **options: of `Scene.of`.

    Returns:
        The record that is written as photo.json.

    Raises:
        UserError: if an input is wrong, or the folder cannot be written.
    """
    writable_folder(out, "--out")
    for given in _inputs(path, mask, look, options.get("lit_by")):
        stem = re.sub(r"_\d+$", "", given.name.split(".")[0])
        if given.is_file() and given.resolve().parent == out.resolve() and stem in RESULTS:
            raise UserError(f"{given} is in the folder of results and would be overwritten: give another --out")
    scene = Scene.of(path, mask, network, **options)
    picture, people = scene.picture, scene.people
    writable_folder(out, "--out", BYTES_PER_PIXEL * picture.pixels[..., 0].size)
    name = look.light.source if look.light else scene.lamp
    exposed = scene.exposed(look)
    relit = next(scene.turned(look, exposed))
    (out / RECORD).unlink(missing_ok=True)  # until all results are of this look
    write_picture(out / f"relit{picture.suffix}", relit)
    write_before_after(out / BEFORE_AFTER, picture.rgba, relit)
    if maps:
        write_maps(out, scene)
    for i, person in enumerate(people, 1):
        stem = "light" if len(people) == 1 else f"light_{i}"
        write_light_files(out / stem, person.light, f"inferred from {picture.name}")
    turned = rotate_y(exposed.light, np.radians(look.turn)).astype(np.float32)
    write_light_files(out / "new_light", turned, f"{name}, turned by {look.turn:g} degrees")
    record = {
        "photo": str(path),
        "picture": f"relit{picture.suffix}",
        "light": name,
        "size": picture.shape[::-1],
        "options": {**look.words, "maps": maps, **options},
        "shading_png": {"stops": DISPLAY_STOPS, "straight_to": KNEE},
        "notes": scene.notes + scene.notes_on(look),
        "people": [
            {
                "square": [round(v, 2) for v in (person.crop.left, person.crop.top, person.crop.side)],
                "white": [round(float(v), 3) for v in person.white],
                "error": person.error,
                "warnings": warnings,
            }
            for person, warnings in zip(people, scene.doubts)
        ],
    }
    write_json(out / RECORD, record, default=str)
    return record


def relight_to(
    network: PhotoNetwork, path: Path, out: Path, look: Look, mask: Path | None = None, **options: Unpack[SceneOptions]
) -> list[str]:
    """Relights a photo, and writes the picture alone.

    Args:
        network: that infers.
        path: of the photo.
        out: of the picture: .jpg, or with the suffix of `Picture`.
        look: of the result.
        mask: its file; by default it is found.
        **options: of `Scene.of`.

    Returns:
        Notes on the photo and the light.

    Raises:
        UserError: if an input is wrong, or the file cannot be written, or is one of the inputs.
    """
    writable_file(out, "--out")
    require_unused(out, path, mask, look, options.get("lit_by"))
    picture, suffix = Picture.of(path), out.suffix.lower()
    if look.background.kind == "transparent" and suffix in JPEG:
        raise UserError(f"--out {out}: a JPEG cannot be transparent, give a name that ends in {picture.suffix}")
    if suffix not in (*JPEG, picture.suffix):
        raise UserError(f"--out {out}: {suffix} is not written; end it in .jpg or {picture.suffix}, or give a folder")
    if suffix in JPEG and max(picture.shape) > JPEG_SIDE:
        raise UserError(f"--out {out}: a JPEG has at most {JPEG_SIDE} pixels a side; end it in {picture.suffix}")
    scene = Scene.of(picture, mask, network, **options)
    relit = scene.relit(look)
    if suffix in JPEG:
        with atomic_write(out) as tmp:
            Image.fromarray(on_white(relit)).save(tmp, quality=JPEG_QUALITY)
    else:
        write_picture(out, relit)
    return scene.notes + scene.notes_on(look, opaque=suffix in JPEG)


def require_unused(out: Path, path: Path, mask: Path | None, look: Look, lit_by: Light | str | None) -> None:
    """Raises UserError if writing `out` would overwrite a file that relighting `path` reads."""
    for given in _inputs(path, mask, look, lit_by):
        if out.exists() and given.exists() and out.samefile(given):
            raise UserError(f"{given} would be overwritten: give another --out")


def _inputs(path: Path, mask: Path | None, look: Look, lit_by: Light | str | None) -> list[Path]:
    """Returns what may be files among the words that say how a photo is relit."""
    lights = [split_place(part)[0] for text in (look.words["light"], str(lit_by)) for part in parts_of(text)]
    return [Path(given) for given in (path, mask or mask_beside(path), look.background.name, *lights) if given]


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


def photos_in(folder: Path) -> tuple[list[Path], Summary]:
    """Lists the photos in a folder, and counts what else is there."""
    photos = list_photos(folder)
    others = {path for path in folder.iterdir() if not path.name.startswith(".")}
    others -= {*photos, *map(mask_beside, photos)}
    folders, unused = {path for path in others if path.is_dir()}, others.intersection(list_pictures(folder))
    skipped = {"folders": folders, "masks without a photo": unused, "files of other kinds": others - folders - unused}
    return photos, Summary(skipped={kind: len(paths) for kind, paths in skipped.items()})


def relight_photos(
    photos: Sequence[Path],
    summary: Summary,
    out: Path,
    look: Look,
    masks: Path | None = None,
    weights: Path | None = None,
    jobs: int | None = None,
    maps: bool = False,
    **options: Unpack[SceneOptions],
) -> None:
    """Relights photos into `out`/<file name>/.

    A photo whose results were made with the same look, options, weights, files and version is skipped. One that fails
    does not stop the others.

    Args:
        photos: their files.
        summary: to which it adds what becomes of them.
        out: folder of the results.
        look: of the results.
        masks: a folder that has a mask of the same stem for each photo; by default <stem>_mask.png beside the photo,
            its alpha, or an automatic mask.
        weights: of the network (.onnx); None for the one that comes with relight.
        jobs: processes; by default as many as there are cores.
        maps: whether the inferred maps are also written.
        **options: of `Scene.of`.

    Raises:
        UserError: if something is wrong with the arguments, and not with a single photo.
    """
    writable_folder(out, "--out")
    if masks and not masks.is_dir():
        raise UserError(f"mask {masks}: for several photos give a folder of masks")
    for one, other in pairwise(sorted(photos, key=lambda path: path.name)):
        if one.name == other.name:
            raise UserError(f"{one} and {other} have one name, and so would their results: relight them one by one")
    require_white_balance(options.get("white_balance", "keep"))
    network = read_network(weights).digest
    tasks = {}
    for photo in photos:
        mask = (mask_in(masks, photo.stem) or masks / f"{photo.stem}.png") if masks else mask_beside(photo)
        files = photo, mask, automatic_model(options.get("mask_model"))
        fingerprint = _fingerprint(files, look, maps, options, network)
        if _recorded(out / photo.name) == fingerprint:
            summary.kept.append(photo.name)
        else:
            tasks[photo.name] = (photo, out / photo.name, mask, fingerprint)
    out.mkdir(parents=True, exist_ok=True)  # else each process would make it for its check, and remove it again
    jobs = max(1, min(jobs or os.cpu_count() or 1, len(tasks)))
    work = partial(_relight_one, look=look, maps=maps, **options)
    for name, reason in progress(_run(work, tasks, jobs, weights), "photos", total=len(tasks)):
        if reason is None:
            summary.done.append(name)
            summary.notes[name] = json.loads((out / name / RECORD).read_text())["notes"]
        else:
            summary.failed[name] = reason


def _run(
    work: Callable[..., str | None], tasks: dict[str, tuple[Any, ...]], jobs: int, weights: Path | None
) -> Iterator[tuple[str, str | None]]:
    """Runs the tasks in processes, and yields each photo's name with the reason of its failure, or None.

    Raises:
        UserError: if a process dies.
    """
    cores = os.cpu_count() or 1
    if not has_semaphores():
        yield from ((name, work(weights, cores, *task)) for name, task in tasks.items())
        return
    name = next(iter(tasks), "")
    spawn = multiprocessing.get_context("spawn")  # threads of the inference do not survive a fork
    threads = max(1, cores // jobs)
    with ProcessPoolExecutor(jobs, spawn) as pool:
        try:
            # Workers inherit the block: Ctrl-C, which waits meanwhile, is not theirs.
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            futures = [(name, pool.submit(work, weights, threads, *task)) for name, task in tasks.items()]
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            for name, future in futures:
                yield name, future.result()
        except BrokenProcessPool:
            who = name if jobs == 1 else f"{name}, or one of the {jobs - 1} after it"
            raise UserError(
                f"{who}: its process died, perhaps for want of memory; what is done stays: give --jobs 1, or a "
                "smaller photo"
            ) from None
        except (KeyboardInterrupt, SystemExit, GeneratorExit):
            for worker in multiprocessing.active_children():
                worker.kill()
            raise


_network = cache(read_network)  # once in each process


def _relight_one(
    weights: Path | None, threads: int, photo: Path, out: Path, mask: Path | None, fingerprint: str, **options: Any
) -> str | None:
    try:
        record = relight_file(_network(weights, threads), photo, out, mask=mask, **options)
        write_json(out / RECORD, {**record, "fingerprint": fingerprint}, default=str)
        return None
    except UserError as error:
        return str(error)
    except Exception as error:  # a bug with one photo must not stop the others
        return f"unexpected {type(error).__name__}: {error}"


def _fingerprint(files: tuple[Path | None, ...], *parts: Any) -> str:
    """Returns a hash of all that results depend on: the version, the files' sizes and times, and other values."""
    stats = [path.stat() if path and path.is_file() else None for path in files]
    stamps = [[stat.st_size, stat.st_mtime_ns] if stat else None for stat in stats]
    return hashlib.sha256(json.dumps([__version__, stamps, *parts], default=_plain).encode()).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return hashlib.sha256(value.tobytes()).hexdigest()
    return vars(value) if hasattr(value, "__dict__") else str(value)


def _recorded(out: Path) -> str | None:
    record = read_record(out / RECORD)
    return record.get("fingerprint") if (out / str(record.get("picture", ""))).is_file() else None
