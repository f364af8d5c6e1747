"""Lights as files, each saying its convention."""

import json
from pathlib import Path

import numpy as np

from relight.files import UserError, whole
from relight.lights.light import Light
from relight.sh.conventions import from_relight

FRAMES = "x right, y up, z toward the camera, unless the convention says otherwise"


def write_light(light: Light, path: Path, convention: str = "relight") -> Path:
    """Writes a light as .json (coefficients, convention, frame, source) or as .npy (K, 3) float64; returns the path.

    A .npy cannot say its convention, so its name does: kitchen.npy becomes kitchen.relight.npy.
    """
    coefficients = from_relight(light.coefficients, convention)
    if path.suffix == ".json":
        content = {
            "convention": convention,
            "frame": FRAMES,
            "order": light.order,
            "source": light.source,
            "coefficients": coefficients.tolist(),
        }
        with whole(path) as temporary:
            temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    elif path.suffix == ".npy":
        if not path.stem.endswith(f".{convention}"):
            path = path.with_name(f"{path.stem}.{convention}.npy")
        with whole(path) as temporary, open(temporary, "wb") as file:
            np.save(file, coefficients)
    else:
        raise UserError(f"{path}: a light is written as .json or .npy")
    return path
