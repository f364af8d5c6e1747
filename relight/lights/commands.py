"""`relight light`: prints, writes and draws the coefficients and statistics of a light."""

import re
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from relight.core.files import PHOTO_SUFFIXES


class Numbers(TyperGroup):
    """Runs the command `numbers` where none is named."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # ctx is click's, which Typer bundles privately
        if args and args[0] not in {*self.commands, "--help", "-h"}:
            args = ["numbers", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(cls=Numbers, no_args_is_help=True, help="Print, write or draw a light.")


@app.command()
def numbers(
    light: Annotated[
        str,
        typer.Argument(
            help="A panorama (.hdr, .exr), coefficients (.npy, .json), a photo of a place (street.jpg, "
            "street.jpg@-60,40), lights.npz:12 of a set, or a name, such as room:7 (relight photo --help has all)."
        ),
    ],
    out: Annotated[
        list[Path] | None,
        typer.Option(
            "--out",
            "-o",
            help="Also write the coefficients (.json, .npy) or draw panorama, diffuse panorama and lit ball (.png); "
            "may be repeated.",
        ),
    ] = None,
    to: Annotated[str, typer.Option(help="Convention to print and write in.")] = "relight",
    order: Annotated[int, typer.Option(min=0, max=6, help="Of the harmonics; 2 gives nine coefficients.")] = 2,
    layout: Annotated[
        str,
        typer.Option(
            help="auto, latlong, angular, ball, cross, strip or strip-gl; square pictures need one other than auto."
        ),
    ] = "auto",
    yaw: Annotated[float, typer.Option(help="Turns the light about the vertical, degrees, from front to right.")] = 0.0,
    flip: Annotated[bool, typer.Option("--flip", help="Mirror left and right.")] = False,
    convention: Annotated[
        str | None,
        typer.Option("--from", help="Convention of a file of coefficients: kanamori2018, dpr, ramamoorthi2001 ..."),
    ] = None,
    repair: Annotated[
        bool, typer.Option("--repair", help="Replace non-finite pixels; rebuild a sun without red.")
    ] = False,
) -> None:
    """Print the spherical harmonics of a light and its statistics. `relight light kitchen.hdr` is short for it."""
    from rich.console import Console
    from rich.table import Table

    from relight.lights.light import light_file, parts_of, write_light
    from relight.lights.load import load_light
    from relight.lights.show import format_statistics, write_light_picture
    from relight.sh import bands, from_relight

    files = [path if path.suffix.lower() == ".png" else light_file(path, to) for path in out or []]
    light = " + ".join(map(_as_place, parts_of(light)))
    loaded = load_light(light, order, layout, yaw, flip, convention, repair)
    coefficients = from_relight(loaded.coefficients, to)
    for path in files:  # before anything is printed, which may go to a pipe that closes
        if path.suffix.lower() == ".png":
            write_light_picture(loaded, path)
        else:
            write_light(loaded, path, to)
    channels = "BGR" if to == "kanamori2018" else "RGB"
    number = " .6f" if abs(coefficients).max() > 0.01 else " .6e"
    table = Table("l, m", *channels, title=f"{loaded.source}, convention {to}", title_justify="left")
    for k, (l, row) in enumerate(zip(bands(loaded.order), coefficients)):
        name = str(k) if to == "kanamori2018" else f"{l}, {k - l * l - l}"
        table.add_row(name, *(f"{value:{number}}" for value in row))
    console = Console(highlight=False)
    console.print(table)
    for name, value in format_statistics(loaded):
        console.print(f"  {name:32s} {value}")
    for note in loaded.notes:
        typer.echo(note, err=True)
    for path in files:
        console.print(f"written: {path}", soft_wrap=True)


def _as_place(light: str) -> str:
    """Returns the name of a light, where it is that of a photo, such as street.jpg@-60,40, with `place:` before it."""
    file = re.sub(r"@[-+.,\d]+$", "", light)
    return f"place:{light}" if Path(file).suffix.lower() in PHOTO_SUFFIXES and not light.startswith("place:") else light


@app.command()
def setup(
    package: Annotated[
        Path | None, typer.Option("--from", help="The .tgz that `npm pack` writes, instead of the registry.")
    ] = None,
) -> None:
    """Fetch 18 real panoramas by Poly Haven, once: 2.8 MB of the npm package @pmndrs/assets (CC0)."""
    from relight.panoramas import polyhaven

    if package is None:
        print(f"downloading {polyhaven.PACKAGE.file_name} (14 MB), of which 2.8 MB are kept", flush=True)
    print(f"{polyhaven.setup(package)}: from now on these are names of lights: {', '.join(polyhaven.NAMES)}")
