"""Scores a trained network, or a baseline, on every test figure under every test light."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from relight.config.schema import PARTS, SCORED_LIGHTS, Loss, fields_by_key
from relight.config.setting import setting_of
from relight.errors import UserError
from relight.evaluation.scoring.scores import Scores, write_scores
from relight.evaluation.scoring.truth import Inferred, Truth
from relight.learning.checkpoint import load_network
from relight.learning.data import Batch, RelitSet, choose_device, read_split
from relight.learning.harmonics import unoccluded
from relight.learning.networks import Network
from relight.maps import Maps
from relight.progress import progress
from relight.sh import UNOCCLUDED_T00, coefficient_count
from relight.srgb import decode

BATCH_PIXELS = 2**20  # largest number of pixels of the images in a batch

Predictor = Callable[[int, np.ndarray], Inferred]  # (figure, lights (N,)), indices in a RelitSet -> prediction


@dataclass(frozen=True)
class Condition:
    """What predictors are scored on.

    Attributes:
        figures: part of the split, one of PARTS; `views` are the further views of the test figures.
        lights: split of the light set, one of SCORED_LIGHTS.
    """

    figures: str = "test"
    lights: str = "test"

    @classmethod
    def parse(cls, text: str) -> "Condition":
        """Parses the name of a condition: test, or FIGURES-LIGHTS. Raises UserError if it is none.

        >>> Condition.parse("sitting-test")
        Condition(figures='sitting', lights='test')
        """
        figures, _, lights = text.partition("-")
        condition = cls(figures, lights or "test")
        if condition.figures not in PARTS or condition.lights not in SCORED_LIGHTS:
            raise UserError(
                f"condition {text}: must be FIGURES-LIGHTS, with figures {', '.join(PARTS)} and lights "
                f"{', '.join(SCORED_LIGHTS)}"
            )
        return condition


TEST = Condition()


def evaluate(checkpoint: Path, packed: Path, lights: Path, split: Path, condition: Condition, out: Path) -> None:
    """Scores a network on every figure under every light of a condition.

    The same inputs give the same bytes on the same machine, since one thread is used on a CPU.

    Args:
        checkpoint: the network, which also determines the color model.
        packed, lights, split: the data set (.safetensors, .npz, .json).
        condition: the figures and lights.
        out: the scores (.csv), whose predictor has the name of the file. If there are no sitting figures, further views
            or unusual lights to score, the file has no rows.

    Raises:
        UserError: if a file has other contents, or there is no figure or light to test on.
    """
    network, data = load(checkpoint, packed, lights)
    if not has_pairs(data, split, condition):
        return write_scores(out, {})
    write_scores(out, {out.stem: score(partial(infer, network, data), data, split, condition)})


def load(checkpoint: Path, packed: Path, lights: Path) -> tuple[Network, RelitSet]:
    """Loads a network, and the data at its order and in its color model, on a GPU if there is one.

    On a CPU, torch is limited to one thread, so that scores are reproducible.

    Args:
        checkpoint: the network (.safetensors).
        packed, lights: the data set.

    Returns:
        The network, with the outputs that no loss constrained in `Network.unlearned`, and the data.

    Raises:
        UserError: if a file has other contents, the network has no color model, or the maps have another size than
            the network.
    """
    device = choose_device("auto")
    if device.type == "cpu":
        torch.set_num_threads(1)
    network, config = load_network(checkpoint, device)
    network.unlearned = unlearned(config.get("loss"))
    color = (config.get("train") or {}).get("color")
    if color is None:
        raise UserError(f"{checkpoint} does not say in which color model it was trained: train it again")
    data = RelitSet(packed, lights, network.order, color, device)
    if data.size != network.size:
        raise UserError(
            f"{checkpoint} was trained at {network.size} px and {packed} holds maps of {data.size} px: they must agree"
        )
    return network, data


def unlearned(loss: dict[str, Any] | None) -> frozenset[str]:
    """Returns which of albedo and light no loss of a training constrains; the scores replace them by the truth.

    Args:
        loss: the settings of the group `loss`; None for a network that does not tell them.
    """
    if not loss or any((loss.get("extra") or {}).values()):  # a loss of the user's may constrain anything
        return frozenset()
    used = (setting_of(field).teaches for key, field in fields_by_key(Loss) if loss.get(key))
    return frozenset({"albedo", "light"}.difference(*used))


def select_pairs(data: RelitSet, split: Path, condition: Condition = TEST) -> tuple[np.ndarray, np.ndarray]:
    """Selects the figures and lights to test on.

    Args:
        data: figures and lights.
        split: the split (.json).
        condition: the figures and lights.

    Returns:
        Indices of figures (F,) and of lights (L,).

    Raises:
        UserError: if either is empty.
    """
    figure_indices = select_figures(data, split, condition.figures)
    light_indices = np.flatnonzero(data.light_split == condition.lights)
    if not len(figure_indices) or not len(light_indices):
        raise UserError(
            f"nothing to evaluate: {len(figure_indices)} {condition.figures} figures of {split} are in the packed set "
            f"and {len(light_indices)} lights are marked {condition.lights}; at least one of each is needed"
        )
    return figure_indices, light_indices


def select_figures(data: RelitSet, split: Path, figures: str) -> np.ndarray:
    """Returns the indices (F,) of the figures of a part of a split, seen from the front.

    Args:
        data: figures and lights.
        split: the split (.json).
        figures: one of PARTS; for `views` the result is the other views of the test figures.
    """
    parts = read_split(split)
    if figures != "views":
        return data.figures(parts.get(figures, []))
    others = data.other_views(data.figures(parts["test"]))
    return others[data.has_view[others]]


def has_pairs(data: RelitSet, split: Path, condition: Condition) -> bool:
    """Returns whether there are figures and lights of a condition in the data.

    Test figures and test lights are taken for granted: if they are missing, `select_pairs` raises an error.

    Args:
        data: figures and lights.
        split: the split (.json).
        condition: the figures and lights.
    """
    has_figures = condition.figures == "test" or len(select_figures(data, split, condition.figures)) > 0
    return has_figures and (condition.lights != "unusual" or bool((data.light_split == "unusual").any()))


def pixel_rows(data: RelitSet, figure: int) -> slice:
    """Returns the rows of a figure's pixels in the arrays of the set."""
    start = int(data.offset[figure])
    return slice(start, start + int(data.counts[figure]))


def pixels(data: RelitSet, figure: int) -> np.ndarray:
    """Returns the flat indices (P,) of a figure's pixels in its image."""
    return data.pixel[pixel_rows(data, figure)].cpu().numpy()


def dense(values: np.ndarray, pixel: np.ndarray, size: int) -> np.ndarray:
    """Returns an image (S,S,C) float32 with values at some pixels, and 0 at the others.

    Args:
        values: (P,C).
        pixel: (P,) flat indices of the pixels in the image.
        size: S.
    """
    image = np.zeros((size**2, values.shape[-1]), np.float32)
    image[pixel] = values
    return image.reshape(size, size, -1)


def score(predictor: Predictor, data: RelitSet, split: Path, condition: Condition) -> Scores:
    """Scores a predictor on every figure under every light of a condition.

    Args:
        predictor: a network or a baseline.
        data: figures and lights.
        split: the split (.json).
        condition: the figures and lights.

    Raises:
        UserError: if there is no figure or no light.
    """
    figures, lights = select_pairs(data, split, condition)
    scores = [truth(data, f, lights).score(predictor(f, lights)) for f in progress(figures.tolist(), "figures scored")]
    columns = {name: np.stack([part[name] for part in scores]) for name in scores[0]}
    return Scores([data.names[f] for f in figures], lights.tolist(), columns)


def truth(data: RelitSet, figure: int, lights: np.ndarray) -> Truth:
    """Returns the ground truth of a figure under some lights, in the color model of the set.

    Args:
        data: figures and lights.
        figure: index of the figure.
        lights: (N,) indices of the lights.
    """
    batch = data.batch(np.array([figure]), lights[:1])
    count = int(data.counts[figure])
    maps = {name: getattr(batch, name)[0, :count].cpu().numpy() for name in ("albedo", "normal", "ao")}
    return Truth(
        pixel=batch.pixel[:count].cpu().numpy(),
        transport=data.transport[pixel_rows(data, figure)].float().cpu().numpy(),
        albedo=maps["albedo"],
        normal=maps["normal"],
        ao=maps["ao"][:, 0],
        lights=data.lights[torch.as_tensor(lights, device=data.lights.device)].cpu().numpy(),
        size=data.size,
    )


@torch.inference_mode()
def infer(network: Network, data: RelitSet, figure: int, lights: np.ndarray) -> Inferred:
    """Infers maps and lights of a figure from its pictures under some lights.

    Args:
        network: in evaluation mode.
        data: its test set.
        figure: index of the figure.
        lights: (N,) indices of the lights.

    Returns:
        The prediction under each light, without outputs that no loss constrained. For SfSNet and SfSNet-AO, transport
        is that of the normals without occlusion (the paper, Table 1).
    """
    count, batch_size = int(data.counts[figure]), max(1, BATCH_PIXELS // data.size**2)
    by_name: dict[str, list[np.ndarray]] = {}
    for start in range(0, len(lights), batch_size):
        batch_lights = lights[start : start + batch_size]
        batch = data.batch(np.full(len(batch_lights), figure), batch_lights)
        for name, values in compact(network, batch).items():
            values = values if name == "light" else values[:, :count]
            by_name.setdefault(name, []).append(values.cpu().numpy())
    outputs = {name: np.concatenate(batches) for name, batches in by_name.items() if name not in network.unlearned}
    return Inferred(
        albedo=outputs.get("albedo"),
        transport=outputs.get("transport"),
        normal=outputs.get("normal"),
        ao=outputs["ao"][..., 0] if "ao" in outputs else None,
        light=outputs.get("light"),
        occlude="ao" in outputs,
    )


def compact(network: Network, batch: Batch) -> dict[str, torch.Tensor]:
    """Runs a network on a batch.

    Returns:
        The maps that it infers, (B,P,C) at the P pixels of the mask, and `light` (B,K,3). If it infers no transport,
        `transport` is that of its normals without occlusion.
    """
    outputs = network(batch.image, batch.mask)
    light = outputs.pop("light").float()
    maps = {name: batch.gather(dense) for name, dense in outputs.items()}
    if "transport" not in maps:
        maps["transport"] = unoccluded(maps["normal"], network.order)
    return {**maps, "light": light}


def inferred_maps(network: Network, data: RelitSet, light: int, true: Maps) -> Maps:
    """Infers the maps of a figure from its picture under one light.

    Args:
        network: network of any kind; outputs that no loss constrained are replaced by the truth.
        data: its test set.
        light: index of the light in the set.
        true: the figure's baked maps, whose info names it in the set.

    Returns:
        Maps with the mask of `true`. The albedo is linear; that of networks with `train.color=paper` is decoded. The
        ambient occlusion is that of the transport. Normals are 0 if they are not inferred.
    """
    (figure,) = data.figures([true.info["name"]])
    inferred = infer(network, data, int(figure), np.array([light]))
    assert inferred.occluded_transport is not None  # every network infers transport
    transport = inferred.occluded_transport[0][:, : coefficient_count(2)]  # pages have order 2
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
