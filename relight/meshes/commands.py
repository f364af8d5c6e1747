"""`relight scans`: what is in a folder of scans, what would become of one, and which BUFF frames to take."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Your own figures: list a folder, check a file, choose frames of BUFF.", no_args_is_help=True)


@app.command("list")
def list_(folder: Annotated[Path, typer.Argument(help="Folder of scans.")]) -> None:
    """Names, subjects and files of the figures in a folder."""
    from relight.meshes.scans import list_scans

    scans = list_scans(folder)
    width = max(map(len, scans))
    for name, scan in scans.items():
        print(f"{name:{width}}  {scan.subject:{width}}  {scan.path}")


@app.command()
def check(
    mesh: Annotated[Path, typer.Argument(help="A .ply, .obj, .glb or .gltf file.")],
    up: Annotated[str, typer.Option(help="Axis that points up: +y, +z, ... or auto.")] = "auto",
    front: Annotated[str, typer.Option(help="Axis that the figure faces, or auto.")] = "auto",
) -> None:
    """Reads, cleans and aligns one file, and says what was found and repaired."""
    from relight.config import Align, composed
    from relight.meshes.align import align
    from relight.meshes.clean import clean
    from relight.meshes.read import read_mesh

    settings = composed()
    read = read_mesh(mesh)
    textures = [material.texture for material in read.materials if material.texture is not None]
    result = align(clean(read, settings.clean), Align(up=up, front=front, padding=settings.align.padding, version=0))
    size = " x ".join(f"{extent:.4g}" for extent in read.vertices.max(axis=0) - read.vertices.min(axis=0))
    print(f"{mesh.name}: {len(read.faces)} faces, {len(read.vertices)} vertices, {size} units")
    print(
        f"  materials  {len(read.materials)}, {len(textures)} textured"
        + (", vertex colours" * (read.color is not None))
    )
    print(f"  axes       {result.info['align']['up']} up, facing {result.info['align']['front']}")
    for what, count in result.info["repairs"].items():
        print(f"  {what}: {count}")
    for warning in result.info["warnings"]:
        print(f"  warning: {warning}")


@app.command()
def pick(
    folder: Annotated[Path, typer.Argument(help="BUFF, unpacked.")],
    count: Annotated[int, typer.Option(min=1, help="Frames to choose.")] = 74,
    stride: Annotated[int, typer.Option(min=1, help="Look at every so many frames of a sequence.")] = 5,
    seed: Annotated[int, typer.Option(help="Of the clustering.")] = 0,
    out: Annotated[Path | None, typer.Option(help="The table; scans.csv in the folder by default.")] = None,
) -> None:
    """Chooses frames of BUFF that stand for the others, into a table that you may edit."""
    from relight.meshes import buff
    from relight.meshes.scans import TABLE

    out = out or folder / TABLE
    print(f"{buff.pick(folder, out, count, stride, seed)} frames in {out}")
