"""Gloss of a figure's materials: roughness and specular as in glTF 2.0.

The specular of skin and eyes follows from their refractive indices, 1.4 and 1.376. All other values are set by eye.
"""

from dataclasses import replace

from relight.figures.draw.fabrics import Fabric, trait
from relight.figures.draw.outfits import Outfit
from relight.meshes import Material

CLOTH = (0.85, 0.3)  # roughness; specular: reflectance over 4 %
SATIN = (0.38, 0.8)
LEATHER = (0.45, 0.8)
GLOSS = {
    "skin": (0.55, 0.7),
    "eyes": (0.1, 0.63),
    **dict.fromkeys(("hair", "brows", "lashes", "beard"), (0.45, 1.0)),
    **dict.fromkeys(("knit", "tweed", "corduroy", "melange"), (0.95, 0.2)),
    "leather": LEATHER,
    "shoes: upper": LEATHER,
    "shoes: cap": LEATHER,
    "shoes: sole": (0.7, 0.6),
    "buckle": (0.3, 1.0),
    "phone": (0.2, 1.0),
    "cup": (0.3, 1.0),
    "bag": LEATHER,
    "seat": (0.6, 0.6),
    "stool legs": (0.5, 0.8),
}
WOVEN = ("plain", "print", "stripes", "fine stripes", "check")  # kinds of fabric that may be satin
SATIN_SHARE = 0.12  # of these fabrics


def with_gloss(material: Material, outfit: Outfit) -> Material:
    """Returns a material with the gloss for its name and the outfit's fabrics."""
    fabrics: dict[str, Fabric | None] = {worn.garment.name: worn.fabric for worn in outfit.garments}
    fabrics |= {"hat": outfit.hat, "tie": outfit.tie, "belt": outfit.belt}
    fabric = fabrics.get(material.name)
    is_upper = material.name.startswith("shoes:") and not material.name.endswith("sole")
    if fabric is not None:
        is_satin = fabric.kind in WOVEN and trait(fabric, "satin") < SATIN_SHARE
        roughness, specular = SATIN if is_satin else GLOSS.get(fabric.kind, CLOTH)
    elif is_upper and "sneakers" in outfit.shoe.name:
        roughness, specular = CLOTH
    else:
        roughness, specular = GLOSS.get(material.name, CLOTH)
    return replace(material, roughness=roughness, specular=specular)
