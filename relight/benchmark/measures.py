"""Errors of what a method infers from one picture, and of how that changes where it should not.

Maps are on the picture's square. Light errors are of irradiance: the norm of the difference over the norm. Names that
end in `_factor` are errors up to one factor for each picture, since no photograph tells how bright a scene is.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion
from skimage.metrics import structural_similarity

from relight.evaluation.metrics import rmse
from relight.sh import cosine_factors, per_coefficient

IRRADIANCE = per_coefficient(cosine_factors(2))[:, None]
MIRROR = np.ones(9)
MIRROR[[3, 4, 7]] = -1  # the coefficients that are odd in x
LEAST = 1e-12  # to divide by
WINDOW = 7  # of the structural similarity, pixels

# What is compared for each invariance, and with which variant of the picture (`relight.benchmark.shots`).
INVARIANCES = {
    "shift_4": "light: square shifted by 4 px",
    "shift_8": "light: by 8 px",
    "larger": "light: square 15 % larger",
    "smaller": "light: 7 % smaller",
    "fatter": "light: mask 1 px fatter",
    "thinner": "light: 1 px thinner",
    "knee": "light: cut at the knee",
    "waist": "light: at the waist",
    "mirror_light": "light: mirrored",
    "mirror_transport": "transport: mirrored",
    "mirror_albedo": "albedo: mirrored",
    "dark_albedo": "albedo at exposure x .5",
    "dark_shading": "shading at exposure x .5",
    "tint": "share of a tint in the light",
}
LEAKS = {
    "edges": "correlation of the edges of albedo and shading",
    "transfer": "albedo's strongest edges in the shading",
    "gradient": "mean gradient of ln shading",
    "stripes": "stripes in the shading",
}


@dataclass(frozen=True)
class Intrinsics:
    """The intrinsic maps and the light of a picture, inferred or true; None where a method does not infer them.

    Attributes:
        mask: (S,S) bool.
        albedo: (S,S,3) linear.
        transport: (S,S,9).
        shading: (S,S,3) linear.
        light: (9,3) radiance coefficients.
    """

    mask: np.ndarray
    albedo: np.ndarray | None = None
    transport: np.ndarray | None = None
    shading: np.ndarray | None = None
    light: np.ndarray | None = None


def distance(light: np.ndarray, other: np.ndarray) -> float:
    """The relative error of a light's irradiance: |light - other| / |other|, both (9,3) coefficients."""
    return float(np.linalg.norm((light - other) * IRRADIANCE) / np.linalg.norm(other * IRRADIANCE))


def factor(values: np.ndarray, other: np.ndarray) -> float:
    """The factor on `values` that brings them nearest to `other`, by least squares."""
    return float((values * other).sum() / max((values**2).sum(), 1e-9))


def similarity(values: np.ndarray, other: np.ndarray, inside: np.ndarray) -> float:
    """Structural similarity of (H,W,3) in [0,1] in the tight box of `inside` (H,W), zero outside of it in both."""
    box = []
    for axis in (1, 0):
        found = np.flatnonzero(inside.any(axis))
        first = max(0, min(found[0], inside.shape[1 - axis] - WINDOW))
        box.append(slice(first, max(found[-1] + 1, first + WINDOW)))
    first, second = ((x * inside[..., None])[tuple(box)] for x in (values, other))
    return float(structural_similarity(first, second, channel_axis=-1, data_range=1.0, win_size=WINDOW))


def errors(seen: Intrinsics, true: Intrinsics) -> dict[str, float]:
    """Compares what is inferred with the truth, over the true mask.

    Args:
        seen: what is inferred.
        true: the truth, as far as it is known.

    Returns:
        For the light its relative error (`distance`); for each map the RMSE of the vector norm
        (`relight.evaluation.metrics.rmse`); for albedo and shading the SSIM, too. What either side lacks is left out.
    """
    found: dict[str, float] = {}
    inside = true.mask
    if seen.light is not None and true.light is not None:
        found["light"] = distance(seen.light, true.light)
        scale = factor(seen.light * IRRADIANCE, true.light * IRRADIANCE)
        found["light_factor"] = distance(seen.light * scale, true.light)
    for name in ("albedo", "shading"):
        values, expected = getattr(seen, name), getattr(true, name)
        if values is not None and expected is not None:
            scale = factor(values[inside], expected[inside])
            found[name] = float(rmse(values[inside], expected[inside]))
            found[f"{name}_factor"] = float(rmse(values[inside] * scale, expected[inside]))
            found[f"{name}_ssim"] = similarity(np.clip(values, 0, 1), np.clip(expected, 0, 1), inside)
    if seen.transport is not None and true.transport is not None:
        found["transport"] = float(rmse(seen.transport[inside], true.transport[inside]))
    return found


def leaks(seen: Intrinsics) -> dict[str, float]:
    """Measures how far edges of the albedo show in the shading, too.

    Differences are those of ln albedo and of ln shading between neighbouring pixels, well inside the mask.

    Args:
        seen: what is inferred.

    Returns:
        LEAKS by name, or {} without albedo or shading, or where the mask is too thin.
        edges: correlation of the two differences.
        transfer: slope of the shading's differences over the albedo's, at the strongest 5 % of the latter.
        gradient: mean absolute difference of ln shading.
        stripes: (max - min) / mean of that from even and from odd pixels, as a mean over both axes.
    """
    if seen.albedo is None or seen.shading is None:
        return {}
    inside = binary_erosion(seen.mask, iterations=4)
    albedo, shading = (np.log(np.maximum(x.mean(-1), 0.02)) for x in (seen.albedo, seen.shading))
    a, s = (np.concatenate([steps(x, inside, axis) for axis in (0, 1)]) for x in (albedo, shading))
    if not len(a):
        return {}
    strong = np.abs(a) > np.quantile(np.abs(a), 0.95)
    folded = [[np.abs(steps(shading, inside, axis, phase)).mean() for phase in (0, 1)] for axis in (0, 1)]
    centred = a - a.mean(), s - s.mean()
    return {
        "edges": float((centred[0] * centred[1]).sum() / max(np.prod([np.linalg.norm(x) for x in centred]), LEAST)),
        "transfer": float((a[strong] * s[strong]).sum() / max((a[strong] ** 2).sum(), LEAST)),
        "gradient": float(np.abs(s).mean()),
        "stripes": float(np.mean([(max(means) - min(means)) / max(np.mean(means), LEAST) for means in folded])),
    }


def steps(values: np.ndarray, inside: np.ndarray, axis: int, phase: int | None = None) -> np.ndarray:
    """Differences of (S,S) between neighbours along an axis that are both inside; phase: from even or odd pixels."""
    both = inside[1:] & inside[:-1] if axis == 0 else inside[:, 1:] & inside[:, :-1]
    if phase is not None:
        both = both & (np.indices(both.shape)[axis] % 2 == phase)
    return np.diff(values, axis=axis)[both]


def invariances(seen: Mapping[str, Intrinsics]) -> dict[str, float]:
    """Measures how what is inferred changes with the variants of a picture.

    A method that always infers the same light is invariant, too: read these numbers beside the errors.

    Args:
        seen: what is inferred from the picture, "", and from each of its variants, by name.

    Returns:
        INVARIANCES by name, of what the method infers. All should be 0, except: at exposure x .5 the albedo should stay
        (1) and the shading be halved (.5), and all of a tint (1) should go to the light.
    """
    usual, found = seen[""], {}
    lights = {name: one.light for name, one in seen.items() if one.light is not None}
    shadings = {name: one.shading for name, one in seen.items() if one.shading is not None}
    if "" in lights:
        moves = {name: distance(light, lights[""]) for name, light in lights.items() if name != "mirror"}
        for pixels in (4, 8):
            found[f"shift_{pixels}"] = (moves[f"down_{pixels}"] + moves[f"right_{pixels}"]) / 2
        found |= {name: moves[name] for name in ("larger", "smaller", "fatter", "thinner", "knee", "waist")}
        found["mirror_light"] = distance(lights["mirror"] * MIRROR[:, None], lights[""])
    both = usual.mask & seen["mirror"].mask[:, ::-1]
    for name, signs in (("transport", MIRROR), ("albedo", 1.0)):
        if (here := getattr(usual, name)) is not None:
            there = getattr(seen["mirror"], name)[:, ::-1] * signs
            found[f"mirror_{name}"] = float(rmse(there[both], here[both]))
    for name in ("albedo", "shading"):
        if (here := getattr(usual, name)) is not None:
            change = (getattr(seen["dark"], name) + 1e-3) / (here + 1e-3)
            found[f"dark_{name}"] = float(np.median(change[usual.mask]))
    if "" in shadings:
        warm, plain = (shadings[name][usual.mask].mean(0) for name in ("warm", "plain"))
        tint = np.log(warm / plain)
        found["tint"] = float((tint[0] - tint[2]) / np.log(1.44))
    return found
