"""Widens a U-Net (`model.width`) without changing what it computes, to go on training it as the start of another.

python tools/widen.py start.safetensors 0.6 out.safetensors

The new channels are random, and nothing reads them until a training lets it (Net2Net, Chen et al. 2016).
"""

import argparse
from dataclasses import replace
from pathlib import Path

import torch

from relight import config
from relight.learning.checkpoint import load_network, save_network
from relight.learning.networks import build

SEED = 5  # of the new channels
FINEST = 4  # channels of the picture and the mask, which the last convolution sees beside the features


def main(start: Path, width: float, out: Path) -> None:
    """Writes the network `start`, at least as wide as before, to `out`."""
    old, settings = load_network(start)
    model = config.Model(**settings["model"])
    torch.manual_seed(SEED)
    new = build(replace(model, width=width), settings["size"])
    weights = new.state_dict()
    for name, before in old.state_dict().items():
        weight = weights[name]
        if before.shape == weight.shape:
            weight.copy_(before)
            continue
        if before.dim() == 1:  # scales, biases and statistics
            weight[: len(before)] = before
            continue
        inputs, wider = [before.shape[1]], [weight.shape[1]]
        if name.startswith("decoder.") and name.endswith(".0.0.weight"):  # features from below, and those beside them
            inputs, wider = ([size // 2] * 2 for size in (inputs[0], wider[0]))
        elif name == "sharpen.weight":
            inputs, wider = ([size - FINEST, FINEST] for size in (inputs[0], wider[0]))
        rows = len(before)
        weight[:rows] = 0
        source = target = 0
        for count, room in zip(inputs, wider):
            weight[:rows, target : target + count] = before[:, source : source + count]
            source, target = source + count, target + room
    new.load_state_dict(weights)
    kept = {key: value for key, value in settings.items() if key in ("loss", "train", "augment", "stages")}
    save_network(out, new.eval(), replace(model, width=width), **kept)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("start", type=Path)
    parser.add_argument("width", type=float)
    parser.add_argument("out", type=Path)
    main(**vars(parser.parse_args()))
