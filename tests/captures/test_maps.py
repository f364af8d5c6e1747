"""Measured maps of captures against formulas, and as figures of a workflow, up to a training."""

import json
import re
import shutil

import capture_twin as twin
import numpy as np
import pytest
from omegaconf import OmegaConf
from PIL import Image
from repo import copy, planned
from scipy.ndimage import binary_erosion

from relight.captures.maps import WHITE_ALBEDO, training_maps
from relight.config import composed
from relight.errors import UserError
from relight.learning.checkpoint import load_network
from relight.maps import PackedMaps, read_info, read_maps
from relight.maps.square import crop_around
from relight.plan import Plan
from relight.sh import basis, sphere_quadrature
from relight.srgb import to_bytes
from relight.stages import capture, pack, split, train

CAMERAS = {"anna.front": 0, "ben.right": 3, "carl.left": 1}
NAMES = tuple(CAMERAS)
SIZE = 64
WORDS = ("scale=smoke", "experiment=one", "figures=olat", "track=none", "train.steps=2", "split.test=0.5")


@pytest.fixture(scope="module")
def olat(tmp_path_factory):
    """Three people; a frame of the last one is missing."""
    folder = tmp_path_factory.mktemp("olat")
    for name, number in CAMERAS.items():
        twin.write_capture(folder, name, number)
    (folder / NAMES[2] / "frames" / "200.png").unlink()
    return folder


@pytest.fixture(scope="module")
def settings(olat):
    return OmegaConf.to_object(composed([*WORDS, f"figures.folder={olat}"]))


@pytest.fixture(scope="module")
def made(tmp_path_factory, settings):
    """Their maps by the stage."""
    folder = tmp_path_factory.mktemp("measured")
    for name in NAMES:
        capture.main(settings.figures, SIZE, name, folder / f"{name}.exr")
    return folder


def true_transport(seen, turn):
    """(H,W,9) of a camera's pixels in its axes, by all directions of a quadrature."""
    total = np.zeros((*seen["mask"].shape, 9))
    point, normal = (seen[name][seen["mask"]] for name in ("point", "normal"))
    for toward, weight in zip(*sphere_quadrature(60)):
        share = (
            weight * np.maximum(normal @ toward, 0) * twin.visible(point, normal, np.broadcast_to(toward, point.shape))
        )
        total[seen["mask"]] += share[:, None] * basis(turn @ toward)
    return total


@pytest.mark.parametrize("name", NAMES[:2])
@pytest.mark.slow
def test_measure_maps_agrees_with_formulas(made, name):
    """On the person's square, whose box fills nine tenths of it as a baked figure does."""
    maps, seen = read_maps(made / f"{name}.exr"), twin.surface(CAMERAS[name])
    assert maps.info["subject"] == name.partition(".")[0] and maps.info["size"] == SIZE and maps.info["order"] == 2
    rows, columns = np.nonzero(maps.mask)
    assert max(np.ptp(rows), np.ptp(columns)) + 1 == pytest.approx(0.9 * SIZE, abs=1.5)
    turn = np.diag([1.0, -1, -1]) @ twin.camera(CAMERAS[name])[0][:, :3]
    box = crop_around(to_bytes(seen["mask"].astype(float)), SIZE)
    share = box.extract(seen["mask"].astype(float))
    assert (maps.mask == (share >= 0.5)).mean() > 0.999
    inner = binary_erosion(maps.mask, iterations=3)

    def expected(values):
        return box.extract(values) / np.maximum(share, 1e-3)[..., None]

    error = (maps.transport - expected(true_transport(seen, turn)))[inner]
    length = np.sort(np.linalg.norm(error, axis=1))[: int(0.99 * len(error))]  # some under the ball are hardly lit
    assert np.sqrt((length**2).mean()) < 0.025  # shadow edges between 331 lamps
    assert np.abs(error.mean(0)).max() < 0.003
    ratio = maps.albedo[maps.mask] / expected(seen["albedo"])[maps.mask]
    assert (np.abs(ratio / np.median(ratio) - 1) < 0.01).mean() > 0.98
    assert maps.albedo[maps.mask].max(1).max() == pytest.approx(WHITE_ALBEDO, rel=0.03)
    normal = expected(seen["normal"] @ turn.T)[inner]
    cosine = (maps.normal[inner] * normal).sum(1) / np.linalg.norm(normal, axis=1)
    assert np.quantile(cosine, 0.02) > 0.999
    assert np.allclose(np.linalg.norm(maps.normal[maps.mask], axis=1), 1, atol=2e-3)


def test_training_reads_measured_maps(made, settings, tmp_path):
    """The one without a frame is left out; a person is on one side of the split."""
    assert "there is no file" in read_info(made / f"{NAMES[2]}.exr")["left_out"]
    (tmp_path / "maps.txt").write_text("\n".join(NAMES))
    pack.main(settings.split, tmp_path / "maps.txt", made, tmp_path / "packed", tmp_path / "record")
    split.main(settings.split, tmp_path / "packed", tmp_path / "record", tmp_path / "split")
    packed = PackedMaps(tmp_path / "packed")
    assert packed.names == packed.figures == list(NAMES[:2]) and packed.subjects == ["anna", "ben"]
    parts = json.loads((tmp_path / "split").read_text())
    assert sorted(parts["train"] + parts["test"]) == list(NAMES[:2]) and len(parts["train"]) == 1
    lights = np.zeros((2, 9, 3), np.float32)
    lights[:, 0] = 1
    np.savez(tmp_path / "lights.npz", coefficients=lights, split=np.array(["train", "test"]), source=np.array("ab"))
    groups = (settings.model, settings.loss, settings.train, settings.augment, settings.track)
    files = (tmp_path / name for name in ("packed", "lights.npz", "split", "run.safetensors", "run.csv"))
    train.main(*groups, *files)
    network, _ = load_network(tmp_path / "run.safetensors")
    assert network.size == SIZE
    assert np.isfinite(float((tmp_path / "run.csv").read_text().splitlines()[-1].split(",")[1]))


@pytest.mark.slow
def test_plan_measures_captures_in_place_of_baking(olat, tmp_path):
    (jobs,) = planned(copy(tmp_path), [*WORDS, f"figures.folder={olat}"])
    assert jobs["capture"] == 3 and jobs["pack"] == jobs["train"] == 1
    assert not {"figure", "scan", "clean", "align", "bake"} & set(jobs)


def refused(words, *more):
    with pytest.raises(UserError, match=words) as caught:
        Plan({"hydra": [*WORDS, *more]}).check()
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_capture_stage_and_plan_refuse(olat, settings, tmp_path):
    folder = f"figures.folder={olat}"
    assert Plan({"hydra": [*WORDS, folder, "figures.only='anna|ben'"]}).figures == list(NAMES[:2])
    refused("figures.source=olat needs figures.folder=<the folder to read>")
    refused(r"holds no PERSON\.VIEW/capture\.json", f"figures.folder={tmp_path}")
    refused(r"whose name matches dora", folder, "figures.only=dora")
    for word, value in (("order", 3), ("bounces", 1), ("views", 2)):
        refused(f"bake.{word} must be .* with figures.source=olat", folder, f"bake.{word}={value}")
    refused("path_traced needs meshes, which figures.source=olat does not make", folder, "experiment=path_traced")
    with pytest.raises(UserError, match=re.escape(f"has no capture dora; it has {', '.join(NAMES)}")):
        capture.main(settings.figures, SIZE, "dora", tmp_path / "out.exr")


def test_training_maps_without_a_mesh_put_the_person_in_a_plane(olat, tmp_path):
    folder = shutil.copytree(olat / "anna.front", tmp_path / "anna.front")
    mesh = folder / "mesh.obj"
    text = mesh.read_text()
    mesh.unlink()
    flat, deep = training_maps(folder, SIZE), training_maps(olat / "anna.front", SIZE)
    assert np.ptp(flat.depth[flat.mask]) < 1 and 100 < np.ptp(deep.depth[deep.mask]) < 2000  # millimetres
    error = np.sqrt(((flat.transport - deep.transport)[flat.mask] ** 2).sum(1).mean())
    assert 0.01 < error < 0.25  # lamps at 2.5 m, a ball of 0.3 m
    mesh.write_text(re.sub(r"(-?\d+\.\d+)", lambda found: f"{float(found[1]) / 1000:.8f}", text))
    with pytest.raises(UserError, match=r"mesh\.obj is not in the picture: it must have the unit and the axes"):
        training_maps(folder, SIZE)


def test_training_maps_depend_on_which_lamp_lit_which_frame(olat, tmp_path):
    """Each frame is taken for the one before: what is tested above would not hold."""
    folder = shutil.copytree(olat / "anna.front", tmp_path / "anna.front")
    index = json.loads((folder / "capture.json").read_text())
    names = [lamp["frame"] for lamp in index["lamps"]]
    for lamp, name in zip(index["lamps"], names[1:] + names[:1]):
        lamp["frame"] = name
    (folder / "capture.json").write_text(json.dumps(index))
    wrong, right = training_maps(folder, SIZE), training_maps(olat / "anna.front", SIZE)
    assert np.sqrt(((wrong.transport - right.transport)[right.mask] ** 2).sum(1).mean()) > 0.5


def test_training_maps_need_light_from_all_sides(olat, tmp_path):
    folder = shutil.copytree(olat / "anna.front", tmp_path / "anna.front")
    index = json.loads((folder / "capture.json").read_text())
    (folder / "capture.json").write_text(json.dumps(index | {"lamps": index["lamps"][:9]}))
    with pytest.raises(UserError, match="light 0% of the person's pixels, and 50% are needed"):
        training_maps(folder, SIZE)
    (folder / "capture.json").write_text(json.dumps(index | {"lamps": index["lamps"][:2]}))
    with pytest.raises(UserError, match="directions do not span a sphere"):
        training_maps(folder, SIZE)
    (folder / "capture.json").write_text(json.dumps(index))
    Image.new("L", (twin.WIDTH, twin.HEIGHT)).save(folder / "mask.png")
    with pytest.raises(UserError, match=r"mask of anna\.front is empty"):
        training_maps(folder, SIZE)
