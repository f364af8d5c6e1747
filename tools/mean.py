"""Averages a U-Net for photos and those that went on from it, perhaps at a higher order: the weights that ship.

python tools/mean.py results/photo4 out.onnx start.onnx end.onnx [end.safetensors ...]

`results/photo4` is the folder of the run whose data the others were trained on. Such an average often has smaller
errors on pictures that differ from those of the last training (Wortsman et al. 2022, Robust Fine-Tuning of Zero-Shot
Models). Bands that the first lacks are those of the others' mean. The statistics of the batch normalisation are those
of the average's own activations on training pictures (Izmailov et al. 2018, Averaging Weights Leads to Wider Optima).
The header of what ships also got, by hand, the stages that the others lack.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from torch.nn.modules.batchnorm import _BatchNorm

from relight import settings as config
from relight.learning.checkpoint import load_network
from relight.learning.data import RelitSet
from relight.learning.export import export
from relight.learning.networks import UNet, widened
from relight.learning.train import Recipe, draw_batch, select_training_data
from relight.lights import read_light_set

SHARE = 0.7  # of the mean of those that went on
SETTINGS = {"rescale": 0.5, "rebalance": 0.4}  # of its inference
TRUST = -0.5  # added to that of its refinement, which learned to trust the head without the image's factor
BATCHES = 200  # for the statistics
GROUPS = {"model": config.Model, "loss": config.Loss, "train": config.Train, "augment": config.Augment}


def main(results: Path, out: Path, start: Path, *ends: Path) -> None:
    """Writes the average to `out`."""
    before, old = load_network(start)
    further, settings = zip(*map(load_network, ends))
    network, kept = further[-1], {name: settings[-1][name] for name in GROUPS}
    assert isinstance(network, UNet)
    weights, first = network.state_dict(), widened(before.state_dict(), network)
    known = widened({name: torch.ones_like(values) for name, values in before.state_dict().items()}, network)
    for name, values in first.items():
        if values.is_floating_point():  # the others are counts of batches
            mean = torch.stack([each.state_dict()[name] for each in further]).mean(0)
            weights[name] = torch.where(known[name] > 0, torch.lerp(values, mean, SHARE), mean)
    network.load_state_dict(weights)
    kept["train"] |= {"start": None, "seed": 1}
    measure_statistics(network, results, Recipe(**{name: group(**kept[name]) for name, group in GROUPS.items()}))
    assert network.refinement is not None
    network.refinement.trust.data += TRUST
    network.refinement.rescale, network.rebalance = SETTINGS.values()
    kept["model"] |= SETTINGS
    lights = read_light_set(results / "lights" / "lights.npz").of("train").coefficients
    kept |= {key: settings[0].get(key, old.get(key)) for key in ("note", "stages")}
    export(network, out, {**kept, "lights": np.round(lights.astype(float), 5).ravel().tolist()})


def measure_statistics(network: UNet, results: Path, recipe: Recipe) -> None:
    """Measures the statistics of the batch normalisation anew, on pictures of a training."""
    data = RelitSet(results / "packed.safetensors", results / "lights" / "lights.npz", network.order, "photo")
    figures, lights = select_training_data(data, results / "split.json", recipe.train)
    layers = [module for module in network.eval().modules() if isinstance(module, _BatchNorm)]
    for layer in layers:
        layer.reset_running_stats()
        layer.momentum = None  # the mean over all batches
        layer.train()
    with torch.no_grad():
        for step in range(BATCHES):
            batch = draw_batch(data, figures, lights, recipe, step, 0, 1)
            network(batch.image, batch.mask)
    network.eval()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
