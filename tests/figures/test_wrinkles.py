"""Fine folds: strain by its closed form, crests across the compression, none where cloth is taut or pinned."""

from dataclasses import replace

import numpy as np

from relight.figures.cut import patterns
from relight.figures.cut.level import Level
from relight.figures.drape import dress, wrinkles
from relight.figures.drape.colliders import Collider, signed_distance
from relight.figures.drape.simulate import DrapeResult
from relight.figures.draw.fabrics import Fabric
from relight.figures.draw.garments import Cloth, Crimp, wardrobe
from relight.figures.surfaces import grid_faces, normals

CRIMP = Crimp(0.024, 0.0, 3.0, 0.08)


def sheet(side=0.5, step=0.0062, columns=None):
    a = np.linspace(-side / 2, side / 2, round(side / step) + 1)
    x, y = np.meshgrid(a if columns is None else columns, a)
    return np.stack([x, y, 0 * x], -1).reshape(-1, 3), grid_faces(*x.shape)[:, ::-1]


def heights(x, crimp=CRIMP, pinned=0.0, seed=4):
    flat, faces = sheet()
    level = Level(flat, flat, flat, np.full(len(flat), pinned), np.zeros((len(flat), 1)), faces)
    return wrinkles.folds([level], [], x, crimp, np.zeros(len(flat)), seed)


def test_stretch_of_an_affine_map_is_exact():
    flat, faces = sheet(0.1)
    rng = np.random.default_rng(0)
    turn, f = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=(3, 2))
    pattern = flat @ turn.T
    tensor, plane = wrinkles.stretch(pattern, flat[:, :2] @ f.T, faces), turn[:, :2]
    np.testing.assert_allclose(tensor, np.broadcast_to(plane @ f.T @ f @ plane.T, tensor.shape), atol=1e-9)
    least, across = wrinkles.principal(tensor, normals(pattern, faces))
    values, vectors = np.linalg.eigh(f.T @ f)
    np.testing.assert_allclose(least, np.sqrt(values[0]), rtol=1e-6)
    np.testing.assert_allclose(np.abs(across @ (plane @ vectors[:, 0])), 1, atol=1e-6)


def test_folds_run_across_the_compression_and_use_up_its_length_and_taut_or_pinned_cloth_has_none():
    flat, _ = sheet()
    n = round(len(flat) ** 0.5)
    h = heights(flat * [0.9, 1.0, 1.0]).reshape(n, n)[10:-10, 10:-10]
    along, across = (np.diff(h, axis=axis) * (n - 1) / 0.5 for axis in (0, 1))
    assert (across**2).mean() > 8 * (along**2).mean()
    longer = (np.sqrt(0.9**2 + across**2) - 0.9).mean()  # than cloth without folds
    assert 0.6 < longer / (wrinkles.SHARES[0] * 0.1) < 1.3
    other = heights(flat * [0.9, 1.0, 1.0], seed=5)
    assert np.corrcoef(other.reshape(n, n)[10:-10, 10:-10].ravel(), h.ravel())[0, 1] < 0.3  # no two are the same
    assert not heights(flat * [1.3, 1.3, 1.0]).any() and not heights(flat * [0.9, 1.0, 1.0], pinned=1.0).any()


def test_finished_keeps_folds_outside_the_layer_below():
    flat, faces = sheet()
    cloth = Cloth(thickness=0.004, crimp=replace(CRIMP, slack=0.1))
    garment = replace(wardrobe()["jeans"], cloth=cloth)  # without a neckline, so no motion is needed
    level = Level(flat, flat, flat, np.zeros(len(flat)), np.zeros((len(flat), 1)), faces)
    pattern = patterns.Pattern(None, garment, [level], [], {"drop": np.zeros(len(flat))}, np.zeros(len(faces), bool))
    below = Collider(flat, flat, faces)
    fabric = Fabric("plain", (0.3, 0.1, 0.05), (0.1, 0.4, 0.7), 1.0, 5)
    x = dress.finished(pattern, DrapeResult(flat + [0, 0, 0.004], [], np.ones(1)), fabric, below, None).positions
    assert x[:, 2].max() > 0.005
    _, distance, _ = signed_distance(x, below, 0.02)
    assert distance.min() > dress.MIN_FOLD_DISTANCE * cloth.thickness - 2e-4
