"""The paper's illumination set: scale, rotate, take out unusual lights, cluster, split (method.md section 4).

`order: cut_first` takes the unusual lights out before the clustering, because amplified back-lit copies would otherwise
take most clusters; `order: paper` clusters first, as the paper says it.
"""

import logging
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from relight.config import Lights
from relight.files import UserError, existing
from relight.lights.cluster import medoids, split_test
from relight.lights.rules import BATCH, broken, reasons
from relight.lights.statistics import measure, reference_brightness
from relight.lights.table import SPLITS, LightSet
from relight.sh.basis import order_of
from relight.sh.rotation import about_y, rotation_matrix

log = logging.getLogger(__name__)

UNUSUAL = 80  # lights that stand for what the rules removed, for the tests and to train on
LEAST = 1e-4  # of the mean irradiance: a front darker than this cannot be scaled to a target


def select(coefficients: np.ndarray, sources: list[str], settings: Lights) -> tuple[LightSet, dict[str, Any]]:
    """The light set from the lights of panoramas, (N, K, 3) radiance coefficients in the panoramas' own units.

    Also returns a record, ready for JSON: for each step how many lights went in, how many stayed, and why the others
    went; the warnings; and in `unlit` the panoramas that no usual light is of. UserError when nothing can be selected.
    """
    check(coefficients, sources, settings)
    record: dict[str, Any] = {"order": settings.order, "steps": [], "warnings": [], "unlit": {}}
    kept = above_threshold(coefficients, settings.threshold, record)
    copies = rotated_copies(coefficients[kept], np.asarray(sources)[kept], settings)
    note(record, "rotate and scale", len(kept), len(copies), {})
    copies = without_vetoed(copies, settings.veto, record)
    if settings.order == "paper":
        # 100 clusters for 50 lights: the authors' removal by hand took about half.
        copies = cluster(copies, 2 * settings.clusters, settings.seed, record)
        usual, unusual = cut(copies, settings, record)
        usual = usual.rows(np.sort(np.random.default_rng(settings.seed).permutation(len(usual))[: settings.clusters]))
    else:
        usual, unusual = cut(copies, settings, record)
        record["unlit"] = unlit(sources, copies, usual)
        usual = cluster(usual, settings.clusters, settings.seed, record)
    test = split_test(usual.coefficients, usual.source, settings)
    usual.split[test] = "test"
    record["warnings"] += split_warnings(usual, settings)
    if len(unusual):
        unusual = cluster(exposed(unusual, settings.rules.channel), min(UNUSUAL, len(unusual)), settings.seed)
        unusual.split[:] = deal_unusual(unusual, usual)
    lights = concatenate(usual, unusual)
    record["lights"] = {split: int((lights.split == split).sum()) for split in SPLITS}
    record["panoramas"] = len(set(usual.source.tolist()))
    for warning in record["warnings"]:
        log.warning(warning)
    return lights, record


def check(coefficients: np.ndarray, sources: list[str], settings: Lights) -> None:
    """UserError for settings or input that no set can be made from."""
    order_of(coefficients.shape[1])
    if len(coefficients) != len(sources) or not len(sources):
        raise UserError(f"lights: {len(coefficients)} lights of {len(sources)} panoramas; at least one is needed")
    if settings.order not in ("cut_first", "paper"):
        raise UserError(f"lights.order={settings.order}: cut_first or paper")
    if settings.split not in ("room", "random"):
        raise UserError(f"lights.split={settings.split}: room or random")
    if not 0 < settings.low <= settings.high:
        raise UserError(f"lights.low={settings.low}, lights.high={settings.high}: must be 0 < low <= high")
    if settings.clusters < 2 or not 0 < settings.test < settings.clusters or settings.rotations < 1:
        raise UserError(
            f"lights: clusters={settings.clusters}, test={settings.test}, rotations={settings.rotations}; "
            "must be at least 2 clusters, fewer test lights than clusters, at least one rotation"
        )


def note(record: dict[str, Any], step: str, before: int, after: int, why: dict[str, int]) -> None:
    record["steps"].append({"step": step, "in": before, "out": after, "why": why})


def above_threshold(coefficients: np.ndarray, threshold: float, record: dict[str, Any]) -> np.ndarray:
    """Indices of panoramas whose reference brightness reaches `threshold`.

    The threshold is in the files' own units: it means something for a set with one exposure. Where it would drop most
    of a set, the set has other units, and all of it is kept, with a warning.
    """
    brightness = reference_brightness(coefficients)
    bright = brightness >= threshold
    if bright.sum() * 2 < len(bright):
        record["warnings"].append(
            f"lights.threshold={threshold:g} would drop {int((~bright).sum())} of {len(bright)} panoramas (median "
            f"reference brightness {np.median(brightness):.3g}): they are in other units, so none was dropped"
        )
        bright[:] = True
    note(
        record, "threshold", len(bright), int(bright.sum()), {"dark": int((~bright).sum())} if not bright.all() else {}
    )
    return np.flatnonzero(bright)


def rotated_copies(coefficients: np.ndarray, sources: np.ndarray, settings: Lights) -> LightSet:
    """Every light turned about the vertical in equal steps, each copy scaled to a reference brightness of its own.

    The target is uniform in [low, high], drawn from the seed of the copy, which depends on the panorama's place in the
    list and the step alone. A copy whose front gets no light keeps scale 0 and is cut as too dark to scale.
    """
    n, steps = len(coefficients), settings.rotations
    order = order_of(coefficients.shape[1])
    yaw = np.arange(steps) * 360 / steps
    turns = np.stack([rotation_matrix(about_y(angle), order) for angle in np.radians(yaw)])
    turned = np.einsum("rjk,nkc->nrjc", turns, coefficients).reshape(n * steps, -1, 3)
    seed = settings.seed * 1_000_003 + np.arange(n * steps)
    target = np.array([np.random.default_rng(s).uniform(settings.low, settings.high) for s in seed])
    brightness = reference_brightness(turned)
    mean = turned[:, 0].max(-1)
    scale = np.where(brightness > LEAST * mean, target / np.where(brightness > LEAST * mean, brightness, 1), 0.0)
    return LightSet(
        coefficients=(turned * scale[:, None, None]).astype(np.float32),
        split=np.full(n * steps, "train", dtype="<U7"),
        source=np.repeat(np.asarray(sources, dtype=str), steps),
        yaw=np.tile(yaw, n),
        seed=seed,
        scale=scale,
        cluster=np.full(n * steps, -1),
        reason=np.full(n * steps, "", dtype="<U64"),
    )


def without_vetoed(copies: LightSet, veto: str | None, record: dict[str, Any]) -> LightSet:
    """The copies without those that the veto file names, a `source` or `source:yaw` per line, # for comments."""
    if veto is None:
        return copies
    lines = existing(Path(veto), "lights.veto").read_text(encoding="utf-8").splitlines()
    out = np.zeros(len(copies), bool)
    for line in filter(None, (line.split("#")[0].strip() for line in lines)):
        named = copies.source == line
        if not named.any() and ":" in line:
            source, yaw = line.rsplit(":", 1)
            named = (copies.source == source) & np.isclose(copies.yaw, number(yaw), atol=0.01)
        if not named.any():
            record["warnings"].append(f"{veto}: {line!r} names none of the lights (a source, or source:yaw)")
        out |= named
    note(record, "veto", len(copies), int((~out).sum()), {"vetoed": int(out.sum())})
    if out.all():
        raise UserError(f"{veto}: the veto list names every light; leave some")
    return copies.rows(~out)


def number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan  # a source with a colon in its name that is not there: reported as naming nothing


def cut(copies: LightSet, settings: Lights, record: dict[str, Any]) -> tuple[LightSet, LightSet]:
    """Usual and unusual lights. When every one breaks a rule, those that break fewest count as usual."""
    found = broken(copies.coefficients, settings.rules)
    found = {"dark": copies.scale == 0, **{name: rule & (copies.scale > 0) for name, rule in found.items()}}
    strikes = np.sum(list(found.values()), axis=0) + 10 * found["dark"]
    if strikes.min() >= 10:
        raise UserError("lights: no copy of any panorama has light on its front; add other panoramas")
    usual = strikes == strikes.min()
    if strikes.min():
        record["warnings"].append(
            f"every light breaks at least {strikes.min()} of the rules for unusual lights; kept the {usual.sum()} that "
            "break no more"
        )
    copies.reason[:] = reasons(found)
    note(
        record,
        "unusual",
        len(copies),
        int(usual.sum()),
        {name: int((rule & ~usual).sum()) for name, rule in found.items()},
    )
    rejected = copies.rows(~usual & ~found["dark"])
    return copies.rows(usual), rejected


def unlit(sources: list[str], copies: LightSet, usual: LightSet) -> dict[str, str]:
    """The panoramas of `sources` that no heading makes a usual light of: each with the rules that its copies break."""
    left = set(sources) - set(usual.source.tolist())
    why = {}
    for source in filter(left.__contains__, sources):
        own = copies.reason[copies.source == source].tolist()
        broken = Counter(word for reason in own for word in reason.split(" ") if word)
        why[source] = ", ".join(f"{word} at {n} of {len(own)} headings" for word, n in broken.most_common())
    return {source: words or "below lights.threshold, or vetoed" for source, words in why.items()}


def exposed(lights: LightSet, most: float) -> LightSet:
    """The lights, those darkened that are brighter than `most` somewhere on the front, as a camera would expose them.

    Scaled to its reference brightness, a back-lit light is many times too bright everywhere else.
    """
    brightest = np.concatenate(
        [measure(lights.coefficients[i : i + BATCH])["channel_most"] for i in range(0, len(lights), BATCH)]
    )
    factor = np.minimum(1, most / brightest)
    coefficients = (lights.coefficients * factor[:, None, None]).astype(np.float32)
    return replace(lights, coefficients=coefficients, scale=lights.scale * factor)


def cluster(lights: LightSet, clusters: int, seed: int, record: dict[str, Any] | None = None) -> LightSet:
    """The medoid of each cluster, evenly over the panoramas."""
    chosen, label = medoids(lights.coefficients, lights.source, clusters, seed)
    found = lights.rows(chosen)
    found.cluster[:] = label
    if record is not None:
        note(record, "cluster", len(lights), len(found), {})
        if len(found) < clusters:
            record["warnings"].append(
                f"lights.clusters: {clusters} were asked for and {len(found)} found among {len(lights)} lights of "
                f"{len(set(lights.source.tolist()))} panoramas"
            )
    return found


def deal_unusual(unusual: LightSet, usual: LightSet) -> np.ndarray:
    """Marks (N,) of unusual lights: `unusual` to test on, `rich` to train on; a room's lights get one mark.

    A room that gives a training light is `rich`, one that gives a test light alone is `unusual`, so that no room is on
    both sides of any test; the others are dealt to the smaller side.
    """
    trained, tested = (set(usual.of(split).source.tolist()) for split in ("train", "test"))
    marks = {room: "rich" if room in trained else "unusual" for room in trained | tested}
    count = {mark: sum(marks.get(room) == mark for room in unusual.source.tolist()) for mark in ("unusual", "rich")}
    for room in dict.fromkeys(unusual.source.tolist()):
        if room not in marks:
            marks[room] = min(count, key=count.get)
            count[marks[room]] += int((unusual.source == room).sum())
    return np.array([marks[room] for room in unusual.source.tolist()])


def split_warnings(lights: LightSet, settings: Lights) -> list[str]:
    trained, tested = (set(lights.of(split).source.tolist()) for split in ("train", "test"))
    both, told = trained & tested, []
    if both and settings.split == "room":
        told.append(
            f"a single panorama ({both.pop()}) gives both training and test lights: the test is not independent"
        )
    if len(tested) < len(lights.of("test")):
        told.append(
            f"the {len(lights.of('test'))} test lights come from {len(tested)} panoramas, the "
            f"{len(lights.of('train'))} training lights from {len(trained)}: lights of one panorama differ in heading "
            "and brightness alone"
        )
    return told


def concatenate(first: LightSet, second: LightSet) -> LightSet:
    return LightSet(**{name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in vars(first)})
