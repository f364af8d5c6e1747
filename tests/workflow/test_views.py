"""Views of figures through the stages: baked beside the frontal view, packed, dealt with their figure, trained on."""

import json
from dataclasses import replace

import numpy as np
import pytest
from omegaconf import OmegaConf
from people import person

from relight.config import composed
from relight.evaluation.evaluate import chosen_pairs, has_pairs
from relight.files import UserError
from relight.learning.data import RelitSet
from relight.learning.train import selection
from relight.maps import PackedMaps, read_info, read_maps
from relight.meshes import Material, Mesh, align
from relight.stages import bake, pack, split
from relight.transport import random_view
from relight.workflow import Plan

FIGURES = ("ann", "bob", "eve")


@pytest.fixture(scope="module")
def settings():
    words = ["scale=smoke", "bake.views=2", "bake.rays=4", "figures.count=1"]
    return OmegaConf.to_object(composed(words))


@pytest.fixture(scope="module")
def made(tmp_path_factory, settings):
    """Three figures of which the third is left out, baked from the front and from two other sides, packed and dealt."""
    folder = tmp_path_factory.mktemp("views")
    (folder / "maps").mkdir()
    for seed, name in enumerate(FIGURES):
        body = person(seed)
        mesh = Mesh(
            body.vertices.astype(np.float32),
            body.faces.astype(np.int32),
            np.zeros((len(body.faces), 3, 2), np.float32),
            np.zeros(len(body.faces), np.int16),
            [Material()],
            info={"name": name, "axes": {"up": "+y", "front": "+z"}, **({"subject": "annie"} if name == "ann" else {})},
        )
        mesh = align(mesh, settings.align)
        if name == "eve":
            mesh = replace(mesh, faces=mesh.faces[:0])
        mesh.save(folder / f"{name}.npz")
        bake.main(settings.bake, folder / f"{name}.npz", folder / "maps" / f"{name}.exr")
    names = [map_name for name in FIGURES for map_name in (name, f"{name}.v1", f"{name}.v2")]
    (folder / "maps.txt").write_text("\n".join(names))
    pack.main(settings.split, folder / "maps.txt", folder / "maps", folder / "packed", folder / "record")
    split.main(settings.split, folder / "packed", folder / "record", folder / "split")
    np.savez(folder / "lights.npz", coefficients=np.ones((2, 9, 3), np.float32), split=np.array(["train", "test"]))
    return folder


def test_each_view_is_a_file_of_its_own(made, settings):
    frontal, views = read_maps(made / "maps/ann.exr"), [read_maps(made / f"maps/ann.v{k}.exr") for k in (1, 2)]
    assert frontal.info["name"] == "ann" and not {"view", "figure"} & set(frontal.info)
    for number, maps in enumerate(views, 1):
        info, view = maps.info, random_view(f"ann.v{number}", settings.bake.seed)
        assert (info["name"], info["figure"], info["subject"]) == (f"ann.v{number}", "ann", "annie")
        assert [info["view"][key] for key in ("yaw", "pitch", "focal")] == [view.yaw, view.pitch, view.focal]
        assert (maps.mask != frontal.mask).any()
        rows, columns = np.nonzero(maps.mask)
        assert max(np.ptp(rows), np.ptp(columns)) + 1 == pytest.approx(0.9 * 64, abs=1.5)
    assert read_info(made / "maps/bob.v1.exr")["subject"] == "bob", "a figure without a subject is its own"


def test_one_view_more_changes_no_other(made, settings, tmp_path):
    bake.main(replace(settings.bake, views=1), made / "bob.npz", tmp_path / "bob.exr")
    for name in ("bob.exr", "bob.v1.exr"):
        assert (tmp_path / name).read_bytes() == (made / "maps" / name).read_bytes()
    assert not (tmp_path / "bob.v2.exr").exists()


def test_a_figure_is_left_out_with_all_its_views(made):
    for name in ("eve", "eve.v1", "eve.v2"):
        assert "no faces" in read_info(made / f"maps/{name}.exr")["left_out"]
    record = json.loads((made / "record").read_text())
    assert set(record["figures"]) == set(FIGURES) and set(record["left_out"]) == {"eve"}


def test_views_are_on_the_side_of_their_figure(made, settings):
    packed = PackedMaps(made / "packed")
    assert packed.names == ["ann", "ann.v1", "ann.v2", "bob", "bob.v1", "bob.v2"]
    assert packed.figures == 3 * ["ann"] + 3 * ["bob"] and packed.subjects == 3 * ["annie"] + 3 * ["bob"]
    assert [view is None for view in packed.views] == 2 * [True, False, False]
    assert packed.views[1] == read_info(made / "maps/ann.v1.exr")["view"]
    parts = json.loads((made / "split").read_text())
    assert sorted(parts["train"] + parts["test"]) == ["ann", "bob"], "the split deals figures"
    data = RelitSet(made / "packed", made / "lights.npz", 2, "photo")
    trained = [data.names[i] for i in selection(data, made / "split", settings.train)[0]]
    own = parts["train"][0]
    assert trained == [own, f"{own}.v1", f"{own}.v2"]
    assert len(selection(data, made / "split", replace(settings.train, figures=1))[0]) == 3, "figures are counted"


def test_the_front_is_evaluated_unless_views_are_asked_for(made, settings):
    data = RelitSet(made / "packed", made / "lights.npz", 2, "photo")
    own = json.loads((made / "split").read_text())["test"][0]
    found = {
        part: [data.names[i] for i in chosen_pairs(data, made / "split", figures=part)[0]] for part in ("test", "views")
    }
    assert found == {"test": [own], "views": [f"{own}.v1", f"{own}.v2"]}
    assert has_pairs(data, made / "split", replace(settings.evaluate, figures="views"))
    assert not has_pairs(data, made / "split", replace(settings.evaluate, figures="sitting"))


def test_plan_names_the_maps():
    plan = Plan({"hydra": "scale=smoke bake.views=2 figures.count=2"})
    assert [plan.maps(figure) for figure in plan.figures] == [[n, f"{n}.v1", f"{n}.v2"] for n in ("g0000", "g0001")]
    assert Plan({"hydra": "scale=smoke"}).maps("g0000") == ["g0000"]
    with pytest.raises(UserError, match=r"bake\.views must be at least 0"):
        Plan({"hydra": "scale=smoke bake.views=-1"})
