"""The commands `photo`, `transfer`, `movie` and `mask`."""

import functools
import inspect
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from relight.photos.photo import Options

app = typer.Typer()
mask_app = typer.Typer(help="Automatic masks: set them up once, or write one to correct it.", no_args_is_help=True)

LIGHTS = """

\b
Lights, for --light:
  auto                    that of the picture in --background, or else a warm
                          lamp from the darker side of the person
  key:#ffd9a0@70,20,0.15  a lamp: color, degrees to the right and up, fill;
                          left and below are negative; quote it in a shell
  hall  park  ...         a real panorama, after `relight light setup`
  place:street.jpg        the light of a place; @-60,40 says where it is from
  room:7  sky:3  lamps:5  generated surroundings, each number another one;
                          room:7:40 is turned by 40 degrees
  kitchen.hdr  .exr .pfm  a panorama
  light.json  .npy .csv   coefficients
  other.jpg               the light of another photo of somebody

\b
Examples:
  {examples}

All about it: docs/photos.md."""
PHOTO_EXAMPLES = """relight photo me.jpg
  relight photo me.jpg --light "key:#b8ccff@-70,30,0.1" --out cold
  relight photo me.jpg --background street.jpg
  relight photo me.jpg -l room:12 --background panorama --blur 3
  relight photo holiday/ --light sky:3 --jobs 2"""
MOVIE_EXAMPLES = """relight movie me.jpg --out turn.mp4
  relight movie clip.mp4 --light room:12 --out relit.webm"""


def option(text: str, *names: str, panel: str | None = None, metavar: str | None = None, **bounds: Any) -> Any:
    """Returns an option whose row fits the help of a narrow terminal.

    Args:
        text: the help.
        *names: such as "--out" and "-o".
        panel: heading in the help; None for the general one.
        metavar: name of the value, short.
        **bounds: `min` and `max` of a number.
    """
    return typer.Option(*names, help=text, rich_help_panel=panel, metavar=metavar, **bounds)


LIGHT, BEHIND, PANORAMA = "Light", "Background", "How a light's file is read"
LightTexts = Annotated[
    list[str] | None,
    option("The new light; see above. Several lights add up.", "--light", "-l", panel=LIGHT, metavar="LIGHT"),
]
MaskPath = Annotated[Path | None, option("White on the people, as large as the photo.", "--mask", "-m", metavar="FILE")]
LightMask = Annotated[
    Path | None, option("Mask of the photo that --light names.", "--light-mask", panel=LIGHT, metavar="FILE")
]
MaskModel = Annotated[
    Path | None, option("ONNX network for automatic masks, like rembg's.", "--mask-model", metavar="FILE")
]
Mode = Annotated[
    str,
    option(
        "ratio: photo times new over old shading, keeps all detail; full: albedo times new shading.",
        "--mode",
        metavar="WORD",
    ),
]
WhiteBalance = Annotated[
    str,
    option(
        "keep: take the photo's light to be white; scene: take it to have the inferred color.",
        "--white-balance",
        panel=LIGHT,
        metavar="WORD",
    ),
]
BACKGROUND = {"panel": BEHIND, "metavar": "WORD"}
BackgroundText = Annotated[
    str, option("keep, transparent, panorama, a color (#334455) or a picture.", "--background", "-b", **BACKGROUND)
]
BackgroundOfTwo = Annotated[
    str, option("keep, transparent, a color (#334455) or a picture.", "--background", "-b", **BACKGROUND)
]
Blur = Annotated[
    float,
    option(
        "Blur of the panorama or picture behind, degrees.", "--blur", panel=BEHIND, metavar="DEGREES", min=0, max=60
    ),
]
Shadow = Annotated[
    bool, option("Cast shadows on the ground of a new background.", "--shadow/--no-shadow", panel=BEHIND)
]
Turn = Annotated[
    float,
    option(
        "Turn the light about the vertical, to the right.", "--turn", panel=LIGHT, metavar="DEGREES", min=-360, max=360
    ),
]
Stops = Annotated[
    float,
    option("Brighten the result; negative: darken it.", "--stops", panel=LIGHT, metavar="STOPS", min=-8, max=8),
]
Absolute = Annotated[
    bool, option("Keep the light's own strength instead of matching it to the photo.", "--absolute", panel=LIGHT)
]
Together = Annotated[bool, option("Take the whole mask as one person, even if it has several parts.", "--together")]
Layout = Annotated[
    str,
    option(
        "Of a panorama: auto, latlong, angular, ball, cross, strip, strip-gl.",
        "--layout",
        panel=PANORAMA,
        metavar="WORD",
    ),
]
Yaw = Annotated[
    float,
    option("Turn a panorama whose front is wrong, to the right.", "--yaw", panel=PANORAMA, metavar="DEGREES"),
]
Flip = Annotated[bool, option("Mirror a panorama left to right.", "--flip", panel=PANORAMA)]
UpsideDown = Annotated[bool, option("Its rows are from the bottom up.", "--upside-down", panel=PANORAMA)]
Convention = Annotated[
    str | None,
    option("Of a coefficient file that does not state it.", "--convention", panel=PANORAMA, metavar="WORD"),
]
Weights = Annotated[
    Path | None,
    option("A network (.onnx); `relight export` writes one of a training.", "--weights", "-w", metavar="FILE"),
]
Size = Annotated[
    int,
    option("Largest length of the longer side.", "--size", metavar="PIXELS", min=16, max=4096),
]
DEFAULT = "auto"  # relight.photos.person.AUTO, whose module needs numpy


def relighting_options(
    light: LightTexts = None,
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
        light=" + ".join(light or [DEFAULT]),
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


def with_relighting_options(examples: str) -> Callable[[Callable], Callable]:
    """Gives a command the parameters of `relighting_options`, and their values as the argument `options`.

    Args:
        examples: for its help, which also lists the lights.
    """

    def decorate(command: Callable) -> Callable:
        signature, shared = inspect.signature(command), inspect.signature(relighting_options)
        parameters = [p for p in signature.parameters.values() if p.name != "options"]
        parameters += shared.parameters.values()

        @functools.wraps(command)
        def wrapper(**values):
            options = relighting_options(**{name: values.pop(name) for name in shared.parameters})
            return command(**values, options=options)

        wrapper.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        wrapper.__annotations__ = {p.name: p.annotation for p in parameters}
        wrapper.__doc__ = f"{command.__doc__}{LIGHTS.format(examples=examples)}"
        return wrapper

    return decorate


@app.command()
@with_relighting_options(PHOTO_EXAMPLES)
def photo(
    path: Annotated[Path, typer.Argument(help="A photo, or a folder of photos.", metavar="PHOTO")],
    options: "Options",
    mask: MaskPath = None,
    out: Annotated[
        Path | None, option("Folder for the results; by default PHOTO_relit.", "--out", "-o", metavar="FOLDER")
    ] = None,
    together: Together = False,
    maps: Annotated[bool, option("Also write maps.exr: albedo, shading, normals and transport.", "--maps")] = False,
    weights: Weights = None,
    jobs: Annotated[
        int | None, option("For a folder: photos relit at the same time.", "--jobs", "-j", metavar="N", min=1)
    ] = None,
) -> None:
    """Relight the people in a photo, or in each photo of a folder."""
    from relight.errors import UserError

    if not path.exists():
        raise UserError(f"photo: there is no file or folder {path}")
    options = replace(options, together=together, maps=maps)
    if out is None:
        named = path.resolve() if path.name in ("", "..") else path  # "." has no name of its own
        out = named.with_name(f"{named.stem if path.is_file() else named.name}_relit")
    if path.is_dir():
        from relight.photos.folder import relight_folder

        summary = relight_folder(path, out, options, mask, weights, jobs)
        print(f"{out}: {summary}")
        if summary.failed:
            raise typer.Exit(1)
        return
    from relight.photos.api import load
    from relight.photos.mask.find import NoMaskNetwork
    from relight.photos.photo import BEFORE_AFTER, relight_file
    from relight.photos.trust import notes_of

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
    print(f"{out}/{BEFORE_AFTER}: both side by side")
    for note in notes_of(record):
        print(f"note: {note}")


@app.command()
def transfer(
    first: Annotated[Path, typer.Argument(help="One photo.", metavar="A")],
    second: Annotated[Path, typer.Argument(help="The other photo.", metavar="B")],
    first_mask: Annotated[Path | None, typer.Option("--mask-a", help="Mask of A.")] = None,
    second_mask: Annotated[Path | None, typer.Option("--mask-b", help="Mask of B.")] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the two results.")] = Path("transfer"),
    mode: Mode = "ratio",
    white_balance: WhiteBalance = "keep",
    background: BackgroundOfTwo = "keep",
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
    paths, notes = swap_lights(load(weights), (first, second), (first_mask, second_mask), out, options)
    print("\n".join([*map(str, paths), *(f"note: {note}" for note in notes)]))


@app.command()
@with_relighting_options(MOVIE_EXAMPLES)
def movie(
    path: Annotated[Path, typer.Argument(help="A photo, a video, or a folder of frames.", metavar="PHOTO|CLIP")],
    options: "Options",
    out: Annotated[Path, option("The movie: .mp4, .webm or .gif.", "--out", "-o", metavar="FILE")] = Path("relit.mp4"),
    mask: Annotated[
        Path | None,
        option("Mask of the photo; for a clip, a folder or a video of masks.", "--mask", "-m", metavar="FILE"),
    ] = None,
    seconds: Annotated[
        float | None,
        option("Length of the movie of a photo; by default 6.", "--seconds", metavar="SECONDS", min=0.1, max=600),
    ] = None,
    fps: Annotated[
        float | None,
        option("Frames per second; by default 25, or the clip's own.", "--fps", metavar="N", min=1, max=120),
    ] = None,
    turns: Annotated[
        float | None, option("Turns of the light; by default 1 for a photo, 0 for a clip.", "--turns", metavar="N")
    ] = None,
    size: Size = 1080,
    weights: Weights = None,
) -> None:
    """Write a movie: a photo under a turning light, or a relit clip of moving people. The exposure is fixed."""
    from relight.errors import UserError
    from relight.photos.video import writable_video

    writable_video(out)
    if options.background in ("transparent", "none"):
        raise UserError("a movie cannot be transparent: give another --background")
    if not path.exists():
        raise UserError(f"movie: there is no file or folder {path}")
    if out.exists() and out.samefile(path):
        raise UserError(f"movie {out} would overwrite the clip: give another --out")
    from relight.photos.api import load
    from relight.photos.movie import write_movie

    notes = write_movie(load(weights), path, mask, out, options, seconds, fps, turns, size)
    print("\n".join([str(out), *(f"note: {note}" for note in notes)]))


@mask_app.command("setup")
def mask_setup(
    wheel: Annotated[
        Path | None, typer.Option("--from", help="A wheel of mediapipe 0.10.21 that you have, instead of a download.")
    ] = None,
) -> None:
    """Fetch the built-in network for masks, once: 249 KB of the package mediapipe (Apache-2.0), with the licence."""
    from relight.photos.mask.selfie import setup

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
    from relight.errors import UserError
    from relight.files import writable_file
    from relight.photos.mask.find import automatic_mask
    from relight.photos.read import read_photo
    from relight.photos.write import write_picture

    out = out or path.with_name(f"{path.stem}_mask.png")
    if out.exists():  # it may have been corrected, or be the photo
        raise UserError(f"{out} exists: delete it for a new one, or give another --out")
    out = writable_file(out, "--out")
    write_picture(out, automatic_mask(read_photo(path), mask_model))
    print(out)


def at_terminal() -> bool:
    """Returns whether somebody can answer a question."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def _text(path: Path | None) -> str | None:
    """Returns a path as text, or None for None: the options of a photo are plain values."""
    return None if path is None else str(path)
