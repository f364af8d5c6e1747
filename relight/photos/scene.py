"""A picture and the people in it: what was inferred of it, and how it looks in another light."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypedDict

import numpy as np

from relight.core.errors import UserError
from relight.lights import Light, load_light
from relight.lights.place import PREFIX, is_of_person
from relight.panoramas import luminance
from relight.photos.background import Background
from relight.photos.ground import standing_box
from relight.photos.look import AUTO, Look
from relight.photos.mask.find import AUTOMATIC, masked
from relight.photos.mask.people import NobodyFound, mask_warnings, split_people
from relight.photos.network import PhotoNetwork, read_network
from relight.photos.person import Person, balanced, infer_person, with_light
from relight.photos.render import frames
from relight.photos.shading import exposure_factor
from relight.photos.trust import doubts
from relight.pictures.picture import Given, Picture
from relight.sh import deringed, order_of, rotate_y

BEHIND = 110  # degrees from the front
DIRECTED = 0.5  # a part of the first band over the mean: 1.7 for a lamp, less for an even light
WHITE_BALANCES = ("keep", "scene")


class SceneOptions(TypedDict, total=False):
    """Options of `Scene.of` that callers pass on."""

    mask_model: Path | str | None
    split: bool
    white_balance: str
    lit_by: Light | str | None


@dataclass(repr=False)
class Scene:
    """A picture and the people in it.

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
        return f"Scene({self.picture!r}, {len(self.people)} people)"

    @classmethod
    def of(
        cls,
        image: Given,
        mask: Given | None = None,
        network: PhotoNetwork | None = None,
        mask_model: Path | str | None = None,
        split: bool = True,
        white_balance: str = "keep",
        size: int | None = None,
        lit_by: Light | str | None = None,
    ) -> "Scene":
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
            lit_by: the light of the picture, if it is known, or its name (`named_light`); it replaces the inferred one,
                at the same exposure.

        Raises:
            UserError: if an argument is not one of these, or the mask is empty.
        """
        require_white_balance(white_balance)
        picture = Picture.of(image)
        if picture.coverage is None or mask is not None:
            picture = masked(picture, mask, mask_model)
        picture = picture.downscaled(size) if size else picture
        network = network or read_network()
        assert picture.coverage is not None  # it is `masked`
        parts = split_people(picture.coverage, picture.bodies) if split else [(picture.coverage, None)]
        people = [infer_person(network, picture.pixels, coverage, body=body) for coverage, body in parts]
        notes: list[str] = []
        if light := known_light(network, lit_by, mask_model, white_balance):
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

    def relit(self, look: Look) -> np.ndarray:
        """Returns the relit picture, (H,W,3) of its type, or (H,W,4) if the background is transparent."""
        return next(self.turned(look, *self.exposed(look)))

    def exposed(self, look: Look, turning: bool = False) -> tuple[np.ndarray, Background]:
        """Returns the light (K,3) of a look in the picture's exposure, not yet turned, and the background with it.

        The exposure is the geometric mean over the people. If the light is `turning`, it suits all headings.
        """
        given = (look.light or load_light(self.lamp, self.order)).at_order(self.order).coefficients
        light = (deringed(given) if look.windowed else given).astype(np.float32)
        shown = rotate_y(light, np.radians(look.turn)).astype(np.float32)
        factors = [exposure_factor(each.light, shown, each.transport, each.mask, turning) for each in self.people]
        needed = float(np.exp(np.mean(np.log(factors))))
        factor = needed if look.match else 1.0
        light = light * np.float32(factor)
        return light, look.background.matched(light, factor, factor / needed)

    def notes_on(self, look: Look) -> list[str]:
        """What a user should know about a look: who casts no shadow, and notes on its light, from behind or below."""
        shadows = []
        if look.background.replaced and look.background.shadow:
            for number, person in enumerate(self.people, 1):
                if standing_box(person.coverage, person.body) is None:
                    who = "the figure" if len(self.people) == 1 else f"person {number}"
                    why = "no feet are seen" if person.body else "its mask reaches the photo's lower edge"
                    shadows.append(f"{who} casts no shadow on the new ground: {why}")
        if look.light is None:
            return shadows
        level, y, z, x = luminance(look.light.at_order(1).coefficients)
        heading = np.degrees(np.arctan2(x, z))
        turned = abs((heading + look.turn + 180) % 360 - 180)
        notes = [*shadows, *look.light.notes]
        if turned >= BEHIND and np.hypot(x, z) >= DIRECTED * level:
            turn = f"a turn of {-heading:.0f} brings it to the front"
            notes.append(f"most of this light comes from behind: faces suffer; {turn}")
        if -y > DIRECTED * level:
            notes.append("most of this light comes from below, which the network never saw in training: faces suffer")
        return notes

    def turned(
        self, look: Look, light: np.ndarray, background: Background, turns: Sequence[float] = (0.0,)
    ) -> Iterator[np.ndarray]:
        """Yields a picture for each of `turns` of the light beyond that of the look, radians.

        `light` and `background` are what `exposed` returned, of this picture or of another frame of its clip.
        """
        angles = [np.radians(look.turn) + turn for turn in turns]
        lights = [(rotate_y(light, angle).astype(np.float32), angle) for angle in angles]
        return frames(self.picture.pixels, self.people, lights, look.mode, background, look.stops, self.picture.alpha)


def degrees_apart(one: np.ndarray, other: np.ndarray) -> float:
    """Returns the angle in degrees between the main directions of two lights (K,3), those of their bands of order 1."""
    first, second = (luminance(light[1:4].astype(np.float64)) for light in (one, other))
    cosine = first @ second / max(np.linalg.norm(first) * np.linalg.norm(second), 1e-9)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def require_white_balance(white_balance: str) -> None:
    """Raises UserError if this is no white balance."""
    if white_balance not in WHITE_BALANCES:
        raise UserError(f"white balance {white_balance!r} is neither keep nor scene")


def named_light(
    network: PhotoNetwork, text: Path | str, mask_model: Path | str | None = None, white_balance: str = "keep"
) -> Light | None:
    """Reads a light as a user names it (docs/photos.md).

    Args:
        network: whose order the light has, and which infers the light of a photo.
        text: a panorama, a file of coefficients, "room:12", "key:#ffeedd@45,30", "place:street.jpg", a photo of
            somebody, or "auto".
        mask_model: for an automatic mask of that photo.
        white_balance: of that photo.

    Returns:
        The light; None for `auto`.

    Raises:
        UserError: if it is no light.
    """
    text = str(text)
    if not is_of_person(text):
        return None if text == AUTO else load_light(text, network.order)
    try:
        scene = Scene.of(text, None, network, mask_model, white_balance=white_balance)
    except NobodyFound:
        raise UserError(f"light: nobody was found in {text}; the light of a place is {PREFIX}{text}") from None
    notes = [f"{Path(text).name}: {note}" for note in scene.notes]
    if AUTOMATIC in scene.picture.notes:
        notes.append(f"{text} is taken for a photo of somebody; the light of a place is {PREFIX}{text}")
    return Light(scene.light, text, notes=notes)


def known_light(
    network: PhotoNetwork, given: Light | str | None, mask_model: Path | str | None, white_balance: str
) -> Light | None:
    """Returns the light of a picture that its user knows, as it is or by its name (`named_light`), if it is given.

    Raises:
        UserError: if it is no light, or `auto`.
    """
    light = named_light(network, given, mask_model, white_balance) if isinstance(given, str) else Look(given).light
    if light is None and given is not None:
        raise UserError(f"lit by {given}: name the light, or leave it out, since it is inferred by default")
    return light
