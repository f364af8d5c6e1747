"""Masks that are wrong by pixels come back to the true coverage, and what they relit wrongly before is right."""

import io

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from relight.core.srgb import LINEAR, encode
from relight.photos.mask.edge import fit_edge
from relight.photos.mask.find import masked
from relight.photos.render import estimate_foreground
from relight.pictures.picture import Picture

BLACK_CLOTH, WHITE_CLOTH = (0.010, 0.011, 0.016), (0.9, 0.88, 0.8)
SKY, LAWN = (0.25, 0.45, 0.9), (0.2, 0.4, 0.05)


def composite(figure, behind, size=160):
    """A disc of a color before another one, as sRGB codes with noise; its true coverage, and the distance inward."""
    y, x = np.mgrid[:size, :size] + 0.5 - size / 2
    inward = 0.35 * size - np.hypot(x, y)
    alpha = np.clip(inward + 0.5, 0, 1)[..., None]
    linear = alpha * np.array(figure) + (1 - alpha) * np.array(behind)
    noise = np.random.default_rng(1).normal(0, 1.5, linear.shape)
    codes = (255 * encode(linear) + noise).round().clip(0, 255).astype(np.uint8)
    return codes, alpha[..., 0].astype(np.float32), inward


def soft(inward):
    return np.rint(255 * np.clip(inward + 0.5, 0, 1)).astype(np.uint8)


def masks(inward):
    return {
        "true": soft(inward), "binary": (255 * (inward > 0)).astype(np.uint8),
        "large": soft(inward + 2), "small": soft(inward - 2),
    }  # fmt: skip


def rim_error(values, true, inward):
    return float(np.sqrt(((values - true)[np.abs(inward) < 6] ** 2).mean()))


@pytest.mark.parametrize("colors", [(BLACK_CLOTH, SKY), (WHITE_CLOTH, LAWN), (LAWN, SKY)])
@pytest.mark.parametrize("kind", ["true", "binary", "large", "small"])
def test_fit_edge_finds_the_true_coverage(colors, kind):
    codes, alpha, inward = composite(*colors)
    mask = masks(inward)[kind]
    before = rim_error(mask / 255, alpha, inward)
    after = rim_error(fit_edge(codes, mask, automatic=kind != "binary") / 255, alpha, inward)
    assert after < 0.02
    assert kind == "true" or after < before / 4


def test_where_colors_say_nothing_fit_edge_keeps_a_soft_mask_and_softens_one_of_two_values():
    """To what a lens leaves of the edge."""
    _, alpha, inward = composite(BLACK_CLOTH, SKY)
    large, binary, alpha = soft(inward + 2), masks(inward)["binary"], gaussian_filter(alpha, 0.7)
    grey = np.random.default_rng(2).normal(128, 3, (*large.shape, 3)).astype(np.uint8)
    assert np.abs(fit_edge(grey, large, automatic=True).astype(int) - large).max() < 26
    fitted = fit_edge(np.full((*binary.shape, 3), 128, np.uint8), binary)
    assert rim_error(fitted / 255, alpha, inward) < 0.6 * rim_error(binary / 255, alpha, inward)


def test_fit_edge_keeps_what_is_neither_color():
    """A red strap across the edge, on white cloth before a lawn: its pixels are no mixture of the two."""
    codes, _, inward = composite(WHITE_CLOTH, LAWN)
    codes[78:81, 100:150] = 200, 10, 60
    mask = soft(inward)
    mask[78:81, 100:140] = 255
    fitted = fit_edge(codes, mask, automatic=True)
    assert fitted[79, 128:140].min() > 200 and fitted[79, 141:150].max() < 60


def coded(mask, coder, quality):
    file = io.BytesIO()
    Image.fromarray(mask).save(file, coder, quality=quality)
    return np.asarray(Image.open(file).convert("L"))


@pytest.mark.parametrize(
    "draw",
    [soft, lambda inward: soft(inward + 2), lambda inward: soft(inward / 9),
     lambda inward: np.vstack([soft(inward)[:80], masks(inward)["binary"][80:]]),
     lambda inward: np.rint(0.6 * soft(inward)).astype(np.uint8), lambda inward: coded(soft(inward), "JPEG", 75)],
    ids=["matte", "too large", "wide", "soft hair", "half transparent", "coded"],
)  # fmt: skip
def test_fit_edge_keeps_a_soft_mask_that_is_given(draw):
    codes, _, inward = composite(BLACK_CLOTH, SKY, 320)
    mask = draw(inward)
    np.testing.assert_array_equal(fit_edge(codes, mask), mask)


@pytest.mark.parametrize(("coder", "quality"), [("JPEG", 95), ("JPEG", 75), ("JPEG", 50), ("WEBP", 80)])
def test_fit_edge_fits_two_values_however_they_are_coded(coder, quality):
    codes, alpha, inward = composite(BLACK_CLOTH, SKY, 320)
    mask = coded(masks(inward)["binary"], coder, quality)
    assert len(np.unique(mask)) > 9
    assert rim_error(fit_edge(codes, mask) / 255, alpha, inward) < rim_error(mask / 255, alpha, inward) / 3


@pytest.mark.parametrize("given", ["array", "file", "beside"])
def test_masked_fits_a_mask_of_two_values_and_keeps_a_soft_one(given, tmp_path):
    codes, _, inward = composite(WHITE_CLOTH, LAWN)
    Image.fromarray(codes).save(tmp_path / "me.png")
    large, binary = soft(inward + 1), masks(inward)["binary"]
    for mask, expected in ((large, large), (binary, fit_edge(codes, binary))):
        Image.fromarray(mask).save(tmp_path / "me_mask.png")
        photo = masked(Picture.of(tmp_path / "me.png"), {"array": mask, "file": tmp_path / "me_mask.png"}.get(given))
        np.testing.assert_array_equal(photo.coverage, expected)


@pytest.mark.parametrize("mask", [np.full((40, 40), 255, np.uint8), np.pad(np.full((2, 3), 255, np.uint8), 20)])
def test_fit_edge_without_background_or_inside(mask):
    fitted = fit_edge(np.random.default_rng(3).integers(0, 256, (*mask.shape, 3)).astype(np.uint8), mask)
    assert np.abs(fitted[mask == 255].astype(int) - 255).max() <= 142 and (fitted[0] == mask[0]).all()


def test_estimated_foreground_leaves_no_background_below_black():
    """A mask that takes sky for a white hat: what is split off is no more than is there."""
    codes, _, inward = composite(WHITE_CLOTH, SKY)
    alpha, linear = np.clip(inward / 3 + 1.5, 0, 1).astype(np.float32), LINEAR[codes]
    assert ((alpha > 0) & (alpha < 1)).sum() > 500
    assert (linear - alpha[..., None] * estimate_foreground(linear, alpha)).min() > -1e-5
