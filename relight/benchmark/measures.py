"""Measures errors of inferred maps and light, their invariances to changes of the picture, and leaks into shading.

Maps are on the picture's square. Errors of a light are relative errors of its irradiance. Names that end in `_factor`
are errors after the best factor for each picture, since a photograph does not determine a scene's brightness.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from relight.benchmark.shots import SHIFTS, WARM_RED_PER_BLUE
from relight.evaluation.scoring.metrics import MaskBox, irradiance_error, rmse, scaled_irradiance_error, scaled_rmse

MIRROR = np.ones(9)
MIRROR[[3, 4, 7]] = -1  # coefficients of functions odd in x
EPSILON = 1e-12  # lower bound of denominators
BLACK = 1e-3  # of values of which a ratio is taken, so that what is black counts as unchanged
MARGIN = 4  # pixels from the mask's outline, where leaks are measured
DARKEST = 0.02  # linear value below which albedo and shading count as this, since logarithms of noise are large

# The descriptions of the invariances; most have the name of a variant of the picture (`relight.benchmark.shots`).
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
    "tint": "share of a tint in the shading",
}
LEAKS = {
    "edges": "correlation of the edges of albedo and shading",
    "transfer": "albedo's strongest edges in the shading",
    "gradient": "mean gradient of ln shading",
    "stripes": "stripes in the shading",
}


@dataclass(frozen=True)
class Intrinsics:
    """Intrinsic maps and light of a picture, inferred or true; None if unknown.

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


def errors(inferred: Intrinsics, true: Intrinsics) -> dict[str, float]:
    """Returns the errors of inferred maps and light over the true mask; what is None on either side is left out.

    The measures are those of `relight.evaluation.scoring.metrics`: for the light the error of irradiance, for each map
    the RMSE, for albedo and shading also the SSIM.
    """
    measured: dict[str, float] = {}
    if inferred.light is not None and true.light is not None:
        measured["light"] = irradiance_error(inferred.light, true.light)
        measured["light_factor"] = scaled_irradiance_error(inferred.light, true.light)
    for name in ("albedo", "shading", "transport"):
        values, expected = getattr(inferred, name), getattr(true, name)
        if values is not None and expected is not None:
            values, expected = values[true.mask], expected[true.mask]
            measured[name] = float(rmse(values, expected))
            if name != "transport":
                measured[f"{name}_factor"] = scaled_rmse(values, expected)
                measured[f"{name}_ssim"] = MaskBox.of(true.mask).ssim(values.clip(0, 1), expected.clip(0, 1))
    return measured


def leaks(inferred: Intrinsics) -> dict[str, float]:
    """Measures how much of the albedo's edges is in the shading.

    Differences are those of ln albedo and ln shading between neighbouring pixels, well inside the mask.

    Args:
        inferred: by a method.

    Returns:
        LEAKS by name; empty without albedo or shading, or if the mask is too thin.
        edges: correlation of the differences of albedo and shading.
        transfer: slope of the shading's differences over the albedo's, for the largest 5 % of the albedo's.
        gradient: mean absolute difference of ln shading.
        stripes: (max - min) / mean of the gradients from even and from odd pixels; mean over both axes.
    """
    if inferred.albedo is None or inferred.shading is None:
        return {}
    inside = binary_erosion(inferred.mask, iterations=MARGIN)
    albedo, shading = (np.log(np.maximum(x.mean(-1), DARKEST)) for x in (inferred.albedo, inferred.shading))
    d_albedo, d_shading = (
        np.concatenate([differences(values, inside, axis) for axis in (0, 1)]) for values in (albedo, shading)
    )
    phases = [[np.abs(differences(shading, inside, axis, phase)) for phase in (0, 1)] for axis in (0, 1)]
    if not all(part.size for pair in phases for part in pair):
        return {}
    strong = np.abs(d_albedo) > np.quantile(np.abs(d_albedo), 0.95)
    by_phase = [[part.mean() for part in pair] for pair in phases]
    centred = d_albedo - d_albedo.mean(), d_shading - d_shading.mean()
    norms = np.prod([np.linalg.norm(values) for values in centred])
    return {
        "edges": float((centred[0] * centred[1]).sum() / max(norms, EPSILON)),
        "transfer": float((d_albedo[strong] * d_shading[strong]).sum() / max((d_albedo[strong] ** 2).sum(), EPSILON)),
        "gradient": float(np.abs(d_shading).mean()),
        "stripes": float(np.mean([(max(means) - min(means)) / max(np.mean(means), EPSILON) for means in by_phase])),
    }


def differences(values: np.ndarray, inside: np.ndarray, axis: int, phase: int | None = None) -> np.ndarray:
    """Returns the differences between neighbouring pixels, the second minus the first, where both are inside.

    Args:
        values: (S,S).
        inside: (S,S) bool.
        axis: 0 for neighbours one above the other, 1 for those side by side.
        phase: 0 or 1 for pairs whose first pixel is even or odd along the axis; None for all pairs.

    Returns:
        (N,), of the N pairs.
    """
    both = inside[1:] & inside[:-1] if axis == 0 else inside[:, 1:] & inside[:, :-1]
    if phase is not None:
        both = both & (np.indices(both.shape)[axis] % 2 == phase)
    return np.diff(values, axis=axis)[both]


def invariances(inferred: Mapping[str, Intrinsics]) -> dict[str, float]:
    """Measures how inferred maps and light change between the variants of a picture.

    A method that always infers the same light is invariant, too. Read these numbers together with the errors.

    Args:
        inferred: by the name of the variant (`variants`); "" is the picture itself. The tint is measured between `warm`
            and `plain`, which differ in color only: `plain` is as dark as `warm` must be to clip no more.

    Returns:
        INVARIANCES by name, for the maps and the light that the method infers. The ideal is 0, but 1 for `dark_albedo`
        and `tint`, and .5 for `dark_shading`.
    """
    picture, measured = inferred[""], {}
    lights = {name: intrinsics.light for name, intrinsics in inferred.items() if intrinsics.light is not None}
    shadings = {name: intrinsics.shading for name, intrinsics in inferred.items() if intrinsics.shading is not None}
    if "" in lights:
        changes = {name: irradiance_error(light, lights[""]) for name, light in lights.items() if name != "mirror"}
        for pixels in SHIFTS:
            measured[f"shift_{pixels}"] = (changes[f"down_{pixels}"] + changes[f"right_{pixels}"]) / 2
        measured |= {name: changes[name] for name in ("larger", "smaller", "fatter", "thinner", "knee", "waist")}
        measured["mirror_light"] = irradiance_error(lights["mirror"] * MIRROR[:, None], lights[""])
    both = picture.mask & inferred["mirror"].mask[:, ::-1]
    for name, signs in (("transport", MIRROR), ("albedo", 1.0)):
        if (original := getattr(picture, name)) is not None:
            mirrored = getattr(inferred["mirror"], name)[:, ::-1] * signs
            measured[f"mirror_{name}"] = float(rmse(mirrored[both], original[both]))
    for name in ("albedo", "shading"):
        if (original := getattr(picture, name)) is not None:
            change = (getattr(inferred["dark"], name) + BLACK) / (original + BLACK)
            measured[f"dark_{name}"] = float(np.median(change[picture.mask]))
    if "" in shadings:
        warm, plain = (shadings[name][picture.mask].mean(0) for name in ("warm", "plain"))
        tint = np.log(np.maximum(warm, BLACK) / np.maximum(plain, BLACK))
        measured["tint"] = float((tint[0] - tint[2]) / np.log(WARM_RED_PER_BLUE))
    return measured
