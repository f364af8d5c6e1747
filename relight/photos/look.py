"""How a picture is to look: its light and what lies behind the people, checked once, when it is made."""

from dataclasses import replace
from typing import Any

from relight.core.errors import UserError
from relight.core.numbers import finite
from relight.lights.place import estimated, is_of_person
from relight.photos.background import Background, read_background
from relight.photos.inferred import AUTO, LightGiven, MaskModel, is_table, read_light
from relight.photos.network import PhotoNetwork
from relight.pictures.picture import Given

MODES = ("ratio", "full")
MAX_STOPS = 8


class Look:
    """How a picture is to look.

    Args:
        light: as `read_light` takes it; `auto` is the light of the place in the background if this is a picture, else
            a lamp (`Scene.lamp`: None).
        mode: `ratio` keeps all detail of the picture, `full` is albedo * shading.
        background: as `read_background` takes it.
        turn: of the light about the vertical axis, its front toward +x, degrees.
        stops: exposure, as a power of two, from -8 to 8.
        match: whether the light is scaled to the picture's exposure.
        network, mask_model, white_balance: as `read_light` takes them.

    Raises:
        UserError: if an argument is not one of these.
    """

    def __init__(
        self,
        light: LightGiven = AUTO,
        mode: str = "ratio",
        background: Background | Given = "keep",
        turn: float = 0.0,
        stops: float = 0.0,
        match: bool = True,
        network: PhotoNetwork | None = None,
        mask_model: MaskModel = None,
        white_balance: str = "keep",
    ):
        if mode not in MODES:
            raise UserError(f"mode {mode!r} is neither ratio nor full")
        self.turn, self.stops = finite("turn", turn), finite("stops", stops, -MAX_STOPS, MAX_STOPS)
        self.mode, self.match = mode, match
        self.background = read_background(background)
        self.light = read_light(light, network, mask_model, white_balance)
        # Whether it is deringed, as lights of photos and mere coefficients are not.
        self.windowed = not (is_table(light) or (self.light and is_of_person(self.light.source)))
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
