"""Training: it learns, it repeats itself exactly, and it goes on after any kill as if nothing had happened."""

import copy
import csv
import json
import os
import pickle
import subprocess
import sys
from dataclasses import make_dataclass, replace
from pathlib import Path
from unittest.mock import call, patch

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

import relight.learning.__main__ as program
import relight.learning.train as module
from relight.core.errors import UserError
from relight.learning import checkpoint
from relight.learning.checkpoint import load_network
from relight.learning.data import RelitSet, draw_pairs
from relight.learning.train import Inputs, Recipe, draw_batch, learning_rate, select_training_data, train
from relight.settings import ROOT


class Run:
    """One training into a folder of its own."""

    def __init__(self, folder: Path, world: dict, recipe: Recipe):
        self.out, self.state, self.curve = folder / "n.safetensors", folder / "state.pt", folder / "curve.csv"
        self.recipe, self.inputs = recipe, Inputs(world["packed"], world["lights"], world["split"])
        self.logged: list[tuple[int, dict]] = []

    def program(self) -> str:
        """Python that runs this training in a process of its own."""
        given = pickle.dumps((self.recipe, self.inputs, self.out, self.state, self.curve, None))
        return f"import pickle\nfrom relight.learning.train import train\ntrain(*pickle.loads({given!r}))\n"

    def change_lights(self, **tables: np.ndarray) -> None:
        path = self.out.with_name("lights.npz")
        np.savez(path, **{**np.load(self.inputs.lights), **tables})
        self.inputs = replace(self.inputs, lights=path)

    def __call__(self, log=None) -> bytes:
        log = log or (lambda values, step, picture: self.logged.append((step, values)))
        train(self.recipe, self.inputs, self.out, self.state, self.curve, log)
        self.state.unlink(missing_ok=True)
        return self.out.read_bytes()


@pytest.fixture
def run(tmp_path, world, model, loss, schedule, augment):
    def make(name: str = "run", model_changes=None, loss_changes=None, augment_changes=None, **changes) -> Run:
        (tmp_path / name).mkdir(exist_ok=True)
        parts = model(**model_changes or {}), loss(**loss_changes or {}), schedule(**changes)
        return Run(tmp_path / name, world, Recipe(*parts, augment(**augment_changes or {})))

    return make


class Killed(Exception):
    pass


def killed_at(last: int):
    """A logger that ends the training at a step."""

    def log(values, step, picture):
        if step == last:
            raise Killed

    return log


PLUS = dict(optimizer="muon", average=0.9, mirror=True, color="photo", pairs="rows")
PHOTO = {"color": "photo", "augment_changes": dict(framing=0.5, tint=0.2, exposure=[-1.0, 0.5], camera=1.0)}
PHOTO["model_changes"] = dict(name="unet", light_head="pooled", refine=True)


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, PLUS, PHOTO], ids=["plain", "plus", "photo"])
def test_the_same_again_and_the_same_after_any_interruption(run, changes):
    undisturbed = run("whole", **changes)
    whole = undisturbed()
    assert changes or run("seed", seed=1)() != whole

    broken = run("broken", **changes)
    for stop in (8, 4):  # before the last state is saved, and, in the next run, before any is
        with pytest.raises(Killed):
            broken(killed_at(stop))
        assert not broken.out.exists() and broken.state.exists() == (stop == 8)
        if stop == 8:
            torch.manual_seed(12345)
            assert broken() == whole and broken.curve.read_text() == undisturbed.curve.read_text()
            assert [step for step, _ in broken.logged] == [8]
            broken.out.unlink()
    assert not broken.state.exists()


@pytest.mark.slow
def test_a_state_of_other_settings_or_data_is_ignored(run, world, capsys):
    first = run()
    with pytest.raises(Killed):
        first(killed_at(8))
    kept = first.state.read_bytes()
    other = run(lr=1e-3)
    assert other() == run("fresh", lr=1e-3)()
    assert "other settings or data: starting from the beginning" in capsys.readouterr().err
    assert [step for step, _ in other.logged] == [4, 8]
    first.state.write_bytes(kept)
    first.change_lights(coefficients=1.1 * np.load(world["lights"])["coefficients"])
    first()
    assert "starting from the beginning" in capsys.readouterr().err


@pytest.mark.slow
def test_one_figure_under_one_light_is_learned_by_heart(run, world, tmp_path):
    (split := tmp_path / "one.json").write_text('{"train": ["figure2"], "test": []}')
    changes = {"norm": "instance", "dropout": 0.0, "name": "sfsnet_ao"}
    heart = run("heart", changes, {"tv_albedo": 0, "tv_transport": 0}, steps=100, batch=1, epoch=50, lr=4e-3)
    heart.inputs = replace(heart.inputs, split=split)
    heart.change_lights(split=np.where(np.arange(7) == 3, "train", "test"))
    heart()
    network, _ = load_network(heart.out)
    batch = RelitSet(world["packed"], world["lights"], 2, "paper").batch(np.array([2]), np.array([3]))
    with torch.no_grad():
        outputs = network(batch.image, batch.mask)

    def rms(error: torch.Tensor) -> float:
        return (error.square().sum() / (batch.inside.sum() * error.shape[-1])).sqrt().item()

    errors = {key: rms(batch.gather(outputs[key]) - getattr(batch, key)) for key in ("albedo", "normal")}
    spread = {key: rms(getattr(batch, key) - getattr(batch, key).mean(1) * batch.inside) for key in errors}
    assert all(errors[key] < 0.4 * spread[key] for key in errors), (errors, spread)
    assert (outputs["light"] - batch.light).abs().mean() < 0.02


def test_what_is_logged(run, capsys):
    short = run(steps=10, loss_changes={"shading": 2.0, "light": 3.0})
    short()
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == ["step 4/10", "step 8/10", "step 10/10"]
    assert all(" left" in line and " ms a step" in line for line in lines)
    assert [step for step, _ in short.logged] == [4, 8, 10]
    for _, values in short.logged:
        for prefix in ("", "validation/"):
            found = {key.removeprefix(prefix): value for key, value in values.items() if key.startswith(prefix)}
            named = {key: found[key] for key in found if key not in ("loss", "lr") and "/" not in key}
            assert len(named) == 15
            weight = dict.fromkeys((key for key in named if key.startswith("shading")), 2.0)
            weight |= {"tv_transport": 64 / 1024, "light": 3.0}
            expected = sum(weight.get(key, 1.0) * value for key, value in named.items())
            assert found["loss"] == pytest.approx(expected, rel=1e-5)
    rows = list(csv.DictReader(short.curve.open()))
    assert [int(row["step"]) for row in rows] == [4, 8, 10]
    assert [float(row["loss"]) for row in rows] == [values["loss"] for _, values in short.logged]
    assert float(rows[-1]["lr"]) < float(rows[0]["lr"]) < 2e-3


def test_a_loss_that_is_not_finite_names_its_step_and_keeps_the_last_good_state(run, world):
    lit = [0, 2, 3, 5]
    seen = [lit[draw_pairs(0, step, 1, 4, 4)[0, 1]] for step in range(12)]
    first, light = max((seen.index(light), light) for light in set(seen))
    coefficients = np.load(world["lights"])["coefficients"]
    coefficients[light, 0, 0] = np.nan
    bad = run("bad", {"norm": "instance"}, steps=12, epoch=2, batch=1)
    bad.change_lights(coefficients=coefficients)
    with pytest.raises(UserError, match=f"not a finite number at step {first}:"):
        bad()
    assert not bad.out.exists()
    kept = torch.load(bad.state, weights_only=True)
    assert kept["step"] == first // 2 * 2 > 0 and all(value.isfinite().all() for value in kept["network"].values())


def test_the_moving_average_has_its_closed_form():
    """decay^n w_0 + (1 - decay) sum decay^(n-k) w_k over the steps k = 1 to n; buffers are those of the last step."""
    decay, steps = 0.9, [torch.nn.BatchNorm1d(3).double() for _ in range(6)]
    for k, network in enumerate(steps):
        for tensor in (*network.parameters(), network.running_mean):
            tensor.data.copy_(torch.sin(torch.arange(3) + 2.0 * k))
    average = copy.deepcopy(steps[0])
    for network in steps[1:]:
        module.update_average(average, network, decay)
    shares = [decay**5, *((1 - decay) * decay ** (5 - k) for k in range(1, 6))]
    assert sum(shares) == pytest.approx(1)
    for name, value in average.named_parameters():
        expected = sum(share * network.get_parameter(name) for share, network in zip(shares, steps))
        torch.testing.assert_close(value, expected, rtol=1e-12, atol=1e-12)
    assert torch.equal(average.running_mean, steps[-1].running_mean)


def test_the_moving_average_is_what_is_kept(run):
    last, mean = run("last", average=0.0), run("mean", average=0.99)
    last(), mean()
    one, other = load_network(last.out)[0], load_network(mean.out)[0]
    assert any(not torch.equal(a, b) for a, b in zip(one.parameters(), other.parameters()))
    moved = [(a - b).norm() / a.norm() for a, b in zip(one.parameters(), other.parameters()) if a.ndim == 4]
    assert 0 < max(moved) < 0.5 and all(torch.equal(a, b) for a, b in zip(one.buffers(), other.buffers()))


def test_going_on_from_another_network_with_its_decoders_frozen_or_from_before_a_setting(run, monkeypatch):
    first = run("first")
    first()
    alone = dict.fromkeys("albedo transport light tv_albedo tv_transport shading reconstruction".split(), 0.0)
    tuned = run("tuned", None, alone, start=str(first.out), only="encoder", lr=1e-4)
    tuned()
    losses = {"loss", "reconstruction_full"}
    assert set(tuned.logged[0][1]) == {"lr", *losses, *(f"validation/{name}" for name in losses)}
    before, after = load_network(first.out)[0].state_dict(), load_network(tuned.out)[0].state_dict()
    changed = {name.split(".")[0] for name in before if not torch.equal(before[name], after[name])}
    assert changed == {"encoder"}
    clip = {"straight_through": "clip", "clip": "straight_through"}[load_network(first.out)[1]["model"]["albedo"]]
    run("clip", {"albedo": clip}, alone, start=str(first.out), steps=1)()  # the same values
    with pytest.raises(UserError, match=r"a network with light_head=\w+: give one with light_head=pooled"):
        run("other", {"light_head": "pooled"}, alone, start=str(first.out))()
    with safe_open(first.out, "pt") as file:
        header = json.loads(file.metadata()["relight"])
        weights = {name: file.get_tensor(name) for name in file.keys()}
    default = header["model"].pop("sees")
    older = first.out.with_name("older.safetensors")
    save_file(weights, older, {"relight": json.dumps(header)})
    newer = make_dataclass("Newer", [("sees", str, default)], bases=(checkpoint.Model,))
    monkeypatch.setattr(checkpoint, "Model", newer)
    run("older", start=str(older), steps=1)()  # with the default


def test_learning_rate(schedule):
    cosine = schedule(steps=100, warmup=10, lr=1.0)
    assert [learning_rate(cosine, step) for step in (0, 4)] == pytest.approx([0.1, 0.5], rel=0.02)
    assert learning_rate(cosine, 50) == pytest.approx(0.51)
    assert learning_rate(cosine, 99) == pytest.approx(0.02, abs=1e-3)
    whole = schedule(steps=100, lr=1.0, warmup=0)
    for first, span in ((0, [0.0, 0.5]), (50, [0.5, 1.0])):
        half = schedule(steps=50, lr=1.0, warmup=0, span=span)
        assert learning_rate(half, 20) == pytest.approx(learning_rate(whole, first + 20))
    assert {learning_rate(schedule(schedule="constant", warmup=0, lr=0.3), step) for step in range(8)} == {0.3}


def test_what_is_trained_on(world, schedule, tmp_path):
    """Marks of lights, parts of the split, and fewer figures that are part of more, another few of another seed."""
    data = RelitSet(world["packed"], world["lights"], 2, "paper")

    def chosen(**changes):
        figures, lights = select_training_data(data, world["split"], schedule(**changes))
        return figures.tolist(), lights.tolist()

    assert chosen() == ([0, 1, 2, 3], [0, 2, 3, 5]) and chosen(lights=["train", "test"])[1] == [0, 1, 2, 3, 5]
    assert chosen(part="test", lights=["test"]) == ([4], [1])
    for seed in range(5):
        nested = [set(chosen(figures=count, seed=seed)[0]) for count in (1, 2, 3, 4, 9)]
        assert [len(figures) for figures in nested] == [1, 2, 3, 4, 4]
        assert nested[0] < nested[1] < nested[2] < nested[3]
    assert len({chosen(figures=1, seed=seed)[0][0] for seed in range(9)}) > 1 and chosen(figures=9) == chosen()


def test_user_errors(run, world, tmp_path):
    nobody = run()
    nobody.inputs = replace(nobody.inputs, split=tmp_path / "split.json")
    nobody.inputs.split.write_text('{"train": ["nobody"], "test": []}')
    with pytest.raises(UserError, match="0 figures and 4 lights to train on"):
        nobody()
    if not torch.cuda.is_available():
        with pytest.raises(UserError, match="torch finds no GPU"):
            run(device="cuda")()


def test_a_batch_of_one_is_relit_under_another_light(run, world):
    """Under its own light, the two losses would be those of shading and reconstruction."""
    one = run(batch=1, loss_changes={"relit": 1.0})
    data = RelitSet(world["packed"], world["lights"], 2, "paper")
    lights = np.flatnonzero(data.light_split == "train")
    batches = [draw_batch(data, np.arange(4), lights, one.recipe, step, 0, 1) for step in range(8)]
    others = [batch.other_light for batch in batches]
    assert all(light is not None and light.shape == batch.light.shape for light, batch in zip(others, batches))
    assert sum(not torch.equal(light, batch.light) for light, batch in zip(others, batches)) >= 4
    shared = run(batch=4, loss_changes={"relit": 1.0}).recipe  # four processes of a pair each
    of_ranks = [draw_batch(data, np.arange(4), lights, shared, 0, rank, 4).other_light for rank in range(4)]
    assert len({tuple(light.flatten().tolist()) for light in of_ranks}) > 1


@pytest.mark.slow
def test_two_processes_train_the_network_that_one_does(run, tmp_path):
    """torchrun with gloo. Without dropout and with instance statistics the averaged gradient is that of the batch.

    No loss teaches albedo and light, so their weights have no gradient to wait for.
    """
    without = "albedo light tv_albedo shading reconstruction reconstruction_full"
    loss = {"reduction": "mask", **dict.fromkeys(without.split(), 0.0)}
    changes = {"norm": "instance", "dropout": 0.0}, loss, {"framing": 1.0}
    alone, pair = (run(name, *changes, steps=4, color="photo", optimizer="muon") for name in ("alone", "pair"))
    alone()
    (script := tmp_path / "pair.py").write_text(pair.program())
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2", str(script)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=240)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("step 4/4") == 1, "one process speaks"
    one, other = load_network(alone.out)[0].state_dict(), load_network(pair.out)[0].state_dict()
    for name, value in one.items():
        assert (value - other[name]).abs().mean() < 2e-5, name
    rows = [list(csv.DictReader(path.open()))[-1] for path in (alone.curve, pair.curve)]
    assert float(rows[0]["loss"]) == pytest.approx(float(rows[1]["loss"]), rel=1e-4)


@pytest.mark.parametrize("stated", ["2", None])
def test_a_job_says_how_many_threads_it_takes(stated, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", stated) if stated else monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr(torch, "get_num_threads", lambda: 2)
    with patch.object(torch, "set_num_threads") as threads, module.torch_context(torch.device("cpu")):
        assert threads.mock_calls == ([] if stated else [call(1)])


@pytest.mark.slow
def test_learning_needs_torch_alone():
    """A bare GPU node has torch, numpy, hydra and safetensors."""
    names = "checkpoint data losses predict train"
    program = f"import sys\nfor name in {names.split()}: __import__('relight.learning.' + name)\nprint(*sys.modules)"
    modules = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in modules.stdout.split()}
    assert not loaded & {*"open3d pymeshlab snakemake mlflow warp anny matplotlib sklearn pandas".split()}


@pytest.mark.parametrize("capability", [None, "amx_bf16", "avx512_bf16"])
def test_bf16_on_a_cpu_without_it_says_so(run, monkeypatch, capsys, capability):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx2": True, capability: True}, raising=False)
    run(precision="bf16", steps=1, batch=1)()
    lines = [line for line in capsys.readouterr().err.splitlines() if "bfloat16" in line]
    assert len(lines) == (capability is None)


def test_without_the_workflow_each_network_has_its_own_state_and_curve(monkeypatch):
    beside = []
    monkeypatch.setattr(program, "train", lambda recipe, inputs, *files: beside.append([str(file) for file in files]))
    for out, base in (("a/net.s0", "a/net.s0"), ("a/net.s1", "a/net.s1"), ("a/net.safetensors", "a/net")):
        monkeypatch.setattr(sys, "argv", ["", "--packed=p", "--lights=l", "--split=s", f"--out={out}", "scale=smoke"])
        program.main()
        assert beside.pop() == [out, f"{base}.state.pt", f"{base}.csv"]
