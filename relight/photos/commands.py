"""The commands `photo`, `movie` and `mask`."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from relight.core.errors import UserError

if TYPE_CHECKING:
    from relight.photos.inferred import SceneOptions

app = typer.Typer()
mask_app = typer.Typer(help="Automatic masks: set them up once, or write one to correct it.", no_args_is_help=True)

LIGHTS = """

\b
Lights, for --light:
  auto                    that of the picture in --background, or else a warm
                          lamp from the darker side of the person
  key:#ffe6c8@50,40,0.3   a lamp: color, degrees to the right and up, fill;
                          left and below are negative; quote it in a shell
  hall  park  ...         a real panorama, after `relight light setup`
  even                    light without a direction
  place:street.jpg        the light of a place; @-60,40 says where it is from
  {generated:22s}  generated surroundings by number;
                          room:7:40 is turned by 40 degrees
  kitchen.hdr  .exr       a panorama
  light.json  .npy .csv   coefficients
  other.jpg               the light of another photo of somebody

\b
Examples:
"""
PHOTO = """  relight photo me.jpg
  relight photo me.jpg --light "key:#b8ccff@-70,30,0.1" --out cold
  relight photo me.jpg --background street.jpg
  relight photo me.jpg -l room:36 --background panorama --blur 3
  relight photo holiday/ --light sky:3 --jobs 2

All about it: docs/photos.md."""
MOVIE = """  relight movie me.jpg --out turn.mp4
  relight movie clip.mp4 --light room:12 --out relit.webm

All about it: docs/photos.md."""


class Lit(TyperCommand):
    """Names the generated lights in its help, by a module that takes too long to import for anything else."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        from relight.lights.load import GENERATED

        self.help = (self.help or "").format(generated="  ".join(f"{kind}:7" for kind in GENERATED))
        super().format_help(ctx, formatter)


# Options of both commands, in words that fit the help of a narrow terminal.
lit = partial(typer.Option, rich_help_panel="Light")
behind = partial(typer.Option, rich_help_panel="Background")
file = partial(typer.Option, metavar="FILE")
Lights = Annotated[list[str] | None, lit("--light", "-l", metavar="LIGHT", help="The new light. Several add up.")]
LitBy = Annotated[str | None, lit(metavar="LIGHT", help="The photo's own light, if known: a lamp, a panorama ...")]
White = Annotated[str, lit(metavar="WORD", help="keep: the photo's light is white; scene: as it is inferred.")]
Turn = Annotated[
    float, lit(min=-360, max=360, metavar="DEGREES", help="Turn the light about the vertical, to the right.")
]
Stops = Annotated[float, lit(min=-8, max=8, metavar="STOPS", help="Brighten the result; negative: darken it.")]
Absolute = Annotated[bool, lit("--absolute", help="Keep the light's own strength, not matched to the photo.")]
Behind = Annotated[
    str, behind("--background", "-b", metavar="WORD", help="keep, transparent, panorama, a color, a picture, a clip.")
]
Blur = Annotated[float, behind(min=0, max=60, metavar="DEGREES", help="Blur of the panorama or picture behind.")]
Shadow = Annotated[bool, behind(help="Cast shadows on the ground of a new background.")]
Mask = Annotated[
    Path | None,
    file("--mask", "-m", help="White on the people, as large as the photo; of a clip, a folder or a video."),
]
MaskModel = Annotated[str | None, file(help="ONNX network for automatic masks; or FILE:bgr, :rgb, :signed.")]
Mode = Annotated[
    str, typer.Option(metavar="WORD", help="ratio: photo times new over old shading; full: albedo times new.")
]
Weights = Annotated[Path | None, file("--weights", "-w", help="A network (.onnx); `relight export` writes one.")]


@app.command(cls=Lit, help=f"Relight the people in a photo, in several, or in each photo of a folder.{LIGHTS}{PHOTO}")
def photo(
    paths: Annotated[list[Path], typer.Argument(help="A photo, several, or a folder of photos.", metavar="PHOTO...")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder of results, by default PHOTO_relit, of several photos relit; or a picture, .png or .jpg.",
            metavar="FOLDER|FILE",
        ),
    ] = None,
    light: Lights = None,
    lit_by: LitBy = None,
    mode: Mode = "ratio",
    white_balance: White = "keep",
    background: Behind = "keep",
    blur: Blur = 0.0,
    shadow: Shadow = True,
    turn: Turn = 0.0,
    stops: Stops = 0.0,
    absolute: Absolute = False,
    mask: Mask = None,
    mask_model: MaskModel = None,
    weights: Weights = None,
    together: Annotated[
        bool, typer.Option("--together", help="Take the whole mask as one person, even if it has several parts.")
    ] = False,
    maps: Annotated[bool, typer.Option("--maps", help="Also write albedo.png, shading.png and maps.exr.")] = False,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", min=1, help="For a folder: photos relit at the same time.", metavar="N"),
    ] = None,
) -> None:
    """Writes the results of photos."""
    from rich.console import Console

    from relight.core.files import PHOTO_SUFFIXES, VIDEO_SUFFIXES
    from relight.photos.background import read_background
    from relight.photos.folder import BEFORE_AFTER, Summary, photos_in, relight_file, relight_photos, relight_to
    from relight.photos.inferred import known_light
    from relight.photos.look import Look
    from relight.photos.mask.find import NoMaskNetwork
    from relight.photos.network import read_network

    path, several = paths[0], len(paths) > 1
    for each in paths:
        if not each.exists() or (several and each.is_dir()):
            raise UserError(f"photo: there is no file {'' if several else 'or folder '}{each}")
    out = out or (Path("relit") if several else relit(path))
    suffixes = *PHOTO_SUFFIXES, *VIDEO_SUFFIXES, ".exr", ".psd", ".jxl"
    picture = out if out.suffix.lower() in suffixes and not out.is_dir() else None  # alone
    network = read_network(weights)
    read_by = network, mask_model, white_balance
    look = Look(light, mode, read_background(background, blur, shadow), turn, stops, not absolute, *read_by)
    options: SceneOptions = {"mask_model": mask_model, "split": not together, "white_balance": white_balance}
    options["lit_by"] = known_light(lit_by, *read_by)
    if maps and picture:
        raise UserError(f"--maps writes several files, and --out {out} is one picture: give a folder")
    if several or path.is_dir():
        if picture:
            raise UserError(f"--out {out} is one picture, and there are several photos: give a folder")
        photos, summary = (paths, Summary()) if several else photos_in(path)
        relight_photos(photos, summary, out, look, mask, weights, jobs, maps, **options)
        print(f"{out}: {summary}")
        if summary.failed:
            raise typer.Exit(1)
        return

    def relight() -> tuple[str, list[str]]:
        with Console(stderr=True).status(f"relighting {path.name}"):
            if picture:
                return f"{picture}", relight_to(network, path, picture, look, mask, **options)
            record = relight_file(network, path, out, look, mask, maps, **options)
            return f"{out}/{record['picture']}: {path.name} in the light of {record['light']}", record["notes"]

    try:
        says, notes = relight()
    except NoMaskNetwork:
        if not at_terminal():
            raise
        print(f"{path.name} has no mask. Networks that find people can be fetched, once (a download of 36 MB).")
        if not typer.confirm("Fetch it now?", default=True):
            raise
        mask_setup()
        says, notes = relight()
    print(says)
    if not picture:
        print(f"{out}/{BEFORE_AFTER}: both side by side")
    for note in notes:
        print(f"note: {note}")


@app.command(
    cls=Lit,
    help="Write a movie: a photo under a turning light, or a relit clip of moving people. The exposure is fixed."
    f"{LIGHTS}{MOVIE}",
)
def movie(
    path: Annotated[Path, typer.Argument(help="A photo, a video, or a folder of frames.", metavar="PHOTO|CLIP")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The movie: .mp4, .webm or .gif; by default CLIP_relit.mp4.", metavar="FILE"),
    ] = None,
    light: Lights = None,
    lit_by: LitBy = None,
    mode: Mode = "ratio",
    white_balance: White = "keep",
    background: Behind = "keep",
    blur: Blur = 0.0,
    shadow: Shadow = True,
    turn: Turn = 0.0,
    stops: Stops = 0.0,
    absolute: Absolute = False,
    mask: Mask = None,
    mask_model: MaskModel = None,
    weights: Weights = None,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.1, max=600, help="Length of the movie of a photo; by default 6.", metavar="SECONDS"),
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option(min=1, max=120, help="Frames per second, for a photo or a folder; by default 25.", metavar="N"),
    ] = None,
    turns: Annotated[
        float | None, typer.Option(help="Turns of the light; by default 1 for a photo, 0 for a clip.", metavar="N")
    ] = None,
    size: Annotated[
        int, typer.Option(min=16, max=4096, help="Largest length of the longer side.", metavar="PIXELS")
    ] = 1080,
) -> None:
    """Writes a movie."""
    from relight.pictures.video import require_writable_video

    out = out or Path(f"{relit(path).name}.mp4")
    require_writable_video(out)
    if not path.exists():
        raise UserError(f"movie: there is no file or folder {path}")
    from relight.photos.background import read_background
    from relight.photos.folder import require_unused
    from relight.photos.inferred import known_light
    from relight.photos.look import Look
    from relight.photos.movie import write_movie
    from relight.photos.network import read_network

    network = read_network(weights)
    read_by = network, mask_model, white_balance
    shown = read_background(background, blur, shadow, moving=True)
    look = Look(light, mode, shown, turn, stops, not absolute, *read_by)
    options: SceneOptions = {"mask_model": mask_model, "white_balance": white_balance}
    options["lit_by"] = known_light(lit_by, *read_by)
    require_unused(out, path, mask, look, options["lit_by"])
    notes = write_movie(network, path, mask, out, look, seconds, fps, turns, size, **options)
    print("\n".join([str(out), *(f"note: {note}" for note in notes)]))


@mask_app.command("setup")
def mask_setup(
    wheel: Annotated[
        Path | None, typer.Option("--from", help="A wheel of mediapipe 0.10.21 that you have, instead of a download.")
    ] = None,
) -> None:
    """Fetch the built-in networks for masks, once: 25 MB of the package mediapipe (Apache-2.0), with the licence."""
    from relight.photos.mask.networks import setup

    if wheel is None:
        print("downloading mediapipe 0.10.21 (36 MB), of which 25 MB are kept", flush=True)
    print(f"{setup(wheel)}: photos without a mask get one from now on")


@mask_app.command("draw")
def mask_draw(
    path: Annotated[Path, typer.Argument(help="A photo.", metavar="PHOTO")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The mask; by default PHOTO_mask.png beside the photo.")
    ] = None,
    mask_model: str | None = None,
) -> None:
    """Write the automatic mask of a photo, to correct in a paint program. `relight photo` finds it beside the photo."""
    from relight.core.files import writable_file
    from relight.photos.mask.find import automatic_mask
    from relight.photos.write import write_picture
    from relight.pictures.picture import Picture

    out = out or path.parent / f"{path.stem}_mask.png"
    if out.suffix.lower() != ".png":
        raise UserError(f"--out {out}: a mask is a .png, which keeps its edge")
    if out.exists():  # it may have been corrected, or be the photo
        raise UserError(f"{out} exists: delete it for a new one, or give another --out")
    write_picture(writable_file(out, "--out"), automatic_mask(Picture.of(path), mask_model)[0])
    print(out)


def relit(path: Path) -> Path:
    """Returns the name of the results of a photo or a folder, beside it."""
    named = path.resolve() if path.name in ("", "..") else path  # "." has no name of its own
    return named.with_name(f"{named.name if path.is_dir() else named.stem}_relit")


def at_terminal() -> bool:
    """Returns whether somebody can answer a question."""
    return sys.stdin.isatty() and sys.stdout.isatty()
