"""`relight benchmark`: makes a set of pictures, answers it, scores answers, and sets them beside each other."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    help="A benchmark of relighting: path traced people whose truth is known.",
    no_args_is_help=True,
)

SetFolder = Annotated[Path, typer.Option("--truth", help="The folder of the set that `make` drew.")]
BENCHMARK = Path("benchmark")


@app.command()
def make(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the set.")] = BENCHMARK,
    kind: Annotated[
        str, typer.Option("--set", help="report: for numbers that are told; choose: for choosing anything.")
    ] = "report",
    count: Annotated[int | None, typer.Option(help="Only so many of its pictures; all 128 by default.")] = None,
    size: Annotated[int, typer.Option(help="Pixels of a whole person's picture.")] = 512,
    samples: Annotated[int, typer.Option(min=1, help="Paths per pixel.")] = 64,
    detail: Annotated[str, typer.Option(help="Of the figures: full, or draft for 128 px.")] = "full",
) -> None:
    """Draws the pictures of a set. It goes on where it was stopped. Needs Mitsuba (the extra `bench`)."""
    from relight.benchmark.make import make as draw
    from relight.benchmark.picture import Settings
    from relight.figures.dress import DETAILS
    from relight.files import UserError

    if detail not in DETAILS:
        raise UserError(f"--detail {detail}: {' or '.join(DETAILS)}")
    found = draw(out, kind, count, Settings(size=size, samples=samples, detail=detail))
    print(f"{out}: set {found[:16]}")


@app.command("import")
def import_(
    layout: Annotated[str, typer.Argument(help="humanolat or ultrastage.")],
    source: Annotated[Path, typer.Argument(help="The data set's folder, as published.", metavar="FOLDER")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder of the set; the layout's name.")] = None,
    only: Annotated[str, typer.Option(help="Regular expression for the captures' names; all by default.")] = "",
    rays: Annotated[int, typer.Option(min=1, help="Per pixel, to bake the captures' meshes.")] = 256,
    places: Annotated[int, typer.Option(min=1, help="The rays start from k x k places of a pixel.")] = 4,
) -> None:
    """Brings captures of real people into a set, to be answered and scored like one that was drawn."""
    from relight.benchmark.captures import BAKED, import_captures

    folder = out or Path(layout)
    found = import_captures(layout, source, folder, only, rays, places)
    if (folder / BAKED).is_file():
        print(f"measured beside baked transport: {folder / BAKED}")
    print(f"{folder}: set {found[:16]}")


@app.command()
def answer(
    out: Annotated[Path, typer.Argument(help="Folder for the answers.", metavar="FOLDER")],
    truth: SetFolder = BENCHMARK,
    method: Annotated[str, typer.Option(help="network, as_it_is, mean_light or true_maps.")] = "network",
    weights: Annotated[
        Path | None, typer.Option("--weights", "-w", help="A checkpoint (.safetensors) of relight, for a network.")
    ] = None,
) -> None:
    """Writes this project's own answers: of a network, or of what costs nothing or knows everything."""
    from relight.benchmark.rows import answer as write

    print(f"{out}: {write(truth, out, method, weights)} answers written")


@app.command()
def score(
    answers: Annotated[Path, typer.Argument(help="Folder of answers, one .npz a picture.", metavar="FOLDER")],
    truth: SetFolder = BENCHMARK,
) -> None:
    """Scores anyone's answers (docs/benchmark.md says what they are): FOLDER/scores.csv, and their means here."""
    from relight.benchmark.score import read_row
    from relight.benchmark.score import score as judge

    path = judge(truth, answers)
    show([read_row(answers)])
    print(path)


@app.command()
def report(
    answers: Annotated[list[Path], typer.Argument(help="Folders that were scored on one set.", metavar="FOLDERS")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the tables.")] = Path("."),
) -> None:
    """Sets scored answers beside each other: CSV, Markdown and LaTeX."""
    from relight.benchmark.score import read_row
    from relight.evaluation.formats import write_tables

    for name, section in show([read_row(folder) for folder in answers]).items():
        write_tables(out / name, section.title, section.note, section.grid)


def show(rows: list) -> dict:
    """Prints the tables of rows, and returns them."""
    from relight.benchmark.score import tables
    from relight.evaluation.formats import to_markdown

    found = tables(rows)
    for section in found.values():
        print(f"## {section.title}\n\n{section.note}\n\n{to_markdown(section.grid)}\n")
    return found
