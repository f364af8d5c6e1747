"""Colour between a photo's bytes and the light in the scene, and back, exactly.

Three scales are told apart. *Coded* values are the 8-bit sRGB numbers of the file. *Linear* values are those decoded,
in [0,1]: what a network sees. *Scene* values undo the camera's shoulder on top of that and are unbounded: relighting
multiplies scene values, so that a highlight that grows brighter rolls off instead of being cut, and one that is
multiplied by 1 comes back as it was: `develop(SCENE[v]) == v` for all 256 codes.
"""

import numpy as np

from relight.srgb import LINEAR, decode

KNEE = 0.8  # linear value under which the camera's curve is a straight line


def shoulder(scene: np.ndarray) -> np.ndarray:
    """Scene values -> linear in [0,1): straight up to KNEE, then an exponential approach to 1 with equal slope."""
    above = np.maximum(scene - KNEE, 0.0) / (1 - KNEE)
    return np.where(scene <= KNEE, np.maximum(scene, 0.0), 1 - (1 - KNEE) * np.exp(-above))


def unshoulder(linear: np.ndarray) -> np.ndarray:
    """The inverse of `shoulder`; white is taken a quarter of a code below 1, so that it stays finite (1.86)."""
    linear = np.minimum(linear, 1 - 1 / 1020)
    return np.where(linear <= KNEE, linear, KNEE - (1 - KNEE) * np.log((1 - np.maximum(linear, KNEE)) / (1 - KNEE)))


SCENE = unshoulder(LINEAR.astype(np.float64)).astype(np.float32)  # scene value of each 8-bit code

# Finding the code of a scene value is a search among the 255 values half-way between two codes: faster than the
# power function, and exactly the inverse of the table.
_EDGES = ((np.arange(255) + 0.5) / 255).astype(np.float64)
_LINEAR_EDGES = decode(_EDGES).astype(np.float32)
_SCENE_EDGES = unshoulder(decode(_EDGES)).astype(np.float32)
_STEPS = 1 << 15  # cells of the lookup tables; a cell holds at most one edge above 0.001, so one comparison settles it


def _coder(edges: np.ndarray):
    """A function from values to the count of `edges` below them, by a table over sqrt(value) and one comparison."""
    top = float(edges[-1]) * 1.0001
    cells = np.searchsorted(edges, (np.arange(_STEPS + 1) / _STEPS) ** 2 * top, side="right").astype(np.int16)
    padded = np.append(edges, np.float32(np.inf))
    assert np.diff(cells).max() <= 1

    def code(values: np.ndarray) -> np.ndarray:
        values = np.nan_to_num(np.asarray(values, np.float32), nan=0.0, posinf=top, neginf=0.0)
        cell = (np.sqrt(np.clip(values, 0.0, top) / np.float32(top)) * np.float32(_STEPS - 1)).astype(np.int32)
        low = cells[cell]
        return (low + (values >= padded[low])).astype(np.uint8)

    return code


to_srgb8 = _coder(_LINEAR_EDGES)
to_srgb8.__doc__ = "Linear values -> 8-bit sRGB, clipped; the inverse of LINEAR."
develop = _coder(_SCENE_EDGES)
develop.__doc__ = "Scene values -> 8-bit sRGB through the shoulder; the inverse of SCENE, monotone, never cut hard."
