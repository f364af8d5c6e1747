"""Computes the numbers of the sections about training, figures, lights and cost.

Each of them returns the context of a template in templates/sections.
"""

import os
from typing import Any

import pandas as pd

from relight.evaluation.experiments.occlusion import read_occlusion
from relight.evaluation.pictures import charts
from relight.evaluation.report.formats import TextTable
from relight.evaluation.report.provenance import costs
from relight.evaluation.report.results import Results
from relight.evaluation.scoring.paper import IMPLIED_AO, IMPLIED_LOST

Numbers = dict[str, Any]


def training(results: Results) -> Numbers:
    """Draws the training curves."""
    curves = results.report / "curves.png"
    charts.plot_curves([results.folder / "train" / f"{name}.csv" for name in results.trainings], curves)
    return {"curves": curves}


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
    return {
        "infos": infos,
        "left_out": _two_columns(["left out", "reason"], left_out),
        "sheet": results.report / "figures.png",
        "histogram": results.report / "occlusion.png",
        "occlusion": table,
        "implied": (IMPLIED_AO, IMPLIED_LOST),
        "repairs": TextTable.of(["figure", "repairs"], repairs),
        "warnings": warnings,
    }


def lights(results: Results) -> Numbers:
    """Computes the numbers of the section about the lights."""
    from relight.lights import read_light_set

    record, chosen = results.lights, read_light_set(results.folder / "lights")
    steps = [
        [step["step"], step["in"], step["out"], ", ".join(f"{why} {n}" for why, n in step["why"].items() if n)]
        for step in record["steps"]
    ]
    return {
        "counts": record["lights"],
        "sources": len(set(chosen.of("test").source)),
        "warnings": record["warnings"],
        "steps": TextTable.of(["step", "lights in", "out", "dropped (a light may have several reasons)"], steps),
        "sheet": results.report / "lights.png",
        "csv": os.path.relpath(results.data / "lights" / "lights.csv", results.report),
        "unlit": _two_columns(["panorama", "rules broken"], record["unlit"]),
        "unreadable": _two_columns(["file", "reason"], record["unreadable"]),
        "repaired": _two_columns(["file", "how"], record["repaired"]),
    }


def cost(results: Results) -> Numbers:
    """Computes the numbers of the section about the cost."""
    stage_costs, wall = costs(results.folder)
    return {"costs": _cost_table(stage_costs), "wall": wall, "seconds": float(stage_costs.seconds.sum())}


def _cost_table(stage_costs: pd.DataFrame) -> TextTable:
    """Returns a grid of `provenance.costs`, with the sums."""
    rows = stage_costs.reset_index().to_numpy(object).tolist()
    totals = stage_costs.seconds.sum(), stage_costs.cpu.sum(), stage_costs.memory.max()
    rows.append(["all", int(stage_costs.jobs.sum()), None, *totals])
    heads = ["stage", "jobs", "s a job", "s in total", "CPU s", "largest memory, GB"]
    digits = {"s a job": 1, "s in total": 1, "CPU s": 1, "largest memory, GB": 2}
    return TextTable.of(heads, rows, digits=digits)


def _two_columns(heads: list[str], pairs: dict[str, str]) -> TextTable:
    return TextTable.of(heads, [list(item) for item in pairs.items()])
