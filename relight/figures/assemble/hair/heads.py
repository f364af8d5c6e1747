"""Builds hair of head and face from strands, and hats with the hair that they leave free."""

from relight.figures.assemble.hair import facial
from relight.figures.assemble.hair.hats import hat
from relight.figures.assemble.hair.locks import grow_locks, tied_hair
from relight.figures.assemble.hair.strands import Strip
from relight.figures.body.motion import Motion
from relight.figures.draw.hairstyles import HairStyle, varied
from relight.figures.surfaces import Surface

HairPart = tuple[str, Strip]  # hair, hat, brows, lashes or beard, which differ in color; and its mesh


def build_hair(motion: Motion, style: HairStyle, beard: float, below: Surface, seed: int, fine: bool) -> list[HairPart]:
    """Builds the hair of head and face, and the hat, in the pose.

    Args:
        motion: how the body moves from its rest pose into the pose.
        style: style of the hair.
        beard: amount of it, in [0,1].
        below: vertices and faces of posed skin and clothes.
        seed: random seed of length, parting, fringe, and of each strand.
        fine: all strands, else fewer, wider ones.
    """
    parts = [("brows", facial.brows(motion, seed, fine)), ("lashes", facial.lashes(motion, seed, fine))]
    beard_strip = facial.beard(motion, beard, below, seed, fine)
    if beard_strip is not None:
        parts.append(("beard", beard_strip))
    if style.comb is None:
        return parts
    if style.hat != "none":
        parts += [("hat", strip) for strip in hat(motion, style)]
    comb = varied(style.comb, seed)
    parts.append(("hair", grow_locks(motion, comb, below, seed, fine, hat=style.hat != "none")))
    if style.tie != "none":
        parts.append(("hair", tied_hair(motion, style.tie, below, seed, fine)))
    return parts
