"""How far an inference from a photo can be trusted, in words."""

from relight.lights import measure
from relight.lights.select import RULES, broken_rules
from relight.photos.person import Person

ERROR = 0.10  # reconstruction error, linear, above which albedo and light do not explain the photo
IMPOSSIBLE = -0.35  # moment eigenvalue of a light below which no radiance has its coefficients
WHITE, BLACK = 0.05, 0.5  # shares of the person's pixels that are clipped, or nearly black
# Sentences for the rules of lights of the training (docs/lights.md); none for a dim one: a photo may be underexposed.
UNUSUAL = {
    "back-lit": "the light comes mostly from behind the figure, where inference is known to fail",
    "bright": "the light is brighter than any that the network has seen",
    "contrast": "the light is harder (more contrast) than any that the network has seen",
    "color": "the light is more strongly colored than any that the network has seen",
    "from-below": "the light comes from below, which the network never saw in training",
}


def doubts(person: Person, stops: float = 0.0) -> list[str]:
    """Returns why one person's inference may be wrong, as sentences; none if all is well.

    Args:
        person: as inferred.
        stops: by which the training made its lights brighter at most.
    """
    warnings = []
    if person.error > ERROR:
        warnings.append(
            f"albedo and light rebuild the photo only to {person.error:.2f} (usual: under {ERROR:.2f}): "
            "shadows may have been taken for dark cloth, or the other way round"
        )
    light = (person.exposure * person.light * person.white)[None] / 2.0**stops  # as the network has it
    stats, broken = measure(light), broken_rules(light, RULES["rooms"])
    if stats["mean"].item() <= 0 or stats["moment"].item() < IMPOSSIBLE:
        warnings.append("no real light has the inferred coefficients: the inference has failed")
    warnings += [sentence for rule, sentence in UNUSUAL.items() if broken[rule].item()]
    image = person.exposure * person.image[person.mask]
    white, black = float((image.max(1) > 0.98).mean()), float((image.max(1) < 0.01).mean())
    if white > WHITE:
        warnings.append(f"{white:.0%} of the figure is blown out to white: what is lost there cannot be relit")
    if black > BLACK:
        warnings.append(f"{black:.0%} of the figure is nearly black: there is little to infer from")
    if max(person.crop.side, 1) < 0.5 * person.crop.size:
        warnings.append(f"the figure is only {person.crop.side * 0.9:.0f} pixels large, fewer than the network sees")
    return warnings
