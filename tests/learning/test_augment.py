"""Augmented pictures: truth and picture change together, and each part does what it says."""

import io
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from samples import encoded

from relight.learning.augment import RED_PER_BLUE, _reframed, augment_batch, specular_reflection
from relight.learning.camera import compress_jpeg
from relight.learning.color import photograph
from relight.learning.data import RelitSet
from relight.learning.losses import variation
from relight.sh import basis

ALL = dict(framing=0.9, tint=0.3, exposure=[-1.0, 1.0], recolor=0.5, prints=0.5, gloss=0.7, mask=1, camera=1.0)


@pytest.fixture(scope="module")
def data(world):
    return RelitSet(world["packed"], world["lights"], 2, "photo")


def batch_of(data):
    return data.batch(np.arange(4), np.arange(4))


def generators(count, seed=0):
    return [np.random.default_rng([seed, i]) for i in range(count)]


def test_a_picture_does_not_depend_on_those_beside_it_and_stays_if_nothing_is_asked_for(data, augment):
    batch = batch_of(data)
    assert augment_batch(batch, augment(), generators(4), data.size) is batch
    together = augment_batch(batch_of(data), augment(**ALL), generators(4), data.size)
    again = augment_batch(batch_of(data), augment(**ALL), generators(4), data.size)
    assert torch.equal(together.image, again.image)
    single = augment_batch(data.batch(np.array([3]), np.array([3])), augment(**ALL), generators(4)[3:], data.size)
    torch.testing.assert_close(together.image[3:], single.image, atol=0.01, rtol=0)
    torch.testing.assert_close(together.light[3:], single.light)


def test_truth_still_explains_the_picture_after_framing_tint_recoloring_and_exposure(data, augment):
    settings = augment(**{**ALL, "gloss": 0, "mask": 0, "camera": 0})
    batch = augment_batch(batch_of(data), settings, generators(4), data.size)
    torch.testing.assert_close(batch.relit, batch.albedo * batch.shading)
    seen = photograph(batch.relit * batch.exposure[:, None, None], "photo")
    torch.testing.assert_close(batch.gather(batch.image), seen * batch.inside, atol=0.02, rtol=0)
    assert batch.mask.sum() == batch.inside.sum()
    torch.testing.assert_close(batch.normal.norm(dim=-1, keepdim=True), batch.inside)
    below = (batch.pixel[batch.below] - batch.pixel)[batch.interior.flatten() > 0]
    assert below.unique().tolist() == [data.size], "a row further, in the same picture"


def framed(monkeypatch, cut: float = 0.0, zoom: tuple[float, float] = (1.0, 1.0)) -> None:
    for name, value in {"CUT_SHARE": cut, "ZOOM": zoom, "SHIFT": 0.0}.items():
        monkeypatch.setattr(f"relight.learning.augment.{name}", value)


def test_framing_moves_the_maps_as_an_affine_map_says(data, augment, monkeypatch):
    """A field that is linear over the picture, in the place of the albedo, tells where each pixel came from."""
    batch = batch_of(data)
    row, column = np.mgrid[: data.size, : data.size]
    field = torch.tensor(np.stack([row, column, np.ones_like(row)]), dtype=torch.float32)[None].repeat(4, 1, 1, 1)
    batch = replace(batch, albedo=batch.gather(field))
    framed(monkeypatch, zoom=(0.8, 0.8))
    new = augment_batch(batch, augment(framing=1.0), generators(4), data.size)
    for i in range(4):
        inside = new.interior[i, :, 0] > 0
        pixel = new.pixel.view(4, -1)[i][inside] % data.size**2
        place = torch.stack([pixel // data.size, pixel % data.size], 1).float()
        found = torch.cat([place, torch.ones(len(place), 1)], 1)
        solution = torch.linalg.lstsq(found, new.albedo[i][inside][:, :2]).solution
        torch.testing.assert_close(found @ solution, new.albedo[i][inside][:, :2], atol=0.1, rtol=0)
        before, after = (torch.nonzero(one.mask[i, 0].any(1))[:, 0] for one in (batch, new))
        height = int(before[-1] - before[0]) + 1
        assert float(solution[0, 0]) == pytest.approx(height / (0.9 * 0.8 * data.size), rel=1e-3)
        assert float(after[0] + after[-1] + 1) / 2 == pytest.approx(data.size / 2, abs=1.0)


def test_cut_figures_end_below_and_fill_the_square_again(data, augment, monkeypatch):
    framed(monkeypatch, cut=1.0)
    batch = augment_batch(batch_of(data), augment(framing=1.0), generators(4, seed=3), data.size)
    for mask in batch.mask[:, 0]:
        rows, columns = (torch.nonzero(mask.any(axis))[:, 0].numpy() for axis in (1, 0))
        assert max(np.ptp(rows), np.ptp(columns)) + 1 == pytest.approx(0.9 * data.size, abs=2)
        assert mask[rows[-1]].sum() > 0.25 * mask.sum(1).max(), "a straight edge, not a tip"


def test_a_figure_whose_legs_lie_to_one_side_is_never_cut_away(augment, monkeypatch):
    framed(monkeypatch, cut=1.0)
    mask = torch.zeros(1, 1, 64, 64)
    mask[..., 4:60, 8:14] = mask[..., 56:60, 8:60] = 1  # body at the left, legs on the ground at the right
    for seed in range(200):
        _, inside = _reframed(mask, mask, augment(framing=1.0), generators(1, seed), 64)
        assert inside.sum() > 20


def test_half_the_size_is_the_mean_of_four_pixels(augment):
    maps = torch.rand(1, 2, 16, 16)
    small, mask = _reframed(maps, torch.ones(1, 1, 16, 16), augment(), generators(1), 8)
    torch.testing.assert_close(small[..., 1:], torch.nn.functional.avg_pool2d(maps, 2)[..., 1:])
    assert mask.sum() == 63, "one pixel stays outside for the padding of compact maps"


def test_tint_goes_to_the_light_and_follows_the_white_balance_of_lamps(data, augment):
    batch = batch_of(data)
    new = augment_batch(batch, augment(tint=0.4), generators(4), data.size)
    gains = (new.light / batch.light).mean(1)
    torch.testing.assert_close(new.light, batch.light * gains[:, None])
    torch.testing.assert_close(gains.max(1).values, torch.ones(4))
    red, blue = (gains[:, 0] / gains[:, 1]).log(), (gains[:, 2] / gains[:, 1]).log()
    assert blue.abs().max() > 0.1 and (red - RED_PER_BLUE * blue).abs().max() < 0.3
    torch.testing.assert_close(new.albedo[:, : batch.albedo.shape[1]], batch.albedo[:, : new.albedo.shape[1]])


@pytest.mark.parametrize("seed", range(2))
def test_recolored_albedo_stays_an_albedo_and_keeps_texture(data, seed, augment):
    batch = batch_of(data)
    new = augment_batch(batch, augment(recolor=1.0), generators(4, seed), data.size)
    inside = new.inside[..., 0] > 0
    assert 0.003 < new.albedo[inside].min() and new.albedo[inside].max() < 0.96
    assert (new.light == batch.light).all() and (new.relit == new.albedo * new.shading).all()


def test_prints_change_the_albedo_of_garments_and_nothing_else(data, augment):
    batch = batch_of(data)
    new = augment_batch(batch, augment(prints=1.0), generators(4, 2), data.size)
    for name in ("light", "shading", "transport", "normal"):
        torch.testing.assert_close(getattr(new, name), getattr(batch, name), atol=1e-3, rtol=0)
    torch.testing.assert_close(new.relit, new.albedo * new.shading)
    assert ((new.albedo - batch.albedo).abs().amax((1, 2)) > 0.05).any()
    edges = [variation(one.albedo, one).sum((1, 2)) for one in (batch, new)]
    assert (edges[1] > 1.1 * edges[0]).any(), "a print has edges of its own"
    skin = torch.tensor([0.6, 0.4, 0.3]).expand_as(batch.albedo) * batch.inside
    kept = augment_batch(replace(batch, albedo=skin), augment(prints=1.0, recolor=1.0), generators(4, 2), data.size)
    torch.testing.assert_close(kept.albedo, skin)


def test_gloss_brightens_the_picture_and_leaves_the_truth(data, augment):
    batch = batch_of(data)
    matt = augment_batch(batch, augment(prints=1.0), generators(4), data.size)
    glossy = augment_batch(batch, augment(prints=1.0, gloss=1.0), generators(4), data.size)
    for name in ("albedo", "transport", "light", "shading", "relit"):
        assert torch.equal(getattr(matt, name), getattr(glossy, name)), name
    more = glossy.image - matt.image
    assert more.min() >= 0 and all(one.max() > 0.02 for one in more)


def ggx(normal: np.ndarray, lamp: np.ndarray, roughness: float, reflectance: float) -> float:
    """Reflected radiance over the irradiance of a lamp, as Walter et al. 2007 write it, eqs. 20, 33, 34 (v = +z)."""
    eye, alpha = np.array([0.0, 0.0, 1.0]), roughness**2
    half = (lamp + eye) / np.linalg.norm(lamp + eye)

    def tangent2(direction: np.ndarray) -> float:
        return 1 / (normal @ direction) ** 2 - 1

    d = alpha**2 / (np.pi * (normal @ half) ** 4 * (alpha**2 + tangent2(half)) ** 2)
    one, other = ((np.sqrt(1 + alpha**2 * tangent2(x)) - 1) / 2 for x in (lamp, eye))
    g = 1 / (1 + one + other)  # Heitz 2014, eq. 99: the heights of both directions are one facet's
    f = reflectance + (1 - reflectance) * (1 - eye @ half) ** 5
    return f * g * d / (4 * normal @ eye)


@pytest.mark.parametrize("roughness", [0.25, 0.5, 0.7])
def test_reflection_of_a_lamp_is_that_of_microfacets(roughness):
    lamp = np.array([0.48, 0.6, 0.64])
    light = basis(lamp)[:, None] * np.array([2.0, 1.0, 0.5])  # of irradiance (2, 1, .5) at right angles
    normals = np.random.default_rng(0).normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inputs = [torch.tensor(x, dtype=torch.float64) for x in (normals, light)]
    found, behind = specular_reflection(*inputs, roughness, 0.04).numpy(), normals[:, 2] <= 0
    assert behind.sum() > 50 and not found[behind].any()
    inputs[1][1:] = 0
    found -= specular_reflection(*inputs, roughness, 0.04).numpy()
    dark = normals @ lamp <= 0
    np.testing.assert_allclose(found[dark], 0, atol=1e-12)
    lit = ~behind & ~dark
    expected = [np.pi * ggx(normal, lamp, roughness, 0.04) for normal in normals[lit]]
    np.testing.assert_allclose(found[lit], np.outer(expected, [2.0, 1.0, 0.5]), rtol=1e-9)


def test_reflection_of_light_from_everywhere():
    """A surface that faces the camera reflects its reflectance, one seen along itself all there is."""
    light = torch.zeros(9, 3)
    light[0] = float(np.sqrt(4 * np.pi)) * torch.tensor([1.0, 2.0, 3.0])  # radiance 1, 2, 3
    found = specular_reflection(torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 1e-6]]), light, 0.5, 0.04)
    radiance = torch.tensor([1.0, 2.0, 3.0]) * np.pi
    torch.testing.assert_close(found, torch.stack([0.04 * radiance, radiance]), rtol=1e-4, atol=0)


def test_the_gloss_of_the_maps_is_what_shines(data, augment):
    """What is matt in the maps stays as it is; the rest gets brighter, by the light that its roughness reflects."""
    batch = batch_of(data)
    inside, gloss = batch.inside.bool()[..., 0], torch.zeros(*batch.inside.shape[:2], 2)
    gloss[..., 0] = 0.5
    gloss[:, ::2, 1] = 1.0
    half = (-1.0, -1.0)  # the exposure
    plain = augment_batch(batch, augment(exposure=half), generators(4, 5), data.size)
    shiny = augment_batch(replace(batch, gloss=gloss), augment(gloss=1.0, exposure=half), generators(4, 5), data.size)
    more, matt = batch.gather(shiny.image - plain.image).amax(-1), inside & (gloss[..., 1] == 0)
    assert more[matt].abs().max() < 1e-6 and (more[inside & ~matt] > 0).float().mean() > 0.5
    for name in ("albedo", "shading", "light", "transport"):
        torch.testing.assert_close(getattr(shiny, name), getattr(plain, name))


def test_masks_err_by_a_pixel_at_most_and_the_truth_keeps_to_both(data, augment):
    batch = batch_of(data)
    new = augment_batch(batch, augment(mask=1), generators(4, 5), data.size)
    pool = torch.nn.functional.max_pool2d
    fat, thin = pool(batch.mask, 3, 1, 1), 1 - pool(1 - batch.mask, 3, 1, 1)
    assert (new.mask <= fat).all() and (new.mask >= thin).all() and (new.mask != batch.mask).any()
    assert new.inside.sum() == (new.mask * batch.mask).sum()
    assert ((new.image > 0).any(1, keepdim=True) <= (new.mask > 0)).all()


@pytest.mark.parametrize("quality", [95, 75, 50, 40])
def test_jpeg_is_that_of_a_library(quality):
    """Pillow's codec without chroma subsampling rounds to whole values on the way, which leaves small differences."""
    rng = np.random.default_rng(1)
    smooth = torch.tensor(rng.random((1, 3, 8, 8)), dtype=torch.float32)
    image = torch.nn.functional.interpolate(smooth, (64, 64), mode="bicubic")[0].clamp(0, 1)
    image = (image + 0.03 * torch.tensor(rng.normal(size=(3, 64, 64)), dtype=torch.float32)).clamp(0, 1)
    coded = (image * 255).round() / 255
    pixels = Image.fromarray((coded.permute(1, 2, 0).numpy() * 255).astype(np.uint8))
    file = io.BytesIO(encoded(pixels, "JPEG", quality=quality, subsampling=0))
    expected = torch.tensor(np.asarray(Image.open(file))).permute(2, 0, 1) / 255
    found = compress_jpeg(coded, quality)
    assert (found - expected).abs().mean() < 0.008
    lost, theirs = float((found - coded).abs().mean()), float((expected - coded).abs().mean())
    assert lost == pytest.approx(theirs, rel=0.1)
