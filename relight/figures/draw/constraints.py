"""Constraints on random figures, and draws of people, outfits and poses that satisfy them."""

import difflib
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from relight.core.errors import UserError
from relight.figures.draw.garments import group, wardrobe
from relight.figures.draw.hairstyles import style_odds, styles
from relight.figures.draw.outfits import Outfit, fitted_to_pose, sample_outfit
from relight.figures.draw.person import Person, sample_person
from relight.figures.draw.poses import Pose, poses, sample_pose

PEOPLE = 40  # maximal number drawn until one can wear the required garments
OUTFITS = 80  # maximal number drawn for each of them; it finds the rarest garment for one person of two


def names() -> dict[str, list[str]]:
    """Returns the names of all poses, garments and hair styles, by the kinds "pose", "garment" and "hair style"."""
    return {"pose": list(poses()), "garment": [*wardrobe(), *group("scarves")], "hair style": list(styles())}


@dataclass(frozen=True)
class Constraints:
    """Constraints on what is otherwise drawn at random.

    Attributes:
        sitting: share of the figures that sit, in [0, 1].
        poses: names of poses, one of which each figure takes; empty for all.
        garments: names of garments, all of which each figure wears together; empty for any.
        hair: names of styles, one of which each figure has; empty for all.
    """

    sitting: float = 0.08
    poses: tuple[str, ...] = ()
    garments: tuple[str, ...] = ()
    hair: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 0 <= self.sitting <= 1:
            raise UserError(f"the share of figures that sit must lie in [0, 1], not {self.sitting}")
        for (kind, known), chosen in zip(names().items(), (self.poses, self.garments, self.hair)):
            for name in chosen:
                check_name(kind, name, known)
        if self.sitting in (0, 1) and {poses()[name].sitting for name in self.poses} == {not self.sitting}:
            raise UserError(f"sitting={self.sitting:g} contradicts poses {', '.join(map(repr, self.poses))}: omit one")

    def sample_person(self, rng: np.random.Generator) -> Person:
        """Draws people until one can have the hair and wear the garments.

        Args:
            rng: random generator. Without constraints on clothes and hair the first person is taken.

        Raises:
            UserError: if none of PEOPLE can, for example because two garments are never worn together.
        """
        for _ in range(PEOPLE):
            person = sample_person(rng)
            has_hair = style_odds(person.female > 0.5, person, self.hair).any()
            if has_hair and (not self.garments or self._find_outfit(rng, person) is not None):
                return person
        raise UserError(f"nobody of {PEOPLE} people who were drawn would have {self._describe()}")

    def sample_outfit(self, rng: np.random.Generator, person: Person) -> Outfit:
        """Draws outfits until one has the garments, and hair of one of the styles.

        Args:
            rng: random generator. Without constraints on clothes the first outfit is taken.
            person: who wears it, drawn by `sample_person`.

        Raises:
            UserError: if none of PEOPLE x OUTFITS has the garments.
        """
        for _ in range(PEOPLE):
            if (outfit := self._find_outfit(rng, person)) is not None:
                return outfit
        raise UserError(f"no outfit of {PEOPLE * OUTFITS} that were drawn has {self._describe()}")

    def sample_pose(self, rng: np.random.Generator, sitting: float, outfit: Outfit) -> Pose:
        """Draws poses until one keeps the garments: long coats come off to sit, scarves to cross the arms.

        Args:
            rng: random generator. Without constraints the first pose is taken.
            sitting: probability of a pose that sits.
            outfit: drawn by `sample_outfit`.

        Raises:
            UserError: if none of PEOPLE does.
        """
        for _ in range(PEOPLE):
            pose = sample_pose(rng, sitting, self.poses)
            if self._has_garments(fitted_to_pose(outfit, pose)):
                return pose
        raise UserError(f"no pose of {PEOPLE} that were drawn can be taken in {self._describe()}")

    def _find_outfit(self, rng: np.random.Generator, person: Person) -> Outfit | None:
        drawn = (sample_outfit(rng, person, self.hair) for _ in range(OUTFITS))
        return next(filter(self._has_garments, drawn), None)

    def _has_garments(self, outfit: Outfit) -> bool:
        return {worn.garment.name for worn in outfit.garments}.issuperset(self.garments)

    def _describe(self) -> str:
        return " and ".join([*self.garments, *([f"{' or '.join(self.hair)} hair"] if self.hair else [])])


def check_name(kind: str, name: str, known: Collection[str]) -> None:
    """Raises UserError for an unknown name; the message suggests the closest known one and lists all.

    `kind` says what has the name, such as "pose", for the message.
    """
    if name not in known:
        close = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise UserError(f"no {kind} is called {name!r}; {hint}there are {', '.join(map(repr, known))}")
