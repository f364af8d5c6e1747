"""`relight view`: a figure or a photo as one page to open, turn the light on, and send to others."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def view(
    paths: Annotated[list[Path], typer.Argument(help="Maps (.exr) or photos; several make a gallery.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="The page; beside the first file by default.")] = None,
    light: Annotated[
        list[str] | None,
        typer.Option("--light", "-l", help="A light to offer instead of the usual ones; may be given several times."),
    ] = None,
    mask: Annotated[
        Path | None, typer.Option("--mask", "-m", help="Of a single photo: white on the people, same size.")
    ] = None,
    background: Annotated[
        str | None, typer.Option("--background", "-b", help="Shown first: studio, light, color, clear or photo.")
    ] = None,
    title: Annotated[str, typer.Option(help="Of the page; the file's name by default.")] = "",
    size: Annotated[int, typer.Option(min=64, max=4096, help="A photo's longer side is scaled down to this.")] = 1024,
    limit: Annotated[
        float | None,
        typer.Option(
            min=0.1, max=100, help="Largest size of the page, MB: 6 by default, and 2.5 for each further figure."
        ),
    ] = None,
    weights: Annotated[Path | None, typer.Option("--weights", "-w", help="A checkpoint (.safetensors).")] = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Writes one self-contained .html: drag to turn the light, choose lights, drop your own .hdr."""
    from relight.files import UserError, writable_file
    from relight.viewer.build import build_gallery
    from relight.viewer.source import baked_figure, named_lights, photo_figure

    photos = [path for path in paths if path.suffix.lower() != ".exr"]
    if mask is not None and len(photos) != 1:
        raise UserError(
            f"--mask belongs to one photo, and {len(photos)} were given; name masks me_mask.png beside me.jpg"
        )
    out = writable_file(out or paths[0].with_suffix(".html"), "page")
    relighter = None
    figures = []
    for path in paths:
        if path not in photos:
            figures.append(baked_figure(path))
            continue
        from relight.photos.api import load
        from relight.photos.mask import find_mask
        from relight.photos.movie import downscale
        from relight.photos.read import mask_beside, read_photo

        photo = read_photo(path)
        relighter = relighter or load(weights)
        pixels, coverage = downscale(photo, find_mask(photo, mask or mask_beside(path)), size)
        figures.append(photo_figure(relighter, pixels, coverage, photo.name))
    build_gallery(
        out, figures, named_lights(light or ()), background, title or figures[0].title, limit and int(limit * 1e6)
    )
    typer.echo(f"{out}: {out.stat().st_size / 1e6:.1f} MB")
    if open_:
        typer.launch(out.resolve().as_uri())
