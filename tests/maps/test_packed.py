"""The packed set holds what the maps hold, pixel by pixel, in few bytes."""

import numpy as np
import pytest
from safetensors.numpy import load_file
from samples import random_maps

from relight.core.errors import UserError
from relight.core.srgb import encode
from relight.maps import PackedMaps, pack_figures, pack_maps, read_maps, write_left_out, write_maps
from relight.maps.packed import decode_normals, encode_normals


@pytest.fixture
def folder(tmp_path):
    for i, name in enumerate(("a1", "b1", "b2")):
        write_maps(tmp_path / f"{name}.exr", random_maps(name, seed=i))
    write_left_out(tmp_path / "c.exr", {"name": "c"}, "no faces")
    return tmp_path


def test_packed_pixels_are_those_of_the_maps(folder):
    names = pack_maps([folder / f"{name}.exr" for name in ("a1", "c", "b1", "b2")], folder / "packed.safetensors")
    packed = PackedMaps(folder / "packed.safetensors")
    assert names == packed.names == ["a1", "b1", "b2"] and packed.subjects == ["a", "b", "b"]
    assert (len(packed), packed.size, packed.order) == (3, 9, 2)
    whole = packed.arrays()
    for i, name in enumerate(names):
        maps, figure = read_maps(folder / f"{name}.exr"), packed.figure(i)
        np.testing.assert_array_equal(figure["pixel"], np.flatnonzero(maps.mask))
        assert figure["pixel"].dtype == np.int32
        np.testing.assert_array_equal(figure["transport"], maps.transport[maps.mask].astype(np.float16))
        codes = encode(maps.albedo[maps.mask]) * 255
        np.testing.assert_allclose(encode(figure["albedo"].astype(np.float32)) * 255, codes, atol=0.56)  # half a code
        assert figure["albedo"].dtype == np.float16
        np.testing.assert_allclose(figure["ao"], maps.ao[maps.mask], atol=1e-3)
        np.testing.assert_allclose(figure["normal"], maps.normal[maps.mask], atol=2e-3)
        for key, value in figure.items():
            np.testing.assert_array_equal(value, whole[key][whole["offset"][i] : whole["offset"][i + 1]])


def test_maps_that_are_not_square_are_not_packed(folder):
    maps = read_maps(folder / "a1.exr")
    for name in ("transport", "albedo", "normal", "ao", "mask", "depth", "coverage"):
        setattr(maps, name, getattr(maps, name)[:, 2:])
    write_maps(folder / "a1.exr", maps)
    with pytest.raises(UserError, match=r"a1\.exr is 7 x 9 pixels: the maps of a data set are square"):
        pack_maps([folder / "a1.exr"], folder / "packed.safetensors")


def test_the_file_is_plain_safetensors(folder):
    pack_maps([folder / "a1.exr", folder / "b1.exr"], folder / "packed.safetensors")
    arrays = load_file(folder / "packed.safetensors")  # the library's own reader checks the layout
    pixels = int(arrays["offset"][-1])
    shapes = {"transport": (pixels, 9), "albedo": (pixels, 3), "normal": (pixels, 2), "offset": (3,), "mask": (2, 11)}
    assert {key: value.shape for key, value in arrays.items()} == shapes
    per_pixel = sum(arrays[key].nbytes for key in ("transport", "albedo", "normal")) / pixels
    assert per_pixel == 25  # so 345 figures of 150,000 pixels at 1024 px take 1.34e9 bytes with their masks
    assert 345 * (150_000 * per_pixel + 1024**2 / 8) < 1.5e9


def test_gloss_is_packed_and_matt_figures_have_none(folder):
    maps = read_maps(folder / "a1.exr")
    maps.gloss = np.random.default_rng(5).random((9, 9, 2)).astype(np.float32)
    write_maps(folder / "a1.exr", maps)
    pack_maps([folder / "a1.exr", folder / "b1.exr"], folder / "packed.safetensors")
    packed = PackedMaps(folder / "packed.safetensors")
    np.testing.assert_allclose(packed.figure(0)["gloss"], maps.gloss[maps.mask], atol=2.5e-3)  # half a code
    assert (packed.figure(1)["gloss"] == [1, 0]).all()
    assert load_file(folder / "packed.safetensors")["gloss"].nbytes == 2 * packed.offset[-1]


def test_bounces_are_averaged_into_the_transport(tmp_path):
    maps = random_maps("a", bounced=True)
    maps.info["bounces"] = 1
    write_maps(tmp_path / "a.exr", maps)
    pack_maps([tmp_path / "a.exr"], tmp_path / "packed.safetensors")
    expected = (maps.transport + maps.bounced.mean(-1))[maps.mask]
    figure = PackedMaps(tmp_path / "packed.safetensors").figure(0)
    np.testing.assert_allclose(figure["transport"], expected, atol=3e-3)
    np.testing.assert_array_equal(figure["ao"], maps.ao[maps.mask].astype(np.float16))  # of the mesh alone


def test_octahedral_normals():
    normals = np.random.default_rng(0).normal(size=(20000, 3)).astype(np.float32)
    normals = np.concatenate([normals, np.eye(3, dtype=np.float32), -np.eye(3, dtype=np.float32)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    back = decode_normals(encode_normals(normals))
    assert np.abs(np.linalg.norm(back, axis=1) - 1).max() < 1e-6
    assert np.linalg.norm(back - normals, axis=1).max() < 7e-5


def test_different_sizes_too_few_figures_and_other_files_are_refused(folder):
    write_maps(folder / "large.exr", random_maps("large", size=12))
    write_maps(folder / "high.exr", random_maps("high", order=3))
    rows = ("a1 large", "one size: these have 9, 12"), ("a1 high", "one order: these have 2, 3"), ("c", "left out")
    for names, says in rows:
        with pytest.raises(UserError, match=says):
            pack_maps([folder / f"{name}.exr" for name in names.split()], folder / "packed.safetensors")
    with pytest.raises(UserError, match=r"only 1 of 2 .*usable.*; c: no faces"):
        pack_figures([folder / "a1.exr", folder / "c.exr"], 0.5, folder / "packed.safetensors", folder / "record")
    assert not list(folder.glob("*.safetensors")) + list(folder.glob(".*"))
    (folder / "x.safetensors").write_bytes(b"12345678abc")
    for name, says in (("x", "not a packed data set"), ("none", "no file")):
        with pytest.raises(UserError, match=says):
            PackedMaps(folder / f"{name}.safetensors")
    pack_maps([folder / "a1.exr"], folder / "packed.safetensors")
    with pytest.raises(IndexError):
        PackedMaps(folder / "packed.safetensors").figure(1)
