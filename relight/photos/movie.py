"""The command `movie`: a photo under a light that turns, or a clip of moving people in another light.

The exposure is fixed throughout. A network that infers each frame of a clip for itself flickers, so its results are
smoothed over time: the light, which hardly changes, over a second; the crop over a few frames; the transport over
neighbouring frames only where the image itself did not change, so that a moving arm leaves no trace.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TypeVar

import numpy as np

from relight.errors import UserError
from relight.lights import Light
from relight.maps.square import Crop, crop_around
from relight.photos.api import Relighter, match_exposure
from relight.photos.background import Background
from relight.photos.color import to_srgb8
from relight.photos.load import LoadedPhoto, load_photo, photo_notes
from relight.photos.mask.edge import fit_edge
from relight.photos.mask.find import AUTOMATIC, mask_warnings
from relight.photos.person import Person, balanced, opposite_lamp
from relight.photos.photo import Options
from relight.photos.read import Photo, list_photos, list_pictures, mask_beside, mask_in
from relight.photos.render import compose, fit_maps, ground_of, render, split_layers
from relight.photos.video import FPS, is_video, read_frames, write_video
from relight.progress import progress
from relight.sh import rotate_y

T = TypeVar("T")
LIGHT_RADIUS, CROP_RADIUS, TRANSPORT_RADIUS = 12, 4, 1  # frames to each side that the means include
CHANGE = 0.06  # of linear values: pixels that differ by more from a neighbouring frame count as moved
SECONDS = 6.0  # of the movie of a photo
UNKNOWN_LENGTH = 250  # frames of one turn of the light, for clips that do not state their length


def write_movie(
    relighter: Relighter,
    path: Path | str,
    mask: Path | str | None,
    out: Path | str,
    options: Options,
    seconds: float | None = None,
    fps: float | None = None,
    turns: float | None = None,
    size: int = 1080,
) -> list[str]:
    """Writes the movie of a photo or of a clip, and shows its progress.

    Args:
        relighter: the network.
        path: of a photo, a video, or a folder of frames.
        mask: of the photo; for a clip, a video of masks, or a folder of them, with the names of the frames or in their
            order. By default masks are found.
        out: the video file.
        options: of the command.
        seconds: length, for a photo; by default SECONDS.
        fps: frames per second; by default the clip's own, or FPS.
        turns: of the light; by default 1 for a photo and 0 for a clip.
        size: the longer side is scaled down to it, pixels.

    Returns:
        Notes on the light, the photo and its mask; on a clip, with the number of frames that have them.

    Raises:
        UserError: if an input is wrong or the file cannot be written.
    """
    path = Path(path)
    light = options.named_light(relighter)
    if path.is_dir() or is_video(path):
        if seconds is not None:
            raise UserError(f"{path} is a clip and keeps its length: --seconds has an effect on a photo only")
        turns = 0.0 if turns is None else turns
        notes: Counter[str] = Counter()
        frames, count, clip_fps = relight_clip(relighter, path, mask, light, options, size, turns, notes)
        sound = path if path.is_file() and fps is None else None
        write_video(out, progress(frames, "frames", total=count), fps or clip_fps, sound)
        return (light.notes if light else []) + [f"{note} (frames: {number})" for note, number in notes.most_common()]
    photo = load_photo(path, mask, options.mask_model).downscaled(size)
    pixels, people = photo.pixels, relighter.infer(photo, None, not options.together, options.white_balance)
    light = light or relighter.read_light(opposite_lamp(people))
    coefficients, background = match_exposure(people, light.coefficients, options.read_background(light), options.match)
    fps = fps or FPS
    count = max(1, round((seconds or SECONDS) * fps))
    frames = turn_light(pixels, people, coefficients, options, background, count, 1.0 if turns is None else turns)
    write_video(out, progress(frames, "frames", total=count), fps)
    return light.notes + photo_notes(photo, people)


def turn_light(
    pixels: np.ndarray,
    people: list[Person],
    light: np.ndarray,
    options: Options,
    background: Background,
    count: int,
    turns: float = 1,
) -> Iterator[np.ndarray]:
    """Renders a photo whose light turns. Only what the light changes is computed for each frame.

    Args:
        pixels: (H,W,3) uint8 sRGB.
        people: as inferred from it.
        light: (K,3), at the start.
        options: mode, turn and stops.
        background: matched to the light.
        count: number of frames.
        turns: of the light in all of them; the last frame leads to the first.

    Yields:
        Frames (H,W,3) uint8 sRGB.
    """
    shape = pixels.shape[:2]
    ground = ground_of(people) if background.replaced and background.shadow else None
    still = background.linear(shape, stops=options.stops) if background.kind in ("color", "picture") else None
    spans = [(person.crop.rows, person.crop.columns) for person in people]
    spans += [(ground.rows, ground.columns)] if ground else []
    if background.kind == "panorama":
        spans = [((0, shape[0]), (0, shape[1]))]
    rows, columns = ((min(a for a, _ in each), max(b for _, b in each)) for each in zip(*spans))
    window = slice(*rows), slice(*columns)
    part = split_layers(pixels, people, rows, columns)
    frame = pixels.copy() if still is None else to_srgb8(still)
    for i in range(count):
        turn = np.radians(options.turn) + 2 * np.pi * turns * i / count
        turned = rotate_y(light, turn).astype(np.float32)
        behind = None if still is None else still[window].copy()
        if background.kind == "panorama":
            behind = background.linear(shape, turn, options.stops)
        if ground and behind is not None:
            ground.cast_shadows(behind, turned, rows[0], columns[0])
        frame = frame.copy()
        compose(frame[window], part, fit_maps(people, turned, options.mode), behind, options.stops)
        yield frame


def relight_clip(
    relighter: Relighter,
    path: Path | str,
    masks: Path | str | None,
    light: Light | None,
    options: Options,
    size: int,
    turns: float,
    notes: Counter[str],
) -> tuple[Iterator[np.ndarray], int | None, float]:
    """Relights a video or a folder of pictures, with results smoothed over time.

    The whole mask of a frame is one person. The new light is matched to the exposure of the first frame.

    Args:
        relighter: the network.
        path: of the clip.
        masks: a folder or a video of masks, frame by frame; by default x_mask.png beside a picture x, its alpha, or an
            automatic mask.
        light: as read; None for `auto`.
        options: of the command.
        size: the longer side is scaled down to it, pixels.
        turns: of the light over the clip.
        notes: counts the frames with each note on files and masks, while the frames are made.

    Returns:
        The frames (H,W,3) uint8, their number if it is known, and frames per second.
    """
    frames, count, fps = read_frames(path)
    background = options.read_background(light)

    def noted(photo: LoadedPhoto) -> tuple[np.ndarray, np.ndarray]:
        notes.update([*photo.notes, *[AUTOMATIC] * photo.automatic])
        return photo.pixels, photo.coverage

    def infer(pixels: np.ndarray, coverage: np.ndarray, crop: Crop) -> Person:
        person = relighter.infer_person(pixels, coverage, crop)
        notes.update(mask_warnings([person]))
        return balanced([person])[0] if options.white_balance == "keep" else person

    def relit() -> Iterator[np.ndarray]:
        pairs = (noted(photo.downscaled(size)) for photo in _with_masks(path, frames, masks, options))
        smooth = smooth_over_time(pairs, lambda coverage: crop_around(coverage, relighter.network.size), infer)
        coefficients = None
        for i, (pixels, person) in enumerate(smooth):
            if coefficients is None:
                given = light or relighter.read_light(opposite_lamp([person]))
                coefficients, matched = match_exposure([person], given.coefficients, background, options.match)
            turn = np.radians(options.turn) + 2 * np.pi * turns * i / (count or UNKNOWN_LENGTH)
            turned = rotate_y(coefficients, turn).astype(np.float32)
            yield render(pixels, [person], turned, options.mode, matched, turn, options.stops)

    return relit(), count, fps


def _with_masks(
    clip: Path | str, frames: Iterator[Photo], masks: Path | str | None, options: Options
) -> Iterator[LoadedPhoto]:
    """Yields the frames of a clip with their masks.

    `masks` is a video, or a folder: by the frames' names if any has one, else in order. If it is None, a frame's file
    has its mask beside it, or it is found; raises UserError if a mask is missing or is of another size.
    """
    if masks is None:
        for photo in frames:  # those of a folder have the names of their files
            beside = mask_beside(Path(clip) / f"{photo.name}.png") if Path(clip).is_dir() else None
            yield load_photo(photo, beside, options.mask_model)
        return
    masks = Path(masks)
    if masks.is_dir():
        files = iter(list_pictures(masks))
        named = Path(clip).is_dir() and any(mask_in(masks, frame.stem) for frame in list_photos(clip))
        for number, photo in enumerate(frames, 1):
            mask = mask_in(masks, photo.name) if named else next(files, None)
            if mask is None and named:
                raise UserError(f"folder {masks} holds no mask of the frame {photo.name}")
            if mask is None:
                raise UserError(f"folder {masks} holds {number - 1} masks, but the clip has more frames")
            yield load_photo(photo, mask)
        if not named and next(files, None) is not None:
            raise UserError(f"folder {masks} holds more masks than the clip has frames: in order, each has its own")
        return
    if not is_video(masks):
        raise UserError(f"mask {masks}: for a clip give a folder of masks or a video of them")
    stream, _, _ = read_frames(masks)
    for number, photo in enumerate(frames, 1):
        drawn = next(stream, None)
        if drawn is None:
            raise UserError(f"mask video {masks} has {number - 1} frames, but the clip has more")
        if drawn.pixels.shape != photo.pixels.shape:
            raise UserError(f"mask video {masks} is of another size than the clip: they must be equal")
        yield LoadedPhoto(photo.pixels, fit_edge(photo.pixels, drawn.codes.max(-1)), photo.name)
    if next(stream, None) is not None:
        raise UserError(f"mask video {masks} has more frames than the clip: each frame has its own")


def smooth_over_time(
    frames: Iterable[tuple[np.ndarray, np.ndarray]],
    find_crop: Callable[[np.ndarray], Crop],
    infer: Callable[[np.ndarray, np.ndarray, Crop], Person],
) -> Iterator[tuple[np.ndarray, Person]]:
    """Infers the person in each frame, with crop, light and transport smoothed over time.

    This is a stream: at most LIGHT_RADIUS + CROP_RADIUS frames to each side are in memory.

    Args:
        frames: pixels (H,W,3) uint8 and coverage (H,W) uint8, frame by frame.
        find_crop: from coverage to its crop.
        infer: from pixels, coverage and crop to a person.

    Yields:
        The pixels and the person of each frame.
    """
    cropped = ((pixels, coverage, find_crop(coverage)) for pixels, coverage in frames)
    inferred = (
        (near[i][0], infer(*near[i][:2], _smooth_crop([crop for _, _, crop in near], i)))
        for near, i in windows(cropped, CROP_RADIUS)
    )
    for near, i in windows(inferred, LIGHT_RADIUS):
        weights = _gaussian(len(near), i, LIGHT_RADIUS)
        light = np.tensordot(weights, np.stack([person.light for _, person in near]), 1)
        around = [person for _, person in near[max(i - TRANSPORT_RADIUS, 0) : i + TRANSPORT_RADIUS + 1]]
        pixels, person = near[i]
        yield pixels, replace(person, light=light.astype(np.float32), transport=_smooth_transport(person, around))


def windows(items: Iterable[T], radius: int) -> Iterator[tuple[list[T], int]]:
    """Yields for each item the list of those at most `radius` before and after it, and its index in that list."""
    stream = iter(items)
    near = list(islice(stream, radius + 1))
    centre = 0
    while centre < len(near):
        yield near, centre
        near = near + list(islice(stream, 1))
        centre += 1
        if centre > radius:
            near, centre = near[1:], centre - 1


def _gaussian(count: int, centre: int, radius: int) -> np.ndarray:
    """Returns the weights of frames around one of them: (count,), with a sum of 1.

    At `radius` frames from `centre`, the Gaussian has 2 standard deviations.
    """
    weights = np.exp(-2 * ((np.arange(count) - centre) / radius) ** 2)
    return weights / weights.sum()


def _smooth_crop(crops: list[Crop], i: int) -> Crop:
    """Returns the square of frame `i`, smoothed over time.

    Its top, left and side are the weighted means of those of `crops`, the squares of the frame and of those around it.
    """
    weights = _gaussian(len(crops), i, CROP_RADIUS)
    top, left, side = weights @ np.array([[crop.top, crop.left, crop.side] for crop in crops])
    return replace(crops[i], top=float(top), left=float(left), side=float(side))


def _smooth_transport(person: Person, around: list[Person]) -> np.ndarray:
    """Returns a person's transport (S,S,K), averaged over the frames `around` where the image hardly changes.

    So what moves is not smeared: a pixel's weight falls with its change (in units of CHANGE) and is 0 outside of both
    masks.
    """
    total = np.zeros_like(person.transport)
    weight = np.zeros((*person.mask.shape, 1), np.float32)
    for other in around:
        change = np.abs(other.image - person.image).max(-1)
        same = np.exp(-0.5 * (change / CHANGE) ** 2) * (person.mask & other.mask)
        total += same[..., None] * other.transport
        weight += same[..., None]
    return np.where(weight > 0, total / np.maximum(weight, 1e-6), person.transport)
