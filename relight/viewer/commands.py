"""`relight view`, a figure or a photo as one page to turn the light on, and `relight web`, a site that opens photos."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from relight.core.errors import UserError
from relight.core.progress import progress

app = typer.Typer()
Lights = Annotated[
    list[str] | None,
    typer.Option("--light", "-l", help="A light to offer instead of the usual ones; may be given several times."),
]
Size = Annotated[int, typer.Option(min=64, max=4096, help="A photo's longer side is scaled down to this, pixels.")]
Weights = Annotated[Path | None, typer.Option("--weights", "-w", help="A network (.onnx).")]
web_app = typer.Typer(
    help="A site that relights photos in the browser. Nothing leaves the visitor's computer.", no_args_is_help=True
)


@app.command()
def view(
    paths: Annotated[list[Path], typer.Argument(help="Maps (.exr) or photos; several make a gallery.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="The page; by default beside the first file.")] = None,
    light: Lights = None,
    mask: Annotated[
        Path | None, typer.Option("--mask", "-m", help="Mask of a single photo: white on the people, same size.")
    ] = None,
    background: Annotated[
        str | None,
        typer.Option("--background", "-b", help="Background to show first: studio, light, color, clear or photo."),
    ] = None,
    size: Size = 1024,
    weights: Weights = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Write one self-contained .html page: drag to turn the light, choose lights, drop your own .hdr."""
    from relight.core.files import writable_file
    from relight.viewer.build import build_viewer
    from relight.viewer.source import figure_of, load, named_lights

    photos = [path for path in paths if path.suffix.lower() != ".exr"]
    if mask is not None and len(photos) != 1:
        raise UserError(f"--mask belongs to one photo, not to {len(photos)}: name masks me_mask.png beside me.jpg")
    out = writable_file(out or paths[0].parent / f"{paths[0].resolve().stem}.html", "page")
    if out.suffix.lower() not in (".html", ".htm"):
        raise UserError(f"page {out}: the name must end in .html")
    relighter = load(weights) if photos else None
    figures = [figure_of(path, relighter, mask, size) for path in progress(paths, "figures inferred")]
    build_viewer(out, figures, named_lights(light or ()), background, figures[0].title)
    typer.echo(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
    for note in (f"note: {figure.title}: {note}" for figure in figures for note in figure.notes):
        typer.echo(note)
    if open_:
        typer.launch(out.resolve().as_uri())


@web_app.command("build")
def web_build(
    out: Annotated[
        Path,
        typer.Argument(help="Folder of the site: a new one, or an earlier site, which is replaced.", metavar="DIR"),
    ],
    paths: Annotated[
        list[Path] | None,
        typer.Argument(help="Maps (.exr) or photos to show first; by default a portrait (NASA).", metavar="FILE"),
    ] = None,
    light: Lights = None,
    size: Size = 1024,
    weights: Weights = None,
) -> None:
    """Write the site to the folder DIR, for any static web server."""
    from relight.photos.network import WEIGHTS
    from relight.viewer.site import build_site
    from relight.viewer.source import figure_of, load, named_lights, portrait

    network = weights or WEIGHTS
    relighter = load(network)
    if relighter.network.order < 2:
        raise UserError(f"the site needs a network of order 2; {network} has order {relighter.network.order}")
    inferred = progress(paths or (), "figures inferred")
    figures = [figure_of(path, relighter, size=size) for path in inferred] or [portrait(relighter)]
    build_site(out, network, relighter.network.size, figures, named_lights(light or ()))
    size = sum(path.stat().st_size for path in out.iterdir())
    shown = "; of its network, bands 0 to 2 are shown" * (relighter.network.order > 2)
    typer.echo(f"{out}: {size / 1e6:.0f} MB{shown}")
    serve = f"python -m http.server --bind 127.0.0.1 --directory {shlex.quote(str(out))}"
    typer.echo(f"to look at it: {serve}, then http://127.0.0.1:8000")


@web_app.command("setup")
def web_setup(
    package: Annotated[
        Path | None, typer.Option("--from", help="The .tgz that `npm pack` writes, instead of the registry.")
    ] = None,
) -> None:
    """Fetch onnxruntime-web, which runs networks in browsers, once: 33 MB from the npm registry (MIT licence)."""
    from relight.viewer.runtime import PACKAGE, setup

    if package is None:
        print(f"downloading {PACKAGE.file_name} (33 MB)", flush=True)
    print(f"{setup(package)}: `relight web build DIR` writes sites from now on")
