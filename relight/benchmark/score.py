"""Scores a folder of answers, and sets rows of scores beside each other."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight.benchmark.files import PICTURES, Entry, Set, inside_of, intrinsics_of, read_answer
from relight.benchmark.measures import INVARIANCES, LEAKS, errors, factor, invariances, leaks, similarity
from relight.evaluation.formats import Grid, count
from relight.evaluation.metrics import rmse
from relight.evaluation.statistics import estimate
from relight.files import UserError, atomic_write, existing_file
from relight.photos.infer import OPAQUE
from relight.progress import progress
from relight.srgb import LINEAR, encode

KEYS = ("set", "picture", "figure")
RELIT = tuple(f"{mode}{reading}" for mode in PICTURES for reading in ("", "_factor", "_ssim"))
SAID = (
    "albedo", "albedo_factor", "albedo_ssim", "shading", "shading_factor", "shading_ssim",
    "transport", "light", "light_factor",
)  # fmt: skip
ABSOLUTE = {name for name in (*RELIT, *SAID) if name != "transport" and not name.endswith("_factor")}
COLUMNS = (*RELIT, *SAID, *INVARIANCES, *LEAKS)
SCORES = "scores.csv"
RESAMPLES = 10_000


def score(folder: Path | str, answers: Path | str) -> Path:
    """Scores the answers in a folder against the set in `folder`; writes scores.csv beside them and returns its path.

    Raises UserError when the set has changed, and for answers that are missing, of another picture or of a wrong size.
    """
    benchmark, answers = Set(folder), Path(answers)
    if not answers.is_dir():
        raise UserError(f"{answers}: there is no such folder of answers")
    benchmark.verify()
    pictures = [entry for entry in benchmark.entries if not entry.of]
    varied = any((answers / f"{entry.name}.npz").is_file() for entry in benchmark.entries if entry.of)
    rows: list[tuple[str, str, str, dict[str, float]]] = []
    first: set[str] = set()
    for entry in progress(pictures, "pictures scored"):
        variants = [one for one in benchmark.entries if one.of == entry.name] if varied else []
        given = {one: read_answer(answers, one) for one in (entry, *variants)}
        first = first or set(given[entry])
        for one, arrays in given.items():
            asked = first.difference(PICTURES) if one.of else first
            if set(arrays) != asked:
                raise UserError(
                    f"{answers / one.name}.npz holds {', '.join(arrays)}, and the first picture asks for "
                    f"{', '.join(sorted(asked))}: all answers of a folder must hold the same"
                )
        rows.append((benchmark.hash[:16], entry.name, entry.figure, judged(benchmark, entry, given)))
    with atomic_write(answers / SCORES) as tmp, open(tmp, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*KEYS, *COLUMNS])
        writer.writerows([*keys, *(f"{found[c]:.6g}" if c in found else "" for c in COLUMNS)] for *keys, found in rows)
    return answers / SCORES


def judged(benchmark: Set, entry: Entry, given: dict[Entry, dict[str, np.ndarray]]) -> dict[str, float]:
    """Scores the answers to a photograph and to its variants.

    Args:
        benchmark: the set.
        entry: the photograph.
        given: the arrays that a method gave for it and for each of its variants.

    Returns:
        Those of COLUMNS that the answers allow. Where the set does not know how bright the albedo is, the scores that
        depend on it (ABSOLUTE) are left out.
    """
    true, pictures = benchmark.truth(entry)
    seen = {one.variant: intrinsics_of(arrays, inside_of(one)) for one, arrays in given.items()}
    found = errors(seen[""], true) | leaks(seen[""])
    solid = entry.shot().mask >= OPAQUE
    for mode in PICTURES:
        if mode in given[entry]:
            parts = [relit_errors(*pair, solid) for pair in zip(given[entry][mode], pictures)]
            found |= {f"{mode}{key}": float(np.mean([part[key] for part in parts])) for key in parts[0]}
    if len(seen) > 1:
        found |= invariances(seen)
    return found if benchmark.scaled else {name: value for name, value in found.items() if name not in ABSOLUTE}


def relit_errors(relit: np.ndarray, true: np.ndarray, solid: np.ndarray) -> dict[str, float]:
    """Errors of a picture (H,W,3) uint8 where the figure is solid, of sRGB codes in [0,1].

    "": RMSE of the vector norm; "_factor": the same after the one factor on linear values that brings it nearest;
    "_ssim": structural similarity.
    """
    codes, expected = (x / 255 for x in (relit, true))
    linear = LINEAR[relit[solid]].astype(np.float64)
    scaled = encode(linear * factor(linear, LINEAR[true[solid]]))
    return {
        "": float(rmse(codes[solid], expected[solid])),
        "_factor": float(rmse(scaled, expected[solid])),
        "_ssim": similarity(codes, expected, solid),
    }


@dataclass
class Row:
    """A method's scores: the set, pictures and figures as they stand in the file; columns: name -> (N,), NaN where
    a method gave nothing."""

    name: str
    keys: list[tuple[str, str, str]]
    columns: dict[str, np.ndarray]


def read_row(answers: Path | str) -> Row:
    """What `score` wrote into a folder of answers. Raises UserError on anything else."""
    path = existing_file(Path(answers) / SCORES, "scores (relight benchmark score)")
    with open(path, newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    try:
        if reader.fieldnames != [*KEYS, *COLUMNS] or not rows:
            raise ValueError
        columns = {name: np.array([float(row[name] or "nan") for row in rows]) for name in COLUMNS}
    except (ValueError, TypeError):
        raise UserError(f"{path} is not what relight benchmark score writes") from None
    return Row(Path(answers).resolve().name, [(row["set"], row["picture"], row["figure"]) for row in rows], columns)


@dataclass
class Section:
    """A table with its title, and a note on what its numbers are."""

    title: str
    note: str
    grid: Grid


def tables(rows: list[Row], bootstrap: int = RESAMPLES) -> dict[str, Section]:
    """The rows beside each other: relit pictures, maps and light, what moves. Means over pictures with their intervals.

    Figures are resampled, whole. Raises UserError when the rows are of different sets.
    """
    for row in rows[1:]:
        if row.keys != rows[0].keys:
            raise UserError(f"{row.name} and {rows[0].name} were scored on different sets: score both on one")
    figures = np.array([figure for _, _, figure in rows[0].keys])
    names = list(dict.fromkeys(figures))

    def cell(row: Row, column: str):
        means = {}
        for name in names:
            values = row.columns[column][figures == name]
            if not np.isnan(values).all():
                means[name] = np.nanmean(values)
        if not means:
            return None
        return estimate(np.array(list(means.values()))[None, :, None], bootstrap, 0)

    def table(title: str, heads: dict[str, str], words: str) -> Section:
        kept = {name: head for name, head in heads.items() if any(cell(row, name) for row in rows)}
        lines = [[row.name, *(cell(row, name) for name in kept)] for row in rows]
        return Section(title, f"{words} {many}", Grid.of(["method", *kept.values()], lines))

    def moves() -> Section:
        """The other way round, since there are more measures than methods."""
        telling = [row for row in rows if any(cell(row, name) for name in MOVES)]
        lines = [[words, *(cell(row, name) for row in telling)] for name, words in MOVES.items()]
        words = "All should be 0, but for albedo at exposure x .5 (1), shading (.5), a tint (1), and the last four."
        grid = Grid.of(["measure", *(row.name for row in telling)], lines)
        return Section("What moves and must not", f"{words} {many}", grid)

    pictures, people = count(len(figures), "picture"), count(len(names), "figure")
    many = (
        f"Means over {pictures} of {people} of set {rows[0].keys[0][0]}, ± half the 95 % interval (bootstrap over "
        "figures). A star: up to one factor a picture."
    )
    found = {
        "benchmark_pictures": table("Relit pictures", PICTURE_HEADS, "Errors of sRGB codes in [0,1]."),
        "benchmark_maps": table("Maps and light", MAP_HEADS, "RMSE of vectors; light: relative, of irradiance."),
        "benchmark_invariance": moves(),
    }
    return {name: section for name, section in found.items() if section.grid.frame.shape[1]}


MOVES = INVARIANCES | LEAKS
READINGS = {"": "RMSE", "_factor": "RMSE*", "_ssim": "SSIM"}
PICTURE_HEADS = {f"{mode}{key}": f"{mode}: {head}" for mode in PICTURES for key, head in READINGS.items()}
MAP_HEADS = {name: name.replace("_factor", "*").replace("_ssim", " SSIM") for name in SAID}
