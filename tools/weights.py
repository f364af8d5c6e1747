"""Turns the network of `relight run experiment=photo` into the weights that ship, with their card.

They are in half precision, with the lights of the training.

python tools/weights.py results/photo [run]
"""

import csv
import json
import sys
from pathlib import Path

import numpy as np

from relight import settings as config
from relight.core.files import atomic_write
from relight.learning.checkpoint import load_network
from relight.learning.export import export
from relight.lights import read_light_set

OUT = Path(config.ROOT) / "relight" / "weights"
LIMIT = 16 * 2**20  # bytes of the weights
SCORES = ("shading_rmse", "transport_rmse", "albedo_rmse", "light_rmse")  # that the card tells
CARD = """\
---
license: cc0-1.0
library_name: onnx
pipeline_tag: image-to-image
tags:
- relighting
- inverse-rendering
- intrinsic-images
- albedo
- light-estimation
- human
- synthetic-data
model-index:
- name: relight photo
  results:
  - task: {{type: image-to-image, name: inverse rendering of people}}
    dataset: {{type: generated, name: {test_figures} held-out figures under {test_lights} lights}}
    metrics:
    - {{type: rmse, name: shading, value: {shading_rmse:.3f}}}
    - {{type: rmse, name: transport, value: {transport_rmse:.3f}}}
    - {{type: rmse, name: albedo, value: {albedo_rmse:.3f}}}
    - {{type: rmse, name: light, value: {light_rmse:.3f}}}
---
# Weights for photos

`photo.onnx` holds the weights that `relight photo`, `relight view` and `relight.load()` use by default:
{parameters:.1f} million parameters in half precision.

| | |
|---|---|
| network | `{model}`, width {width}, {size} px |
| training | in the stages listed below |
| training lights | {lights} generated rooms, skies and studios |
| training pictures | like a camera's: linear light, exposed, clipped, 8-bit sRGB; augmented as docs/training.md says |
| held out | {test_figures} figures, {test_lights} lights |

Errors on the held-out figures and lights (means; RMSE per pixel vector, as defined in docs/training.md):

| shading | transport | albedo | light |
|---|---|---|---|
| {shading_rmse:.3f} | {transport_rmse:.3f} | {albedo_rmse:.3f} | {light_rmse:.3f} |

What a card of an open model answers:

| | |
|---|---|
| licence of the weights | CC0-1.0 (`NOTICE`) |
| training data | generated figures and lights; nobody was scanned or photographed |
| provenance of the data | MakeHuman's bodies (CC0); all else relight's code (docs/figures.md) |
| licence of the data | CC0-1.0; whoever runs relight makes them again from integer seeds |
| training code | `relight.learning`, Apache-2.0 |
| Open Source AI Definition 1.0 | has its three parts: code, weights, data to make again (our reading, not certified) |
| Model Openness Framework | class I but for a paper; docs/lab/weights.md is the report (our reading, not certified) |
| published research | the method: Kanamori & Endo 2018, doi 10.1145/3272127.3275104 |
| reproducibility | one command, from seeds: `relight run experiment=photo` |
| inference | local, on a CPU, by onnxruntime; nothing is sent |
| intended for | relighting photographs of people, albedo and light for compositing, baselines for research |
| not for | measuring skin, identifying people, evidence: maps are inferred, and wrong by the errors above |

Limits:

- The training figures are synthetic.
- The maps have {size} px. Finer folds are not in them, but mode `ratio`, the default, keeps such folds, because it
  multiplies the photo itself.
- A photograph does not tell how bright its scene is, so albedo and light are known only up to a factor.
- Back light, children, several touching people, and props other than phones, cups, bags and stools are outside of what
  the network has seen. `relight photo` warns when the inferred light is unusual.
- The network recognises nobody, and was trained on no photo of a real person.

Stages of the training, each continuing the one before:

{training}

Made by `relight run experiment=photo` and `tools/weights.py`. How the inferred light
changes with framing, mask and white balance: `python benchmarks/invariance.py relight/weights/photo.onnx`.
"""


def main(results: Path, training: str) -> None:
    """Writes the weights and their card.

    Args:
        results: folder of the run.
        training: name of the training.
    """
    network, settings = load_network(results / "train" / f"{training}.safetensors")
    light_set = read_light_set(results / "lights" / "lights.npz")
    lights = np.concatenate([light_set.of(split).coefficients for split in settings["train"]["lights"]])
    split = json.loads((results / "split.json").read_text())
    infos = json.loads((results / "figures.json").read_text())["figures"]
    generator = sorted({info["generator"] for info in infos.values() if "left_out" not in info})
    stages = lineage(settings, {"figures": len(split["train"]), "generator": generator})
    kept = {key: settings[key] for key in ("model", "loss", "train", "augment")}
    kept["train"] = {**kept["train"], "start": None}  # a path of this machine
    out = OUT / "photo.onnx"
    new = out.with_suffix(".new.onnx")
    export(network, new, {**kept, "stages": stages, "lights": np.round(lights.astype(float), 5).ravel().tolist()})
    if (size := new.stat().st_size) > LIMIT:
        new.unlink()
        sys.exit(f"the weights have {size / 2**20:.1f} MiB, over {LIMIT / 2**20:.0f}: give a smaller model.width")
    with open(results / "evaluate" / f"{training}.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    facts = {
        "parameters": sum(weights.numel() for weights in network.parameters()) / 1e6,
        "model": settings["model"]["name"],
        "width": config.Model(**settings["model"]).width,
        "size": network.size,
        "lights": len(lights),
        "training": "\n".join(f"{number}. {stage_in_words(stage)}" for number, stage in enumerate(stages, 1)),
        "test_figures": len({row["figure"] for row in rows}),
        "test_lights": len({row["light"] for row in rows}),
        **{name: np.mean([float(row[name]) for row in rows]) for name in SCORES},
    }
    with atomic_write(OUT / "README.md") as tmp:
        tmp.write_text(CARD.format(**facts))
    new.replace(out)
    print(f"{out}: {size / 2**20:.1f} MiB")


def stage_in_words(stage: dict) -> str:
    """Returns a line of the card about a stage of `lineage`."""
    return (
        f"{stage['steps']:,} steps of {stage['batch']} images at {stage['size']} px, of {stage['figures']} figures "
        f"(generator {', '.join(map(str, stage['generator']))})"
        f"{', by Muon' if stage.get('optimizer') == 'muon' else ''}, in {stage['precision']}"
    )


def lineage(settings: dict, data: dict) -> list[dict]:
    """Returns the trainings that led to a network, oldest first.

    Args:
        settings: of the network, by group.
        data: number of training `figures`, and versions of their `generator`; the networks that it went on from are
            taken to have seen the same, unless their own settings tell.

    Returns:
        `steps`, `batch`, `optimizer`, `precision`, `size`, `figures` and `generator` of each training.
    """
    if "stages" in settings:
        return settings["stages"]
    train = settings["train"]
    before = lineage(load_network(train["start"])[1], data) if train["start"] else []
    stage = {key: train[key] for key in ("steps", "batch", "optimizer", "precision")}
    figures = min(data["figures"], train["figures"] or data["figures"])
    return [*before, {**stage, "size": settings["size"], **data, "figures": figures}]


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "photo.s0")
