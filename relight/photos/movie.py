"""The command `movie`: a photo under a light that turns, or a clip of moving people in another light.

The exposure is fixed throughout. A network that infers each frame of a clip for itself flickers, so its results are
smoothed over time: the light over all frames that seem to have the same; the crop over a few frames; the transport over
neighbouring frames only where the image itself did not change, so that a moving arm leaves no trace.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice, repeat
from pathlib import Path
from typing import TypeVar, Unpack

import numpy as np
from PIL import Image
from scipy.ndimage import maximum_filter, median_filter, minimum_filter

from relight.core.errors import UserError
from relight.core.numbers import finite
from relight.core.progress import progress
from relight.maps.square import MASK_THRESHOLD, Crop, crop_around
from relight.photos.inferred import SceneOptions, require_white_balance
from relight.photos.look import Look
from relight.photos.mask.coverage import GREY, coverage_of
from relight.photos.mask.find import masked
from relight.photos.mask.people import NobodyFound
from relight.photos.network import PhotoNetwork
from relight.photos.person import Person, balanced, infer_person
from relight.photos.scene import Exposed, Scene
from relight.pictures.codes import on_white
from relight.pictures.opening import list_photos, list_pictures, mask_in
from relight.pictures.picture import Given, Picture
from relight.pictures.video import FPS, at_constant_rate, is_video, read_frames, write_video

T = TypeVar("T")
CROP_RADIUS, TRANSPORT_RADIUS = 4, 1  # frames to each side that the means include
AHEAD, PAST = 12, 250  # frames after and before one whose lights count for its own
MEDIAN = 7  # frames, whose median light tells whether the light has changed,
ALIKE = 0.15  # and by how much of itself, in standard deviations
CODER = 16  # codes from black, and from what is bright in a mask, within which the coder of a clip leaves them
CHANGE = 0.06  # of linear values: pixels that differ by more from a neighbouring frame count as moved
SECONDS = 6.0  # of the movie of a photo
NOBODY = "nobody is seen, so nothing is relit"
BOUNDS = {"seconds": (0.1, 600), "fps": (1, 120), "turns": (-1000, 1000)}
UNKNOWN_LENGTH = 250  # frames of one turn of the light, for clips that do not state their length


def write_movie(
    network: PhotoNetwork,
    path: Path,
    mask: Path | None,
    out: Path,
    look: Look,
    seconds: float | None = None,
    fps: float | None = None,
    turns: float | None = None,
    size: int = 1080,
    **options: Unpack[SceneOptions],
) -> list[str]:
    """Writes the movie of a photo or of a clip, and shows its progress.

    Args:
        network: that infers.
        path: of a photo, a video, or a folder of frames.
        mask: of the photo; for a clip, a video of masks, or a folder of them, with the names of the frames or in their
            order. By default masks are found.
        out: the video file.
        look: at the start; its background is made ready to play, if it is a clip.
        seconds: length, for a photo; by default SECONDS.
        fps: frames per second of the movie of a photo or a folder; by default FPS. A video keeps its own.
        turns: of the light; by default 1 for a photo and 0 for a clip.
        size: the longer side is scaled down to it, pixels.
        **options: of `Scene.of`; in a clip, the whole mask of a frame is one person.

    Returns:
        Notes on the light, the photo and its mask; on a clip, with the number of frames, unless all have them.

    Raises:
        UserError: if an input is wrong or the file cannot be written.
    """
    given = {"seconds": seconds, "fps": fps, "turns": turns}
    seconds, fps, turns = (
        None if value is None else finite(name, value, *BOUNDS[name]) for name, value in given.items()
    )
    if look.background.kind == "transparent":
        raise UserError("a movie cannot be transparent: give another --background")
    if path.is_dir() or is_video(path):
        if seconds is not None or (fps is not None and path.is_file()):
            raise UserError(f"{path} is a clip and keeps its length: --seconds is for photos, --fps also for folders")
        notes: dict[str, list[str]] = {}
        frames, count, clip_fps = _relight_clip(network, path, mask, look, size, turns or 0.0, notes, **options)
        fps, sound = fps or clip_fps, path if path.is_file() else None
        look.background = look.background.playing(fps)
        write_video(out, progress(frames, "frames", total=count), fps, sound)
        alike = sorted(notes.values(), key=len, reverse=True)
        return [said[0] if len(said) == count else f"{said[0]} (frames: {len(said)})" for said in alike]
    scene, fps = Scene.of(path, mask, network, size=size, **options), fps or FPS
    look.background = look.background.playing(fps)
    count = max(1, round((seconds or SECONDS) * fps))
    turn = 2 * np.pi * (1.0 if turns is None else turns) / count
    exposed = scene.exposed(look, turning=turn != 0)
    frames = map(on_white, scene.turned(look, exposed, [turn * i for i in range(count)]))
    write_video(out, progress(frames, "frames", total=count), fps)
    return scene.notes + scene.notes_on(look, turn != 0, opaque=True)


def _relight_clip(
    network: PhotoNetwork,
    path: Path,
    masks: Path | None,
    look: Look,
    size: int,
    turns: float,
    notes: dict[str, list[str]],
    **options: Unpack[SceneOptions],
) -> tuple[Iterator[np.ndarray], int | None, float]:
    """Relights a video or a folder of pictures, with results smoothed over time.

    The whole mask of a frame is one person, and the new light is matched to the exposure of the first frame with one.
    While the frames are made, `notes` gets those on each, by what they say without numbers. Returns the frames (H,W,3)
    uint8, their number if it is known, and frames per second.
    """
    if options.get("lit_by"):
        raise UserError("the light of a clip is inferred in each frame: --lit-by is for photos")
    white_balance = options.get("white_balance", "keep")
    require_white_balance(white_balance)
    frames, shown, fps = read_frames(path)
    count = sum(shown) or None

    def infer(picture: Picture, crop: Crop) -> Person:
        assert picture.coverage is not None  # frames are masked
        person = infer_person(network, picture.pixels, picture.coverage, crop)
        return balanced([person])[0] if white_balance == "keep" else person

    def relit() -> Iterator[np.ndarray]:
        clip = with_masks(path, frames, masks, options.get("mask_model"))
        pictures = at_constant_rate((frame.downscaled(size) for frame in clip), shown)
        exposed = None
        for i, scene in enumerate(smooth_over_time(pictures, network.size, infer)):
            said, shown_as = scene.picture.notes, exposed
            if scene.people:
                scene.network = network
                said = scene.notes + scene.notes_on(look, turns != 0, opaque=True)
                shown_as = exposed = exposed or scene.exposed(look, turns != 0)
            for note in said:
                notes.setdefault(re.sub(r"\d[\d.]*", "", note), []).append(note)
            turn = 2 * np.pi * turns * i / (count or UNKNOWN_LENGTH)
            unlit = Exposed(np.zeros((9, 3)), look.background)
            yield from map(on_white, scene.turned(look, shown_as or unlit, [turn]))
        if exposed is None:
            advice = "give masks with --mask" if masks is None else f"all masks of {masks} are empty"
            raise NobodyFound(f"nobody was found in {path}: {advice}")

    return relit(), count, fps


def with_masks(
    clip: Path, frames: Iterator[Picture], masks: Path | None, mask_model: Path | str | None = None
) -> Iterator[Picture]:
    """Yields the frames of a clip, masked.

    `masks` is a video, or a folder: by the frames' names if any has one, else in order. If it is None, a frame's file
    has its mask beside it, or it is found. A frame may show nobody. Raises UserError if a mask is missing or is of
    another size.
    """
    given = repeat(None) if masks is None else _masks(clip, masks)
    for number, (frame, mask) in enumerate(zip(frames, given, strict=masks is not None), 1):
        try:
            yield masked(frame, _drawn(mask) if isinstance(mask, Picture) else mask, mask_model)
        except NobodyFound:
            yield replace(frame, coverage=np.zeros(frame.shape, np.uint8), notes=[*frame.notes, NOBODY])
        except UserError as error:
            where = f"frame {number} of the clip, mask of {masks}: " if masks else ""
            raise UserError(f"{where}{error}") from None


def _masks(clip: Path, masks: Path) -> Iterator[Given]:
    """Returns the masks of the frames of a clip; raises UserError if they are not as many."""
    stream: Iterator[Given]
    if masks.is_dir():
        by_name = {frame.name: mask_in(masks, frame.stem) for frame in (list_photos(clip) if clip.is_dir() else [])}
        missing = [name for name, mask in by_name.items() if mask is None]
        if 0 < len(missing) < len(by_name):
            raise UserError(f"folder {masks} holds no mask of the frame {missing[0]}")
        files = list(filter(None, by_name.values())) or list_pictures(masks)
        stream, count = iter(files), len(files)
    elif is_video(masks):
        stream, shown, _ = read_frames(masks)
        count = len(shown)
    else:
        raise UserError(f"mask {masks}: for a clip give a folder of masks or a video of them")
    if count != (needed := len(read_frames(clip)[1])):
        raise UserError(f"{masks} holds {count} masks, but the clip has {needed} frames: each has its own")
    return stream


def _drawn(frame: Picture) -> Image.Image:
    """Returns a frame of a clip of masks without the noise of its coder, where it is dark and where it is bright.

    Raises UserError if even areas have several colors; along edges, coders mix them.
    """
    codes = frame.codes.max(-1) if frame.alpha is None else frame.alpha
    if frame.alpha is None and np.ptp(frame.codes, axis=-1).max() > GREY:
        even = maximum_filter(codes, 5) - minimum_filter(codes, 5) < CODER
        coverage_of(frame.codes[even][:, None], "the mask")
    bright = codes[codes >= MASK_THRESHOLD]
    peak = np.quantile(bright, 0.9) if bright.size else 255
    return Image.fromarray(np.where(codes < CODER, 0, np.where(codes > peak - CODER, 255, codes)).astype(np.uint8))


def smooth_over_time(frames: Iterable[Picture], size: int, infer: Callable[[Picture, Crop], Person]) -> Iterator[Scene]:
    """Infers the person in each frame, with crop, light and transport smoothed over time.

    This is a stream: at most AHEAD + CROP_RADIUS frames to each side are in memory. The light of a frame is the mean of
    those of the last PAST frames and the next AHEAD, weighted by how alike they are: an inference from one frame is
    off by a tenth, and another way as the person turns, but a lamp that is switched on must be followed at once.

    Args:
        frames: masked.
        size: of the network's image, pixels.
        infer: from a frame and its crop to a person.

    Yields:
        The scene of each frame; without people, if the mask is empty.
    """
    masks = ((frame, np.asarray(frame.coverage)) for frame in frames)
    cropped = ((frame, crop_around(mask, size) if mask.any() else None) for frame, mask in masks)
    lights: list[np.ndarray] = []

    def inferred() -> Iterator[tuple[Picture, Person | None, int]]:
        """Yields frames, with the number of the person's light in `lights`."""
        for near, i in windows(cropped, CROP_RADIUS):
            frame, crop = near[i]
            person = infer(frame, _smooth_crop(crop, [each for _, each in near], i)) if crop else None
            lights.extend([person.light] if person else [])
            yield frame, person, len(lights) - 1

    for near, i in windows(inferred(), AHEAD):
        frame, person, number = near[i]
        if not person:
            yield Scene(frame, [])
            continue
        first = max(number - PAST, 0)
        around = [each for _, each, _ in near[max(i - TRANSPORT_RADIUS, 0) : i + TRANSPORT_RADIUS + 1] if each]
        light = _mean_alike(np.stack(lights[first:]), number - first)
        yield Scene(frame, [replace(person, light=light, transport=_smooth_transport(person, around))])


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


def _mean_alike(lights: np.ndarray, i: int) -> np.ndarray:
    """Returns the mean of lights (N,K,3), weighted by how like the one at `i` each is, by medians over time."""
    medians = median_filter(lights, (MEDIAN, 1, 1), mode="nearest")
    change = np.linalg.norm(medians - medians[i], axis=(1, 2)) / np.linalg.norm(medians[i])
    weights = np.exp(-0.5 * (change / ALIKE) ** 2)
    return np.tensordot(weights / weights.sum(), lights, 1).astype(np.float32)


def _smooth_crop(crop: Crop, crops: Sequence[Crop | None], i: int) -> Crop:
    # At CROP_RADIUS frames from `i`, the Gaussian has 2 standard deviations.
    weights = [np.exp(-2 * ((j - i) / CROP_RADIUS) ** 2) for j, near in enumerate(crops) if near]
    top, left, side = np.average([[near.top, near.left, near.side] for near in crops if near], 0, weights)
    return replace(crop, top=float(top), left=float(left), side=float(side))


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
