"""Unusual lights: what the paper's authors took out by hand, as rules (method.md section 4)."""

import numpy as np

from relight.config import Rules
from relight.lights.statistics import measure

DIRECTED = 0.35  # |L1| / L00 above which a light has a main direction worth judging
BATCH = 4096


def broken(lights: np.ndarray, rules: Rules) -> dict[str, np.ndarray]:
    """Which rules lights (N, K, 3), scaled to their reference brightness, break: name to (N,) bool."""
    parts = [_broken(lights[start : start + BATCH], rules) for start in range(0, len(lights), BATCH)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if parts else {}


def _broken(lights: np.ndarray, rules: Rules) -> dict[str, np.ndarray]:
    m = measure(lights)
    directed = m["first"] > DIRECTED
    return {
        "bright": (m["front_most"] > rules.bright) | (m["channel_most"] > rules.channel),
        "dim": m["front"] < rules.dim,
        "back-lit": (m["back_mean"] > rules.back * m["front_mean"]) | (directed & (m["toward"] < rules.toward)),
        "contrast": (m["front_least"] < rules.contrast * m["front_most"]) | (m["first"] > rules.first),
        "colour": np.maximum(abs(m["red"]), abs(m["blue"])) > rules.colour,
        "from-below": directed & (m["elevation"] < rules.below),
    }


def reasons(found: dict[str, np.ndarray]) -> np.ndarray:
    """The names of the rules that each light breaks, separated by spaces: (N,) str."""
    names = np.array(list(found), dtype=object)
    table = np.stack(list(found.values()), -1)
    return np.array([" ".join(names[row]) for row in table], dtype=str)
