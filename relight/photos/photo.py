"""The commands `photo` and `transfer`: from the files of photos to folders of results."""

import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from relight.errors import UserError
from relight.files import writable_folder
from relight.lights import Light, LightOptions
from relight.panoramas.panorama import LAYOUTS
from relight.photos.api import MODES, Relighter, match_exposure, require_white_balance
from relight.photos.background import Background, read_background
from relight.photos.color import DISPLAY_STOPS, KNEE
from relight.photos.load import LoadedPhoto, load_photo, mask_notes, photo_notes
from relight.photos.person import AUTO, Person, mean_light, opposite_lamp
from relight.photos.place import default_light, is_of_person
from relight.photos.read import is_picture
from relight.photos.render import render
from relight.photos.write import (
    write_before_after,
    write_inference,
    write_json,
    write_light_files,
    write_maps,
    write_picture,
)
from relight.sh import CONVENTIONS, rotate_y

BEFORE_AFTER = "before_after.jpg"
RESULTS = ("relit", "before_after", "albedo", "shading", "maps", "light", "new_light")  # names of files, without suffix
BYTES_PER_PIXEL = 54  # of the photo, at most, for the results: three pictures and 19 maps of half floats


@dataclass(frozen=True)
class Options:
    """The options of `relight photo`, `movie` and `transfer` that shape a picture.

    Attributes:
        light: as `Relighter.read_light` takes it, or `auto`, as `Relighter.relight` takes it.
        mode: ratio | full.
        white_balance: keep | scene, as `Relighter.infer` takes it.
        background: as `read_background` takes it.
        blur: of a panorama or picture behind, degrees.
        shadow: whether people cast shadows on a new background.
        turn: of the light about the vertical axis, its front toward +x, degrees.
        stops: exposure, as a power of two.
        match: whether the light is scaled to the photo's exposure.
        together: whether the whole mask is one person.
        maps: whether the maps are also written as maps.exr.
        light_mask: of the photo that `light` names.
        mask_model: ONNX network for automatic masks.
        layout: of a panorama.
        yaw: correction of a panorama's front, degrees.
        flip: whether the panorama is mirrored.
        upside_down: whether its rows run from the bottom up.
        convention: of a file of coefficients.
    """

    light: str = AUTO
    mode: str = "ratio"
    white_balance: str = "keep"
    background: str = "keep"
    blur: float = 0.0
    shadow: bool = True
    turn: float = 0.0
    stops: float = 0.0
    match: bool = True
    together: bool = False
    maps: bool = False
    light_mask: str | None = None
    mask_model: str | None = None
    layout: str = "auto"
    yaw: float = 0.0
    flip: bool = False
    upside_down: bool = False
    convention: str | None = None

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise UserError(f"mode {self.mode!r} is neither ratio nor full")
        require_white_balance(self.white_balance)
        if self.layout not in ("auto", *LAYOUTS):
            raise UserError(f"layout {self.layout!r} is none of auto, {', '.join(LAYOUTS)}")
        if self.convention not in (None, *CONVENTIONS):
            raise UserError(f"convention {self.convention!r} is none of {', '.join(CONVENTIONS)}")
        if self.blur and not (self.background == "panorama" or is_picture(self.background)):
            raise UserError(f"a panorama or a picture behind can be blurred, not the background {self.background}")
        light = self.light_name
        is_photo = is_of_person(light)
        if self.light_mask and not is_photo:
            raise UserError(f"a mask of the light is that of a photo of somebody, and the light is {light}")
        names = ("layout", "yaw", "flip", "upside_down", "convention")
        given = [name.replace("_", "-") for name in names if getattr(self, name) != getattr(Options, name)]
        if given and (is_photo or light == AUTO):
            raise UserError(f"the light {light} takes no {' or '.join(given)}: only files and generated lights do")

    @property
    def light_name(self) -> str:
        """What `light` names: AUTO for a lamp that depends on the photo, as `auto` without a picture behind it does."""
        return default_light(self.background) if self.light == AUTO else self.light

    def named_light(self, relighter: Relighter) -> Light | None:
        """Reads the light that the options name.

        Returns:
            The light; None for a lamp that depends on the photo (`auto` without a picture as the background).
        """
        if self.light_name == AUTO:
            return None
        options: LightOptions = {
            "layout": self.layout, "yaw": self.yaw, "flip": self.flip, "upside_down": self.upside_down
        }  # fmt: skip
        if self.convention:
            options["convention"] = self.convention
        return relighter.read_light(self.light_name, self.light_mask, self.mask_model, self.white_balance, **options)

    def read_background(self, light: Light | None) -> Background:
        """Reads the background, which may be the panorama of the light."""
        panorama = light.panorama if light else None
        return replace(read_background(self.background, panorama, self.blur), shadow=self.shadow)

    def infer(
        self, relighter: Relighter, path: Path | str, mask: Path | str | None
    ) -> tuple[LoadedPhoto, list[Person]]:
        """Loads a photo and infers its people.

        Args:
            relighter: the network.
            path: of the photo.
            mask: file; None for the one beside the photo, its alpha, or an automatic mask.

        Returns:
            The photo, and its people from left to right.
        """
        photo = load_photo(path, mask, self.mask_model)
        return photo, relighter.infer(photo, None, not self.together, self.white_balance)


def is_result(path: Path | str) -> bool:
    """Returns whether a file has the name of one that `relight_file` writes."""
    return re.sub(r"_\d+$", "", Path(path).name.split(".")[0]) in RESULTS


def relight_file(
    relighter: Relighter,
    path: Path | str,
    out: Path | str,
    options: Options,
    mask: Path | str | None = None,
    light: Light | None = None,
) -> dict:
    """Relights a photo and writes all results to a folder (docs/photos.md).

    Everything is read and computed before the first file is written.

    Args:
        relighter: the network.
        path: of the photo.
        out: the folder.
        options: of the command.
        mask: its file; by default it is found.
        light: that of the options, if it is read already.

    Returns:
        The record that is written as photo.json.

    Raises:
        UserError: if an input is wrong, or the folder cannot be written.
    """
    out = writable_folder(out, "--out")
    for given in (path, mask, options.light, options.light_mask, options.background):
        if given and Path(given).is_file() and Path(given).resolve().parent == out.resolve() and is_result(given):
            raise UserError(f"{given} is in the folder of results and would be overwritten: give another --out")
    light = light or options.named_light(relighter)
    photo, people = options.infer(relighter, path, mask)
    light = light or relighter.read_light(opposite_lamp(people))
    background = options.read_background(light)
    writable_folder(out, "--out", BYTES_PER_PIXEL * photo.pixels[..., 0].size)
    matched, background = match_exposure(people, light.coefficients, background, options.match)
    turned = rotate_y(matched, np.radians(options.turn)).astype(np.float32)
    relit = render(photo.pixels, people, turned, options.mode, background, np.radians(options.turn), options.stops)
    assessed = [relighter.trust(person) for person in people]
    write_picture(out / f"relit{photo.suffix}", relit)
    write_before_after(out / BEFORE_AFTER, photo.pixels, relit)
    write_inference(out, people, photo.pixels)
    if options.maps:
        write_maps(out / "maps.exr", people, photo.pixels)
    for i, person in enumerate(people, 1):
        name = "light" if len(people) == 1 else f"light_{i}"
        write_light_files(out / name, person.light, f"inferred from {photo.name}")
    write_light_files(out / "new_light", turned, f"{light.source}, turned by {options.turn:g} degrees")
    record = {
        "photo": str(path),
        "picture": f"relit{photo.suffix}",
        "notes": list(photo.notes),
        "size": [photo.pixels.shape[1], photo.pixels.shape[0]],
        "options": asdict(options),
        "shading_png": {"stops": DISPLAY_STOPS, "straight_to": KNEE},
        "light": {"name": light.source, "notes": light.notes},
        "mask": {"automatic": photo.automatic, "notes": mask_notes(photo, people)},
        "people": [
            {
                "square": [round(v, 2) for v in (p.crop.left, p.crop.top, p.crop.side)],
                "white": [round(float(v), 3) for v in p.white],
                **asdict(trust),
            }
            for p, trust in zip(people, assessed)
        ],
    }
    write_json(out / "photo.json", record)
    return record


def swap_lights(
    relighter: Relighter,
    paths: tuple[Path, Path],
    masks: tuple[Path | None, Path | None],
    out: Path | str,
    options: Options,
) -> tuple[list[Path], list[str]]:
    """Relights each of two photos by the inferred light of the other, each in its own exposure.

    Args:
        relighter: the network.
        paths: of the photos.
        masks: their files; by default they are found.
        out: folder of the results, named after the photos (me_1 and me_2, if both are called me).
        options: of the command.

    Returns:
        The paths of the two pictures, and notes on the photos and their masks.
    """
    writable_folder(out, "--out")
    inferred = [options.infer(relighter, path, mask) for path, mask in zip(paths, masks)]
    names = [photo.name for photo, _ in inferred]
    if names[0].lower() == names[1].lower():  # some file systems do not distinguish a and A
        names = [f"{name}_{number}" for number, name in enumerate(names, 1)]
    lights = [Light(mean_light(people), name) for name, (_, people) in zip(names, inferred)]
    relit = {}
    for name, (photo, people), light in zip(names, inferred, lights[::-1]):
        coefficients, background = match_exposure(people, light.coefficients, options.read_background(light))
        path = Path(out) / f"{name}_lit_as_{light.source}{photo.suffix}"
        relit[path] = render(photo.pixels, people, coefficients, options.mode, background, stops=options.stops)
    for path, pixels in relit.items():
        write_picture(path, pixels)
    for light in lights:
        write_light_files(Path(out) / f"{light.source}_light", light.coefficients, f"inferred from {light.source}")
    return list(relit), [f"{photo.name}: {note}" for photo, people in inferred for note in photo_notes(photo, people)]
