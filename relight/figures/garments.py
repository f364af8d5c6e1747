"""What a garment is: cuts of a smooth suit around the body, its ease, its length and its cloth."""

from dataclasses import dataclass, field

from relight.figures.drape import Cloth

# where ease is given. torso: 0 the crotch, 1 the base of the neck; arm: 0 shoulder, 1 elbow, 2 wrist; leg: 0 hip,
# 1 knee, 2 ankle
TORSO_AT = (0.0, 0.3, 0.55, 0.8, 0.95, 1.1)
ARM_AT = (0.0, 0.3, 0.6, 1.0, 1.4, 1.8, 2.0)
LEG_AT = (-0.6, -0.3, 0.0, 0.3, 0.7, 1.0, 1.5, 2.0)


@dataclass(frozen=True)
class Garment:
    """Lengths in metres. kind: top | trousers | skirt | scarf.

    sleeve: where it ends on the arm (0 shoulder, 1 elbow, 2 wrist); leg likewise; armhole: radius of the opening of
    a garment without sleeves; hem: above the crotch; seam: above the navel, where a drop is sewn on at the waist;
    drop: length added below the hem, or below the hips; flare: how much wider the end of the drop is; gather,
    pleat: depth of its folds at its upper and lower end, as a share of its radius; waves: their number; turn:
    radians, where they begin; waist: above the navel; neck: radii (sideways, up, forward) of the opening; vee:
    depth of a V below it; open: half the gap of a garment open in front; torso, arm, leg: ease; slack,
    sleeve_slack, leg_slack: extra length, which makes folds; cuff, rib, grip: how firmly sleeve ends, the hem, the
    neck are held to the body; thick: of the visible edge; tuck: worn inside a waistband at this height above the
    navel; belt: height above the navel at which a belt gathers it; over: how far outside other clothes a waistband is
    held; collar: none | fold | stand | roll | hood |
    lapel; front: how a closed front is fastened: none | placket (at the neck only) | buttons | zip | double (two
    rows of buttons); cloth: how it drapes; fabrics: what it is made of, drawn from with equal chances.
    """

    name: str
    kind: str
    sleeve: float = 0.6
    leg: float = 1.95
    hem: float = 0.06
    armhole: float = 0.0
    seam: float | None = None
    drop: float = 0.0
    flare: float = 0.0
    gather: float = 0.0
    pleat: float = 0.0
    waves: int = 12
    turn: float = 1.0
    waist: float = 0.0
    neck: tuple[float, float, float] = (0.078, 0.075, 0.085)
    vee: float = 0.0
    open: float = 0.0
    torso: tuple[float, ...] = (0.016, 0.034, 0.028, 0.014, 0.008, 0.006)
    arm: tuple[float, ...] = (0.010, 0.016, 0.022, 0.024, 0.03, 0.03, 0.03)
    legs: tuple[float, ...] = (0.004, 0.006, 0.010, 0.018, 0.022, 0.024, 0.024, 0.018)
    slack: float = 0.0
    sleeve_slack: float = 0.0
    leg_slack: float = 0.0
    cuff: float = 0.0
    rib: float = 0.0
    grip: float = 0.0
    thick: float = 0.003
    tuck: float | None = None
    belt: float | None = None
    over: float = 0.0
    collar: str = "none"
    front: str = "none"
    cloth: Cloth = field(default_factory=Cloth)
    fabrics: tuple[str, ...] = ("plain", "stripes", "print", "melange")
