"""The frames of a movie: a photo under a light that turns, or a clip under a new one. The exposure never changes."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from relight.files import UserError
from relight.photos.api import Relighter
from relight.photos.background import Background
from relight.photos.clip import steady
from relight.photos.color import to_srgb8
from relight.photos.frame import frame
from relight.photos.infer import Figure
from relight.photos.mask import mask_of
from relight.photos.movie import is_movie, pictures_in, read_frames, write_movie
from relight.photos.photo import Wish, lit
from relight.photos.read import Photo, read_photo
from relight.photos.render import compose, ground_of, layers, relight_maps, render
from relight.photos.source import Source, mask_beside
from relight.progress import progress
from relight.sh import rotate_y


def turning(
    pixels: np.ndarray,
    figures: list[Figure],
    light: np.ndarray,
    wish: Wish,
    behind: Background,
    count: int,
    turns: float = 1,
) -> Iterator[np.ndarray]:
    """`count` frames (H,W,3) uint8 of a photo whose light makes `turns` turns; the last leads on to the first.

    Only the part that the light changes is computed anew: the figures, the ground under them, or all of a panorama.
    """
    shape = pixels.shape[:2]
    floor = ground_of(figures) if behind.replaced and behind.shadow else None
    still = behind.linear(shape, stops=wish.stops) if behind.kind in ("color", "picture") else None
    windows = [(figure.frame.rows, figure.frame.columns) for figure in figures]
    windows += [(floor.rows, floor.columns)] if floor else []
    if behind.kind == "panorama":
        windows = [((0, shape[0]), (0, shape[1]))]
    rows, columns = ((min(a for a, _ in spans), max(b for _, b in spans)) for spans in zip(*windows))
    window = slice(*rows), slice(*columns)
    part = layers(pixels, figures, rows, columns)
    frame = pixels.copy() if still is None else to_srgb8(still)
    for i in range(count):
        turn = np.radians(wish.turn) + 2 * np.pi * turns * i / count
        turned = rotate_y(light, turn).astype(np.float32)
        scene = None if still is None else still[window].copy()
        if behind.kind == "panorama":
            scene = behind.linear(shape, turn, wish.stops)
        if floor:
            floor.darken(scene, turned, rows[0], columns[0])
        frame = frame.copy()
        compose(frame[window], part, relight_maps(figures, turned, wish.mode), scene, wish.stops)
        yield frame


def relit_clip(
    relighter: Relighter,
    path: Path | str,
    masks: Path | str | None,
    source: Source,
    wish: Wish,
    size: int,
    turns: float,
) -> tuple[Iterator[np.ndarray], int | None, float]:
    """The frames of a video or a folder of pictures in a new light, how many, and frames per second.

    masks: a folder of masks or a video of them, frame by frame; else x_mask.png beside a picture x, its alpha or the
    automatic mask. Light
    and transport are steadied over time (relight.photos.clip), the whole mask of a frame is one figure, and the new
    light's strength is matched to the first frame's and then held.
    """
    frames, count, fps = read_frames(path)
    behind = wish.behind(source)

    def look(pixels: np.ndarray, coverage: np.ndarray, box) -> Figure:
        return relighter.look(pixels, coverage, box)

    def relit() -> Iterator[np.ndarray]:
        pairs = ((smaller(photo, coverage, size)) for photo, coverage in _masked(path, frames, masks, wish))
        light = None
        for i, (pixels, figure) in enumerate(
            steady(pairs, lambda coverage: frame(coverage, relighter.network.size), look)
        ):
            if light is None:
                light, held = lit([figure], source, behind, wish)
            turn = np.radians(wish.turn) + 2 * np.pi * turns * i / (count or 250)
            turned = rotate_y(light, turn).astype(np.float32)
            yield render(pixels, [figure], turned, wish.mode, held, turn, wish.stops)

    return relit(), count, fps


def smaller(photo: Photo, coverage: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels and coverage, scaled down so that the longer side is at most `size`."""
    height, width = coverage.shape
    scale = size / max(height, width)
    if scale >= 1:
        return photo.pixels, coverage
    shape = max(8, round(width * scale)), max(8, round(height * scale))
    images = (Image.fromarray(photo.pixels), Image.fromarray(coverage))
    pixels, coverage = (np.asarray(image.resize(shape, Image.Resampling.LANCZOS, reducing_gap=3)) for image in images)
    return pixels, coverage


def _masked(
    clip: Path | str, frames: Iterator[Photo], masks: Path | str | None, wish: Wish
) -> Iterator[tuple[Photo, np.ndarray]]:
    if masks is None:
        for photo in frames:  # a folder's have their files' names
            beside = mask_beside(Path(clip) / f"{photo.name}.png") if Path(clip).is_dir() else None
            yield photo, mask_of(photo, beside, wish.mask_model)
        return
    masks = Path(masks)
    if masks.is_dir():
        files = iter(pictures_in(masks))
        for number, photo in enumerate(frames, 1):
            mask = next(files, None)
            if mask is None:
                raise UserError(f"folder {masks} holds {number - 1} masks, but the clip has more frames")
            yield photo, mask_of(photo, mask)
        return
    if not is_movie(masks):
        raise UserError(f"mask {masks}: for a clip give a folder of masks or a video of them")
    stream, _, _ = read_frames(masks)
    for number, photo in enumerate(frames, 1):
        mask = next(stream, None)
        if mask is None:
            raise UserError(f"mask video {masks} has {number - 1} frames, but the clip has more")
        if mask.pixels.shape != photo.pixels.shape:
            raise UserError(f"mask video {masks} is of another size than the clip: they must be equal")
        yield photo, mask.pixels.max(-1)


def shoot(
    relighter: Relighter,
    path: Path | str,
    mask: Path | str | None,
    out: Path | str,
    wish: Wish,
    seconds: float = 6.0,
    fps: float | None = None,
    turns: float | None = None,
    size: int = 1080,
) -> None:
    """Writes the movie `out` of a photo (its light turns once) or of a clip, with progress. Raises UserError."""
    path = Path(path)
    source = wish.source(relighter)
    if path.is_dir() or is_movie(path):
        turns = 0.0 if turns is None else turns
        frames, count, own = relit_clip(relighter, path, mask, source, wish, size, turns)
        write_movie(out, progress(frames, "frames", total=count), fps or own)
        return
    photo = read_photo(path)
    coverage = mask_of(photo, mask or mask_beside(path), wish.mask_model)
    pixels, coverage = smaller(photo, coverage, size)
    figures = relighter.infer(pixels, coverage, split=not wish.together)
    light, behind = lit(figures, source, wish.behind(source), wish)
    fps = fps or 25.0
    count = max(1, round(seconds * fps))
    frames = turning(pixels, figures, light, wish, behind, count, 1.0 if turns is None else turns)
    write_movie(out, progress(frames, "frames", total=count), fps)
