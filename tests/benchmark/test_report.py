"""The experiment `benchmark`: what answers the set, when it is answered again, and the section of the report."""

import csv
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from relight.benchmark.methods import BASELINES, FIXED, answer
from relight.benchmark.score import COLUMNS, KEYS, mean_scores, read_scores, score
from relight.config import ROOT, Benchmark
from relight.config_folder import ConfigFolder
from relight.errors import UserError
from relight.photos.network import WEIGHTS
from relight.plan import Plan
from relight.stages.benchmark_scores import main as benchmark_scores
from relight.stages.report import main as report

WORDS = "scale=smoke experiment=benchmark sweep.only=[ours_full] sweep.seeds=[0,1] track=none"


def plan(folder) -> Plan:
    return Plan({"hydra": f"{WORDS} benchmark.folder={folder}"})


def write(folder: Path, values: dict[str, list[float]], benchmark: str = "0123456789abcdef") -> None:
    """Scores of one picture of each of three figures; what `values` does not name was not answered."""
    folder.mkdir(parents=True)
    with open(folder / "scores.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*KEYS, *COLUMNS])
        for i, figure in enumerate("abc"):
            writer.writerow([benchmark, f"{figure}.1", figure, *(values[c][i] if c in values else "" for c in COLUMNS)])


@pytest.mark.parametrize("method", ["ours_full.s0", "as_it_is", "mean_light"])
@pytest.mark.slow
def test_benchmark_scores_stage_agrees_with_the_command(drawn, weights, tmp_path, method):
    """And leaves no answers, but everything else that was in the folder."""
    kind = method if method in BASELINES else "network"
    answer(drawn, tmp_path / "by_hand", kind, weights)
    out = tmp_path / "made" / method / "scores.csv"
    out.parent.mkdir(parents=True)
    (out.parent / "thesis.txt").write_text("mine")
    benchmark_scores(Benchmark(str(drawn)), method, weights, out)
    assert out.read_text() == score(drawn, tmp_path / "by_hand").read_text()
    assert sorted(path.name for path in out.parent.iterdir()) == ["scores.csv", "thesis.txt"]


def test_plan_benchmark_weights(drawn):
    """All trainings of the rows with their networks, and what needs no training with the package's weights."""
    found = plan(drawn)
    networks = {f"ours_full.s{seed}": f"results/smoke/train/ours_full.s{seed}.safetensors" for seed in (0, 1)}
    fixed = dict.fromkeys(("shipped", "as_it_is", "mean_light", "true_maps"), str(WEIGHTS))
    assert found.benchmark_weights == networks | fixed
    assert found.stage_outputs("benchmark") == [
        f"results/smoke/benchmark_scores/{method}/scores.csv" for method in networks | fixed
    ]


@pytest.mark.slow
def test_plan_check_of_a_missing_set(drawn, tmp_path):
    plan(drawn).check()
    with pytest.raises(UserError, match=r"there is no finished benchmark there \(relight benchmark make --out \S+\)$"):
        plan(tmp_path).check()
    Plan({"hydra": f"scale=smoke benchmark.folder={tmp_path}"}).check()  # only this experiment needs it
    copy = shutil.copytree(drawn, tmp_path / "copy")
    os.utime(copy / "index.json", (time.time() + 3600,) * 2)
    with pytest.raises(UserError, match=r"index\.json is dated in the future"):
        plan(copy).check()
    for maps in (copy / "truth").glob("*.exr"):
        maps.unlink()
    with pytest.raises(UserError, match="true maps: there is no file"):
        plan(copy).check()


@pytest.mark.slow
def test_benchmark_scores_rule_of_a_new_set(drawn, tmp_path):
    """By the rules of the workflow: its index is what scores depend on."""
    copy = shutil.copytree(drawn, tmp_path / "set")
    scores = tmp_path / "results" / "smoke" / "benchmark_scores" / "as_it_is" / "scores.csv"

    def snakemake(*options: str) -> str:
        words = [
            "--snakefile",
            str(ROOT / "workflow" / "Snakefile"),
            "--directory",
            str(tmp_path),
            "--cores",
            "1",
            *options,
        ]
        command = [sys.executable, "-m", "snakemake", str(scores.relative_to(tmp_path)), *words]
        command += ["--config", f"hydra={WORDS} benchmark.folder={copy}"]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        return run.stdout + run.stderr

    def scored() -> set[str]:
        return {key for key, *_ in read_scores(scores.parent).index}

    snakemake()
    index = json.loads((copy / "index.json").read_text())
    assert scored() == {index["sha256"][:16]}
    assert "Nothing to be done" in snakemake("--dry-run")
    (copy / "index.json").write_text(json.dumps({**index, "sha256": 64 * "5"}))
    snakemake()
    assert scored() == {16 * "5"}


def test_mean_scores_of_trainings(tmp_path):
    write(tmp_path / "s0", {"full": [0.1, 0.2, 0.3], "light": [1, 1, 1]})
    write(tmp_path / "s1", {"full": [0.3, 0.2, 0.5], "light": [2, 1, 0]})
    write(tmp_path / "other", {"full": [0.3, 0.2, 0.5]}, 16 * "f")
    first, second, other = (read_scores(tmp_path / name) for name in ("s0", "s1", "other"))
    mean = mean_scores("mine", [first, second])
    assert mean.attrs["method"] == "mine" and mean.index.equals(first.index)
    assert np.allclose(mean["full"], [0.2, 0.2, 0.4]) and np.allclose(mean["light"], [1.5, 1, 0.5])
    assert np.isnan(mean["albedo"]).all()
    with pytest.raises(UserError, match="other and s0 were scored on different sets"):
        mean_scores("mine", [first, other])


def test_benchmark_section_of_the_report(tmp_path, capsys):
    """Two trainings at .1 and .3 are a row at .2; sections whose data this folder lacks take nothing from it."""
    levels = {"ours_full.s0": 0.1, "ours_full.s1": 0.3, "shipped": 0.15, "as_it_is": 0.4, "mean_light": 0.35}
    levels["true_maps"] = 0.05
    for method, level in levels.items():
        values = {"ratio": [level, level + 0.01, level - 0.01]}
        if method not in BASELINES:
            values |= {"light": [2 * level] * 3, "knee": [level, level, level]}
        write(tmp_path / "benchmark_scores" / method, values)
    (tmp_path / "experiments.json").write_text(ConfigFolder(plan(tmp_path)).experiments_json())
    (tmp_path / "report").mkdir()
    out = tmp_path / "report" / "report.html"
    report("mine", tmp_path / "experiments.json", tmp_path, out)
    heading, _, rest = out.read_text().partition('<h2 id="benchmark">')[2].partition("</h2>")
    section = rest.partition("</section>")[0]
    assert heading.startswith("Benchmark:") and "could not be made" not in section
    for title in ("Relit pictures", "Maps and light", "Differences from Shipped weights", "Invariances and leaks"):
        assert f"<h3>{title}</h3>" in section
    assert "means over the trainings" in section and "set 0123456789abcdef" in section
    ends = {"pictures", "maps", "differences", "invariance"}
    assert {path.name for path in (tmp_path / "report").glob("benchmark_*")} == {
        f"benchmark_{end}.{kind}" for end in ends for kind in ("csv", "md", "tex")
    }
    assert all(f'href="benchmark_{end}.tex"' in section for end in ends)

    def table(end: str) -> dict[str, dict[str, str]]:
        with open(tmp_path / "report" / f"benchmark_{end}.csv", newline="") as file:
            return {next(iter(row.values())): row for row in csv.DictReader(file)}

    labels = ["Ours (full)", "Shipped weights", "the picture as it is", "true maps, mean training light"]
    labels.append("true maps, true light")
    assert len(labels) == 1 + len(FIXED) and all(f">{words}</th>" in section for words in labels)
    means = {words: float(row["ratio: RMSE"]) for words, row in table("pictures").items()}
    assert means == dict(zip(labels, map(pytest.approx, (0.2, 0.15, 0.4, 0.35, 0.05))))
    assert list(means) == labels
    assert section.count('<tr class="baseline">') == 2 * len(BASELINES) and section.count('<tr class="network">') == 5
    assert float(table("maps")["Ours (full)"]["light"]) == pytest.approx(0.4)
    worse = {words: float(row["ratio: RMSE"]) for words, row in table("differences").items()}
    assert worse == dict(zip([labels[0], *labels[2:]], map(pytest.approx, (0.05, 0.25, 0.2, -0.1))))
    assert float(table("invariance")["light: cut at the knee"]["Ours (full)"]) == pytest.approx(0.2)
    assert "figures" in capsys.readouterr().err  # a section that this folder has no data for
