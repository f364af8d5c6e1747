"""Views of figures through the workflow: baked beside the frontal view, packed, dealt with their figure, trained on."""

import json
from dataclasses import replace

import numpy as np
import pytest
from omegaconf import OmegaConf
from people import person
from samples import mesh_of

from relight.core.errors import UserError
from relight.evaluation.scoring.evaluate import select_pairs
from relight.lab.plan import Plan
from relight.lab.record import compose_run
from relight.learning.data import RelitSet
from relight.learning.split import write_split
from relight.learning.train import select_training_data
from relight.maps import PackedMaps, pack_figures, read_info, read_maps
from relight.meshes import Material, align
from relight.meshes.left_out import left_out
from relight.settings import composed
from relight.transport import random_view
from relight.transport.figure import bake_figure

FIGURES = ("ann", "bob", "eve")


@pytest.fixture(scope="module")
def settings():
    return OmegaConf.to_object(composed(["scale=smoke", "bake.views=2", "bake.rays=4", "figures.count=1"]))


@pytest.fixture(scope="module")
def made(tmp_path_factory, settings):
    """Three figures of which the third is left out, baked from the front and from two other sides, packed and dealt."""
    folder = tmp_path_factory.mktemp("views")
    (folder / "maps").mkdir()
    for seed, name in enumerate(FIGURES):
        body = person(seed)
        info = {"name": name, "axes": {"up": "+y", "front": "+z"}, **({"subject": "annie"} if name == "ann" else {})}
        mesh = mesh_of(body.vertices, body.faces, info=info)
        if name == "bob":  # has another outfit
            mesh.outfits, mesh.info["outfits"] = [{0: Material(np.array([0.5, 0.2, 0.1], np.float32))}], [[], ["plain"]]
        mesh = align(mesh, settings.align)
        if name == "eve":
            mesh = replace(mesh, faces=mesh.faces[:0])
        mesh.save(folder / f"{name}.npz")
        bake_figure(folder / f"{name}.npz", settings.bake, folder / "maps")
    looks = ("ann", "bob", "bob.o1", "eve")
    maps = [folder / "maps" / f"{look}{view}.exr" for look in looks for view in ("", ".v1", ".v2")]
    pack_figures(maps, settings.split.least, folder / "packed", folder / "record")
    write_split(settings.split, folder / "packed", folder / "record", folder / "split")
    np.savez(folder / "lights.npz", coefficients=np.ones((2, 9, 3), np.float32), split=np.array(["train", "test"]))
    return folder


def test_each_view_is_a_file_of_its_own(made, settings):
    frontal, views = read_maps(made / "maps/ann.exr"), [read_maps(made / f"maps/ann.v{k}.exr") for k in (1, 2)]
    assert frontal.info["name"] == "ann" and not {"view", "figure"} & set(frontal.info)
    for number, maps in enumerate(views, 1):
        info, view = maps.info, random_view(f"ann.v{number}")
        assert (info["name"], info["figure"], info["subject"]) == (f"ann.v{number}", "ann", "annie")
        assert [info["view"][key] for key in ("yaw", "pitch", "focal")] == [view.yaw, view.pitch, view.focal]
        assert (maps.mask != frontal.mask).any()
        rows, columns = np.nonzero(maps.mask)
        assert max(np.ptp(rows), np.ptp(columns)) + 1 == pytest.approx(0.9 * 64, abs=1.5)
    assert read_info(made / "maps/bob.v1.exr")["subject"] == "bob", "a figure without a subject is its own"


def test_one_view_more_changes_no_other(made, settings, tmp_path):
    bake_figure(made / "bob.npz", replace(settings.bake, views=1), tmp_path)
    for name in ("bob.exr", "bob.v1.exr"):
        assert (tmp_path / name).read_bytes() == (made / "maps" / name).read_bytes()
    assert not (tmp_path / "bob.v2.exr").exists()


def test_a_figure_is_left_out_with_all_its_views_and_outfits(made, settings, tmp_path):
    for name in ("eve", "eve.v1", "eve.v2"):
        assert "no faces" in read_info(made / f"maps/{name}.exr")["left_out"]
    record = json.loads((made / "record").read_text())
    assert set(record["figures"]) == set(FIGURES) and set(record["left_out"]) == {"eve"}
    left_out({"name": "ann", "outfits": [None, None]}, "torn").save(tmp_path / "ann.npz")
    bake_figure(tmp_path / "ann.npz", replace(settings.bake, views=1), tmp_path)
    found = {path.stem: read_info(path)["left_out"] for path in tmp_path.glob("*.exr")}
    assert found == dict.fromkeys(("ann", "ann.o1", "ann.o1.v1", "ann.v1"), "torn")


def test_views_are_on_the_side_of_their_figure(made, settings):
    packed = PackedMaps(made / "packed")
    assert packed.names == [f"{look}{end}" for look in ("ann", "bob", "bob.o1") for end in ("", ".v1", ".v2")]
    assert packed.figures == 3 * ["ann"] + 6 * ["bob"] and packed.subjects == 3 * ["annie"] + 6 * ["bob"]
    assert [view is None for view in packed.views] == 3 * [True, False, False]
    assert packed.views[1] == read_info(made / "maps/ann.v1.exr")["view"]
    parts = json.loads((made / "split").read_text())
    assert sorted(parts["train"] + parts["test"]) == ["ann", "bob"], "the split deals figures"
    data = RelitSet(made / "packed", made / "lights.npz", 2, "photo")
    trained = [data.names[i] for i in select_training_data(data, made / "split", settings.train)[0]]
    own = parts["train"][0]
    assert trained == [name for name, figure in zip(packed.names, packed.figures) if figure == own]
    assert len(select_training_data(data, made / "split", replace(settings.train, figures=1))[0]) == len(trained)


def test_outfits_are_maps_of_their_own_that_share_transport(made):
    for end in ("", ".v1"):
        own, other = (read_maps(made / f"maps/{look}{end}.exr") for look in ("bob", "bob.o1"))
        np.testing.assert_array_equal(own.transport, other.transport)
        shown = other.albedo[own.mask]
        np.testing.assert_allclose(shown, np.broadcast_to([0.5, 0.2, 0.1], shown.shape), atol=1e-3)
        assert own.albedo[own.mask].min() > 0.9
        record = {key: other.info[key] for key in ("name", "figure", "subject", "outfit", "fabrics")}
        assert record == {"name": f"bob.o1{end}", "figure": "bob", "subject": "bob", "outfit": 1, "fabrics": ["plain"]}
        assert other.info.get("view") == own.info.get("view")


def test_the_front_is_evaluated(made, settings):
    data = RelitSet(made / "packed", made / "lights.npz", 2, "photo")
    own = json.loads((made / "split").read_text())["test"][0]
    assert [data.names[i] for i in select_pairs(data, made / "split")[0]] == [own]
    assert not len(select_pairs(data, made / "split", "sitting-test")[0])


def test_plan_names_the_maps():
    plan = Plan(compose_run("scale=smoke bake.views=2 figures.count=2".split()))
    assert [plan.maps(figure) for figure in plan.figures] == [[n, f"{n}.v1", f"{n}.v2"] for n in ("g0000", "g0001")]
    assert Plan(compose_run("scale=smoke".split())).maps("g0000") == ["g0000"]
    plan = Plan(compose_run("scale=smoke bake.views=1 figures.outfits=2".split()))
    assert plan.maps("g0000") == ["g0000", "g0000.v1", "g0000.o1", "g0000.o1.v1"]
    for words in ("bake.bounces=1", "figures=scans figures.folder=."):
        with pytest.raises(UserError, match=r"figures\.outfits must be 1"):
            Plan(compose_run(f"scale=smoke figures.outfits=2 {words}".split()))
    with pytest.raises(UserError, match=r"bake\.views must be at least 0"):
        Plan(compose_run("scale=smoke bake.views=-1".split()))
