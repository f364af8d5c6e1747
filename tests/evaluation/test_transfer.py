"""Light transfer against a twin that swaps one pair at a time, by hand."""

import numpy as np
import pytest
from PIL import Image

from relight.core.errors import UserError
from relight.evaluation.experiments.transfer import (
    BASELINES,
    VARIANTS,
    evaluate_transfer,
    mean_light,
    pair_up,
    score_swaps,
    transfer_plate,
)
from relight.evaluation.pictures.panels import evenly_spaced
from relight.evaluation.scoring.evaluate import truth
from relight.evaluation.scoring.scores import read_scores
from relight.evaluation.scoring.truth import Inferred
from relight.learning.data import RelitSet


def drawn_answer(data, figure, lit, occlude=False):
    """Maps and lights at random, the same for the same figure and light."""
    count, parts = int(data.counts[figure]), []
    for light in lit:
        rng = np.random.default_rng([figure, int(light)])
        parts.append([rng.random((count, c)).astype(np.float32) for c in (3, 9, 1)] + [rng.normal(1, 0.4, (9, 3))])
    albedo, transport, ao, light = (np.stack(column).astype(np.float32) for column in zip(*parts))
    return Inferred(albedo, transport, ao=ao[..., 0] if occlude else None, light=light, occlude=occlude)


@pytest.mark.parametrize("occlude", [False, True])
def test_score_swaps_agrees_with_swaps_by_hand(world, occlude):
    """Each light is in one swap alone: swaps that share a light are not independent samples, as intervals assume."""
    data = RelitSet(world.packed, world.lights, 2, "paper")
    data.light_split = np.array(["train", *5 * ["test"]])
    scores = score_swaps(lambda f, lit: drawn_answer(data, f, lit, occlude), data, world.split)
    a, b = data.figures(["snowman03", "snowman04"])
    assert scores[""].figures == ["snowman03+snowman04"]  # the third test figure has no partner
    assert scores[""].lights == [1, 3]  # nor has the fifth light
    lights, mean = data.lights.numpy(), mean_light(data)[0]
    for place, (l, m) in enumerate([(1, 2), (3, 4)]):
        errors = {name: [] for name in scores}
        for own, other, seen, new in ((a, b, l, m), (b, a, m, l), (a, b, m, l), (b, a, l, m)):
            true = truth(data, own, np.array([new]))
            albedo, transport = true.maps["albedo"][0], true.maps["transport"][0]
            said = drawn_answer(data, own, [seen], occlude)
            told = drawn_answer(data, other, [new], occlude).light[0]
            mine = said.albedo[0], said.transport[0] * (said.ao[0][:, None] if occlude else 1)
            made = {
                "": (*mine, told),
                "true_light": (*mine, lights[new]),
                "true_maps": (albedo, transport, told),
                "mean_light": (*mine, mean),
                "as_it_is": (albedo, transport, lights[seen]),
                "true_maps_mean_light": (albedo, transport, mean),
            }
            goal = albedo * np.maximum(transport @ lights[new], 0)
            for name, (color, vectors, light) in made.items():
                picture = color * np.maximum(vectors @ light, 0)
                errors[name].append(np.sqrt(((picture - goal) ** 2).sum(-1).mean()))
        for name, pair in errors.items():
            found = scores[name].columns["reconstruction_rmse"][0, place]
            assert found == pytest.approx(np.mean(pair), rel=1e-4), name


@pytest.mark.slow
def test_evaluate_transfer_and_transfer_plate(world, small_network, tmp_path):
    networks = {}
    for name in ("ours", "sfsnet_ao"):
        networks[f"{name}.s0"] = tmp_path / f"{name}.safetensors"
        small_network(networks[f"{name}.s0"], name, "photo")
    given = world.packed, world.lights, world.split
    evaluate_transfer(networks, *given, tmp_path / "scores.csv")
    scores = read_scores(tmp_path / "scores.csv")
    rows = [f"{row}{':' * bool(v)}{v}.s0" for row in ("ours", "sfsnet_ao") for v in VARIANTS]
    assert list(scores) == [*rows, *BASELINES]
    assert scores["ours:true_light.s0"].columns["light_rmse"].max() < 1e-6
    shown = {name.partition(".")[0]: path for name, path in networks.items()}
    transfer_plate(shown, *given, tmp_path / "plate.png")
    sheet = Image.open(tmp_path / "plate.png")
    assert sheet.height > 2 * 300  # one pair, both ways
    first = (tmp_path / "plate.png").read_bytes()
    transfer_plate(shown, *given, tmp_path / "plate.png")
    assert (tmp_path / "plate.png").read_bytes() == first


@pytest.mark.parametrize(
    ("people", "pairs"),
    [("abcde", "ab cd"), ("aabb", "ab ab"), ("ababcc", "ab ab"), ("aaabcccd", "ab cd"), ("aaaaa", "aa aa")],
)
def test_pairs_are_of_two_people_where_there_are_two(people, pairs):
    found = pair_up(np.arange(len(people)), list(people))
    assert [people[a] + people[b] for a, b in found] == pairs.split() and len({*sum(found, ())}) == 2 * len(found)


def test_score_swaps_without_a_pair(world):
    with pytest.raises(UserError, match="two test figures"):
        pair_up(np.array([3]), list("abcd"))
    data = RelitSet(world.packed, world.lights, 2, "paper")
    data.light_split = np.array(["train"] * 5 + ["test"])
    with pytest.raises(UserError, match="two test lights"):
        score_swaps(lambda f, lit: drawn_answer(data, f, lit), data, world.split)
    assert evenly_spaced(7, 3) == [0, 3, 6] and evenly_spaced(1, 4) == [0]
