"""A path-traced capture is imported as what was rendered (needs the `bench` extra)."""

import json

import numpy as np
import pytest
import trimesh

from relight.captures.capture import read_capture
from relight.captures.maps import WHITE_ALBEDO, measure_maps
from relight.config import ROOT
from relight.meshes import Material, Mesh

pytest.importorskip("mitsuba")


@pytest.fixture(scope="module")
def person():
    """A head over a body, which shade each other, of a green that gets brighter upwards."""
    parts = [trimesh.creation.icosphere(4, 0.25), trimesh.creation.icosphere(4, 0.45)]
    parts[0].apply_translation([0, 0.65, 0.1])
    parts[1].vertices *= [0.8, 1.4, 0.6]
    parts[1].apply_translation([0, -0.2, 0])
    whole = trimesh.util.concatenate(parts)
    color = np.clip(0.35 + 0.3 * whole.vertices[:, 1:2], 0.05, 0.9) * [0.6, 1.0, 0.5]
    return Mesh(
        whole.vertices.astype(np.float32),
        whole.faces.astype(np.int32),
        np.zeros((len(whole.faces), 3, 2), np.float32),
        np.zeros(len(whole.faces), np.int16),
        [Material()],
        color=color[whole.faces].astype(np.float32),
        info={"name": "somebody", "subject": "somebody"},
    )


@pytest.fixture(scope="module")
def lightstage():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        import lightstage

        yield lightstage


@pytest.fixture(scope="module")
def traced(person, lightstage, tmp_path_factory):
    """The folder of a matt capture without interreflection, and its true maps."""
    folder = tmp_path_factory.mktemp("captures") / "anna.front"
    return folder, lightstage.write_capture(folder, person, 64, 200, 16, 0, False)


def test_measure_maps_of_path_traced_frames(traced, lightstage):
    folder, baked = traced
    _, maps, _ = measure_maps(read_capture(folder))
    found = lightstage.compare(maps, baked)
    assert found["pixels"] > 500 and found["length"] > 1
    assert found["difference"] < 0.03 and found["shape"] < 0.015 and abs(found["factor"] - 1) < 0.01
    assert found["albedo"] < 0.02 and found["normals"] < 1
    assert np.quantile(maps.albedo[maps.mask].max(1), 0.99) == pytest.approx(WHITE_ALBEDO, rel=0.02)


def test_measure_maps_of_permuted_lamps(traced, lightstage, tmp_path):
    """What the test above would say if positions were mirrored."""
    folder, baked = traced
    index = json.loads((folder / "capture.json").read_text())
    for lamp in index["lamps"]:
        lamp["position"][0] *= -1
    (tmp_path / "capture.json").write_text(json.dumps(index))
    for name in ("frames", "mask.png", "mesh.obj"):
        (tmp_path / name).symlink_to(folder / name)
    _, maps, _ = measure_maps(read_capture(tmp_path))
    assert lightstage.compare(maps, baked)["difference"] > 0.3
