import json

import numpy as np
import pytest

from relight.core.errors import UserError
from relight.core.srgb import decode, encode
from relight.evaluation.pictures.panels import Shown, plates, swapped
from relight.evaluation.scoring.baselines import evaluate_baselines, make_predictors
from relight.evaluation.scoring.evaluate import evaluate, infer, inferred_maps, load, unlearned
from relight.evaluation.scoring.scores import read_scores
from relight.learning.checkpoint import load_network
from relight.learning.data import RelitSet
from relight.learning.predict import predict
from relight.maps import read_maps
from relight.settings import composed
from relight.settings.scores import BASELINES
from relight.sh import unoccluded


@pytest.fixture(scope="module")
def checkpoints(small_network, tmp_path_factory):
    folder, paths = tmp_path_factory.mktemp("networks"), {}
    for name in ("ours", "sfsnet", "sfsnet_ao"):
        paths[name] = folder / f"{name}.s0.safetensors"
        small_network(paths[name], name, "photo" if name == "ours" else "paper")
    return paths


@pytest.mark.parametrize("name", ["ours", "sfsnet", "sfsnet_ao"])
def test_evaluate_agrees_with_predictions_one_at_a_time(name, checkpoints, world, tmp_path):
    out = tmp_path / f"{name}.s0.csv"
    evaluate(checkpoints[name], world.packed, world.lights, world.split, world.condition, out)
    scores = read_scores(out)[f"{name}.s0"]
    assert scores.figures == ["snowman03", "snowman04", "snowman05"] and scores.lights == [4, 5]
    network, _ = load_network(checkpoints[name])
    lights = np.load(world.lights)["coefficients"]
    for f, path in enumerate(world.maps[3:]):
        maps = read_maps(path)
        albedo = maps.albedo
        if name != "ours":  # color=paper: 8-bit sRGB codes as if linear
            albedo = np.round(encode(albedo) * 255) / 255 * maps.mask[..., None]
        for l, light in enumerate(lights[4:]):
            image = albedo * np.maximum(maps.transport @ light, 0)
            if name == "ours":  # color=photo: clipped, 8-bit sRGB
                image = decode(np.round(encode(image) * 255) / 255)
            found = predict(network, image, maps.mask)
            occlusion = found["ao"] if "ao" in found else 1
            transport = found["transport"] if name == "ours" else unoccluded(found["normal"])
            shading = np.maximum((transport * occlusion) @ found["light"], 0)
            expected = {"albedo": (found["albedo"], albedo), "transport": (transport, maps.transport)}
            expected["shading"] = shading, np.maximum(maps.transport @ light, 0)
            for quantity, (a, b) in expected.items():
                error = np.sqrt((((a - b) ** 2).sum(-1)[maps.mask]).mean())
                assert scores.columns[f"{quantity}_rmse"][f, l] == pytest.approx(error, rel=2e-3), quantity
            error = np.sqrt(((found["light"] - light) ** 2).mean())
            assert scores.columns["light_rmse"][f, l] == pytest.approx(error, rel=1e-3)
    assert ("transport_with_ao_rmse" in scores.columns) == (name == "sfsnet_ao")
    assert ("normal_rmse" in scores.columns) == (name != "ours")


def test_evaluate_and_plates_without_figures_or_lights(checkpoints, world, tmp_path):
    parts = {"train": ["snowman00"], "test": ["snowman03"], "sitting": ["snowman04"]}
    for name, split in (("some", parts), ("none", parts | {"sitting": []})):
        (tmp_path / f"{name}.json").write_text(json.dumps(split))

    def scored(split, condition):
        out, given = tmp_path / "ours.csv", (world.packed, world.lights, tmp_path / split, condition)
        evaluate(checkpoints["ours"], *given, out)
        evaluate_baselines(*given, tmp_path / "baselines.csv")
        for draw in (plates, swapped):  # nobody, or one person alone: the sheet says so
            draw(Shown({"ours": checkpoints["ours"]}, *given), tmp_path / "p.png")
        assert bool(read_scores(tmp_path / "baselines.csv")) == bool(read_scores(out)) and (tmp_path / "p.png").exists()
        return read_scores(out)

    assert scored("some.json", "sitting-test")["ours"].figures == ["snowman04"]
    assert scored("none.json", "sitting-test") == {} and scored("some.json", "test-unusual") == {}


def test_unlearned_outputs_are_replaced_by_the_truth(checkpoints, world, tmp_path, monkeypatch):
    made_with = {"model": None, "train": {"color": "paper"}, "loss": composed(["loss=transport"]).loss}
    network, _ = load_network(checkpoints["ours"])
    monkeypatch.setattr("relight.evaluation.scoring.evaluate.load_network", lambda path, device: (network, made_with))
    out = tmp_path / "ours.csv"
    evaluate(checkpoints["ours"], world.packed, world.lights, world.split, world.condition, out)
    columns = read_scores(out)["ours"].columns
    assert not [name for name in columns if name.startswith(("albedo_r", "albedo_ss", "light", "sphere"))]
    np.testing.assert_array_equal(columns["shading_rmse"], columns["shading_true_light_rmse"])
    assert not unlearned(composed(["loss=self_supervised"]).loss) and not unlearned(composed().loss)
    for also in ("loss.relit=1", "loss.detail=1", "loss.exclusion=1"):
        assert unlearned(composed(["loss=transport", also]).loss) == {"light"}
    assert not unlearned({"transport": 1.0, "extra": {"mine": 1.0}})


def test_infer_in_batches_equals_one_batch(checkpoints, world, monkeypatch):
    network, _ = load_network(checkpoints["sfsnet_ao"])
    data = RelitSet(world.packed, world.lights, 2, "paper")
    together = infer(network, data, 0, np.arange(6))
    monkeypatch.setattr("relight.evaluation.scoring.evaluate.BATCH_PIXELS", 2 * 64**2)
    apart = infer(network, data, 0, np.arange(6))
    for name in ("albedo", "transport", "normal", "ao", "light"):
        np.testing.assert_allclose(getattr(together, name), getattr(apart, name), atol=1e-5)


def test_make_predictors_of_each_baseline(world, tmp_path):
    out = tmp_path / "baselines.csv"
    evaluate_baselines(world.packed, world.lights, world.split, world.condition, out, color="photo")
    scores = read_scores(out)
    assert [*scores] == [*BASELINES]
    lights = np.load(world.lights)["coefficients"]
    error = np.sqrt(((lights[:4].mean(0) - lights[4]) ** 2).mean())
    assert scores["mean_light"].columns["light_rmse"][0, 0] == pytest.approx(error, rel=1e-5)
    nearest = min(np.sqrt(((train - lights[5]) ** 2).mean()) for train in lights[:4])
    assert scores["nearest_light"].columns["light_rmse"][1, 1] == pytest.approx(nearest, rel=1e-5)
    # The world's transport is AO * T(normal): with both true nothing is left but half floats, without AO much is.
    assert scores["ao_occlusion"].columns["shading_rmse"].max() < 3e-3
    maps = read_maps(world.maps[3])
    ao = np.concatenate([maps.ao[maps.mask] for maps in map(read_maps, world.maps[:3])]).mean()
    for name, occlusion in (("no_occlusion", 1), ("mean_occlusion", ao)):
        error = (occlusion * unoccluded(maps.normal) - maps.transport)[maps.mask]
        expected = np.sqrt((error**2).sum(-1).mean())
        assert scores[name].columns["transport_rmse"][0] == pytest.approx(expected, rel=2e-3)
    assert "transport_rmse" not in scores["mean_light"].columns and "light_rmse" not in scores["no_occlusion"].columns


def test_mean_figure_at_pixels_that_few_figures_cover(world):
    data = RelitSet(world.packed, world.lights, 2, "photo")
    train = [read_maps(path) for path in world.maps[:3]]
    count = np.sum([maps.mask for maps in train], 0)
    mean = np.sum([maps.albedo for maps in train], 0) / np.maximum(count, 1)[..., None]
    everywhere = np.concatenate([maps.albedo[maps.mask] for maps in train]).mean(0)
    inside = np.zeros_like(train[0].mask)
    for figure in (3, 4, 5):
        mask = read_maps(world.maps[figure]).mask
        inside |= mask
        found = make_predictors(data, world.split)["mean_figure"](figure, np.array([4, 5]))
        expected = np.where(count[..., None] > 0, mean, everywhere)[mask]
        np.testing.assert_allclose(found.albedo[0], expected, atol=5e-3)  # packed as 8-bit sRGB
        np.testing.assert_allclose(np.linalg.norm(found.normal, axis=-1), 1, rtol=1e-5)
    assert (count[inside] == 0).any() and (count[inside] == 2).any()


def test_evaluate_refuses_broken_inputs(checkpoints, world, tmp_path):
    arguments = [checkpoints["ours"], world.packed, world.lights, world.split, world.condition, tmp_path / "out.csv"]
    (tmp_path / "empty.json").write_text(json.dumps({"train": ["snowman00"], "test": ["nobody"]}))
    with pytest.raises(UserError, match="0 test figures"):
        evaluate(*arguments[:3], tmp_path / "empty.json", *arguments[4:])
    with pytest.raises(UserError, match="no file"):
        evaluate(tmp_path / "missing.safetensors", *arguments[1:])
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(("name", "color"), [("sfsnet_ao", "paper"), ("ours", "photo")])
def test_inferred_maps_inside_the_mask(world, small_network, tmp_path, name, color):
    small_network(tmp_path / "a.safetensors", name, color)
    network, data = load(tmp_path / "a.safetensors", world.packed, world.lights)
    true = read_maps(world.maps[4])
    found, raw = inferred_maps(network, data, 5, true), infer(network, data, 4, np.array([5]))
    transport = raw.transport[0] * (raw.ao[0][:, None] if raw.occlude else 1)
    np.testing.assert_array_equal(found.transport[true.mask], transport)
    np.testing.assert_allclose(found.ao[true.mask], np.clip(transport[:, 0] / 0.886227, 0, 1), atol=1e-6)
    albedo = decode(raw.albedo[0]) if color == "paper" else raw.albedo[0]
    np.testing.assert_allclose(found.albedo[true.mask], albedo, atol=1e-6)
    assert found.normal.any() == (name == "sfsnet_ao") and found.info == true.info
    for dense in (found.transport, found.albedo, found.normal, found.ao):
        assert not dense[~true.mask].any() and dense.dtype == np.float32
