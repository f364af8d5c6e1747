"""`relight scans`: lists a folder, checks a file."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from relight.core.errors import UserError

app = typer.Typer(help="Your own figures: list a folder, check files.", no_args_is_help=True)


@app.command("list")
def list_(folder: Annotated[Path, typer.Argument(help="Folder of scans.")]) -> None:
    """List the figures of a folder: names, subjects and files."""
    from relight.meshes.scans import list_scans

    scans = list_scans(folder)
    width = max(map(len, scans))
    for name, scan in scans.items():
        print(f"{name:{width}}  {scan.subject:{width}}  {scan.path}")


@app.command()
def check(
    mesh: Annotated[Path, typer.Argument(help="A .ply, .obj, .glb, .gltf or .stl file, or a folder of them.")],
    up: Annotated[str, typer.Option(help="Axis that points up: +y, +z, ... or auto.")] = "auto",
    front: Annotated[str, typer.Option(help="Axis that the figure faces, or auto.")] = "auto",
) -> None:
    """Read, clean and align a file, or each of a folder, and print what was found and repaired."""
    from relight.core.files import require_safe_name
    from relight.meshes.scans import TABLE, list_scans, one_subject

    if not mesh.is_dir():
        _check(mesh, mesh.stem, up, front)
        return
    failed = 0
    table = str(mesh / TABLE) if (mesh / TABLE).is_file() else None
    for name, scan in (scans := list_scans(mesh)).items():
        try:
            require_safe_name(scan.path)  # else a run leaves it out
            _check(scan.path, name, up, front, table)
        except UserError as error:
            failed += 1
            print(error)
    if note := one_subject(scans):
        print(f"note: {note}")
    if failed:
        raise UserError(f"{failed} of {len(scans)} scans cannot be used")


def _check(mesh: Path, name: str, up: str, front: str, table: str | None = None) -> None:
    from relight.meshes import align, clean, read_mesh
    from relight.settings import Align

    original = read_mesh(mesh)
    original.info["name"] = name
    textures = [material.texture for material in original.materials if material.texture is not None]
    result = align(clean(original), Align(up, front, table))
    size = " x ".join(f"{extent:.4g}" for extent in original.vertices.max(axis=0) - original.vertices.min(axis=0))
    print(f"{mesh.name}: {len(original.faces)} faces, {len(original.vertices)} vertices, {size} units")
    colors = "" if original.color is None else ", vertex colors"
    print(f"  materials  {len(original.materials)}, {len(textures)} textured{colors}")
    axes = result.info["align"]
    print(f"  axes       {axes['up']} up, facing {axes['front']}")
    for what, count in result.info["repairs"].items():
        left = ", left as they are" if count and what in ("holes", "boundary edges", "parts") else ""
        print(f"  {what}: {count}{left}")
    for warning in result.info["warnings"]:
        print(f"  warning: {warning}")
    view = ["--up", axes["up"], "--front", axes["front"], *(["--yaw", f"{axes['turn']:g}"] if axes["turn"] else [])]
    words = [str(mesh), *view, "--out", f"{mesh.stem}_maps.png", "--rays", "16"]
    print(f"  to see it  relight bake {shlex.join(words)}")
