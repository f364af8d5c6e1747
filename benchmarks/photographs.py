"""Measures errors of networks for photographs on test figures: on relit pictures, and on augmented ones.

    python benchmarks/photographs.py results/photo relight/weights/photo.onnx [other.onnx ...]
    python benchmarks/photographs.py results/held results/photo/train/state/photo.s0/state.pt ... --all

The first argument is a folder of `relight run experiment=photo`: its packed set, lights and split. A network may also
be the state of a training of this experiment that still runs. Each test figure (with --all, each figure) is seen under
three test lights. "Photographs" have the framing, masks, exposures and camera of augment=photo; "and tints" also its
white balances and recolored clothes; "and gloss" also glossy materials in each picture. Light errors are relative
errors of irradiance; others are RMSE of vectors in the mask. Columns with a star are after the best factor for each
picture, since a photograph does not determine a scene's brightness. Detail is the energy of the error's detail over the
truth's (`losses.detail`): 1 for maps without detail; that of shading is under the true light. Each network after the
first has a second row: its differences from the first, and half their 95 % intervals over the figures.

A second table has R² of transport (over pixels) and light (over pictures) by band, on "photographs": the share of the
variance about the mean coefficients that is inferred; 0 for these means, negative if worse.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from omegaconf import OmegaConf
from scipy.stats import sem, t

from relight.evaluation.scoring import metrics
from relight.learning.augment import augment_batch
from relight.learning.checkpoint import load_network
from relight.learning.color import shade
from relight.learning.data import Batch, RelitSet, read_split
from relight.learning.losses import detail
from relight.learning.networks import Network, build
from relight.learning.training_name import TrainingName
from relight.settings import composed

PHOTOGRAPHS = ["train.color=photo", "augment=photo"]
KINDS = {
    "as relit": ["train.color=photo", "augment=none"],
    "photographs": [*PHOTOGRAPHS, "augment.tint=0", "augment.recolor=0", "augment.prints=0", "augment.gloss=0"],
    "and tints": [*PHOTOGRAPHS, "augment.gloss=0"],
    "and gloss": [*PHOTOGRAPHS, "augment.gloss=1"],
}
LIGHTS_PER_FIGURE = 3
COLUMNS = ("light", "light*", "albedo", "albedo*", "transport", "shading", "shading*")
DETAILS = ("albedo", "transport", "shading")


@torch.inference_mode()
def inferred(
    network: torch.nn.Module, data: RelitSet, figures: np.ndarray, kind: list[str]
) -> Iterator[tuple[Batch, dict[str, torch.Tensor], torch.Tensor]]:
    """Yields the pictures of each figure (F,) of a kind, their inferred maps at the pixels, and their lights."""
    settings = OmegaConf.to_object(composed(kind).augment)
    test_lights = np.flatnonzero(data.light_split == "test")
    for i, figure in enumerate(figures):
        spread = i + np.arange(LIGHTS_PER_FIGURE) * len(test_lights) // LIGHTS_PER_FIGURE
        lit = test_lights[spread % len(test_lights)]
        generators = [np.random.default_rng([i, j]) for j in range(LIGHTS_PER_FIGURE)]
        batch = augment_batch(data.batch(np.full(LIGHTS_PER_FIGURE, figure), lit), settings, generators, network.size)
        outputs = network(batch.image, batch.mask)
        light = outputs.pop("light") / batch.exposure[:, None, None]
        yield batch, {name: batch.gather(dense) for name, dense in outputs.items()}, light


def explained(network: torch.nn.Module, data: RelitSet, figures: np.ndarray) -> dict[str, list[float]]:
    """Returns R² of transport and light by band, 0 first, on the "photographs" of figures (F,)."""
    found, true = ({"transport": [], "light": []} for _ in range(2))
    for batch, maps, light in inferred(network, data, figures, KINDS["photographs"]):
        inside = batch.inside[..., 0] > 0
        for into, transport, lights in ((found, maps["transport"], light), (true, batch.transport, batch.light)):
            into["transport"].append(transport[inside].numpy())  # (pixels, K)
            into["light"].append(lights.transpose(1, 2).reshape(-1, lights.shape[1]).numpy())  # (pictures x 3, K)
    bands = np.floor(np.sqrt(np.arange(true["light"][0].shape[1]))).astype(int)
    table = {}
    for name in found:
        told, truth = (np.concatenate(side[name]).astype(float) for side in (found, true))
        lost, spread = ((told - truth) ** 2).sum(0), ((truth - truth.mean(0)) ** 2).sum(0)
        table[name] = [1 - lost[bands == band].sum() / spread[bands == band].sum() for band in range(bands[-1] + 1)]
    return table


@torch.inference_mode()
def errors(network: torch.nn.Module, data: RelitSet, figures: np.ndarray, kind: list[str]) -> np.ndarray:
    """Measures the errors of a network on pictures of a kind.

    Args:
        network: for photographs.
        data: figures and lights.
        figures: (F,) indices of the figures.
        kind: settings of the pictures, a value of KINDS.

    Returns:
        (F, columns) means over the lights: those of COLUMNS, then the energies of DETAILS.
    """
    means = []
    for batch, maps, light in inferred(network, data, figures, kind):
        maps["shading"] = shade(maps["transport"], batch.light)  # under the true light, for its detail
        true = {name: getattr(batch, name) for name in DETAILS}
        energies = [detail(maps[name] - true[name], true[name], batch) for name in DETAILS]
        maps["shading"] = shade(maps["transport"], light)
        rows = []
        for j in range(LIGHTS_PER_FIGURE):
            inside = batch.inside[j, :, 0] > 0
            lights = light[j].numpy(), batch.light[j].numpy()
            row = [metrics.irradiance_error(*lights), metrics.scaled_irradiance_error(*lights)]
            for name in ("albedo", "transport", "shading"):
                pair = maps[name][j][inside].numpy(), getattr(batch, name)[j][inside].numpy()
                row += [metrics.rmse(*pair), *([metrics.scaled_rmse(*pair)] if name != "transport" else [])]
            rows.append(row)
        means.append([*np.mean(rows, 0), *energies])
    return np.array(means, float)


def network_of(path: Path) -> Network:
    """Returns the network of a file, or of the state of a training of `experiment=photo`: its moving average."""
    if path.suffix != ".pt":
        return load_network(path)[0]
    row = composed(["experiment=photo"]).sweep.rows[TrainingName.parse(path.parent.name).row]
    settings = composed(["experiment=photo", *row])
    network = build(OmegaConf.to_object(settings.model), settings.train.size or settings.bake.size)
    network.load_state_dict(torch.load(path, weights_only=True)["average"])
    return network.eval()


def main() -> None:
    """Prints a row for each kind of pictures and each network."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("weights", type=Path, nargs="+")
    parser.add_argument("--kinds", choices=KINDS, nargs="+", default=list(KINDS), help="of pictures; by default all")
    parser.add_argument("--all", action="store_true", help="of a set that no training has seen, take all figures")
    args = parser.parse_args()
    torch.set_num_threads(1)
    columns = [*COLUMNS, *(f"detail of {name}" for name in DETAILS)]
    print("| pictures | weights | " + " | ".join(columns) + " |\n|---|---|" + "---|" * len(columns))
    tested = {}
    for path in args.weights:
        network = network_of(path)
        data = RelitSet(
            args.results / "packed.safetensors", args.results / "lights" / "lights.npz", network.order, "photo"
        )
        if args.all:
            names = sorted(set(data.figure_of))  # from the front, in the first outfit
        else:
            names = read_split(args.results / "split.json")["test"]
        tested[path] = network, data, data.figures(names)
    for title in args.kinds:
        first = None
        for path, given in tested.items():
            rows = errors(*given, KINDS[title])
            print(f"| {title} | {path} | " + " | ".join(f"{value:.3f}" for value in rows.mean(0)) + " |")
            if first is None:
                first = rows
                continue
            change = rows - first
            margins = sem(change) * t.ppf(0.975, len(change) - 1)
            shown = (f"{mean:+.3f} ± {margin:.3f}" for mean, margin in zip(change.mean(0), margins))
            print("| | minus the first | " + " | ".join(shown) + " |")
    print("\n| R² of | weights | bands from 0 |\n|---|---|---|")
    for path, given in tested.items():
        for name, bands in explained(*given).items():
            print(f"| {name} | {path} | " + ", ".join(f"{value:.2f}" for value in bands) + " |")


if __name__ == "__main__":
    main()
