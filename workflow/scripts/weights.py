"""Turns a network (`relight run experiment=photo`, or mean.py) into the weights that ship, with their card.

They are in half precision, with the lights of the training.

python workflow/scripts/weights.py results/photo [run]
"""

import csv
import json
import sys
from pathlib import Path

import numpy as np

from relight import config
from relight.learning.checkpoint import load_network, save_network
from relight.lights import read_light_set

OUT = Path(config.ROOT) / "relight" / "weights"
LIMIT = 16 * 2**20
CARD = """\
# Weights for photos

`photo.safetensors` is what `relight photo`, `relight view` and `relight.load()` use: {parameters:.1f} million
parameters in half precision.

| | |
|---|---|
| network | `{model}`, width {width}, {size} px |
| training | {training}; in {precision}{note} |
| lights | {lights} generated rooms |
| pictures | a camera's: linear light, exposed, clipped, 8-bit sRGB; augmented as docs/training.md says |
| held out | {test_figures} figures, {test_lights} lights |
| licence | Apache-2.0; the training data are generated from public-domain sources (docs/figures.md) |

Errors on what was held out (means over figures and lights; RMSE per pixel vector, as in docs/evaluation.md):

| shading | transport | albedo | light |
|---|---|---|---|
| {shading_rmse:.3f} | {transport_rmse:.3f} | {albedo_rmse:.3f} | {light_rmse:.3f} |

Limits: the figures are synthetic, in indoor light. The maps have {size} px: finer folds
of a photo stay in the picture by the `ratio` way of relighting, but they are not in the maps. How bright a scene is,
no photograph tells: albedo and light hold up to a factor. Back light, children, several touching people and props are
outside of what the network has seen; `relight photo` says so when the inferred light is unusual. It recognises nobody,
and no photo of a real person was used.

Made with the settings of `experiment=photo`, in the stages above, and `workflow/scripts/weights.py`. How its light
moves with framing, mask and white balance: `python benchmarks/invariance.py relight/weights/photo.safetensors`.
"""


def main(results: Path, run: str) -> None:
    network, made_with = load_network(results / "train" / f"{run}.safetensors")
    chosen = read_light_set(results / "lights" / "lights.npz")
    training = np.concatenate([chosen.of(mark).coefficients for mark in made_with["train"]["lights"]])
    model = config.Model(**made_with["model"])
    out = OUT / "photo.safetensors"
    split = json.loads((results / "split" / "subject.json").read_text())
    infos = json.loads((results / "figures.json").read_text())["figures"]
    generator = sorted({info["generator"] for info in infos.values() if "left_out" not in info})
    stages = lineage(made_with, {"figures": len(split["train"]), "generator": generator})
    rest = {key: made_with[key] for key in ("loss", "train", "augment", "note") if key in made_with}
    rest["train"] = {**rest["train"], "start": None}  # a path of this machine
    save_network(out, network, model, half=True, **rest, stages=stages, lights=np.round(training, 5).ravel().tolist())
    if out.stat().st_size > LIMIT:
        sys.exit(
            f"{out} has {out.stat().st_size / 2**20:.1f} MiB, over {LIMIT / 2**20:.0f}: give a smaller model.width"
        )
    with open(results / "evaluate" / f"{run}.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    names = ("shading_rmse", "transport_rmse", "albedo_rmse", "light_rmse")
    facts = {
        "precision": made_with["train"]["precision"],
        "note": f"; {made_with['note']}" if "note" in made_with else "",
        "parameters": sum(p.numel() for p in network.parameters()) / 1e6,
        "model": made_with["model"]["name"],
        "width": model.width,
        "size": network.size,
        "lights": len(training),
        "training": "; ".join(
            f"{stage['steps']:,} steps of {stage['batch']} images at {stage['size']} px, of {stage['figures']} figures "
            f"(generator version {' and '.join(map(str, stage['generator']))})"
            for stage in stages
        ),
        "test_figures": len({row["figure"] for row in rows}),
        "test_lights": len({row["light"] for row in rows}),
        **{name: np.mean([float(row[name]) for row in rows]) for name in names},
    }
    (OUT / "README.md").write_text(CARD.format(**facts))
    print(f"{out}: {out.stat().st_size / 2**20:.1f} MiB")


def lineage(config: dict, data: dict) -> list[dict]:
    """The trainings that led to a network, oldest first.

    Args:
        config: of the network.
        data: facts on the figures that it was trained on; the networks that it went on from are taken to have seen the
            same, unless their own config tells.
    """
    if "stages" in config:
        return config["stages"]
    start, own = config["train"]["start"], {key: config["train"][key] for key in ("steps", "batch")}
    before = lineage(load_network(start)[1], data) if start else []
    return [*before, {**own, "size": config["size"], **data}]


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "photo.s0")
