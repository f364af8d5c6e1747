"""From panoramas to the light set: generate or read, project, select."""

import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from relight.config import Lights, Panoramas
from relight.files import UserError, refuse_odd
from relight.lights.select import select
from relight.lights.statistics import from_below, measure
from relight.lights.table import LightSet
from relight.panoramas.panorama import Panorama
from relight.panoramas.project import orient, project
from relight.panoramas.read import panoramas_in, read_panorama
from relight.panoramas.rooms import room
from relight.panoramas.skies import sky
from relight.processes import end_with_parent
from relight.progress import progress as show_progress

log = logging.getLogger(__name__)

GENERATORS: dict[str, Callable[[int], np.ndarray]] = {"room": room, "sky": sky}
SERIAL = 48  # fewer panoramas than this are not worth the start of worker processes
NAMED = 8  # panoramas in one sentence


def build(panoramas: Panoramas, lights: Lights, order: int, progress: bool = True) -> tuple[LightSet, dict[str, Any]]:
    """The light set that the settings describe, and the record of what each step dropped and why.

    Lights of spherical-harmonic `order`; `progress` shows the time left. The record is that of `select`, and
    `record["unreadable"]` maps files of a folder that could not be read to what was wrong with them, and
    `record["repaired"]` others to what was mended.
    """
    sources, coefficients, unreadable, repaired = coefficients_of(panoramas, order, progress)
    chosen, record = select(coefficients, sources, lights)
    if panoramas.source == "folder":
        told = [*told_of_unlit(record["unlit"], len(sources)), *told_of_below(sources, coefficients, panoramas)]
        record["warnings"] += told
        for warning in told:
            log.warning(warning)
    why = {"unreadable": len(unreadable)} if unreadable else {}
    record["steps"].insert(0, {"step": "read", "in": len(sources) + len(unreadable), "out": len(sources), "why": why})
    record |= {"unreadable": unreadable, "repaired": repaired}
    return chosen, record


def told_of_unlit(unlit: dict[str, str], of: int) -> list[str]:
    """A sentence about the panoramas that gave no light, `unlit` of `select`; none when all gave one."""
    if not unlit:
        return []
    named = "; ".join(f"{source}: {why}" for source, why in list(unlit.items())[:NAMED])
    more = f"; and {len(unlit) - NAMED} more, which chain.json names" if len(unlit) > NAMED else ""
    return [
        f"{len(unlit)} of {of} panoramas gave no light; the rules for unusual lights (lights.rules) are for rooms, "
        f"and open sky breaks them: {named}{more}"
    ]


def told_of_below(sources: list[str], coefficients: np.ndarray, panoramas: Panoramas) -> list[str]:
    """A sentence about the panoramas whose lights (N, K, 3) are brighter from below than from above, if any."""
    found = measure(coefficients)
    below = [source for source, odd in zip(sources, from_below(found)) if odd]
    if not below:
        return []
    named = ", ".join(below[:NAMED]) + (f" and {len(below) - NAMED} more" if len(below) > NAMED else "")
    remedy = f"panoramas.upside_down={'false' if panoramas.upside_down else 'true'}"
    return [
        f"{len(below)} of {len(sources)} panoramas are brighter from below than from above: {named}; where the rows of "
        f"files run {'from the top down' if panoramas.upside_down else 'from the bottom up'}, give {remedy}"
    ]


def coefficients_of(
    panoramas: Panoramas, order: int, progress: bool = True
) -> tuple[list[str], np.ndarray, dict[str, str], dict[str, str]]:
    """Sources and lights (N, K, 3) of the panoramas that the settings name, what could not be read, what was mended."""
    if panoramas.source == "generated":
        sources = [f"room:{panoramas.seed + i}" for i in range(panoramas.count)]
        sources += [f"sky:{panoramas.seed + i}" for i in range(panoramas.skies)]
        if not sources:
            raise UserError("panoramas.count=0 and panoramas.skies=0: at least one panorama is needed")
        light_of = partial(generated_light, order=order, yaw=panoramas.yaw, flip=panoramas.flip)
    elif panoramas.source == "folder":
        folder = Path(panoramas.folder or "")
        sources = panoramas_in(folder)
        light_of = partial(file_light, panoramas=panoramas, order=order)
    else:
        raise UserError(f"panoramas.source={panoramas.source}: generated or folder")
    found, unreadable, repaired = {}, {}, {}
    results = spread(light_of, sources)
    for source, result in zip(sources, show_progress(results, "panoramas", len(sources)) if progress else results):
        if isinstance(result, str):
            unreadable[source] = result
            log.warning(result)
            continue
        found[source], mended = result if isinstance(result, tuple) else (result, [])
        if mended:
            repaired[source] = "; ".join(mended)
    if not found:
        first = next(iter(unreadable.values()))
        raise UserError(f"{panoramas.folder}: none of its {len(unreadable)} panoramas can be read; the first: {first}")
    return list(found), np.stack(list(found.values())), unreadable, repaired


def generated_light(source: str, order: int, yaw: float = 0.0, flip: bool = False) -> np.ndarray:
    """The light (K, 3) of "room:12" or "sky:3"."""
    kind, seed = source.split(":")
    return orient(project(Panorama(GENERATORS[kind](int(seed)), source=source), order), yaw, flip)


def file_light(source: str, panoramas: Panoramas, order: int) -> tuple[np.ndarray, list[str]] | str:
    """The light (K, 3) of one file of a folder and what was mended, or what is wrong with it: one bad file must not end
    a long run."""
    try:
        panorama = file_panorama(source, panoramas)
        return project(panorama, order), panorama.repairs
    except UserError as error:
        return str(error)


def file_panorama(source: str, panoramas: Panoramas, yaw: float = 0.0) -> Panorama:
    """One file of a folder, as the settings say and turned by `yaw` degrees more. UserError as in `read_panorama`."""
    p, path = panoramas, Path(panoramas.folder or "") / source
    refuse_odd(path)
    return read_panorama(
        path,
        layout=p.layout,
        yaw=p.yaw + yaw,
        flip=p.flip,
        repair=p.repair,
        upside_down=p.upside_down,
    )


def spread(function: Callable[[str], Any], items: list[str]) -> Iterator[Any]:
    """`function` of each item, in order, on all cores that this process may use."""
    workers = min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1, 16)
    if len(items) < SERIAL or workers == 1:
        yield from map(function, items)
        return
    with ProcessPoolExecutor(workers, initializer=begin, initargs=(os.getpid(),)) as pool:
        yield from pool.map(function, items, chunksize=8)


def begin(parent: int) -> None:
    """Starts a process of the pool: one thread, and no longer than its parent."""
    from threadpoolctl import threadpool_limits

    end_with_parent(parent)
    threadpool_limits(1)
