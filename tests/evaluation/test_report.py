"""The sections of the report: each verdict from scores that are made so that it must come out, and the page itself."""

import json
import re
from dataclasses import asdict
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image
from safetensors.numpy import save_file
from samples import lights_of

from relight.evaluation.pictures import charts
from relight.evaluation.report import build, provenance, sections
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.comparisons import Verdict
from relight.evaluation.scoring.scores import Scores, write_scores
from relight.lights import write_light_set
from relight.settings import CONF, Experiment
from relight.settings.scores import BASELINES, COLUMNS

pytestmark = pytest.mark.usefixtures("few_resamples")
FIGURES = [f"f{i}" for i in range(10)]
ROWS = ("sfsnet_ao", "ours_min", "ours_plus", "mean_figure")  # of the preset claim, and a constant
LEVEL = {"shading": 0.3, "transport": 0.4, "light": 0.2, "albedo": 0.1}


def scores(seed: int, errors: dict[str, float], figures=FIGURES) -> Scores:
    """Scores about LEVEL where `errors` says nothing else; figures are hard or easy alike in every row."""
    rng, hard = np.random.default_rng([seed, 1]), np.linspace(-0.03, 0.03, len(figures))[:, None]
    signs = {"shading_contrast": 0.9, "albedo_share": 0.4}
    errors_of_all = [column for column in COLUMNS if not column.endswith(("_contrast", "_share"))]
    wanted = {c: next((v for k, v in LEVEL.items() if c.startswith(k)), 0.5) for c in errors_of_all} | signs
    columns = {c: v + hard + rng.normal(0, 0.002, (len(figures), 3)) for c, v in (wanted | errors).items()}
    return Scores(list(figures), [1, 2, 3], columns)


def results(folder, preset: str, errors: dict[str, dict[str, float]], usual=None, sitting=FIGURES) -> Results:
    """A folder of results with the scores of a preset's rows: `errors` by row, `usual` those on the usual pairs."""
    one = yaml.safe_load((CONF / "experiment" / f"{preset}.yaml").read_text())
    (experiment,) = one["experiments"].values()
    experiment = asdict(Experiment(rows=[])) | experiment | {"plates": False}
    rows, own = experiment["rows"], (experiment["figures"], experiment["lights"])
    files = {}
    for on, wanted in {("test", "test"): usual or errors, own: errors}.items():
        place = folder / "evaluate" / "-".join(on)
        figures = sitting if on[0] == "sitting" else FIGURES
        made = {f"{row}.s0": scores(i, wanted.get(row, {}), figures) for i, row in enumerate(rows)} if figures else {}
        for name in (f"{row}.s0" for row in rows):
            write_scores(place / f"{name}.csv", {name: made[name]} if made else {})
        baselines = {name: scores(50 + i, wanted.get(name, {}), figures) for i, name in enumerate(BASELINES)}
        write_scores(place / "baselines.csv", baselines if figures else {})
        files[on] = {row: [f"evaluate/{'-'.join(on)}/{row}.s0.csv"] for row in rows}
        files[on][""] = [f"evaluate/{'-'.join(on)}/baselines.csv"]
    (folder / "report").mkdir(exist_ok=True)
    (folder / "figures.json").write_text('{"figures": {}, "left_out": {}}')
    run = folder / "run.yaml"
    told = {"overrides": [], "settings": {"figures": {"source": "generated"}, "experiments": {}}, "rows": {}}
    told = yaml.safe_load(run.read_text()) if run.exists() else told
    for row in rows:
        words = dict(word.split("=") for word in one["sweep"]["rows"][row] if "." in word.split("=")[0])
        train = {"part": "train", "steps": int(words.get("train.steps", 1000 + len(row)))}
        model = {"width": float(words.get("model.width", 1)), "order": int(words.get("model.order", 2))}
        (folder / "train").mkdir(exist_ok=True)
        save_file({}, folder / "train" / f"{row}.s0.safetensors", {"relight": json.dumps({"train": train})})
        told["rows"][row] = {"train": train, "model": model, "loss": {"light": 1}}
    run.write_text(yaml.safe_dump(told))
    record = {"usual": files["test", "test"], "scores": files[own], "trainings": {row: [f"{row}.s0"] for row in rows}}
    return Results(folder, {preset: experiment | record}, folder)


def numbers(folder, preset: str, errors: dict[str, dict[str, float]], **options) -> dict:
    return sections.experiment(results(folder, preset, errors, **options), preset)


def verdicts(made: dict) -> dict[tuple[str, str], Verdict]:
    return {(what, row["in"]): row["the first is"] for what, row in made["comparisons"].frame.iterrows()}


def test_section_without_such_figures(tmp_path):
    made = results(tmp_path, "sitting", {}, sitting=[])
    assert "<table" not in build.experiment(made, "sitting")["html"] and made.table("sitting").rows == {}
    sections.write_score_table(made.table("sitting"), "Sitting", tmp_path / "sitting")
    assert (tmp_path / "sitting.md").stat().st_size > 50


def test_experiment_compares_its_pairs_in_its_words(tmp_path):
    errors = {"as_it_is": {"relit_rmse": 0.3}, "ours_full": {"relit_rmse": 0.2}, "sfsnet": {"relit_rmse": 0.4}}
    html = build.experiment(results(tmp_path, "relit", errors), "relit")["html"]
    assert "relit by the next test light, which is given" in html and "Which network's maps" in unescape(html)
    made = numbers(tmp_path, "relit", errors)
    found = verdicts(made)
    assert found["Ours (full) against the picture as it is: relighting", "relit RMSE"] is Verdict.BETTER
    assert found["SfSNet against the picture as it is: relighting", "relit RMSE"] is Verdict.WORSE
    row = made["comparisons"].frame.loc["Ours (full) against the picture as it is: relighting"].iloc[0]
    assert row["first better by"].startswith("+33") and row["within"] is None


def test_experiment_on_other_figures_or_lights_is_compared_with_the_usual_ones(tmp_path):
    found = verdicts(numbers(tmp_path / "a", "sitting", {"ours_full": {"shading_rmse": 0.5}}, usual={"x": {}}))
    assert found["Ours (full), sitting figures against usual ones", "shading RMSE"] is Verdict.WORSE
    same = found["Ours plus, sitting figures against usual ones", "shading RMSE"]
    assert same not in (Verdict.BETTER, Verdict.WORSE)
    pair = "Ours (full) against mean training figure, mean light: more than the usual pose"
    assert found[pair, "shading RMSE"] is Verdict.WORSE
    assert found[f"{pair} (usual ones)", "shading RMSE"] is not Verdict.WORSE
    light = {"ours_full": 0.4, "nearest_light": 0.39, "mean_light": 0.8}
    errors = {row: {"light_rmse": error} for row, error in light.items()}
    made = numbers(tmp_path / "b", "unusual_lights", errors, usual={"x": {}})
    found = verdicts(made)
    assert found["Ours (full), unusual lights against usual ones", "light RMSE"] is Verdict.WORSE
    nearest = "Ours (full) against true maps, nearest training light: more than the nearest training light"
    assert found[nearest, "light RMSE"] is Verdict.WORSE
    mean = "Ours (full) against true maps, mean training light: more than the mean training light"
    gains = made["comparisons"].frame.set_index("in", append=True)["first better by"]
    assert gains[mean, "light RMSE"].startswith("+5")
    assert gains[f"{mean} (usual ones)", "light RMSE"][:2] in ("0.", "+0", "−0")


def test_experiment_without_pairs_compares_the_best_row(tmp_path):
    """As in a sweep, whose networks infer neither normals nor AO: no column is empty but for baselines."""
    errors = {row: {"shading_rmse": 0.5} for row in ("no_tv", "no_shading", "ours_full")}
    errors["no_reconstruction"] = {"shading_rmse": 0.3}
    made = results(tmp_path, "table2", errors)
    made.experiments["table2"] |= {"compare": {"nobody against ours_full": "no row"}, "shows": ["shading", "normal"]}
    for file in (tmp_path / "evaluate" / "test-test").glob("*.s0.csv"):
        table = pd.read_csv(file)
        table.drop(columns=[column for column in table if column.startswith("normal")]).to_csv(file, index=False)
    found = sections.experiment(made, "table2")
    best = found["comparisons"].frame.loc["w/o reconstruction against Ours (full): best shading RMSE"]
    assert best["first better by"] == "+40.0 %" and best["the first is"] is Verdict.BETTER
    assert len(found["comparisons"].frame) == 3 and set(found["comparisons"].frame["in"]) == {"shading RMSE"}
    assert [head for _, head in found["tables"]["table2"].frame] == ["Shading", "Shading"]


def test_pairs_of_rows_that_are_not_trained_are_left_out(tmp_path, monkeypatch):
    """The others keep their colors, which are those in MLflow."""
    colored = []
    monkeypatch.setattr(charts, "plot_errors", lambda table, rows, out: colored.extend(rows))
    falling = {"figures_8": 0.5, "figures_16": 0.4, "figures_32": 0.35}
    made = results(tmp_path, "data_size", {row: {"shading_rmse": value} for row, value in falling.items()})
    for kind in ("trainings", "scores"):
        del made.experiments["data_size"][kind]["figures_128"]
    found = verdicts(sections.experiment(made, "data_size"))
    assert found["Ours (full) against figures_8: more figures", "shading RMSE"] is Verdict.BETTER
    assert len(found) == 4 * 4 and not any("128" in what for what, _ in found)
    assert colored == sorted(["ours_full", *(f"figures_{count}" for count in (8, 16, 32, 64, 128))])


def test_summary_effects_and_bounds(tmp_path):
    """Rows alike but for noise are equivalent or open, and `within` says under what; sure ones have no bound."""
    frame = sections.summary(results(tmp_path, "table2", {"no_tv": {"albedo_rmse": 0.2}}))["listed"].frame
    sure = frame[frame["in"] == "albedo RMSE"].loc["w/o TV before Ours (full)"]
    assert sure["within"] is None and sure["here by"].startswith("−") and sure["here"] == "✗ reversed"
    alike = frame[frame["in"] == "light RMSE"].loc["Ours (full) before w/o TV"]
    assert alike["here"][0] in "≈?" and float(alike["within"][1:-2]) < 3.5
    assert {"†" in value for value in frame["by"]} == {True, False}  # what the paper prints under 3.5 %


def whole_run(folder, *presets: str, **options):
    asked = {}
    for preset in presets:
        asked |= results(folder, preset, {}, **options).experiments
    infos = {name: {"name": name, "warnings": ["its front is a guess"]} for name in FIGURES}
    infos["g<1>"] = {"name": "g<1>", "left_out": "it is a plane"}
    (folder / "figures.json").write_text(json.dumps({"figures": infos, "left_out": {"g<1>": "it is a plane"}}))
    for name in ("figures", "lights"):
        Image.new("RGB", (30, 20), "red").save(folder / "report" / f"{name}.png")
    (folder / "lights").mkdir()
    steps = [{"step": "read", "in": 5, "out": 4, "why": {"dark": 1}}]
    chain = {"steps": steps, "lights": {"train": 3, "validation": 0, "test": 1}, "warnings": [], "repaired": {}}
    chain |= {"unreadable": {"x.hdr": "empty"}, "unlit": {"room:9": "bright at 36 of 36 headings"}}
    (folder / "lights" / "chain.json").write_text(json.dumps(chain))
    reason = np.array(["", "", "", "", "bright back"])
    lights = lights_of(["train", "train", "train", "test", "unusual"], reason=reason)
    write_light_set(lights, folder / "lights")
    told = yaml.safe_load((folder / "run.yaml").read_text()) | {"overrides": ["scale=smoke", "model=glob(*)"]}
    (folder / "run.yaml").write_text(yaml.safe_dump(told))
    return folder, asked


@pytest.mark.slow
def test_build_report_is_whole_and_stands_alone(tmp_path):
    folder, asked = whole_run(tmp_path, "table1", "table2")
    out = folder / "report" / "report.html"
    build.build_report(Results(folder, asked, folder), out)
    html = out.read_text()
    found = check(html)
    assert found.names == ["what-came-out", "how-to-read", "table1", "table2", *map(str.lower, sections.SECTIONS)]
    assert "failed" not in found.classes and "10.1145/3272127.3275104" in html
    assert {f"#{name}" for name in found.names} <= set(found.links)
    assert all(source.startswith("data:image/") for source in found.sources) and len(found.sources) >= 4
    assert not re.search(r"@import|url\(", html) and "g&lt;1&gt;" in html
    assert "relight run scale=smoke 'model=glob(*)'" in unescape(html)
    assert "8 trainings of 1,005 to 1,017 steps;" in html and "Nothing can be concluded" not in html
    assert f"<dd>{len(FIGURES)} figures, " in html  # not counting the one that was left out
    for said in ("it is a plane", "its front is a guess", "x.hdr", "bright at 36 of 36 headings"):
        assert said in html


@pytest.mark.slow
def test_build_report_with_a_failed_experiment_on_data_of_another_run(tmp_path):
    folder, asked = whole_run(tmp_path, "table1")
    (data := tmp_path / "data").mkdir()
    for name in ("figures.json", "lights"):
        (folder / name).rename(data / name)
    asked["sitting"] = {"title": "", "question": "", "plates": False, "labels": {}}
    asked["sitting"] |= {"rows": [], "trainings": {}, "failed": ["sitting/a.csv"]}
    out = folder / "report" / "report.html"
    build.build_report(Results(folder, asked, data), out)
    found = check(out.read_text())
    assert found.classes.count("failed") == 1 and {"table1", "sitting"} <= set(found.names)
    assert "1 experiment could not be finished" in out.read_text() and "sitting/a.csv" in out.read_text()


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


def test_head_draws_no_conclusion_from_a_few_subjects(tmp_path):
    for figures, subjects, concludes in ((6, 6, True), (10, 5, False)):
        folder = tmp_path / str(figures)
        made = results(folder, "claim", {"mean_occlusion": {"shading_true_light_rmse": 0.6}})
        for file in (folder / "evaluate" / "test-test").glob("*.csv"):
            table = pd.read_csv(file)
            table[table["figure"].isin(FIGURES[:figures])].to_csv(file, index=False)
        people = {name: {"subject": f"p{i % subjects}"} for i, name in enumerate(FIGURES)}
        made.record = {"figures": people, "left_out": {}}
        made.lights = {"lights": {"train": 3, "test": 1}}
        head = build.head("run", made, outcome=None)
        assert ("Yes, knowing occlusion pays." in head) == concludes
        assert ("concluded from this run: its networks are tested on 5 subjects." in head) != concludes
        body = build.page.section("sections/experiment.md", **sections.experiment(made, "claim"))
        assert ("these results hold for these networks" in body) == concludes


def test_networks_that_are_no_better_than_a_constant_are_named(tmp_path):
    errors = {"sfsnet_ao": 0.6, "ours_min": 0.8, "mean_figure": 0.6}
    columns = ("shading_true_light_rmse", "relit_rmse")
    levels = {row: dict(zip(columns, (errors.get(row, 0.1), 0.7 if row == "mean_figure" else 0.1))) for row in ROWS}
    made = numbers(tmp_path, "claim", levels)
    assert made["unlearned"] == {"shading, true light RMSE": ["SfSNet-AO", "Ours (min)"]}
    body = build.page.section("sections/experiment.md", **made)
    assert "RMSE, SfSNet-AO and Ours (min) are no better than the mean training figure" in body


def test_command_repeats_a_run():
    run = {"overrides": ["name=mine", "experiment=[a,b]"], "settings": {"experiments": {"a": {}, "b": {}}}}
    assert provenance.command("mine", run) == "relight run name=mine 'experiment=[a,b]'"
    swept = run | {"settings": {"experiments": {"sweep": {}}}}
    assert provenance.command("mine", swept) == "snakemake all --configfile results/mine/run.yaml"
