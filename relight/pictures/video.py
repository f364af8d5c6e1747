"""Reading and writing video files with PyAV and Pillow, without a system ffmpeg."""

import shlex
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from itertools import chain, groupby, islice, pairwise, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.files import VIDEO_SUFFIXES, atomic_write, writable_file
from relight.core.srgb import decode
from relight.pictures.opening import decoding_errors, list_photos, open_picture
from relight.pictures.picture import Picture
from relight.pictures.profile import HLG, PQ, PRIMARIES, TRANSFERS, by_codes

if TYPE_CHECKING:
    from av import VideoFrame
    from av.container import InputContainer
    from av.filter import Graph
    from av.video.stream import VideoStream

CODECS = {".mp4": ("libx264", {"crf": "18", "preset": "medium"}), ".webm": ("libvpx-vp9", {"crf": "28", "b": "0"})}
CONTAINERS = {".mp4": {"movflags": "faststart"}, ".webm": {}}  # the index in front, so that pages show it at once
# The codec of sound that is coded anew, and those that are kept.
SOUNDS = {".mp4": ("aac", "aac", "mp3", "ac3", "eac3", "alac", "flac", "opus"), ".webm": ("libopus", "opus", "vorbis")}
RATE = 48000  # of sound that is coded anew, samples per second
FPS = 25.0  # of what does not state its rate
MAX_FPS = 60  # of a clip whose rate varies
GIF_DELAY = 0.1  # seconds that browsers show what states a hundredth or less
HDR = {PQ: "PQ", HLG: "HLG"}
# Codes of ITU-T H.273.
BT709, BT2020 = 1, 9
UNSTATED = (2, 3)  # and what is reserved
WIDE = (BT2020, 11, 12)  # primaries of BT.2020 and P3
MATRICES = (0, 1, 4, 5, 6, 7, 9)  # that FFmpeg's scaler knows
DOLBY = ("dvh1", "dvhe", "dav1", "dva1", "dvav")  # the codings of Dolby Vision that no other decoder shows right
CONVERT = "convert it to BT.709"
LOST = "a part that cannot be decoded shows its neighbouring frame"
JUMP = 0.1  # seconds by which a clock that was set anew goes back, as for FFmpeg
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
        sound: a video whose sound the new one gets; .gif has none.

    Raises:
        UserError: for another suffix, if there are no frames, or if the file cannot be written.
    """
    require_writable_video(path)
    with atomic_write(path) as tmp:
        if (first := next(frames := iter(frames), None)) is None:
            raise UserError("the movie has no frames")
        frames = chain([first], frames)
        if path.suffix.lower() == ".gif":
            _write_gif(tmp, frames, fps)
        else:
            _write_video(tmp, first.shape[:2], frames, fps)
            if sound:
                _add_sound(tmp, sound)


def _write_video(path: Path, size: tuple[int, ...], frames: Iterable[np.ndarray], fps: float) -> None:
    """Writes frames of a size (H, W) with a codec of FFmpeg, in BT.709; odd sizes are padded by a border pixel."""
    import av

    codec, options = CODECS[path.suffix.lower()]
    with av.open(str(path), "w", options=CONTAINERS[path.suffix.lower()]) as container:
        stream = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1001), options=options)
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width = (side + side % 2 for side in size)
        stream.pix_fmt = "yuv420p"
        coder = stream.codec_context
        coder.colorspace = coder.color_primaries = coder.color_trc = BT709
        coder.color_range = 1  # values 16 to 235
        for pixels in frames:
            pixels = np.pad(pixels, ((0, pixels.shape[0] % 2), (0, pixels.shape[1] % 2), (0, 0)), mode="edge")
            image = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            container.mux(
                stream.encode(image.reformat(format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"))
            )
        container.mux(stream.encode())


def _add_sound(path: Path, source: Path) -> None:
    """Adds the sound of a video to another one: as it is coded, where browsers take this from the container, else anew.

    The first of both begins at 0, and the other as long after it as in `source`.
    """
    import av

    with_sound = path.with_name(f"{path.stem}-sound{path.suffix}")
    options, (coding, *taken) = CONTAINERS[path.suffix.lower()], SOUNDS[path.suffix.lower()]
    try:
        with (
            av.open(f"file:{source}") as spoken,
            av.open(str(path)) as shown,
            av.open(str(with_sound), "w", options=options) as out,
        ):
            film, sound, pictures = _film(spoken, source), spoken.streams.best("audio"), shown.streams.video[0]
            if not isinstance(sound, av.AudioStream):
                return
            film_at, sound_at = ((one.start_time or 0) * (one.time_base or Fraction()) for one in (film, sound))
            begin = min(film_at, sound_at)  # seconds
            parts: list[Any] = [(out.add_stream_from_template(pictures), shown.demux(pictures), film_at - begin)]
            if sound.codec_context.codec.canonical_name in taken:
                parts.append((out.add_stream_from_template(sound), spoken.demux(sound), -begin))
            else:
                coder: Any = out.add_stream(coding, rate=RATE)
                coded = (packet for frame in chain(spoken.decode(sound), [None]) for packet in coder.encode(frame))
                parts.append((coder, coded, -begin))
            packets = []
            for stream, stored, late in parts:
                for packet in stored:
                    if packet.dts is not None:
                        packet.pts, packet.dts = (t + round(late / packet.time_base) for t in (packet.pts, packet.dts))
                        packet.stream = stream
                        packets.append(packet)
            for packet in sorted(packets, key=lambda p: float(p.dts * p.time_base)):
                out.mux(packet)
        with_sound.replace(path)
    except (av.FFmpegError, ValueError) as error:
        print(f"{source}: its sound is left out, for it cannot be read ({error})", file=sys.stderr)
    finally:
        with_sound.unlink(missing_ok=True)


def _film(container: "InputContainer", path: Path) -> "VideoStream":
    """Returns the stream that players show: the default one, the largest of several, and no picture of a cover."""
    from av.stream import Disposition

    covers = Disposition.attached_pic | Disposition.timed_thumbnails
    if not (films := [stream for stream in container.streams.video if not stream.disposition & covers]):
        raise UserError(f"{path} holds no film")
    return max(films, key=lambda film: (bool(film.disposition & Disposition.default), film.width * film.height))


def _write_gif(path: Path, frames: Iterable[np.ndarray], fps: float) -> None:
    """Writes a GIF with one palette for all frames, made from four of them, so that colors do not flicker."""
    step = int(np.ceil(fps * MIN_GIF_TICKS / 100))  # faster ones are left out
    images, fps = [Image.fromarray(np.ascontiguousarray(f)) for f in islice(frames, 0, None, step)], fps / step
    samples = [np.asarray(images[i]) for i in sorted({0, len(images) // 4, len(images) // 2, len(images) - 1})]
    palette = Image.fromarray(np.concatenate(samples)).quantize(256, method=Image.Quantize.MEDIANCUT)
    first, *rest = [image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG) for image in images]
    ends = [round(100 * (i + 1) / fps) for i in range(len(images))]  # GIF counts hundredths of a second
    durations = [10 * (end - begin) for begin, end in pairwise([0, *ends])]
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=durations, loop=0, disposal=1)


def is_video(path: Path) -> bool:
    """Returns whether a file has the name of a video, or is an animated GIF."""
    if path.suffix.lower() != ".gif":
        return path.suffix.lower() in VIDEO_SUFFIXES
    with decoding_errors(f"{path}"), open_picture(path, f"{path}") as image:
        return getattr(image, "n_frames", 1) > 1


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
        return _of_one_size(map(Picture.of, files), path), [1] * len(files), FPS
    if not path.is_file():
        raise UserError(f"movie: there is no file or folder {path}")
    import av

    stored, clocks, end, is_cut = [], [], 0.0, False
    try:
        with av.open(f"file:{path}") as container:  # else FFmpeg takes what is before a colon for a protocol
            film, is_gif = _film(container, path), container.format.name == "gif"
            rate, own = float(film.average_rate or FPS), film.duration is not None
            promised = float((film.duration or 0) * (film.time_base or 0)) if own else (container.duration or 0) / 1e6
            is_avi = container.format.name == "avi"  # its duration is guessed by the bytes that are there
            promised = film.frames / rate if is_avi else promised
            for packet in container.demux(*[film] * own):  # the length of a Matroska is that of its longest stream
                if packet.pts is None or packet.is_discard:
                    continue
                time, length = (t * float(packet.time_base or 0) for t in (packet.pts, packet.duration or 0))
                end = max(end, time + length)
                if packet.stream_index == film.index:
                    stored.append((time, length))
                    if packet.dts is not None:
                        clocks.append(packet.dts * float(packet.time_base or 0))
                    is_cut = packet.is_corrupt
    except (av.FFmpegError, TypeError) as error:
        raise UserError(f"{path} cannot be read as a video ({error})") from None
    if np.diff(clocks).min(initial=0) < -JUMP:
        joined = f"ffmpeg -i {shlex.quote(str(path))} -c copy whole.mp4"
        raise UserError(f"{path}: its clock jumps back, as where files were joined: make one clip of it by `{joined}`")
    times = np.sort([time for time, _ in stored])
    decoded = _of_one_size(_decoded(path, np.full(len(times), np.inf) if is_avi else times), path)
    steps = np.diff(times)
    found = end - times[0] * own if len(times) else promised
    longest = (np.median(steps) if own else steps.max()) if len(steps) else 1 / rate
    if is_cut or promised - found > 1.5 * longest:
        told = f"its file promises {promised:.1f} seconds and holds {found:.1f}"
        raise UserError(f"{path} is cut short: {told}: give the whole clip, or save what is left as a new one")
    if is_gif:
        lengths = [length if length > MIN_GIF_TICKS / 200 else GIF_DELAY for _, length in stored]
        times = np.cumsum([0, *lengths[:-1]])
        steps, stored = np.diff(times), list(zip(times, lengths))
    if len(times) < 2:
        return decoded, [1] * len(times), rate
    usual = np.median(steps)
    time, last = stored[-1]  # in the order of decoding, to which durations belong
    last = last if time == times[-1] else 0
    if np.abs(steps - usual).max() < 0.5 * usual and usual - 0.1 < (last or usual) < 1.5 * usual:
        return decoded, [1] * len(times), float(1 / steps.mean())
    rate = 1 / max(np.quantile(steps, 0.25, method="lower"), 1 / MAX_FPS)
    fps = float(round(rate) if rate > 10 else np.ceil(rate - 0.05))  # up, so that no frame of a slide show is left out
    shown = np.round((np.append(times, times[-1] + max(last, 1 / fps)) - times[0]) * fps).astype(int)
    return decoded, np.diff(shown).tolist(), fps


def at_constant_rate(frames: Iterable[Picture], shown: list[int]) -> Iterator[Picture]:
    """Yields each frame as often as `read_frames` says, the same object; those that it does not count once."""
    for frame, count in zip(frames, chain(shown, repeat(1))):
        yield from repeat(frame, count)


def _of_one_size(frames: Iterable[Picture], path: Path) -> Iterator[Picture]:
    """Yields the frames of a clip; raises UserError if they change their size."""
    first = None
    for number, frame in enumerate(frames, 1):
        if (first := first or frame.shape) != frame.shape:
            name = frame.file or f"{path}: frame {number}"
            sizes = [f"{width} x {height} pixels" for height, width in (frame.shape, first)]
            raise UserError(f"{name} is {sizes[0]}, and those before are {sizes[1]}: a clip has one size")
        yield frame


def _decoded(path: Path, stamps: np.ndarray) -> Iterator[Picture]:
    """Yields the frames of a video, upright and in sRGB: one for each of `stamps`, seconds.

    Stamps of AVI, which holds none, are infinite: frames come in their order, and those that are lost at the end.

    Raises:
        UserError: if the file is damaged, or its colors are of a kind that is not read.
    """
    import av

    try:
        with av.open(f"file:{path}") as container:
            film = _film(container, path)
            decoder = film.codec_context
            if film.metadata.get("alpha_mode") == "1":  # which FFmpeg's own decoders of VP8 and VP9 leave out
                decoder = av.VideoCodecContext.create("libvpx-vp9" if decoder.name == "vp9" else "libvpx", "r")

            def frames() -> Iterator[av.VideoFrame]:
                for packet in container.demux(film):
                    with suppress(av.InvalidDataError):  # it is lost
                        yield from decoder.decode(packet)

            done, last = 0, None
            for frame in _filtered(film, frames(), path):
                picture = _picture(frame, path)
                place = int(np.searchsorted(stamps, (frame.time or 0) - 1e-4))
                yield from repeat(_lost(last or picture), place - done)
                yield picture
                done, last = max(done, place) + 1, picture
            if last is None:
                raise UserError(f"{path} is damaged: none of its frames can be decoded")
            yield from repeat(_lost(last), len(stamps) - done)
    except av.FFmpegError as error:
        raise UserError(f"{path} is damaged or cut short ({error})") from None


def _lost(neighbour: Picture) -> Picture:
    return replace(neighbour, notes=[*neighbour.notes, LOST])


def _picture(frame: "VideoFrame", path: Path) -> Picture:
    """Returns a frame of the filters as a picture."""
    pixels = np.ascontiguousarray(_upright(_shown(frame.to_ndarray(), frame), frame))
    given = pixels if pixels.shape[2] == 3 else Image.fromarray(pixels)
    picture = Picture.of(given, f"a frame of {path}", path.stem)
    if kind := HDR.get(frame.color_trc):
        coded = f"it is coded for displays of high dynamic range ({kind})"
        picture.notes.append(f"{path}: {coded}; what is brighter than white is cut")
    return picture


def _filtered(film: "VideoStream", frames: Iterator["VideoFrame"], path: Path) -> Iterator["VideoFrame"]:
    """Yields what filters make of the frames of a video; they are made anew where these state other things."""

    def stated(frame: "VideoFrame") -> tuple[Any, ...]:
        colors = frame.colorspace, frame.color_primaries, frame.color_trc, frame.color_range
        return frame.width, frame.height, frame.format.name, *colors

    for _, alike in groupby(frames, stated):
        first = next(alike)
        graph = _conversion(film, first, path)
        for frame in chain([first], alike, [None]):  # at the end, a filter gives what it held to see the next one
            graph.vpush(frame)
            with suppress(BlockingIOError, EOFError):
                while True:
                    yield graph.vpull()


def _conversion(film: "VideoStream", frame: "VideoFrame", path: Path) -> "Graph":
    """Returns FFmpeg's filters that make frames RGB with square pixels: of 16 bits where `_shown` converts them.

    The matrix is that of the file, or else BT.709 from 720 lines on and BT.601 below, as players take it. Raises
    UserError if the frame states colors of a kind that is not read.
    """
    import av

    is_stated = frame.colorspace not in UNSTATED
    if not is_stated and (frame.color_trc in HDR or film.codec_context.codec_tag in DOLBY):
        raise UserError(f"{path} has high dynamic range, but no matrix is stated, as in Dolby Vision 5: {CONVERT}")
    kinds = {"matrix": (frame.colorspace, MATRICES), "primaries": (frame.color_primaries, PRIMARIES)}
    kinds["transfer"] = (frame.color_trc, TRANSFERS)
    unknown = [f"{kind} {code}" for kind, (code, known) in kinds.items() if code not in (*known, *UNSTATED, 0)]
    if unknown:
        raise UserError(f"{path} has colors of {' and '.join(unknown)} of ITU-T H.273: {CONVERT}")
    graph = av.filter.Graph()
    aspect = film.sample_aspect_ratio or 1
    matrix = "auto" if is_stated else "bt709" if frame.height >= 720 else "bt601"
    has_alpha = any(component.is_alpha for component in frame.format.components)
    wide = f"{max(1, round(frame.width * aspect))}:{frame.height}"
    scale = graph.add("scale", f"{wide}:in_color_matrix={matrix}:flags=bicubic+accurate_rnd+full_chroma_int")
    planar, packed = ("gbrap", "rgba") if has_alpha else ("gbrp", "rgb24")  # planar first is twice as fast
    if TRANSFERS.get(frame.color_trc, decode) is not decode or frame.color_primaries in WIDE:  # not shown as sRGB is
        planar, packed = f"{planar}16le", "rgba64le" if has_alpha else "rgb48le"
    is_film = not (frame.format.is_rgb or frame.format.has_palette)  # which may be interlaced in part
    whole = [graph.add("bwdif", "deint=interlaced:mode=send_frame")] if is_film else []
    source = graph.add_buffer(None, frame.width, frame.height, frame.format, time_base=film.time_base)
    nodes = [source, *whole, scale, graph.add("format", planar), graph.add("format", packed)]
    graph.link_nodes(*nodes, graph.add("buffersink")).configure()
    return graph


def _shown(pixels: np.ndarray, frame: "VideoFrame") -> np.ndarray:
    """Returns pixels (H,W,C) of the filters as uint8 sRGB."""
    if pixels.dtype == np.uint8:
        return pixels
    pixels = np.minimum(pixels, 255 << 8)  # FFmpeg's white in 16 bits
    pixels += pixels >> 8
    usual = BT2020 if frame.color_trc in HDR else BT709
    primaries = frame.color_primaries if frame.color_primaries in PRIMARIES else usual
    pixels[..., :3] = by_codes(pixels[..., :3], primaries, frame.color_trc if frame.color_trc in TRANSFERS else BT709)
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
