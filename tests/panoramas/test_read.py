import warnings

import numpy as np
import OpenEXR
import pytest
from samples import write_exr
from scipy.ndimage import generic_filter

from relight.core.errors import UserError
from relight.panoramas import list_panoramas, project, read_panorama
from relight.sh import irradiance

SIX = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)


def exr(path, channels, **header):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    OpenEXR.File(header, channels).write(str(path))
    return path


def noise(h=16, w=32, seed=0):
    return np.random.default_rng(seed).random((h, w, 3)).astype(np.float32)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_pixels(tmp_path, dtype):
    pixels = noise().astype(dtype)
    panorama = read_panorama(exr(tmp_path / "a.exr", {"RGB": pixels}))
    np.testing.assert_array_equal(panorama.pixels, pixels.astype(np.float32))
    assert (panorama.layout, panorama.corners, panorama.front, panorama.repairs) == ("latlong", False, "-z", [])


def test_the_envmap_attribute_turns_and_sets_corners(tmp_path):
    """OpenEXR: the centre of a lat-long looks along +z, its right half toward -x; cube faces go +x, -x, +y, ..."""
    latlong = np.full((33, 64, 3), 0.01, np.float32)
    latlong[14:19, 30:34] = 50
    for columns, side in ((0, 4), (16, 1)):
        path = exr(tmp_path / "a.exr", {"RGB": np.roll(latlong, columns, axis=1)}, envmap=OpenEXR.ENVMAP_LATLONG)
        assert irradiance(project(read_panorama(path)), SIX)[:, 0].argmax() == side
    for face in range(6):
        strip = np.full((6 * 9, 9, 3), 0.01, np.float32)
        strip[9 * face + 4, 4] = 50
        panorama = read_panorama(exr(tmp_path / "c.exr", {"RGB": strip}, envmap=OpenEXR.ENVMAP_CUBE))
        assert panorama.corners and irradiance(project(panorama), SIX)[:, 0].argmax() == face


def test_multi_part_reads_the_part_with_color(tmp_path):
    depth = OpenEXR.Part({"name": "depth"}, {"Z": np.ones((16, 32), np.float32)})
    OpenEXR.File([depth, OpenEXR.Part({"name": "color"}, {"RGB": noise()})]).write(str(tmp_path / "a.exr"))
    panorama = read_panorama(tmp_path / "a.exr")
    np.testing.assert_array_equal(panorama.pixels, noise())
    assert panorama.repairs == ["part 1 of 2 was read"]


def test_negatives_are_clipped_and_counted(tmp_path):
    pixels = noise()
    pixels[2, 3] = -1
    panorama = read_panorama(write_exr(tmp_path / "a.exr", pixels))
    assert panorama.repairs == ["1 of 512 pixels had negative values, set to zero"]
    np.testing.assert_array_equal(panorama.pixels, np.maximum(pixels, 0))


def test_repaired_pixels_get_the_mean_of_their_neighbours(tmp_path):
    """Twin: ring by ring, each pixel that touches finite ones, by a filter of nanmean."""
    pixels = noise(40, 80)
    holes = [(0, 0), (5, 79), (20, 40), *((i, j) for i in range(30, 34) for j in range(60, 65))]
    broken = pixels.copy()
    for n, hole in enumerate(holes):
        broken[hole][n % 3] = (np.nan, np.inf, -np.inf)[n % 3]  # one channel is enough
    path = write_exr(tmp_path / "a.exr", broken)
    with pytest.raises(UserError, match=r"23 of 3200 pixels are not finite.*row 0, column 0.*--repair"):
        read_panorama(path)
    mended = read_panorama(path, repair=True)
    expected = np.where(np.isfinite(broken).all(-1, keepdims=True), broken, np.nan).astype(np.float64)
    while (left := np.isnan(expected)).any():
        with warnings.catch_warnings(action="ignore"):  # means of nothing
            means = generic_filter(expected, np.nanmean, (3, 3, 1), mode="constant", cval=np.nan)
        expected[left] = means[left]
    np.testing.assert_allclose(mended.pixels, expected, rtol=1e-5)
    how = "23 of 3200 pixels are not finite numbers; they were replaced by the mean of their neighbours"
    assert mended.repairs == [how]
    assert read_panorama(write_exr(tmp_path / "b.exr", pixels), repair=True).repairs == []
    broken[:, :2] = np.nan
    with pytest.raises(UserError, match="more than 1% cannot be repaired"):
        read_panorama(write_exr(tmp_path / "c.exr", broken), repair=True)


SHAPES = {(32, 64): "latlong", (30, 40): "cross", (40, 30): "cross", (60, 10): "strip", (10, 60): "strip"}


@pytest.mark.parametrize("shape", SHAPES)
def test_the_layout_is_found_by_the_aspect_ratio(tmp_path, shape):
    pixels = noise(*shape)
    if SHAPES[shape] == "cross":
        path = write_exr(tmp_path / "photo.exr", pixels)
        with pytest.raises(UserError, match="its corners are not empty, as in a photo"):
            read_panorama(path)
        assert read_panorama(path, layout="cross").layout == "cross"
        pixels[:10, :10] = pixels[:10, -10:] = 0.5  # grey paper
    assert read_panorama(write_exr(tmp_path / "a.exr", pixels)).layout == SHAPES[shape]


def test_a_square_picture_needs_a_layout(tmp_path):
    path = write_exr(tmp_path / "a.exr", noise(20, 20))
    with pytest.raises(UserError, match=r"light --layout, .*: angular, ball or latlong"):
        read_panorama(path)
    for size in ((1, 2), (1, 64), (64, 1)):  # a lat-long may be squeezed, to one row or column, too
        white = read_panorama(write_exr(tmp_path / "b.exr", np.ones((*size, 3))), layout="latlong")
        np.testing.assert_allclose(project(white, 1)[:, 0], [np.sqrt(4 * np.pi), 0, 0, 0], atol=1e-12)
    for layout in ("angular", "ball", "latlong"):
        assert read_panorama(path, layout=layout).layout == layout
    for layout in ("cross", "strip", "cylinder"):
        with pytest.raises(UserError, match=layout):
            read_panorama(path, layout=layout)


HOSTILE = {
    "empty.hdr": (b"", "empty"),
    "lfs.exr": (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "git-lfs"),
    "page.hdr": (b"\n<!DOCTYPE html><html>", "web page"),
    "png.hdr": (b"\x89PNG\r\n\x1a\n" + bytes(100), "PNG"),
    "jpeg.exr": (b"\xff\xd8\xff\xe0" + bytes(100), "JPEG"),
    "zip.hdr": (b"PK\x03\x04" + bytes(100), "zip"),
    "text.hdr": (b"hello", "not a panorama"),
    "map.exr": (b"PF\n4 2\n-1.0\n" + bytes(96), "save it as .exr"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_files_that_are_no_panoramas_are_named(tmp_path, name):
    content, word = HOSTILE[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=word) as error:
        read_panorama(tmp_path / name)
    assert name in str(error.value)


def test_exr_bombs_and_kinds_that_are_refused(tmp_path):
    # A header that promises 60,000 x 30,000 pixels: patched into a small file, refused before pixels are read.
    small = exr(tmp_path / "a.exr", {"RGB": noise()}).read_bytes()
    window = small.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    bomb = small[:window] + np.array([0, 0, 59999, 29999], "<i4").tobytes() + small[window + 16 :]
    (tmp_path / "bomb.exr").write_bytes(bomb)
    with pytest.raises(UserError, match="8192 x 4096"):
        read_panorama(tmp_path / "bomb.exr")
    chroma = {name: np.ones((4, 8), np.float32) for name in ("Y", "RY", "BY")}
    with pytest.raises(UserError, match="luminance-chroma"):
        read_panorama(exr(tmp_path / "chroma.exr", chroma))


def test_a_damaged_exr_is_one_sentence_and_no_other_part_of_it_is_read(tmp_path, capfd):
    whole = exr(tmp_path / "a.exr", {"RGB": noise(64, 128)}).read_bytes()
    parts = [OpenEXR.Part({"name": name}, {"RGB": noise(64, 128, seed)}) for seed, name in enumerate("ab")]
    OpenEXR.File(parts).write(str(tmp_path / "two.exr"))
    two = (tmp_path / "two.exr").read_bytes()
    assert read_panorama(tmp_path / "two.exr").repairs == ["part 0 of 2 was read"]
    # Two tables of four places each, then the first part's first rows.
    table = next(i for i in range(len(two)) if int.from_bytes(two[i : i + 8], "little") == i + 64)
    first = two[: table + 64] + b"\xff" * 20 + two[table + 84 :]
    for name, content in {"cut": whole[: len(whole) // 2], "half": two[: 2 * len(two) // 3], "first": first}.items():
        (tmp_path / f"{name}.exr").write_bytes(content)
        with pytest.raises(UserError, match=rf"^[^\n]*{name}.exr: cut short or damaged: [^\n]* cannot be read[^\n]*$"):
            read_panorama(tmp_path / f"{name}.exr")
    assert capfd.readouterr() == ("", ""), "the library's noise"


def test_a_folder_lists_panoramas_only(tmp_path):
    for name in ("b.hdr", "a/c.EXR", "a/._c.exr", "__MACOSX/d.hdr", ".cache/e.hdr", "readme.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert list_panoramas(tmp_path) == ["a/c.EXR", "b.hdr"]
    (tmp_path / "nothing").mkdir()
    with pytest.raises(UserError, match="no panorama"):
        list_panoramas(tmp_path / "nothing")


def test_a_sun_that_has_lost_its_red_is_told_and_rebuilt(tmp_path):
    """Its power in blue stays; it becomes as red as the sky around it."""
    sky = np.full((16, 32, 3), [1.4, 1.2, 1.0], np.float32)
    sky[5:8, 10:13] = [0, 0, 300]
    path = write_exr(tmp_path / "a.exr", sky)
    told, rebuilt = read_panorama(path), read_panorama(path, repair=True)
    assert "blue and no red" in told.repairs[0] and np.array_equal(told.pixels, sky)
    assert "9 pixels had lost its red and green" in rebuilt.repairs[0]
    np.testing.assert_allclose(rebuilt.pixels[5:8, 10:13], np.broadcast_to([420, 360, 300], (3, 3, 3)), rtol=1e-5)
    seam = read_panorama(write_exr(path, np.roll(sky, -11, 1)), repair=True)  # a sun on both edges
    np.testing.assert_allclose(seam.pixels, np.roll(rebuilt.pixels, -11, 1), rtol=1e-6)
    sky[5:8, 10:13] = 1.4, 1.2, 1.0
    assert np.array_equal(np.delete(rebuilt.pixels, np.s_[5:8], 0), np.delete(sky, np.s_[5:8], 0))
    sky[5:8, 10:13] = [300, 0, 0]  # a red lamp
    assert read_panorama(write_exr(path, sky)).repairs == []
    for surroundings in ([0, 0, 0], [0, 0, 1]):  # a blue lamp in the dark, and blue light alone
        sky[:], sky[5:8, 10:13] = surroundings, [0, 0, 300]
        found = read_panorama(write_exr(path, sky), repair=True)
        assert found.repairs == [] and np.array_equal(found.pixels, sky)
