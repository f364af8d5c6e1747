"""Captures of a light stage as figures: measured maps in place of baked ones, on the twin, up to a training."""

import json
import re

import numpy as np
import olat_twin as twin
import pytest
from omegaconf import OmegaConf
from repo import copy, planned
from scipy.ndimage import binary_erosion

from relight.benchmark.captures import WHITE_ALBEDO
from relight.config import composed
from relight.files import UserError
from relight.learning.checkpoint import load_network
from relight.maps import PackedMaps, read_info, read_maps
from relight.photos.crop import crop_around
from relight.sh import basis, sphere_quadrature
from relight.srgb import to_bytes
from relight.stages import capture, pack, split, train
from relight.workflow import Plan

NAMES = ("T001.P00.Cam01", "T002.P00.Cam04", "T003.P00.Cam02")
SIZE = 64
WORDS = ("scale=smoke", "experiment=one", "figures=olat", "track=none", "train.steps=2", "split.test=0.5")


@pytest.fixture(scope="module")
def olat(tmp_path_factory):
    """Three people, the last of whom has too few frames."""
    folder = tmp_path_factory.mktemp("olat")
    for name in NAMES:
        twin.write(folder, (int(name[-1]),), who=name[:4])
    for frame in folder.glob("SUBJECT_T003/POSE_00/images_processed/Cam02/*.0002*.png"):
        frame.unlink()
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
def test_measured_maps_are_those_of_the_formulas(made, name):
    """On the person's square, whose box fills nine tenths of it as a baked figure does."""
    maps, seen = read_maps(made / f"{name}.exr"), twin.surface(int(name[-1]) - 1)
    assert maps.info["subject"] == name[:4] and maps.info["size"] == SIZE and maps.info["order"] == 2
    rows, columns = np.nonzero(maps.mask)
    assert max(np.ptp(rows), np.ptp(columns)) + 1 == pytest.approx(0.9 * SIZE, abs=1.5)
    turn = np.diag([1.0, -1, -1]) @ twin.camera(int(name[-1]) - 1)[0][:, :3]
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


def test_a_training_reads_them(made, settings, tmp_path):
    """The one with too few frames is left out; a person is on one side of the split."""
    assert "holds the frames of" in read_info(made / f"{NAMES[2]}.exr")["left_out"]
    (tmp_path / "maps.txt").write_text("\n".join(NAMES))
    pack.main(settings.split, tmp_path / "maps.txt", made, tmp_path / "packed", tmp_path / "record")
    split.main(settings.split, tmp_path / "packed", tmp_path / "record", tmp_path / "split")
    packed = PackedMaps(tmp_path / "packed")
    assert packed.names == packed.figures == list(NAMES[:2]) and packed.subjects == ["T001", "T002"]
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


def test_the_workflow_measures_in_place_of_baking(olat, tmp_path):
    jobs = planned(copy(tmp_path), *WORDS, f"figures.folder={olat}")
    assert jobs["capture"] == 3 and jobs["pack"] == jobs["train"] == 1
    assert not {"figure", "scan", "clean", "align", "bake"} & set(jobs)


def refused(words, *more):
    with pytest.raises(UserError, match=words) as caught:
        Plan({"hydra": [*WORDS, *more]}).check()
    assert "\n" not in str(caught.value)


def test_what_is_refused(olat, settings, tmp_path):
    folder = f"figures.folder={olat}"
    assert Plan({"hydra": [*WORDS, folder, "figures.only='T00[12]'"]}).figures == list(NAMES[:2])
    refused("figures.source=olat needs figures.folder=<the folder to read>")
    refused(r"holds no SUBJECT_\*/POSE_\*/images_processed/Cam\*", f"figures.folder={tmp_path}")
    refused(r"whose name matches C003", folder, "figures.only=C003")
    for word, value in (("order", 3), ("bounces", 1), ("views", 2)):
        refused(f"bake.{word} must be .* with figures.source=olat", folder, f"bake.{word}={value}")
    refused("path_traced needs meshes, which figures.source=olat does not make", folder, "experiment=path_traced")
    with pytest.raises(UserError, match=re.escape(f"has no capture T009; it has {', '.join(NAMES)}")):
        capture.main(settings.figures, SIZE, "T009", tmp_path / "out.exr")
