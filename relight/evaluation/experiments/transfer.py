"""Light transfer (paper, section 7.2): two people in two lights, each relit by the light inferred from the other.

Test figures a and b are seen under test lights l and m. From the picture of a under l and that of b under m, a network
infers maps and lights. Then a is relit by the light inferred from b, and b by that from a. The results are compared
with the true pictures of a under m and of b under l. To separate the causes of the error, inferred maps and lights are
also combined with true ones and with the mean training light. The unchanged pictures are a baseline.

The lights 2k and 2k + 1 are those of a swap. If a light were in two swaps, these would not be independent.
"""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.progress import progress
from relight.evaluation.pictures.panels import PLATE_FIGURES, Cell, Line, Subject, draw, evenly_spaced
from relight.evaluation.scoring.evaluate import Predictor, infer, load, select_pairs, truth
from relight.evaluation.scoring.labels import label
from relight.evaluation.scoring.scores import Scores, write_scores
from relight.evaluation.scoring.truth import Inferred, Truth, light_errors
from relight.learning.data import RelitSet
from relight.learning.training_name import TrainingName
from relight.photos.shading import shade

# The maps and the light of a relit picture. Inferred maps are from the figure's own picture, lights from its partner's.
VARIANTS = {
    "": "inferred maps, inferred light",
    "true_light": "inferred maps, true light",
    "true_maps": "true maps, inferred light",
    "mean_light": "inferred maps, mean training light",
}
# Predictions without a network.
BASELINES = {"as_it_is": "the picture as it is", "true_maps_mean_light": "true maps, mean training light"}


@dataclass
class Partner:
    """One of two figures that swap lights: its truth under N lights, and what is inferred under each."""

    truth: Truth
    inferred: Inferred


def other(rows: np.ndarray) -> np.ndarray:
    """Returns rows (N,...), one for each light, with those of a swap's two lights exchanged."""
    return rows[np.arange(len(rows)) ^ 1]


def evaluate_transfer(networks: dict[str, Path], packed: Path, lights: Path, split: Path, out: Path) -> None:
    """Scores networks on swaps of lights, with VARIANTS and BASELINES.

    A row of the scores is a swap: "figure" is the pair a+b, and "light" the index of the first light. The scores of
    four relit pictures are averaged: both figures, each under both lights. `reconstruction` is the relit picture before
    it is clipped and quantised.

    Args:
        networks: `row.s<seed>` -> checkpoint.
        packed, lights, split: the data set.
        out: the scores (.csv); variants are named `row:variant.s<seed>`.

    Raises:
        UserError: if there are fewer than two figures or lights.
    """
    scores: dict[str, Scores] = {}
    baselines: dict[str, Scores] = {}
    for name, checkpoint in progress(list(networks.items()), "networks that swap lights"):
        network, data = load(checkpoint, packed, lights)
        training = TrainingName.parse(name)
        by_variant = score_swaps(partial(infer, network, data), data, split)
        baselines = {name: by_variant.pop(name) for name in BASELINES}
        for variant, swaps in by_variant.items():
            scores[str(replace(training, row=f"{training.row}:{variant}")) if variant else name] = swaps
    write_scores(out, {**scores, **baselines})


def score_swaps(predictor: Predictor, data: RelitSet, split: Path) -> dict[str, Scores]:
    """Scores a predictor on swaps of lights between test figures. Raises UserError if there are fewer than two of each.

    Returns:
        Name of VARIANTS or BASELINES -> scores (F,L) of the F pairs, a+b, and the L swaps, by the index of the first
        light. Of an odd number of lights the last is left out.
    """
    figures, test_lights = select_pairs(data, split)
    pairs = pair_up(figures, data.subject_of)
    if len(test_lights) < 2:
        raise UserError("light transfer needs two test lights at least, and the set has one: raise lights.test")
    test_lights, mean = test_lights[: len(test_lights) // 2 * 2], mean_light(data)
    by_variant: dict[str, list[dict[str, np.ndarray]]] = {}  # for each pair, its errors (L,) by column
    for pair in progress(pairs, "pairs of figures"):
        a, b = (Partner(truth(data, figure, test_lights), predictor(figure, test_lights)) for figure in pair)
        relit_a, relit_b = _relight_swapped(a, b, mean), _relight_swapped(b, a, mean)
        for variant in relit_a:
            errors_a, errors_b = _errors(a.truth, *relit_a[variant]), _errors(b.truth, *relit_b[variant])
            by_light = {column: (errors_a[column] + errors_b[column]) / 2 for column in errors_a}
            errors = {column: values.reshape(-1, 2).mean(1) for column, values in by_light.items()}
            by_variant.setdefault(variant, []).append(errors)
    names = ["+".join(data.names[figure] for figure in pair) for pair in pairs]
    return {variant: Scores.stack(names, test_lights[::2], errors) for variant, errors in by_variant.items()}


def pair_up(figures: np.ndarray, subject_of: list[str]) -> list[tuple[int, int]]:
    """Pairs the figures (F,) of neighbouring people, each of whom is in pairs with one other person alone.

    `subject_of` has the person of every map. Of an odd number the last is left out; one person is paired with itself.
    Raises UserError if there is no pair.
    """
    if len(figures) < 2:
        raise UserError("light transfer needs two test figures at least: raise split.test or figures.count")
    people: dict[str, list[int]] = {}
    for figure in figures.tolist():
        people.setdefault(subject_of[figure], []).append(figure)
    groups = list(people.values()) if len(people) > 1 else [figures[::2].tolist(), figures[1::2].tolist()]
    return [pair for a, b in zip(groups[::2], groups[1::2]) for pair in zip(a, b)]


def mean_light(data: RelitSet) -> np.ndarray:
    """Returns the mean (1,K,3) of the training lights."""
    return data.lights.cpu().numpy()[data.light_split == "train"].mean(0, keepdims=True)


def _relight_swapped(a: Partner, b: Partner, mean: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Relights figure `a` by the light that was inferred from its partner `b`.

    For each light, `b` was seen under it, and `a` under the other light of the swap; `mean` (1,K,3) is the mean
    training light. Returns the pictures (N,P,3) of `a` and the lights (N,K,3) that relit them, for each of VARIANTS and
    BASELINES.
    """
    true, (_, _, inferred) = a.truth.lights, b.truth.complete(b.inferred)
    true_maps, maps = (a.truth.maps["albedo"], a.truth.transport), a.truth.complete(a.inferred)[:2]
    inferred_maps = tuple(other(np.broadcast_to(values, (len(true), *values.shape[1:]))) for values in maps)
    mean_lights = np.repeat(mean, len(true), 0)
    combinations = {
        "": (inferred_maps, inferred),
        "true_light": (inferred_maps, true),
        "true_maps": (true_maps, inferred),
        "mean_light": (inferred_maps, mean_lights),
        "as_it_is": (true_maps, other(true)),
        "true_maps_mean_light": (true_maps, mean_lights),
    }
    return {name: (maps[0] * shade(maps[1], light), light) for name, (maps, light) in combinations.items()}


def _errors(true: Truth, picture: np.ndarray, light: np.ndarray) -> dict[str, np.ndarray]:
    """Returns the errors (N,) of relit pictures (N,P,3) and of their lights (N,K,3) by column of the scores."""
    return {**true.compare("reconstruction", picture), **light_errors(light, true.lights)}


def transfer_plate(networks: dict[str, Path], packed: Path, lights: Path, split: Path, out: Path) -> None:
    """Draws swaps in two rows each: input, relit by each network with its error, truth.

    Args:
        networks: row -> checkpoint.
        packed, lights, split: the data set.
        out: the picture (.png), of swaps that are evenly spaced over the test set, each with its own two lights.
    """
    lines: list[Line] = []
    for checkpoint in networks.values():
        network, data = load(checkpoint, packed, lights)
        figures, test_lights = select_pairs(data, split)
        pairs = pair_up(figures, data.subject_of)
        pairs = [pairs[i] for i in evenly_spaced(len(pairs), PLATE_FIGURES)]
        swaps = [test_lights[[i % len(test_lights), (i + 1) % len(test_lights)]] for i in range(len(pairs))]
        if not lines:  # two for each pair: the first figure is seen under the first light, the second under the second
            for pair, swap in zip(pairs, swaps):
                for own_light, figure in enumerate(pair):
                    subject = Subject.of(data, figure, swap)
                    lines.append(Line(subject.name, subject, [subject.picture(own_light)], first=own_light == 0))
        for i, (pair, swap) in enumerate(zip(pairs, swaps)):
            partners = [Partner(truth(data, figure, swap), infer(network, data, figure, swap)) for figure in pair]
            for own_light, new_light in ((0, 1), (1, 0)):
                partner = partners[own_light]
                pictures, inferred_lights = _relight_swapped(partner, partners[new_light], mean_light(data))[""]
                error = pictures[new_light] - partner.truth.maps["reconstruction"][new_light]
                relit = Cell(pictures[new_light], light=inferred_lights[new_light])
                lines[2 * i + own_light].views += [relit, Cell(error=np.linalg.norm(error, axis=-1))]
    for i, line in enumerate(lines):
        line.views.append(line.subject.picture(1 - i % 2))  # under the other light
    heads = ["input", *(head for name in networks for head in (f"relit by {label(name)}", "its error")), "truth"]
    words = (
        "Two figures in two lights, each relit by the light inferred from the other's picture. The spheres show the "
        "light of each picture: the true one in input and truth, the inferred one where it was relit."
    )
    draw(heads, lines, words).save(out)
