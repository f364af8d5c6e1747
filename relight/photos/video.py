"""Reading and writing video files with PyAV and Pillow, without a system ffmpeg."""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image

from relight.errors import UserError
from relight.files import atomic_write, writable_file
from relight.photos.read import Photo, list_photos, read_photo

CODECS = {".mp4": ("libx264", {"crf": "18", "preset": "medium"}), ".webm": ("libvpx-vp9", {"crf": "28", "b": "0"})}
FPS = 25.0  # of what does not state its rate
READABLE = (".mp4", ".mov", ".webm", ".mkv", ".avi", ".m4v", ".gif")
WRITABLE = (*CODECS, ".gif")
MIN_GIF_TICKS = 2  # hundredths of a second of a frame; many players slow shorter ones down


def writable_video(path: Path | str) -> Path:
    """Returns `path` if a video can be written there; raises UserError otherwise, before any work is done."""
    path = Path(path)
    if path.suffix.lower() not in WRITABLE:
        raise UserError(f"movie {path}: the name must end in .mp4, .webm or .gif")
    if path.suffix.lower() in CODECS:
        import av  # noqa: F401  (says at once that it is missing)
    return writable_file(path, "movie")


def write_video(path: Path | str, frames: Iterable[np.ndarray], fps: float = FPS) -> None:
    """Writes a video, whole or not at all.

    Odd sizes gain a repeated row or column, since codecs halve the resolution of color. Colors are tagged BT.709.

    Args:
        path: of the file, .mp4 (H.264), .webm (VP9) or .gif.
        frames: (H,W,3) uint8 sRGB, all of one size.
        fps: frames per second.

    Raises:
        UserError: for another suffix, if there are no frames, or if the file cannot be written.
    """
    path = writable_video(path)
    with atomic_write(path) as tmp:
        if path.suffix.lower() == ".gif":
            _write_gif(tmp, frames, fps)
        else:
            _write_video(tmp, frames, fps, *CODECS[path.suffix.lower()])


def _write_video(path: Path, frames: Iterable[np.ndarray], fps: float, codec: str, options: dict[str, str]) -> None:
    """Writes a video with a codec of FFmpeg, in BT.709; odd sizes are padded by a border pixel.

    The path is .mp4 or .webm, and frames are (H,W,3) uint8 sRGB, all of one size. Raises UserError if there is none.
    """
    import av

    with av.open(str(path), "w", options={"movflags": "faststart"} if path.suffix == ".mp4" else {}) as container:
        stream: av.VideoStream | None = None
        for pixels in frames:
            pixels = np.pad(pixels, ((0, pixels.shape[0] % 2), (0, pixels.shape[1] % 2), (0, 0)), mode="edge")
            if stream is None:
                added = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1001), options=options)
                assert isinstance(added, av.VideoStream)
                stream = added
                stream.height, stream.width = pixels.shape[:2]
                stream.pix_fmt = "yuv420p"
                stream.codec_context.colorspace = 1  # BT.709, which players assume at this size
                stream.codec_context.color_range = 1  # values 16 to 235
            image = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            container.mux(
                stream.encode(image.reformat(format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"))
            )
        if stream is None:
            raise UserError("the movie has no frames")
        container.mux(stream.encode())


def _write_gif(path: Path, frames: Iterable[np.ndarray], fps: float) -> None:
    """Writes a GIF with one palette for all frames, made from four of them, so that colors do not flicker.

    Frames are (H,W,3) uint8 sRGB. Raises UserError if there is none.
    """
    images = [Image.fromarray(np.ascontiguousarray(f)) for f in frames]
    if not images:
        raise UserError("the movie has no frames")
    samples = [np.asarray(images[i]) for i in sorted({0, len(images) // 4, len(images) // 2, len(images) - 1})]
    palette = Image.fromarray(np.concatenate(samples)).quantize(256, method=Image.Quantize.MEDIANCUT)
    first, *rest = [image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG) for image in images]
    ends = [round(100 * (i + 1) / fps) for i in range(len(images))]  # GIF counts hundredths of a second
    durations = [10 * max(MIN_GIF_TICKS, end - begin) for begin, end in pairwise([0, *ends])]
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=durations, loop=0, disposal=1)


def is_video(path: Path | str) -> bool:
    """Returns whether a file name is that of a video or an animated GIF."""
    return Path(path).suffix.lower() in READABLE


def read_frames(path: Path | str) -> tuple[Iterator[Photo], int | None, float]:
    """Reads the frames of a video file or a folder of pictures, one by one.

    Returns:
        The frames, their number if it is known, and frames per second.

    Raises:
        UserError: if the path is neither, or, at the frame where it shows, if the file is damaged.
    """
    path = Path(path)
    if path.is_dir():
        files = list_photos(path)
        return (read_photo(file) for file in files), len(files), FPS
    if not path.is_file():
        raise UserError(f"movie: there is no file or folder {path}")
    import av

    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            count, fps = stream.frames or None, float(stream.average_rate or FPS)
    except (av.FFmpegError, IndexError) as error:
        raise UserError(f"{path} cannot be read as a video ({error})") from None
    return _decoded(path), count, fps


def _decoded(path: Path) -> Iterator[Photo]:
    """Yields the frames of a video, upright; raises UserError if it is damaged."""
    import av

    try:
        with av.open(str(path)) as container:
            for image in container.decode(video=0):  # phones store portrait clips rotated
                upright = np.rot90(image.to_ndarray(format="rgb24"), round(image.rotation / 90))
                yield Photo(np.ascontiguousarray(upright), None, path.stem, what=f"a frame of {path}")
    except av.FFmpegError as error:
        raise UserError(f"{path} is damaged or cut short ({error})") from None
