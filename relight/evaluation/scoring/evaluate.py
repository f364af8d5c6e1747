"""Scores a trained network, or a baseline, on every test figure under every test light."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from relight.core.errors import UserError
from relight.core.progress import progress
from relight.core.srgb import decode
from relight.evaluation.scoring.scores import Scores, write_scores
from relight.evaluation.scoring.truth import Inferred, Truth
from relight.learning.checkpoint import load_network
from relight.learning.data import RelitSet, choose_device, read_split
from relight.learning.harmonics import unoccluded
from relight.learning.networks import Network
from relight.maps import Maps
from relight.settings.schema import Loss, fields_by_key
from relight.settings.setting import setting_of
from relight.sh import UNOCCLUDED_T00, coefficient_count

BATCH_PIXELS = 2**20  # largest number of pixels of the images in a batch

Predictor = Callable[[int, np.ndarray], Inferred]  # (figure, lights (N,)), indices in a RelitSet -> prediction


def evaluate(checkpoint: Path, packed: Path, lights: Path, split: Path, condition: str, out: Path) -> None:
    """Scores a network on every figure under every light of a condition.

    The same inputs give the same bytes on the same machine, since one thread is used on a CPU.

    Args:
        checkpoint: the network, which also determines the color model.
        packed, lights, split: the data set (.safetensors, .npz, .json).
        condition: the figures and lights, as `select_pairs` takes them.
        out: the scores (.csv), whose predictor has the name of the file. If there are no sitting figures or
            unusual lights to score, the file has no rows.

    Raises:
        UserError: if a file has other contents, or there is no figure or light to test on.
    """
    network, data = load(checkpoint, packed, lights)
    write_all_scores({out.stem: partial(infer, network, data)}, data, split, condition, out)


def write_all_scores(predictors: dict[str, Predictor], data: RelitSet, split: Path, condition: str, out: Path) -> None:
    """Writes the scores of predictors, by name, on a condition; no rows if it has no figures or no lights."""
    figures, lights = select_pairs(data, split, condition)
    some = len(figures) and len(lights)
    write_scores(out, {name: score(predictor, data, figures, lights) for name, predictor in predictors.items() if some})


def load(checkpoint: Path, packed: Path, lights: Path) -> tuple[Network, RelitSet]:
    """Loads a network, and the data at its order and in its color model, on a GPU if there is one.

    On a CPU, torch is limited to one thread, so that scores are reproducible. `Network.unlearned` then has the outputs
    that no loss constrained.

    Raises:
        UserError: if a file has other contents, the network has no color model, or the maps have another size than
            the network.
    """
    device = choose_device("auto")
    if device.type == "cpu":
        torch.set_num_threads(1)
    network, config = load_network(checkpoint, device)
    network.unlearned = unlearned(config.get("loss"))
    if (color := (config.get("train") or {}).get("color")) is None:
        raise UserError(f"{checkpoint} does not say in which color model it was trained: train it again")
    data = RelitSet(packed, lights, network.order, color, device)
    if data.size != network.size:
        raise UserError(
            f"{checkpoint} was trained at {network.size} px and {packed} holds maps of {data.size} px: they must agree"
        )
    return network, data


def unlearned(loss: dict[str, Any] | None) -> frozenset[str]:
    """Returns which of albedo and light no loss of a training, by its settings, constrains; scores take the truth."""
    if not loss or any((loss.get("extra") or {}).values()):  # a loss of the user's may constrain anything
        return frozenset()
    used = (setting_of(field).teaches for key, field in fields_by_key(Loss) if loss.get(key))
    return frozenset({"albedo", "light"}.difference(*used))


def select_pairs(data: RelitSet, split: Path, condition: str = "test") -> tuple[np.ndarray, np.ndarray]:
    """Selects the figures (F,), seen from the front, and the lights (L,) to test on.

    There may be no sitting figures or unusual lights.

    Args:
        data: the data set.
        split: file with the names of the figures by part (.json).
        condition: a part of the split and a split of the light set, such as "sitting-test"; "test" is test figures
            under test lights.

    Raises:
        UserError: if there are no test figures or test lights, and the condition has them.
    """
    part, _, light_split = condition.partition("-")
    light_split = light_split or "test"
    figures = data.figures(read_split(split).get(part, []))
    lights = np.flatnonzero(data.light_split == light_split)
    for found, kind, what in ((figures, part, "figures"), (lights, light_split, "lights")):
        if kind == "test" and not len(found):
            raise UserError(f"nothing to evaluate: {split} gives 0 test {what} of the data set; at least one is needed")
    return figures, lights


def pixel_rows(data: RelitSet, figure: int) -> slice:
    """Returns the rows of a figure's pixels in the arrays of the set."""
    start = int(data.offset[figure])
    return slice(start, start + int(data.counts[figure]))


def pixels(data: RelitSet, figure: int) -> np.ndarray:
    """Returns the flat indices (P,) of a figure's pixels in its image."""
    return data.pixel[pixel_rows(data, figure)].cpu().numpy()


def dense(values: np.ndarray, pixel: np.ndarray, size: int) -> np.ndarray:
    """Returns an image (S,S,C) float32 with values (P,C) at pixels of flat indices (P,), and 0 at the others."""
    image = np.zeros((size**2, values.shape[-1]), np.float32)
    image[pixel] = values
    return image.reshape(size, size, -1)


def score(predictor: Predictor, data: RelitSet, figures: np.ndarray, lights: np.ndarray) -> Scores:
    """Scores a predictor on figures (F,) under lights (L,), at least one of each, by their indices."""
    scores = [truth(data, f, lights).score(predictor(f, lights)) for f in progress(figures.tolist(), "figures scored")]
    columns = {name: np.stack([part[name] for part in scores]) for name in scores[0]}
    return Scores([data.names[f] for f in figures], lights.tolist(), columns)


def truth(data: RelitSet, figure: int, lights: np.ndarray) -> Truth:
    """Returns the ground truth of a figure under lights (N,), by their indices, in the color model of the set."""
    batch = data.batch(np.array([figure]), lights[:1])
    count = int(data.counts[figure])
    maps = {name: getattr(batch, name)[0, :count].cpu().numpy() for name in ("albedo", "normal", "ao")}
    maps["transport"] = data.transport[pixel_rows(data, figure)].float().cpu().numpy()  # of all bands
    true_lights = data.lights[torch.as_tensor(lights, device=data.lights.device)].cpu().numpy()
    return Truth(pixels(data, figure), maps, true_lights, data.size)


@torch.inference_mode()
def infer(network: Network, data: RelitSet, figure: int, lights: np.ndarray) -> Inferred:
    """Infers maps and lights of a figure from its pictures under lights (N,), by their indices in the set.

    Outputs that no loss constrained are left out. For SfSNet and SfSNet-AO, transport is that of the normals without
    occlusion (the paper, Table 1).
    """
    count, batch_size = int(data.counts[figure]), max(1, BATCH_PIXELS // data.size**2)
    by_name: dict[str, list[np.ndarray]] = {}
    for start in range(0, len(lights), batch_size):
        batch_lights = lights[start : start + batch_size]
        batch = data.batch(np.full(len(batch_lights), figure), batch_lights)
        images = network(batch.image, batch.mask)
        values = {"light": images.pop("light").float()}
        values |= {name: batch.gather(image)[:, :count] for name, image in images.items()}
        if "transport" not in values:
            values["transport"] = unoccluded(values["normal"], network.order)
        for name, tensor in values.items():
            by_name.setdefault(name, []).append(tensor.cpu().numpy())
    outputs = {name: np.concatenate(batches) for name, batches in by_name.items() if name not in network.unlearned}
    known = {name: outputs.get(name) for name in ("albedo", "transport", "normal", "light")}
    return Inferred(**known, ao=outputs["ao"][..., 0] if "ao" in outputs else None, occlude="ao" in outputs)


def inferred_maps(network: Network, data: RelitSet, light: int, true: Maps) -> Maps:
    """Infers the maps of a figure from its picture under one light.

    Args:
        network: network of any kind; outputs that no loss constrained are replaced by the truth.
        data: its test set.
        light: index of the light in the set.
        true: the figure's baked maps, whose info names it in the set.

    Returns:
        Maps with the mask of `true`, linear albedo, the AO of the transport, and normals of 0 if they are
        not inferred.
    """
    (figure,) = data.figures([true.info["name"]])
    inferred = infer(network, data, int(figure), np.array([light]))
    assert inferred.occluded_transport is not None  # every network infers transport
    transport = inferred.occluded_transport[0][:, : coefficient_count(2)]  # pages have order 2
    values = {"transport": transport, "ao": np.clip(transport[:, :1] / np.float64(UNOCCLUDED_T00), 0, 1)}
    values["normal"] = np.zeros((len(transport), 3)) if inferred.normal is None else inferred.normal[0]
    if inferred.albedo is not None:
        coded = np.clip(inferred.albedo[0], 0, 1)
        values["albedo"] = decode(coded) if data.color == "paper" else coded
    place = pixels(data, int(figure))
    images: dict[str, Any] = {name: dense(array, place, data.size) for name, array in values.items()}
    images["ao"] = images["ao"][..., 0]
    return replace(true, **images, bounced=None)
