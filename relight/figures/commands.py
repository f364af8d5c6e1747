"""`relight figures`: clothed figures from seeds, for relight or for any other program."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


def seeds_of(text: str) -> list[int]:
    """The integers of "7", "0-47" or "1,4,10-12", each once, in the order given."""
    from relight.files import UserError

    out: list[int] = []
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        if not first.isdigit() or (last and not last.isdigit()):
            raise UserError(f"--seeds {text}: integers and ranges such as 7, 0-47 or 1,4,10-12")
        if last and int(last) < int(first):
            raise UserError(f"--seeds {text}: the range {part.strip()} runs backwards")
        out += range(int(first), int(last or first) + 1)
    return list(dict.fromkeys(out))


@app.command()
def figures(
    seeds: Annotated[str, typer.Option(help="7, 0-47 or 1,4,10-12.")] = "0-7",
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the figures and their table.")] = Path("figures"),
    export: Annotated[str, typer.Option(help="glb for any program, npz for relight.")] = "glb",
    detail: Annotated[str, typer.Option(help="full for 1024 px, draft for 128 px.")] = "full",
    texture: Annotated[int, typer.Option(min=64, help="Side of the largest texture in pixels.")] = 1024,
    per_subject: Annotated[int, typer.Option(min=1, help="Consecutive seeds that are one person, in poses.")] = 1,
    shading: Annotated[float, typer.Option(min=0, max=1, help="Bakes shading into the albedo, as scans have it.")] = 0,
    device: Annotated[str, typer.Option(help="cpu, cuda or auto: where cloth is draped; bits depend on it.")] = "cpu",
    jobs: Annotated[int, typer.Option(min=1, help="Figures made at the same time, about 1 GB of memory each.")] = 1,
) -> None:
    """Make clothed figures. A seed always makes the same figure; figures.csv tells who, in what, how.

    A figure that is already in the folder is kept. What the figures are, and their licence: docs/figures.md.
    """
    import csv
    import json
    import multiprocessing

    from relight.figures.colliders import DEVICES
    from relight.figures.dress import DETAILS
    from relight.figures.export import FORMATS
    from relight.files import UserError, atomic_write
    from relight.progress import progress

    numbers = seeds_of(seeds)
    if export not in FORMATS:
        raise UserError(f"--export {export}: {' or '.join(FORMATS)}")
    if detail not in DETAILS:
        raise UserError(f"--detail {detail}: {' or '.join(DETAILS)}")
    if device not in DEVICES:
        raise UserError(f"--device {device}: {', '.join(DEVICES)}")
    asked = [detail, texture, per_subject, shading, device]
    tasks = [(seed, asked, out / f"g{seed:04d}.{export}") for seed in numbers]
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        rows = list(progress(pool.imap(one, tasks), "figures", total=len(tasks)))
    failed = [str(row["error"]) for row in rows if "error" in row]
    good = [row for row in rows if "error" not in row]
    if good:
        with atomic_write(out / "figures.csv") as tmp, open(tmp, "w", newline="") as file:
            table = csv.writer(file)
            table.writerow(good[0])
            table.writerows([v if isinstance(v, str) else json.dumps(v) for v in row.values()] for row in good)
    if failed:
        raise UserError(f"{len(failed)} of {len(rows)} figures failed: {failed[0]}")


def one(task: tuple[int, list, Path]) -> dict:
    """Makes and writes one figure, unless it is there; returns its info, or {"error": why}."""
    import json

    from relight.figures.dress import make_figure
    from relight.figures.export import export
    from relight.files import UserError, atomic_write

    seed, asked, path = task
    note = path.with_suffix(".json")
    if path.is_file() and note.is_file():
        info = json.loads(note.read_text())
        if info.get("asked") == asked:
            return info
    try:
        mesh = make_figure(seed, *asked)
        mesh.info["asked"] = asked
        export(mesh, path)
        with atomic_write(note) as tmp:
            tmp.write_text(json.dumps(mesh.info, indent=1) + "\n")
        return mesh.info
    except UserError as error:
        return {"error": str(error)}
