"""Builds the light set: reads or generates panoramas, projects them, and selects lights."""

import logging
import os
import re
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.files import require_safe_name
from relight.core.processes import count_cores, end_with_parent, has_semaphores
from relight.core.progress import progress
from relight.lights.load import load_light
from relight.lights.select import select_lights
from relight.lights.statistics import is_lit_from_below, measure
from relight.lights.table import LightSet
from relight.panoramas import list_panoramas, orient, project, read_panorama
from relight.settings import Lights, Panoramas
from relight.settings.setting import setting_of

log = logging.getLogger(__name__)

Projected = np.ndarray | tuple[np.ndarray, list[str]] | str  # light, light and repairs, or why there is none

MIN_PARALLEL = 48  # panoramas; for fewer, starting worker processes takes longer than it saves
MAX_NAMED = 8  # panoramas that a warning lists


def build_light_set(panoramas: Panoramas, lights: Lights, order: int) -> tuple[LightSet, dict[str, Any]]:
    """Builds the light set that the settings describe.

    Args:
        panoramas: which panoramas are generated or read.
        lights: how lights are selected.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.

    Returns:
        The light set, and the record of `select_lights` with two more entries: `unreadable` has the error of each file
        that could not be read, `repaired` the repairs of each file that was repaired. A file that is a copy of another
        in another size or format, by its name, is left out, so that no panorama trains and tests.

    Raises:
        UserError: if the settings name no panorama, if none can be read, or if no light can be selected.
    """
    found, coefficients, unreadable, repaired = project_panoramas(panoramas, order)
    kept = _largest_copies(found)
    sources, coefficients = [found[i] for i in kept], coefficients[kept]
    selected, record = select_lights(coefficients, sources, lights)
    if panoramas.source == "folder":
        copies = sorted({*found} - {*sources})
        unlit = [f"{source}: {reason}" for source, reason in record["unlit"].items()]
        below = [source for source, is_below in zip(sources, is_lit_from_below(measure(coefficients))) if is_below]
        for names, total, what in (
            (copies, len(found), "are copies of others in another size or format, and were left out"),
            (unlit, len(sources), "gave no light (lights.rules=strong has wider limits)"),
            (below, len(sources), "are brighter from below (are their rows upside down?)"),
        ):
            if names:
                named = "; ".join(names[:MAX_NAMED])
                more = f"; and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
                warning = f"{len(names)} of {total} panoramas {what}: {named}{more}"
                record["warnings"].append(warning)
                log.warning(warning)
    reasons = {"unreadable": len(unreadable), "copies": len(found) - len(sources)}
    why = {reason: count for reason, count in reasons.items() if count}
    record["steps"].insert(0, {"step": "read", "in": len(found) + len(unreadable), "out": len(sources), "why": why})
    record |= {"unreadable": unreadable, "repaired": repaired}
    return selected, record


def project_panoramas(panoramas: Panoramas, order: int) -> tuple[list[str], np.ndarray, dict[str, str], dict[str, str]]:
    """Projects all panoramas that the settings name.

    Args:
        panoramas: a folder, or the number of each kind of generated ones.
        order: of the spherical harmonics.

    Returns:
        The sources of the N panoramas that could be read; their lights (N,K,3); the errors of the others, by source;
        and the repairs, by source.

    Raises:
        UserError: if the settings name no panorama or none can be read.
    """
    if panoramas.source == "generated":
        counts = {kind: getattr(panoramas, item.name) for item in fields(panoramas) if (kind := setting_of(item).kind)}
        sources = [f"{kind}:{seed}" for kind, count in counts.items() for seed in range(count)]
        light_of: Callable[[str], Projected] = partial(generated_light, order=order, flip=panoramas.flip)
    else:
        sources = list_panoramas(Path(panoramas.folder or ""))
        light_of = partial(_file_light, panoramas=panoramas, order=order)
    projected: dict[str, np.ndarray] = {}
    unreadable: dict[str, str] = {}
    repaired: dict[str, str] = {}
    for source, result in zip(sources, progress(parallel_map(light_of, sources), "panoramas", len(sources))):
        if isinstance(result, str):
            unreadable[source.encode(errors="backslashreplace").decode()] = result
            log.warning(result)
            continue
        projected[source], repairs = result if isinstance(result, tuple) else (result, [])
        if repairs:
            repaired[source] = "; ".join(repairs)
    if not projected:
        first = next(iter(unreadable.values()))
        raise UserError(f"{panoramas.folder}: none of its {len(unreadable)} panoramas can be read; the first: {first}")
    return list(projected), np.stack(list(projected.values())), unreadable, repaired


def _largest_copies(sources: list[str]) -> list[int]:
    """Returns the indices of panoramas, of those whose names differ in size or format only the largest.

    A name without a size counts as the largest.

    >>> _largest_copies(["hall_1k.hdr", "hall_2k.exr", "hall_2k.hdr", "hall2_1k.hdr", "room:1"])
    [1, 3, 4]
    """
    best: dict[PurePosixPath, tuple[float, int]] = {}
    for i, source in enumerate(sources):
        path = PurePosixPath(source)
        match = re.fullmatch(r"(.+)_(\d\d?)k", path.stem, re.IGNORECASE)  # more digits are those of a color temperature
        name, size = (match[1], float(match[2])) if match else (path.stem, np.inf)
        key = path.with_name(name)
        if key not in best or size > best[key][0]:
            best[key] = size, i
    return sorted(i for _, i in best.values())


def generated_light(source: str, order: int, flip: bool = False) -> np.ndarray:
    """Returns the light (K,3) of a generated panorama, such as "room:12", mirrored left to right if `flip`."""
    return load_light(source, order, flip=flip).coefficients


def _file_light(source: str, panoramas: Panoramas, order: int) -> tuple[np.ndarray, list[str]] | str:
    """Reads one panorama of a folder and projects it: its light (K,3), and the reader's repairs.

    For a file that cannot be read, it returns the message of the error, since one bad file must not end a long run.
    """
    path = Path(panoramas.folder or "") / source
    try:
        require_safe_name(path)
        panorama = read_panorama(path, panoramas.layout, panoramas.repair)
        return orient(project(panorama, order), flip=panoramas.flip), panorama.repairs
    except UserError as error:
        return str(error)


def parallel_map(function: Callable[[str], Projected], items: list[str]) -> Iterator[Projected]:
    """Yields the results of `function` for all items, in their order, computed on up to 16 cores.

    Without semaphores, for few items or on one core, they are computed in this process.
    """
    workers = min(count_cores(), 16)
    if len(items) < MIN_PARALLEL or workers == 1 or not has_semaphores():
        yield from map(function, items)
        return
    with ProcessPoolExecutor(workers, initializer=start_worker, initargs=(os.getpid(),)) as pool:
        yield function(items[0])  # here, so that this process imports all that it takes
        yield from pool.map(function, items[1:], chunksize=8)


def start_worker(parent: int) -> None:
    """Limits a worker process to one thread and to the lifetime of its parent."""
    from threadpoolctl import threadpool_limits

    end_with_parent(parent)
    threadpool_limits(1)
