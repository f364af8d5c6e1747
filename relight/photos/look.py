"""How a picture is to look: its light and what lies behind the people, checked once, when it is made."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.numbers import finite
from relight.lights import Light, load_light
from relight.lights.light import total
from relight.lights.place import estimated, is_of_person
from relight.photos.background import Background, read_background
from relight.pictures.picture import Given
from relight.sh.conventions import as_table

AUTO = "auto"
MODES = ("ratio", "full")
MAX_STOPS = 8
LightGiven = Light | np.ndarray | Path | str | Sequence[Light | Path | str] | None


class Look:
    """How a picture is to look.

    Args:
        light: a name (relight.load_light), a `Light`, several of them, which add up, (K,3) radiance coefficients, or
            `auto`: the light of the place in the background if this is a picture, else a lamp (`Scene.lamp`: None).
        mode: `ratio` keeps all detail of the picture, `full` is albedo * shading.
        background: as `read_background` takes it.
        turn: of the light about the vertical axis, its front toward +x, degrees.
        stops: exposure, as a power of two, from -8 to 8.
        match: whether the light is scaled to the picture's exposure.

    Raises:
        UserError: if an argument is not one of these.
    """

    light: Light | None
    windowed: bool  # whether the light is deringed, as those of photos and mere coefficients are not
    mode: str
    background: Background
    turn: float
    stops: float
    match: bool

    def __init__(
        self,
        light: LightGiven = AUTO,
        mode: str = "ratio",
        background: Background | Given = "keep",
        turn: float = 0.0,
        stops: float = 0.0,
        match: bool = True,
    ):
        if mode not in MODES:
            raise UserError(f"mode {mode!r} is neither ratio nor full")
        self.turn, self.stops = finite("turn", turn), finite("stops", stops, -MAX_STOPS, MAX_STOPS)
        self.mode, self.match = mode, match
        self.background = read_background(background)
        self.light, self.windowed = _read_light(light)
        if self.light is None and self.background.picture is not None:
            self.light = estimated(self.background.picture, self.background.name).checked()
        if self.background.kind == "panorama" and self.background.panorama is None:
            panorama = self.light.panorama if self.light else None
            if panorama is None:
                raise UserError(
                    "background panorama: this light has no panorama; give one with --light, or another background"
                )
            self.background = replace(self.background, panorama=panorama)

    @property
    def words(self) -> dict[str, Any]:
        """Plain values that tell what was asked for."""
        behind = {"background": self.background.name, "blur": self.background.blur, "shadow": self.background.shadow}
        numbers = {"mode": self.mode, "turn": self.turn, "stops": self.stops, "match": self.match}
        return {"light": self.light.source if self.light else AUTO, **behind, **numbers}


def _read_light(given: LightGiven) -> tuple[Light | None, bool]:
    """Returns a light, None for `auto`, and whether it is to be deringed."""
    if given is None or (isinstance(given, str) and given == AUTO):
        return None, True
    if isinstance(given, str | Path):
        if is_of_person(str(given)):
            raise UserError(f"light {given}: the light of a photo of somebody is read by `Relighter.read_light`")
        return load_light(given), True
    if isinstance(given, Light):
        checked = replace(given, coefficients=as_table(given, given.source)).checked()
        return checked, not is_of_person(given.source)
    if isinstance(given, Sequence) and given and all(isinstance(part, Light | str | Path) for part in given):
        parts = [light for light, _ in map(_read_light, given) if light is not None]
        if not parts:
            return None, True
        order, source = max(part.order for part in parts), " + ".join(part.source for part in parts)
        return total([part.at_order(order) for part in parts], source).checked(), True
    return Light(as_table(given, "the light"), "the light").checked(), False
