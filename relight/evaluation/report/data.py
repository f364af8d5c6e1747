"""Computes the numbers of the sections about training, figures, lights, cost and settings."""

import re
from collections import Counter
from typing import Any

import pandas as pd

from relight.evaluation.experiments.occlusion import SEPARATOR, group_occlusion, read_occlusion
from relight.evaluation.pictures import charts
from relight.evaluation.report.formats import TextTable, number
from relight.evaluation.report.provenance import costs
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.labels import label
from relight.evaluation.scoring.paper import IMPLIED_AO, IMPLIED_LOST
from relight.learning.checkpoint import load_network

Numbers = dict[str, Any]


def training(results: Results) -> Numbers:
    """Draws the errors of the first table and the training curves, and lists the networks.

    Returns:
        The context of templates/sections/training.md: the charts `errors` and `curves`, and the grid `networks`.
    """
    files = {"errors": results.report / "errors.png", "curves": results.report / "curves.png"}
    tables = [results.table(name) for name in results.readable]
    # That of sitting figures is empty if nobody sits.
    table = next((table for table in tables if table.rows), tables[0])
    charts.plot_errors(table, tuple(c for c in table.columns if c.endswith("rmse")), files["errors"])
    charts.plot_curves([results.folder / "train" / f"{name}.csv" for name in results.trainings], files["curves"])
    return files | {"networks": networks(results, results.readable[0])}


def networks(results: Results, name: str) -> TextTable:
    """Returns a grid of the different networks of a table: the rows that train each, its weights, and its size.

    Args:
        results: results of the run.
        name: the experiment of the table.
    """
    first = {row: trainings[0] for row, trainings in results.experiments[name]["trainings"].items()}
    settings = results.settings_files()
    rows_by_model: dict[str, list[str]] = {}
    for row, training in first.items():
        model = {key: value for key, value in settings[f"train.{training}"].items() if key.startswith("model.")}
        rows_by_model.setdefault(str(model), []).append(row)
    lines: list[list] = []
    for rows in rows_by_model.values():
        file = results.folder / "train" / f"{first[rows[0]]}.safetensors"
        if file.exists():
            network, _ = load_network(file)
            weights = sum(weight.numel() for weight in network.parameters())
            lines.append([", ".join(map(label, rows)), weights / 1e6, network.size])
    return TextTable.of(["network", "weights, millions", "side of its picture, px"], lines)


def figures(results: Results) -> Numbers:
    """Computes the numbers of the section about the figures.

    Returns:
        The context of templates/sections/figures.md: `infos`, the record of each figure; the pictures `sheet` and
        `histogram`; the mean occlusion of `every` figure, and the one that the paper's tables have `implied`; and grids
        of the figures that were `left_out`, of the occlusion `by_pose`, `by_garment` and of `each` figure, and of
        `repairs`; the names of figures by their `warnings`. And what `redraws` returns.
    """
    infos, left_out = results.record["figures"], results.record["left_out"]
    table = read_occlusion(results.report / "occlusion.csv")
    repairs = [
        [name, ", ".join(f"{what} {times}" for what, times in info["repairs"].items())]
        for name, info in infos.items()
        if info.get("repairs")
    ]
    warnings: dict[str, list[str]] = {}  # names of figures by warning
    for name, info in infos.items():
        for warning in info.get("warnings", ()):
            warnings.setdefault(warning, []).append(name)
    by_figure = table.assign(garments=table.garments.str.replace(SEPARATOR, ", ", regex=False))
    by_figure = by_figure[["name", "pose", "garments", "ao", "dark", "lost"]].to_numpy(object).tolist()
    return {
        "infos": infos,
        "left_out": two_columns(["left out", "reason"], left_out),
        "sheet": results.report / "figures.png",
        "histogram": results.report / "occlusion.png",
        "every": group_occlusion(table, "all").iloc[0],
        "implied": (IMPLIED_AO, IMPLIED_LOST),
        "by_pose": group_grid(table, "pose"),
        "by_garment": group_grid(table, "garment"),
        "each": TextTable.of(["figure", "pose", "garments", "mean AO", "AO < .5", "rms lost"], by_figure),
        "repairs": TextTable.of(["figure", "repairs"], repairs),
        "warnings": warnings,
        **redraws(infos),
    }


def group_grid(table: pd.DataFrame, by: str) -> TextTable:
    """Returns the occlusion of groups of figures, darkest first, followed by all figures and the paper's scans.

    Args:
        table: of the figures (`measure_occlusion`).
        by: "pose" or "garment".
    """
    groups = pd.concat([group_occlusion(table, by), group_occlusion(table, "all")])
    rows = [
        [
            group.Index,
            group.figures,
            group.ao,
            f"{number(group.least, digits=2)} to {number(group.most, digits=2)}",
            group.dark,
            group.lost,
        ]
        for group in groups.itertuples()
    ]
    rows.append(["the paper, implied", None, IMPLIED_AO, None, None, IMPLIED_LOST])
    heads = [by, "figures", "mean AO", "range", "AO < .5", "rms lost"]
    return TextTable.of(heads, rows, ["network"] * (len(groups) - 1) + ["baseline"] * 2)


def redraws(infos: dict[str, dict]) -> Numbers:
    """Counts the figures that were drawn again, by reason.

    Args:
        infos: figure -> its record; that of a generated one has `redrawn`, how often, and `redrawn_because`, the
            reasons, [GARMENT: ]REASON.

    Returns:
        `drawn`: number of generated figures; `redrawn`: of those drawn again; `reasons`: a grid of the reasons.
    """
    generated = [info for info in infos.values() if "redrawn" in info]
    reasons = [reason for info in generated for reason in info["redrawn_because"]]
    draws: Counter[str] = Counter()
    garments: dict[str, Counter[str]] = {}
    for reason in reasons:
        garment, _, why = reason.rpartition(": ")
        why = re.sub(r"\d+(\.\d+)?", "…", why)  # reasons that differ in a measured number alone are counted as one
        draws[why] += 1
        garments.setdefault(why, Counter())[garment] += bool(garment)
    rows = [
        [why, times, ", ".join(f"{name} {n}" for name, n in garments[why].most_common() if n)]
        for why, times in draws.most_common()
    ]
    grid = TextTable.of(["gate", "draws", "garments"], rows)
    return {"drawn": len(generated), "redrawn": sum(info["redrawn"] > 0 for info in generated), "reasons": grid}


def lights(results: Results) -> Numbers:
    """Computes the numbers of the section about the lights.

    Returns:
        The context of templates/sections/lights.md: `counts` of lights by split; `sources`, number of panoramas of the
        test lights; `warnings`; the picture `sheet`; and grids of the `steps` of the light chain with what each
        dropped, of the `test` lights, of those that were `cut`, and of panoramas that are `unlit`, `unreadable` or
        `repaired`.
    """
    from relight.lights import read_light_set

    record, chosen = results.lights, read_light_set(results.folder / "lights")
    steps = [
        [step["step"], step["in"], step["out"], ", ".join(f"{why} {n}" for why, n in step["why"].items() if n)]
        for step in record["steps"]
    ]
    turned = [f"{yaw:.0f}" for yaw in chosen.yaw]
    by_light = [list(map(str, row)) for row in zip(chosen.source, turned, chosen.reason, chosen.split)]
    return {
        "counts": record["lights"],
        "sources": len({row[0] for row in by_light if row[3] == "test"}),
        "warnings": record["warnings"],
        "steps": TextTable.of(["step", "lights in", "out", "dropped (a light may have several reasons)"], steps),
        "sheet": results.report / "lights.png",
        "test": TextTable.of(["test light", "turned by, degrees"], [row[:2] for row in by_light if row[3] == "test"]),
        "cut": TextTable.of(
            ["panorama", "turned by, degrees", "reasons", "kept as"], [row for row in by_light if row[2]]
        ),
        "unlit": two_columns(["panorama", "rules broken"], record["unlit"]),
        "unreadable": two_columns(["file", "reason"], record["unreadable"]),
        "repaired": two_columns(["file", "how"], record["repaired"]),
    }


def costs_and_settings(results: Results) -> Numbers:
    """Computes the numbers of the section about cost and settings.

    Returns:
        The context of templates/sections/costs.md: `wall` and `seconds`, wall time and sum of the jobs; and grids of
        the `costs` by stage, of the settings `shared` by the whole run, and of those `differing` between trainings.
    """
    stage_costs, wall = costs(results.folder)
    settings = {
        stage: {key: "none" if value is None else str(value) for key, value in values.items()}
        for stage, values in results.settings_files().items()
    }
    shared, differing = setting_tables(settings, results.trainings)
    seconds = float(stage_costs.seconds.sum())
    return {
        "costs": cost_table(stage_costs),
        "wall": wall,
        "seconds": seconds,
        "shared": shared,
        "differing": differing,
    }


def cost_table(stage_costs: pd.DataFrame) -> TextTable:
    """Returns a grid of jobs, seconds and memory by stage, with their sums; `stage_costs` is of `provenance.costs`."""
    rows = [
        [stage, int(cost.jobs), cost["mean"], cost.seconds, cost.cpu, cost.memory]
        for stage, cost in stage_costs.iterrows()
    ]
    totals = stage_costs.seconds.sum(), stage_costs.cpu.sum(), stage_costs.memory.max()
    rows.append(["all", int(stage_costs.jobs.sum()), None, *totals])
    heads = ["stage", "jobs", "s a job", "s in total", "CPU s", "largest memory, GB"]
    digits = {"s a job": 1, "s in total": 1, "CPU s": 1, "largest memory, GB": 2}
    return TextTable.of(heads, rows, digits=digits)


def setting_tables(settings: dict[str, dict[str, str]], names: list[str]) -> tuple[TextTable, TextTable]:
    """Returns the settings of a run in two tables.

    Args:
        settings: settings file (`bake`, `train.ours_full.s0`) -> key -> value.
        names: names of the trainings that the tables compare.

    Returns:
        The settings that are the same in the whole run, and those in which its trainings differ, with a column for each
        training.
    """
    by_training = pd.DataFrame({name: settings[f"train.{name}"] for name in names if f"train.{name}" in settings})
    by_training = by_training.astype(object).fillna("")
    differing = by_training[by_training.nunique(axis=1) != 1]
    values_by_key: dict[str, set[str]] = {}
    for file, values in settings.items():
        if not file.startswith("train.") or file.removeprefix("train.") in names:
            for key, value in values.items():
                values_by_key.setdefault(key, set()).add(value)
    # Also files of stages can differ, such as split.subject and split.paper.
    shared = {key: min(values) for key, values in values_by_key.items() if len(values) == 1}
    shared = {key: value for key, value in sorted(shared.items()) if key not in differing.index}
    return two_columns(["setting", "value"], shared), TextTable(differing.rename_axis("setting"), [""] * len(differing))


def two_columns(heads: list[str], pairs: dict[str, str]) -> TextTable:
    """Returns a grid of two columns.

    Args:
        heads: of the columns.
        pairs: first cell -> second cell.
    """
    return TextTable.of(heads, [list(item) for item in pairs.items()])
