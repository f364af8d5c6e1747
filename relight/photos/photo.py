"""One photo from its file to its folder of results."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from relight.files import UserError, writable_folder
from relight.photos.api import MODES, Relighter, exposure
from relight.photos.background import Background, background
from relight.photos.color import DISPLAY, KNEE
from relight.photos.infer import Figure
from relight.photos.mask import AUTOMATIC, doubts, mask_of
from relight.photos.read import Photo, read_photo
from relight.photos.render import render
from relight.photos.save import save_inference, save_json, save_light, save_picture
from relight.photos.source import Source, light_source, mask_beside, mean_light
from relight.sh import rotate_y

BYTES = 48  # that the results may take per pixel of the photo: three pictures and 16 maps of half floats


@dataclass(frozen=True)
class Wish:
    """What a user asks for: every option of `relight photo`, `movie` and `transfer` that shapes a picture."""

    light: str = ""
    mode: str = "ratio"
    background: str = "keep"
    blur: float = 0.0  # of a panorama behind, degrees
    shadow: bool = True  # of the people, on a new background
    turn: float = 0.0  # of the light, degrees about the vertical, its front toward +x
    stops: float = 0.0
    match: bool = True  # the light's strength to the photo's exposure
    together: bool = False  # one figure, even where the mask falls apart
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

    def source(self, relighter: Relighter) -> Source:
        """The light, read."""
        layout = {"layout": self.layout, "yaw": self.yaw, "flip": self.flip, "upside_down": self.upside_down}
        if self.convention:
            layout["convention"] = self.convention
        return light_source(self.light, relighter, self.light_mask, self.mask_model, **layout)

    def behind(self, source: Source) -> Background:
        """The background, read."""
        return replace(background(self.background, source.panorama, self.blur), shadow=self.shadow)


def look(relighter: Relighter, path: Path | str, mask: Path | str | None, wish: Wish) -> tuple[Photo, list[Figure]]:
    """Reads a photo and infers its people."""
    photo = read_photo(path)
    coverage = mask_of(photo, mask or mask_beside(path), wish.mask_model)
    return photo, relighter.infer(photo.pixels, coverage, split=not wish.together)


def lit(figures: list[Figure], source: Source, behind: Background, wish: Wish) -> tuple[np.ndarray, Background]:
    """The light in the photo's exposure, not turned yet, and the background in the same."""
    needed = exposure(figures, source.coefficients)
    factor = needed if wish.match else 1.0
    light = source.coefficients * np.float32(factor)
    return light, behind.under(light, factor, factor / needed)


def relight_file(
    relighter: Relighter,
    path: Path | str,
    out: Path | str,
    wish: Wish,
    mask: Path | str | None = None,
    source: Source | None = None,
) -> dict:
    """Relights the photo `path` into the folder `out`; returns the record that it leaves there as photo.json.

    Everything is read and computed before the first file is written; each file is whole. Raises UserError.
    """
    out = writable_folder(out, "--out")
    source = source or wish.source(relighter)
    behind = wish.behind(source)
    photo, figures = look(relighter, path, mask, wish)
    writable_folder(out, "--out", BYTES * photo.pixels[..., 0].size)
    light, behind = lit(figures, source, behind, wish)
    turned = rotate_y(light, np.radians(wish.turn)).astype(np.float32)
    relit = render(photo.pixels, figures, turned, wish.mode, behind, np.radians(wish.turn), wish.stops)
    judged = [relighter.trust(figure) for figure in figures]
    save_picture(out / "relit.png", relit)
    save_inference(out, figures, photo.pixels)
    for i, figure in enumerate(figures, 1):
        name = "light" if len(figures) == 1 else f"light_{i}"
        save_light(out / name, figure.light, f"inferred from {photo.name}")
    save_light(out / "new_light", turned, f"{source.name}, turned by {wish.turn:g} degrees")
    automatic = photo.alpha is None and not (mask or mask_beside(path))
    record = {
        "photo": str(path),
        "size": [photo.pixels.shape[1], photo.pixels.shape[0]],
        "wish": asdict(wish),
        "shading_png": {"stops": DISPLAY, "straight_to": KNEE},
        "light": {"name": source.name, "notes": source.notes},
        "mask": {"automatic": automatic, "notes": doubts(figures) + [AUTOMATIC] * automatic},
        "people": [
            {"square": [round(v, 2) for v in (f.frame.left, f.frame.top, f.frame.side)], **asdict(trust)}
            for f, trust in zip(figures, judged)
        ],
    }
    save_json(out / "photo.json", record)
    return record


def swap(
    relighter: Relighter,
    paths: tuple[Path, Path],
    masks: tuple[Path | None, Path | None],
    out: Path | str,
    wish: Wish,
) -> list[Path]:
    """Relights each of two photos by the other's light, matched to its own exposure; returns the pictures' paths."""
    writable_folder(out, "--out")
    looked = [look(relighter, path, mask, wish) for path, mask in zip(paths, masks)]
    sources = [Source(photo.name, mean_light(figures)) for photo, figures in looked]
    relit = {}
    for (photo, figures), source in zip(looked, sources[::-1]):
        light, behind = lit(figures, source, wish.behind(source), wish)
        name = Path(out) / f"{photo.name}_lit_as_{source.name}.png"
        relit[name] = render(photo.pixels, figures, light, wish.mode, behind, stops=wish.stops)
    for name, pixels in relit.items():
        save_picture(name, pixels)
    for source in sources:
        save_light(Path(out) / f"{source.name}_light", source.coefficients, f"inferred from {source.name}")
    return list(relit)
