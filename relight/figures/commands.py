"""`relight figures`: generates clothed figures from seeds, for relight or for any other program."""

import shlex
import signal
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

app = typer.Typer()
GRACE = 3  # seconds in which a worker that is told to end may remove its files


def seeds_of(text: str) -> list[int]:
    """Parses "7", "0-47" or "1,4,10-12" into integers, each once, in the order given."""
    from relight.core.errors import UserError

    seeds: list[int] = []
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        if not first.isdecimal() or (last and not last.isdecimal()):
            raise UserError(f"--seeds {text}: it must be integers and ranges such as 7, 0-47 or 1,4,10-12")
        if last and int(last) < int(first):
            raise UserError(f"--seeds {text}: the range {part.strip()} must not run backwards")
        seeds += range(int(first), int(last or first) + 1)
    return list(dict.fromkeys(seeds))


def start_worker() -> None:
    """Prepares a worker: SIGTERM, which the parent sends, raises SystemExit, so that temporary files are removed.

    Ctrl-C goes to all processes; a worker ignores it, and waits for the parent to end it.
    """

    def end(number: int, _: object) -> None:
        signal.alarm(GRACE)  # ends the process where a destructor swallows the exception; the pool waits for it
        sys.unraisablehook = lambda _: None  # and is quiet about it
        sys.exit(128 + number)

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@app.command()
def figures(
    seeds: Annotated[str, typer.Option(help="Seeds of the figures: 7, 0-47 or 1,4,10-12.")] = "0-7",
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the figures and their table.")] = Path("figures"),
    detail: Annotated[
        Literal["full", "draft"], typer.Option(help="full, for pictures of 1024 px; draft, for 128 px.")
    ] = "full",
    texture: Annotated[int, typer.Option(min=64, help="Side of the largest texture in pixels.")] = 1024,
    per_subject: Annotated[
        int, typer.Option(min=1, help="Consecutive seeds that are one person in different poses.")
    ] = 1,
    sitting: Annotated[float, typer.Option(min=0, max=1, help="Share of the figures that sit.")] = 0.08,
    pose: Annotated[list[str] | None, typer.Option(help="A pose; if repeated, each figure takes one of them.")] = None,
    garment: Annotated[list[str] | None, typer.Option(help="A garment; if repeated, all are worn together.")] = None,
    hair: Annotated[
        list[str] | None, typer.Option(help="A hair style; if repeated, each figure takes one of them.")
    ] = None,
    names: Annotated[bool, typer.Option("--names", help="List all poses, garments and hair styles, and exit.")] = False,
    jobs: Annotated[int, typer.Option(min=1, help="Figures made at the same time, about 1 GB of memory each.")] = 1,
) -> None:
    """Make clothed figures. A seed always gives the same figure; figures.csv lists all figures of the folder.

    A figure that is already in the folder is kept, unless it was made with other options. What the figures are, and
    their licence: docs/figures.md.
    """
    import multiprocessing
    from importlib import import_module

    from relight.core.errors import UserError
    from relight.core.files import writable_folder
    from relight.core.processes import has_semaphores
    from relight.core.progress import progress
    from relight.figures.draw.constraints import Constraints
    from relight.figures.draw.constraints import names as known_names

    if names:
        for kind, known in known_names().items():
            typer.echo("\n".join(f"--{kind.split()[0]} {shlex.quote(name)}" for name in known))
        return
    import_module("relight.figures.make")  # a package that is missing is told here, not by each process
    numbers = seeds_of(seeds)
    writable_folder(out, "--out")
    constraints = Constraints(sitting, tuple(pose or ()), tuple(garment or ()), tuple(hair or ()))
    settings = {"detail": detail, "texture": texture, "per_subject": per_subject, "constraints": constraints}
    tasks = [(seed, settings, out / f"g{seed:04d}.glb") for seed in numbers]
    spawn = multiprocessing.get_context("spawn")
    with spawn.Pool(jobs, start_worker) if has_semaphores() else nullcontext() as pool:
        made = pool.imap(make_one, tasks) if pool else map(make_one, tasks)
        errors = [error for error in progress(made, "figures", total=len(tasks)) if error]
    write_table(out)
    if errors:
        raise UserError(f"{len(errors)} of {len(tasks)} figures failed: {errors[0]}")


def make_one(task: tuple[int, dict[str, Any], Path]) -> str | None:
    """Makes and writes one figure and its record (.json), unless both exist; returns the error message, or None.

    Args:
        task: the seed, the arguments of `make_figure`, and the path of the figure.
    """
    import json
    from dataclasses import asdict

    from relight.core.errors import UserError
    from relight.core.files import read_record, write_json
    from relight.figures.export import LICENCE, write_glb
    from relight.figures.make import GENERATOR, make_figure

    seed, settings, path = task
    record = path.with_suffix(".json")
    plain = json.loads(json.dumps({**settings, "constraints": asdict(settings["constraints"])}))
    known = read_record(record)
    if path.is_file() and known.get("settings") == plain and known.get("generator") == GENERATOR:
        return None
    try:
        mesh = make_figure(seed, **settings)
        mesh.info |= {"licence": LICENCE, "settings": plain}
        write_glb(mesh, path)
        write_json(record, mesh.info)
    except UserError as error:
        return str(error)
    return None


def write_table(folder: Path) -> None:
    """Writes figures.csv with a row for each record (.json) in the folder.

    Columns that a record lacks are empty in its row; lists and dictionaries are JSON.
    """
    import csv
    import json

    from relight.core.files import atomic_write, read_record

    records = [record for path in sorted(folder.glob("g[0-9]*.json")) if (record := read_record(path))]
    if not records:
        return
    with atomic_write(folder / "figures.csv") as tmp, open(tmp, "w", newline="") as file:
        table = csv.DictWriter(file, list(dict.fromkeys(key for record in records for key in record)))
        table.writeheader()
        for record in records:
            table.writerow({k: v if isinstance(v, str) else json.dumps(v) for k, v in record.items()})
