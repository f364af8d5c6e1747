"""Reading and writing video files with PyAV and Pillow, without a system ffmpeg."""

import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from itertools import chain, islice, pairwise, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.files import atomic_write, writable_file
from relight.pictures.opening import list_photos
from relight.pictures.picture import Picture
from relight.pictures.profile import HLG, PQ, PRIMARIES, TRANSFERS, by_codes

if TYPE_CHECKING:
    from av import VideoFrame
    from av.filter import Graph
    from av.video.stream import VideoStream

CODECS = {".mp4": ("libx264", {"crf": "18", "preset": "medium"}), ".webm": ("libvpx-vp9", {"crf": "28", "b": "0"})}
FPS = 25.0  # of what does not state its rate
READABLE = (".mp4", ".mov", ".webm", ".mkv", ".avi", ".m4v", ".gif")
MAX_FPS = 60  # of a clip whose rate varies
HDR = {PQ: "PQ", HLG: "HLG"}
BT2020 = 9  # color primaries of ITU-T H.273
WIDE = (BT2020, 11, 12)  # those, and P3's
KNOWN_MATRICES = (0, 1, 4, 5, 6, 7, 8, 9, 10, 14)  # of H.273; 2 is not specified
MIN_GIF_TICKS = 2  # hundredths of a second of a frame; many players slow shorter ones down


def require_writable_video(path: Path) -> None:
    """Raises UserError if a video cannot be written there, before any work is done."""
    if path.suffix.lower() not in (*CODECS, ".gif"):
        raise UserError(f"movie {path}: the name must end in .mp4, .webm or .gif")
    if path.suffix.lower() in CODECS:
        import av  # noqa: F401  (says at once that it is missing)
    writable_file(path, "movie")


def write_video(path: Path, frames: Iterable[np.ndarray], fps: float = FPS, sound: Path | None = None) -> None:
    """Writes a video, whole or not at all.

    Odd sizes gain a repeated row or column, since codecs halve the resolution of color. Colors are tagged BT.709.

    Args:
        path: of the file, .mp4 (H.264), .webm (VP9) or .gif.
        frames: (H,W,3) uint8 sRGB, all of one size.
        fps: frames per second.
        sound: a video whose sound the new one gets, as it is coded there; .gif has none.

    Raises:
        UserError: for another suffix, if there are no frames, or if the file cannot be written.
    """
    require_writable_video(path)
    with atomic_write(path) as tmp:
        if path.suffix.lower() == ".gif":
            _write_gif(tmp, frames, fps)
        else:
            _write_video(tmp, frames, fps, *CODECS[path.suffix.lower()])
            if sound:
                _add_sound(tmp, sound)


def _write_video(path: Path, frames: Iterable[np.ndarray], fps: float, codec: str, options: dict[str, str]) -> None:
    """Writes a video with a codec of FFmpeg, in BT.709; odd sizes are padded by a border pixel.

    The path is .mp4 or .webm, and frames are (H,W,3) uint8 sRGB, all of one size. Raises UserError if there is none.
    """
    import av

    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise UserError("the movie has no frames")
    with av.open(str(path), "w", options={"movflags": "faststart"} if path.suffix == ".mp4" else {}) as container:
        stream = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1001), options=options)
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width = (side + side % 2 for side in first.shape[:2])
        stream.pix_fmt = "yuv420p"
        stream.codec_context.colorspace = 1  # BT.709, which players assume at this size
        stream.codec_context.color_range = 1  # values 16 to 235
        for pixels in chain([first], frames):
            pixels = np.pad(pixels, ((0, pixels.shape[0] % 2), (0, pixels.shape[1] % 2), (0, 0)), mode="edge")
            image = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            container.mux(
                stream.encode(image.reformat(format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"))
            )
        container.mux(stream.encode())


def _add_sound(path: Path, source: Path) -> None:
    """Adds the sound of a video to another one, whose container must take its codec (else it stays silent)."""
    import av

    with_sound = path.with_name(f"{path.stem}-sound{path.suffix}")
    try:
        with av.open(str(source)) as spoken, av.open(str(path)) as shown, av.open(str(with_sound), "w") as out:
            if not spoken.streams.audio:
                return
            streams = {
                id(one): out.add_stream_from_template(one) for one in (shown.streams.video[0], spoken.streams.audio[0])
            }
            first = spoken.streams.video[0]
            late = (first.start_time or 0) * (first.time_base or 0)  # seconds: a film may begin after its sound
            packets: list[Any] = [*shown.demux(video=0), *spoken.demux(audio=0)]
            packets = [packet for packet in packets if packet.dts is not None]
            for packet in packets:
                if packet.stream in shown.streams:
                    packet.pts, packet.dts = (t + round(late / packet.time_base) for t in (packet.pts, packet.dts))
            for packet in sorted(packets, key=lambda p: float(p.dts * p.time_base)):
                packet.stream = streams[id(packet.stream)]
                out.mux(packet)
        with_sound.replace(path)
    except (av.FFmpegError, ValueError) as error:
        print(f"{source}: its sound is left out: {path.suffix} does not take it ({error})", file=sys.stderr)
    finally:
        with_sound.unlink(missing_ok=True)


def _write_gif(path: Path, frames: Iterable[np.ndarray], fps: float) -> None:
    """Writes a GIF with one palette for all frames, made from four of them, so that colors do not flicker.

    Frames are (H,W,3) uint8 sRGB. Raises UserError if there is none.
    """
    step = int(np.ceil(fps * MIN_GIF_TICKS / 100))  # faster ones are left out
    images, fps = [Image.fromarray(np.ascontiguousarray(f)) for f in islice(frames, 0, None, step)], fps / step
    if not images:
        raise UserError("the movie has no frames")
    samples = [np.asarray(images[i]) for i in sorted({0, len(images) // 4, len(images) // 2, len(images) - 1})]
    palette = Image.fromarray(np.concatenate(samples)).quantize(256, method=Image.Quantize.MEDIANCUT)
    first, *rest = [image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG) for image in images]
    ends = [round(100 * (i + 1) / fps) for i in range(len(images))]  # GIF counts hundredths of a second
    durations = [10 * (end - begin) for begin, end in pairwise([0, *ends])]
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=durations, loop=0, disposal=1)


def is_video(path: Path) -> bool:
    """Returns whether a file name is that of a video or an animated GIF."""
    return path.suffix.lower() in READABLE


def read_frames(path: Path) -> tuple[Iterator[Picture], list[int], float]:
    """Reads the frames of a video file or a folder of pictures, one by one.

    Frames of a video come upright, with square pixels, in sRGB.

    Returns:
        The frames; how often `at_constant_rate` shows each, so that it is seen at its time where the file's own rate
        varies (empty if their number is not known); and frames per second.

    Raises:
        UserError: if the path is neither, or, at the frame where it shows, if the file is damaged or its frames change
            their size.
    """
    if path.is_dir():
        files = list_photos(path)
        return (Picture.of(file) for file in files), [1] * len(files), FPS
    if not path.is_file():
        raise UserError(f"movie: there is no file or folder {path}")
    import av

    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            base = float(stream.time_base or 1)
            packets = [packet for packet in container.demux(stream) if not packet.is_discard]
            stored = [(p.pts * base, (p.duration or 0) * base) for p in packets if p.pts is not None]
            rate = float(stream.average_rate or FPS)
    except (av.FFmpegError, IndexError, TypeError) as error:
        raise UserError(f"{path} cannot be read as a video ({error})") from None
    times = np.sort([time for time, _ in stored])
    if len(times) < 2:
        return _decoded(path), [1] * len(times), rate
    steps = np.diff(times)
    usual = np.median(steps)
    time, last = stored[-1]  # in the order of decoding, to which durations belong
    last = last if time == times[-1] else 0
    if np.abs(steps - usual).max() < 0.5 * usual and last < 1.5 * usual:
        return _decoded(path), [1] * len(times), float(1 / steps.mean())
    rate = 1 / max(np.quantile(steps, 0.25, method="lower"), 1 / MAX_FPS)
    fps = float(round(rate) if rate > 10 else np.ceil(rate - 0.05))  # up, so that no frame of a slide show is left out
    shown = np.round((np.append(times, times[-1] + max(last, 1 / fps)) - times[0]) * fps).astype(int)
    return _decoded(path), np.diff(shown).tolist(), fps


def at_constant_rate(frames: Iterable[Picture], shown: list[int]) -> Iterator[Picture]:
    """Yields each frame as often as `read_frames` says, the same object; those that it does not count once."""
    for frame, count in zip(frames, chain(shown, repeat(1))):
        yield from repeat(frame, count)


def _decoded(path: Path) -> Iterator[Picture]:
    """Yields the frames of a video, upright and in sRGB.

    Raises:
        UserError: if the file is damaged, or its frames change their size.
    """
    import av

    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            decoder = stream.codec_context
            if stream.metadata.get("alpha_mode") == "1":  # which FFmpeg's own decoders of VP8 and VP9 leave out
                decoder = av.VideoCodecContext.create("libvpx-vp9" if decoder.name == "vp9" else "libvpx", "r")
            frames = (frame for packet in container.demux(stream) for frame in decoder.decode(packet))
            first, notes = next(frames, None), []
            if first is None:
                return
            if kind := HDR.get(first.color_trc):
                coded = f"it is coded for displays of high dynamic range ({kind})"
                notes = [f"{path}: {coded}; what is brighter than white is cut"]
            for frame in _filtered(_conversion(stream, first), chain([first], frames), path):
                pixels = np.ascontiguousarray(_upright(_shown(frame.to_ndarray(), first), first))
                given = pixels if pixels.shape[2] == 3 else Image.fromarray(pixels)
                picture = Picture.of(given, f"a frame of {path}", path.stem)
                yield replace(picture, notes=[*picture.notes, *notes])
    except av.FFmpegError as error:
        raise UserError(f"{path} is damaged or cut short ({error})") from None


def _filtered(graph: "Graph", frames: Iterator["VideoFrame"], path: Path) -> Iterator["VideoFrame"]:
    """Yields what filters make of the frames of a video; raises UserError if these change their size."""
    first = None
    for number, frame in enumerate(frames, 1):
        first = first or (frame.width, frame.height)
        if first != (frame.width, frame.height):
            raise UserError(
                f"{path}: frame {number} is {frame.width} x {frame.height} pixels, and those before are "
                f"{first[0]} x {first[1]}: a clip has one size"
            )
        graph.vpush(frame)
        yield from _ready(graph)
    graph.vpush(None)
    yield from _ready(graph)


def _ready(graph: "Graph") -> Iterator["VideoFrame"]:
    # What removes the lines of interlaced frames looks at the next one first.
    with suppress(BlockingIOError, EOFError):
        while True:
            yield graph.vpull()


def _conversion(stream: "VideoStream", frame: "VideoFrame") -> "Graph":
    """Returns FFmpeg's filters that make frames RGB with square pixels: of 16 bits where `_shown` converts them.

    The matrix is that of the file, or else BT.709 from 720 lines on and BT.601 below, as players take it.
    """
    import av

    graph = av.filter.Graph()
    aspect = stream.sample_aspect_ratio or 1
    matrix = "auto" if frame.colorspace in KNOWN_MATRICES else "bt709" if frame.height >= 720 else "bt601"
    has_alpha = any(component.is_alpha for component in frame.format.components)
    wide = f"{max(1, round(frame.width * aspect))}:{frame.height}"
    scale = graph.add("scale", f"{wide}:in_color_matrix={matrix}:flags=bicubic+accurate_rnd+full_chroma_int")
    planar, packed = ("gbrap", "rgba") if has_alpha else ("gbrp", "rgb24")  # planar first is twice as fast
    if _needs_conversion(frame):
        planar, packed = f"{planar}16le", "rgba64le" if has_alpha else "rgb48le"
    whole = [graph.add("bwdif", "deint=interlaced:mode=send_frame")] if frame.interlaced_frame else []
    source = graph.add_buffer(template=stream)
    nodes = [source, *whole, scale, graph.add("format", planar), graph.add("format", packed)]
    graph.link_nodes(*nodes, graph.add("buffersink")).configure()
    return graph


def _needs_conversion(frame: "VideoFrame") -> bool:
    """Returns whether codes are not to be displayed as sRGB, as those of the curves of standard television are."""
    return frame.color_trc in HDR or frame.color_primaries in WIDE


def _shown(pixels: np.ndarray, frame: "VideoFrame") -> np.ndarray:
    """Returns pixels (H,W,C) of the filters as uint8 sRGB."""
    if not _needs_conversion(frame):
        return pixels
    pixels = np.minimum(pixels, 255 << 8)  # FFmpeg's white in 16 bits
    pixels += pixels >> 8
    primaries = frame.color_primaries if frame.color_primaries in PRIMARIES else BT2020
    pixels[..., :3] = by_codes(pixels[..., :3], primaries, frame.color_trc if frame.color_trc in TRANSFERS else 1)
    return np.round(pixels / 257).astype(np.uint8)


def _upright(pixels: np.ndarray, frame: "VideoFrame") -> np.ndarray:
    """Returns pixels (H,W,3) turned and mirrored as the display matrix of a frame says (ISO 14496-12, 6.2.2)."""
    matrix: Any = frame.side_data.get("DISPLAYMATRIX")
    if matrix is None:
        return pixels
    a, b, _, c, d = np.frombuffer(matrix, np.int32, 5)
    if abs(b) > abs(a):
        pixels, a, d = pixels.swapaxes(0, 1), c, b
    return pixels[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1]
