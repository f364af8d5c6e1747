"""One page that tells what was made, and what came out."""

import csv
import json
from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage
from relight.stages.tables import tables


@stage(
    "report",
    experiments="experiments (.json)",
    runs="runs, one per line (.txt)",
    results="folder of the results",
    out="report (.html)",
)
def main(evaluate: Evaluate, name: str, experiments: Path, runs: Path, results: Path, out: Path) -> None:
    from relight.evaluation.page import Section, build_page

    made = tables(evaluate, experiments, results / "evaluate", results / "evaluate" / "baselines.csv")
    sections = [
        Section("What came out", verdict(made)),
        *(Section(table.title, words(table)) for table in made.values()),
        Section("Pictures", pictures(results)),
        Section("Training", training(made, runs, results, out)),
        Section("Figures", figures(results)),
        Section("Lights", lights(results)),
        Section("Cost and settings", costs(results)),
    ]
    figure_count = len(json.loads((results / "figures.json").read_text())["figures"])
    lead = (
        f"{figure_count} figures, {len(runs.read_text().split())} trainings; numbers were measured in this run, "
        "but for the rows called “as printed”, which are the paper's."
    )
    build_page(f"relight: {name}", sections, out, lead)


def verdict(made: dict) -> str:
    """Which of the paper's orderings hold here, in words and as a table."""
    from relight.evaluation.claims import matrix, paragraph
    from relight.evaluation.page import prose

    both = list(made.values())
    return prose(paragraph(both)) + matrix(both)


def words(table) -> str:
    """A table with its legend; the readings that the paper does not print are folded away."""
    from relight.evaluation.formats import legend, to_html
    from relight.evaluation.metrics import COLUMNS
    from relight.evaluation.page import fold, prose

    other = tuple(c for c in COLUMNS if c not in table.columns and any(c in row.cells for row in table.rows))
    return prose(legend(table)) + to_html(table) + fold("Other readings of the same scores", to_html(table, other))


def pictures(results: Path) -> str:
    """Test figures as each network sees them."""
    from relight.evaluation.page import picture

    link = '<p><a href="viewer.html">Turn the light on the test figures with the mouse</a>'
    return link + picture(
        results / "report" / "plates.png", "Test figures, unseen in training, as each network sees them."
    )


def training(made: dict, runs: Path, results: Path, out: Path) -> str:
    """Errors with their intervals, and the losses over the steps."""
    from relight.evaluation.page import picture
    from relight.evaluation.plots import plot_curves, plot_errors

    errors, curves = out.with_name("errors.png"), out.with_name("curves.png")
    table = next(iter(made.values()))
    plot_errors(table, tuple(c for c in table.columns if c.endswith("rmse")), errors)
    plot_curves([results / "train" / f"{run}.csv" for run in runs.read_text().split()], curves)
    return picture(errors, "Errors with 95 % intervals over test figures.") + picture(curves, "Losses while training.")


def figures(results: Path) -> str:
    """The figures, how much they shadow themselves, what was repaired, and what was left out and why."""
    from relight.evaluation.page import fold, grid, picture, prose

    record = json.loads((results / "figures.json").read_text())
    with open(results / "report" / "occlusion.csv", newline="") as file:
        shadowed = list(csv.DictReader(file))
    mean = {key: sum(float(row[key]) for row in shadowed) / len(shadowed) for key in ("ao", "dark", "lost")}
    infos, left_out = record["figures"], record["left_out"]
    text = (
        f"{len(shadowed)} of {len(infos)} figures are in the data set. Over their pixels the mean ambient occlusion is "
        f"**{mean['ao']:.3f}**, **{mean['dark']:.1%}** lie under .5, and occlusion takes **{mean['lost']:.2f}** from "
        "the transport (root mean square of the nine-vector); means over figures."
    )
    parts = [prose(text)]
    if left_out:
        parts.append(grid(["left out", "why"], [[name, reason] for name, reason in left_out.items()]))
    parts.append(picture(results / "report" / "figures.png", "Lit, albedo, normals, ambient occlusion, shading."))
    rows = [[row["name"], *(float(row[key]) for key in ("ao", "dark", "lost"))] for row in shadowed]
    parts.append(fold("Occlusion of each figure", grid(["figure", "mean AO", "share under .5", "rms lost"], rows)))
    repairs = [
        [name, ", ".join(f"{what} {count}" for what, count in info["repairs"].items())]
        for name, info in infos.items()
        if info.get("repairs")
    ]
    if repairs:
        parts.append(fold("What cleaning repaired", grid(["figure", "repairs"], repairs)))
    return "\n".join(parts)


def lights(results: Path) -> str:
    """The illumination set, and what each step of its chain dropped."""
    from relight.evaluation.page import fold, grid, picture, prose

    record = json.loads((results / "lights" / "chain.json").read_text())
    steps = [
        [step["step"], step["in"], step["out"], ", ".join(f"{why} {n}" for why, n in step["why"].items() if n)]
        for step in record["steps"]
    ]
    counts = record["lights"]
    parts = [
        prose(f"{counts['train']} training lights and {counts['test']} test lights; the chain went so:"),
        grid(["step", "in", "out", "dropped (a light may have several reasons)"], steps),
        picture(results / "report" / "lights.png", "The lights, as lit spheres."),
    ]
    if warnings := record["warnings"]:
        parts.insert(1, prose("\n\n".join(warnings)))
    if unreadable := record["unreadable"]:
        parts.append(fold("Panoramas that could not be read", grid(["file", "why"], list(unreadable.items()))))
    return "\n".join(parts)


def costs(results: Path) -> str:
    """CPU seconds and memory per rule, and all settings of this run."""
    import yaml

    from relight.evaluation.page import fold, grid, settings_list

    rows = []
    for folder in sorted((results / "benchmark").glob("*")):
        jobs = []
        for path in folder.glob("*.tsv"):
            with open(path, newline="") as file:
                jobs += list(csv.DictReader(file, delimiter="\t"))
        seconds = [float(job["cpu_time"]) for job in jobs if job["cpu_time"] not in ("NA", "-")]
        memory = [float(job["max_rss"]) for job in jobs if job["max_rss"] not in ("NA", "-")]
        if seconds and memory:
            rows.append([folder.name, len(jobs), sum(seconds) / len(seconds), max(memory) / 1024])
    settings: dict = {}
    for path in sorted((results / "config").glob("*.yaml")):
        stage_settings = yaml.safe_load(path.read_text())
        for key in ("defaults", "hydra"):
            stage_settings.pop(key)
        if path.stem.count(".") == 0:
            settings |= {
                key: {**settings.get(key, {}), **value} if isinstance(value, dict) else value
                for key, value in stage_settings.items()
            }
    cost = grid(["rule", "jobs", "mean CPU seconds", "largest memory, GB"], rows)
    return cost + fold("Settings", settings_list(settings))


if __name__ == "__main__":
    main.cli()
