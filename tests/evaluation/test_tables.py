import csv
import io
import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from relight.core.errors import UserError
from relight.evaluation.report.formats import TextTable, number, other_columns, score_grid, to_markdown, write_tables
from relight.evaluation.report.page import section
from relight.evaluation.report.sections import write_score_table
from relight.evaluation.scoring.comparisons import MARGIN, Comparison, Verdict, compare_rows, correct, orderings
from relight.evaluation.scoring.paper import printed
from relight.evaluation.scoring.scores import Scores, gather, read_scores, write_scores
from relight.evaluation.scoring.statistics import Estimate, holm
from relight.evaluation.scoring.tables import TABLE1_COLUMNS, TABLE2_COLUMNS, Table, experiment_table
from relight.settings.scores import BASELINES, COLUMNS, READINGS, Reading

pytestmark = pytest.mark.usefixtures("few_resamples")
FIGURES = [f"f{i}" for i in range(12)]


def scores(row: str, seed: int, shift: dict[str, float], noise: float = 0.002) -> Scores:
    """Scores about the paper's printed values plus `shift`; figures are hard or easy alike in every row."""
    rng = np.random.default_rng([seed, *row.encode()])
    hard = np.random.default_rng(9).normal(0, 0.05, (12, 1))
    means = {column: value + shift.get(column, 0) + hard for column, value in printed(row).items()}
    columns = {column: mean + rng.normal(0, noise, (12, 4)) for column, mean in means.items()}
    return Scores(FIGURES, [3, 4, 5, 6], columns)


def rows(shift=None, names=("sfsnet", "sfsnet_ao", "ours_min", "ours_full"), seeds=1, **options):
    shift = shift or {}
    return {name: [scores(name, seed, shift.get(name, {}), **options) for seed in range(seeds)] for name in names}


def test_experiment_table_best_and_not_significant():
    given = rows({"ours_min": {"light_rmse": -0.0062}})  # .1988 against .199 of ours_full
    cells = experiment_table("table1", given, {}).rows
    assert list(cells) == ["sfsnet", "sfsnet_ao", "ours_min", "ours_full"]
    assert [name for name, row in cells.items() if row["shading_rmse"].best] == ["ours_full"]
    assert [n for n, row in cells.items() if row["albedo_ssim"].best] == ["sfsnet_ao"]  # more is better
    assert not cells["sfsnet"]["shading_rmse"].not_significant and cells["sfsnet"]["shading_rmse"].p < 0.05
    light = [cells[name]["light_rmse"] for name in ("ours_min", "ours_full")]
    assert sum(cell.best for cell in light) == 1 and sum(cell.not_significant for cell in light) == 1
    mean = np.mean([s.columns["shading_rmse"] for s in given["sfsnet"]])
    assert cells["sfsnet"]["shading_rmse"].mean == pytest.approx(mean)
    assert "ao_rmse" not in cells["ours_full"] and not cells["sfsnet_ao"]["ao_rmse"].best  # alone in its column


@pytest.mark.parametrize("column", ["shading_contrast", "albedo_share"])
def test_what_is_best_as_the_truth_has_it_is_not_ranked(column):
    given = rows(names=("ours_min", "ours_full"))
    for (trainings,), level in zip(given.values(), (0.5, 1.5)):
        trainings.columns[column] = level * trainings.columns["shading_ssim"]
    table = experiment_table("mine", given, {}, TABLE2_COLUMNS)
    assert not any(cells[column].best or cells[column].p is not None for cells in table.rows.values())
    assert {head for head, _ in score_grid(table, [column]).frame} <= {"contrast", "share of the picture"}
    found = compare_rows(table, "ours_full", "ours_min", (column,))[column]
    assert found.verdict is Verdict.DIFFERENT and found.verdict.is_significant
    assert found.gain == pytest.approx(2, rel=0.05) and 0 < found.interval[0] < found.gain  # three times as large


def test_experiment_table_baselines_do_not_compete():
    baseline = {"mean_figure": [scores("ours_full", 0, {c: -0.1 for c in TABLE1_COLUMNS})]}
    table = experiment_table("table1", rows(), baseline)
    assert list(table.rows)[-1] == "mean_figure"
    assert "mean_figure" not in table.networks and table.kind("mean_figure") == "baseline"
    assert not any(cell.best or cell.p is not None for cell in table.rows["mean_figure"].values())
    assert table.rows["ours_full"]["shading_rmse"].best
    assert score_grid(table, table.columns).frame.index[-5] == BASELINES["mean_figure"]  # four printed rows follow


def test_write_tables_of_scores(tmp_path):
    table = experiment_table("table1", rows(seeds=2), {"mean_figure": [scores("ours_min", 5, {})]})
    write_score_table(table, "Table 1", tmp_path / "table1")
    with open(tmp_path / "table1.csv", newline="") as file:
        lines = {(line["row"], line["kind"]): line for line in csv.DictReader(file)}
    ours = lines["ours_full", "network"]
    assert ours["trainings"] == "2" and ("mean_figure", "baseline") in lines
    assert float(lines["ours_full", "paper"]["shading_rmse"]) == 0.219
    one = table.rows["ours_full"]["shading_rmse"]
    for end, value in (("", one.mean), ("_low", one.low), ("_high", one.high)):
        assert float(ours[f"shading_rmse{end}"]) == pytest.approx(value, abs=6e-6)
    markdown = (tmp_path / "table1.md").read_text()
    cells = re.search(r"\| Ours \(full\) +\|(.*)", markdown)[1].split("|")
    assert cells[0].strip().startswith(f"**{number(one.mean)}** ± {number(one.margin)}")
    undecided = sum(row[c].not_significant for row in table.rows.values() for c in TABLE1_COLUMNS if c in row)
    shown = markdown.split("### Other")[0].split("\n\n", 2)[2]
    assert shown.count("n.s.") == undecided
    assert shown.count(", as printed ") == 8 and shown.count(f"*{BASELINES['mean_figure']}*") == 2
    before = [path.read_bytes() for path in sorted(tmp_path.iterdir())]
    write_score_table(table, "Table 1", tmp_path / "table1")
    assert [path.read_bytes() for path in sorted(tmp_path.iterdir())] == before


def test_write_tables_of_any_cells(tmp_path):
    one = Estimate(0.1234, 0.1, 0.15, np.zeros((3, 1)))
    alone = Estimate(0.5, -np.inf, np.inf, np.zeros((1, 1)))
    lines = [["a\n& b", one, 3, 12.34, Verdict.WORSE], ["<c>", alone, 4, None, "|"]]
    grid = TextTable.of(["", "RMSE, %", "px", "s", "is"], lines, kinds=["network", "baseline"], digits={"s": 1})
    write_tables(tmp_path / "things", "Things", "Of 100 %.", grid)
    heads, *found = csv.reader(io.StringIO((tmp_path / "things.csv").read_text()))
    assert heads == ["", "RMSE, %", "RMSE, %, low", "RMSE, %, high", "px", "s", "is"]
    assert found[0][:6] == ["a\n& b", "0.1234", "0.1", "0.15", "3", "12.34"]
    assert found[1] == ["<c>", "0.5", "-inf", "inf", "4", "", "|"]
    cells = [line.split(" | ") for line in to_markdown(grid).splitlines()]
    assert [cell.strip(" |") for cell in cells[2]] == ["a & b", ".123 ± .025", "3", "12.3", "✗ worse"]
    assert cells[3][0] == "| *<c>*" and cells[3][1].strip() == ".500 ± ∞" and grid.blocks() == [grid]
    page = section("sections/summary.md", orderings=[1], tables=[Table(())], trainings=(2, 2), small=0, listed=grid)
    cells = re.findall("<t[dh][^>]*>(.*?)</t[dh]>", page)
    assert cells[5:10] == ["a &amp; b", ".123\u00a0±\u00a0.025", "3", "12.3", "✗ worse"]
    assert cells[10] == "<em>&lt;c&gt;</em>" and cells[14] == "|"


def test_orderings_of_the_printed_values_hold():
    table = experiment_table("table1", rows(noise=0.0005), {})
    found = {(one.better, one.worse, one.comparison.column): one for one in orderings([table])}
    assert found["ours_min", "sfsnet", "shading_rmse"].comparison.verdict is Verdict.BETTER
    against = found["sfsnet_ao", "ours_full", "albedo_ssim"]  # as printed, against the paper's general words
    assert against.comparison.verdict is Verdict.BETTER and not against.argued
    assert against.printed_difference == pytest.approx((0.955 - 0.943) / 0.955) and against.comparison.gain > 0
    assert Verdict.WORSE not in {one.comparison.verdict for one in found.values()}
    assert not any(one.better == one.worse for one in found.values())


def test_comparison_equivalent():
    """At a true difference of exactly the margin it is claimed in 5 % of cases; at none and little noise, always."""

    def claims(shift: float, noise: float) -> float:
        found = []
        for trial in range(400):
            rng = np.random.default_rng([trial, 3])
            first = 1 + rng.normal(0, 0.1, 16)
            second = first + shift + rng.normal(0, noise, 16)
            one = Comparison("shading_rmse", *(Estimate(v.mean(), 0, 0, v[:, None]) for v in (first, second)))
            found.append(one.p_equivalent < 0.05)
        return np.mean(found)

    assert claims(0.0, 0.01) == 1 and 0.02 <= claims(MARGIN / (1 - MARGIN / 2), 0.05) <= 0.08
    assert claims(0.0, 0.5) < 0.06


def test_correct_widens_intervals_until_they_agree_with_p():
    rng, means = np.random.default_rng(2), [1.0, 1.005, 1.05, 1.09, 1.1, 1.2, 1.6]
    ones = [Estimate(v.mean(), 0, 0, v[:, None]) for v in (mean + rng.normal(0, 0.1, 12) for mean in means)]
    alone = [Comparison("shading_rmse", ones[0], one) for one in ones[1:]]
    before, equivalent = [one.interval for one in alone], holm([one.p_equivalent for one in alone])
    kept = [low > 0 or high < 0 for low, high in before]
    together = correct(alone)
    after = [one.interval for one in together]
    assert all(a[0] <= b[0] and b[1] <= a[1] for a, b in zip(after, before))
    assert [one.p_equivalent for one in together] == pytest.approx(equivalent)
    excluded = [low > 0 or high < 0 for low, high in after]
    assert excluded == [one.p < 0.05 for one in together] and sum(excluded) < sum(kept)
    # The least p of six is tested at the level 0.05 / 6, of Student's t.
    sure = min(together, key=lambda one: one.p)
    half_width = stats.t.isf(0.05 / 12, sure.difference.freedom) * sure.difference.error / sure.second
    assert sure.interval[1] - sure.gain == pytest.approx(half_width)


def test_write_scores_keeps_scores(tmp_path):
    one = Scores(["a", "null"], [3, 1], {"shading_rmse": np.array([[0.1234567, 2], [3, np.nan]])})
    write_scores(tmp_path / "a.csv", {"NA": one, "b.s0": one})
    found = read_scores(tmp_path / "a.csv")
    assert list(found) == ["NA", "b.s0"] and found["NA"].figures == ["a", "null"] and found["NA"].lights == [3, 1]
    np.testing.assert_allclose(found["NA"].columns["shading_rmse"], [[0.123457, 2], [3, np.nan]])
    assert list(found["NA"].columns) == ["shading_rmse"]
    write_scores(tmp_path / "none.csv", {})
    assert read_scores(tmp_path / "none.csv") == {}
    pd.read_csv(tmp_path / "a.csv", keep_default_na=False).iloc[:-1].to_csv(tmp_path / "short.csv", index=False)
    for name, text in {"empty.csv": "", "other.csv": "a,b\n1,2\n", "ragged.csv": "a,b\n1,2,3\n4\n"}.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)))
    for name in ("short", "empty", "other", "ragged", "binary"):
        with pytest.raises(UserError, match="not a table of scores"):
            read_scores(tmp_path / f"{name}.csv")


def test_figures_of_one_person_are_averaged():
    one = scores("sfsnet", 0, {})
    again = {name: np.concatenate([values, values[:3] + 2, values[:1] + 4]) for name, values in one.columns.items()}
    more = Scores([*FIGURES, "f0b", "f1b", "f2b", "f0c"], one.lights, again)
    mean = more.by_subject({"f0b": "f0", "f1b": "f1", "f2b": "f2", "f0c": "f0"})
    assert mean.figures == FIGURES
    for name, values in one.columns.items():
        np.testing.assert_allclose(mean.columns[name] - values, np.array([[2, 1, 1] + 9 * [0]]).T + np.zeros(4))


def test_gather_trainings_by_row(tmp_path):
    for name in ("ours_min.s0", "ours_min.s12", "sfsnet.s0"):
        write_scores(tmp_path / f"{name}.csv", {name: scores(name.split(".")[0], 0, {})})
    found = gather(sorted(tmp_path.glob("*.csv")))
    assert {name: len(trainings) for name, trainings in found.items()} == {"ours_min": 2, "sfsnet": 1}
    write_scores(tmp_path / "z.csv", {"z": Scores(FIGURES[::-1], [3, 4, 5, 6], scores("sfsnet", 0, {}).columns)})
    with pytest.raises(UserError, match="different test pairs"):
        gather(sorted(tmp_path.glob("*.csv")))


def test_experiment_table_of_one_figure():
    one = {n: [Scores(["f"], [1], {c: v[:1, :1] for c, v in s[0].columns.items()})] for n, s in rows().items()}
    table = experiment_table("table1", one, {})
    assert "± ∞" in to_markdown(score_grid(table, table.columns))
    assert {one.comparison.verdict for one in orderings([table])} == {Verdict.OPEN}


def test_a_new_reading_reaches_the_tables_by_its_entry(tmp_path, monkeypatch):
    """An unknown column is refused where it is written; with an entry it is in the files, and on the page."""
    given = rows(names=("ours_min", "ours_full"))
    for trainings in given.values():
        trainings[0].columns["shading_psnr"] = 20 + trainings[0].columns["shading_rmse"]
    with pytest.raises(UserError, match="shading_psnr must be one of QUANTITIES and one of READINGS"):
        write_scores(tmp_path / "a.csv", {"a": given["ours_min"][0]})
    assert not (tmp_path / "a.csv").exists()
    monkeypatch.setitem(READINGS, "psnr", Reading("PSNR", -1))
    monkeypatch.setitem(COLUMNS, "shading_psnr", ("shading", "psnr"))
    write_scores(tmp_path / "a.csv", {"a": given["ours_min"][0]})
    assert read_scores(tmp_path / "a.csv")["a"].columns["shading_psnr"].mean() == pytest.approx(20.24, abs=0.02)
    table = experiment_table("mine", given, {}, TABLE2_COLUMNS)
    assert ("PSNR ↑", "Shading") in score_grid(table, other_columns(table)).frame
    assert table.rows["ours_min"]["shading_psnr"].best and "shading_psnr_low" in table.statistics()
