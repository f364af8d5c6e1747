"""Relit pictures against path tracing: chains whose causes are known, and a ball, which lights itself not at all."""

import csv
import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image
from samples import lights_of, mesh_of

from relight.core.errors import UserError
from relight.evaluation.experiments.path_traced import ANSWERS, CAUSES, Chain, evaluate_traced, traced_plate
from relight.evaluation.experiments.tracing import Scene, read_scenes, sky_of, trace
from relight.evaluation.report.own import traced_tables
from relight.evaluation.scoring.evaluate import infer, load
from relight.learning.data import RelitSet
from relight.lights import read_light_set, write_light_set
from relight.lights.chain import generated_light
from relight.maps import pack_maps, write_maps
from relight.meshes import Material
from relight.panoramas import orient
from relight.settings import Panoramas, Trace
from relight.sh import basis, unoccluded
from relight.transport import bake
from relight.transport.tracer import sky_directions, sky_weights

GENERATED = Panoramas("generated", None, 3, 0, 0, "auto", True, True)


@pytest.fixture(scope="module")
def data(world):
    return RelitSet(world.packed, world.lights, 2, "paper")


def scene_of(data, figure, seen, new, **changed):
    """A scene in which every picture of the chain is the same, but for what is `changed`."""
    start, count = int(data.offset[figure]), int(data.counts[figure])
    light = data.lights[new].numpy()
    lit = data.transport[start : start + count].float().numpy() @ light
    arrays = {"area": lit, "cut": np.stack([lit] * 2), "direct": np.stack([lit] * 2), "full": np.stack([lit] * 2)}
    return Scene(figure, seen, new, light, **{**arrays, **changed})


def test_chain_steps_separate_the_causes(data):
    """0.1, .2, .3 on all channels, one after the other, are all that their causes find."""
    plain = scene_of(data, 3, 4, 5)
    rng = np.random.default_rng(0)

    def noisy(values):
        return values + rng.normal(0, 2, (2, *values.shape[-2:]))

    scene = scene_of(data, 3, 4, 5, cut=plain.cut + 0.1, direct=plain.direct + 0.3, full=plain.full + 0.6)
    chain = Chain.of(data, scene)
    norm = np.sqrt((chain.albedo**2).sum(-1).mean())
    wanted = {"clipping": 0, "sampling": 0, "baker": 0.1, "truncation": 0.2, "interreflection": 0.3}
    total = 0
    for cause, before, after in chain.steps():
        rmse, _, bias = chain.measure_difference(before, after)
        assert rmse == pytest.approx(wanted[cause] * norm, abs=1e-5), cause
        assert bias < 0 or wanted[cause] == 0
        total = total + (before - after).mean()
    assert total == pytest.approx((chain.pictures["truth"] - chain.full).mean(), rel=1e-4)
    loud = Chain.of(data, scene_of(data, 3, 4, 5, direct=noisy(plain.direct), full=noisy(plain.full + 0.3)))
    steps = {cause: loud.measure_difference(before, after)[0] for cause, before, after in loud.steps()}
    assert steps["interreflection"] < 0.5 and np.sqrt(8) * norm > 1  # noise of that size, were it left in


def test_chain_clipping_of_a_light_below_zero(data):
    light = data.lights[5].numpy().copy()
    light[2] -= 2  # from behind
    chain = Chain.of(data, scene_of(data, 3, 4, 5))
    chain.scene.light = light
    chain.pictures["truth"] = chain.albedo * np.maximum(chain.truth.transport[0] @ light, 0)
    cause, before, after = next(chain.steps())
    assert cause == "clipping" and (before >= after).all() and (before > after).any()


def test_evaluate_traced_traced_tables_and_traced_plate(world, data, small_network, tmp_path):
    networks = {}
    for name in ("ours", "sfsnet_ao"):
        networks[f"{name}.s0"] = tmp_path / f"{name}.safetensors"
        small_network(networks[f"{name}.s0"], name, "paper")
    scenes = [scene_of(data, figure, 4, 5) for figure in (3, 4)]
    scenes[0].full = scenes[0].full * 1.1
    arrays = {f"{i}.{name}": value for i, scene in enumerate(scenes) for name, value in vars(scene).items()}
    np.savez(tmp_path / "traced.npz", **arrays)
    given = world.packed, world.lights, tmp_path / "traced.npz"
    evaluate_traced(networks, *given, tmp_path / "scores.csv")
    with open(tmp_path / "scores.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * (len(ANSWERS) + len(CAUSES) - 1 + 2 * len(networks))
    found = {(row["kind"], row["name"], row["figure"]): row for row in rows}
    assert float(found["answer", "truth", "snowman03"]["relative"]) == pytest.approx(0.1 / 1.1, rel=1e-3)
    assert float(found["answer", "truth", "snowman03"]["bias"]) == pytest.approx(-0.1 / 1.1, rel=1e-3)
    assert float(found["answer", "truth", "snowman04"]["rmse"]) < 1e-6
    for name, path in networks.items():
        network, own = load(path, world.packed, world.lights)
        said = infer(network, own, 4, np.array([4]))
        transport = said.transport[0] * (said.ao[0][:, None] if said.occlude else 1)
        relit = said.albedo[0] * np.maximum(transport @ scenes[1].light, 0)
        chain = Chain.of(own, scenes[1])
        rmse = np.sqrt(((relit - chain.pictures["truth"]) ** 2).sum(-1).mean())
        for kind, label in (("answer", name), ("cause", f"network:{name}")):
            assert float(found[kind, label, "snowman04"]["rmse"]) == pytest.approx(rmse, rel=1e-4)
    found = traced_tables(tmp_path / "scores.csv")
    assert list(found["path_traced"].frame.index) == ["ours", "SfSNet-AO", *ANSWERS.values()]
    assert len(found["path_traced_causes"].frame) == len(CAUSES) - 1 + len(networks)
    assert found["path_traced"].frame["relative, %"].iloc[2].mean == pytest.approx(
        50 * 0.1 / 1.1, rel=1e-2
    )  # percent, of two figures
    traced_plate({name.partition(".")[0]: path for name, path in networks.items()}, *given, tmp_path / "plate.png")
    assert Image.open(tmp_path / "plate.png").height > 600


def test_chain_refuses_another_data_set(data, world, tmp_path):
    scene = scene_of(data, 3, 4, 5)
    scene.area = scene.area[1:]
    with pytest.raises(UserError, match="trace it again"):
        Chain.of(data, scene)
    (tmp_path / "notes.npz").write_text("no")
    with pytest.raises(UserError, match="set of traced pictures"):
        read_scenes(tmp_path / "notes.npz")
    (tmp_path / "notes.csv").write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match="not a table"):
        traced_tables(tmp_path / "notes.csv")


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    """A light set of three generated rooms, turned and scaled."""
    yaw, scale = np.array([0.0, 70, 190]), np.array([1.0, 2, 0.5])
    turned = [orient(generated_light(f"room:{i}", 2, flip=True), yaw[i], False) * scale[i] for i in range(3)]
    fields = {"coefficients": np.array(turned, np.float32), "yaw": yaw, "scale": scale}
    table = lights_of(["train", "test", "test"], **fields)
    path = tmp_path_factory.mktemp("rooms") / "lights.npz"
    write_light_set(table, path)
    return path


def test_sky_of_has_the_coefficients_of_the_light(rooms):
    table = read_light_set(rooms)
    sky = sky_of(table, 1, GENERATED)
    light = np.einsum("hw,hwk,hwc->kc", sky_weights(), basis(sky_directions()), sky)
    assert np.linalg.norm(light - table.coefficients[1]) < 5e-3 * np.linalg.norm(light)
    with pytest.raises(UserError, match=r"lost\.hdr"):
        sky_of(replace(table, source=np.array(["room:0", "lost.hdr", "room:2"])), 1, GENERATED)


def test_trace_of_a_ball(rooms, tmp_path):
    """Convex, so nothing is occluded and nothing reflects on it: only the truncation is left."""
    pytest.importorskip("mitsuba")
    for i, radius in enumerate((0.6, 0.8)):
        ball = trimesh.creation.icosphere(subdivisions=5)
        fields = {
            "materials": [Material(np.float32([0.6, 0.4, 0.2]))],
            "info": {"name": f"ball{i}", "subject": f"ball{i}"},
        }
        mesh = mesh_of(ball.vertices * radius, ball.faces, **fields)
        mesh.save(tmp_path / f"ball{i}.npz")
        write_maps(tmp_path / f"ball{i}.exr", bake(mesh, 64, 32))
    pack_maps([tmp_path / f"ball{i}.exr" for i in range(2)], tmp_path / "packed.safetensors")
    (tmp_path / "split.json").write_text('{"train": ["ball0"], "test": ["ball1"], "sitting": []}')
    paths = tmp_path / "packed.safetensors", rooms, tmp_path / "split.json", tmp_path
    trace(*paths, GENERATED, Trace(1, 64, 2), 2, 32, tmp_path / "traced.npz")
    (scene,) = read_scenes(tmp_path / "traced.npz")
    assert (scene.seen, scene.new) == (1, 2)
    chain = Chain.of(RelitSet(*paths[:2], 2, "paper"), scene)
    relative = {cause: chain.measure_difference(before, after)[1:] for cause, before, after in chain.steps()}
    assert abs(relative["baker"][1]) < 0.01 and relative["baker"][0] < 0.03
    assert abs(relative["interreflection"][1]) < 0.01 and relative["interreflection"][0] < 0.03
    sky = sky_of(read_light_set(rooms), 2, GENERATED)
    light = np.einsum("hw,hwk,hwc->kc", sky_weights(), basis(sky_directions(), 8), sky)
    normal = chain.truth.maps["normal"][0]
    lost = chain.albedo * (unoccluded(normal) @ light[:9] - unoccluded(normal, 8) @ light)
    wanted = np.sqrt((lost**2).sum(-1).mean() / (chain.full**2).sum(-1).mean())
    assert relative["truncation"][0] == pytest.approx(wanted, abs=5e-3)


def test_trace_without_mitsuba(monkeypatch):
    from relight.transport.tracer import import_mitsuba

    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(UserError, match=r"pip install '\.\[bench\]'"):
        import_mitsuba()
