"""The sections of the report: each verdict from scores that are made so that it must come out."""

import csv
import json

import numpy as np
import pytest
import yaml

from relight.config import CONF, Evaluate
from relight.evaluation.metrics import COLUMNS, SIGNS
from relight.evaluation.report.experiments import PARAGRAPHS, section
from relight.evaluation.report.results import Results
from relight.evaluation.scores import Scores, write_scores

SETTINGS = Evaluate(200, 2, 6, "test", "cpu", 0, 1)
FIGURES = [f"f{i}" for i in range(10)]
TRIVIAL = ("mean_figure", "mean_light", "nearest_light", "no_occlusion", "ao_occlusion", "cut_2", "cut_3")
LEVEL = {"shading": 0.3, "transport": 0.4, "light": 0.2, "albedo": 0.1}


def scores(seed: int, errors: dict[str, float], figures=FIGURES) -> Scores:
    """Scores about LEVEL where `errors` says nothing else; figures are hard or easy alike in every row."""
    rng = np.random.default_rng([seed, 1])
    hard = np.linspace(-0.03, 0.03, len(figures))[:, None]
    wanted = {column: next((v for k, v in LEVEL.items() if column.startswith(k)), 0.5) for column in COLUMNS}
    columns = {c: v + hard + rng.normal(0, 0.002, (len(figures), 3)) for c, v in (wanted | errors).items()}
    signs = {"shading_contrast": 0.9, "albedo_share": 0.4}
    return Scores(
        list(figures),
        [1, 2, 3],
        {**columns, **{s: columns.get(s, v + 0.3 * hard + np.zeros((1, 3))) for s, v in signs.items()}},
    )


def results(folder, preset: str, errors: dict[str, dict[str, float]], usual=None, sitting=FIGURES) -> Results:
    """A folder of results with the scores of a preset's rows: `errors` by row, `usual` those on the usual pairs."""
    one = yaml.safe_load((CONF / "experiment" / f"{preset}.yaml").read_text())
    (experiment,) = one["experiments"].values()
    experiment = {"figures": "test", "lights": "test", "axis": None, "table": True, "plates": False} | experiment
    experiment["plates"] = False
    rows, own = experiment["rows"], (experiment["figures"], experiment["lights"])
    files = {}
    for kind, on, wanted in (("usual", ("test", "test"), usual or errors), ("scores", own, errors)):
        place = folder / "evaluate" / "-".join(on)
        figures = sitting if on[0] == "sitting" else FIGURES
        made = {f"{row}.s0": scores(i, wanted.get(row, {}), figures) for i, row in enumerate(rows)} if figures else {}
        for name in (f"{row}.s0" for row in rows):
            write_scores(place / f"{name}.csv", {name: made[name]} if made else {})
        trivial = {name: scores(50 + i, wanted.get(name, {}), figures) for i, name in enumerate(TRIVIAL)}
        write_scores(place / "baselines.csv", trivial if figures else {})
        files[kind] = {row: [f"evaluate/{'-'.join(on)}/{row}.s0.csv"] for row in rows}
        files[kind][""] = [f"evaluate/{'-'.join(on)}/baselines.csv"]
    (folder / "split.json").write_text(json.dumps({"train": [f"t{i}" for i in range(40)], "test": FIGURES}))
    (folder / "config").mkdir(parents=True, exist_ok=True)
    (folder / "report").mkdir(exist_ok=True)
    for row in rows:
        words = dict(word.split("=") for word in one["sweep"]["runs"][row] if "." in word.split("=")[0])
        train = {"figures": int(words["train.figures"]) if "train.figures" in words else None, "part": "train"}
        model = {"width": float(words.get("model.width", 1)), "order": int(words.get("model.order", 2))}
        (folder / "config" / f"train.{row}.s0.yaml").write_text(yaml.safe_dump({"train": train, "model": model}))
    record = {**experiment, **files, "runs": {row: [f"{row}.s0"] for row in rows}}
    record["splits"] = dict.fromkeys(rows, "split.json")
    (folder / "experiments.json").write_text(json.dumps({preset: record}))
    return Results(folder, SETTINGS, folder / "experiments.json")


def paragraph(folder, preset: str, errors: dict[str, dict[str, float]], **options) -> str:
    return PARAGRAPHS[preset](results(folder, preset, errors, **options), preset)


@pytest.mark.parametrize("preset", PARAGRAPHS)
def test_every_section_is_made(tmp_path, preset):
    made = results(tmp_path, preset, {})
    found = section(made, preset)
    assert found.title == made.table(preset).title and "<table" in found.html and "paper" in found.html
    assert ("data:image/png" in found.html) == bool(made.experiments[preset]["axis"])


def test_what_is_not_in_the_data_is_said(tmp_path):
    made = results(tmp_path, "sitting", {}, sitting=[])
    assert "nothing to compare" in section(made, "sitting").html and made.table("sitting").rows == []


def test_sitting(tmp_path):
    worse = {"shading_rmse": 0.5}
    text = paragraph(
        tmp_path / "a", "sitting", {"ours_full": worse, "mean_figure": dict.fromkeys(LEVEL, 0)}, usual={"x": {}}
    )
    assert "**Ours (full)**, sitting against standing: shading RMSE (.5" in text and "worse by" in text
    assert "Ours plus**, sitting against standing: shading RMSE" in text and "not to be told apart" in text


def test_unusual_lights(tmp_path):
    lost = {"light_rmse": 0.4, "albedo_rmse": 0.2}
    errors = {
        "ours_full": lost,
        "ours_plus": lost,
        "nearest_light": {"light_rmse": 0.39},
        "ours_rich": {"light_rmse": 0.3},
    }
    text = paragraph(tmp_path / "a", "unusual_lights", errors, usual={"x": {}})
    assert "Light and albedo both fail, as in the paper" in text
    assert "does not even find the best of the training lights" in text
    assert "under unusual lights shading RMSE" in text and "light RMSE (.3" in text.split("remedy")[1]
    errors["ours_full"] = {"light_rmse": 0.2, "albedo_rmse": 0.1}
    text = paragraph(tmp_path / "b", "unusual_lights", errors, usual={"x": {}})
    assert "cannot be seen here" in text and "it does find more than a training light" in text


def test_silhouette_says_how_far_the_mask_goes(tmp_path):
    errors = {"silhouette": {"transport_rmse": 0.35}, "transport_only": {"transport_rmse": 0.2}}
    errors |= {"mean_figure": {"transport_rmse": 0.4, "shading_true_light_rmse": 0.4}}
    assert "goes 25 % of the way" in paragraph(tmp_path / "a", "silhouette", errors)
    assert "the silhouette does tell shape" in paragraph(tmp_path / "b", "silhouette", errors)
    text = paragraph(tmp_path / "c", "silhouette", {})
    assert "cannot be seen here" in text and "of the way" not in text


def test_self_supervised_measures_the_collapse(tmp_path):
    errors = {"self_all": {"shading_contrast": 0.3, "albedo_share": 0.9}, "self_encoder": {"shading_contrast": 0.3}}
    text = paragraph(tmp_path, "self_supervised", errors)
    own = {part.split("**")[0]: part for part in text.split("\n\n**")}
    assert (
        "it collapses as in the paper" in own["Everything fine-tuned"] and "share 90%" in own["Everything fine-tuned"]
    )
    assert "half of the collapse" in own["Encoder fine-tuned"]
    rising = {"ours_full": {"albedo_share": 0.1}, "self_all": {"albedo_share": 0.3}}  # less than the true albedo has
    assert "collapses" not in paragraph(tmp_path / "rising", "self_supervised", rising)
    assert "no collapse" in paragraph(tmp_path / "none", "self_supervised", {})


def test_data_size_and_order(tmp_path):
    falling = {"figures_8": 0.5, "figures_16": 0.4, "figures_32": 0.35, "figures_64": 0.3, "figures_128": 0.3}
    errors = {row: {"shading_rmse": value} for row, value in falling.items()}
    made = results(tmp_path / "a", "data_size", errors)
    section(made, "data_size")
    text = PARAGRAPHS["data_size"](made, "data_size")
    assert "From 8 to 40" in text and "shading RMSE (.3" in text and "better by" in text  # 40: all that there are
    errors = {"order_2": {"shading_rmse": 0.4}, "cut_2": {"shading_rmse": 0.2}, "cut_3": {"shading_rmse": 0.1}}
    text = paragraph(tmp_path / "b", "order", errors)
    assert (
        "25 % of the squared error of Ours, order 2" in text
        and "**Order 3 against 2** (16 coefficients against 9)" in text
    )


def test_splits(tmp_path):
    errors = {"ours_siblings": {"shading_rmse": 0.2, "albedo_rmse": 0.05}}
    text = paragraph(tmp_path, "splits", errors)
    assert "A random split flatters 2 of these errors" in text


def test_signs_are_in_the_scores(tmp_path):
    write_scores(tmp_path / "a.csv", {"one": scores(0, {})})
    with open(tmp_path / "a.csv", newline="") as file:
        assert set(SIGNS) <= set(next(csv.DictReader(file)))
