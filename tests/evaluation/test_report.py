"""The sections of the report: each verdict from scores that are made so that it must come out, and the page itself."""

import json
import os
import re
from dataclasses import asdict
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image

from relight.config import CONF, Experiment
from relight.evaluation.experiments.occlusion import HISTOGRAM
from relight.evaluation.report import build, page, provenance, sections
from relight.evaluation.report.data import costs_and_settings, redraws
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.comparisons import Verdict
from relight.evaluation.scoring.scores import Scores, write_scores
from relight.evaluation.scoring.truth import COLUMNS

FIGURES = [f"f{i}" for i in range(10)]
BASELINES = ("mean_figure", "mean_light", "nearest_light", "no_occlusion", "ao_occlusion", "as_it_is", "cut_2", "cut_3")
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
    experiment = asdict(Experiment(rows=[])) | experiment | {"plates": False}
    rows, own = experiment["rows"], (experiment["figures"], experiment["lights"])
    files = {}
    for kind, on, wanted in (("usual", ("test", "test"), usual or errors), ("scores", own, errors)):
        place = folder / "evaluate" / "-".join(on)
        figures = sitting if on[0] == "sitting" else FIGURES
        made = {f"{row}.s0": scores(i, wanted.get(row, {}), figures) for i, row in enumerate(rows)} if figures else {}
        for name in (f"{row}.s0" for row in rows):
            write_scores(place / f"{name}.csv", {name: made[name]} if made else {})
        baselines = {name: scores(50 + i, wanted.get(name, {}), figures) for i, name in enumerate(BASELINES)}
        write_scores(place / "baselines.csv", baselines if figures else {})
        files[kind] = {row: [f"evaluate/{'-'.join(on)}/{row}.s0.csv"] for row in rows}
        files[kind][""] = [f"evaluate/{'-'.join(on)}/baselines.csv"]
    (folder / "split.json").write_text(json.dumps({"train": [f"t{i}" for i in range(40)], "test": FIGURES}))
    (folder / "report").mkdir(exist_ok=True)
    run = folder / "run.yaml"
    told = yaml.safe_load(run.read_text()) if run.exists() else {"overrides": [], "settings": {}, "rows": {}}
    for row in rows:
        words = dict(word.split("=") for word in one["sweep"]["rows"][row] if "." in word.split("=")[0])
        figures = int(words["train.figures"]) if "train.figures" in words else None
        train = {"figures": figures, "part": "train", "steps": int(words.get("train.steps", 1000 + len(row)))}
        model = {"width": float(words.get("model.width", 1)), "order": int(words.get("model.order", 2))}
        told["rows"][row] = {"train": train, "model": model, "loss": {"light": 1}}
    run.write_text(yaml.safe_dump(told))
    record = {**experiment, **files, "trainings": {row: [f"{row}.s0"] for row in rows}}
    record["splits"] = dict.fromkeys(rows, "split.json")
    return Results(folder, {preset: record})


def numbers(folder, preset: str, errors: dict[str, dict[str, float]], **options) -> dict:
    return sections.experiment(results(folder, preset, errors, **options), preset)


def verdicts(made: dict) -> dict[tuple[str, str], Verdict]:
    """What is compared, and in which column -> verdict."""
    frame = made["comparisons"].frame
    return {(what, row["in"]): row["the first is"] for what, row in frame.iterrows()}


TABLES = [path.stem for path in (CONF / "experiment").glob("*.yaml") if "table: false" not in path.read_text()]


@pytest.mark.parametrize("preset", sorted({*TABLES} - {"one", "photo"}))
@pytest.mark.slow
def test_section_of_every_table_of_trainings(tmp_path, preset):
    made = build.experiment(results(tmp_path, preset, {}), preset)
    assert not made.failed and made.name == preset and "<table" in made.html
    assert ("data:image/png" in made.html) == (preset in ("order", "data_size", "width"))
    check(made.html)


def test_setting_tables_shared_and_differing(tmp_path):
    made = results(tmp_path, "table1", {})
    run = tmp_path / "run.yaml"
    told = yaml.safe_load(run.read_text()) | {"settings": {"bake": {"rays": 256}}}
    told["rows"]["another"] = {"loss": {"light": 3}}
    run.write_text(yaml.safe_dump(told))
    found = costs_and_settings(made)
    shared = found["shared"].frame["value"]
    assert "train.steps" not in shared.index and (shared["bake.rays"], shared["loss.light"]) == ("256", "1")
    assert list(found["differing"].frame.index) == ["train.steps"]


def test_section_without_such_figures(tmp_path):
    made = results(tmp_path, "sitting", {}, sitting=[])
    section = build.experiment(made, "sitting")
    assert not section.failed and "<table" not in section.html and made.table("sitting").rows == {}
    sections.write_score_table(made.table("sitting"), "Sitting", tmp_path / "sitting")
    assert (tmp_path / "sitting.tex").stat().st_size > 50


def test_sitting_section(tmp_path):
    worse = {"ours_full": {"shading_rmse": 0.5}, "mean_figure": dict.fromkeys(LEVEL, 0)}
    found = verdicts(numbers(tmp_path, "sitting", worse, usual={"x": {}}))
    assert found["Ours (full), sitting against standing", "shading RMSE"] is Verdict.WORSE
    assert found["Ours plus, sitting against standing", "shading RMSE"] not in (Verdict.BETTER, Verdict.WORSE)
    assert found["Ours (full) against the mean figure", "shading RMSE"] is Verdict.WORSE


def test_unusual_lights_section(tmp_path):
    lost = {"light_rmse": 0.4, "albedo_rmse": 0.2}
    errors = {
        "ours_full": lost,
        "ours_plus": lost,
        "nearest_light": {"light_rmse": 0.39},
        "mean_light": {"light_rmse": 0.8},
        "ours_rich": {"light_rmse": 0.3},
    }
    made = numbers(tmp_path / "a", "unusual_lights", errors, usual={"x": {}})
    assert made["fails"] == {"shading_rmse": False, "transport_rmse": False, "albedo_rmse": True, "light_rmse": True}
    assert made["nearest"] is Verdict.WORSE
    assert made["share"] == pytest.approx([0.5, 1], abs=0.01)  # half of the mean light's error; the same as it
    assert verdicts(made)["Ours, richer lights against Ours (full), unusual lights", "light RMSE"] is Verdict.BETTER
    errors["ours_full"] = {"light_rmse": 0.2, "albedo_rmse": 0.1}
    made = numbers(tmp_path / "b", "unusual_lights", errors, usual={"x": {}})
    assert not any(made["fails"].values()) and made["nearest"] is Verdict.BETTER


def test_silhouette_section(tmp_path):
    errors = {"silhouette": {"transport_rmse": 0.35}, "transport_only": {"transport_rmse": 0.2}}
    errors |= {"mean_figure": {"transport_rmse": 0.4, "shading_true_light_rmse": 0.4}}
    made = numbers(tmp_path / "a", "silhouette", errors)
    assert made["part"] == pytest.approx(0.25, abs=0.01) and made["tells"]
    made = numbers(tmp_path / "b", "silhouette", {})
    assert made["part"] is None and not made["tells"]


def test_self_supervised_section(tmp_path):
    errors = {"self_all": {"shading_contrast": 0.3, "albedo_share": 0.9}, "self_encoder": {"shading_contrast": 0.3}}
    made = numbers(tmp_path, "self_supervised", errors)
    assert made["collapsed"] == {"self_encoder": 1, "self_all": 2}
    assert made["signs"].frame["share explained by the albedo"].iloc[-1] == pytest.approx(0.4, abs=0.01)
    rising = {"ours_full": {"albedo_share": 0.1}, "self_all": {"albedo_share": 0.3}}  # less than the true albedo has
    assert numbers(tmp_path / "rising", "self_supervised", rising)["collapsed"]["self_all"] == 0
    assert set(numbers(tmp_path / "none", "self_supervised", {})["collapsed"].values()) == {0}


@pytest.mark.slow
def test_data_size_and_order_sections(tmp_path):
    falling = {"figures_8": 0.5, "figures_16": 0.4, "figures_32": 0.35, "figures_64": 0.3, "figures_128": 0.3}
    made = numbers(tmp_path / "a", "data_size", {row: {"shading_rmse": value} for row, value in falling.items()})
    assert made["places"][0] == 8 and made["places"][-1] == 40  # all that there are
    assert verdicts(made)["40 against 8", "shading RMSE"] is Verdict.BETTER and made["falling"] == []
    errors = {"order_2": {"shading_rmse": 0.4}, "cut_2": {"shading_rmse": 0.2}, "cut_3": {"shading_rmse": 0.1}}
    made = numbers(tmp_path / "b", "order", errors)
    assert made["floors"].frame.loc["Ours, order 2", "share of the squared error"] == "25 %"
    assert verdicts(made)["order 3 against 2", "shading RMSE"] is Verdict.BETTER


def test_splits_section(tmp_path):
    made = build.experiment(
        results(tmp_path, "splits", {"ours_siblings": {"shading_rmse": 0.2, "albedo_rmse": 0.05}}), "splits"
    )
    assert "With a random split, 2 of 5 errors are significantly smaller." in made.html


def test_equal_losses_section(tmp_path):
    """Of .4 without and .2 with both, .3 with either: each half of the lead, a quarter of the first error."""
    levels = {"sfsnet_ao": 0.4, "sfsnet_ao_full": 0.3, "ours_min": 0.3, "ours_full": 0.2}
    made = numbers(tmp_path, "equal_losses", {row: {"shading_rmse": value} for row, value in levels.items()})
    assert made["parts"] == pytest.approx({"inferred": 0.25, "losses": 0.25}, abs=0.01)
    found = verdicts(made)
    assert found["Ours (min) against SfSNet-AO: what is inferred, four losses", "shading RMSE"] is Verdict.BETTER
    assert found["SfSNet-AO, all losses against SfSNet-AO: the losses, ambient occlusion", "shading RMSE"] is (
        Verdict.BETTER
    )
    flat = {**levels, "sfsnet_ao_full": 0.4, "ours_min": 0.2}  # the losses do nothing
    made = numbers(tmp_path / "b", "equal_losses", {row: {"shading_rmse": value} for row, value in flat.items()})
    assert made["parts"] == pytest.approx({"inferred": 0.5, "losses": 0}, abs=0.01)


@pytest.mark.slow
def test_plus_parts_section(tmp_path):
    errors = {"plus_no_mirror": {"albedo_rmse": 0.2}, "ours_full": {"albedo_rmse": 0.2}}
    errors["plus_no_relit"] = {"relit_rmse": 0.6}
    made = numbers(tmp_path, "plus_parts", errors)
    assert verdicts(made)["Ours plus against Ours (full): all parts are worth", "albedo RMSE"] is Verdict.BETTER
    html = build.experiment(results(tmp_path, "plus_parts", errors), "plus_parts").html
    assert "Some error is significantly worse for: plus w/o losses under another light, plus w/o mirroring." in html
    html = build.experiment(
        results(tmp_path / "b", "plus_parts", {"ours_plus": dict.fromkeys(COLUMNS, 0.9)}), "plus_parts"
    ).html
    assert "None of the 5 ablations is significantly worse in any error." in html


def test_steps_section(tmp_path):
    """All fifteen losses trail in transport at 4,000 steps and lead at 16,000."""
    errors = {
        "full_4000": {"transport_rmse": 0.5},
        "full_16000": {"transport_rmse": 0.2},
        "min_16000": {"transport_rmse": 0.3},
        "weighted_16000": {"transport_rmse": 0.2},
    }
    made = numbers(tmp_path, "steps", errors)
    found = verdicts(made)
    assert found["4,000 steps: fifteen losses against four losses", "transport RMSE"] is Verdict.WORSE
    assert found["16,000 steps: fifteen losses against four losses", "transport RMSE"] is Verdict.BETTER
    assert found["fifteen losses: 16,000 against 4,000 steps", "transport RMSE"] is Verdict.BETTER
    assert made["changed"] == ["transport_rmse"]
    assert numbers(tmp_path / "b", "steps", {})["changed"] == []


def test_relit_section(tmp_path):
    errors = {"as_it_is": {"relit_rmse": 0.3}, "ours_full": {"relit_rmse": 0.2}, "sfsnet": {"relit_rmse": 0.4}}
    errors |= {"sfsnet_ao": {"relit_rmse": 0.3}, "ours_min": {"relit_rmse": 0.3}}
    made = numbers(tmp_path, "relit", errors)
    html = build.experiment(results(tmp_path, "relit", errors), "relit").html
    assert "Significantly better than the unchanged picture: Ours (full)." in html
    row = made["comparisons"].frame.loc["Ours (full) against the picture as it is: relighting"].iloc[0]
    assert row["first better by"].startswith("+33") and row["within"] is None


def test_summary_effects_and_bounds(tmp_path):
    """Rows alike but for noise are equivalent or open, and `within` says under what; sure ones have no bound."""
    frame = sections.summary(results(tmp_path, "table2", {"no_tv": {"albedo_rmse": 0.2}}))["listed"].frame
    sure = frame[frame["in"] == "albedo RMSE"].loc["w/o TV before Ours (full)"]
    assert sure["within"] is None and sure["here by"].startswith("−") and sure["here"] == "✗ reversed"
    alike = frame[frame["in"] == "light RMSE"].loc["Ours (full) before w/o TV"]
    assert alike["here"][0] in "≈?" and float(alike["within"][1:-2]) < 3.5
    assert {"†" in value for value in frame["by"]} == {True, False}  # what the paper prints under 3.5 %


def test_quarters_hold_the_right_figures(tmp_path):
    """Figures in the set grow harder with their number, and are the less occluded the higher it is."""
    made = results(tmp_path, "table2", {})
    write_occlusion(made.report / "occlusion.csv", 1 - np.arange(10) / 10)
    grid = sections.quarters(made, "table2")["quarters"]
    own = made.scores("table2")["no_tv"][0].figure_means("shading_rmse")
    wanted = [own[part].mean() for part in (slice(7, 10), slice(4, 7), slice(2, 4), slice(0, 2))]
    means = [cell.mean for cell in grid.frame["shading RMSE"].loc["w/o TV"]]
    assert means == pytest.approx(wanted)
    assert grid.kinds == ["network"] * 4 + ["baseline"] * len(BASELINES)
    table = pd.read_csv(made.report / "table2_occlusion.csv", index_col=0)
    assert table.filter(like="shading RMSE").filter(regex="lost$").loc["w/o TV"].tolist() == pytest.approx(
        wanted, rel=1e-5
    )
    write_occlusion(made.report / "occlusion.csv", np.ones(9), FIGURES[1:])
    assert sections.quarters(made, "table2") == {}


def test_quarters_compare_methods(tmp_path):
    """Ours (full) is ahead of SfSNet-AO on the five least occluded of ten figures, and behind on the others."""
    made = results(tmp_path, "table1", {})
    lead = np.where(np.arange(10) < 5, -0.1, 0.1)[:, None]
    one = scores(3, {"shading_rmse": 0.3 + lead})
    write_scores(tmp_path / "evaluate" / "test-test" / "ours_full.s0.csv", {"ours_full.s0": one})
    write_occlusion(made.report / "occlusion.csv", 0.1 + np.arange(10) / 10)
    leads = sections.quarters(made, "table1")["leads"].frame
    gains = [
        leads.loc[name]["first better by"] for name in leads.index if name.startswith("Ours (full) against SfSNet-AO")
    ]
    assert [gain[0] for gain in gains] == ["+", "+", "−", "−"] and len(gains) == 4


def write_occlusion(path, lost, figures=FIGURES):
    row = {"pose": "standing", "garments": "a", "pixels": 9, "ao": 0.9, "dark": 0, **dict.fromkeys(HISTOGRAM, 0.05)}
    pd.DataFrame([{**row, "name": f, "lost": x} for f, x in zip(figures, lost)]).to_csv(path, index=False)


def whole_run(folder, *presets: str, **options):
    """All that a report reads, made small."""
    made = [results(folder, preset, {}, **options) for preset in presets]
    asked = {}
    for one, preset in zip(made, presets):
        results(folder, preset, {}, **options)
        asked |= one.experiments
    infos = {name: {"name": name, "warnings": ["its front is a guess"]} for name in FIGURES} | {
        "g<1>": {"name": "g<1>", "left_out": "it is a plane"}
    }
    (folder / "figures.json").write_text(json.dumps({"figures": infos, "left_out": {"g<1>": "it is a plane"}}))
    write_occlusion(folder / "report" / "occlusion.csv", np.full(10, 0.3))
    for name in ("figures", "occlusion", "lights"):
        Image.new("RGB", (30, 20), "red").save(folder / "report" / f"{name}.png")
    for preset in asked:
        for row in asked[preset]["rows"]:
            (folder / "train").mkdir(exist_ok=True)
            (folder / "train" / f"{row}.s0.csv").write_text("step,lr,loss,light\n10,.1,3,.2\n20,.1,1,.1\n")
    (folder / "lights").mkdir()
    steps = [{"step": "read", "in": 5, "out": 4, "why": {"dark": 1}}]
    chain = {"steps": steps, "lights": {"train": 3, "validation": 0, "test": 1}, "warnings": [], "repaired": {}}
    chain |= {"unreadable": {"x.hdr": "empty"}, "unlit": {"room:9": "bright at 36 of 36 headings"}}
    (folder / "lights" / "chain.json").write_text(json.dumps(chain))
    save_lights(folder / "lights")
    told = yaml.safe_load((folder / "run.yaml").read_text()) | {"overrides": ["scale=smoke", "model=glob(*)"]}
    (folder / "run.yaml").write_text(yaml.safe_dump(told))
    place = folder / "benchmark" / "bake"
    place.mkdir(parents=True)
    (place / "g0.tsv").write_text("s\tmax_rss\tcpu_time\n2.5\t1024\t2\n1.5\t-\t1\n")
    return folder, asked


def save_lights(folder):
    from relight.lights import LightSet, write_light_set

    split, reason = np.array(["train", "train", "train", "test", "unusual"]), np.array(["", "", "", "", "bright back"])
    plain = np.zeros(5)
    lights = np.zeros((5, 9, 3), np.float32)
    lights[:, 0] = 1
    sources = np.array([f"room:{i}" for i in range(5)])
    write_light_set(
        LightSet(lights, split, sources, plain, plain.astype(int), plain + 1, plain.astype(int), reason), folder
    )


@pytest.mark.slow
def test_build_report_is_whole_and_stands_alone(tmp_path):
    folder, asked = whole_run(tmp_path, "table1", "table2")
    out = folder / "report" / "report.html"
    build.build_report("a <run>", asked, folder, out)
    html = out.read_text()
    found = check(html)
    assert found.names == [
        "what-came-out",
        "how-to-read",
        "table1",
        "table2",
        "training",
        "figures",
        "lights",
        "the-paper",
        "cost-and-settings",
    ]
    assert "failed" not in found.classes and "10.1145/3272127.3275104" in html
    assert {f"#{name}" for name in found.names} <= set(found.links)
    assert all(source.startswith("data:image/") for source in found.sources) and len(found.sources) >= 5
    assert not re.search(r"@import|url\(", html) and "a &lt;run&gt;" in html and "g&lt;1&gt;" in html
    assert "relight run scale=smoke 'model=glob(*)'" in unescape(html)
    for setting in ("loss.light", "train.part", "model.order"):  # of files with a dot in their stem
        assert f">{setting}<" in html
    assert html.count('<a href="#table2">Table 2</a>') == 3 and ">Figure 12<" in html and "#sitting" not in html
    assert "8 trainings of 1,005 to 1,017 steps;" in html
    assert "relight run experiment=sitting" in html and "validation/" not in html
    assert f"<dd>{len(FIGURES)} figures, " in html  # not counting the one that was left out
    for said in ("it is a plane", "its front is a guess", "x.hdr", "bright back", "bright at 36 of 36 headings", "4.0"):
        assert said in html


@pytest.mark.slow
def test_build_report_with_failed_sections(tmp_path, capsys):
    folder, asked = whole_run(tmp_path, "table1", "table2")
    (folder / "evaluate" / "test-test" / "no_tv.s0.csv").write_text("a,b\n1,2\n")
    (folder / "lights" / "chain.json").unlink()
    asked["light_transfer"] = {"title": "", "question": "", "table": False, "plates": False}
    asked["light_transfer"] |= {"rows": [], "trainings": {}}
    asked["light_transfer"] |= {"failed": ["light_transfer/a.csv"]}
    out = folder / "report" / "report.html"
    build.build_report("run", asked, folder, out)
    found = check(out.read_text())
    # The summary needs table2, and so does the chart of the first table.
    assert found.classes.count("failed") >= 3 and {"table1", "figures", "light_transfer"} <= set(found.names)
    assert "sections could not be made" in out.read_text()
    assert "light_transfer/a.csv" in out.read_text() and "no_tv.s0.csv" in out.read_text()
    assert "Traceback" in capsys.readouterr().err


class Outline(HTMLParser):
    """Names, links and classes of a page, and whether its elements that need an end have one."""

    CLOSED = ("table", "thead", "tbody", "tr", "td", "th", "div", "figure", "section", "main", "details", "nav", "p")

    def __init__(self):
        super().__init__()
        self.names, self.links, self.sources, self.open, self.classes = [], [], [], [], []

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.names += [attrs["id"]] if "id" in attrs else []
        self.links += [attrs["href"]] if tag == "a" else []
        self.sources += [attrs["src"]] if "src" in attrs else []
        self.classes += attrs.get("class", "").split()
        if tag in self.CLOSED:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag in self.CLOSED:
            assert self.open.pop() == tag


def check(html: str) -> Outline:
    """The outline of a page, whose Markdown and templates left nothing behind."""
    found = Outline()
    found.feed(html)
    assert found.open == [] and not re.search(r"\*\*|\{\{|\{%|&amp;lt;|&lt;a |None<|Markup\(", html)
    assert "<p><div" not in html and "<p><table" not in html and "<p><figure" not in html
    return found


def test_costs_of_overlapping_jobs(tmp_path):
    """Two jobs side by side, a pause, and a third: 4 + 2 s of wall time, 9 s of jobs."""
    for stage, name, seconds, end in (("bake", "a", 4, 104), ("bake", "b", 3, 103), ("evaluate/x-y", "c", 2, 202)):
        path = tmp_path / "benchmark" / stage / f"{name}.tsv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"s\tmax_rss\tcpu_time\n{seconds}\t{1024 * seconds}\t-\n")
        os.utime(path, (end, end))
    found, wall = provenance.costs(tmp_path)
    assert wall == pytest.approx(6) and found.seconds.to_dict() == {"bake": 7, "evaluate": 2}
    assert found.loc["bake"].to_dict() == {"jobs": 2, "mean": 3.5, "seconds": 7, "cpu": 0, "memory": 4}
    assert provenance.costs(tmp_path / "none")[1] == 0


def test_command_repeats_a_run(tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    assert provenance.command(folder) == "relight run"
    (folder / "run.yaml").write_text(yaml.safe_dump({"overrides": ["name=mine", "experiment=[a,b]"]}))
    assert provenance.command(folder) == "relight run name=mine 'experiment=[a,b]'"
    swept = {"overrides": ["name=mine"], "settings": {"experiments": {"sweep": {}}}}
    (folder / "run.yaml").write_text(yaml.safe_dump(swept))
    assert provenance.command(folder) == "snakemake all --configfile results/mine/run.yaml"


def test_picture_is_embedded(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (600, 700, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "big.png")
    assert 'src="data:image/jpeg' in page.picture(tmp_path / "big.png", 'a "red" <box>')
    assert "&lt;box&gt;" in page.picture(tmp_path / "big.png", 'a "red" <box>')
    (tmp_path / "a.gif").write_bytes(b"GIF")
    with pytest.raises(build.UserError, match="kinds"):
        page.picture(tmp_path / "a.gif", "no")


def test_redraws_by_reason():
    stretched = ["t-shirt: stretched to 1.41 of its pattern", "coat: stretched to 1.52 of its pattern"]
    infos = {
        "g0": {"redrawn": 0, "redrawn_because": []},
        "g1": {"redrawn": 2, "redrawn_because": stretched},
        "g2": {"redrawn": 1, "redrawn_because": ["77 pixels of a lower layer show through the cloth"]},
        "g3": {"left_out": "no figure of seed 3 passed"},
    }
    made = redraws(infos)
    assert (made["drawn"], made["redrawn"]) == (3, 2)
    frame = made["reasons"].frame
    assert frame.loc["stretched to … of its pattern"].tolist() == [2, "t-shirt 1, coat 1"]
    assert frame.loc["… pixels of a lower layer show through the cloth"].tolist() == [1, ""]
    assert redraws({"scan": {"name": "scan"}})["drawn"] == 0
