"""Scores folders of answers, and compares methods in tables."""

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight.benchmark.files import PICTURES, BenchmarkSet, Entry, read_answer, square_mask, to_intrinsics
from relight.benchmark.measures import INVARIANCES, LEAKS, best_scale, errors, invariances, leaks, ssim
from relight.evaluation.report.formats import Grid, count
from relight.evaluation.scoring.metrics import rmse
from relight.evaluation.scoring.statistics import estimate
from relight.files import UserError, atomic_write, existing_file
from relight.photos.infer import OPAQUE
from relight.progress import progress
from relight.srgb import LINEAR, encode

KEYS = ("set", "picture", "figure")
PICTURE_COLUMNS = tuple(f"{mode}{reading}" for mode in PICTURES for reading in ("", "_factor", "_ssim"))
MAP_COLUMNS = (
    "albedo", "albedo_factor", "albedo_ssim", "shading", "shading_factor", "shading_ssim",
    "transport", "light", "light_factor",
)  # fmt: skip
ABSOLUTE = {name for name in (*PICTURE_COLUMNS, *MAP_COLUMNS) if name != "transport" and not name.endswith("_factor")}
COLUMNS = (*PICTURE_COLUMNS, *MAP_COLUMNS, *INVARIANCES, *LEAKS)
SCORES = "scores.csv"
RESAMPLES = 10_000


def score(folder: Path | str, answers: Path | str) -> Path:
    """Scores a folder of answers, and writes scores.csv there.

    Args:
        folder: of the set.
        answers: folder of the answers.

    Returns:
        The file of the scores.

    Raises:
        UserError: if the set has changed, or an answer is missing, for another picture, or of a wrong size.
    """
    benchmark, answers = BenchmarkSet(folder), Path(answers)
    if not answers.is_dir():
        raise UserError(f"{answers}: there is no such folder of answers")
    benchmark.verify()
    pictures = [entry for entry in benchmark.entries if not entry.of]
    has_variants = any((answers / f"{entry.name}.npz").is_file() for entry in benchmark.entries if entry.of)
    rows: list[tuple[str, str, str, dict[str, float]]] = []
    names: set[str] = set()
    for entry in progress(pictures, "pictures scored"):
        variants = [one for one in benchmark.entries if one.of == entry.name] if has_variants else []
        answered = {one: read_answer(answers, one) for one in (entry, *variants)}
        names = names or set(answered[entry])
        for one, arrays in answered.items():
            required = names.difference(PICTURES) if one.of else names
            if set(arrays) != required:
                raise UserError(
                    f"{answers / one.name}.npz holds {', '.join(arrays)}, but that of the first picture "
                    f"{', '.join(sorted(required))}: all answers of a folder must hold the same arrays"
                )
        rows.append((benchmark.hash[:16], entry.name, entry.figure, score_answers(benchmark, entry, answered)))
    with atomic_write(answers / SCORES) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*KEYS, *COLUMNS])
        writer.writerows([*keys, *(f"{found[c]:.6g}" if c in found else "" for c in COLUMNS)] for *keys, found in rows)
    return answers / SCORES


def score_answers(
    benchmark: BenchmarkSet, entry: Entry, answered: dict[Entry, dict[str, np.ndarray]]
) -> dict[str, float]:
    """Scores the answers to a picture and to its variants.

    Args:
        benchmark: the set.
        entry: the picture.
        answered: the arrays of the answers to the picture and to each of its variants.

    Returns:
        Those of COLUMNS that the answers allow. If the set does not know the scale of the albedo, the scores that
        depend on it (ABSOLUTE) are left out.
    """
    true, pictures = benchmark.truth(entry)
    inferred = {one.variant: to_intrinsics(arrays, square_mask(one)) for one, arrays in answered.items()}
    found = errors(inferred[""], true) | leaks(inferred[""])
    opaque = entry.shot().mask >= OPAQUE
    for mode in PICTURES:
        if mode in answered[entry]:
            by_light = [relit_errors(*pair, opaque) for pair in zip(answered[entry][mode], pictures)]
            found |= {f"{mode}{key}": float(np.mean([one[key] for one in by_light])) for key in by_light[0]}
    if len(inferred) > 1:
        found |= invariances(inferred)
    return found if benchmark.scaled else {name: value for name, value in found.items() if name not in ABSOLUTE}


def relit_errors(relit: np.ndarray, true: np.ndarray, opaque: np.ndarray) -> dict[str, float]:
    """Returns the errors of a relit picture, of sRGB codes in [0,1].

    Args:
        relit: (H,W,3) uint8.
        true: (H,W,3) uint8.
        opaque: (H,W) bool, where the figure covers the pixel.

    Returns:
        "": RMSE of the vector norm.
        "_factor": the same after the best factor on linear values.
        "_ssim": SSIM.
    """
    codes, true_codes = (x / 255 for x in (relit, true))
    linear = LINEAR[relit[opaque]].astype(np.float64)
    scaled = encode(linear * best_scale(linear, LINEAR[true[opaque]]))
    return {
        "": float(rmse(codes[opaque], true_codes[opaque])),
        "_factor": float(rmse(scaled, true_codes[opaque])),
        "_ssim": ssim(codes, true_codes, opaque),
    }


@dataclass
class MethodScores:
    """The scores of a method.

    Attributes:
        name: of the method.
        keys: set, picture and figure of each of the N rows.
        columns: name -> (N,), NaN where the method did not answer.
    """

    name: str
    keys: list[tuple[str, str, str]]
    columns: dict[str, np.ndarray]


def read_scores(answers: Path | str) -> MethodScores:
    """Reads the scores in a folder of answers. Raises UserError if `score` did not write them."""
    path = existing_file(Path(answers) / SCORES, "scores (relight benchmark score)")
    with open(path, newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    try:
        if reader.fieldnames != [*KEYS, *COLUMNS] or not rows:
            raise ValueError
        columns = {name: np.array([float(row[name] or "nan") for row in rows]) for name in COLUMNS}
    except (ValueError, TypeError):
        raise UserError(f"{path} is not a table of relight benchmark score: score the answers again") from None
    keys = [(row["set"], row["picture"], row["figure"]) for row in rows]
    return MethodScores(Path(answers).resolve().name, keys, columns)


def mean_scores(name: str, trainings: list[MethodScores]) -> MethodScores:
    """Averages the scores of the trainings of a network, picture by picture.

    Args:
        name: of the network.
        trainings: one or more.

    Returns:
        The scores of the network.

    Raises:
        UserError: if the trainings were scored on different sets.
    """
    require_one_set(trainings)
    columns = {column: np.mean([one.columns[column] for one in trainings], 0) for column in COLUMNS}
    return MethodScores(name, trainings[0].keys, columns)


def require_one_set(rows: list[MethodScores]) -> None:
    """Raises UserError if not all were scored on the same set."""
    for row in rows[1:]:
        if row.keys != rows[0].keys:
            raise UserError(f"{row.name} and {rows[0].name} were scored on different sets: score both on the same one")


@dataclass
class Section:
    """A table with its title, and a note that explains its numbers."""

    title: str
    note: str
    grid: Grid


def tables(rows: list[MethodScores], bootstrap: int = RESAMPLES, reference: int = 0) -> dict[str, Section]:
    """Compares methods: tables of relit pictures, of maps and light, of differences, and of invariances.

    Cells are means with the intervals of a bootstrap over figures.

    Args:
        rows: the methods.
        bootstrap: number of resamples.
        reference: index of the method from which differences are taken.

    Returns:
        Tables by the stem of their files.

    Raises:
        UserError: if the methods were scored on different sets, or two folders have the same name.
    """
    if len({row.name for row in rows}) < len(rows):
        raise UserError("two folders of answers have the same name, by which tables tell methods apart: rename one")
    require_one_set(rows)
    figures = np.array([figure for _, _, figure in rows[0].keys])
    names = list(dict.fromkeys(figures))

    def cell(row: MethodScores, column: str, minus: MethodScores | None = None):
        means = {}
        for name in names:
            values = row.columns[column][figures == name]
            if minus:
                values = values - minus.columns[column][figures == name]
            if not np.isnan(values).all():
                means[name] = np.nanmean(values)
        if not means:
            return None
        return estimate(np.array(list(means.values()))[None, :, None], bootstrap, 0)

    sample = f"of set {rows[0].keys[0][0]}, ± half the 95 % interval (bootstrap over figures)."
    star = "A star: after the best factor for each picture."

    def means(shown: Iterable[MethodScores], columns: Iterable[str]) -> str:
        answered = [~np.isnan(row.columns[name]) for row in shown for name in columns]
        scored = np.any(answered, 0) if answered else np.zeros(len(figures), bool)
        return f"means over {count(int(scored.sum()), 'picture')} of {count(len(set(figures[scored])), 'figure')}"

    def table(title: str, heads: dict[str, str], words: str) -> Section:
        kept = {name: head for name, head in heads.items() if any(cell(row, name) for row in rows)}
        lines = [[row.name, *(cell(row, name) for name in kept)] for row in rows]
        lines = [line for line in lines if any(line[1:])]
        words = f"{words} All are {means(rows, kept)} {sample} {star}"
        return Section(title, words, Grid.of(["method", *kept.values()], lines))

    def difference_table() -> Section:
        first, others = rows[reference], [*rows[:reference], *rows[reference + 1 :]]
        kept = {name: head for name, head in DIFFERENCE_HEADS.items() if any(cell(row, name, first) for row in others)}
        lines = [[row.name, *(cell(row, name, first) for name in kept)] for row in others]
        lines = [line for line in lines if any(line[1:])]
        words = (
            f"Error of each method minus that of {first.name}, picture by picture; positive where {first.name} is "
            f"better. All are {means([first], kept)} {sample} {star}"
        )
        return Section(f"Differences from {first.name}", words, Grid.of(["method", *kept.values()], lines))

    def invariance_table() -> Section:
        """Transposed, since there are more measures than methods."""
        answering = [row for row in rows if any(cell(row, name) for name in INVARIANCE_ROWS)]
        lines = [[words, *(cell(row, name) for row in answering)] for name, words in INVARIANCE_ROWS.items()]
        words = (
            "Ideally 0, but 1 for albedo at exposure x .5 and for a tint, and .5 for shading at exposure x .5; "
            f"{means(answering, INVARIANCES)}. The last four rows measure leaks of the albedo into the shading; "
            f"{means(answering, LEAKS)}"
        )
        grid = Grid.of(["measure", *(row.name for row in answering)], lines)
        return Section("Invariances and leaks", f"{words} {sample}", grid)

    found = {
        "benchmark_pictures": table("Relit pictures", PICTURE_HEADS, "Errors of sRGB codes in [0,1]."),
        "benchmark_maps": table("Maps and light", MAP_HEADS, "RMSE of vectors; light: relative error of irradiance."),
        "benchmark_differences": difference_table(),
        "benchmark_invariance": invariance_table(),
    }
    return {name: section for name, section in found.items() if section.grid.frame.shape[1]}


INVARIANCE_ROWS = INVARIANCES | LEAKS
READINGS = {"": "RMSE", "_factor": "RMSE*", "_ssim": "SSIM"}
PICTURE_HEADS = {f"{mode}{key}": f"{mode}: {head}" for mode in PICTURES for key, head in READINGS.items()}
MAP_HEADS = {name: name.replace("_factor", "*").replace("_ssim", " SSIM") for name in MAP_COLUMNS}
DIFFERENCE_HEADS = {name: head for name, head in (PICTURE_HEADS | MAP_HEADS).items() if not name.endswith("_ssim")}
