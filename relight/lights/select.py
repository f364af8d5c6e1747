"""The paper's illumination set: scale, rotate, remove unusual lights, cluster, split (method.md section 4).

With `order: cut_first`, unusual lights are removed before the clustering, since amplified back-lit copies would take
most clusters otherwise. With `order: paper`, the clustering comes first, as in the paper.
"""

import logging
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from relight.config import Lights, Rules
from relight.files import UserError, existing_file
from relight.lights.cluster import choose_test_lights, medoids
from relight.lights.statistics import measure, reference_brightness
from relight.lights.table import SPLITS, LightSet
from relight.sh import order_of, rotation_about_y, rotation_matrix

log = logging.getLogger(__name__)

MAX_UNUSUAL = 80  # clusters of the unusual lights, for the tests and to train on
MIN_FRONT = 1e-4  # of the mean irradiance: a darker front cannot be scaled to a target
DIRECTED = 0.35  # |L1| / L00 from which on a light has a main direction that the rules test
BATCH = 4096  # lights that are measured at a time


def select_lights(coefficients: np.ndarray, sources: list[str], settings: Lights) -> tuple[LightSet, dict[str, Any]]:
    """Selects a light set from the lights of panoramas.

    Args:
        coefficients: (N,K,3) radiance, in the panoramas' own units.
        sources: N names of the panoramas.
        settings: of all steps, checked (relight.config.check).

    Returns:
        The light set, and a record of plain values: for each step the number of lights before and after it and why
        lights were removed; the warnings; and in `unlit` the panoramas without a usual light, each with the reason.

    Raises:
        UserError: if the veto file cannot be used or no light can be selected.
    """
    if len(coefficients) != len(sources) or not sources:
        raise UserError(f"lights: {len(coefficients)} lights of {len(sources)} panoramas; at least one is needed")
    record: dict[str, Any] = {"order": settings.order, "steps": [], "warnings": [], "unlit": {}}
    kept = above_threshold(coefficients, settings.threshold, record)
    copies = rotated_copies(coefficients[kept], np.asarray(sources)[kept], settings)
    record_step(record, "rotate and scale", len(kept), len(copies), {})
    copies = without_vetoed(copies, settings.veto, record)
    if settings.order == "paper":
        # 100 clusters for 50 lights: the authors removed about half of theirs by hand.
        copies = cluster(copies, 2 * settings.clusters, settings.seed, record)
        candidates, unusual = split_by_rules(copies, settings, record)
        usual = candidates.rows(
            np.sort(np.random.default_rng(settings.seed).permutation(len(candidates))[: settings.clusters])
        )
    else:
        candidates, unusual = split_by_rules(copies, settings, record)
        record["unlit"] = unlit_panoramas(sources, copies, candidates)
        usual = cluster(candidates, settings.clusters, settings.seed, record)
    test = choose_test_lights(usual.coefficients, usual.source, settings)
    usual.split[test] = "test"
    record["warnings"] += split_warnings(usual, settings)
    if len(unusual):
        unusual = darkened(unusual, settings.rules.channel)
        unusual = cluster(unusual, min(MAX_UNUSUAL, len(unusual)), settings.seed)
        unusual.split[:] = split_unusual(unusual, usual)
    lights = concatenate(usual, unusual)
    if settings.extra_test:
        extra = extra_test_lights(candidates, lights, settings)
        lights = concatenate(lights, extra)
        if len(extra) < settings.extra_test:
            record["warnings"].append(
                f"lights.extra_test: {settings.extra_test} were asked for and {len(extra)} found among the panoramas "
                "that give no other light to train or to test on"
            )
    record["lights"] = {split: int((lights.split == split).sum()) for split in SPLITS}
    record["panoramas"] = len(set(usual.source.tolist()))
    for warning in record["warnings"]:
        log.warning(warning)
    return lights, record


def record_step(record: dict[str, Any], step: str, before: int, after: int, why: dict[str, int]) -> None:
    """Adds a step to the record: numbers of lights before and after it, and of those removed, by reason."""
    record["steps"].append({"step": step, "in": before, "out": after, "why": why})


def above_threshold(coefficients: np.ndarray, threshold: float, record: dict[str, Any]) -> np.ndarray:
    """Returns indices of the lights (N,K,3) whose reference brightness reaches `threshold`.

    The threshold is in the files' own units, hence meaningful only where all panoramas have the same exposure. If it
    would remove more than half of them, they are in other units: all are kept, with a warning.
    """
    brightness = reference_brightness(coefficients)
    bright = brightness >= threshold
    if bright.sum() * 2 < len(bright):
        record["warnings"].append(
            f"lights.threshold={threshold:g} would drop {int((~bright).sum())} of {len(bright)} panoramas (median "
            f"reference brightness {np.median(brightness):.3g}): they are in other units, so none was dropped"
        )
        bright[:] = True
    why = {"dark": int((~bright).sum())} if not bright.all() else {}
    record_step(record, "threshold", len(bright), int(bright.sum()), why)
    return np.flatnonzero(bright)


def rotated_copies(coefficients: np.ndarray, sources: np.ndarray, settings: Lights) -> LightSet:
    """Rotates every light about the vertical in equal steps and scales each copy to its own reference brightness.

    The reference brightness is drawn uniformly from [low, high] with a seed that depends only on the panorama's
    position in the list and on the step. A copy whose front gets no light has the scale 0 and is removed later.

    Args:
        coefficients: (N,K,3) of the panoramas.
        sources: (N,) their names.
        settings: rotations, low, high and seed.

    Returns:
        N * rotations lights, all in the training split.
    """
    n, steps = len(coefficients), settings.rotations
    order = order_of(coefficients.shape[1])
    yaw = np.arange(steps) * 360 / steps
    rotations = np.stack([rotation_matrix(rotation_about_y(angle), order) for angle in np.radians(yaw)])
    rotated = np.einsum("rjk,nkc->nrjc", rotations, coefficients).reshape(n * steps, -1, 3)
    seed = settings.seed * 1_000_003 + np.arange(n * steps)
    target = np.array([np.random.default_rng(s).uniform(settings.low, settings.high) for s in seed])
    brightness = reference_brightness(rotated)
    mean = rotated[:, 0].max(-1)
    lit = brightness > MIN_FRONT * mean
    scale = np.where(lit, target / np.where(lit, brightness, 1), 0.0)
    return LightSet(
        coefficients=(rotated * scale[:, None, None]).astype(np.float32),
        split=np.full(n * steps, "train", dtype="<U7"),
        source=np.repeat(np.asarray(sources, dtype=str), steps),
        yaw=np.tile(yaw, n),
        seed=seed,
        scale=scale,
        cluster=np.full(n * steps, -1),
        reason=np.full(n * steps, "", dtype="<U64"),
    )


def without_vetoed(copies: LightSet, veto: str | None, record: dict[str, Any]) -> LightSet:
    """Removes the copies that a veto file names, one `source` or `source:yaw` per line, with # before comments."""
    if veto is None:
        return copies
    lines = existing_file(Path(veto), "lights.veto").read_text(encoding="utf-8").splitlines()
    vetoed = np.zeros(len(copies), bool)
    for line in filter(None, (line.split("#")[0].strip() for line in lines)):
        named = copies.source == line
        if not named.any() and ":" in line:
            source, yaw = line.rsplit(":", 1)
            named = (copies.source == source) & np.isclose(copies.yaw, parse_yaw(yaw), atol=0.01)
        if not named.any():
            record["warnings"].append(f"{veto}: {line!r} names none of the lights (a source, or source:yaw)")
        vetoed |= named
    record_step(record, "veto", len(copies), int((~vetoed).sum()), {"vetoed": int(vetoed.sum())})
    if vetoed.all():
        raise UserError(f"{veto}: the veto list names every light; leave some")
    return copies.rows(~vetoed)


def parse_yaw(text: str) -> float:
    """Parses degrees; returns NaN, which matches no light, for other text, as after a colon in a source's name."""
    try:
        return float(text)
    except ValueError:
        return np.nan


def broken_rules(lights: np.ndarray, rules: Rules) -> dict[str, np.ndarray]:
    """Tests lights by the rules that replace the authors' removal of unusual lights by hand.

    Args:
        lights: (N,K,3), scaled to their reference brightness.
        rules: limits.

    Returns:
        (N,) bool by the name of the rule, true where a light breaks it.
    """
    parts = [_broken_rules(lights[start : start + BATCH], rules) for start in range(0, len(lights), BATCH)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if parts else {}


def _broken_rules(lights: np.ndarray, rules: Rules) -> dict[str, np.ndarray]:
    m = measure(lights)
    directed = m["first"] > DIRECTED
    return {
        "bright": (m["front_most"] > rules.bright) | (m["channel_most"] > rules.channel),
        "dim": m["front"] < rules.dim,
        "back-lit": (m["back_mean"] > rules.back * m["front_mean"]) | (directed & (m["toward"] < rules.toward)),
        "contrast": (m["front_least"] < rules.contrast * m["front_most"]) | (m["first"] > rules.first),
        "colour": np.maximum(abs(m["red"]), abs(m["blue"])) > rules.colour,
        "from-below": directed & (m["elevation"] < rules.below),
    }


def joined_names(broken: dict[str, np.ndarray]) -> np.ndarray:
    """Returns (N,) str, the names of the rules that each light breaks, separated by spaces."""
    names = np.array(list(broken), dtype=object)
    table = np.stack(list(broken.values()), -1)
    return np.array([" ".join(names[row]) for row in table], dtype=str)


def split_by_rules(copies: LightSet, settings: Lights, record: dict[str, Any]) -> tuple[LightSet, LightSet]:
    """Splits lights into usual and unusual ones, and notes the broken rules in their `reason`.

    If every light breaks a rule, those that break the fewest are the usual ones. Lights of scale 0 are in neither.

    Raises:
        UserError: if all lights have scale 0.
    """
    broken = broken_rules(copies.coefficients, settings.rules)
    broken = {"dark": copies.scale == 0, **{name: rule & (copies.scale > 0) for name, rule in broken.items()}}
    strikes = np.sum(list(broken.values()), axis=0) + 10 * broken["dark"]
    if strikes.min() >= 10:
        raise UserError("lights: no copy of any panorama has light on its front; add other panoramas")
    usual = strikes == strikes.min()
    if strikes.min():
        record["warnings"].append(
            f"every light breaks at least {strikes.min()} of the rules for unusual lights; kept the {usual.sum()} that "
            "break no more"
        )
    copies.reason[:] = joined_names(broken)
    why = {name: int((rule & ~usual).sum()) for name, rule in broken.items()}
    record_step(record, "unusual", len(copies), int(usual.sum()), why)
    return copies.rows(usual), copies.rows(~usual & ~broken["dark"])


def unlit_panoramas(sources: list[str], copies: LightSet, usual: LightSet) -> dict[str, str]:
    """Returns the panoramas without a usual light at any heading, each with the rules that its copies break."""
    left = set(sources) - set(usual.source.tolist())
    why = {}
    for source in filter(left.__contains__, sources):
        own = copies.reason[copies.source == source].tolist()
        broken = Counter(word for reason in own for word in reason.split(" ") if word)
        why[source] = ", ".join(f"{word} at {n} of {len(own)} headings" for word, n in broken.most_common())
    return {source: words or "below lights.threshold, or vetoed" for source, words in why.items()}


def darkened(lights: LightSet, limit: float) -> LightSet:
    """Scales down the lights whose brightest channel exceeds the irradiance `limit` on a front-facing normal.

    A camera would expose for them so: a back-lit light that is scaled to its reference brightness is many times too
    bright everywhere else.
    """
    brightest = np.concatenate(
        [measure(lights.coefficients[i : i + BATCH])["channel_most"] for i in range(0, len(lights), BATCH)]
    )
    factor = np.minimum(1, limit / brightest)
    coefficients = (lights.coefficients * factor[:, None, None]).astype(np.float32)
    return replace(lights, coefficients=coefficients, scale=lights.scale * factor)


def cluster(lights: LightSet, clusters: int, seed: int, record: dict[str, Any] | None = None) -> LightSet:
    """Reduces lights to the medoids of at most `clusters` clusters."""
    chosen, label = medoids(lights.coefficients, lights.source, clusters, seed)
    found = lights.rows(chosen)
    found.cluster[:] = label
    if record is not None:
        record_step(record, "cluster", len(lights), len(found), {})
        if len(found) < clusters:
            record["warnings"].append(
                f"lights.clusters: {clusters} were asked for and {len(found)} found among {len(lights)} lights of "
                f"{len(set(lights.source.tolist()))} panoramas"
            )
    return found


def split_unusual(unusual: LightSet, usual: LightSet) -> np.ndarray:
    """Splits unusual lights by panorama into `unusual`, to test on, and `rich`, to train on.

    A panorama that gives a training light is `rich`, one that gives only test lights is `unusual`, so that no panorama
    is on both sides of any test. The others go to the smaller side.

    Returns:
        (N,) str, the split of each unusual light.
    """
    trained, tested = (set(usual.of(split).source.tolist()) for split in ("train", "test"))
    splits = {room: "rich" if room in trained else "unusual" for room in trained | tested}
    count = {split: sum(splits.get(room) == split for room in unusual.source.tolist()) for split in ("unusual", "rich")}
    for room in dict.fromkeys(unusual.source.tolist()):
        if room not in splits:
            splits[room] = min(count, key=count.__getitem__)
            count[splits[room]] += int((unusual.source == room).sum())
    return np.array([splits[room] for room in unusual.source.tolist()])


def extra_test_lights(candidates: LightSet, lights: LightSet, settings: Lights) -> LightSet:
    """Selects `settings.extra_test` further test lights; the training lights do not depend on how many.

    Args:
        candidates: usual lights before the clustering.
        lights: the set so far.
        settings: extra_test and seed.

    Returns:
        Medoids of the candidates of panoramas that give no light to train or to test on yet.
    """
    used = np.isin(candidates.source, lights.source[np.isin(lights.split, ("train", "test", "rich"))])
    free = candidates.rows(~used)
    found = cluster(free, settings.extra_test, settings.seed) if len(free) else free
    found.split[:] = "test"
    return found


def split_warnings(lights: LightSet, settings: Lights) -> list[str]:
    """Returns warnings about test lights that are not independent of the training lights or of each other."""
    trained, tested = (set(lights.of(split).source.tolist()) for split in ("train", "test"))
    both, warnings = trained & tested, []
    if both and settings.split == "room":
        warnings.append(
            f"a single panorama ({both.pop()}) gives both training and test lights: the test is not independent"
        )
    if len(tested) < len(lights.of("test")):
        warnings.append(
            f"the {len(lights.of('test'))} test lights come from {len(tested)} panoramas, the "
            f"{len(lights.of('train'))} training lights from {len(trained)}: lights of one panorama differ in heading "
            "and brightness alone"
        )
    return warnings


def concatenate(first: LightSet, second: LightSet) -> LightSet:
    """Appends the lights of `second` to those of `first`."""
    return LightSet(**{name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in vars(first)})
