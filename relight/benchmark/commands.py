"""`relight benchmark`: makes a set of pictures, answers it, scores answers, and compares them."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

app = typer.Typer(
    help="A benchmark of relighting: path-traced people whose ground truth is known.", no_args_is_help=True
)

SetFolder = Annotated[Path, typer.Option("--truth", help="Folder of the set that `make` wrote.")]
BENCHMARK = Path("benchmark")


@app.command()
def make(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the set.")] = BENCHMARK,
    kind: Annotated[
        str,
        typer.Option(
            "--set",
            help="report: for final numbers; choose: for the choice of methods and settings; real: under real "
            "panoramas (after `relight light setup`).",
        ),
    ] = "report",
    count: Annotated[int | None, typer.Option(help="Number of pictures; by default all 128.")] = None,
    size: Annotated[int, typer.Option(help="Side of the picture of a whole person, pixels.")] = 512,
    samples: Annotated[int, typer.Option(min=1, help="Paths per pixel.")] = 64,
    detail: Annotated[
        Literal["full", "draft"], typer.Option(help="Detail of the figures; draft is for 128 px.")
    ] = "full",
) -> None:
    """Render the pictures of a set, resuming where it was stopped. Needs Mitsuba (the extra `bench`)."""
    from relight.benchmark.make import make as make_set
    from relight.benchmark.picture import Settings

    digest = make_set(out, kind, count, Settings(size=size, samples=samples, detail=detail))
    print(f"{out}: set {digest[:16]}")


@app.command()
def answer(
    out: Annotated[Path, typer.Argument(help="Folder for the answers.", metavar="FOLDER")],
    truth: SetFolder = BENCHMARK,
    method: Annotated[
        str, typer.Option(help="network, as_it_is, mean_light, true_maps, true_maps_3, _4, _6, or exact.")
    ] = "network",
    weights: Annotated[Path | None, typer.Option("--weights", "-w", help="A network (.onnx) of relight.")] = None,
) -> None:
    """Write relight's own answers to a set: by a network, a trivial baseline, or the true maps."""
    from relight.benchmark.methods import answer as write

    print(f"{out}: {write(truth, out, method, weights)} answers written")


@app.command()
def score(
    answers: Annotated[Path, typer.Argument(help="Folder of answers, one .npz per picture.", metavar="FOLDER")],
    truth: SetFolder = BENCHMARK,
) -> None:
    """Score the answers of any method (docs/benchmark.md): write FOLDER/scores.csv and print the means."""
    from relight.benchmark.score import read_scores
    from relight.benchmark.score import score as score_answers

    path = score_answers(truth, answers)
    show([read_scores(answers)])
    print(path)


@app.command()
def report(
    answers: Annotated[
        list[Path], typer.Argument(help="Folders of answers that were scored on the same set.", metavar="FOLDERS")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the tables; by default the one that holds the first.")
    ] = None,
) -> None:
    """Compare scored answers in tables: CSV and Markdown."""
    from relight.benchmark.score import read_scores
    from relight.evaluation.report.formats import write_tables

    folders = [path for path in answers if not path.is_file()] or answers  # among `answers/*` are the tables, too
    for name, table in show([read_scores(folder) for folder in folders]).items():
        write_tables((out or answers[0].parent) / name, table.title, table.note, table.grid)


def show(scores: list[Any]) -> dict[str, Any]:
    """Prints tables that compare methods by their scores (`relight.benchmark.score.read_scores`).

    Returns:
        stem of a file -> `relight.benchmark.tables.ComparisonTable`.
    """
    from relight.benchmark.tables import MethodComparison
    from relight.evaluation.report.formats import to_markdown

    tables = MethodComparison(scores).tables()
    for table in tables.values():
        print(f"## {table.title}\n\n{table.note}\n\n{to_markdown(table.grid)}\n")
    return tables
