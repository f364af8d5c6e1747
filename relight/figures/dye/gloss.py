"""Gloss of a figure's materials: roughness and specular as in glTF 2.0."""

from dataclasses import replace

from relight.figures.catalogue.schema import entries
from relight.figures.draw.fabrics import Fabric, trait
from relight.figures.draw.outfits import Outfit
from relight.meshes import Material

WOVEN = ("plain", "print", "stripes", "fine stripes", "check")  # kinds of fabric that may be satin
SATIN_SHARE = 0.12  # of these fabrics


def with_gloss(material: Material, outfit: Outfit) -> Material:
    """Returns a material with the gloss for its name and the outfit's fabrics."""
    fabrics: dict[str, Fabric | None] = {worn.garment.name: worn.fabric for worn in outfit.garments}
    fabrics |= {"hat": outfit.hat, "tie": outfit.tie, "belt": outfit.belt}
    fabric = fabrics.get(material.name)
    kind = material.name if fabric is None else fabric.kind
    if kind.startswith("shoes:") and not kind.endswith("sole") and "sneakers" in outfit.shoe.name:
        kind = "cloth"
    if fabric is not None and kind in WOVEN and trait(fabric, "satin") < SATIN_SHARE:
        kind = "satin"
    known = entries("colors", "gloss", tuple[float, float])
    roughness, specular = known.get(kind, known["cloth"])
    return replace(material, roughness=roughness, specular=specular)
