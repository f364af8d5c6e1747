"""Shoes: what there is."""

from dataclasses import dataclass

from relight.figures.catalogue.schema import entries


@dataclass(frozen=True)
class Shoe:
    """A kind of shoe.

    Attributes:
        name: as in the record of a figure.
        top: metres above the ankle where the upper ends; negative below it.
        sole: metres of thickness under the toes.
        heel: likewise, under the end of the heel.
        point: how pointed the toe is, in [0,1].
        straps: whether the upper consists of straps.
        laces: number of bands of laces.
        cap: share of the length that a toe cap covers.
        men, women: how often they wear it, relative to other shoes.
        with_skirt: likewise, for women in skirts and dresses; None if that makes no difference.
    """

    name: str
    top: float
    sole: float
    heel: float
    point: float = 0.0
    straps: bool = False
    laces: int = 0
    cap: float = 0.0
    men: float = 0.0
    women: float = 0.0
    with_skirt: float | None = None


def shoes() -> list[Shoe]:
    """Returns all kinds of shoes."""
    return list(entries("shoes", "shoes", Shoe).values())
