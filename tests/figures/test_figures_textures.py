"""Fabrics as functions of cloth coordinates, panels as an atlas of them."""

import numpy as np
import pytest

from relight.figures import fabrics, panels, wardrobe
from relight.figures.fabrics import Fabric
from relight.figures.scarves import SCARVES

LATTICE = [0.212093949, 0.283698976, 0.247471035, 0.376442909]
KINDS = sorted(
    {
        k
        for g in (*wardrobe.TOPS, *wardrobe.OUTER, *wardrobe.BOTTOMS, *wardrobe.SKIRTS, *wardrobe.DRESSES, *SCARVES)
        for k in g.fabrics
    }
)


def grid(side=200, span=0.4):
    a = np.linspace(0, span, side, endpoint=False)
    return np.meshgrid(a, a)


@pytest.mark.parametrize("kind", KINDS)
def test_every_fabric_is_an_albedo_with_something_in_it(kind):
    u, v = grid()
    color = fabrics.weave(Fabric(kind, (0.3, 0.1, 0.05), (0.1, 0.4, 0.7), 1.0, 5), "front", u, v)
    assert color.shape == (200, 200, 3) and np.isfinite(color).all()
    assert color.min() > 0 and color.max() < 1
    assert color.std() > 0.003


def test_stripes_have_their_period_and_share():
    _, v = grid(800, 0.55)
    share = fabrics.band(v, 0.055, 0.42)
    assert share.mean() == pytest.approx(0.42, abs=0.01)
    np.testing.assert_allclose(share[:80], share[80:160], atol=1e-6)


def test_the_hash_is_the_same_everywhere():
    i = np.array([0, 1, -3, 70000])
    np.testing.assert_allclose(fabrics.lattice(i, i[::-1], 7), LATTICE, atol=1e-8)
    noise = fabrics.noise(np.linspace(-5, 5, 100001), np.zeros(100001), 3)
    assert 0 <= noise.min() and noise.max() <= 1
    assert np.abs(np.diff(noise)).max() < 4e-4  # continuous


def test_sampled_fabrics_reach_from_near_black_to_white_and_saturated():
    rng = np.random.default_rng(0)
    first = np.array([fabrics.sample_fabric(rng, ("plain",), False).first for _ in range(400)])
    assert first.min() > 0.01 and first.max() <= 0.82
    assert (first.max(1) < 0.05).any() and (first.min(1) > 0.6).any()
    assert (first[:, 0] > 8 * first[:, 2]).any() and (first[:, 2] > 4 * first[:, 0]).any()  # reds, blues


def test_panels_do_not_overlap_and_uv_finds_the_paint():
    rng = np.random.default_rng(2)
    panel = rng.integers(0, 4, 300)
    cloth = rng.uniform(-0.3, 0.5, (300, 1, 2)) + rng.uniform(0, 0.02, (300, 3, 2)) + panel[:, None, None]
    laid = panels.lay_out(["a", "b", "c", "d"], panel, cloth, 256)
    owner = np.zeros((256, 256), int)
    for _, _, x, y, w, h in laid.boxes.values():
        owner[y : y + h, x : x + w] += 1
    assert owner.max() == 1
    assert laid.uv.min() >= 0 and laid.uv.max() <= 1
    picture = panels.draw(
        laid,
        lambda name, u, v, place: np.stack([u / 10 + 0.3, v / 10 + 0.3, np.full_like(u, "abcd".index(name) / 4)], -1),
    )
    at = laid.uv.mean(1)
    seen = picture[(256 * (1 - at[:, 1])).astype(int), (256 * at[:, 0]).astype(int)]
    middle = cloth.mean(1)
    want = panels.coded(np.stack([middle[:, 0] / 10 + 0.3, middle[:, 1] / 10 + 0.3, panel / 4], -1))
    assert np.abs(seen.astype(int) - want.astype(int)).max() <= 3


def test_srgb_code_points():
    np.testing.assert_array_equal(panels.coded(np.array([0.0, 0.0031308, 0.2140, 1.0])), [0, 10, 127, 255])
