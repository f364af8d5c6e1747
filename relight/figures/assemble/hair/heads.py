"""Builds hair of head and face from strands, and hats with the hair that they leave free."""

from relight.figures.assemble.hair import facial
from relight.figures.assemble.hair.combing import Head
from relight.figures.assemble.hair.hats import hat
from relight.figures.assemble.hair.locks import grow_locks, tied_hair
from relight.figures.assemble.hair.strands import Strip
from relight.figures.draw.hairstyles import HairStyle, varied

HairPart = tuple[str, Strip]  # hair, hat, brows, lashes or beard, which differ in color; and its mesh


def build_hair(head: Head, style: HairStyle, beard: float) -> list[HairPart]:
    """Builds the hair of head and face, with a beard of an amount in [0,1], and the hat, in the pose."""
    parts = [("brows", facial.brows(head)), ("lashes", facial.lashes(head))]
    if (beard_strip := facial.beard(head, beard)) is not None:
        parts.append(("beard", beard_strip))
    if style.comb is None:
        return parts
    if style.hat != "none":
        parts += [("hat", strip) for strip in hat(head.motion, style)]
    parts.append(("hair", grow_locks(head, varied(style.comb, head.seed), hat=style.hat != "none")))
    if style.tie != "none":
        parts.append(("hair", tied_hair(head, style.tie)))
    return parts
