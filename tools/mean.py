"""Averages the weights of a network and of the network from which its training started.

python tools/mean.py start.safetensors end.safetensors out.safetensors packed.safetensors lights.npz split.json

Such an average often has smaller errors on pictures that differ from those of the last training (Wortsman et al. 2022,
Robust Fine-Tuning of Zero-Shot Models). The statistics of its batch normalisation are those of its own activations on
training pictures (Izmailov et al. 2018, Averaging Weights Leads to Wider Optima). Settings are those of the end.
"""

import argparse
from pathlib import Path

import torch
from torch.nn.modules.batchnorm import _BatchNorm

from relight import config
from relight.learning.checkpoint import load_network, save_network
from relight.learning.data import RelitSet
from relight.learning.train import Recipe, draw_batch, select_training_data

BATCHES = 200  # of the last training's size, for the statistics
SEED = 1  # of their pictures


def main(start: Path, end: Path, out: Path, packed: Path, lights: Path, split: Path, share: float) -> None:
    """Writes `share` of the network `end` and the rest of `start` to `out`; the files are those of the training."""
    (before, _), (network, settings) = load_network(start), load_network(end)
    weights = network.state_dict()
    for name, weight in before.state_dict().items():
        if weight.is_floating_point():  # the others are counts of batches
            weights[name] = torch.lerp(weight, weights[name], share)
    network.load_state_dict(weights)
    groups = {"model": config.Model, "loss": config.Loss, "train": config.Train, "augment": config.Augment}
    recipe = Recipe(**{name: group(**settings[name]) for name, group in groups.items()})
    recipe.train.seed = SEED
    data = RelitSet(packed, lights, recipe.model.order, recipe.train.color)
    figures, lit = select_training_data(data, split, recipe.train)
    layers = [module for module in network.eval().modules() if isinstance(module, _BatchNorm)]
    for layer in layers:
        layer.reset_running_stats()
        layer.momentum = None  # the mean over all batches
        layer.train()
    with torch.no_grad():
        for step in range(BATCHES):
            batch = draw_batch(data, figures, lit, recipe, step, 0, 1)
            network(batch.image, batch.mask)
    note = f"then the mean of the weights before, {1 - share:g}, and after, {share:g}"
    kept = {key: value for key, value in settings.items() if key in ("loss", "train", "augment", "stages")}
    save_network(out, network, recipe.model, **kept, note=note)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("start", "end", "out", "packed", "lights", "split"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--share", type=float, default=0.5, help="of the end")
    main(**vars(parser.parse_args()))
