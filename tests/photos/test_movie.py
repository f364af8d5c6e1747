import re
from contextlib import nullcontext
from itertools import count
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from relight.core.errors import UserError
from relight.core.srgb import encode
from relight.maps.square import crop_around
from relight.photos import movie
from relight.photos.look import Look
from relight.photos.mask.find import masked
from relight.photos.mask.people import NobodyFound
from relight.photos.movie import NOBODY, smooth_over_time, with_masks, write_movie
from relight.photos.person import Person
from relight.photos.write import write_picture
from relight.pictures.picture import Picture
from relight.pictures.video import is_video, read_frames, write_video


@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".gif"])
def test_written_and_read_back(suffix, tmp_path):
    path = tmp_path / f"a{suffix}"
    colors = [(200, 60, 40), (40, 180, 60), (60, 80, 220), (128, 128, 128), (250, 250, 250)]
    frames = [np.full((49, 65, 3), c, np.uint8) for c in colors]  # odd sizes
    write_video(path, frames, fps=20)
    stream, _, fps = read_frames(path)
    back = [photo.pixels for photo in stream]
    assert len(back) == len(colors) and fps == pytest.approx(20)
    for color, image in zip(colors, back):
        assert np.abs(image.reshape(-1, 3).mean(0) - color).max() < 6, (suffix, color)
        assert image.shape[0] in (49, 50) and image.shape[1] in (65, 66)


def test_a_failed_movie_leaves_the_old_one(tmp_path):
    path = tmp_path / "a.mp4"
    path.write_bytes(b"old")

    def frames():
        yield np.zeros((32, 32, 3), np.uint8)
        raise RuntimeError("out of light")

    with pytest.raises(RuntimeError):
        write_video(path, frames())
    assert path.read_bytes() == b"old" and [p.name for p in tmp_path.iterdir()] == ["a.mp4"]
    with pytest.raises(UserError, match=r"must end in .mp4, .webm or .gif"):
        write_video(tmp_path / "a.flv", frames())
    with pytest.raises(UserError, match="no frames"):
        write_video(path, [])
    (tmp_path / "b.mp4").write_bytes(b"nothing of a movie")
    with pytest.raises(UserError, match="cannot be read as a video"):
        read_frames(tmp_path / "b.mp4")


def saved(folder, pictures, end=".png"):
    """A folder of the files of pictures, which are numbered from 0."""
    folder.mkdir(exist_ok=True)
    for i, pixels in enumerate(pictures):
        Image.fromarray(pixels).save(folder / f"{i}{end}")
    return folder


def turned(scene, look, count):
    return list(scene.turned(look, scene.exposed(look, turning=True), 2 * np.pi * np.arange(count) / count))


@pytest.mark.slow
def test_turning_light_closes_and_keeps_its_exposure(relighter, draw):
    pixels, mask = draw()
    scene = relighter.scene(pixels, mask)
    cover = scene.people[0].coverage
    light, _ = scene.exposed(Look("room:2"), turning=True)
    frames = turned(scene, Look("room:2"), 8)
    assert len(frames) == 8
    assert np.array_equal(frames[0], scene.relit(Look(light, match=False)))
    assert np.abs(frames[2].astype(int) - scene.relit(Look(light, turn=90, match=False))).max() <= 1
    assert np.array_equal(turned(scene, Look("room:2"), 1)[0], frames[0])
    assert all(np.array_equal(f[cover == 0], pixels[cover == 0]) for f in frames)
    # a movie that normalised each frame would show a light of twice the strength alike
    assert turned(scene, Look(2 * light, match=False), 2)[1][mask == 255].mean() > frames[4][mask == 255].mean() + 5


def test_movie_of_a_photo(run, photo_files, weights, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    me, mask_file, _, mask = photo_files
    words = ["movie", me, "--seconds", 0.4, "--size", 64, "--light", "sky:1"]
    words += ["--background", "panorama", "--weights", weights]
    assert "the mask" not in run(*words)
    Image.fromarray(255 - mask).save(mask_file)
    assert "note: the mask may be inverted" in run(*words)
    with av.open(str(tmp_path / "me_relit.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.frames, stream.height, stream.width) == (10, 64, 50)
    with pytest.raises(UserError, match="cannot be transparent"):
        run("movie", me, "--out", tmp_path / "b.mp4", "--background", "transparent")
    for turns in ("nan", "inf", "1e308"):
        with pytest.raises(UserError, match=f"turns is {re.escape(str(float(turns)))}: .* finite number from -1000 to"):
            run("movie", me, "--out", tmp_path / "b.mp4", "--turns", turns)


@pytest.mark.parametrize(("form", "of"), [("behind.mp4", "photo"), ("behind.gif", "clip"), ("behind", "photo")])
def test_a_clip_behind_plays_at_its_speed_and_begins_again(run, photo_files, weights, tmp_path, monkeypatch, form, of):
    """Three greys of a tenth or a 25th of a second each (a folder), behind frames of a 20th or a 25th."""
    me, _, pixels, mask = photo_files
    greys, fps = [40, 120, 200], 25 if form == "behind" else 10
    frames = [np.full((60, 80, 3), grey, np.uint8) for grey in greys]
    saved(tmp_path / "behind", frames)
    if form != "behind":
        write_video(tmp_path / form, frames, fps)
    saved(saved(tmp_path / "clip", 9 * [pixels]), 9 * [mask], "_mask.png")
    shown = []
    monkeypatch.setattr(movie, "write_video", lambda out, frames, *given: shown.extend(frames))
    words = ["--background", tmp_path / form, "--weights", weights, "--fps", 20, "--no-shadow", "--light", "even"]
    run("movie", *([me, "--seconds", 0.45] if of == "photo" else [tmp_path / "clip"]), *words)
    assert len(shown) == 9
    values = [frame[5, -5].mean() for frame in shown]
    steps = [round((n + 1) * 20 / fps) - round(n * 20 / fps) for n in range(12)]
    expected = [greys[n % 3] for n, times in enumerate(steps) for _ in range(times)][:9]
    np.testing.assert_allclose(np.array(values) / values[0], np.array(expected) / 40, rtol=0.1)
    with pytest.raises(UserError, match=rf"{form} is a clip, which is for `relight movie`"):
        run("photo", me, "--background", tmp_path / form, "--weights", weights)


def test_a_gif_of_one_picture_is_a_photo(run, weights, draw, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, image in zip(("me.gif", "me_mask.png"), draw()):
        Image.fromarray(image).save(name)
    run("movie", "me.gif", "--seconds", 0.2, "--size", 64, "--weights", weights)
    assert sum(1 for _ in read_frames(Path("me_relit.mp4"))[0]) == 5
    Image.open("me.gif").save("two.gif", save_all=True, append_images=[Image.open("me_mask.png")])
    with pytest.raises(UserError, match=r"two\.gif is a clip and keeps its length"):
        run("movie", "two.gif", "--seconds", 0.2, "--weights", weights)


@pytest.mark.parametrize("suffix", [".3gp", ".TS", ".m2ts", ".wmv"])
def test_clips_of_phones_and_cameras_are_read(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    with av.open(str(path), "w") as file:
        stream = file.add_stream("wmv2" if suffix == ".wmv" else "libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 96, 96, "yuv420p"
        for i in range(20):
            frame = av.VideoFrame.from_ndarray(np.full((96, 96, 3), 40 + 10 * i, np.uint8), "rgb24")
            file.mux(stream.encode(frame.reformat(format="yuv420p")))
        file.mux(stream.encode())
    assert is_video(path)
    frames, shown, fps = read_frames(path)
    np.testing.assert_allclose([frame.codes[48, 48, 1] for frame in frames], 40 + 10 * np.arange(20.0), atol=6)
    assert shown == [1] * 20 and fps == pytest.approx(25, rel=1e-3)


@pytest.mark.slow
def test_frames_without_a_person_stay_and_a_clip_tells_what_a_photo_does(run, weights, tmp_path, draw, monkeypatch):
    """Also before the first person; without anybody there is no movie."""
    pixels, mask = draw(64, 48)
    saved(tmp_path / "clip", (np.roll(pixels, 9 * i, 1) for i in range(5)))

    def masked_but(empty):
        def found(frame, *_):
            if frame.name in empty:
                raise NobodyFound("nobody")
            return masked(frame, np.roll(mask, 9 * int(frame.name), 1))

        return found

    shown = []

    def write(out, frames, *given):
        shown[:] = frames
        write_video(out, shown, *given)

    monkeypatch.setattr(movie, "write_video", write)
    words = ["movie", tmp_path / "clip", "--weights", weights, "--out", tmp_path / "a.webm"]
    monkeypatch.setattr(movie, "masked", masked_but("02"))
    said = run(*words, "--light", "key:#ffffff@-150,10")
    assert "note: nobody is seen, so nothing is relit (frames: 2)\n" in said
    assert "note: most of this light comes from behind: faces suffer; a turn of 150 brings it to the front (fra" in said
    same = [np.array_equal(frame, np.roll(pixels, 9 * i, 1)) for i, frame in enumerate(shown)]
    assert same == [True, False, True, False, False]
    assert "from behind" not in run(*words, "--light", "key:#ffffff@-150,10", "--turns", 1)
    run(*words, "--background", "#ff0000")
    assert (shown[0] == [255, 0, 0]).all() and (shown[1] != [255, 0, 0]).any()
    monkeypatch.setattr(movie, "masked", masked_but("01234"))
    (tmp_path / "a.webm").unlink()
    with pytest.raises(UserError, match=r"nobody was found in .*clip: give masks"):
        run(*words)
    assert [path.name for path in tmp_path.iterdir()] == ["clip"]


@pytest.mark.slow
def test_movie_of_a_clip(run, weights, tmp_path, draw):
    pixels, mask = draw(64, 48)
    frames, masks = (
        saved(tmp_path / name, (np.roll(each, i, 1) for i in range(5)))
        for name, each in (("frames", pixels), ("masks", mask))
    )
    words = ["movie", frames, "--mask", masks, "--out", tmp_path / "a.webm", "--light", "room:1", "--weights", weights]
    assert re.findall("note: (.{6})", run(*words)) == ["albedo"]  # of the toy network, once
    assert sum(1 for _ in read_frames(tmp_path / "a.webm")[0]) == 5
    beside = tmp_path / "beside"
    beside.mkdir()
    for path in frames.iterdir():
        (beside / path.name).hardlink_to(path)
        (beside / f"{path.stem}_mask.png").hardlink_to(masks / path.name)
    run("movie", beside, "--out", tmp_path / "b.webm", *words[6:])
    pairs = zip(read_frames(tmp_path / "a.webm")[0], read_frames(tmp_path / "b.webm")[0], strict=True)
    assert all(np.array_equal(a.pixels, b.pixels) for a, b in pairs)
    Image.fromarray(255 - mask).save(masks / "2.png")
    assert re.search(r"note: the mask may be inverted.* \(frames: 1\)", run(*words))
    for given, says in (
        ([frames, "--seconds", 3], "is a clip and keeps its length"),
        ([tmp_path / "a.webm"], r"a\.webm would be overwritten"),
    ):
        with pytest.raises(UserError, match=says):
            run("movie", *given, *words[2:])
    (masks / "4.png").unlink()
    with pytest.raises(UserError, match=r"holds no mask of the frame 4\.png"):
        run(*words)
    for i in range(4):
        (masks / f"{i}.png").rename(masks / f"mask {i}.png")  # other names: in their order
    with pytest.raises(UserError, match="holds 4 masks, but the clip has 5 frames"):
        run(*words)


def test_frames_and_masks_are_paired_by_name_and_by_number(tmp_path):
    """Frames without leading zeros; _ sorts after digits, . before them."""
    drawn = [np.where(np.arange(8)[:, None] <= i // 2, np.uint8(255), np.uint8(0)).repeat(8, 1) for i in range(12)]
    saved(tmp_path, (np.full((8, 8, 3), 20 * i, np.uint8) for i in range(12)))
    masks = saved(tmp_path / "masks", [*drawn[:11], 255 - drawn[11]], "_mask.png")
    write_picture(masks / "11.exr", np.dstack([drawn[11] / np.float32(255)] * 3))  # before its .png
    photos = with_masks(tmp_path, read_frames(tmp_path)[0], masks)
    pairs = [(photo.name, int((photo.coverage > 127).sum()) // 8) for photo in photos]
    assert pairs == [(str(i), i // 2 + 1) for i in range(12)]


@pytest.mark.parametrize("masks", ["masks.mp4", "masks"])
def test_masks_of_a_clip_are_fitted_where_they_have_two_values(masks, tmp_path):
    y, x = np.mgrid[:96, :96]
    inward = 30 - np.hypot(x - 48, y - 48)
    alpha = np.clip(inward + 0.5, 0, 1)
    pixels = np.rint(255 * encode(alpha[..., None] * [0.01, 0.01, 0.02] + (1 - alpha[..., None]) * [0.2, 0.4, 0.8]))
    large, soft = ((255 * (inward > -2)).astype(np.uint8), np.rint(255 * np.clip(inward + 2.5, 0, 1)).astype(np.uint8))
    clip = saved(tmp_path / "clip", 2 * [pixels.astype(np.uint8)])
    saved(tmp_path / "masks", (large, soft))
    write_video(tmp_path / "masks.mp4", iter([np.repeat(large[..., None], 3, -1)] * 2), 25)
    first, second = (photo.coverage for photo in with_masks(clip, read_frames(clip)[0], tmp_path / masks))
    assert np.abs(first / 255 - alpha).max() < 0.2
    assert masks == "masks.mp4" or np.array_equal(second, soft)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_mask_video_has_as_many_frames_as_the_clip(tmp_path, count):
    frame = np.full((96, 96, 3), 200, np.uint8)
    frame[30:60, 30:60] = 0
    write_video(tmp_path / "masks.mp4", [200 - frame] * count, 25)
    first, second = Image.fromarray(frame), Image.fromarray(frame // 2)
    first.save(tmp_path / "clip.gif", save_all=True, append_images=[second], duration=[100, 500])  # shown for 6 frames
    masked = with_masks(tmp_path / "clip.gif", read_frames(tmp_path / "clip.gif")[0], tmp_path / "masks.mp4")
    says = pytest.raises(UserError, match=f"holds {count} masks, but the clip has 2 frames")
    with nullcontext() if count == 2 else says:
        assert len(list(masked)) == 2


INSIDE = np.hypot(*np.meshgrid(np.arange(96) - 48, np.arange(96) - 48)) < 30
NOTHING = np.zeros((96, 96, 3), np.uint8)
PERSON = np.where(np.indices((96, 96))[0][..., None] > 50, [70, 60, 100], [215, 160, 130])
PERSON = (PERSON + 30 * np.sin(np.indices((96, 96))[1] / 9)[..., None]).astype(int)
# a frame of a clip of masks, and what is said of it; nothing if it is read
DRAWN = {
    "white": (NOTHING + 255 * INSIDE[..., None], ""),
    "green": (NOTHING + INSIDE[..., None] * [30, 220, 30], ""),
    "empty": (NOTHING, ""),  # in this frame, nobody is seen
    "full": (NOTHING + 255, "covers the whole photo"),
    "yellow": (NOTHING + INSIDE[..., None] * [220, 200, 40], ""),
    "a cut-out on black": (INSIDE[..., None] * PERSON, "has several colors"),
    "an overlay": (np.where(INSIDE[..., None], PERSON // 2 + [20, 60, 127], PERSON - 40), "has several colors"),
    "a person on green": (NOTHING + np.where(INSIDE[..., None], [200, 30, 30], [30, 200, 30]), "several colors"),
    "several people": (NOTHING + 90 * INSIDE[..., None] + 100 * np.roll(INSIDE, 40, 1)[..., None], "as labels have"),
}


@pytest.mark.parametrize("name", DRAWN)
def test_a_clip_of_masks_is_checked_as_a_mask_is(tmp_path, name):
    drawn, says = DRAWN[name]
    write_video(tmp_path / "masks.mp4", [drawn.astype(np.uint8)], 25)
    photo = Picture.of((NOTHING + np.arange(96)[:, None, None] * 2 + 30).astype(np.uint8))
    told = pytest.raises(UserError, match=rf"frame 1 of the clip, mask of .*masks\.mp4: .*{says}")
    with told if says else nullcontext():
        (frame,) = with_masks(tmp_path / "masks.mp4", iter([photo]), tmp_path / "masks.mp4")
        assert ((frame.coverage > 127) != (INSIDE & drawn.any())).mean() < 0.01
        assert (NOBODY in frame.notes) == (name == "empty")


@pytest.mark.parametrize("codec", ["png", "qtrle", "prores_ks", "libvpx-vp9"])
def test_a_clip_that_is_transparent_is_its_own_mask(tmp_path, codec):
    form = {"png": "rgba", "qtrle": "argb", "prores_ks": "yuva444p10le", "libvpx-vp9": "yuva420p"}[codec]
    path = tmp_path / ("a.webm" if codec == "libvpx-vp9" else "a.mov")
    pixels = np.dstack([np.where(INSIDE[..., None], [200, 100, 50], [255, 0, 255]), 255 * INSIDE]).astype(np.uint8)
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 96, 96, form
        file.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgba").reformat(format=form)))
        file.mux(stream.encode())
    frames, *_ = read_frames(path)
    (photo,) = with_masks(path, frames, None)
    assert np.abs(photo.coverage.astype(int) - 255 * INSIDE).max() <= 6
    assert np.abs(photo.pixels[32:64, 32:64].astype(int) - [200, 100, 50]).max() <= 3


def smoothed(coverage, size, infer, count):
    """The people whom `infer` gives one after the other, (image, transport, light), in a clip that stands still."""

    def person(picture, crop):
        image, transport, light = (each.astype(np.float32) for each in infer())
        return Person(crop, coverage, np.ones((size, size), bool), image, image, transport, light)

    pictures = [Picture(np.full((*coverage.shape, 3), 100, np.uint8), coverage=coverage)] * count
    return [scene.people[0] for scene in smooth_over_time(pictures, size, person)]


def test_smoothing_removes_flicker_and_keeps_what_is_still():
    rng, number, coverage = np.random.default_rng(0), count(), np.zeros((40, 40), np.uint8)
    coverage[5:35, 12:28] = 255

    def infer():
        light = 1 + (next(number) >= 20) + rng.normal(0, 0.2, (9, 3))
        return np.full((16, 16, 3), 0.13), 0.5 + rng.normal(0, 0.1, (16, 16, 9)), light

    out = smoothed(coverage, 16, infer, 40)
    assert len(out) == 40
    lights = np.stack([f.light for f in out])
    assert lights[:20].std(0).mean() < 0.06 > lights[20:].std(0).mean()  # of 0.2
    changes = np.abs(np.diff(lights.mean((1, 2))))
    assert changes[:17].max() < 0.02 > changes[22:].max()
    assert abs(lights[18].mean() - 1) < 0.1 > abs(lights[21].mean() - 2)  # a lamp is switched on
    assert np.stack([f.transport for f in out]).std(0).mean() < 0.07  # of 0.1
    assert all(f.crop.side == pytest.approx(crop_around(coverage, 16).side) for f in out)


def test_what_moves_from_frame_to_frame_is_not_smeared():
    values = iter([0.2, 0.9, 0.2, 0.9])
    infer = lambda: (np.full((8, 8, 3), value := next(values)), np.full((8, 8, 9), value), np.ones((9, 3)))  # noqa: E731
    out = [person.transport[0, 0, 0] for person in smoothed(np.full((20, 20), 255, np.uint8), 8, infer, 4)]
    assert np.allclose(out, [0.2, 0.9, 0.2, 0.9], atol=1e-3)


def test_what_is_transparent_is_white_in_a_movie_of_any_size(tmp_path, relighter, draw):
    pixels, mask = draw()
    pixels[mask == 0] = 255, 0, 255
    Image.fromarray(np.dstack([pixels, mask])).save(tmp_path / "me.png")
    notes = write_movie(relighter.network, tmp_path / "me.png", None, tmp_path / "a.gif", Look("key:#ffffff@60,20"),
                        seconds=0.1, size=90)  # fmt: skip
    assert any("what is transparent is white" in note for note in notes)
    small = np.asarray(Image.fromarray(mask).resize((70, 90), Image.Resampling.LANCZOS))
    frame = next(read_frames(tmp_path / "a.gif")[0])
    assert frame.pixels[small == 0].mean() > 250 and (frame.pixels[small == 0] > 200).all()
    assert (frame.pixels[..., [0, 2]].min(-1).astype(int) - frame.pixels[..., 1]).max() < 90  # magenta
