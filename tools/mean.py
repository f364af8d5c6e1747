"""Averages the weights of a network and of the network from which its training started.

python tools/mean.py start.safetensors end.safetensors out.safetensors

Such averages often have smaller errors on pictures that differ from those of the last training (Wortsman et al. 2022,
Robust Fine-Tuning of Zero-Shot Models). Settings are those of the end.
"""

import argparse
from pathlib import Path

from relight import config
from relight.learning.checkpoint import load_network, save_network


def main(start: Path, end: Path, out: Path) -> None:
    (first, _), (last, made_with) = load_network(start), load_network(end)
    weights = last.state_dict()
    for name, other in first.state_dict().items():
        if other.is_floating_point():  # the others are counts of batches
            weights[name] = (weights[name] + other) / 2
    last.load_state_dict(weights)
    model = config.Model(**made_with.pop("model"))
    rest = {key: value for key, value in made_with.items() if key in ("loss", "train", "augment", "stages")}
    save_network(out, last, model, **rest, note="the mean of the weights before and after the last training")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("start", "end", "out"):
        parser.add_argument(name, type=Path)
    main(**vars(parser.parse_args()))
