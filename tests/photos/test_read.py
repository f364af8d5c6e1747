import sys
import unicodedata

import numpy as np
import pytest
import tifffile
from PIL import Image
from samples import png_of_size

from relight.core.errors import UserError
from relight.photos.mask.find import read_mask
from relight.photos.mask.people import count_heads, mask_warnings, split_people
from relight.photos.write import write_picture
from relight.pictures.opening import RAW, mask_beside, mask_in
from relight.pictures.picture import Picture

RGB = np.random.default_rng(0).integers(0, 256, (40, 30, 3)).astype(np.uint8)


def truncated(path):
    write_picture(path, np.kron(RGB, np.ones((8, 8, 1), np.uint8 if path.suffix == ".jpg" else np.uint16)))
    path.write_bytes(path.read_bytes()[:4000])


def raw(path):
    tifffile.imwrite(path, RGB, photometric="rgb", extratags=[(50706, "B", 4, bytes([1, 4, 0, 0]), True)])  # DNGVersion


BAD = {
    "deeper.tif": (lambda p: Image.fromarray(RGB[..., 0].astype(np.float32)).save(p), "more than 16 bits"),
    "cmyk.jpg": (lambda p: Image.fromarray(RGB).convert("CMYK").save(p), "CMYK"),
    "cut.jpg": (truncated, "cut short"),
    "cut deep.png": (truncated, "damaged or cut short"),
    "huge.png": (lambda p: p.write_bytes(png_of_size(30_000, 30_000)), "too large"),
    "large.png": (lambda p: p.write_bytes(png_of_size(14_000, 14_000)), "too large: at most 178 million pixels"),
    "bomb.png": (lambda p: p.write_bytes(png_of_size(300_000, 300_000)), "too large"),
    "text.jpg": (lambda p: p.write_text("no picture"), r"is damaged, or no \.jpg that is read here: save it as PNG$"),
    "empty.png": (lambda p: p.write_bytes(b""), "is damaged"),
    "floats.tif": (lambda p: tifffile.imwrite(p, np.ones((20, 20, 3), np.float32)), "or as OpenEXR if it is linear$"),
    "clip.xyz": (lambda p: p.write_bytes(b"clip"), r"give \.jpg, .*exr; a clip for relight movie is \.mp4, .*gif$"),
    "canon.tif": (lambda p: p.write_bytes(b"II*\0\x10\0\0\0CR\2\0"), "is the RAW file of a camera"),
    **{
        name: (raw, "is the RAW file of a camera: develop it first")
        for name in (*(f"a{each}" for each in RAW), "b.tif")
    },
    "speck.png": (lambda p: Image.fromarray(RGB[:4, :4]).save(p), "only 4x4"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_photos_are_one_line(name, tmp_path):
    make, says = BAD[name]
    make(tmp_path / name)
    with pytest.raises(UserError, match=says) as error:
        Picture.of(tmp_path / name)
    assert name in str(error.value) and "\n" not in str(error.value)


def test_a_mask_has_the_size_of_its_photo(tmp_path):
    Image.fromarray(np.pad(np.full((20, 12), 255, np.uint8), ((10, 10), (8, 10)))).save(tmp_path / "l.png")
    for shape, says in (((40, 31), "30x40.*but the photo is 31x40"), ((30, 40), "before its EXIF rotation")):
        with pytest.raises(UserError, match=says):
            read_mask(tmp_path / "l.png", shape)


def test_people_are_split_left_to_right():
    coverage = np.zeros((60, 120), np.uint8)
    coverage[10:50, 70:100] = 255  # the larger, to the right
    coverage[20:50, 10:30] = 255
    coverage[5:8, 98:101] = 255  # a crumb of the right one
    coverage[20:50, 30:33] = 90  # a soft edge of the left one
    left, right = (part for part, _ in split_people(coverage))
    assert np.array_equal(left + right, coverage) and not (left.astype(bool) & right.astype(bool)).any()
    assert left[30, 20] and left[30, 31] == 90 and right[6, 99] == 255
    assert len(split_people(right)) == 1
    with pytest.raises(UserError, match="at least 8 pixels"):
        split_people(np.pad(np.full((3, 3), 255, np.uint8), 10))


def person(height=200, width=160, center=0.5):
    y, x = np.mgrid[:height, :width] / height - np.array([0, center * width / height])[:, None, None]
    head = np.hypot(x / 0.055, (y - 0.12) / 0.075) < 1
    body = (np.abs(x) < 0.11) & (y > 0.19) & (y < 0.55)
    arms = (np.abs(np.abs(x) - 0.11 - (y - 0.2) * 0.5) < 0.028) & (y > 0.2) & (y < 0.5)
    legs = (np.abs(np.abs(x) - 0.055) < 0.045) & (y >= 0.55) & (y < 0.96)
    neck = (np.abs(x) < 0.035) & (y > 0.15) & (y < 0.25)
    return head | body | arms | legs | neck


def said(*masks):
    return " ".join(mask_warnings([mask * np.uint8(255) for mask in masks]))


def test_masks_that_look_wrong():
    alone = person()
    assert said(alone) == ""
    assert "inverted" in said(~alone)
    assert "inverted" in said(~alone[:120, 40:130])  # a portrait, cut at the waist
    assert "inverted" not in said(alone[60:120, 55:115])
    box = np.zeros_like(alone)
    box[20:180, 50:120] = True
    assert "the figure is a rectangle" in said(box)
    pair = person(center=0.35) | person(center=0.65)
    assert count_heads(alone[20:, 20:-20]) == 1 and "several people who touch" in said(pair)
    assert "several people who touch" in said(alone | np.roll(person(center=0.8), 40, 0))  # a smaller one in front
    assert said(person(width=260, center=0.3), person(width=260, center=0.7)) == ""
    assert "cut by the photo's lower edge:" in said(alone[:120])
    assert "photo's left and right edges:" in said(alone[:, 58:-58])
    assert "photo's lower, left and right edges:" in said(alone[:120, 58:-58])
    raised = alone.copy()
    raised[8:60, 48:58] = raised[8:60, 102:112] = True  # arms straight up
    raised[40:60, 48:112] = True
    assert said(raised) == ""


def tiff(path, *pages):
    """A TIFF of pages, each of a NewSubfileType and whether a picture of a sensor is under it."""
    with tifffile.TiffWriter(path) as file:
        for kind, has_more in pages:
            file.write(RGB[::2, ::2].copy(), photometric="rgb", subfiletype=kind, subifds=int(has_more))
            if has_more:
                cells = [(33421, "H", 2, (2, 2), True), (33422, "B", 4, bytes([0, 1, 1, 2]), True)]
                file.write(np.kron(RGB[..., 0], np.ones((9, 9), np.uint16)), photometric="cfa", extratags=cells)


PREVIEWS = {
    "a preview of a sensor's picture": ([(1, True)], "preview of another picture"),
    "two of them": ([(1, True), (1, False)], "preview of another picture"),
    "a preview and a picture": ([(1, True), (0, False)], ""),
    "a picture, and a sensor's": ([(0, True)], ""),
    "a picture that is called reduced": ([(1, False)], ""),
}


@pytest.mark.parametrize("kind", ["photo", "mask", "image"])
@pytest.mark.parametrize("name", PREVIEWS)
def test_a_preview_is_no_picture(tmp_path, name, kind):
    pages, says = PREVIEWS[name]
    tiff(tmp_path / "a.tif", *pages)
    read = (lambda path: read_mask(path, (20, 15))) if kind == "mask" else Picture.of
    given = Image.open(tmp_path / "a.tif") if kind == "image" else tmp_path / "a.tif"
    if says or kind == "mask":
        with pytest.raises(UserError, match=says or "several colors"):
            read(given)
    else:
        np.testing.assert_array_equal(read(given).pixels, RGB[::2, ::2])


@pytest.mark.parametrize("name", ["a.heic", "a.HEIF", "a.jpg", "a.hif"])
def test_heic_needs_its_reader(tmp_path, monkeypatch, name):
    (tmp_path / name).write_bytes(b"....ftypheic")
    monkeypatch.setitem(sys.modules, "pi_heif", None)  # as if it were not installed
    with pytest.raises(UserError, match=r"HEIC, which needs pi-heif.*or save it as JPEG"):
        Picture.of(tmp_path / name)


@pytest.mark.parametrize("form", ["NFC", "NFD"])
@pytest.mark.parametrize("name", ["Zoë", "Ângela Müller", "が", "Å.old", "me", "IMG[1]"])
def test_masks_are_found_however_accents_are_composed(tmp_path, name, form):
    photo, mask = (unicodedata.normalize(each, name) for each in (form, "NFD" if form == "NFC" else "NFC"))
    photo, beside, other = (tmp_path / name for name in (f"{photo}.JPG", f"{mask}_mask.png", f"x{mask}_mask.png"))
    assert mask_beside(photo) is None
    for path in (photo, beside, other):
        path.touch()
    assert mask_beside(photo) == beside
    (folder := tmp_path / "masks").mkdir()
    for path in (folder / other.name, folder / beside.name, folder / f"{mask}.webp"):
        assert mask_in(folder, photo.stem) == (folder / beside.name if path.suffix == ".webp" else None)
        path.touch()
    assert mask_in(folder, photo.stem) == path
