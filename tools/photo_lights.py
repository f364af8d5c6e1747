"""Makes the lights under which the weights for photos are trained: rooms, skies, studios and real panoramas.

    python tools/photo_lights.py FOLDER lights.npz

FOLDER holds the real panoramas, as `relight light setup` unpacks them. Each kind is selected on its own, so that its
share is known. Rooms keep the rules for usual lights; skies and studios are as strong and as directed as they come, but
not from behind or from below, since networks trained with many such lights find the light of photographs there.
"""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from relight.config import Panoramas, read_preset
from relight.lights import build_light_set, select_lights, write_light_set
from relight.lights.chain import generated_light, parallel_map
from relight.lights.select import RULES, concatenate, darkened
from relight.lights.table import LightSet

HELD_OUT = ("city", "forest", "lobby", "sky", "sunset", "workshop")  # every third of the eighteen, for the benchmark
FIRST_SEED = 5000  # of skies and studios: apart from those of the benchmark
GENERATED = {"sky": (600, 120), "lamps": (600, 120)}  # panoramas drawn, lights selected
ROOM_LIGHTS = 410  # lights selected from generated rooms
ORDER = 2  # of the spherical harmonics
HEADINGS = 12  # lights of each real panorama


def exposed(lights: LightSet) -> LightSet:
    """Returns the training and test lights, dimmed as a camera would expose: no brighter than usual lights may be."""
    chosen = lights.rows(np.isin(lights.split, ("train", "test")))
    return darkened(chosen, RULES["rooms"].channel)


def main() -> None:
    """Writes the lights, and prints how many of each kind there are."""
    folder, out = Path(sys.argv[1]), Path(sys.argv[2])
    usual = read_preset("lights")
    strong = replace(usual, test=1, rules="strong")
    rooms = read_preset("panoramas", "generated")
    lights, _ = build_light_set(rooms, replace(usual, clusters=ROOM_LIGHTS), ORDER)
    for kind, (drawn, count) in GENERATED.items():
        sources = [f"{kind}:{FIRST_SEED + i}" for i in range(drawn)]
        coefficients = np.stack(list(parallel_map(partial(generated_light, order=ORDER), sources)))  # (N,9,3)
        chosen, _ = select_lights(coefficients, sources, replace(strong, clusters=count))
        lights = concatenate(lights, exposed(chosen))
    names = [path.stem for path in sorted(folder.glob("*.exr"))]
    panoramas = Panoramas(source="folder", folder=str(folder), count=0, skies=0, layout="auto", flip=False)
    real, _ = build_light_set(panoramas, replace(strong, clusters=HEADINGS * len(names), split="random"), ORDER)
    real = exposed(real)
    held_out = np.isin([Path(source).stem for source in real.source], HELD_OUT)
    real.split[:] = np.where(held_out, "test", "train")
    lights = concatenate(lights, real)
    for split in ("train", "test"):
        kinds = [str(source).split(":")[0] if ":" in str(source) else "real" for source in lights.of(split).source]
        print(split, {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)})
    write_light_set(lights, out)


if __name__ == "__main__":
    main()
