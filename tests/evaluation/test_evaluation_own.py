"""Tables and sections of the experiments that are no table of trainings."""

import csv
import io
from types import SimpleNamespace

import numpy as np
import pytest

from relight.config import Evaluate
from relight.evaluation.page import Section
from relight.evaluation.path_traced import ANSWERS, CAUSES, COLUMNS
from relight.evaluation.plain import Plain, plain_csv, plain_html, plain_latex, plain_markdown, write_plain
from relight.evaluation.report.own import SECTIONS
from relight.evaluation.scores import Scores, write_scores
from relight.evaluation.statistics import Estimate
from relight.evaluation.timing import Time
from relight.evaluation.transfer import TRIVIAL, VARIANTS

SETTINGS = Evaluate(bootstrap=500, plates=1, sheet=6, lights="test", device="cpu", seed=0, version=1)


def some_table():
    one = Estimate(0.1234, 0.1, 0.15, np.zeros(3))
    alone = Estimate(0.5, -np.inf, np.inf, np.zeros(1))
    rows = [["a & b", one, 3, 12.34], ["<c>", alone, 4, None]]
    return Plain("Things", {"": None, "RMSE, %": 3, "px": None, "s": 1}, rows, "Of 100 %.", frozenset({1}))


def test_a_plain_table_in_every_form(tmp_path):
    table = some_table()
    heads, *rows = csv.reader(io.StringIO(plain_csv(table)))
    assert heads == ["", "RMSE, %", "RMSE, %, low", "RMSE, %, high", "px", "s"]
    assert rows == [["a & b", "0.1234", "0.1", "0.15", "3", "12.34"], ["<c>", "0.5", "-inf", "inf", "4", ""]]
    markdown = plain_markdown(table)
    assert "| a & b | 0.123 ± 0.025 | 3 | 12.3 |" in markdown and "| *<c>* | 0.500 ± ∞ | 4 |  |" in markdown
    latex = plain_latex(table)
    assert r"a \& b & 0.123 $\pm$ 0.025 & 3 & 12.3 \\" in latex and r"RMSE, \%" in latex and r"\textit{<c>}" in latex
    page = plain_html(table).replace("\n", "")
    assert "a &amp; b<td>0.123<small>±0.025</small><td>3<td>12.3" in page
    assert "<tr class=baseline><th scope=row>&lt;c" in page
    assert [path.name for path in write_plain(table, tmp_path / "things")] == ["things.csv", "things.md", "things.tex"]


@pytest.fixture
def results(tmp_path):
    from PIL import Image

    experiments = {name: {"runs": {"ours_full": ["ours_full.s0", "ours_full.s1"]}} for name in SECTIONS}
    for name in ("light_transfer/swaps.png", "path_traced/pictures.png"):
        (tmp_path / name).parent.mkdir()
        Image.new("RGB", (9, 9)).save(tmp_path / name)
    return SimpleNamespace(folder=tmp_path, report=tmp_path, settings=SETTINGS, experiments=experiments)


def test_what_swapping_lights_is_worth(results):
    """Swapping beats the picture as it is by .05 +- .001 on every pair; the maps cost more than the light."""
    rng = np.random.default_rng(0)
    hard = rng.uniform(0, 0.1, (8, 1))

    def scores(level):
        error = level + hard + rng.normal(0, 0.001, (8, 4))
        columns = {"reconstruction_rmse": error, "reconstruction_ssim": 1 - error, "light_rmse": error}
        return Scores([f"a{i}+b{i}" for i in range(8)], [3, 4, 5, 6], columns)

    levels = {
        "": 0.1,
        "true_light": 0.09,
        "true_maps": 0.02,
        "true_colour": 0.13,
        "true_pattern": 0.08,
        "mean_light": 0.1,
    }
    assert set(levels) == set(VARIANTS)
    rows = {f"ours_full{':' * bool(v)}{v}.s{s}": scores(level) for v, level in levels.items() for s in (0, 1)}
    rows |= {"as_it_is": scores(0.15), "true_maps_mean_light": scores(0.03)}
    write_scores(results.folder / "light_transfer" / "scores.csv", rows)
    section = SECTIONS["light_transfer"](results, "light_transfer")
    assert isinstance(section, Section)
    assert "better by" in section.html and "not to be told apart" in section.html
    assert "the maps cost more" in section.html and "a true colour makes it worse" in section.html
    with open(results.folder / "light_transfer.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(VARIANTS) + len(TRIVIAL)
    assert float(table[1]["relit, RMSE"]) == pytest.approx(0.09 + hard.mean(), abs=1e-3)


def test_what_lies_between_relighting_and_path_tracing(results):
    lines = [",".join(["kind", "name", "figure", "light", *COLUMNS])]
    for figure in ("a", "b", "c"):
        lines += [f"answer,ours_full.s{s},{figure},1,.3,.4,.1" for s in (0, 1)]
        lines += [f"cause,network:ours_full.s{s},{figure},1,.2,.3,.1" for s in (0, 1)]
        lines += [f"answer,{name},{figure},1,.1,.1{i},.05" for i, name in enumerate(ANSWERS)]
        lines += [f"cause,{name},{figure},1,.0{i},.0{i},.01" for i, name in enumerate(list(CAUSES)[1:])]
    (results.folder / "path_traced" / "scores.csv").write_text("\n".join(lines) + "\n")
    section = SECTIONS["path_traced"](results, "path_traced")
    words = section.html
    assert words.index(CAUSES["interreflection"]) < words.index(CAUSES["truncation"]) < words.index(CAUSES["baker"])
    assert "<b>10.0 %</b>" in words and "<b>Ours (full)</b>: 40.0 %" in words
    for name in ("path_traced", "path_traced_causes"):
        assert (results.folder / f"{name}.tex").stat().st_size > 300


def test_how_long_a_picture_takes(results):
    from dataclasses import asdict

    (results.folder / "inference_time").mkdir()
    times = [
        Time("ours_full", 0.25, 6_000_000, size, "cpu", t, 0.5 / t, 0.5, 20.0, 100.0 * t)
        for t in (1, 2)
        for size in (256, 1024)
    ]
    with open(results.folder / "inference_time" / "ours_full.s0.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, list(asdict(times[0])), lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(one) for one in times)
    section = SECTIONS["inference_time"](results, "inference_time")
    assert "Ours (full), width 0.25, 2 threads: <b>0.25 s</b>" in section.html and "0.43 s" in section.html
    assert "100 GFLOP/s on 1 thread, 200 GFLOP/s on 2 threads" in section.html
    with open(results.folder / "inference_time.csv", newline="") as file:
        assert [float(row["of the matrix rate, %"]) for row in csv.DictReader(file)] == [40] * 4
