"""The sections of experiments that are no table of trainings. Their tables are written beside the report."""

from collections.abc import Callable

import numpy as np

from relight.evaluation.formats import count, number
from relight.evaluation.page import Section, picture, prose
from relight.evaluation.path_traced import ANSWERS, CAUSES, traced_tables
from relight.evaluation.plain import Plain, plain_html, write_plain
from relight.evaluation.report.results import Results
from relight.evaluation.report.words import Compared, compared, told
from relight.evaluation.scores import Scores
from relight.evaluation.statistics import Estimate, compare, estimate, resample_weights
from relight.evaluation.tables import ALPHA, LABELS, gather, spread_of_trainings, values
from relight.evaluation.timing import PRINTED, Time, read_times
from relight.evaluation.transfer import TRIVIAL, VARIANTS

SWAPS = {"reconstruction_rmse": "relit, RMSE", "reconstruction_ssim": "relit, SSIM", "light_rmse": "light, RMSE"}


def light_transfer(results: Results, name: str) -> Section:
    """Who swaps lights, and what it is worth beside the picture as it is."""
    rows = gather([results.folder / "light_transfer" / "scores.csv"])
    networks = {row: trainings for row, trainings in rows.items() if ":" not in row and row not in TRIVIAL}
    found = {column: estimates(rows, networks, column, results) for column in SWAPS}
    some = next(iter(rows.values()))[0]
    title = "Light transfer: each figure relit by the light inferred from another's picture"
    text = (
        "The paper (section 7.2) shows pictures and says that inferred lights differ slightly in colour, that their "
        "patterns are similar, and that relit figures are therefore similar to the truth; it prints no number.\n\n"
    )
    text += "\n\n".join(swaps(row, found["reconstruction_rmse"]) for row in networks)
    table = swap_table(title, networks, found, len(some.figures), len(some.lights))
    shown = picture(results.folder / "light_transfer" / "swaps.png", "Pairs of test figures that swap their lights.")
    return Section(title, prose(text) + written(table, results, name) + shown)


def estimates(
    rows: dict[str, list[Scores]], networks: dict[str, list[Scores]], column: str, results: Results
) -> dict[str, Estimate]:
    """Row -> mean and interval over pairs; the trainings of the networks tell how much trainings spread."""
    settings = results.settings
    pairs = len(next(iter(rows.values()))[0].figures)
    weights = resample_weights(pairs, settings.bootstrap, settings.seed)
    spread = spread_of_trainings(networks, (column,))[column]
    return {
        row: estimate(values(trainings, column), weights, settings.seed + place, None if row in TRIVIAL else spread)
        for place, (row, trainings) in enumerate(rows.items())
    }


def swaps(row: str, found: dict[str, Estimate]) -> str:
    """What one network's swaps are worth, and where their error comes from."""

    def against(*others: str) -> Compared:
        return {"reconstruction_rmse": compared(found[row], found[others[0]], compare)}

    def surely_more(first: str, second: str) -> bool:
        difference = compare(found[first], found[second])
        return difference.mean > 0 and difference.p < ALPHA

    own = {variant: f"{row}:{variant}" for variant in VARIANTS}
    mean = {variant: number(found[name].mean) for variant, name in own.items() if variant}
    larger = "which of the two costs more cannot be told"
    for part, first, second in (("maps", "true_light", "true_maps"), ("light", "true_maps", "true_light")):
        if surely_more(own[first], own[second]):
            larger = f"of the two, the {part} cost{'' if part == 'maps' else 's'} more"
    text = (
        f"**{LABELS.get(row, row)}** against the picture as it is: {told(against('as_it_is'))}. Against its own maps "
        f"under the mean training light, for which no light need be inferred: {told(against(own['mean_light']))}. "
        f"With the true light the error is {mean['true_light']}, with the true maps {mean['true_maps']}: {larger}. "
        f"With colour and strength of the light made true the error is {mean['true_colour']}, with its pattern made "
        f"true {mean['true_pattern']}"
    )
    parts = (("colour", "true_colour"), ("pattern", "true_pattern"))
    if worse := [what for what, variant in parts if surely_more(own[variant], row)]:
        text += f"; that a true {' or '.join(worse)} makes it worse says that maps and light make up for each other"
    return text + "."


def swap_table(title: str, networks: dict, found: dict[str, dict[str, Estimate]], pairs: int, lights: int) -> Plain:
    lines, italic = [], set()
    for row in networks:
        for variant, words in VARIANTS.items():
            own = f"{row}:{variant}" if variant else row
            italic |= {len(lines)} if variant else set()
            lines.append([f"{LABELS.get(row, row)}: {words}", *(found[column][own] for column in SWAPS)])
    for trivial, words in TRIVIAL.items():
        italic.add(len(lines))
        lines.append([words, *(found[column][trivial] for column in SWAPS)])
    legend = (
        f"Means over {count(pairs, 'pair')} of test figures and {count(lights, 'swap')} of test lights for each, ± "
        "half the 95 % interval (bootstrap over pairs). RMSE is inside the mask, over pixels of the vector norm "
        "(light: over coefficients). Rows in italics know some of the truth, or look at no light."
    )
    return Plain(title, {"": None, **dict.fromkeys(SWAPS.values(), 3)}, lines, legend, frozenset(italic))


def path_traced(results: Results, name: str) -> Section:
    """How far relit pictures are from path tracing, and why."""
    tables = traced_tables(results.folder / "path_traced" / "scores.csv", results.settings)
    causes, answers = tables["path_traced_causes"], tables["path_traced"]
    sizes = {row[0]: row[1].mean for row in causes.rows}
    relative = {row[0]: row[2].mean for row in answers.rows}
    networks = [row for row in relative if row not in ANSWERS.values()]
    ranked = sorted((label for label in sizes if label in CAUSES.values()), key=sizes.get, reverse=True)
    text = "The paper shows relit figures beside path traced ones and prints no number. "
    text += f"Relit by the true maps, a figure differs from its path tracing by **{relative[ANSWERS['truth']]:.1f} %** "
    text += "(root mean square); the causes, largest first: "
    text += ", ".join(f"{label} (RMSE {sizes[label]:.3f})" for label in ranked) + ". "
    text += (
        f"True normals without occlusion differ by {relative[ANSWERS['no_occlusion']]:.1f} %, with ambient occlusion "
    )
    text += f"by {relative[ANSWERS['ao_occlusion']]:.1f} %: what is left over true maps is the price of ignoring "
    text += "the direction of occlusion when interreflection, too, is there. "
    text += "; ".join(f"**{label}**: {relative[label]:.1f} %" for label in networks)
    text += f"; leaving the picture as it is: {relative[ANSWERS['as_it_is']]:.1f} %."
    shown = picture(results.folder / "path_traced" / "pictures.png", "Test figures, relit and path traced.")
    parts = [prose(text), written(causes, results, f"{name}_causes"), written(answers, results, name), shown]
    return Section("Path tracing: what lies between a relit picture and the whole light", "\n".join(parts))


def inference_time(results: Results, name: str) -> Section:
    """Seconds for a picture of each network, at each size."""
    runs = results.experiments[name]["runs"]
    times = [t for row in runs for t in read_times(results.folder / "inference_time" / f"{runs[row][0]}.csv")]
    largest = max(t.size for t in times)
    best = [t for t in times if t.size == largest]
    text = f"The paper prints {PRINTED} s for a picture of 1024 px on a GeForce GTX 1080 Ti. Here, at {largest} px: "
    text += "; ".join(f"{LABELS.get(t.row, t.row)}, width {t.width:g}, {place(t)}: **{t.wall:.3g} s**" for t in best)
    text += ". Weights are untrained: they take no part in how long a network needs."
    heads = {
        "": None,
        "width": None,
        "parameters": None,
        "px": None,
        "on": None,
        "seconds": 4,
        "CPU seconds": 4,
        "GFLOP": 1,
        "of the matrix rate, %": 0,
    }
    rows = [
        [
            LABELS.get(t.row, t.row),
            f"{t.width:g}",
            f"{t.parameters / 1e6:.1f} M",
            t.size,
            place(t),
            t.wall,
            None if t.device == "cuda" else t.cpu,
            t.gflop,
            100 * t.share,
        ]
        for t in times
    ]
    rates = {place(t): np.median([u.rate for u in times if place(u) == place(t)]) for t in times}
    legend = (
        "One picture at a time, float32; the least of repeated calls. GFLOP: two per multiply-add. The rate of large "
        f"matrix products: {', '.join(f'{rate:.0f} GFLOP/s on {where}' for where, rate in rates.items())}."
    )
    title = "Inference time"
    return Section(title, prose(text) + written(Plain(title, heads, rows, legend), results, name))


def place(one: Time) -> str:
    return "a GPU" if one.device == "cuda" else count(one.threads, "thread")


def written(table: Plain, results: Results, name: str) -> str:
    """The table as HTML under its legend; as CSV, Markdown and LaTeX it is written beside the report."""
    write_plain(table, results.report / name)
    return prose(table.legend) + plain_html(table)


SECTIONS: dict[str, Callable[[Results, str], Section]] = {
    "light_transfer": light_transfer,
    "path_traced": path_traced,
    "inference_time": inference_time,
}
