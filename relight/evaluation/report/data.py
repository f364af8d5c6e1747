"""Computes the numbers of the sections about figures and lights.

Each of them returns the context of a template in templates/sections.
"""

import os

from relight.evaluation.report.formats import TextTable
from relight.evaluation.report.results import Results
from relight.evaluation.report.sections import Numbers


def figures(results: Results) -> Numbers:
    """Computes the numbers of the section about the figures."""
    infos, left_out = results.record["figures"], results.record["left_out"]
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
        "repairs": TextTable.of(["figure", "repairs"], repairs),
        "warnings": warnings,
    }


def lights(results: Results) -> Numbers:
    """Computes the numbers of the section about the lights."""
    from relight.lights import read_light_set

    record, chosen = results.lights, read_light_set(results.data / "lights")
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


def _two_columns(heads: list[str], pairs: dict[str, str]) -> TextTable:
    return TextTable.of(heads, [list(item) for item in pairs.items()])
