"""Light transfer (paper, section 7.2): two people in two lights, each relit by the light inferred from the other.

Test figures a, b are paired and seen under test lights l, m. From the picture of a under l and that of b under m a
network infers maps and lights; a is relit by the light of b, b by that of a, and the results are compared with the true
a under m and b under l. What a number is worth shows beside it: each network's maps and lights are also put together
with the true ones and with the mean training light, and the pictures are left as they are.
"""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from relight import config
from relight.evaluation.evaluate import Predictor, chosen_pairs, infer, load, truth
from relight.evaluation.labels import label
from relight.evaluation.metrics import Inferred, Truth, light_errors, shade
from relight.evaluation.panels import Line, Subject, View, draw, spaced
from relight.evaluation.scores import Scores, write_scores
from relight.files import UserError
from relight.learning.data import RelitSet
from relight.progress import progress
from relight.run_name import RunName

# What a figure is relit with, of what was inferred from its own picture (maps) and from its partner's (light).
VARIANTS = {
    "": "inferred maps, inferred light",
    "true_light": "inferred maps, true light",
    "true_maps": "true maps, inferred light",
    "true_colour": "inferred maps, inferred light with the true light's colour and strength",
    "true_pattern": "inferred maps, true light with the inferred light's colour and strength",
    "mean_light": "inferred maps, mean training light",
}
# Answers without a network.
TRIVIAL = {
    "as_it_is": "the picture as it is",
    "true_maps_mean_light": "true maps, mean training light",
}
WORST = 0.5  # error of a picture (vector norm) at the dark end of the scale
DARK = 1e-3  # a light's mean is taken to be this at least where its colour is exchanged


@dataclass
class Side:
    """One of two partners under N lights: its truth, and what is inferred of it under each."""

    truth: Truth
    inferred: Inferred

    def maps(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Albedo (N,P,3) and transport (N,P,K) whose row k was inferred under light k - step."""
        albedo, transport, light = self.truth.complete(self.inferred)

        def shifted(values: np.ndarray) -> np.ndarray:
            return np.roll(np.broadcast_to(values, (len(light), *values.shape[1:])), step, 0)

        return shifted(albedo), shifted(transport)


def evaluate_transfer(
    networks: dict[str, Path], packed: Path, lights: Path, split: Path, settings: config.Evaluate, out: Path
) -> None:
    """Scores networks whose figures swap lights, their VARIANTS, and what is TRIVIAL.

    The unit is a swap: "figure" is a pair a+b, "light" the index of the light l of a, and the scores of the two relit
    pictures are averaged, since both come from the same two pictures. `reconstruction` is the relit picture, before the
    camera.

    Args:
        networks: `row.s<seed>` -> checkpoint.
        packed, lights, split: the data set.
        settings: which lights, and the device.
        out: the scores (.csv); a variant is called `row:variant.s<seed>`.

    Raises:
        UserError: there are fewer than two figures or lights.
    """
    scores: dict[str, Scores] = {}
    trivial: dict[str, Scores] = {}
    for name, checkpoint in progress(list(networks.items()), "networks that swap lights"):
        network, data = load(checkpoint, packed, lights, settings)
        training = RunName.parse(name)
        found = score_swaps(partial(infer, network, data), data, split, settings)
        trivial = {name: found.pop(name) for name in TRIVIAL}
        for variant, one in found.items():
            scores[str(replace(training, run=f"{training.run}:{variant}")) if variant else name] = one
    write_scores(out, {**scores, **trivial})


def score_swaps(predictor: Predictor, data: RelitSet, split: Path, settings: config.Evaluate) -> dict[str, Scores]:
    """The scores of a predictor's VARIANTS and of what is TRIVIAL, a row per pair of figures, a column per swap."""
    figures, lit = chosen_pairs(data, split, settings.lights)
    pairs = couples(figures)
    if len(lit) < 2:
        raise UserError("light transfer needs two test lights at least, and the set has one: raise lights.test")
    parts: dict[str, list[dict[str, np.ndarray]]] = {}
    for pair in progress(pairs, "pairs of figures"):
        a, b = (Side(truth(data, f, lit), predictor(f, lit)) for f in pair)
        there, back = (swapped(*sides, mean_light(data), step) for sides, step in (((a, b), 1), ((b, a), -1)))
        for name in there:
            # a goes from light l to m = l + 1, b from m to l: both belong to the swap of l.
            first, second = compare(a.truth, *there[name]), compare(b.truth, *back[name])
            parts.setdefault(name, []).append({key: (np.roll(first[key], -1) + second[key]) / 2 for key in first})
    names = ["+".join(data.names[f] for f in pair) for pair in pairs]
    return {
        name: Scores(names, lit.tolist(), {key: np.stack([one[key] for one in rows]) for key in rows[0]})
        for name, rows in parts.items()
    }


def couples(figures: np.ndarray) -> list[tuple[int, int]]:
    """Neighbours in pairs; the last of an odd number stays alone. UserError when there is no pair."""
    if len(figures) < 2:
        raise UserError("light transfer needs two test figures at least: raise split.test or figures.count")
    return [(int(a), int(b)) for a, b in zip(figures[::2], figures[1::2])]


def mean_light(data: RelitSet) -> np.ndarray:
    """The mean (1,K,3) of the lights marked `train`."""
    return data.lights.cpu().numpy()[data.light_split == "train"].mean(0, keepdims=True)


def swapped(a: Side, b: Side, mean: np.ndarray, step: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Relights a figure by the light that was inferred from its partner.

    Args:
        a: the figure, in row k seen under light k - step (cyclic).
        b: its partner, in row k seen under light k.
        mean: (1,K,3), the mean training light.
        step: 1 or -1.

    Returns:
        For each of VARIANTS and TRIVIAL the picture (N,P,3) of a, which should show it under light k, and the light
        (N,K,3) that it was relit with.
    """
    true, (_, _, found) = a.truth.lights, b.truth.complete(b.inferred)
    own, given = a.maps(step), (a.truth.maps["albedo"], a.truth.transport)
    put = {
        "": (own, found),
        "true_light": (own, true),
        "true_maps": (given, found),
        "true_colour": (own, coloured(found, true)),
        "true_pattern": (own, coloured(true, found)),
        "mean_light": (own, np.repeat(mean, len(true), 0)),
        "as_it_is": (given, np.roll(true, step, 0)),
        "true_maps_mean_light": (given, np.repeat(mean, len(true), 0)),
    }
    return {name: (albedo * shade(transport, light), light) for name, ((albedo, transport), light) in put.items()}


def coloured(light: np.ndarray, other: np.ndarray) -> np.ndarray:
    """`light` (N,K,3), each channel scaled to the mean radiance of `other`'s: its pattern in the other's colour."""
    return light * (np.maximum(other[:, :1], DARK) / np.maximum(light[:, :1], DARK))


def compare(true: Truth, picture: np.ndarray, light: np.ndarray) -> dict[str, np.ndarray]:
    """The errors (N,) of the relit picture and of the light."""
    return {**true.compare("reconstruction", picture), **light_errors(light, true.lights)}


def transfer_plate(
    networks: dict[str, Path], packed: Path, lights: Path, split: Path, settings: config.Evaluate, out: Path
) -> None:
    """Draws swaps, two rows each: input, relit by each network, its error, the truth.

    Args:
        networks: row -> checkpoint.
        packed, lights, split: the data set.
        settings: `plates`, how many swaps; their pairs are spread over the test set, each with lights of its own.
        out: the picture (.png).
    """
    lines: list[Line] = []
    for checkpoint in networks.values():
        network, data = load(checkpoint, packed, lights, settings)
        figures, lit = chosen_pairs(data, split, settings.lights)
        pairs = couples(figures)
        pairs = [pairs[i] for i in spaced(len(pairs), settings.plates)]
        swaps = [lit[[i % len(lit), (i + 1) % len(lit)]] for i in range(len(pairs))]
        if not lines:
            subjects = [Subject.of(data, f, two) for pair, two in zip(pairs, swaps) for f in pair]
            lines = [Line(s.name, s, [s.picture(i % 2)], i % 2 == 0) for i, s in enumerate(subjects)]
        for i, (pair, two) in enumerate(zip(pairs, swaps)):
            sides = [Side(truth(data, f, two), infer(network, data, f, two)) for f in pair]
            for own in (0, 1):  # the light that the figure was seen in; it goes to the other
                pictures, found = swapped(sides[own], sides[1 - own], mean_light(data), 1)[""]
                error = pictures[1 - own] - sides[own].truth.maps["reconstruction"][1 - own]
                relit = View(pictures[1 - own], light=found[1 - own])
                lines[2 * i + own].views += [relit, View(error=np.linalg.norm(error, axis=-1))]
    for i, line in enumerate(lines):
        line.views.append(line.subject.picture(1 - i % 2))
    heads = ["input", *(h for name in networks for h in (f"relit by {label(name)}", "its error")), "truth"]
    words = (
        "Two figures in two lights, each relit by the light inferred from the other's picture. The spheres show the "
        "light of each picture: the true one in input and truth, the inferred one where it was relit."
    )
    draw(heads, lines, WORST, words).save(out)
