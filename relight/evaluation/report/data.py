"""Computes the numbers of the sections about training, figures, lights, cost and settings.

Each of them returns the context of a template in templates/sections.
"""

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
    """Draws the training curves, and lists the networks."""
    curves = results.report / "curves.png"
    charts.plot_curves([results.folder / "train" / f"{name}.csv" for name in results.trainings], curves)
    return {"curves": curves, "networks": _networks(results, results.readable[0])}


def _networks(results: Results, name: str) -> TextTable:
    """Returns a grid of the different networks of an experiment: the rows that train each, its weights and size."""
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
    """Computes the numbers of the section about the figures."""
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
        "left_out": _two_columns(["left out", "reason"], left_out),
        "sheet": results.report / "figures.png",
        "histogram": results.report / "occlusion.png",
        "every": group_occlusion(table, "all").iloc[0],
        "implied": (IMPLIED_AO, IMPLIED_LOST),
        "by_pose": _group_grid(table, "pose"),
        "by_garment": _group_grid(table, "garment"),
        "each": TextTable.of(["figure", "pose", "garments", "mean AO", "AO < .5", "rms lost"], by_figure),
        "repairs": TextTable.of(["figure", "repairs"], repairs),
        "warnings": warnings,
        **redraws(infos),
    }


def _group_grid(table: pd.DataFrame, by: str) -> TextTable:
    """Returns the occlusion of groups of figures by pose or garment, then that of all figures and the paper's scans."""
    groups = pd.concat([group_occlusion(table, by), group_occlusion(table, "all")])
    ranges = [f"{number(least, 2)} to {number(most, 2)}" for least, most in zip(groups.least, groups.most)]
    groups.insert(2, "range", ranges)
    rows = groups.drop(columns=["least", "most"]).reset_index().to_numpy(object).tolist()
    rows.append(["the paper, implied", None, IMPLIED_AO, None, None, IMPLIED_LOST])
    heads = [by, "figures", "mean AO", "range", "AO < .5", "rms lost"]
    return TextTable.of(heads, rows, kinds=["network"] * (len(groups) - 1) + ["baseline"] * 2)


def redraws(infos: dict[str, dict]) -> Numbers:
    """Counts the figures that were drawn again, by reason.

    Args:
        infos: figure -> its record; that of a generated one has `redrawn`, how often, and `redrawn_because`, the
            reasons, [GARMENT: ]REASON.

    Returns:
        `drawn`: number of generated figures; `redrawn`: of those drawn again; `reasons`: a grid of the reasons.
    """
    generated = [info for info in infos.values() if "redrawn" in info]
    draws: dict[str, Counter[str]] = {}  # reason -> garments
    for garment, _, why in (reason.rpartition(": ") for info in generated for reason in info["redrawn_because"]):
        why = re.sub(r"\d+(\.\d+)?", "…", why)  # reasons that differ in a measured number alone are counted as one
        draws.setdefault(why, Counter())[garment] += 1
    rows = [
        [why, garments.total(), ", ".join(f"{name} {n}" for name, n in garments.most_common() if name)]
        for why, garments in sorted(draws.items(), key=lambda item: -item[1].total())
    ]
    grid = TextTable.of(["gate", "draws", "garments"], rows)
    return {"drawn": len(generated), "redrawn": sum(info["redrawn"] > 0 for info in generated), "reasons": grid}


def lights(results: Results) -> Numbers:
    """Computes the numbers of the section about the lights."""
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
        "unlit": _two_columns(["panorama", "rules broken"], record["unlit"]),
        "unreadable": _two_columns(["file", "reason"], record["unreadable"]),
        "repaired": _two_columns(["file", "how"], record["repaired"]),
    }


def costs_and_settings(results: Results) -> Numbers:
    """Computes the numbers of the section about cost and settings."""
    stage_costs, wall = costs(results.folder)
    settings = {
        stage: {key: "none" if value is None else str(value) for key, value in values.items()}
        for stage, values in results.settings_files().items()
    }
    shared, differing = _setting_tables(settings, results.trainings)
    return {
        "costs": _cost_table(stage_costs),
        "wall": wall,
        "seconds": float(stage_costs.seconds.sum()),
        "shared": shared,
        "differing": differing,
    }


def _cost_table(stage_costs: pd.DataFrame) -> TextTable:
    """Returns a grid of `provenance.costs`, with the sums."""
    rows = stage_costs.reset_index().to_numpy(object).tolist()
    totals = stage_costs.seconds.sum(), stage_costs.cpu.sum(), stage_costs.memory.max()
    rows.append(["all", int(stage_costs.jobs.sum()), None, *totals])
    heads = ["stage", "jobs", "s a job", "s in total", "CPU s", "largest memory, GB"]
    digits = {"s a job": 1, "s in total": 1, "CPU s": 1, "largest memory, GB": 2}
    return TextTable.of(heads, rows, digits=digits)


def _setting_tables(settings: dict[str, dict[str, str]], names: list[str]) -> tuple[TextTable, TextTable]:
    """Returns the settings that are the same in the whole run, and those in which its trainings differ.

    `settings`: file (`bake`, `train.ours_full.s0`) -> key -> value. `names`: of the trainings that the tables compare.
    """
    frame = pd.DataFrame(settings, dtype=object).sort_index()
    trainings = [name for name in names if f"train.{name}" in frame]
    by_training = pd.DataFrame({name: frame[f"train.{name}"] for name in trainings}).dropna(how="all").fillna("")
    differing = by_training[by_training.nunique(axis=1) > 1]
    # Also files of stages can differ, such as split.subject and split.paper.
    frame = frame[[file for file in frame if not file.startswith("train.") or file.removeprefix("train.") in trainings]]
    shared = frame[frame.nunique(axis=1) == 1].drop(index=differing.index, errors="ignore").bfill(axis=1).iloc[:, 0]
    return _two_columns(["setting", "value"], shared.to_dict()), TextTable(differing.rename_axis("setting"))


def _two_columns(heads: list[str], pairs: dict[str, str]) -> TextTable:
    return TextTable.of(heads, [list(item) for item in pairs.items()])
