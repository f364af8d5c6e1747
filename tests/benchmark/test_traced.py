"""Pictures as the path tracer draws them (needs the `bench` extra)."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import trimesh
from samples import mesh_of

from relight.benchmark import make as making
from relight.benchmark import methods
from relight.benchmark import picture as module
from relight.benchmark.files import BenchmarkSet
from relight.benchmark.lights import Lamplight
from relight.benchmark.methods import BASELINES, true_maps
from relight.benchmark.picture import Settings, render_picture
from relight.benchmark.recipes import draw_recipe
from relight.core.srgb import decode
from relight.meshes import Material
from relight.panoramas import Panorama
from relight.panoramas.radiosity import view_directions
from relight.sh import basis
from relight.transport import View

pytest.importorskip("mitsuba")

SETTINGS = Settings(size=64, samples=64, rays=256)


@pytest.fixture(scope="module")
def person():
    """A head over a body, with a texture that varies slowly: it shades itself."""
    parts = [trimesh.creation.icosphere(4, 0.25), trimesh.creation.icosphere(4, 0.45)]
    parts[0].apply_translation([0, 0.65, 0.1])
    parts[1].vertices *= [0.8, 1.4, 0.6]
    parts[1].apply_translation([0, -0.2, 0])
    whole = trimesh.util.concatenate(parts)
    ramp = np.linspace(90, 230, 64, dtype=np.uint8)
    texture = np.stack([np.tile(ramp, (64, 1)), np.tile(ramp[:, None], (1, 64)), np.full((64, 64), 150, np.uint8)], -1)
    uv = (whole.vertices[whole.faces][..., :2] + 1) / 2
    fields = {"uv": uv.astype(np.float32), "materials": [Material(texture=texture)]}
    return mesh_of(whole.vertices, whole.faces, **fields, info={"name": "somebody", "subject": "somebody"})


def harmonic(light: Lamplight, pitch: float, brightness: float) -> Panorama:
    """A panorama of nine coefficients that is nowhere negative; another for each seed."""
    rng = np.random.default_rng(light.seed)
    coefficients = np.concatenate([np.full((1, 3), 1.2), rng.uniform(-0.25, 0.25, (8, 3))]) * [1.0, 0.9, 0.8]
    pixels = basis(view_directions()) @ coefficients * brightness
    assert pixels.min() > 0
    return Panorama(pixels.reshape(64, 128, 3).astype(np.float32))


@pytest.fixture(scope="module")
def traced(person):
    """A diffuse person in spherical harmonics without interreflection; the first two new lights are one light."""
    recipe = draw_recipe(900_000, 1)
    new = (recipe.new[0], recipe.new[0], *recipe.new[2:])
    recipe = replace(recipe, view=View(30, 10, 40.0), new=new, varied=False, stops=0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "panorama", harmonic)
        patch.setattr(module, "BOUNCES", 0)
        return recipe, render_picture(recipe, person, SETTINGS)


@pytest.fixture(scope="module")
def benchmark(traced, person, tmp_path_factory):
    """The picture in the files of a set."""
    folder, (recipe, drawn) = tmp_path_factory.mktemp("benchmark"), traced
    making.save_picture(folder, recipe.name, person.info["name"], asdict(recipe), drawn)
    making.write_index(folder, "report", [recipe.name], asdict(SETTINGS))
    return BenchmarkSet(folder)


def test_render_picture_true_maps_agree_with_the_tracer(benchmark):
    entry = benchmark.entries[0]
    says = true_maps(benchmark, entry)
    pictures = np.load(benchmark.folder / "truth" / f"{entry.name}.npz")["full"]
    inside = entry.shot().mask == 255
    ours, theirs = (decode(x[:, inside] / 255) for x in (says["full"], pictures))
    noise = (theirs[0] - theirs[1]).std() / np.sqrt(2)  # the same light, other samples
    assert inside.sum() > 500 and 0.001 < noise < 0.02
    for mine, one in zip(ours, theirs):
        assert abs((mine - one).mean()) < 0.005 * one.mean() and (mine - one).std() < 1.2 * noise
    assert (ours[0] - ours[2]).std() > 4 * noise  # another light is another picture
    seen, _ = benchmark.truth(entry)
    assert np.abs((says["shading"] - seen.shading)[seen.mask].mean(0)).max() < 0.01
    assert np.allclose(seen.light, says["light"])


def test_higher_orders_and_exact_irradiance_agree_in_light_of_order_2(benchmark, traced, person, monkeypatch):
    monkeypatch.setattr(methods, "draw_recipes", lambda name: [traced[0]])
    monkeypatch.setattr(methods, "make_mesh", lambda seed, settings: person)
    entry = benchmark.entries[0]
    inside, methods_used = entry.shot().mask == 255, (true_maps, BASELINES["true_maps_4"], BASELINES["exact"])
    second, fourth, traced_again = (method(benchmark, entry) for method in methods_used)
    for name in ("full", "ratio"):
        assert np.abs(second[name].astype(int) - fourth[name])[:, inside].max() <= 1
        ours, theirs = (decode(says[name][:, inside] / 255) for says in (second, traced_again))
        assert np.abs(ours.mean(1) / theirs.mean(1) - 1).max() < 0.01
        assert (ours - theirs).std() < 0.5 * (ours - ours.mean((0, 1))).std()  # noise is less than what is seen
    assert all(np.array_equal(second[name], traced_again[name]) for name in ("albedo", "transport", "light", "shading"))


def test_render_picture_photograph(traced):
    """But for blur, noise and JPEG: in the mean over the figure, and over what is behind it."""
    _, drawn = traced
    shot = drawn.shots[""]
    inside, away, linear = shot.mask == 255, shot.mask == 0, decode(shot.photo / 255)
    expected = drawn.maps.albedo * np.maximum(drawn.maps.transport @ drawn.truth.light, 0)
    assert np.allclose(linear[inside].mean(0), expected[inside].mean(0), rtol=0.03)
    assert 0.001 < (linear - expected)[inside].std() < 0.08
    assert np.allclose(linear[away].mean(0), np.minimum(np.pi * drawn.light.pixels[32, 64], 1), atol=0.15)


def test_render_picture_has_gloss_and_a_bounce(traced, person, monkeypatch):
    recipe, drawn = traced
    monkeypatch.setattr(module, "panorama", harmonic)
    few = replace(SETTINGS, samples=16, rays=16)
    inside = drawn.shots[""].mask == 255
    glossy_person = replace(person, materials=[replace(person.materials[0], roughness=0.5, specular=1.0)])
    bounced = render_picture(recipe, person, few)
    glossy = render_picture(recipe, glossy_person, few)
    levels = [decode(one.relit[:, inside] / 255).mean() for one in (drawn, bounced, glossy)]
    assert levels[1] > 1.002 * levels[0] and levels[2] > 1.1 * levels[1]
    assert bounced.truth.shading[drawn.truth.mask].mean() > drawn.truth.shading[drawn.truth.mask].mean()
    truth = [one.truth for one in (bounced, glossy)]  # gloss is in the pictures alone
    assert all(np.array_equal(*(getattr(one, name) for one in truth)) for name in ("albedo", "shading", "transport"))
