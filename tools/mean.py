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
    """Writes the mean of two networks of the same form to `out`, with the settings of `end`."""
    (before, _), (after, settings) = load_network(start), load_network(end)
    weights = after.state_dict()
    for name, weight_before in before.state_dict().items():
        if weight_before.is_floating_point():  # the others are counts of batches
            weights[name] = (weights[name] + weight_before) / 2
    after.load_state_dict(weights)
    model = config.Model(**settings.pop("model"))
    kept = {key: value for key, value in settings.items() if key in ("loss", "train", "augment", "stages")}
    save_network(out, after, model, **kept, note="the mean of the weights before and after the last training")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("start", "end", "out"):
        parser.add_argument(name, type=Path)
    main(**vars(parser.parse_args()))
