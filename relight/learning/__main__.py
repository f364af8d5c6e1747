"""Trains a network from files; needs only torch, numpy, hydra and safetensors of this project's dependencies.

    python -m relight.learning --packed packed.safetensors --lights lights.npz --split split.json \\
        --out ours.safetensors scale=study model=ours loss=full train.seed=1
    torchrun --nproc-per-node 8 -m relight.learning ...        # the same on eight GPUs

The overrides are those of `relight run`. The losses (.csv) are written beside the network. So is the state (.state.pt)
from which the same command resumes; it is removed at the end.
"""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from relight.core.errors import UserError
from relight.learning.train import Inputs, Recipe, train
from relight.settings import composed


def main() -> None:
    """Trains a network from files, without the workflow: python -m relight.learning."""
    parser = argparse.ArgumentParser(
        "relight.learning", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    for name, description in (
        ("packed", "packed maps (.safetensors)"),
        ("lights", "light set (.npz)"),
        ("split", "split of the figures (.json)"),
        ("out", "network to write (.safetensors)"),
    ):
        parser.add_argument(f"--{name}", type=Path, required=True, help=description)
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="settings, as for relight run")
    options = parser.parse_intermixed_args()
    try:
        settings: Any = OmegaConf.to_object(composed(options.overrides))
        recipe = Recipe(settings.model, settings.loss, settings.train, settings.augment)
        stem = str(options.out).removesuffix(".safetensors")  # of net.s0, too, which with_suffix would make net
        state, curve = Path(f"{stem}.state.pt"), Path(f"{stem}.csv")
        train(recipe, Inputs(options.packed, options.lights, options.split), options.out, state, curve)
        if os.environ.get("RANK", "0") == "0":  # the process that wrote the outputs
            state.unlink(missing_ok=True)
    except UserError as error:
        sys.exit(f"relight.learning: {error}")


if __name__ == "__main__":
    main()
