"""How far to trust what was inferred from a photo, in numbers and in words."""

from dataclasses import dataclass, field

import numpy as np

from relight.config import read_preset
from relight.lights import measure
from relight.lights.select import broken_rules
from relight.photos.infer import Figure
from relight.sh import cosine_factors, order_of, per_coefficient

ERROR = 0.10  # reconstruction error, linear, above which albedo and light do not explain the photo
IMPOSSIBLE = -0.35  # moment of a light below which its coefficients are no light's
CLIPPED, BLACK = 0.05, 0.5  # shares of the figure's pixels that are white or nearly black
UNUSUAL = {  # words for the rules of relight.lights.select.broken_rules
    "back-lit": "the light comes mostly from behind the figure, where inference is known to fail",
    "bright": "the light is brighter than any that the network has seen",
    "contrast": "the light is harder (more contrast) than any that the network has seen",
    "colour": "the light is more strongly coloured than any that the network has seen",
    "from-below": "the light comes from below, as none that the network has seen does",
}


@dataclass
class Trust:
    """error: root mean square of photo - albedo * shading, linear; distance: of the light to the nearest training
    light, as a share of the light (None when they are unknown); usual: the distance that 95 % of the training lights
    have to their own nearest; warnings: sentences, none when all is well.
    """

    error: float
    distance: float | None
    usual: float | None
    warnings: list[str] = field(default_factory=list)


def trust(figure: Figure, training: np.ndarray | None = None, stops: float = 0.0) -> Trust:
    """Judges one figure's inference. training: (N,K,3) the lights that the network was trained under, up to `stops`
    brighter than they are.
    """
    warnings = []
    if figure.error > ERROR:
        warnings.append(
            f"albedo and light rebuild the photo only to {figure.error:.2f} (usual: under {ERROR:.2f}): "
            "shadows may have been taken for dark cloth, or the other way round"
        )
    distance = usual = None
    if training is not None and len(training) > 1:
        distance, usual = _distance(figure.light, training)
        if distance > usual:
            warnings.append(
                f"the light is unlike those of the network's training (distance {distance:.2f}, usual {usual:.2f})"
            )
    warnings += _words(figure.light, 2.0**stops)
    seen = figure.image[figure.mask]
    white, black = float((seen.max(1) > 0.98).mean()), float((seen.max(1) < 0.01).mean())
    if white > CLIPPED:
        warnings.append(f"{white:.0%} of the figure is blown out to white: what is lost there cannot be relit")
    if black > BLACK:
        warnings.append(f"{black:.0%} of the figure is nearly black: there is little to infer from")
    if max(figure.frame.side, 1) < 0.5 * figure.frame.size:
        warnings.append(f"the figure is only {figure.frame.side * 0.9:.0f} pixels large, fewer than the network sees")
    return Trust(figure.error, distance, usual, warnings)


def _distance(light: np.ndarray, training: np.ndarray) -> tuple[float, float]:
    """Distance of `light` to the nearest of `training`, and the 95 % quantile of the same among `training`.

    Lights are compared by what they do, irradiance, with their overall strength divided out.
    """
    count = min(len(light), training.shape[1])
    weight = per_coefficient(cosine_factors(order_of(count)))[:, None]

    def unit(lights: np.ndarray) -> np.ndarray:
        flat = (lights[..., :count, :] * weight).reshape(*lights.shape[:-2], -1)
        return flat / np.maximum(np.linalg.norm(flat, axis=-1, keepdims=True), 1e-9)

    known = unit(training)
    among = np.linalg.norm(known[:, None] - known[None], axis=-1)
    np.fill_diagonal(among, np.inf)
    return float(np.linalg.norm(known - unit(light), axis=1).min()), float(np.quantile(among.min(1), 0.95))


def _words(light: np.ndarray, gain: float = 1.0) -> list[str]:
    """What is unusual about a light, by the rules for the training lights (docs/lights.md), which were made up to
    `gain` times brighter in training. A dim light is not: it may be the exposure of the photo.
    """
    light = light[None] / gain
    stats = measure(light)
    broken = broken_rules(light, read_preset("lights").rules)
    says = [words for rule, words in UNUSUAL.items() if broken[rule].item()]
    if stats["mean"].item() <= 0 or stats["moment"].item() < IMPOSSIBLE:
        says.insert(0, "no real light has the inferred coefficients: the inference has failed")
    return says
