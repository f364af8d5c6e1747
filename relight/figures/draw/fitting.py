"""Fits garments to a person, to each other, and to a pose."""

from dataclasses import replace

import numpy as np

from relight.figures.draw.garments import Garment, necks

ROUND = ("t-shirt", "fitted t-shirt", "long sleeve", "sweater", "dress", "long dress")  # cut like a t-shirt at the neck
MAX_WAIST_EASE = 0.036  # metres, of a top: wider cloth falls into one deep fold at the back
MAX_INNER_EASE = 0.020  # metres, of the trunk of a top worn under a jacket
MAX_INNER_ARM_EASE = 0.016  # same, of its sleeves
MIN_SITTING_EASE = 0.009  # metres, of the legs of trousers on a sitting figure, unless they stretch
TUCKED_SHARES = (0.5, 0.5, 0.7, 1, 1, 1)  # of the ease at TORSO_AT that a tucked top keeps: less at the hips
SITTING_HEM = 0.10  # metres above the crotch: hem of tops on a sitting figure
MAX_LENGTH = 1.06  # factor of a drop's usual length: longer skirts would lie on the floor
MIN_EASE = 0.004  # metres, not scaled by the fit


def tailored(rng: np.random.Generator, garment: Garment) -> Garment:
    """Draws the fit, lengths, neckline and folds of one person's garment.

    Args:
        rng: random generator.
        garment: garment of the wardrobe, with its usual cut.

    Returns:
        The garment with its ease above MIN_EASE scaled by 0.5 to 1.8, its sleeves, legs and drop longer or shorter, and
        one of `necks` if its neckline is round.
    """
    looseness = float(np.exp(np.clip(rng.normal(-0.05, 0.32), -0.7, 0.6)))  # factor of the ease above MIN_EASE
    if garment.kind == "top":
        looseness = min(looseness, MAX_WAIST_EASE / garment.torso_ease[1])
    # Metres; and positions along arm and leg as in `Garment`: 1 is the elbow or knee, 2 the wrist or ankle.
    extra_drop, sleeve, leg = rng.normal(0, [0.025, 0.05, 0.03])

    def eased(ease: tuple[float, ...]) -> tuple[float, ...]:
        """Scales what is above MIN_EASE by the looseness."""
        return tuple(min(e, MIN_EASE) + looseness * max(e - MIN_EASE, 0) for e in ease)

    if garment.name in ROUND:
        shapes = [*necks().values()]
        neck, v_depth, _ = shapes[int(rng.choice(len(shapes), p=[share for *_, share in shapes]))]
        garment = replace(garment, neck=neck, v_depth=v_depth)
    if garment.sleeve_end > 1.5 and garment.collar not in ("lapel", "stand") and rng.random() < 0.14:  # pushed up
        garment = replace(garment, sleeve_end=float(rng.uniform(1.3, 1.65)), cuff_pin=max(garment.cuff_pin, 0.5))
    elif 0.3 < garment.sleeve_end < 0.9:  # short sleeves, between shoulder and elbow
        garment = replace(garment, sleeve_end=float(np.clip(garment.sleeve_end + 2 * sleeve, 0.32, 0.85)))
    leg_end = garment.leg_end
    if garment.kind == "trousers" and leg_end > 1.5:  # long ones get shorter only
        leg_end = leg_end - abs(leg) - (0.25 if rng.random() < 0.12 else 0)  # some end above the ankle
    elif garment.kind == "trousers":  # shorts
        leg_end = leg_end + 3 * leg
    if garment.drop > 0.2:  # skirts, dresses and coats: in proportion
        extra_drop = garment.drop * (min(float(np.exp(rng.normal(-0.03, 0.12))), MAX_LENGTH) - 1)
    return replace(
        garment,
        torso_ease=eased(garment.torso_ease),
        arm_ease=eased(garment.arm_ease),
        leg_ease=eased(garment.leg_ease),
        leg_end=leg_end,
        drop=max(garment.drop + extra_drop, 0.0) if garment.drop else 0.0,
        flare=garment.flare * float(np.exp(rng.normal(0, 0.15))),
        fold_phase=float(rng.uniform(0, 2 * np.pi)),
    )


def over(outer: Garment, inner: Garment) -> Garment:
    """Widens an outer garment so that the inner one fits under it.

    Args:
        outer: a jacket, coat, cardigan or vest.
        inner: the top that is worn under it.

    Returns:
        `outer` with at least 8 mm more ease than `inner` at the trunk, and 6 mm more at the sleeves if `inner` has
        any.
    """
    torso = tuple(max(ease, below + 0.008) for ease, below in zip(outer.torso_ease, inner.torso_ease))
    arm = tuple(max(ease, below + 0.006) for ease, below in zip(outer.arm_ease, inner.arm_ease))
    return replace(outer, torso_ease=torso, arm_ease=outer.arm_ease if inner.armhole else arm)


def under(inner: Garment) -> Garment:
    """Returns a top cut close enough to be worn under a jacket: with its ease and the length of its sleeves limited."""
    return replace(
        inner,
        torso_ease=tuple(min(ease, MAX_INNER_EASE) for ease in inner.torso_ease),
        arm_ease=tuple(min(ease, MAX_INNER_ARM_EASE) for ease in inner.arm_ease),
        sleeve_slack=min(inner.sleeve_slack, 0.02),
    )


def tucked(top: Garment, bottom: Garment) -> list[Garment]:
    """Returns a top tucked into a skirt or trousers, and these with a waistband that fits over it."""
    snug = tuple(ease * share for ease, share in zip(top.torso_ease, TUCKED_SHARES))
    inside = replace(top, hem=0.10, drop=0.0, flare=0.0, slack=0.025, torso_ease=snug, tuck_height=bottom.waist)
    return [inside, replace(bottom, waistband_offset=0.007)]


def cut_to_sit(garment: Garment) -> Garment:
    """Adapts a garment to a sitting figure.

    Tops lose the length that the lap would push up under the chest. Trousers get room for bent legs, and shorts get no
    more than that: they would gape below the thighs.
    """
    if garment.kind == "trousers":
        max_ease = 1.4 * MIN_SITTING_EASE if garment.leg_end < 1.2 else np.inf
        ease = tuple(min(max(e, MIN_SITTING_EASE), max_ease) if e > 0.003 else e for e in garment.leg_ease)
        return replace(garment, leg_ease=ease)
    if garment.kind != "top" or garment.drop > 0.2:
        return garment
    return replace(garment, slack=0.0, drop=0.0, hem=max(garment.hem, SITTING_HEM))
