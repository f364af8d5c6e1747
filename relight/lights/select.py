"""Selects the light set: rotates, scales, removes unusual lights, clusters and splits (method.md section 4).

With `order: cut_first`, unusual lights are removed before the clustering; otherwise, amplified back-lit copies would
take most clusters. With `order: paper`, the clustering comes first, as in the paper.
"""

import logging
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from relight.core.errors import UserError
from relight.lights.cluster import choose_test_lights, choose_validation_lights, medoids
from relight.lights.statistics import measure, reference_brightness
from relight.lights.table import SPLITS, LightSet
from relight.sh import order_of, rotation_about_y, rotation_matrix

if TYPE_CHECKING:
    from relight.settings import Lights

log = logging.getLogger(__name__)

MIN_BRIGHTNESS = 0.2  # reference brightness of a panorama, in its own units, below which it is dark (the paper's)
BRIGHTNESS = (0.7, 0.9)  # range of the reference brightness to which lights are scaled (the paper's)
ROTATIONS = 36  # headings of each panorama, every 10 degrees (the paper's)
MAX_UNUSUAL = 80  # clusters of unusual lights
MIN_FRONT = 1e-4  # reference brightness over the mean; a darker front cannot be scaled to a target
MIN_DIRECTIVITY = 0.35  # |L1| / L00; above it, a light has a main direction, which the rules test
MORE_THAN_ALL_RULES = 10  # rules that a light of scale 0 counts as breaking


@dataclass(frozen=True)
class Rules:
    """Limits of usual lights, scaled to their reference brightness. A light that breaks one is unusual.

    Irradiance is that of luminance. The front is all normals with z > 0. Rules on the main direction apply to lights
    with |L1| / L00 above MIN_DIRECTIVITY.

    Attributes:
        bright: largest irradiance of the front.
        channel: largest irradiance of the front in one channel.
        dim: least irradiance at the normal (0, 0, 1).
        back: largest ratio of the mean irradiance of the back to that of the front.
        toward: least cosine between main direction and direction to the camera.
        first: largest |L1| / L00.
        color: largest |ln R/G| and |ln B/G| of the mean radiance.
        below: least elevation of the main direction, degrees.
    """

    bright: float = 2.0
    channel: float = 2.6
    dim: float = 0.4
    back: float = 1.6
    toward: float = -0.45
    first: float = 1.25
    color: float = 1.1
    below: float = -15.0


# Strong lights may be as bright and as directed as those of skies and studios, but not from behind or from below.
RULES = {"rooms": Rules(), "strong": Rules(bright=6.0, channel=8.0, first=1.72, color=1.5)}


def select_lights(coefficients: np.ndarray, sources: list[str], settings: "Lights") -> tuple[LightSet, dict[str, Any]]:
    """Selects a light set from the lights of panoramas.

    Args:
        coefficients: (N,K,3) radiance, in the panoramas' own units.
        sources: N names of the panoramas.
        settings: settings of all steps; must have passed relight.settings.check.

    Returns:
        The light set, and a record of plain values: `steps` with the numbers of lights before and after each step and
        the reasons for removals; `warnings`; and `unlit`, the panoramas without a usual light, each with the reason.

    Raises:
        UserError: if no light can be selected.
    """
    record: dict[str, Any] = {"order": settings.order, "steps": [], "warnings": [], "unlit": {}}
    kept = _above_threshold(coefficients, record)
    copies = _rotated_copies(coefficients[kept], np.asarray(sources)[kept], settings.seed)
    _record_step(record, "rotate and scale", len(kept), len(copies), {})
    if settings.order == "paper":
        # Twice as many clusters, since the authors removed about half of their lights by hand.
        copies = cluster(copies, 2 * settings.clusters, settings.seed, record)
        candidates, unusual = _split_by_rules(copies, settings, record)
        drawn = np.random.default_rng(settings.seed).permutation(len(candidates))[: settings.clusters]
        usual = candidates.rows(np.sort(drawn))
    else:
        candidates, unusual = _split_by_rules(copies, settings, record)
        record["unlit"] = _unlit_panoramas(sources, copies, candidates)
        usual = cluster(candidates, settings.clusters, settings.seed, record)
    usual.split[choose_test_lights(usual.coefficients, usual.source, settings)] = "test"
    record["warnings"] += _split_warnings(usual, settings)
    if len(unusual):
        unusual = cluster(unusual, min(MAX_UNUSUAL, len(unusual)), settings.seed)
        unusual.split[:] = _split_unusual(unusual, usual)
    lights = concatenate(usual, unusual)
    if settings.extra_test:
        extra = _extra_test_lights(candidates, lights, settings)
        lights = concatenate(lights, extra)
        if len(extra) < settings.extra_test:
            record["warnings"].append(f"lights.extra_test: {len(extra)} of {settings.extra_test} found: few panoramas")
    train = np.flatnonzero(lights.split == "train")
    lights.split[train[choose_validation_lights(lights.coefficients[train])]] = "validation"
    record["lights"] = {split: int((lights.split == split).sum()) for split in SPLITS}
    record["panoramas"] = len(set(usual.source.tolist()))
    for warning in record["warnings"]:
        log.warning(warning)
    return lights, record


def _record_step(record: dict[str, Any], step: str, before: int, after: int, reasons: dict[str, int]) -> None:
    """Adds a step to the record: the numbers of lights before and after it, and of those removed, by reason."""
    record["steps"].append({"step": step, "in": before, "out": after, "why": reasons})


def _above_threshold(coefficients: np.ndarray, record: dict[str, Any]) -> np.ndarray:
    """Returns the indices of the lights (N,K,3) whose reference brightness reaches MIN_BRIGHTNESS.

    The threshold is in the files' units and assumes one exposure for all panoramas. If it would remove more than half
    of them, they must be in other units: all are kept, with a warning.
    """
    brightness = reference_brightness(coefficients)
    bright = brightness >= MIN_BRIGHTNESS
    if bright.sum() * 2 < len(bright):
        record["warnings"].append(
            f"a least reference brightness of {MIN_BRIGHTNESS:g} would drop {int((~bright).sum())} of {len(bright)} "
            f"panoramas (median {np.median(brightness):.3g}): they are in other units, so none was dropped"
        )
        bright[:] = True
    reasons = {"dark": int((~bright).sum())} if not bright.all() else {}
    _record_step(record, "threshold", len(bright), int(bright.sum()), reasons)
    return np.flatnonzero(bright)


def _rotated_copies(coefficients: np.ndarray, sources: np.ndarray, seed: int) -> LightSet:
    """Rotates every light about the vertical in equal steps and scales each copy to a random reference brightness.

    The reference brightness is uniform in its range, with a seed that depends only on the panorama's index and on
    the step. A copy without light on its front gets scale 0 and is removed later. Returns N * ROTATIONS lights, all in
    the training split.
    """
    n, steps = len(coefficients), ROTATIONS
    order = order_of(coefficients.shape[1])
    yaw = np.arange(steps) * 360 / steps
    rotations = np.stack([rotation_matrix(rotation_about_y(angle), order) for angle in np.radians(yaw)])
    rotated = np.einsum("rjk,nkc->nrjc", rotations, coefficients).reshape(n * steps, -1, 3)
    seeds = seed * 1_000_003 + np.arange(n * steps)
    target = np.array([np.random.default_rng(copy_seed).uniform(*BRIGHTNESS) for copy_seed in seeds])
    brightness = reference_brightness(rotated)
    constant = rotated[:, 0].max(-1)  # the first coefficient, of the brightest channel
    has_front_light = brightness > MIN_FRONT * constant
    scale = np.where(has_front_light, target / np.where(has_front_light, brightness, 1), 0.0)
    return LightSet(
        coefficients=(rotated * scale[:, None, None]).astype(np.float32),
        split=np.full(n * steps, "train", dtype="<U10"),
        source=np.repeat(np.asarray(sources, dtype=str), steps),
        yaw=np.tile(yaw, n),
        scale=scale,
        reason=np.full(n * steps, "", dtype="<U64"),
    )


def broken_rules(lights: np.ndarray, rules: Rules) -> dict[str, np.ndarray]:
    """Tests lights by the rules that replace the authors' removal of unusual lights by hand.

    Args:
        lights: (N,K,3), scaled to their reference brightness.
        rules: limits.

    Returns:
        Whether each light breaks a rule, (N,) bool, by the rule's name.
    """
    stats = measure(lights)
    directed = stats["first"] > MIN_DIRECTIVITY
    is_back_lit = stats["back_mean"] > rules.back * stats["front_mean"]
    return {
        "bright": (stats["front_most"] > rules.bright) | (stats["channel_most"] > rules.channel),
        "dim": stats["front"] < rules.dim,
        "back-lit": is_back_lit | (directed & (stats["toward"] < rules.toward)),
        "contrast": (stats["front_least"] < 0) | (stats["first"] > rules.first),
        "color": np.maximum(abs(stats["red"]), abs(stats["blue"])) > rules.color,
        "from-below": directed & (stats["elevation"] < rules.below),
    }


def _split_by_rules(copies: LightSet, settings: "Lights", record: dict[str, Any]) -> tuple[LightSet, LightSet]:
    """Splits lights into usual and unusual ones, and writes the broken rules to their `reason`.

    If every light breaks a rule, those that break the fewest rules are usual. Lights of scale 0 are neither; raises
    UserError if all are. None of the lights is too bright for a camera (`darkened`).
    """
    broken = broken_rules(copies.coefficients, RULES[settings.rules])
    broken = {"dark": copies.scale == 0, **{name: rule & (copies.scale > 0) for name, rule in broken.items()}}
    broken_count = np.sum(list(broken.values()), axis=0) + MORE_THAN_ALL_RULES * broken["dark"]
    if broken_count.min() >= MORE_THAN_ALL_RULES:
        raise UserError("lights: no copy of any panorama has light on its front; add other panoramas")
    usual = broken_count == broken_count.min()
    if broken_count.min():
        record["warnings"].append(f"every light breaks {broken_count.min()} or more rules; {usual.sum()} break no more")
    names = np.array(list(broken), dtype=object)
    copies.reason[:] = [" ".join(names[row]) for row in np.stack(list(broken.values()), -1)]
    reasons = {name: int((rule & ~usual).sum()) for name, rule in broken.items()}
    _record_step(record, "unusual", len(copies), int(usual.sum()), reasons)
    return darkened(copies.rows(usual)), darkened(copies.rows(~usual & ~broken["dark"]))


def _unlit_panoramas(sources: list[str], copies: LightSet, usual: LightSet) -> dict[str, str]:
    """Returns the panoramas without a usual light at any heading, with the rules that their copies break.

    Reasons are such as "bright at 3 of 12 headings, color at 1 of 12 headings".
    """
    left = set(sources) - set(usual.source.tolist())
    reasons = {}
    for source in filter(left.__contains__, sources):
        by_heading = copies.reason[copies.source == source].tolist()
        broken = Counter(rule for reason in by_heading for rule in reason.split(" ") if rule)
        reasons[source] = ", ".join(f"{rule} at {n} of {len(by_heading)} headings" for rule, n in broken.most_common())
    return {source: words or "too dark" for source, words in reasons.items()}


def darkened(lights: LightSet) -> LightSet:
    """Scales lights down until no channel is brighter than rooms may be, in irradiance on normals that face the camera.

    A camera would expose so: a light from the side or the back that is scaled to its reference brightness is many times
    too bright elsewhere.
    """
    if not len(lights):
        return lights
    factor = np.minimum(1, RULES["rooms"].channel / measure(lights.coefficients)["channel_most"])
    coefficients = (lights.coefficients * factor[:, None, None]).astype(np.float32)
    return replace(lights, coefficients=coefficients, scale=lights.scale * factor)


def cluster(lights: LightSet, clusters: int, seed: int, record: dict[str, Any] | None = None) -> LightSet:
    """Reduces lights to the medoids of at most `clusters` clusters.

    Args:
        lights: to cluster.
        clusters: their largest number.
        seed: random seed of k-means.
        record: gets the step, and a warning if there are fewer clusters; None for neither.
    """
    selected = lights.rows(medoids(lights.coefficients, lights.source, clusters, seed))
    if record is not None:
        _record_step(record, "cluster", len(lights), len(selected), {})
        if len(selected) < clusters:
            panoramas = len(set(lights.source.tolist()))
            record["warnings"].append(f"lights.clusters: {len(selected)} of {clusters} found in {panoramas} panoramas")
    return selected


def _split_unusual(unusual: LightSet, usual: LightSet) -> np.ndarray:
    """Splits unusual lights (N,) by panorama into `unusual`, for tests, and `rich`, for training.

    A panorama with a training light is `rich`, one with only test lights is `unusual`, so no panorama is on both sides.
    The other panoramas go to the smaller side.
    """
    train_sources, test_sources = (set(usual.of(split).source.tolist()) for split in ("train", "test"))
    splits = {room: "rich" if room in train_sources else "unusual" for room in train_sources | test_sources}
    count = {split: sum(splits.get(room) == split for room in unusual.source.tolist()) for split in ("unusual", "rich")}
    for room in dict.fromkeys(unusual.source.tolist()):
        if room not in splits:
            splits[room] = min(count, key=count.__getitem__)
            count[splits[room]] += int((unusual.source == room).sum())
    return np.array([splits[room] for room in unusual.source.tolist()])


def _extra_test_lights(candidates: LightSet, lights: LightSet, settings: "Lights") -> LightSet:
    """Selects `settings.extra_test` further test lights, without any effect on the training lights.

    They are medoids of the candidates from panoramas that have no training, test or rich light.
    """
    used = np.isin(candidates.source, lights.source[np.isin(lights.split, ("train", "test", "rich"))])
    free = candidates.rows(~used)
    extra = cluster(free, settings.extra_test, settings.seed) if len(free) else free
    extra.split[:] = "test"
    return extra


def _split_warnings(lights: LightSet, settings: "Lights") -> list[str]:
    """Returns warnings about test lights that are not independent of the training lights or of each other."""
    train_sources, test_sources = (set(lights.of(split).source.tolist()) for split in ("train", "test"))
    shared, warnings = train_sources & test_sources, []
    if shared and settings.split == "room":
        warnings.append(f"a single panorama ({shared.pop()}) gives training and test lights: they are not independent")
    if len(test_sources) < len(lights.of("test")):
        warnings.append(
            f"the {len(lights.of('test'))} test lights come from {len(test_sources)} panorama(s), the others from "
            f"{len(train_sources)}: lights of one panorama differ in heading and brightness alone"
        )
    return warnings


def concatenate(first: LightSet, second: LightSet) -> LightSet:
    """Appends the lights of `second` to those of `first`."""
    return LightSet(**{name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in vars(first)})
