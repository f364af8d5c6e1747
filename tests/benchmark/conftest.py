"""A set of the benchmark whose pictures are painted ellipsoids: truth in closed form, no figure and no path tracer."""

import numpy as np
import pytest

from relight.benchmark import make as making
from relight.benchmark.lights import panorama
from relight.benchmark.picture import Picture, Settings, crop_maps, crop_window, on_square
from relight.benchmark.shots import variants
from relight.core.srgb import encode, to_bytes
from relight.maps import Maps
from relight.meshes import Mesh
from relight.panoramas import project
from relight.sh import unoccluded

SIZE = 64
SETTINGS = Settings(size=SIZE, samples=1, rays=16, detail="draft", texture=64)


def ellipsoid(seed: int, size: int = SIZE) -> Maps:
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:size, :size]
    x, y = (2 * column + 1) / size - 1, 1 - (2 * row + 1) / size
    u, v = x / rng.uniform(0.4, 0.6), y / 0.9
    mask = u**2 + v**2 < 1
    w = np.sqrt(np.maximum(1 - u**2 - v**2, 0))
    normal = np.stack([u, v, w], -1) / np.maximum(np.hypot(np.hypot(u, v), w), 1e-9)[..., None]
    inside = mask[..., None]
    albedo = (0.4 + 0.2 * np.sign(np.sin(9 * x + rng.uniform(0, 6))))[..., None] * [1.0, 0.8, 0.6]
    maps = {"albedo": albedo * inside, "normal": normal * inside, "ao": (0.4 + 0.6 * w) * mask, "depth": w * mask}
    maps["transport"] = unoccluded(normal) * (0.4 + 0.6 * w)[..., None] * inside
    halved = {name: values.astype(np.float16).astype(np.float32) for name, values in maps.items()}  # as files hold it
    return Maps(mask=mask, coverage=mask.astype(np.float32), info={"order": 2, "size": size}, **halved)


def paint_picture(recipe, mesh, settings) -> Picture:
    """Replaces `relight.benchmark.picture.render_picture`: the truth is that of the formulation."""
    maps = ellipsoid(recipe.seed, settings.size)
    light, *new = (panorama(one, 0.0, 0.7) for one in (recipe.light, *recipe.new))
    coefficients = project(light, 2)
    shading = np.maximum(maps.transport @ coefficients, 0)
    linear = maps.albedo * shading + 0.1 * ~maps.mask[..., None]
    window = crop_window(maps.mask, recipe.cut)
    relit = [to_bytes(encode(maps.albedo * np.maximum(maps.transport @ project(one, 2), 0)))[window] for one in new]
    maps = crop_maps(maps, window)
    shots = variants(lambda gain: to_bytes(encode(linear * gain))[window], to_bytes(maps.coverage), settings.side)
    shots = {name: shot for name, shot in shots.items() if recipe.varied or not name}
    truth = on_square(maps, shading[window], coefficients, shots[""].square)
    return Picture(shots, light, new, maps, np.stack(relit), truth)


def empty_mesh(seed, settings) -> Mesh:
    none = np.zeros((0, 3))
    return Mesh(none, none, none, none, [], info={"name": f"g{seed}", "subject": f"g{seed}"})


@pytest.fixture(scope="session")
def settings():
    return SETTINGS


def paints(patch):
    patch.setattr(making, "import_mitsuba", lambda: None)
    patch.setattr(making, "make_mesh", empty_mesh)
    patch.setattr(making, "render_picture", paint_picture)


@pytest.fixture
def painter(monkeypatch):
    """Makes `make` paint; the function that paints one picture."""
    paints(monkeypatch)
    return paint_picture


@pytest.fixture(scope="session")
def drawn(tmp_path_factory):
    """The folder of a set of three pictures: one in variants, one of half a person."""
    folder = tmp_path_factory.mktemp("benchmark")
    with pytest.MonkeyPatch.context() as patch:
        paints(patch)
        making.make(folder, "report", 3, SETTINGS)
    return folder
