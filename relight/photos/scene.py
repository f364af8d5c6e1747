"""A picture and the people in it, in another light."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from relight.lights import load_light
from relight.panoramas import luminance
from relight.photos.background import Background
from relight.photos.ground import standing_box
from relight.photos.inferred import Inferred
from relight.photos.look import Look
from relight.photos.render import frames
from relight.photos.shading import exposure_factor
from relight.sh import deringed, rotate_y

BEHIND = 110  # degrees from the front
WHITE = "what is transparent is white, since the result is opaque: --background gives something else"
DIRECTED = 0.5  # a part of the first band over the mean: 1.7 for a lamp, less for an even light


class Exposed(NamedTuple):
    """A look in the exposure of a picture.

    Attributes:
        light: (K,3), not yet turned.
        background: with it.
    """

    light: np.ndarray
    background: Background


class Scene(Inferred):
    """A picture and the people in it, which can be relit."""

    def relit(self, look: Look) -> np.ndarray:
        """Returns the relit picture, (H,W,3) of its type, or (H,W,4) if the background is transparent."""
        return next(self.turned(look, self.exposed(look)))

    def exposed(self, look: Look, turning: bool = False) -> Exposed:
        """Returns the light and the background of a look in the picture's exposure.

        The exposure is the geometric mean over the people. If the light is `turning`, it suits all headings.
        """
        given = (look.light or load_light(self.lamp, self.order)).at_order(self.order).coefficients
        light = (deringed(given) if look.windowed else given).astype(np.float32)
        shown = rotate_y(light, np.radians(look.turn)).astype(np.float32)
        factors = [exposure_factor(each.light, shown, each.transport, each.mask, turning) for each in self.people]
        needed = float(np.exp(np.mean(np.log(factors))))
        factor = needed if look.match else 1.0
        light = light * np.float32(factor)
        return Exposed(light, look.background.matched(light, factor, factor / needed))

    def notes_on(self, look: Look, turning: bool = False, opaque: bool = False) -> list[str]:
        """What a user should know about a look: who casts no shadow, and notes on its light, from behind or below.

        A light that is `turning` comes from everywhere in turn. If the result is `opaque`, what becomes white is noted.
        """
        shadows = [WHITE] * (opaque and self.picture.alpha is not None and look.background.kind == "keep")
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
        if not turning and turned >= BEHIND and np.hypot(x, z) >= DIRECTED * level:
            turn = f"a turn of {-heading:.0f} brings it to the front"
            notes.append(f"most of this light comes from behind: faces suffer; {turn}")
        if -y > DIRECTED * level:
            notes.append("most of this light comes from below, which the network never saw in training: faces suffer")
        return notes

    def turned(self, look: Look, exposed: Exposed, turns: Sequence[float] = (0.0,)) -> Iterator[np.ndarray]:
        """Yields a picture for each of `turns` of the light beyond that of the look, radians.

        `exposed` is of this picture or of another frame of its clip.
        """
        light, background = exposed
        angles = [np.radians(look.turn) + turn for turn in turns]
        lights = [(rotate_y(light, angle).astype(np.float32), angle) for angle in angles]
        return frames(self.picture.pixels, self.people, lights, look.mode, background, look.stops, self.picture.alpha)
