"""Scores a trained network, or a baseline, on every test figure under every test light."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from relight import config
from relight.evaluation.metrics import Inferred, Truth
from relight.evaluation.scores import Scores, write_scores
from relight.files import UserError
from relight.learning.checkpoint import load_network
from relight.learning.data import Batch, RelitSet, read_split
from relight.learning.harmonics import unoccluded
from relight.learning.networks import Network
from relight.progress import progress

PIXELS = 2**20  # of the images that go through a network at once

Predictor = Callable[[int, np.ndarray], Inferred]  # (figure, lights (N,)) of a RelitSet -> what is inferred of them


def evaluate(checkpoint: Path, packed: Path, lights: Path, split: Path, settings: config.Evaluate, out: Path) -> None:
    """Writes the scores (CSV) of the network in `checkpoint`, under the name of `out`.

    Figures are those of `settings.figures` in the split, relit by the lights marked `settings.lights`, in the colour
    model that the network was trained with. The same inputs give the same bytes on the same machine: on a CPU one
    thread is used. Raises UserError when a file is not what it should be or nothing is left to test on; figures that
    sit, further views and unusual lights need not be there, and the file then holds no scores.
    """
    network, data = load(checkpoint, packed, lights, settings)
    if not has_pairs(data, split, settings):
        return write_scores(out, {})
    scores = score(lambda figure, lit: infer(network, data, figure, lit), data, split, settings)
    write_scores(out, {out.stem: scores})


def load(checkpoint: Path, packed: Path, lights: Path, settings: config.Evaluate) -> tuple[Network, RelitSet]:
    """The network and its data on the device of `settings`, at the network's own order and in its own colour model.

    Sets `network.unlearned`.
    """
    device = torch_device(settings.device)
    network, made_with = load_network(checkpoint, device)
    network.unlearned = unlearned(made_with.get("loss"))
    data = RelitSet(packed, lights, network.order, made_with["train"]["color"], device)
    if data.size != network.size:
        raise UserError(
            f"{checkpoint} was trained at {network.size} px and {packed} holds maps of {data.size} px: they must agree"
        )
    return network, data


def unlearned(loss: dict[str, float] | None) -> frozenset[str]:
    """Which of albedo and light no loss of a training asked for: they are noise, and the truth stands in for them."""
    asked = {"albedo": ("albedo", "tv_albedo"), "light": ("light", "shading")}
    either = ("reconstruction", "reconstruction_full")
    return frozenset(name for name, own in asked.items() if loss and not any(loss[key] for key in (*own, *either)))


def torch_device(name: str) -> torch.device:
    """`auto` is the GPU where there is one. Keeps torch to one thread on a CPU, where sums depend on their number."""
    kind = "cuda" if name != "cpu" and torch.cuda.is_available() else "cpu"
    if kind == "cpu":
        torch.set_num_threads(1)
    if name == "cuda" and kind == "cpu":
        raise UserError("evaluate.device is cuda and torch sees no GPU here: give evaluate.device=cpu or auto")
    return torch.device(kind)


def chosen_pairs(
    data: RelitSet, split: Path, lights: str = "test", figures: str = "test"
) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the figures of a part of the split and of the lights with a mark. UserError when either is empty."""
    chosen = chosen_figures(data, split, figures)
    lit = np.flatnonzero(data.light_split == lights)
    if not len(chosen) or not len(lit):
        raise UserError(
            f"nothing to evaluate: {len(chosen)} {figures} figures of {split} are in the packed set and "
            f"{len(lit)} lights are marked {lights}; at least one of each is needed"
        )
    return chosen, lit


def chosen_figures(data: RelitSet, split: Path, figures: str) -> np.ndarray:
    """Indices of the figures of a part of the split, from the front; `views` are the test figures' other views."""
    parts = read_split(split)
    if figures != "views":
        return data.figures(parts[figures])
    others = data.others(data.figures(parts["test"]))
    return others[data.turned[others]]


def has_pairs(data: RelitSet, split: Path, settings: config.Evaluate) -> bool:
    """Whether the set has a figure that sits, a further view or an unusual light, where these are to be scored."""
    figures = settings.figures == "test" or len(chosen_figures(data, split, settings.figures)) > 0
    return figures and (settings.lights != "unusual" or bool((data.light_split == "unusual").any()))


def score(predictor: Predictor, data: RelitSet, split: Path, settings: config.Evaluate) -> Scores:
    """The scores of a predictor on all test pairs; those of a figure are taken together, since they share its truth."""
    figures, lights = chosen_pairs(data, split, settings.lights, settings.figures)
    parts = [truth(data, f, lights).score(predictor(f, lights)) for f in progress(figures.tolist(), "figures scored")]
    columns = {name: np.stack([part[name] for part in parts]) for name in parts[0]}
    return Scores([data.names[f] for f in figures], lights.tolist(), columns)


def truth(data: RelitSet, figure: int, lights: np.ndarray) -> Truth:
    """The true maps of one figure of the set under `lights` (N,), in the set's colour model."""
    batch = data.batch(np.array([figure]), lights[:1])
    start, count = int(data.offset[figure]), int(data.counts[figure])
    maps = {name: getattr(batch, name)[0, :count].cpu().numpy() for name in ("albedo", "normal", "ao")}
    return Truth(
        batch.pixel[:count].cpu().numpy(),
        data.transport[start : start + count].float().cpu().numpy(),
        maps["albedo"],
        maps["normal"],
        maps["ao"][:, 0],
        data.lights[torch.as_tensor(lights, device=data.lights.device)].cpu().numpy(),
        data.size,
    )


@torch.inference_mode()
def infer(network: Network, data: RelitSet, figure: int, lights: np.ndarray) -> Inferred:
    """What the network says of one figure under each of `lights` (N,), from the pictures relit by them.

    SfSNet's transport is that of its normals without occlusion, with and without AO (table 1 of the paper says so).
    """
    count, step = int(data.counts[figure]), max(1, PIXELS // data.size**2)
    found: dict[str, list[np.ndarray]] = {}
    for start in range(0, len(lights), step):
        lit = lights[start : start + step]
        batch = data.batch(np.full(len(lit), figure), lit)
        for name, values in compact(network, batch).items():
            values = values if name == "light" else values[:, :count]
            found.setdefault(name, []).append(values.cpu().numpy())
    maps = {name: np.concatenate(parts) for name, parts in found.items()}
    maps |= dict.fromkeys(network.unlearned)
    ao = maps["ao"][..., 0] if "ao" in maps else None
    return Inferred(maps["albedo"], maps["transport"], maps.get("normal"), ao, maps["light"], occlude=ao is not None)


def compact(network: Network, batch: Batch) -> dict[str, torch.Tensor]:
    """The network's maps on the in-mask pixels (B,P,C), its light (B,K,3), and the transport of its normals."""
    outputs = network(batch.image, batch.mask)
    light = outputs.pop("light").float()
    maps = {name: batch.take(dense) for name, dense in outputs.items()}
    if "transport" not in maps:
        maps["transport"] = unoccluded(maps["normal"], network.order)
    return {**maps, "light": light}
