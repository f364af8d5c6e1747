"""Captures become sets: their truth against formulas, their scores, and what is refused."""

import csv
import hashlib
import json
import re
import shutil

import numpy as np
import olat_twin as twin
import pytest
from PIL import Image
from scipy.ndimage import binary_erosion
from typer.testing import CliRunner

from relight.benchmark.captures import SQUARE_SIZE, WHITE_ALBEDO, import_captures
from relight.benchmark.files import BenchmarkSet, read_arrays, write_arrays
from relight.benchmark.humanolat import captures
from relight.benchmark.methods import answer, new_lights
from relight.benchmark.score import ABSOLUTE, read_scores, score
from relight.cli import app
from relight.files import UserError
from relight.maps import read_maps
from relight.panoramas import project, read_panorama
from relight.photos.environment import lookup
from relight.sh import sphere_quadrature, unoccluded
from relight.srgb import LINEAR, encode, to_bytes


@pytest.fixture(scope="module")
def brought(humanolat, tmp_path_factory):
    """The set of the twin, by the command."""
    folder = tmp_path_factory.mktemp("sets") / "humanolat"
    says = CliRunner().invoke(
        app, ["benchmark", "import", "humanolat", str(humanolat), "-o", str(folder), "--rays", "64", "--places", "1"]
    )
    assert says.exit_code == 0 and f"{folder}: set {BenchmarkSet(folder).hash[:16]}" in says.output, says.output
    return folder


def true_picture(seen, panorama, turn):
    """Of a camera's pixels, by all directions of a quadrature: no lamps, no frames, no mesh. Albedo one."""
    directions, weights = sphere_quadrature(60)
    radiance = lookup(panorama, directions @ turn.T)
    point, normal = seen["point"][seen["mask"]], seen["normal"][seen["mask"]]
    total = np.zeros((len(point), 3))
    for toward, weight, light in zip(directions, weights, radiance):
        facing = np.flatnonzero(normal @ toward > 0)
        free = twin.visible(point[facing], normal[facing], np.broadcast_to(toward, (len(facing), 3)))
        total[facing[free]] += weight * (normal[facing[free]] @ toward)[:, None] * light
    return total


def test_the_truth_is_that_of_the_formulas(humanolat, brought):
    """Pictures, shading, albedo, normals, transport and light, up to the one factor that no frame tells."""
    benchmark = BenchmarkSet(brought)
    benchmark.verify()
    entry = next(one for one in benchmark.entries if one.name == "T001.P00.Cam01")
    assert not benchmark.scaled and entry.figure == "T001" and entry.side == SQUARE_SIZE and entry.new == 4
    capture = next(captures(humanolat))
    seen, maps = twin.surface(0), read_maps(benchmark.maps(entry))
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
    light = read_panorama(brought / "truth" / f"{entry.name}.light.exr")
    assert np.allclose(true.light, project(light, 2), rtol=1e-4, atol=1e-4)
    photo, linear = entry.shot().photo, np.median(ratio) * seen["albedo"][mask] * true_picture(seen, light, turn)
    assert np.abs(photo[mask].astype(int) - to_bytes(encode(linear))).mean() < 2
    behind = photo[~mask].astype(int)
    assert behind.std() > 0 and behind.mean() > 3  # the panorama


def test_baked_transport_is_set_beside_it(brought):
    with open(brought / "baked.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["picture"] for row in rows] == ["T001.P00.Cam01", "T001.P00.Cam03"]
    for row in rows:
        assert float(row["rest"]) < 0.004 < float(row["difference"]) < 0.04 and float(row["pixels"]) > 300


def test_rows_are_scored_up_to_a_factor(brought, tmp_path):
    scored = {}
    for method in ("true_maps", "mean_light", "as_it_is"):
        answer(brought, tmp_path / method, method)
        scored[method] = read_scores(score(brought, tmp_path / method).parent).columns
    for columns in scored.values():
        assert all(np.isnan(columns[name]).all() for name in ABSOLUTE)
    best = scored["true_maps"]
    assert best["albedo_factor"].max() < 0.01 and best["transport"].max() < 0.01 and best["light_factor"].max() < 1e-3
    assert (
        best["full_factor"].mean() < 0.8 * scored["as_it_is"]["ratio_factor"].mean()
    )  # hard shadows, nine coefficients
    assert best["light_factor"].max() < scored["mean_light"]["light_factor"].min()


def test_an_import_goes_on_and_keeps_to_its_set(humanolat, brought, tmp_path):
    before = {path: path.stat().st_mtime_ns for path in brought.rglob("photo.png")}
    assert import_captures("humanolat", humanolat, brought, rays=64, supersample=1) == BenchmarkSet(brought).hash
    assert before == {path: path.stat().st_mtime_ns for path in brought.rglob("photo.png")}
    varied = {one.name.partition("+")[0] for one in BenchmarkSet(brought).entries if one.of}
    assert varied == {"T001.P00.Cam01"}  # the first of the person
    with pytest.raises(UserError, match="holds another set, or one with other settings"):
        import_captures("humanolat", humanolat, brought, rays=128, supersample=1)
    with pytest.raises(UserError, match="layout goliath: must be humanolat or ultrastage"):
        import_captures("goliath", humanolat, tmp_path)


def test_without_a_mesh_the_person_is_in_a_plane(humanolat, brought, tmp_path):
    copy = shutil.copytree(humanolat, tmp_path / "copy")
    model = copy / "SUBJECT_T001/POSE_00/model/model.obj"
    text = model.read_text()
    model.unlink()
    import_captures("humanolat", copy, tmp_path / "flat", "Cam03")
    (entry,) = (one for one in BenchmarkSet(tmp_path / "flat").entries if not one.of)
    flat, deep = (read_maps(BenchmarkSet(folder).maps(entry)) for folder in (tmp_path / "flat", brought))
    assert not (tmp_path / "flat" / "baked.csv").exists()
    assert np.ptp(flat.depth[flat.mask]) == 0 < np.ptp(deep.depth[deep.mask])
    error = np.sqrt(((flat.transport - deep.transport)[flat.mask] ** 2).sum(1).mean())
    assert 0.01 < error < 0.25  # lamps at 2.5 m, a ball of .3 m
    model.write_text(re.sub(r"(-?\d+\.\d+)", lambda found: f"{float(found[1]) / 1000:.8f}", text))
    with pytest.raises(UserError, match=r"model\.obj is not in the picture of T001\.P00\.Cam03: it must be in mill"):
        import_captures("humanolat", copy, tmp_path / "metres", "Cam03")


GRADIENTS = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, -1]])  # of red, green, blue


@pytest.fixture
def stage(tmp_path):
    """UltraStage's layout: a matt ball in closed form, from two cameras."""
    place = tmp_path / "ultra" / "8fuu"
    size, frames = 96, []
    row, column = np.mgrid[:size, :size]
    x, y = (2 * column + 1) / size - 1, 1 - (2 * row + 1) / size
    radius = 0.8
    mask = np.hypot(x, y) < radius
    own = np.stack([x, y, np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0))], -1) / radius
    for number, angle in ((0, 0.4), (3, 2.0)):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.array([[1, 0, 0], [0, 0.96, -0.28], [0, 0.28, 0.96]])
        frames.append({"file_path": f"./full_on/{number:05d}.jpg", "transform_matrix": np.eye(4).tolist()})
        frames[-1]["transform_matrix"] = np.block([[turn, np.ones((3, 1))], [np.zeros(3), 1]]).tolist()
        normal = own @ turn.T
        albedo = np.where((np.sin(12 * y) > 0)[..., None], [0.6, 0.5, 0.4], [0.3, 0.35, 0.4]) * mask[..., None]
        pictures = {"full_on": albedo}
        for part, sign in (("pos", 1), ("neg", -1)):
            pictures[part] = albedo * (1 + sign * 2 / 3 * normal @ GRADIENTS.T) / 2
        files = {part: to_bytes(encode(linear)) for part, linear in pictures.items()} | {"mask": to_bytes(1.0 * mask)}
        alpha = to_bytes(np.concatenate([(normal * mask[..., None] + 1) / 2, mask[..., None]], -1))
        for part, pixels in (files | {"normal_alpha": alpha}).items():
            (place / part).mkdir(parents=True, exist_ok=True)
            Image.fromarray(pixels).save(place / part / f"{number:05d}.png")
    (place / "transforms.json").write_text(json.dumps({"frames": frames}))
    return tmp_path / "ultra"


def test_gradients_are_new_lights(stage, tmp_path):
    """An answer by the formula, through panoramas in the camera's frame, is the pictures that are there."""
    out, answers = tmp_path / "set", tmp_path / "answers"
    import_captures("ultrastage", stage, out)
    benchmark = BenchmarkSet(out)
    pictures = [entry for entry in benchmark.entries if not entry.of]
    assert [entry.name for entry in pictures] == ["8fuu.00000", "8fuu.00003"]
    for number, entry in enumerate(pictures):
        recipe = json.loads((entry.folder / "picture.json").read_text())["recipe"]
        assert np.array_equal(recipe["gradients"], GRADIENTS) and recipe["fit"] > 0.99
        size = 96
        row, column = np.mgrid[:size, :size]
        x, y = (2 * column + 1) / size - 1, 1 - (2 * row + 1) / size
        own = np.stack([x, y, np.sqrt(np.maximum(0.64 - x**2 - y**2, 0))], -1)
        transport = unoccluded(own / np.maximum(np.linalg.norm(own, axis=-1, keepdims=True), 1e-9))
        true, _ = benchmark.truth(entry)
        shading = transport @ true.light
        shot = entry.shot()
        full = [to_bytes(encode(LINEAR[shot.photo] * (transport @ new) / shading)) for new in new_lights(entry)]
        seal = hashlib.sha256((entry.folder / "photo.png").read_bytes()).hexdigest()
        answers.mkdir(exist_ok=True)
        write_arrays(answers / f"{entry.name}.npz", seal, {"ratio": np.stack(full), "light": 7 * true.light})
        assert set(read_arrays(out / "truth" / f"{entry.name}.npz")) == {"photo", "full", "light"}, number
    columns = read_scores(score(out, answers).parent).columns
    assert columns["ratio_factor"].max() < 0.01 and columns["light_factor"].max() < 1e-6
    with pytest.raises(UserError, match="has no true maps: answer it by --method network or as_it_is"):
        answer(out, tmp_path / "true", "true_maps")


def test_what_is_refused_of_ultrastage(stage, tmp_path):
    place = stage / "8fuu"

    def refused(words, only=""):
        with pytest.raises(UserError, match=words) as caught:
            import_captures("ultrastage", stage, tmp_path / "set", only)
        assert "\n" not in str(caught.value)

    kept = (place / "transforms.json").read_text()
    for text in ("{", '{"frames": [{"file_path": "1"}]}', kept.replace("[[", "[[7, ")):
        (place / "transforms.json").write_text(text)
        refused("`frames` with `file_path` and a rigid `transform_matrix` each are expected")
    (place / "transforms.json").write_text(kept.replace("00003", "00004"))
    refused("has no camera 00003", "3$")
    (place / "transforms.json").write_text(kept)
    shutil.copy(place / "full_on/00000.png", place / "pos/00000.png")
    shutil.copy(place / "full_on/00000.png", place / "neg/00000.png")
    refused("its normals explain 0% of the difference between pos and neg")
    Image.new("RGB", (90, 96)).save(place / "neg/00000.png")
    refused(r"neg/00000\.png is 90x96 pixels and the picture under all lamps 96x96")
    (place / "neg/00000.png").unlink()
    refused("neg: there is no file")
    refused("holds no CAPTURE/full_on/00000.jpg whose name matches 77", "77")
    refused(r"'\(' is not a regular expression", "(")
