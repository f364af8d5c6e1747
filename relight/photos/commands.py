"""The commands `photo`, `movie` and `mask`."""

import functools
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from relight.core.errors import UserError

if TYPE_CHECKING:
    from relight.photos.look import Look
    from relight.photos.network import PhotoNetwork
    from relight.photos.scene import SceneOptions

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
  relight photo me.jpg -l room:36 --background panorama --blur 3
  relight photo holiday/ --light sky:3 --jobs 2"""
MOVIE_EXAMPLES = """relight movie me.jpg --out turn.mp4
  relight movie clip.mp4 --light room:12 --out relit.webm"""


LIGHT, BEHIND = "Light", "Background"
# Flags, heading in the help, name of the value, and help of the options, by the name of the parameter; bounds. The rows
# fit the help of a narrow terminal.
OPTIONS: dict[str, tuple[str, str | None, str | None, str]] = {
    "light": ("--light -l", LIGHT, "LIGHT", "The new light; see above. Several lights add up."),
    "mask": ("--mask -m", None, "FILE", "White on the people, as large as the photo; of a clip, a folder or a video."),
    "mask_model": ("--mask-model", None, "FILE", "ONNX network for automatic masks; or FILE:bgr, :rgb, :signed."),
    "mode": ("--mode", None, "WORD", "ratio: photo times new over old shading, keeps detail; full: albedo times new."),
    "lit_by": ("--lit-by", LIGHT, "LIGHT", "The photo's own light, if known: a panorama of the place, a lamp ..."),
    "white_balance": ("--white-balance", LIGHT, "WORD", "keep: the photo's light is white; scene: as it is inferred."),
    "background": ("--background -b", BEHIND, "WORD", "keep, transparent, panorama, a color (#334455) or a picture."),
    "blur": ("--blur", BEHIND, "DEGREES", "Blur of the panorama or picture behind, degrees."),
    "shadow": ("--shadow/--no-shadow", BEHIND, None, "Cast shadows on the ground of a new background."),
    "turn": ("--turn", LIGHT, "DEGREES", "Turn the light about the vertical, to the right."),
    "stops": ("--stops", LIGHT, "STOPS", "Brighten the result; negative: darken it."),
    "absolute": ("--absolute", LIGHT, None, "Keep the light's own strength instead of matching it to the photo."),
    "together": ("--together", None, None, "Take the whole mask as one person, even if it has several parts."),
    "maps": ("--maps", None, None, "Also write albedo.png, shading.png and maps.exr."),
    "weights": ("--weights -w", None, "FILE", "A network (.onnx); `relight export` writes one of a training."),
    "jobs": ("--jobs -j", None, "N", "For a folder: photos relit at the same time."),
    "seconds": ("--seconds", None, "SECONDS", "Length of the movie of a photo; by default 6."),
    "fps": ("--fps", None, "N", "Frames per second, for a photo or a folder; by default 25."),
    "turns": ("--turns", None, "N", "Turns of the light; by default 1 for a photo, 0 for a clip."),
    "size": ("--size", None, "PIXELS", "Largest length of the longer side."),
}
BOUNDS = {
    "blur": (0, 60), "turn": (-360, 360), "stops": (-8, 8), "jobs": (1, None), "seconds": (0.1, 600), "fps": (1, 120),
    "size": (16, 4096),
}  # fmt: skip


@dataclass(frozen=True)
class Words:
    """The options that `photo` and `movie` share, as a user types them."""

    light: list[str] | None = None
    lit_by: str | None = None
    mode: str = "ratio"
    white_balance: str = "keep"
    background: str = "keep"
    blur: float = 0.0
    shadow: bool = True
    turn: float = 0.0
    stops: float = 0.0
    absolute: bool = False
    mask_model: str | None = None

    def look(self, network: "PhotoNetwork") -> "Look":
        """Reads the light and the background."""
        from relight.photos.background import read_background
        from relight.photos.look import Look
        from relight.photos.scene import named_light

        background = read_background(self.background, self.blur, self.shadow)
        text = " + ".join(self.light or ["auto"])
        light = named_light(network, text, self.mask_model, self.white_balance)
        return Look(light, self.mode, background, self.turn, self.stops, not self.absolute)

    def scene(self, network: "PhotoNetwork", together: bool = False) -> "SceneOptions":
        """Reads the photo's own light, and returns the options of `Scene.of`."""
        from relight.photos.scene import known_light

        lit_by = known_light(network, self.lit_by, self.mask_model, self.white_balance)
        words: SceneOptions = {"mask_model": self.mask_model, "white_balance": self.white_balance}
        return {**words, "split": not together, "lit_by": lit_by}


def with_options(examples: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Describes the parameters of a command that OPTIONS names, and gives it those of `Words` in place of `words`.

    Args:
        examples: for its help, which also lists the lights.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        signature, shared = inspect.signature(command), inspect.signature(Words).parameters
        own = [parameter for parameter in signature.parameters.values() if parameter.name != "words"]
        parameters = list(map(_described, [*own, *shared.values()]))

        @functools.wraps(command)
        def wrapper(**values: Any) -> None:
            words = Words(**{name: values.pop(name) for name in shared})
            command(words=words, **values)

        wrapper.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        wrapper.__annotations__ = {p.name: p.annotation for p in parameters}
        wrapper.__doc__ = f"{command.__doc__}{LIGHTS.format(examples=examples)}"
        return wrapper

    return decorate


def _described(parameter: inspect.Parameter) -> inspect.Parameter:
    if parameter.name not in OPTIONS:
        return parameter
    flags, panel, metavar, text = OPTIONS[parameter.name]
    low, high = BOUNDS.get(parameter.name, (None, None))
    option = typer.Option(*flags.split(), help=text, rich_help_panel=panel, metavar=metavar, min=low, max=high)
    return parameter.replace(annotation=Annotated[parameter.annotation, option])


@app.command()
@with_options(PHOTO_EXAMPLES)
def photo(
    paths: Annotated[list[Path], typer.Argument(help="A photo, several, or a folder of photos.", metavar="PHOTO...")],
    words: Words,
    mask: Path | None = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder of results, by default PHOTO_relit, of several photos relit; or a picture, .png or .jpg.",
            metavar="FOLDER|FILE",
        ),
    ] = None,
    together: bool = False,
    maps: bool = False,
    weights: Path | None = None,
    jobs: int | None = None,
) -> None:
    """Relight the people in a photo, in several, or in each photo of a folder."""
    from rich.console import Console

    from relight.core.files import PHOTO_SUFFIXES
    from relight.photos.folder import BEFORE_AFTER, Summary, photos_in, relight_file, relight_photos, relight_to
    from relight.photos.mask.find import NoMaskNetwork
    from relight.photos.network import read_network

    path, several = paths[0], len(paths) > 1
    for each in paths:
        if not each.exists() or (several and each.is_dir()):
            raise UserError(f"photo: there is no file {'' if several else 'or folder '}{each}")
    if out is None:
        named = path.resolve() if path.name in ("", "..") else path  # "." has no name of its own
        out = Path("relit") if several else named.with_name(f"{named.stem if path.is_file() else named.name}_relit")
    picture = out if out.suffix.lower() in (*PHOTO_SUFFIXES, ".exr", ".psd") and not out.is_dir() else None  # alone
    network = read_network(weights)
    look, options = words.look(network), words.scene(network, together)
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


@app.command()
@with_options(MOVIE_EXAMPLES)
def movie(
    path: Annotated[Path, typer.Argument(help="A photo, a video, or a folder of frames.", metavar="PHOTO|CLIP")],
    words: Words,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The movie: .mp4, .webm or .gif; by default CLIP_relit.mp4.", metavar="FILE"),
    ] = None,
    mask: Path | None = None,
    seconds: float | None = None,
    fps: float | None = None,
    turns: float | None = None,
    size: int = 1080,
    weights: Path | None = None,
) -> None:
    """Write a movie: a photo under a turning light, or a relit clip of moving people. The exposure is fixed."""
    from relight.pictures.video import require_writable_video

    out = out or Path(f"{path.stem}_relit.mp4")
    require_writable_video(out)
    if not path.exists():
        raise UserError(f"movie: there is no file or folder {path}")
    from relight.photos.folder import require_unused
    from relight.photos.movie import write_movie
    from relight.photos.network import read_network

    network = read_network(weights)
    look, options = words.look(network), words.scene(network)
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

    out = out or path.with_name(f"{path.stem}_mask.png")
    if out.suffix.lower() != ".png":
        raise UserError(f"--out {out}: a mask is a .png, which keeps its edge")
    if out.exists():  # it may have been corrected, or be the photo
        raise UserError(f"{out} exists: delete it for a new one, or give another --out")
    out = writable_file(out, "--out")
    write_picture(out, automatic_mask(Picture.of(path), mask_model)[0])
    print(out)


def at_terminal() -> bool:
    """Returns whether somebody can answer a question."""
    return sys.stdin.isatty() and sys.stdout.isatty()
