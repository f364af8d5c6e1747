import csv
import re

import numpy as np
import pytest

from relight.config import Evaluate
from relight.evaluation.claims import PAIRS, claims, listed, matrix, paragraph
from relight.evaluation.formats import number, split_column, to_html, to_latex, to_markdown, write_table
from relight.evaluation.metrics import COLUMNS
from relight.evaluation.paper import printed
from relight.evaluation.scores import Scores, write_scores
from relight.evaluation.tables import COLUMNS1, LABELS, experiment_table, gather
from relight.files import UserError

SETTINGS = Evaluate(4000, 2, 6, "test", "cpu", 0, 1)
FIGURES = [f"f{i}" for i in range(12)]


def scores(row: str, seed: int, shift: dict[str, float], noise: float = 0.002) -> Scores:
    """Scores about the paper's printed values plus `shift`; figures are hard or easy alike in every row."""
    rng = np.random.default_rng([seed, *row.encode()])
    hard = np.random.default_rng(9).normal(0, 0.05, (12, 1))
    columns = {
        column: value + shift.get(column, 0) + hard + rng.normal(0, noise, (12, 4))
        for column, value in printed(row).items()
    }
    return Scores(FIGURES, [3, 4, 5, 6], columns)


def rows(shift=None, names=("sfsnet", "sfsnet_ao", "ours_min", "ours_full"), seeds=1, **options):
    shift = shift or {}
    return {name: [scores(name, seed, shift.get(name, {}), **options) for seed in range(seeds)] for name in names}


def test_the_best_and_what_cannot_be_told_from_it():
    given = rows({"ours_min": {"light_rmse": -0.0062}})  # .1988 against .199 of ours_full
    table = experiment_table("table1", given, {}, SETTINGS)
    assert [row.name for row in table.rows] == ["sfsnet", "sfsnet_ao", "ours_min", "ours_full"]
    cells = {row.name: row.cells for row in table.rows}
    best = [name for name, row in cells.items() if row["shading_rmse"].best]
    assert best == ["ours_full"]
    assert [n for n, row in cells.items() if row["albedo_ssim"].best] == ["sfsnet_ao"]  # more is better
    assert not cells["sfsnet"]["shading_rmse"].undecided and cells["sfsnet"]["shading_rmse"].p < 0.05
    light = [cells[name]["light_rmse"] for name in ("ours_min", "ours_full")]
    assert sum(cell.best for cell in light) == 1 and sum(cell.undecided for cell in light) == 1
    mean = np.mean([s.columns["shading_rmse"] for s in given["sfsnet"]])
    assert cells["sfsnet"]["shading_rmse"].estimate.mean == pytest.approx(mean)
    assert "ao_rmse" not in cells["ours_full"] and not cells["sfsnet_ao"]["ao_rmse"].best  # alone in its column


def test_baselines_do_not_compete():
    baseline = {"mean_figure": [scores("ours_full", 0, {c: -0.1 for c in COLUMNS1})]}
    table = experiment_table("table1", rows(), baseline, SETTINGS)
    last = table.rows[-1]
    assert last.baseline and last.label == LABELS["mean_figure"]
    assert not any(cell.best or cell.p is not None for cell in last.cells.values())
    assert next(r for r in table.rows if r.name == "ours_full").cells["shading_rmse"].best


def test_an_experiment_shows_its_own_columns_and_its_rows_in_their_order():
    names = ("ours_full", "no_tv", "no_shading")
    given = {name: [scores(name, 0, {})] for name in names}
    table = experiment_table("table2", given, {}, SETTINGS)
    assert [row.name for row in table.rows] == list(names) and "normal_rmse" not in table.columns
    mine = experiment_table("of my own", given, {}, SETTINGS)
    assert mine.title.startswith("of my own") and table.printed and not mine.printed
    with pytest.raises(UserError, match="no run"):
        experiment_table("table2", {}, {}, SETTINGS)


def test_formats_say_the_same(tmp_path):
    table = experiment_table("table1", rows(seeds=2), {"mean_figure": [scores("ours_min", 5, {})]}, SETTINGS)
    paths = write_table(table, tmp_path / "table1")
    assert [path.name for path in paths] == ["table1.csv", "table1.md", "table1.tex"]
    with open(paths[0], newline="") as file:
        lines = {line["row"]: line for line in csv.DictReader(file)}
    assert lines["ours_full"]["trainings"] == "2" and lines["mean_figure"]["kind"] == "baseline"
    assert float(lines["Ours (full), as printed"]["shading_rmse"]) == 0.219
    low, mean, high = (float(lines["ours_min"][f"shading_rmse{part}"]) for part in ("_low", "", "_high"))
    assert low < mean < high
    markdown = paths[1].read_text()
    row = next(line for line in markdown.splitlines() if line.startswith("| Ours (full) |"))
    assert row.split("|")[2].strip().startswith(f"**{number(float(lines['ours_full']['shading_rmse']))}** ±")
    latex = paths[2].read_text()
    body = [line for line in latex.splitlines() if line.endswith("\\\\") and "multicolumn" not in line]
    assert len({line.count("&") for line in body}) == 1 and latex.count("{tabular}") == 2
    marked = [markdown, latex, to_html(table)]
    undecided = sum(row.cells[c].undecided for row in table.rows for c in COLUMNS1 if c in row.cells)
    assert markdown.split("### Other")[0].count("n.s. |") == latex.count("mathrm{n.s.}") == undecided
    assert marked[2].count("<i>n.s.</i>") == undecided and marked[2].count("<tr class=paper>") == 8


def test_bytes_do_not_change():
    tables = [experiment_table("table1", rows(seeds=3), {}, SETTINGS) for _ in range(2)]
    for text in (to_markdown, to_latex, to_html):
        assert text(tables[0]) == text(tables[1])
    assert paragraph(tables[:1]) == paragraph(tables[1:])


def test_the_papers_own_numbers_hold_where_they_differ():
    table = experiment_table("table1", rows(noise=0.0005), {}, SETTINGS)
    verdicts = {(c.better, c.worse, c.column): c.verdict for c in claims([table])}
    assert verdicts["ours_min", "sfsnet", "shading_rmse"] == "holds"
    assert verdicts["sfsnet_ao", "ours_full", "albedo_ssim"] == "holds"  # as printed, against the paper's general words
    assert "reversed" not in verdicts.values()
    against = sum((better, worse) not in {pair[:2] for pair in PAIRS} for better, worse, _ in verdicts)
    assert len(re.findall(r">\([✓✗?]\) ", matrix([table]))) == against > 0
    assert not any(c[1] == c[0] for c in verdicts)


def test_an_order_that_is_turned_round_is_reported_as_such():
    table = experiment_table("table1", rows({"ours_full": {"transport_rmse": 0.1}}), {}, SETTINGS)
    made = {(c.better, c.worse, c.column): c for c in claims([table])}
    claim = made["ours_full", "ours_min", "transport_rmse"]
    assert claim.verdict == "reversed" and claim.ours.low > 0
    lines = [re.findall(r"<td[^>]*>([^<]*)", row) for row in listed([table]).split("<tr>")]
    told = next(line for line in lines if line[1:3] == ["Ours (full) before Ours (min)", "transport RMSE"])
    low, high = re.fullmatch(r"−(\.\d+) to −(\.\d+)", told[4]).groups()
    assert told[0] == "✗ reversed" and float(high) < abs(claim.ours.mean) < float(low)
    assert "class=reversed" in matrix([table])


def test_nothing_is_claimed_that_noise_can_explain():
    """All rows drawn alike: a stray verdict in about one of twenty repetitions, as the correction promises."""
    stray, quick = 0, Evaluate(2, 2, 6, "test", "cpu", 0, 1)
    for trial in range(40):
        rng = np.random.default_rng(trial)
        hard = rng.normal(0, 0.05, (12, 1))
        given = {
            name: [Scores(FIGURES, [0, 1], {c: 0.3 + hard + rng.normal(0, 0.02, (12, 2)) for c in COLUMNS1})]
            for name in ("sfsnet", "sfsnet_ao", "ours_min", "ours_full")
        }
        stray += any(claim.verdict != "open" for claim in claims([experiment_table("table1", given, {}, quick)]))
    assert stray <= 5


def test_verdicts_count_up_in_the_paragraph():
    table = experiment_table("table1", rows(), {}, SETTINGS)
    pattern = r"\*\*(\d+) hold here, (\d+) the other way round, (\d+) stay open"
    counts = [int(n) for n in re.search(pattern, paragraph([table])).groups()]
    made = claims([table])
    assert [listed([table]).count(f">{sign} ") for sign in "✓✗?"] == counts
    assert counts == [sum(c.verdict == v for c in made) for v in ("holds", "reversed", "open")]
    assert "With one training a row" in paragraph([table])
    assert "No two rows" in paragraph([experiment_table("table1", rows(names=("sfsnet",)), {}, SETTINGS)])


def test_gather_puts_trainings_of_a_row_together(tmp_path):
    for name in ("ours_min.s0", "ours_min.s12", "sfsnet.s0"):
        write_scores(tmp_path / f"{name}.csv", {name: scores(name.split(".")[0], 0, {})})
    found = gather(sorted(tmp_path.glob("*.csv")))
    assert {name: len(trainings) for name, trainings in found.items()} == {"ours_min": 2, "sfsnet": 1}
    other = Scores(FIGURES[::-1], [3, 4, 5, 6], scores("sfsnet", 0, {}).columns)
    write_scores(tmp_path / "z.csv", {"z": other})
    with pytest.raises(UserError, match="different test pairs"):
        gather(sorted(tmp_path.glob("*.csv")))


def test_one_figure_gives_numbers_without_certainty():
    one = {n: [Scores(["f"], [1], {c: v[:1, :1] for c, v in s[0].columns.items()})] for n, s in rows().items()}
    table = experiment_table("table1", one, {}, SETTINGS)
    assert "± ∞" in to_markdown(table) and "infty" in to_latex(table)
    assert all(claim.verdict == "open" for claim in claims([table]))


def test_printed_values_are_the_papers():
    assert printed("ours_full")["shading_rmse"] == 0.219 and printed("sfsnet_ao")["ao_ssim"] == 0.946
    assert "normal_rmse" not in printed("ours_min") and printed("mean_figure") == {}
    assert len(printed("no_reconstruction")) == 8


def test_numbers_and_columns():
    assert [number(v) for v in (0.1234, -0.5, 10.1234, 1.0, 0.0, np.inf)] == [
        ".123",
        "-.500",
        "10.123",
        "1.000",
        ".000",
        "∞",
    ]
    assert split_column("shading_true_light_rmse_element") == ("shading_true_light", "rmse_element")
    assert split_column("light_ssim_range2") == ("light", "ssim_range2")
    assert {reading for _, reading in map(split_column, COLUMNS)} == {"rmse", "rmse_element", "ssim", "ssim_range2"}
