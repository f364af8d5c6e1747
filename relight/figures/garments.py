"""The wardrobe: what each garment is, as cuts of a smooth suit around the body, its ease, its length and its cloth."""

from dataclasses import dataclass, field

from relight.figures.drape import Cloth

# where ease is given. torso: 0 the crotch, 1 the base of the neck; arm: 0 shoulder, 1 elbow, 2 wrist; leg: 0 hip,
# 1 knee, 2 ankle
TORSO_AT = (0.0, 0.3, 0.55, 0.8, 0.95, 1.1)
ARM_AT = (0.0, 0.3, 0.6, 1.0, 1.4, 1.8, 2.0)
LEG_AT = (-0.6, -0.3, 0.0, 0.3, 0.7, 1.0, 1.5, 2.0)


@dataclass(frozen=True)
class Garment:
    """Lengths in metres. kind: top | trousers | skirt.

    sleeve: where it ends on the arm (0 shoulder, 1 elbow, 2 wrist); leg likewise; hem: above the crotch; drop: length
    added below the hem; flare: how much wider the end of the drop is; pleat: depth of its waves; waist: above the
    navel; neck: radii (sideways, up, forward) of the opening; open: half the gap of a garment open in front; torso,
    arm, leg: ease; slack, sleeve_slack, leg_slack: extra length, which makes folds; cuff, rib, grip: how firmly sleeve
    ends, the hem, the neck are held to the body; thick: of the visible edge; tuck: worn inside a waistband at this
    height above the navel; over: how far outside other clothes a waistband is held; collar: none | fold | stand |
    hood | lapel; cloth: how it drapes; fabrics: what it is made of, drawn from with equal chances.
    """

    name: str
    kind: str
    sleeve: float = 0.6
    leg: float = 1.95
    hem: float = 0.06
    drop: float = 0.0
    flare: float = 0.0
    pleat: float = 0.0
    waist: float = 0.0
    neck: tuple[float, float, float] = (0.078, 0.075, 0.085)
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
    over: float = 0.0
    collar: str = "none"
    cloth: Cloth = field(default_factory=Cloth)
    fabrics: tuple[str, ...] = ("plain", "stripes", "print", "melange")


SLIM = (0.004, 0.005, 0.006, 0.008, 0.009, 0.010, 0.011, 0.008)
WIDE = (0.004, 0.007, 0.016, 0.032, 0.045, 0.055, 0.07, 0.08)
SHIRT = (0.016, 0.032, 0.026, 0.014, 0.008, 0.006)
COAT = (0.045, 0.045, 0.038, 0.028, 0.018, 0.012)
SLEEVE = (0.010, 0.018, 0.024, 0.025, 0.022, 0.016, 0.006)
COAT_SLEEVE = (0.022, 0.028, 0.030, 0.030, 0.026, 0.022, 0.014)
NARROW_NECK = (0.070, 0.058, 0.082)
SHIRT_NECK = (0.072, 0.072, 0.092)
KNIT = Cloth(bend=0.35, thickness=0.006, crumple=0.02)
JERSEY = Cloth(bend=0.12, crumple=0.04)
POPLIN = Cloth(bend=0.18, crumple=0.035)
DENIM = Cloth(bend=0.35, crumple=0.025, thickness=0.005)
WOOL = Cloth(bend=0.30, crumple=0.02, thickness=0.006)
LEATHER = Cloth(bend=0.50, crumple=0.02, thickness=0.006)
SILK = Cloth(bend=0.05, crumple=0.02)

TOPS = (
    Garment(
        "t-shirt",
        "top",
        0.58,
        drop=0.03,
        slack=0.02,
        cloth=JERSEY,
        fabrics=("plain", "stripes", "print", "melange", "logo"),
    ),
    Garment(
        "fitted t-shirt",
        "top",
        0.42,
        drop=0.02,
        torso=(0.014, 0.014, 0.010, 0.008, 0.006, 0.005),
        arm=(0.006, 0.008, 0.01, 0.01, 0.01, 0.01, 0.01),
        slack=0.02,
        cloth=JERSEY,
    ),
    Garment(
        "tank top",
        "top",
        0.06,
        drop=0.03,
        neck=(0.095, 0.11, 0.11),
        torso=(0.018, 0.018, 0.014, 0.008, 0.006, 0.005),
        cloth=JERSEY,
        fabrics=("plain", "stripes", "melange"),
    ),
    Garment(
        "long sleeve",
        "top",
        1.96,
        drop=0.03,
        slack=0.02,
        sleeve_slack=0.04,
        arm=SLEEVE,
        cuff=0.4,
        cloth=JERSEY,
        fabrics=("stripes", "plain", "melange", "stripes"),
    ),
    Garment(
        "shirt",
        "top",
        1.97,
        drop=0.03,
        slack=0.02,
        sleeve_slack=0.05,
        torso=SHIRT,
        arm=SLEEVE,
        cuff=0.6,
        neck=SHIRT_NECK,
        collar="fold",
        cloth=POPLIN,
        fabrics=("plain", "check", "fine stripes", "stripes", "plain"),
    ),
    Garment(
        "short shirt",
        "top",
        0.66,
        drop=0.03,
        slack=0.02,
        torso=SHIRT,
        neck=SHIRT_NECK,
        collar="fold",
        cloth=POPLIN,
        fabrics=("print", "check", "fine stripes", "plain"),
    ),
    Garment(
        "sweater",
        "top",
        1.98,
        hem=0.08,
        slack=0.06,
        sleeve_slack=0.06,
        torso=(0.024, 0.034, 0.032, 0.022, 0.014, 0.010),
        arm=(0.018, 0.026, 0.03, 0.03, 0.028, 0.022, 0.008),
        cuff=0.7,
        rib=0.6,
        thick=0.005,
        neck=NARROW_NECK,
        cloth=KNIT,
        fabrics=("knit", "knit", "stripes", "melange"),
    ),
    Garment(
        "hoodie",
        "top",
        1.97,
        hem=0.09,
        slack=0.08,
        sleeve_slack=0.07,
        torso=(0.03, 0.042, 0.040, 0.028, 0.018, 0.012),
        arm=(0.024, 0.034, 0.038, 0.038, 0.034, 0.028, 0.008),
        cuff=0.7,
        rib=0.7,
        thick=0.006,
        neck=(0.075, 0.066, 0.085),
        collar="hood",
        cloth=KNIT,
        fabrics=("plain", "melange", "logo", "plain"),
    ),
)
OUTER = (
    Garment(
        "jacket",
        "top",
        1.93,
        drop=0.08,
        open=0.035,
        slack=0.02,
        sleeve_slack=0.04,
        torso=COAT,
        arm=COAT_SLEEVE,
        cuff=0.25,
        thick=0.005,
        neck=(0.08, 0.07, 0.095),
        collar="stand",
        cloth=LEATHER,
        fabrics=("leather", "plain", "denim"),
    ),
    Garment(
        "blazer",
        "top",
        1.92,
        drop=0.12,
        flare=0.02,
        open=0.02,
        slack=0.01,
        sleeve_slack=0.02,
        torso=COAT,
        arm=COAT_SLEEVE,
        cuff=0.2,
        thick=0.005,
        neck=(0.08, 0.07, 0.1),
        collar="lapel",
        cloth=WOOL,
        fabrics=("plain", "pinstripe", "tweed", "check"),
    ),
    Garment(
        "coat",
        "top",
        1.95,
        drop=0.46,
        flare=0.10,
        open=0.03,
        slack=0.0,
        sleeve_slack=0.02,
        torso=COAT,
        arm=COAT_SLEEVE,
        cuff=0.2,
        thick=0.006,
        neck=(0.08, 0.07, 0.1),
        collar="lapel",
        cloth=WOOL,
        fabrics=("plain", "tweed", "plain"),
    ),
    Garment(
        "cardigan",
        "top",
        1.96,
        drop=0.10,
        open=0.03,
        slack=0.02,
        sleeve_slack=0.05,
        torso=(0.036, 0.038, 0.034, 0.024, 0.016, 0.012),
        arm=COAT_SLEEVE,
        cuff=0.5,
        thick=0.005,
        neck=(0.085, 0.08, 0.105),
        cloth=KNIT,
        fabrics=("knit", "melange", "stripes"),
    ),
)
BOTTOMS = (
    Garment(
        "jeans",
        "trousers",
        leg=1.95,
        leg_slack=0.05,
        legs=(0.004, 0.005, 0.007, 0.010, 0.012, 0.013, 0.014, 0.010),
        cuff=0.3,
        waist=-0.03,
        cloth=DENIM,
        fabrics=("denim",),
    ),
    Garment(
        "slim trousers",
        "trousers",
        leg=1.9,
        leg_slack=0.02,
        legs=SLIM,
        cuff=0.4,
        waist=-0.02,
        cloth=POPLIN,
        fabrics=("plain", "plain", "denim", "leather"),
    ),
    Garment(
        "trousers",
        "trousers",
        leg=1.95,
        leg_slack=0.05,
        cuff=0.15,
        waist=-0.01,
        cloth=POPLIN,
        fabrics=("plain", "plain", "pinstripe", "tweed", "check"),
    ),
    Garment(
        "wide trousers",
        "trousers",
        leg=1.92,
        leg_slack=0.02,
        legs=WIDE,
        waist=0.02,
        cloth=SILK,
        fabrics=("plain", "plain", "fine stripes"),
    ),
    Garment(
        "shorts",
        "trousers",
        leg=0.80,
        leg_slack=0.01,
        legs=(0.004, 0.006, 0.014, 0.024, 0.032, 0.036, 0.036, 0.036),
        waist=-0.03,
        cloth=POPLIN,
        fabrics=("plain", "denim", "check", "print"),
    ),
)
SKIRTS = (
    Garment(
        "a-line skirt",
        "skirt",
        drop=0.48,
        flare=0.45,
        pleat=0.05,
        legs=(0.008, 0.010, 0.012, 0.014, 0.02, 0.02, 0.02, 0.02),
        cloth=POPLIN,
        fabrics=("plain", "print", "check", "denim", "tweed"),
    ),
    Garment(
        "short skirt",
        "skirt",
        drop=0.29,
        flare=0.30,
        pleat=0.04,
        legs=(0.008, 0.010, 0.012, 0.014, 0.02, 0.02, 0.02, 0.02),
        cloth=DENIM,
        fabrics=("denim", "plain", "leather", "check"),
    ),
    Garment(
        "long skirt",
        "skirt",
        drop=0.66,
        flare=0.55,
        pleat=0.06,
        legs=(0.008, 0.010, 0.012, 0.014, 0.02, 0.02, 0.02, 0.02),
        cloth=SILK,
        fabrics=("plain", "print", "stripes"),
    ),
)
DRESSES = (
    Garment(
        "dress",
        "top",
        0.22,
        drop=0.45,
        flare=0.45,
        pleat=0.05,
        neck=(0.10, 0.09, 0.11),
        torso=(0.024, 0.016, 0.008, 0.008, 0.006, 0.004),
        arm=(0.008, 0.01, 0.012, 0.012, 0.02, 0.02, 0.02),
        grip=0.5,
        cloth=SILK,
        fabrics=("print", "plain", "stripes", "check"),
    ),
    Garment(
        "long dress",
        "top",
        1.2,
        drop=0.72,
        flare=0.55,
        pleat=0.05,
        neck=(0.095, 0.085, 0.11),
        torso=(0.026, 0.018, 0.010, 0.008, 0.006, 0.004),
        arm=(0.010, 0.014, 0.018, 0.02, 0.02, 0.02, 0.02),
        grip=0.5,
        cloth=SILK,
        fabrics=("print", "plain"),
    ),
    Garment(
        "shift dress",
        "top",
        0.3,
        drop=0.36,
        flare=0.10,
        neck=(0.095, 0.08, 0.10),
        torso=(0.022, 0.022, 0.016, 0.010, 0.006, 0.004),
        arm=(0.008, 0.012, 0.014, 0.014, 0.02, 0.02, 0.02),
        grip=0.4,
        cloth=POPLIN,
        fabrics=("plain", "check", "stripes", "print", "tweed"),
    ),
)
