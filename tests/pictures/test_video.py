import shutil
import struct
import subprocess
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from relight.core.errors import UserError
from relight.core.srgb import decode, encode
from relight.pictures.video import LOST, at_constant_rate, read_frames, write_video

PATCHES = np.array([[200, 60, 40], [40, 160, 60], [50, 80, 200], [128, 128, 128]])
LUMA = {  # of red and blue
    "601": (0.299, 0.114), "709": (0.2126, 0.0722), "2020": (0.2627, 0.0593), "FCC": (0.3, 0.11), "240": (0.212, 0.087)
}  # fmt: skip
# Columns of linear sRGB to linear colors of BT.2020 and of P3, by their chromaticities.
TO_2020 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]])
TO_P3 = np.array([[0.8225, 0.1775, 0.0], [0.0332, 0.9668, 0.0], [0.0171, 0.0724, 0.9105]])


def hlg(values: np.ndarray) -> np.ndarray:
    """BT.2100's HLG of linear BT.2020, with white at 203 of 1,000 nits."""
    luminance = (values @ [0.2627, 0.6780, 0.0593])[..., None] * 0.203
    scene = values * 0.203 * luminance ** (-0.2 / 1.2)
    high = 0.17883277 * np.log(np.maximum(12 * scene - 0.28466892, 1e-9)) + 0.55991073
    return np.where(scene <= 1 / 12, np.sqrt(3 * scene), high)


def pq(values: np.ndarray) -> np.ndarray:
    """BT.2100's PQ of linear colors, with white at 203 nits."""
    y = (values * 203 / 10000) ** 0.1593017578125
    return ((0.8359375 + 18.8515625 * y) / (1 + 18.6875 * y)) ** 78.84375


def write(path, codes, matrix="709", bits=8, tags=None, codec="libx264", full=False, aspect=None, times=range(3),
          last=1, faststart=False):  # fmt: skip
    """Writes a picture (H,W,3) of codes in [0,1] as a clip, by the matrices of ITU-R BT.601, 709 and 2020.

    tags: matrix, primaries and transfer by the numbers of ITU-T H.273; None writes none.
    times: of the frames, in thirtieths of a second; an edit list cuts off those below 0. last: the last one's length.
    """
    red, blue = LUMA[matrix]
    luma = codes @ [red, 1 - red - blue, blue]
    chroma = [(codes[..., 2] - luma) / (2 - 2 * blue), (codes[..., 0] - luma) / (2 - 2 * red)]
    scale, low, high, wide = 2 ** (bits - 8), *((0, 255, 255) if full else (16, 219, 224))
    planes = [(low + high * luma) * scale, *((128 + wide * plane[::2, ::2]) * scale for plane in chroma)]
    rows = np.concatenate([plane.reshape(-1, codes.shape[1]) for plane in planes]).round().clip(0, 255 * scale)
    form = "yuv420p" if bits == 8 else f"yuv420p{bits}le"
    with av.open(str(path), "w", options={"movflags": "faststart"} if faststart else {}) as file:
        options = {"crf": "1", "g": "20", "x265-params": "log-level=none"}
        options = {"lossless": "1"} if codec == "libvpx-vp9" else options
        options |= {"bf": "0"} if last > 1 else {}  # then the last one in the file is the last one shown
        stream = file.add_stream(codec, rate=30, options=options)
        stream.height, stream.width = codes.shape[:2]
        stream.pix_fmt, context = form, stream.codec_context
        context.time_base = Fraction(1, 30)
        if tags:
            context.colorspace, context.color_primaries, context.color_trc = tags
        context.color_range = 2 if full else 1
        if aspect:
            context.sample_aspect_ratio = aspect
        packets = []
        for time in times:
            frame = av.VideoFrame.from_ndarray(rows.astype(np.uint8 if bits == 8 else np.uint16), form)
            frame.pts, frame.time_base, frame.color_range = time, Fraction(1, 30), 2 if full else 1
            if tags:
                frame.colorspace = tags[0]
            packets += stream.encode(frame)
        packets += stream.encode()
        packets[-1].duration = round(last / 30 / packets[-1].time_base)
        file.mux(packets)


def picture(width: int, height: int) -> np.ndarray:
    return np.repeat(PATCHES, width // 4, 0)[None].repeat(height, 0) / 255


def patches(pixels: np.ndarray) -> np.ndarray:
    height, width = pixels.shape[:2]
    return np.array([pixels[height // 2, width * (2 * i + 1) // 8] for i in range(4)]).astype(int)


WIDE = picture(128, 96)
CODINGS = {
    "BT.709": (WIDE, {"tags": (1, 1, 1)}),
    "BT.709, 10 bits": (WIDE, {"tags": (1, 1, 1), "bits": 10}),
    "BT.601": (WIDE, {"matrix": "601", "tags": (6, 6, 6)}),
    "BT.601 in HD": (picture(1280, 720), {"matrix": "601", "tags": (6, 6, 6)}),
    "SD without tags": (picture(640, 480), {"matrix": "601"}),
    "HD without tags": (picture(1280, 720), {}),
    "full range": (WIDE, {"tags": (1, 1, 1), "full": True}),
    "VP9": (WIDE, {"tags": (1, 1, 1), "codec": "libvpx-vp9"}),
    "HEVC": (WIDE, {"tags": (1, 1, 1), "codec": "libx265"}),
    "P3": (encode(decode(WIDE) @ TO_P3.T), {"tags": (1, 12, 13), "bits": 10}),
    "HLG": (hlg(decode(WIDE) @ TO_2020.T), {"matrix": "2020", "tags": (9, 9, 18), "bits": 10}),
    "PQ": (pq(decode(WIDE) @ TO_2020.T), {"matrix": "2020", "tags": (9, 9, 16), "bits": 10}),
    "gamma 2.2": (decode(WIDE) ** (1 / 2.2), {"tags": (1, 1, 4), "bits": 10}),
    "gamma 2.8": (decode(WIDE) ** (1 / 2.8), {"tags": (1, 1, 5), "bits": 10}),
    "linear": (decode(WIDE), {"tags": (1, 1, 8), "bits": 10}),
    "linear, primaries not stated": (decode(WIDE), {"tags": (1, 2, 8), "bits": 10}),
    "FCC": (WIDE, {"matrix": "FCC", "tags": (4, 1, 1)}),
    "SMPTE 240M": (WIDE, {"matrix": "240", "tags": (7, 1, 1)}),
}
# matrix, primaries and transfer of ITU-T H.273 that are refused, and what is said
REFUSED = {
    "YCgCo": ((8, 1, 1), "matrix 8 of ITU-T H.273: convert it to BT.709"),
    "derived from primaries": ((12, 1, 1), "matrix 12 of"),
    "ICtCp": ((14, 9, 16), "matrix 14 of"),
    "film's primaries": ((1, 8, 1), "primaries 8 of"),
    "logarithmic": ((1, 1, 9), "transfer 9 of"),
    "cinema": ((1, 10, 17), "primaries 10 and transfer 17 of"),
    "PQ without a matrix": ((2, 9, 16), "no matrix is stated"),
    "Dolby Vision 5": (None, "as in Dolby Vision 5: convert it to BT.709"),
}


@pytest.mark.parametrize("coding", CODINGS)
def test_colors_are_those_of_the_picture(tmp_path, coding):
    codes, options = CODINGS[coding]
    # The MP4 muxer of FFmpeg reads x265's headers past their end and fails at random.
    path = tmp_path / {"libvpx-vp9": "a.webm", "libx265": "a.ts"}.get(options.get("codec"), "a.mp4")
    write(path, codes, times=[0], **options)
    photo = next(read_frames(path)[0])
    np.testing.assert_allclose(patches(photo.pixels), PATCHES, atol=2)
    assert any(f"({coding})" in note for note in photo.notes) == (coding in ("HLG", "PQ"))


@pytest.mark.parametrize("name", REFUSED)
def test_colors_of_kinds_that_are_not_read_are_refused(tmp_path, name):
    tags, says = REFUSED[name]
    write(tmp_path / "a.mp4", WIDE, tags=tags, bits=10, codec="libx264" if tags else "libx265")
    if tags is None:
        (tmp_path / "a.mp4").write_bytes((tmp_path / "a.mp4").read_bytes().replace(b"hev1", b"dvh1"))
    with pytest.raises(UserError, match=rf"a\.mp4 has .*{says}"):
        next(read_frames(tmp_path / "a.mp4")[0])


def test_what_a_clip_states_of_its_colors_may_change(tmp_path):
    parts = ["BT.601", "full range", "HLG", "BT.709, 10 bits"]
    for number, (codes, options) in enumerate(CODINGS[coding] for coding in parts):
        write(tmp_path / f"{number}.h264", codes, **options)
    (tmp_path / "a.h264").write_bytes(b"".join((tmp_path / f"{i}.h264").read_bytes() for i in range(len(parts))))
    frames = list(read_frames(tmp_path / "a.h264")[0])
    np.testing.assert_allclose([patches(frame.pixels) for frame in frames], [PATCHES] * 12, atol=2)
    assert [any("(HLG)" in note for note in frame.notes) for frame in frames] == [False] * 6 + [True] * 3 + [False] * 3


TURNS = [(1, 0, 0, 1), (0, 1, -1, 0), (-1, 0, 0, -1), (0, -1, 1, 0), (-1, 0, 0, 1), (0, 1, 1, 0)]


@pytest.mark.parametrize(("a", "b", "c", "d"), TURNS)
def test_frames_are_turned_and_mirrored_as_displayed_with_square_pixels(tmp_path, a, b, c, d):
    """The display matrix takes a point (x, y) to (a x + c y, b x + d y), up to a shift."""
    write(tmp_path / "a.mp4", np.kron(np.arange(12).reshape(3, 4, 1) / 12, np.ones((32, 32, 3))), tags=(1, 1, 1))
    stored = next(read_frames(tmp_path / "a.mp4")[0]).pixels[16::32, 16::32, 0].astype(int)
    y, x = np.mgrid[:3, :4]
    across, down = a * x + c * y, b * x + d * y
    shown = np.empty((np.ptp(down) + 1, np.ptp(across) + 1), int)
    shown[down - down.min(), across - across.min()] = stored
    data = bytearray((tmp_path / "a.mp4").read_bytes())
    place = data.index(b"tkhd") + 44  # of the matrix in ISO 14496-12, 8.3.2, version 0
    data[place : place + 36] = struct.pack(">9i", a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30)
    (tmp_path / "b.mp4").write_bytes(data)
    assert np.abs(next(read_frames(tmp_path / "b.mp4")[0]).pixels[16::32, 16::32, 0].astype(int) - shown).max() <= 1
    write(tmp_path / "a.mp4", picture(144, 108), tags=(1, 1, 1), aspect=Fraction(4, 3))
    assert next(read_frames(tmp_path / "a.mp4")[0]).pixels.shape == (108, 192, 3)


@pytest.mark.parametrize(
    "times",
    [[*range(30), *range(30, 90, 3), *range(90, 120)], [0, 1, 2, 150, 151], [0, 90, 180, 480, 570],
     [0, 21, 42, 63, 153, 174], [0, 150], [0, 3, 18], range(30), [-45, -30, *range(0, 30, 3), *range(30, 45), 90]],
)  # fmt: skip
@pytest.mark.parametrize(("suffix", "last"), [(".mp4", 1), (".mp4", 90), (".mkv", 1)])
def test_each_frame_is_seen_at_its_time(tmp_path, times, suffix, last):
    times = [time for time in times if time >= 0 or suffix != ".mkv"]  # which has no edit lists
    write(tmp_path / f"a{suffix}", WIDE, times=times, last=last)
    frames, counts, fps = read_frames(tmp_path / f"a{suffix}")
    read, count = list(at_constant_rate(frames, counts)), sum(counts)
    assert len(read) == count
    begins = [i / fps for i, frame in enumerate(read) if i == 0 or frame is not read[i - 1]]
    shown = np.array([time for time in times if time >= 0]) / 30
    np.testing.assert_allclose(begins, shown, atol=0.5 / fps + 1e-3)
    assert count / fps == pytest.approx(shown[-1] + max(last / 30, min(1 / fps, 1)), abs=0.5 / fps)


@pytest.mark.parametrize("start", [0, 1, 5])
def test_interlaced_frames_are_made_whole(tmp_path, start):
    """A bar moves by two pixels from field to field; only frames one after the other show it in both.

    Before `start`, frames are progressive, as the joined header of the first ones says.
    """
    fields = np.zeros((20, 96, 128, 3))
    for i, field in enumerate(fields):
        field[:, 2 * i + 40 : 2 * i + 72] = 0.8
    pairs, parts = list(zip(fields[::2], fields[1::2])), b""
    for name, part in [("", pairs[:start]), ("tff=1", pairs[start:])][start == 0 :]:
        with av.open(str(tmp_path / "a.h264"), "w") as file:
            stream = file.add_stream("libx264", rate=25, options={"crf": "1", "x264-params": name})
            stream.height, stream.width = 96, 128
            for i, (even, odd) in enumerate(part):
                woven = np.where(np.arange(96)[:, None, None] % 2, odd if name else even, even)
                frame = av.VideoFrame.from_ndarray(np.rint(255 * woven).astype(np.uint8), "rgb24")
                frame = frame.reformat(format="yuv420p", interpolation="BICUBIC")
                frame.pts = i
                file.mux(stream.encode(frame))
            file.mux(stream.encode())
        parts += (tmp_path / "a.h264").read_bytes()
    (tmp_path / "a.h264").write_bytes(parts)
    read = [frame.codes[..., 1].astype(int) for frame in read_frames(tmp_path / "a.h264")[0]]
    assert len(read) == 10
    for codes in [*read[:start], *read[start + 1 : -1]]:
        assert np.abs(np.diff(codes[8:-8], axis=0)).max() < 40  # 204 where lines are woven


@pytest.mark.parametrize("is_folder", [False, True])
def test_a_clip_or_a_folder_that_changes_its_size_is_refused(tmp_path, is_folder):
    for name, width, wide in (("a", 128, 16), ("b", 64, 12)):
        write(tmp_path / f"{name}.h264", picture(width, 96))
        Image.new("RGB", (wide, 16), "red").save(tmp_path / f"{name}.png")
    (joined := tmp_path / "c.h264").write_bytes(b"".join((tmp_path / f"{name}.h264").read_bytes() for name in "ab"))
    says = r"b\.png is 12 x 16 pixels, .* before are 16 x 16" if is_folder else "frame 4 is 64 x 96 .* are 128 x 96"
    with pytest.raises(UserError, match=f"{says} pixels: a clip has one"):
        list(read_frames(tmp_path if is_folder else joined)[0])


@pytest.mark.parametrize("fps", [12.5, 24, 30, 50, 60, 120])
def test_a_gif_is_as_long_as_its_movie(tmp_path, fps):
    """Its frames last whole hundredths of a second; their rounding must not add up."""
    frames = (np.full((8, 8, 3), i % 2 * 255, np.uint8) for i in range(int(2 * fps)))
    write_video(tmp_path / "a.gif", frames, fps)
    with Image.open(tmp_path / "a.gif") as movie:
        durations = [movie.info["duration"] for i in range(movie.n_frames) if movie.seek(i) is None]
    assert sum(durations) == 2000 and min(durations) >= 20


def with_tracks(path, *tracks, start=0.0, sound_at=None):
    """Remuxes silent clips, each with its dispositions, from `start` on; sound of two seconds begins at `sound_at`."""
    rate, packets = 44100, []
    wave = 0.5 * np.sin(2 * np.pi * 440 * np.arange(2 * rate) / rate, dtype=np.float32)
    with av.open(str(path), "w") as file:
        for source, disposition in tracks:
            with av.open(str(source)) as silent:
                film = file.add_stream_from_template(silent.streams.video[0])
                film.disposition = disposition
                for packet in silent.demux(video=0):
                    if packet.dts is not None:
                        packet.pts, packet.dts = (t + round(start / packet.time_base) for t in (packet.pts, packet.dts))
                        packet.stream = film
                        packets.append(packet)
        if sound_at is not None:
            audio = file.add_stream("pcm_s16le" if path.suffix == ".mov" else "aac", rate, layout="mono")
            for begin in range(0, len(wave) - 1023, 1024):
                frame = av.AudioFrame.from_ndarray(wave[None, begin : begin + 1024], "fltp", "mono")
                frame.sample_rate, frame.time_base = rate, Fraction(1, rate)
                frame.pts = begin + round(sound_at * rate)
                packets += audio.encode(frame)
            packets += audio.encode()
        for packet in sorted(packets, key=lambda packet: float(packet.dts * packet.time_base)):
            file.mux(packet)


DEFAULT, COVER, NONE = av.stream.Disposition.default, av.stream.Disposition.attached_pic, av.stream.Disposition(0)


@pytest.mark.parametrize(
    ("suffix", "tracks", "shown"),
    [(".mkv", [(128, NONE), (64, DEFAULT)], 64), (".mkv", [(64, DEFAULT), (128, DEFAULT)], 128),
     (".mkv", [(64, DEFAULT), (128, NONE)], 64), (".mp4", [(128, COVER), (64, DEFAULT)], 64),
     (".mp4", [(64, DEFAULT), (128, COVER)], 64), (".mp4", [(128, COVER)], None)],
)  # fmt: skip
def test_the_film_of_a_clip_is_the_one_that_players_show(tmp_path, suffix, tracks, shown):
    for width, disposition in tracks:
        is_cover = disposition == COVER
        write(tmp_path / f"{width}.mov", picture(width, 96), codec="mjpeg" if is_cover else "libx264", full=is_cover,
              times=range(1 if is_cover else 6))  # fmt: skip
    path = tmp_path / f"a{suffix}"
    with_tracks(path, *((tmp_path / f"{width}.mov", disposition) for width, disposition in tracks))
    if shown is None:
        with pytest.raises(UserError, match="holds no film"):
            read_frames(path)
        return
    if tracks[0][1] == COVER:  # the tag with the cover in front of the tracks, as taggers write it
        data = path.read_bytes()
        place, end = (data.index(word) - 4 for word in (b"moov", b"udta"))
        tag = data[end : end + int.from_bytes(data[end : end + 4])]
        path.write_bytes(data[: place + 8] + tag + data[place + 8 : end] + data[end + len(tag) :])
        with av.open(str(path)) as file:
            assert file.streams.video[0].disposition & COVER
    frames, counts, _ = read_frames(path)
    assert [frame.shape for frame in frames] == [(96, shown)] * 6 and sum(counts) == 6


@pytest.mark.parametrize(
    ("suffix", "start", "sound_at"),
    [(".mp4", 0, 0), (".mp4", 1, 0), (".mkv", 10, 10), (".mkv", 10.5, 10), (".mkv", 3, 3.5), (".mp4", 0, 0.5),
     (".mov", 0, 0)],
)  # fmt: skip
def test_the_movie_has_the_sound_of_its_clip(tmp_path, capsys, suffix, start, sound_at):
    """Picture and sound are as far apart as there, the first of both begins at once, and the index stands in front."""
    clip = tmp_path / f"clip{suffix}"
    write(tmp_path / "silent.mp4", WIDE, times=range(60))
    with_tracks(clip, (tmp_path / "silent.mp4", DEFAULT), start=start, sound_at=sound_at)
    for name in ("out.MP4", "out.webm"):
        frames, _, fps = read_frames(clip)
        write_video(tmp_path / name, (frame.pixels for frame in frames), fps, sound=clip)
        with av.open(str(tmp_path / name)) as movie:
            one, rate = movie.streams.audio[0], movie.streams.audio[0].rate
            at = [float(track.start_time * track.time_base) for track in (movie.streams.video[0], one)]
            heard = np.concatenate([frame.to_ndarray()[0] for frame in movie.decode(one)])
            film = movie.streams.video[0].codec_context
            assert [film.color_primaries, film.color_trc, film.colorspace, film.color_range] == [1, 1, 1, 1]
            assert movie.duration / 1e6 == pytest.approx(2 + abs(start - sound_at), abs=0.05)
        assert one.codec_context.codec.canonical_name == ("aac" if name == "out.MP4" else "opus")
        assert at == pytest.approx([start - min(start, sound_at), sound_at - min(start, sound_at)], abs=0.04)
        assert np.abs(np.fft.rfft(heard[rate // 2 : rate // 2 + rate])).argmax() == 440
    assert not capsys.readouterr().err and not list(tmp_path.glob("*-sound*"))
    data = (tmp_path / "out.MP4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat") and b"colrnclx\0\1\0\1\0\1" in data


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".webm", ".avi"])
@pytest.mark.parametrize("kept", [0.6, 0.9])
def test_a_clip_that_is_cut_short_is_refused(tmp_path, monkeypatch, suffix, kept):
    monkeypatch.chdir(tmp_path)
    noise, whole = np.random.default_rng(0).random((96, 128, 3)), Path(f"12:30{suffix}")  # 12 is no protocol
    codec = "libvpx-vp9" if suffix == ".webm" else "libx264"  # with frames out of order, also in AVI
    write(tmp_path / whole, noise, times=range(60), codec=codec, faststart=True)
    assert [LOST in frame.notes for frame in read_frames(whole)[0]] == [False] * 60
    with av.open(str(tmp_path / whole)) as file:
        place = [packet.pos for packet in file.demux(video=0) if packet.size][round(60 * kept)]
    (tmp_path / f"b{suffix}").write_bytes(whole.read_bytes()[: place - (12 if suffix in (".mkv", ".webm") else 0)])
    with pytest.raises(UserError, match=r"is cut short: its file promises .* seconds and holds .*: give the whole"):
        read_frames(tmp_path / f"b{suffix}")


@pytest.mark.parametrize(("lost", "unseen"), [((0, 10), (0, 20)), ((20, 25), (20, 25)), ((50, 60), (50, 60))])
def test_what_cannot_be_decoded_keeps_its_time(tmp_path, lost, unseen):
    """The lost ones hold nothing but filling. Each 20th is a key frame, before the first of which none is seen."""
    write(tmp_path / "a.mkv", WIDE, times=range(60), last=2)
    with av.open(str(tmp_path / "a.mkv")) as file, av.open(str(tmp_path / "b.mkv"), "w") as copy:
        film = copy.add_stream_from_template(file.streams.video[0])
        for number, packet in enumerate(file.demux(video=0)):
            if packet.dts is not None:
                if number in range(*lost):
                    packet.update(struct.pack(">IB", packet.size - 4, 12) + b"\xff" * (packet.size - 5))
                packet.stream = film
                copy.mux(packet)
    frames = list(read_frames(tmp_path / "b.mkv")[0])
    assert len(frames) == 60 and [i for i, frame in enumerate(frames) if LOST in frame.notes] == [*range(*unseen)]


@pytest.mark.parametrize(
    ("delays", "shown"),
    [([0, 0, 0], [100, 100, 100]), ([10, 10], [100, 100]), ([20, 20, 20], [20, 20, 20]),
     ([0, 500, 10], [100, 500, 100]), ([30, 70, 100], [30, 70, 100]), ([100, 100, 0], [100, 100, 100])],
)  # fmt: skip
def test_a_gif_has_the_delays_of_browsers(tmp_path, delays, shown):
    """They show for a tenth of a second what states none, or a hundredth."""
    first, *rest = [Image.fromarray(np.full((16, 16), 40 * i, np.uint8)) for i in range(len(delays))]
    first.save(tmp_path / "a.gif", save_all=True, append_images=rest, duration=20)
    head, *blocks = (tmp_path / "a.gif").read_bytes().split(b"\x21\xf9\x04")
    blocks = [block[:1] + struct.pack("<H", delay // 10) + block[3:] for delay, block in zip(delays, blocks)]
    (tmp_path / "a.gif").write_bytes(b"\x21\xf9\x04".join([head, *blocks]))
    frames, counts, fps = read_frames(tmp_path / "a.gif")
    assert len(list(frames)) == len(delays)
    np.testing.assert_allclose(np.cumsum(counts) / fps, np.cumsum(shown) / 1000, atol=0.5 / fps)


@pytest.mark.skipif(not shutil.which("ffmpeg"), reason="ffmpeg is not installed")
def test_a_clip_that_was_joined_by_cat_is_refused_with_a_command_that_helps(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write("a b.ts", WIDE, times=range(20))
    Path("a b.ts").write_bytes(2 * Path("a b.ts").read_bytes())
    with pytest.raises(UserError, match=r"a b\.ts: its clock jumps back, as where files were joined") as error:
        read_frames(Path("a b.ts"))
    subprocess.run(str(error.value).split("`")[1].replace("ffmpeg", "ffmpeg -v error"), shell=True, check=True)
    frames, shown, fps = read_frames(Path("whole.mp4"))
    assert len(list(frames)) == 40 and sum(shown) / fps == pytest.approx(40 / 30, abs=0.1)
