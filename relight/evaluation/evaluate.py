"""Scores a trained network, or a baseline, on every test figure under every test light."""

from collections.abc import Callable
from dataclasses import replace
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
from relight.maps import Maps
from relight.progress import progress
from relight.sh import UNOCCLUDED_T00, coefficient_count
from relight.srgb import decode

PIXELS = 2**20  # of the images that go through a network at once

Predictor = Callable[[int, np.ndarray], Inferred]  # (figure, lights (N,)) of a RelitSet -> what is inferred of them


def evaluate(checkpoint: Path, packed: Path, lights: Path, split: Path, settings: config.Evaluate, out: Path) -> None:
    """Scores a network on every test figure under every test light.

    The same inputs give the same bytes on the same machine: on a CPU one thread is used.

    Args:
        checkpoint: the network; its colour model is used.
        packed, lights, split: the data set (.safetensors, .npz, .json).
        settings: `figures`, the part of the split, and `lights`, the mark of the lights that relight them.
        out: the scores (.csv), under the stem of this path. Figures that sit, further views and unusual lights need
            not be there; the file then holds no scores.

    Raises:
        UserError: a file is not what it should be, or no figure or light is left to test on.
    """
    network, data = load(checkpoint, packed, lights, settings)
    if not has_pairs(data, split, settings):
        return write_scores(out, {})
    scores = score(lambda figure, lit: infer(network, data, figure, lit), data, split, settings)
    write_scores(out, {out.stem: scores})


def load(checkpoint: Path, packed: Path, lights: Path, settings: config.Evaluate) -> tuple[Network, RelitSet]:
    """Loads a network, and its data at its own order and in its own colour model.

    Args:
        checkpoint: the network (.safetensors).
        packed, lights: the data set.
        settings: `device`.

    Returns:
        The network, which knows what it has not learned (`Network.unlearned`), and the data.

    Raises:
        UserError: a file is not what it should be, or the maps have another size than the network was trained at.
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
    """Names those of albedo and light that no loss of a training constrains: the truth replaces their noise."""
    terms = {"albedo": ("albedo", "tv_albedo"), "light": ("light", "shading")}
    either = ("reconstruction", "reconstruction_full")
    return frozenset(name for name, own in terms.items() if loss and not any(loss[key] for key in (*own, *either)))


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
    """Chooses the pairs to test on.

    Args:
        data: figures and lights.
        split: the split (.json).
        lights: the mark of the lights.
        figures: the part of the split; `views` are the further views of the test figures.

    Returns:
        Indices of figures (F,) and of lights (L,).

    Raises:
        UserError: either is empty.
    """
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


def rows(data: RelitSet, figure: int) -> slice:
    """The rows of a figure's pixels in the arrays of the set."""
    start = int(data.offset[figure])
    return slice(start, start + int(data.counts[figure]))


def pixels(data: RelitSet, figure: int) -> np.ndarray:
    """Flat indices (P,) of a figure's pixels in its image."""
    return data.pixel[rows(data, figure)].cpu().numpy()


def dense(values: np.ndarray, pixel: np.ndarray, size: int) -> np.ndarray:
    """Puts values (P,C) at their pixels (P,) of an image (S,S,C), zero elsewhere."""
    image = np.zeros((size**2, values.shape[-1]), np.float32)
    image[pixel] = values
    return image.reshape(size, size, -1)


def score(predictor: Predictor, data: RelitSet, split: Path, settings: config.Evaluate) -> Scores:
    """The scores of a predictor on all test pairs; those of a figure are taken together, since they share its truth."""
    figures, lights = chosen_pairs(data, split, settings.lights, settings.figures)
    parts = [truth(data, f, lights).score(predictor(f, lights)) for f in progress(figures.tolist(), "figures scored")]
    columns = {name: np.stack([part[name] for part in parts]) for name in parts[0]}
    return Scores([data.names[f] for f in figures], lights.tolist(), columns)


def truth(data: RelitSet, figure: int, lights: np.ndarray) -> Truth:
    """The true maps of one figure of the set under `lights` (N,), in the set's colour model."""
    batch = data.batch(np.array([figure]), lights[:1])
    count = int(data.counts[figure])
    maps = {name: getattr(batch, name)[0, :count].cpu().numpy() for name in ("albedo", "normal", "ao")}
    return Truth(
        batch.pixel[:count].cpu().numpy(),
        data.transport[rows(data, figure)].float().cpu().numpy(),
        maps["albedo"],
        maps["normal"],
        maps["ao"][:, 0],
        data.lights[torch.as_tensor(lights, device=data.lights.device)].cpu().numpy(),
        data.size,
    )


@torch.inference_mode()
def infer(network: Network, data: RelitSet, figure: int, lights: np.ndarray) -> Inferred:
    """Infers maps and lights of one figure from its pictures under some lights.

    Args:
        network: in evaluation mode.
        data: its test set.
        figure: index of the figure.
        lights: (N,) indices of the lights.

    Returns:
        What is inferred under each; what no loss constrained is left out. SfSNet's transport is that of its normals
        without occlusion, with and without AO (the paper, Table 1).
    """
    count, step = int(data.counts[figure]), max(1, PIXELS // data.size**2)
    found: dict[str, list[np.ndarray]] = {}
    for start in range(0, len(lights), step):
        lit = lights[start : start + step]
        batch = data.batch(np.full(len(lit), figure), lit)
        for name, values in compact(network, batch).items():
            values = values if name == "light" else values[:, :count]
            found.setdefault(name, []).append(values.cpu().numpy())
    maps = {name: np.concatenate(parts) for name, parts in found.items() if name not in network.unlearned}
    ao = maps["ao"][..., 0] if "ao" in maps else None
    return Inferred(
        maps.get("albedo"),
        maps.get("transport"),
        maps.get("normal"),
        ao,
        maps.get("light"),
        occlude=ao is not None,
    )


def compact(network: Network, batch: Batch) -> dict[str, torch.Tensor]:
    """The network's maps on the in-mask pixels (B,P,C), its light (B,K,3), and the transport of its normals."""
    outputs = network(batch.image, batch.mask)
    light = outputs.pop("light").float()
    maps = {name: batch.take(dense) for name, dense in outputs.items()}
    if "transport" not in maps:
        maps["transport"] = unoccluded(maps["normal"], network.order)
    return {**maps, "light": light}


def inferred_maps(network: Network, data: RelitSet, light: int, true: Maps) -> Maps:
    """Infers the maps of a figure from its picture under one light.

    Args:
        network: of any kind; what no loss of its training constrained stays true.
        data: its test set.
        light: index of the light in the set.
        true: the figure's baked maps, whose info names it in the set.

    Returns:
        Maps with the mask of `true`. The albedo is linear: that of networks of `train.color=paper`, which take codes as
        linear values, is decoded. The ambient occlusion is that of the transport; normals that are not inferred are 0.
    """
    (figure,) = data.figures([true.info["name"]])
    inferred = infer(network, data, int(figure), np.array([light]))
    assert inferred.occluded_transport is not None  # every network infers transport
    transport = inferred.occluded_transport[0][:, : coefficient_count(2)]
    values = {"transport": transport, "ao": np.clip(transport[:, :1] / np.float64(UNOCCLUDED_T00), 0, 1)}
    if inferred.normal is not None:
        values["normal"] = inferred.normal[0]
    if inferred.albedo is not None:
        coded = np.clip(inferred.albedo[0], 0, 1)
        values["albedo"] = decode(coded) if data.color == "paper" else coded
    images = {name: dense(array, pixels(data, int(figure)), data.size) for name, array in values.items()}
    images["ao"] = images["ao"][..., 0]
    return replace(
        true,
        albedo=images.get("albedo", true.albedo),
        normal=images.get("normal", np.zeros_like(true.normal)),
        ao=images["ao"],
        transport=images["transport"],
        bounced=None,
    )
