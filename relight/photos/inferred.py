"""What is inferred of the people in a picture; and lights as a user gives them, also by a photo of somebody."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypedDict

import numpy as np

from relight.core.errors import UserError
from relight.lights import Light, load_light
from relight.lights.light import parts_of, total
from relight.lights.place import PREFIX, is_of_person
from relight.panoramas import luminance
from relight.photos.mask.find import AUTOMATIC, masked
from relight.photos.mask.people import NobodyFound, mask_warnings, split_people
from relight.photos.network import PhotoNetwork, read_network
from relight.photos.person import Person, balanced, infer_person, with_light
from relight.photos.trust import doubts
from relight.pictures.picture import Given, Picture
from relight.sh import deringed, order_of
from relight.sh.conventions import as_table

AUTO = "auto"
WHITE_BALANCES = ("keep", "scene")
MaskModel = Path | str | None  # the file of an ONNX network for automatic masks, as `masked` takes it
LightGiven = Light | np.ndarray | Path | str | Sequence[Light | Path | str] | None


class SceneOptions(TypedDict, total=False):
    """Options of `Scene.of` that callers pass on."""

    mask_model: MaskModel
    split: bool
    white_balance: str
    lit_by: Light | str | None


@dataclass(repr=False)
class Inferred:
    """A picture and what was inferred of the people in it.

    Attributes:
        picture: with its `coverage`.
        people: as inferred from it, from left to right.
        network: that inferred them; None if they are known otherwise.
        own_notes: what a user should know beside the notes on the picture, its mask and the inference.
    """

    picture: Picture
    people: Sequence[Person]
    network: PhotoNetwork | None = None
    own_notes: Sequence[str] = ()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.picture!r}, {len(self.people)} people)"

    @classmethod
    def of(
        cls,
        image: Given,
        mask: Given | None = None,
        network: PhotoNetwork | None = None,
        mask_model: MaskModel = None,
        split: bool = True,
        white_balance: str = "keep",
        size: int | None = None,
        lit_by: Light | str | None = None,
    ) -> Self:
        """Finds the people in a picture, and infers the light, albedo and transport of each.

        Args:
            image: as `Picture.of` takes it.
            mask: as `masked` takes it; by default it is found.
            network: by default the one that comes with the package.
            mask_model: ONNX network for automatic masks.
            split: whether people are inferred one by one (`split_people`).
            white_balance: `keep` takes the light to be white on average (`balanced`), `scene` to have the color that
                the network infers.
            size: pixels that the longer side is scaled down to, with 8 bits; None keeps the picture as it is.
            lit_by: the light of the picture, if it is known, as `read_light` takes it; it replaces the inferred one,
                at the same exposure.

        Raises:
            UserError: if an argument is not one of these, or the mask is empty.
        """
        require_white_balance(white_balance)
        picture = Picture.of(image)
        if picture.coverage is None or mask is not None:
            picture = masked(picture, mask, mask_model)
        picture = picture if size is None else picture.downscaled(size)
        network = network or read_network()
        assert picture.coverage is not None  # it is `masked`
        parts = split_people(picture.coverage, picture.bodies) if split else [(picture.coverage, None)]
        people = [infer_person(network, picture.pixels, coverage, body=body) for coverage, body in parts]
        notes: list[str] = []
        if light := known_light(lit_by, network, mask_model, white_balance):
            known = deringed(light.at_order(network.order).coefficients).astype(np.float32)
            notes = list(light.notes)
            if np.any(known[1:4]):  # it has a direction
                apart = np.mean([degrees_apart(person.light, known) for person in people])
                notes += [f"the photo's light as given, {light.source}, is {apart:.0f} degrees from the inferred one"]
            people = [with_light(person, known) for person in people]
        return cls(picture, balanced(people) if white_balance == "keep" else people, network, notes)

    @cached_property
    def light(self) -> np.ndarray:
        """(K,3) the mean of the inferred lights, weighted by the people's areas."""
        areas = np.array([person.mask.sum() * (person.crop.side / person.crop.size) ** 2 for person in self.people])
        lights = np.stack([person.light for person in self.people])
        return np.tensordot(areas / areas.sum(), lights, 1).astype(np.float32)

    @property
    def lamp(self) -> str:
        """The name of a warm lamp from the side from which the light does not come, so that all see what changed."""
        from_right = float(luminance(self.light.astype(np.float64))[3]) > 0
        return f"key:#ffe6c8@{-50 if from_right else 50},40,0.3"

    @cached_property
    def doubts(self) -> list[list[str]]:
        """Why the inference of each person may be wrong; empty without a network."""
        network = self.network
        return [doubts(person, network.stops) for person in self.people] if network else []

    @property
    def notes(self) -> list[str]:
        """What a user should know about the picture, its mask and the inference, one sentence each."""
        masks = zip(*((person.coverage, person.body) for person in self.people))
        notes = [*self.own_notes, *self.picture.notes, *mask_warnings(*masks)]
        for number, warnings in enumerate(self.doubts, 1):
            who = f"person {number}: " if len(self.people) > 1 else ""
            notes += [f"{who}{warning}" for warning in warnings]
        return notes

    @property
    def order(self) -> int:
        """Of the spherical harmonics."""
        return order_of(self.people[0].transport.shape[-1])


def degrees_apart(one: np.ndarray, other: np.ndarray) -> float:
    """Returns the angle in degrees between the main directions of two lights (K,3), those of their bands of order 1."""
    first, second = (luminance(light[1:4].astype(np.float64)) for light in (one, other))
    cosine = first @ second / max(np.linalg.norm(first) * np.linalg.norm(second), 1e-9)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def require_white_balance(white_balance: str) -> None:
    """Raises UserError if this is no white balance."""
    if white_balance not in WHITE_BALANCES:
        raise UserError(f"white balance {white_balance!r} is neither keep nor scene")


def read_light(
    given: LightGiven, network: PhotoNetwork | None = None, mask_model: MaskModel = None, white_balance: str = "keep"
) -> Light | None:
    """Reads a light as a user gives it (docs/photos.md).

    Args:
        given: a name (`relight.load_light`), a photo of somebody, a `Light`, several of these, which add up, (K,3)
            radiance coefficients, or `auto`.
        network: whose order named lights have, and which infers the light of a photo; by default the one that comes
            with the package.
        mask_model, white_balance: for that photo, as in `Inferred.of`.

    Returns:
        The light; None for `auto`.

    Raises:
        UserError: if it is no light.
    """
    options = network, mask_model, white_balance
    if given is None or (isinstance(given, str) and given == AUTO):
        return None
    if isinstance(given, Light):
        return replace(given, coefficients=as_table(given, given.source)).checked()
    if is_table(given):
        return Light(as_table(given, "the light"), "the light").checked()
    parts = parts_of(str(given)) if isinstance(given, str | Path) else given
    if len(parts) > 1:
        lights = [read_light(part, *options) or load_light(AUTO) for part in parts]  # which is none to be added
        order = max(light.order for light in lights)
        return total([light.at_order(order) for light in lights], " + ".join(map(str, lights))).checked()
    if not isinstance(given, str | Path):
        return read_light(given[0], *options)
    text = str(given)
    if not is_of_person(text):
        return load_light(text, network.order if network else 2)
    try:
        found = Inferred.of(text, None, network, mask_model, white_balance=white_balance)
    except NobodyFound:
        raise UserError(f"light: nobody was found in {text}; the light of a place is {PREFIX}{text}") from None
    notes = [f"{Path(text).name}: {note}" for note in found.notes]
    if AUTOMATIC in found.picture.notes:
        notes.append(f"{text} is taken for a photo of somebody; the light of a place is {PREFIX}{text}")
    return Light(found.light, text, notes=notes)


def known_light(given: Light | str | None, *options: Any) -> Light | None:
    """Reads the light of a picture that its user knows, if it is given, as `read_light` takes it, but not `auto`."""
    light = read_light(given, *options)
    if light is None and given is not None:
        raise UserError(f"lit by {given}: name the light, or leave it out, since it is inferred by default")
    return light


def is_table(given: LightGiven) -> bool:
    """Returns whether a light is given by mere coefficients."""
    parts = given if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    return not (parts and all(part is None or isinstance(part, Light | str | Path) for part in parts))
