"""Captures become sets: their truth against formulas, their scores, and what is refused."""

import capture_twin
import numpy as np
import pytest
from scipy.ndimage import binary_erosion
from typer.testing import CliRunner

from relight.benchmark.captures import SQUARE_SIZE, UpsampledPanoramas, blur_to_spacing, import_captures
from relight.benchmark.files import BenchmarkSet
from relight.benchmark.methods import answer
from relight.benchmark.score import ABSOLUTE, read_scores, score
from relight.captures.capture import read_capture
from relight.captures.maps import WHITE_ALBEDO
from relight.cli import app
from relight.errors import UserError
from relight.maps import read_maps
from relight.panoramas import Panorama, generate_room, project, read_panorama
from relight.panoramas.lookup import lookup
from relight.panoramas.radiosity import view_directions
from relight.sh import sphere_quadrature
from relight.srgb import encode, to_bytes


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    """Two views of one person."""
    folder = tmp_path_factory.mktemp("captures")
    for name, number in (("anna.front", 0), ("anna.left", 2)):
        capture_twin.write_capture(folder, name, number)
    return folder


@pytest.fixture(scope="module")
def imported(captures, tmp_path_factory):
    """The set of the twin, by the command."""
    folder = tmp_path_factory.mktemp("sets") / "captures"
    result = CliRunner().invoke(app, ["benchmark", "import", str(captures), "-o", str(folder)])
    assert result.exit_code == 0 and f"{folder}: set {BenchmarkSet(folder).hash[:16]}" in result.output, result.output
    return folder


def true_picture(seen, panorama, turn):
    """Of a camera's pixels, by all directions of a quadrature: no lamps, no frames, no mesh. Albedo one."""
    directions, weights = sphere_quadrature(60)
    radiance = lookup(panorama, directions @ turn.T)
    point, normal = seen["point"][seen["mask"]], seen["normal"][seen["mask"]]
    total = np.zeros((len(point), 3))
    for toward, weight, light in zip(directions, weights, radiance):
        facing = np.flatnonzero(normal @ toward > 0)
        free = capture_twin.visible(point[facing], normal[facing], np.broadcast_to(toward, (len(facing), 3)))
        total[facing[free]] += weight * (normal[facing[free]] @ toward)[:, None] * light
    return total


@pytest.mark.slow
def test_import_captures_truth_agrees_with_formulas(captures, imported):
    """Pictures, shading, albedo, normals, transport and light, up to the one factor that no frame tells."""
    benchmark = BenchmarkSet(imported)
    benchmark.verify()
    entry = next(one for one in benchmark.entries if one.name == "anna.front")
    assert not benchmark.scaled and entry.figure == "anna" and entry.side == SQUARE_SIZE and entry.new == 4
    capture = read_capture(captures / "anna.front")
    seen, maps = capture_twin.surface(0), read_maps(benchmark.maps(entry))
    mask, turn = seen["mask"], capture.camera.rotation
    inner = binary_erosion(mask, iterations=2)
    assert np.array_equal(maps.mask, mask) and maps.info["measured"]["lamps"] == 331
    ratio = maps.albedo[inner] / seen["albedo"][inner]
    right = (np.abs(ratio / np.median(ratio) - 1) < 0.01).all(-1)
    assert maps.info["measured"]["known"] > 0.99 and right.mean() > 0.99  # what lamps hardly light is its neighbours'
    assert np.isclose(np.quantile(maps.albedo[mask].max(1), 0.99), WHITE_ALBEDO, rtol=0.02)
    assert (maps.normal[inner] * (seen["normal"][inner] @ turn.T)).sum(1)[right].min() > 0.9995  # half floats
    _, pictures = benchmark.truth(entry)
    for path, picture in zip(entry.panoramas(), pictures):
        expected = np.median(ratio) * seen["albedo"][mask] * true_picture(seen, read_panorama(path), turn)
        codes = to_bytes(encode(expected)).astype(int)
        assert np.abs(picture[mask].astype(int) - codes).mean() < 2
        assert not picture[~mask].any()
    true, _ = benchmark.truth(entry)
    light = read_panorama(imported / "truth" / f"{entry.name}.light.exr")
    assert np.allclose(true.light, project(light, 2), rtol=1e-4, atol=1e-4)
    photo, linear = entry.shot().photo, np.median(ratio) * seen["albedo"][mask] * true_picture(seen, light, turn)
    assert np.abs(photo[mask].astype(int) - to_bytes(encode(linear))).mean() < 2
    behind = photo[~mask].astype(int)
    assert behind.std() > 0 and behind.mean() > 3  # the panorama


def test_score_of_captures_leaves_out_absolute_columns(imported, tmp_path):
    scored = {}
    for method in ("true_maps", "mean_light", "as_it_is"):
        answer(imported, tmp_path / method, method)
        scored[method] = read_scores(score(imported, tmp_path / method).parent)
    for columns in scored.values():
        assert all(np.isnan(columns[name]).all() for name in ABSOLUTE)
    best = scored["true_maps"]
    assert best["albedo_factor"].max() < 0.01 and best["transport"].max() < 0.01 and best["light_factor"].max() < 1e-3
    assert (
        best["full_factor"].mean() < 0.8 * scored["as_it_is"]["ratio_factor"].mean()
    )  # hard shadows, nine coefficients
    assert best["light_factor"].max() < scored["mean_light"]["light_factor"].min()


def test_import_captures_resumes_its_own_set(captures, imported):
    before = {path: path.stat().st_mtime_ns for path in imported.rglob("photo.png")}
    assert import_captures(captures, imported) == BenchmarkSet(imported).hash
    assert before == {path: path.stat().st_mtime_ns for path in imported.rglob("photo.png")}
    varied = {one.name.partition("+")[0] for one in BenchmarkSet(imported).entries if one.of}
    assert varied == {"anna.front"}  # the first of the person
    with pytest.raises(UserError, match="holds another set, or one with other settings"):
        import_captures(captures, imported, "front")


def test_blur_to_spacing_by_band():
    """Band l falls by exp(-l (l + 1) s^2 / 2), where s is .6 of the distance between lamps."""
    pixels = generate_room(3)
    soft, turned = blur_to_spacing(np.stack([pixels, np.roll(pixels, 32, 1)]), 331)
    first, second = (project(Panorama(x.astype(np.float32)), 2) for x in (pixels, soft))
    variance = 0.36 * 4 * np.pi / 331
    assert np.allclose(second[0], first[0], rtol=0.01)
    assert np.allclose(second[4:], first[4:] * np.exp(-3 * variance), atol=0.02 * np.abs(first).max())
    assert np.allclose(turned, np.roll(soft, 32, 1), rtol=1e-6)
    directions = view_directions()
    weight = np.exp((directions @ directions[20 * 128 + 77] - 1) / variance) * np.hypot(*directions.T[[0, 2]])
    assert np.allclose(soft[20, 77], weight @ pixels.reshape(-1, 3) / weight.sum(), rtol=1e-5)


def test_upsampled_panoramas_agree_with_lookup():
    pixels = np.random.default_rng(4).uniform(size=(2, 64, 128, 3)).astype(np.float32)
    soft = blur_to_spacing(pixels, 331).astype(np.float32)
    directions = np.random.default_rng(5).normal(size=(500, 3))
    found = UpsampledPanoramas(soft).radiance(directions / np.linalg.norm(directions, axis=1, keepdims=True))
    expected = np.stack([lookup(Panorama(one), directions) for one in soft], 1)
    assert found.shape == (500, 2, 3) and np.abs(found - expected).max() < 0.02 < expected.std()
