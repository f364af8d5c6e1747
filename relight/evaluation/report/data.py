"""The sections of the report about what the networks were trained on, and what it took."""

import csv
import json

import yaml

from relight.evaluation.page import fold, grid, picture, prose, settings_list
from relight.evaluation.report.results import Results
from relight.evaluation.report.shadows import occlusion, redraws


def figures(results: Results) -> str:
    """The figures, how much they shadow themselves, what was repaired, and what was left out and why."""
    infos, left_out = results.record["figures"], results.record["left_out"]
    shown = min(len(infos), results.settings.sheet)
    caption = f"The first {shown} of {len(infos)} figures: lit, albedo, normals, ambient occlusion, shading."
    parts = [prose(f"{len(infos) - len(left_out)} of {len(infos)} figures are in the data set.")]
    if left_out:
        parts.append(grid(["left out", "why"], [[name, reason] for name, reason in left_out.items()]))
    parts += [redraws(infos), picture(results.report / "figures.png", caption), occlusion(results)]
    repairs = [
        [name, ", ".join(f"{what} {count}" for what, count in info["repairs"].items())]
        for name, info in infos.items()
        if info.get("repairs")
    ]
    if repairs:
        parts.append(fold("What cleaning repaired", grid(["figure", "repairs"], repairs)))
    return "\n".join(parts)


def lights(results: Results) -> str:
    """The illumination set, and what each step of its chain dropped."""
    record = json.loads((results.folder / "lights" / "chain.json").read_text())
    steps = [
        [step["step"], step["in"], step["out"], ", ".join(f"{why} {n}" for why, n in step["why"].items() if n)]
        for step in record["steps"]
    ]
    counts = record["lights"]
    parts = [
        prose(f"{counts['train']} training lights and {counts['test']} test lights; the chain went so:"),
        grid(["step", "in", "out", "dropped (a light may have several reasons)"], steps),
        picture(results.report / "lights.png", "The lights, as lit spheres."),
    ]
    if warnings := record["warnings"]:
        parts.insert(1, prose("\n\n".join(warnings)))
    if unreadable := record["unreadable"]:
        parts.append(fold("Panoramas that could not be read", grid(["file", "why"], list(unreadable.items()))))
    if repaired := record["repaired"]:
        parts.append(fold("Panoramas that were mended", grid(["file", "how"], list(repaired.items()))))
    return "\n".join(parts)


def costs(results: Results) -> str:
    """Seconds and memory of a job per rule, and all settings of this run.

    Wall time: of jobs of seconds, Snakemake's samples miss a part of the CPU time.
    """
    rows = []
    for folder in sorted((results.folder / "benchmark").glob("*")):
        jobs = []
        for path in folder.glob("*.tsv"):
            with open(path, newline="") as file:
                jobs += list(csv.DictReader(file, delimiter="\t"))
        seconds = [float(job["s"]) for job in jobs]
        memory = [float(job["max_rss"]) for job in jobs if job["max_rss"] not in ("NA", "-")]
        if memory:
            rows.append([folder.name, len(jobs), sum(seconds) / len(seconds), max(memory) / 1024])
    settings: dict = {}
    for path in sorted((results.folder / "config").glob("*.yaml")):
        stage_settings = yaml.safe_load(path.read_text())
        for key in ("defaults", "hydra"):
            stage_settings.pop(key)
        if path.stem.count(".") == 0:
            settings |= {
                key: {**settings.get(key, {}), **value} if isinstance(value, dict) else value
                for key, value in stage_settings.items()
            }
    cost = grid(["rule", "jobs", "mean seconds, wall", "largest memory, GB"], rows)
    return cost + fold("Settings", settings_list(settings))
