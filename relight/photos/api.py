"""The Python interface: `relight.load()` and its `Relighter`. Pictures are arrays, images of Pillow, or files."""

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Unpack

import numpy as np

from relight.photos.background import Background, read_background
from relight.photos.inferred import AUTO, LightGiven, SceneOptions
from relight.photos.look import Look
from relight.photos.network import PhotoNetwork, read_network
from relight.photos.person import Person
from relight.photos.scene import Scene
from relight.pictures.picture import Given


class Relighter:
    """A network that is ready for photos.

    Attributes:
        network: that infers.
    """

    def __init__(self, network: PhotoNetwork):
        self.network = network

    def __repr__(self) -> str:
        return f"Relighter({self.network.size} x {self.network.size} pixels, order {self.network.order})"

    def scene(
        self, image: Given, mask: Given | None = None, size: int | None = None, **options: Unpack[SceneOptions]
    ) -> Scene:
        """Finds the people in a photo, and infers the light, albedo and transport of each.

        Args:
            image: as `Picture.of` takes it: a file, an image of Pillow, or an array.
            mask: a file, an image of Pillow, or (H,W) bool, uint8 of 0 to 255 or float in [0,1]. By default the file
                beside the photo, its alpha, or an automatic mask.
            size: pixels that the longer side is scaled down to; None keeps the photo as it is.
            **options: `mask_model`, `split`, `white_balance` and `lit_by` of `Scene.of`.

        Returns:
            The scene: `people`, `light`, `notes`, and `relit(Look(...))` for any number of looks.

        Raises:
            UserError: if an argument is not one of these, or the mask is empty.
        """
        return Scene.of(image, mask, self.network, size=size, **options)

    def infer(self, image: Given, mask: Given | None = None, **options: Unpack[SceneOptions]) -> list[Person]:
        """Returns the people of `scene`, from left to right, and shows its notes as warnings.

        Args:
            image, mask, **options: as `scene` takes them.
        """
        scene = self.scene(image, mask, **options)
        _warn(scene)
        return list(scene.people)

    def relight(
        self,
        image: Given,
        mask: Given | None = None,
        light: LightGiven = AUTO,
        mode: str = "ratio",
        background: Background | Given = "keep",
        turn: float = 0.0,
        match: bool = True,
        stops: float = 0.0,
        blur: float = 0.0,
        shadow: bool = True,
        size: int | None = None,
        **options: Unpack[SceneOptions],
    ) -> np.ndarray:
        """Relights the people of a photo, and shows the notes on it and on the light as warnings.

        Args:
            image: as `scene` takes it.
            mask: likewise.
            light: as `Look` takes it.
            mode: `ratio` keeps all detail of the photo, `full` is albedo * shading.
            background: "keep", "transparent", "panorama" (the light's), a color, or a picture: a file, an array or an
                image of Pillow; or a `Background`.
            turn: of the light about the vertical axis, its front toward +x, degrees.
            match: whether the light is scaled to the photo's exposure.
            stops: exposure, as a power of two, from -8 to 8.
            blur: of the panorama or picture behind, degrees.
            shadow: whether people cast shadows on a new background.
            size: as `scene` takes it.
            **options: likewise; `mask_model` and `white_balance` are also those of a photo that `light` names.

        Returns:
            (H,W,3) of the photo's type; (H,W,4) if the background, or the photo, is transparent.

        Raises:
            UserError: if an argument is not one of these.
        """
        read_by = self.network, options.get("mask_model"), options.get("white_balance", "keep")
        look = Look(light, mode, read_background(background, blur, shadow), turn, stops, match, *read_by)
        scene = self.scene(image, mask, size, **options)
        _warn(scene, scene.notes_on(look))
        return scene.relit(look)


def _warn(scene: Scene, others: Iterable[str] = ()) -> None:
    """Shows the notes of a scene, and others, to the caller of a method of `Relighter`."""
    for note in [*(f"{scene.picture.name}: {note}" for note in scene.notes), *others]:
        warnings.warn(note, stacklevel=3)


def load(path: Path | str | None = None, threads: int = 0) -> Relighter:
    """Loads a network.

    Args:
        path: an .onnx file that `relight export` wrote; by default the network that comes with the package.
        threads: of the inference; 0 for one per core.

    Raises:
        UserError: if it is no such network.
    """
    return Relighter(read_network(path, threads))
