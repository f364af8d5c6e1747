"""The commands `photo`, `transfer`, `movie`, `export` and `mask`. They import torch only when they run."""

import functools
import inspect
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from relight.lights.commands import OUT, TO, report
from relight.lights.commands import app as light_app

if TYPE_CHECKING:
    from relight.photos.photo import Options

app = typer.Typer()
mask_app = typer.Typer(help="Automatic masks: set them up once, or write one to correct it.", no_args_is_help=True)

LightText = Annotated[
    str,
    typer.Option(
        "--light",
        "-l",
        help="Panorama, light file, hall, room:N, sky:N, lamps:N, key:#RRGGBB@AZIMUTH,ELEVATION, place:PICTURE or a "
        "photo of somebody; by default the place in --background, if it is a picture, else room:7.",
        show_default=False,
    ),
]
MaskPath = Annotated[
    Path | None, typer.Option("--mask", "-m", help="Mask: white on the people, same size as the photo.")
]
LightMask = Annotated[Path | None, typer.Option(help="Mask of the photo that --light names.")]
MaskModel = Annotated[Path | None, typer.Option(help="ONNX network for automatic masks, like rembg's.")]
Mode = Annotated[
    str, typer.Option(help="ratio: photo times new over old shading, keeps all detail; full: albedo times new shading.")
]
WhiteBalance = Annotated[
    str,
    typer.Option(help="keep: take the photo's light to be white; scene: take it to have the inferred colour."),
]
BackgroundText = Annotated[
    str, typer.Option("--background", "-b", help="keep, transparent, panorama, a colour (#334455) or a picture.")
]
Blur = Annotated[float, typer.Option(min=0, max=60, help="Blur of the background panorama, degrees.")]
Shadow = Annotated[bool, typer.Option("--shadow/--no-shadow", help="Cast shadows on the ground of a new background.")]
Turn = Annotated[float, typer.Option(help="Rotation of the light about the vertical, degrees.")]
Stops = Annotated[
    float, typer.Option(min=-8, max=8, help="Brighten the result by this many stops; negative: darken it.")
]
Absolute = Annotated[
    bool, typer.Option("--absolute", help="Keep the light's own strength instead of matching it to the photo.")
]
Together = Annotated[
    bool, typer.Option("--together", help="Take the whole mask as one person, even if it has several parts.")
]
Layout = Annotated[
    str, typer.Option(help="Layout of a panorama: auto, latlong, angular, ball, cross, strip, strip-gl.")
]
Yaw = Annotated[float, typer.Option(help="Rotate a panorama whose front is wrong, degrees; front goes to the right.")]
Flip = Annotated[bool, typer.Option("--flip", help="Mirror a panorama left to right.")]
UpsideDown = Annotated[bool, typer.Option("--upside-down", help="The panorama's rows are from the bottom up.")]
Convention = Annotated[str | None, typer.Option(help="Convention of a coefficient file that does not state it.")]
Weights = Annotated[
    Path | None,
    typer.Option(
        "--weights",
        "-w",
        help="A network: .onnx, .safetensors, or, after `relight run experiment=photo`, models:/relight@photo.",
    ),
]
Size = Annotated[int, typer.Option(min=16, max=4096, help="Largest length of the longer side, pixels.")]


def relighting_options(
    light: LightText = "",
    mode: Mode = "ratio",
    white_balance: WhiteBalance = "keep",
    background: BackgroundText = "keep",
    blur: Blur = 0.0,
    shadow: Shadow = True,
    turn: Turn = 0.0,
    stops: Stops = 0.0,
    absolute: Absolute = False,
    light_mask: LightMask = None,
    mask_model: MaskModel = None,
    layout: Layout = "auto",
    yaw: Yaw = 0.0,
    flip: Flip = False,
    upside_down: UpsideDown = False,
    convention: Convention = None,
) -> "Options":
    """Adds the options that `photo` and `movie` share."""
    from relight.photos.photo import Options

    return Options(
        light=light,
        mode=mode,
        white_balance=white_balance,
        background=background,
        blur=blur,
        shadow=shadow,
        turn=turn,
        stops=stops,
        match=not absolute,
        light_mask=_text(light_mask),
        mask_model=_text(mask_model),
        layout=layout,
        yaw=yaw,
        flip=flip,
        upside_down=upside_down,
        convention=convention,
    )


def with_relighting_options(command: Callable) -> Callable:
    """Gives a command the parameters of `relighting_options`, and their values as the argument `options`."""
    own, shared = inspect.signature(command), inspect.signature(relighting_options)
    parameters = [p for p in own.parameters.values() if p.name != "options"] + list(shared.parameters.values())

    @functools.wraps(command)
    def wrapper(**values):
        options = relighting_options(**{name: values.pop(name) for name in shared.parameters})
        return command(**values, options=options)

    wrapper.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    wrapper.__annotations__ = {p.name: p.annotation for p in parameters}
    return wrapper


@app.command()
@with_relighting_options
def photo(
    path: Annotated[Path, typer.Argument(help="A photo, or a folder of photos.", metavar="PHOTO")],
    options: "Options",
    mask: MaskPath = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the results; by default PHOTO_relit.")
    ] = None,
    together: Together = False,
    maps: Annotated[
        bool, typer.Option("--maps", help="Also write maps.exr: albedo, shading and transport in half floats.")
    ] = False,
    weights: Weights = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", min=1, help="For a folder: photos relit at the same time.")
    ] = None,
) -> None:
    """Relight the people in a photo, or in each photo of a folder."""
    from relight.files import UserError

    if not path.exists():
        raise UserError(f"photo: there is no file or folder {path}")
    options = replace(options, together=together, maps=maps)
    out = out or path.with_name(f"{path.stem if path.is_file() else path.name}_relit")
    if path.is_dir():
        from relight.photos.folder import relight_folder

        summary = relight_folder(path, out, options, mask, weights, jobs)
        print(f"{out}: {summary}")
        if summary.failed:
            raise typer.Exit(1)
        return
    from relight.photos.api import load
    from relight.photos.mask import NoMaskNetwork
    from relight.photos.photo import relight_file

    relighter = load(weights)
    try:
        record = relight_file(relighter, path, out, options, mask)
    except NoMaskNetwork:
        if not at_terminal():
            raise
        print(f"{path.name} has no mask. A network that finds people can be fetched, once (a download of 36 MB).")
        if not typer.confirm("Fetch it now?", default=True):
            raise
        mask_setup()
        record = relight_file(relighter, path, out, options, mask)
    print(f"{out}/{record['picture']}: {path.name} in the light of {record['light']['name']}")
    _print_notes(record)


@app.command()
def transfer(
    first: Annotated[Path, typer.Argument(help="One photo.", metavar="A")],
    second: Annotated[Path, typer.Argument(help="The other photo.", metavar="B")],
    first_mask: Annotated[Path | None, typer.Option("--mask-a", help="Mask of A.")] = None,
    second_mask: Annotated[Path | None, typer.Option("--mask-b", help="Mask of B.")] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the two results.")] = Path("transfer"),
    mode: Mode = "ratio",
    white_balance: WhiteBalance = "keep",
    background: BackgroundText = "keep",
    shadow: Shadow = True,
    stops: Stops = 0.0,
    mask_model: MaskModel = None,
    weights: Weights = None,
) -> None:
    """Swap the lights of two photos; exposures stay. Writes OUT/A_lit_as_B.png and OUT/B_lit_as_A.png."""
    from relight.photos.api import load
    from relight.photos.photo import Options, swap_lights

    options = Options(
        mode=mode,
        white_balance=white_balance,
        background=background,
        shadow=shadow,
        stops=stops,
        mask_model=_text(mask_model),
    )
    for path in swap_lights(load(weights), (first, second), (first_mask, second_mask), out, options):
        print(path)


@app.command()
@with_relighting_options
def movie(
    path: Annotated[Path, typer.Argument(help="A photo, a video, or a folder of frames.", metavar="PHOTO|CLIP")],
    options: "Options",
    out: Annotated[Path, typer.Option("--out", "-o", help="The movie: .mp4, .webm or .gif.")] = Path("relit.mp4"),
    mask: Annotated[
        Path | None, typer.Option("--mask", "-m", help="Mask of the photo; for a clip, a folder or a video of masks.")
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.1, max=600, help="Length of the movie of a photo.")] = 6.0,
    fps: Annotated[
        float | None, typer.Option(min=1, max=120, help="Frames per second; by default 25, or the clip's own.")
    ] = None,
    turns: Annotated[
        float | None, typer.Option(help="Turns of the light; by default 1 for a photo, 0 for a clip.")
    ] = None,
    size: Size = 1080,
    weights: Weights = None,
) -> None:
    """Write a movie: a photo under a turning light, or a relit clip of moving people. The exposure is fixed."""
    from relight.files import UserError
    from relight.photos.video import writable_video

    writable_video(out)
    if options.background in ("transparent", "none"):
        raise UserError("a movie cannot be transparent: give another --background")
    if not path.exists():
        raise UserError(f"movie: there is no file or folder {path}")
    from relight.photos.api import load
    from relight.photos.movie import write_movie

    write_movie(load(weights), path, mask, out, options, seconds, fps, turns, size)
    print(out)


@app.command()
def export(
    checkpoint: Annotated[Path, typer.Argument(help="A network that a training wrote (.safetensors).")],
    out: Annotated[Path, typer.Argument(help="The .onnx file to write.")],
) -> None:
    """Write a trained network as one graph (.onnx) for `relight photo -w` and other programs, for any image size."""
    from relight.learning.checkpoint import load_network
    from relight.learning.export import export as write

    network, config = load_network(checkpoint)
    difference = write(network, out, config)
    print(f"{out}: differs from torch by {difference:.1e} at most")


@light_app.command("place")
def light_place(
    picture: Annotated[
        str, typer.Argument(help="A photo of a place, also with the light's direction: street.jpg@AZIMUTH,ELEVATION.")
    ],
    out: OUT = None,
    to: TO = "relight",
) -> None:
    """Estimate the light of a place from an ordinary photograph of it, without a person."""
    from relight.photos.place import read_place

    report(read_place(picture), to, out or [])


@mask_app.command("setup")
def mask_setup(
    wheel: Annotated[
        Path | None, typer.Option("--from", help="A wheel of mediapipe 0.10.21 that you have, instead of a download.")
    ] = None,
) -> None:
    """Fetch the built-in network for masks, once: 249 KB of the package mediapipe (Apache-2.0), with the licence."""
    from relight.photos.selfie import setup

    if wheel is None:
        print("downloading mediapipe 0.10.21 (36 MB), of which 249 KB are kept", flush=True)
    print(f"{setup(wheel)}: photos without a mask get one from now on")


@mask_app.command("draw")
def mask_draw(
    path: Annotated[Path, typer.Argument(help="A photo.", metavar="PHOTO")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The mask; by default PHOTO_mask.png beside the photo.")
    ] = None,
    mask_model: MaskModel = None,
) -> None:
    """Write the automatic mask of a photo, to correct in a paint program. `relight photo` finds it beside the photo."""
    from relight.files import writable_file
    from relight.photos.mask import automatic_mask
    from relight.photos.read import read_photo
    from relight.photos.write import write_picture

    out = writable_file(out or path.with_name(f"{path.stem}_mask.png"), "--out")
    write_picture(out, automatic_mask(read_photo(path), mask_model))
    print(out)


def at_terminal() -> bool:
    """Returns whether somebody can answer a question."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)


def _print_notes(record: dict) -> None:
    for note in record["notes"] + record["light"]["notes"] + record["mask"]["notes"]:
        print(f"note: {note}")
    for number, person in enumerate(record["people"], 1):
        for warning in person["warnings"]:
            print(f"note{f' on person {number}' if len(record['people']) > 1 else ''}: {warning}")
