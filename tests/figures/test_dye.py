"""Fabrics as functions of cloth coordinates, panels as an atlas of them."""

import numpy as np
import pytest

from relight.figures import texture
from relight.figures.cut import patterns
from relight.figures.draw.fabrics import Fabric
from relight.figures.draw.garments import wardrobe
from relight.figures.dye import aging, marks, panels
from relight.figures.dye.prints import emblem
from relight.figures.dye.weaves import WEAVES, Swatch, woven
from relight.figures.surfaces import grid_faces


def test_lattice_is_the_same_everywhere():
    i = np.array([0, 1, -3, 70000])
    known = [0.212093949, 0.283698976, 0.247471035, 0.376442909]
    np.testing.assert_allclose(texture.lattice(i, i[::-1], 7), known, atol=1e-8)
    noise = texture.noise(np.linspace(-5, 5, 100001), np.zeros(100001), 3)
    assert 0 <= noise.min() and noise.max() <= 1
    assert np.abs(np.diff(noise)).max() < 4e-4  # continuous


def test_lay_out_panels_do_not_overlap_and_uv_finds_the_paint():
    rng = np.random.default_rng(2)
    panel = rng.integers(0, 4, 300)
    cloth = rng.uniform(-0.3, 0.5, (300, 1, 2)) + rng.uniform(0, 0.02, (300, 3, 2)) + panel[:, None, None]
    laid, owner = panels.lay_out(["a", "b", "c", "d"], panel, cloth, 256), np.zeros((256, 256), int)
    for _, _, x, y, w, h in laid.boxes.values():
        owner[y : y + h, x : x + w] += 1
    assert owner.max() == 1 and laid.uv.min() >= 0 and laid.uv.max() <= 1

    def color(u, v, k):
        return np.stack([u / 10 + 0.3, v / 10 + 0.3, k / 4 + 0 * u], -1)

    picture = panels.draw(laid, lambda name, u, v, place: color(u, v, "abcd".index(name)))
    at = laid.uv.mean(1)
    seen = picture[(256 * (1 - at[:, 1])).astype(int), (256 * at[:, 0]).astype(int)]
    want = texture.coded(color(*cloth.mean(1).T, panel))
    assert np.abs(seen.astype(int) - want.astype(int)).max() <= 3


@pytest.mark.parametrize("kind", [*sorted(WEAVES), "denim"])
def test_woven_is_uneven_for_each_kind(kind):
    """The scatter of ln albedo between places 2.5 mm apart, which scans of cloth have as well."""
    a = np.arange(240) * 0.0013
    u, v = np.broadcast_arrays(a[None].astype(np.float32), a[:, None].astype(np.float32))
    color = woven(Swatch(Fabric(kind, (0.3, 0.2, 0.15), (0.1, 0.4, 0.7), 1.0, 11), "back", u, v, 0.0013))
    assert color.shape == (240, 240, 3) and np.isfinite(color).all() and color.min() > 0 and color.max() < 1
    log = np.log(color.mean(-1).reshape(120, 2, 120, 2).mean((1, 3)))
    assert np.diff(log, axis=1).std() > 0.03


@pytest.mark.parametrize("name", [name for name, garment in wardrobe().items() if "logo" in garment.fabrics])
def test_emblem_is_on_a_panel_of_each_garment_with_a_logo(body, name):
    names, panel, cloth = panels.cloth_coordinates(patterns.build_pattern(body, wardrobe()[name], 0))
    inside = np.array([(a, b, 8 - a - b) for a in range(9) for b in range(9 - a)]) / 8
    u, v = np.einsum("wk,fkd->dfw", inside, cloth)  # some 4 mm apart
    for seed in range(20):
        fabric = Fabric("logo", (0.3, 0.2, 0.15), (0.1, 0.4, 0.7), 1.0, seed)
        shown = [emblem(fabric, names[k], u[panel == k], v[panel == k], 0.001) for k in np.unique(panel)]
        assert max(np.abs(color - fabric.first).max() for color in shown) > 0.1


def test_images_show_marks_in_the_atlas():
    faces = grid_faces(65, 65)[:, ::-1]
    cloth = np.stack(np.meshgrid(a := np.linspace(0, 0.4, 65), a), -1).reshape(-1, 2)[faces]
    laid = panels.lay_out(["front"], np.zeros(len(faces), int), cloth, 256)
    far = np.abs(cloth[..., 0] - 0.2)
    found = marks.images(laid, {"seam": far, "edge": far / 2, "rub": 0 * far, "bend": 0 * far})
    u0, _, column, row, w, h = laid.boxes[0]
    u = u0 + (np.arange(w) + 0.5 - panels.GUTTER) / laid.scale
    inside = (slice(row + 8, row + h - 8), slice(column + 8, column + w - 8))
    want = np.abs(u - 0.2)[8:-8]
    assert np.abs(found["seam"][inside] - want).max() < 0.003
    assert np.abs(found["edge"][inside] - want / 2).max() < 0.0015


def test_aged_sews_seams_and_hems_and_fades_knees():
    u, v = np.meshgrid(a := np.linspace(0, 0.2, 100, endpoint=False), a)
    far = np.full(u.shape, 0.1)
    at = {"seam": far, "edge": far, "rub": 0 * u, "bend": 0 * u}
    denim = Fabric("denim", (0.03, 0.055, 0.135), (0.5, 0.5, 0.5), 1.0, 5)
    trousers, ground = wardrobe()["jeans"], np.full((100, 100, 3), 0.1)

    def look(**marks):
        return aging.aged(aging.Patch(denim, "front left", u, v, 0.002, trousers, at | marks, ground))

    plain = look().mean()
    assert look(rub=0 * u + 1).mean() > 1.05 * plain and look(seam=0 * u).mean() < 0.85 * plain
    creased = np.log(look(bend=0 * u + 1) / look())[..., 0]
    assert 0.02 < creased.std() < 0.1 and np.abs(np.diff(creased, axis=0)).mean() > 2 * np.abs(np.diff(creased)).mean()
