"""Tables and sections of the experiments that are no table of trainings."""

import csv
import json

import numpy as np
import pytest
from PIL import Image

from relight.evaluation.experiments.transfer import BASELINES, VARIANTS
from relight.evaluation.report import own, page
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.comparisons import Verdict
from relight.evaluation.scoring.scores import Scores, write_scores


@pytest.fixture
def results(tmp_path):
    runs = {"ours_full": ["ours_full.s0", "ours_full.s1"]}
    experiments = {"light_transfer": {"trainings": runs, "title": "", "question": "How?", "about": "So."}}
    (tmp_path / "light_transfer").mkdir()
    Image.new("RGB", (9, 9)).save(tmp_path / "light_transfer" / "plate.png")
    (tmp_path / "report").mkdir()
    (tmp_path / "figures.json").write_text('{"figures": {}}')
    return Results(tmp_path, experiments, tmp_path)


def test_light_transfer_section(results):
    """Swapping beats the picture as it is by .05 +- .001 on every pair; the maps cost more than the light."""
    rng = np.random.default_rng(0)
    hard = rng.uniform(0, 0.1, (8, 1))

    def scores(level):
        error = level + hard + rng.normal(0, 0.001, (8, 4))
        columns = {"reconstruction_rmse": error, "reconstruction_ssim": 1 - error, "light_rmse": error}
        return Scores([f"a{i}+b{i}" for i in range(8)], [3, 4, 5, 6], columns)

    levels = {"": 0.1, "true_light": 0.09, "true_maps": 0.02, "mean_light": 0.1}
    assert set(levels) == set(VARIANTS)
    rows = {f"ours_full{':' * bool(v)}{v}.s{s}": scores(level) for v, level in levels.items() for s in (0, 1)}
    rows |= {"as_it_is": scores(0.15), "true_maps_mean_light": scores(0.03)}
    write_scores(results.folder / "light_transfer" / "scores.csv", rows)
    made = own.light_transfer(results, "light_transfer")
    verdicts = list(made["comparisons"].frame["the first is"])
    assert verdicts[0] is Verdict.BETTER and verdicts[2] is Verdict.WORSE
    assert verdicts[1] not in (Verdict.BETTER, Verdict.WORSE)
    assert list(made["comparisons"].frame.index) == [f"Ours (full) {what}" for what in own.SWAPS]
    assert page.section("sections/experiment.md", **made).count("<table") == 2
    with open(results.report / "light_transfer.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(VARIANTS) + len(BASELINES)
    assert float(table[1]["relit, RMSE"]) == pytest.approx(0.09 + hard.mean(), abs=1e-3)
    two = {f"{person}{i}": {"subject": person} for person in "ab" for i in range(8)}
    (results.folder / "figures.json").write_text(json.dumps({"figures": two}))
    made = own.light_transfer(Results(results.folder, results.experiments, results.data), "light_transfer")
    assert set(made["comparisons"].frame["the first is"]) == {Verdict.OPEN} and "1 pair of people" in made["note"]
