"""Batches against the maps they come from."""

import numpy as np
import pytest
import torch
from scipy.ndimage import binary_erosion

from relight.core.errors import UserError
from relight.learning.color import decode, encode
from relight.learning.data import RelitSet, neighbours, read_split
from relight.maps import PackedMaps

FIGURES, LIGHTS = np.array([3, 0, 4]), np.array([1, 5, 0])


def dense(packed: PackedMaps, figure: int, key: str) -> np.ndarray:
    arrays = packed.figure(figure)
    values = np.asarray(arrays[key], np.float32).reshape(len(arrays["pixel"]), -1)
    out = np.zeros((packed.size**2, values.shape[1]), np.float32)
    out[arrays["pixel"]] = values
    return out.reshape(packed.size, packed.size, -1)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_maps_and_image(tiny_world, order):
    packed = PackedMaps(tiny_world["packed"])
    batch = RelitSet(tiny_world["packed"], tiny_world["lights"], order, "photo").batch(FIGURES, LIGHTS)
    every = np.load(tiny_world["lights"])["coefficients"]  # the picture has all bands, whatever the network's order
    lights = every[:, : (order + 1) ** 2]
    for i, (figure, light) in enumerate(zip(FIGURES, LIGHTS)):
        truth = {key: dense(packed, figure, key) for key in ("transport", "albedo", "normal", "ao")}
        shading = np.clip(truth["transport"] @ every[light], 0, 10)
        truth["transport"] = truth["transport"][..., : (order + 1) ** 2]
        for key, value in truth.items():
            np.testing.assert_array_equal(batch.scatter(getattr(batch, key))[i].permute(1, 2, 0).numpy(), value)
        np.testing.assert_array_equal(batch.light[i].numpy(), lights[light])
        relit = truth["albedo"] * shading
        np.testing.assert_allclose(batch.scatter(batch.relit)[i].permute(1, 2, 0).numpy(), relit, atol=1e-6)
        coded = np.round(encode(torch.tensor(np.clip(relit, 0, 1))).numpy() * 255) / 255
        off = np.abs(batch.image[i].permute(1, 2, 0).numpy() - decode(torch.tensor(coded)).numpy())
        assert off.max() < 0.01 and (off > 1e-5).mean() < 0.001, "a code may differ where rounding decides, hardly ever"
        np.testing.assert_array_equal(batch.mask[i, 0].numpy(), truth["ao"][..., 0] > 0)


def test_color_paper_takes_the_codes_of_albedo_as_linear_and_never_clips(tiny_world):
    photo = RelitSet(tiny_world["packed"], tiny_world["lights"], 2, "photo").batch(FIGURES, LIGHTS)
    data = RelitSet(tiny_world["packed"], tiny_world["lights"], 2, "paper")
    data.lights *= 3
    paper, codes = data.batch(FIGURES, LIGHTS), (encode(photo.albedo) * 255).round() / 255
    torch.testing.assert_close(paper.albedo, codes * photo.inside)
    torch.testing.assert_close(paper.image, paper.scatter(paper.albedo * paper.shading))
    assert paper.image.max() > 1.2


def test_neighbours():
    masks = np.random.default_rng(0).random((4, 12, 12)) > 0.3
    masks[1], masks[2] = False, True  # an image that is all figure has no background to name, and needs none
    masks[1, 5, 5] = True
    pixel = np.concatenate([np.flatnonzero(mask) for mask in masks])
    offset = np.concatenate([[0], np.cumsum(masks.sum((1, 2)))])
    below, interior, outside = neighbours(pixel, offset, 12)
    for i, mask in enumerate(masks):
        own, part = np.flatnonzero(mask), slice(offset[i], offset[i + 1])
        np.testing.assert_array_equal(interior[part], binary_erosion(mask).ravel()[own])
        inner = interior[part]
        np.testing.assert_array_equal(own[below[part]][inner], own[inner] + 12)
        np.testing.assert_array_equal(own[np.flatnonzero(inner) + 1], own[inner] + 1)
        assert mask.all() or not mask.flat[outside[i]]


def test_mirrored_batch_is_the_mirrored_image(tiny_world):
    data = RelitSet(tiny_world["packed"], tiny_world["lights"], 3, "paper")
    plain = data.batch(FIGURES, LIGHTS)
    mixed = data.batch(FIGURES, LIGHTS, mirror=np.array([True, False, True]))
    assert torch.equal(mixed.image[1], plain.image[1]) and torch.equal(mixed.light[1], plain.light[1])
    mirror_x = torch.tensor([-1.0, 1, 1])[:, None, None]
    for i in (0, 2):
        for key in ("image", "mask"):
            torch.testing.assert_close(getattr(mixed, key)[i], getattr(plain, key)[i].flip(-1))
        normals = [batch.scatter(batch.normal)[i] for batch in (plain, mixed)]
        assert torch.equal(mirror_x * normals[1], normals[0].flip(-1))
    # What makes the mirrored truth right: transport of mirrored normals, and light from the mirrored side.
    torch.testing.assert_close(mixed.transport @ mixed.light, plain.transport @ plain.light, atol=1e-5, rtol=1e-4)
    assert torch.equal(mixed.light[0, [3, 4, 7]], -plain.light[0, [3, 4, 7]])
    assert torch.equal(mixed.light[0, [0, 1, 2, 5, 6, 8]], plain.light[0, [0, 1, 2, 5, 6, 8]])


def test_user_errors(tiny_world, tmp_path):
    with pytest.raises(UserError, match=r"up to order 3: model\.order=4 needs bake\.order=4"):
        RelitSet(tiny_world["packed"], tiny_world["lights"], 4, "paper")
    for missing, read in (("npz", lambda path: RelitSet(tiny_world["packed"], path, 2, "paper")), ("json", read_split)):
        with pytest.raises(UserError, match=rf"there is no file .*none\.{missing}"):
            read(tmp_path / f"none.{missing}")
    for text in ("{}", '{"train": "figure0", "test": []}', '{"train": ["figure0"]}'):
        (tmp_path / "split.json").write_text(text)
        with pytest.raises(UserError, match="is not a split of relight"):
            read_split(tmp_path / "split.json")
