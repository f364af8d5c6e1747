"""What the viewer can be given: files of baked maps, photos, and lights by name."""

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.files import existing_file
from relight.lights import load_light, reference_brightness
from relight.maps import LeftOut, Maps, read_maps
from relight.panoramas import luminance
from relight.photos import api
from relight.photos.render import total_coverage
from relight.photos.scene import Scene
from relight.photos.shading import saturation
from relight.photos.write import placed_maps
from relight.pictures.codes import on_white
from relight.sh import UNOCCLUDED_T00
from relight.viewer.figure import Figure

BRIGHTNESS = 0.8  # the first light's irradiance toward the viewer, the middle of the paper's [.7, .9]
PORTRAIT = Path(__file__).parent / "web" / "astronaut.jpg"
PORTRAIT_MASK = Path(__file__).parent / "web" / "astronaut_mask.png"
LIGHTS = {
    "Warm, from the right": "room:8",
    "From behind": "room:3",
    "Cool, from the right": "room:5",
    "Soft and grey": "room:17",
    "Tungsten": "room:26",
    "Soft, from the front": "room:11",
    "Open sky": "sky:1",
    "Warm key light": "key:#ffd9a8@-50,35,0.25",
    "Blue rim light": "key:#b8ccff@125,25,0.35",
}


def named_lights(texts: Iterable[str] = ()) -> dict[str, np.ndarray]:
    """Returns the lights that a page offers.

    The first is scaled so that the reference brightness is BRIGHTNESS or, where that would dazzle as it comes from
    behind, the mean irradiance of its brightest channel. The others get the brightness of the first: luminance of the
    mean radiance, times `saturation`.

    Args:
        texts: lights as `relight.lights.load_light` reads them; LIGHTS if there are none.

    Returns:
        Radiance coefficients (9,3) by the name to show.

    Raises:
        UserError: for what is no light, or a black one.
    """
    texts = list(texts)
    stems = [Path(text).stem if os.path.isfile(text) else text for text in texts]
    texts_by_name = {stem if stems.count(stem) == 1 else text: text for stem, text in zip(stems, texts)} or LIGHTS
    lights = {name: load_light(text).coefficients for name, text in texts_by_name.items()}
    first = next(iter(lights.values()))
    scale = BRIGHTNESS / max(reference_brightness(first), UNOCCLUDED_T00 * first[0].max())
    bright = {name: float(luminance(np.maximum(light[0], 0))) * saturation(light) for name, light in lights.items()}
    return {name: light * (scale * next(iter(bright.values())) / bright[name]) for name, light in lights.items()}


def load(weights: Path | None) -> api.Relighter:
    """Loads a network; raises UserError for one of `train.color=paper`, whose shading acts on coded values."""
    relighter = api.load(weights)
    if relighter.network.config.get("train", {}).get("color") == "paper":
        raise UserError("the viewer needs a network trained with train.color=photo; this one was trained with paper")
    return relighter


def baked_figure(path: Path) -> Figure:
    """Reads the figure of a file of maps (relight.maps.exr).

    Raises:
        UserError: if there is no such file, or it stands for a figure that was left out.
    """
    try:
        maps = read_maps(existing_file(path, "maps"))
    except LeftOut as reason:
        raise UserError(f"{path} holds no maps, the figure was left out: {reason}") from None
    return Figure(str(maps.info.get("name") or path.stem), maps)


def figure_of(path: Path, relighter: api.Relighter | None, mask: Path | None = None, size: int = 1024) -> Figure:
    """Makes the figure of a file of maps, or of a photo.

    Args:
        path: maps (.exr) or a photo.
        relighter: for photos; None where there are only maps.
        mask: mask of the photo; by default it is that of the file beside the photo, or found in it (docs/photos.md).
        size: pixels that the photo's longer side is scaled down to.

    Raises:
        UserError: for what cannot be read.
    """
    if path.suffix.lower() == ".exr":
        return baked_figure(path)
    if path.suffix.lower() in (".obj", ".ply", ".glb", ".gltf", ".stl", ".npz"):
        raise UserError(f"{path} is no photo and no maps: `relight bake` makes maps of a mesh (.exr)")
    assert relighter is not None, "photos need a relighter"
    return photo_figure(relighter.scene(path, mask, size))


def portrait(relighter: api.Relighter) -> Figure:
    """Makes the figure of the portrait of Eileen Collins by NASA (public domain)."""
    return replace(photo_figure(relighter.scene(PORTRAIT, PORTRAIT_MASK)), title="Eileen Collins (NASA)")


def photo_figure(scene: Scene) -> Figure:
    """Makes the figure of a photo: what the network infers about its people, at the photo's pixels.

    A page has one light a photo: several people share the mean of theirs, weighted by area.

    Args:
        scene: with a picture of 8 bits, whose name is the title of the figure, and a network of `train.color=photo`.
    """
    people, pixels = scene.people, scene.picture.codes
    coverage = total_coverage(people)
    shape = coverage.shape
    albedo, transport = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 9), np.float32)
    for person in people:
        fits = person.fitted_albedo, person.fit(person.transport[..., :9])
        for window, own, share, root, values in placed_maps(person, people, pixels, fits):
            albedo[window][own] += share * root**2
            transport[window][own] += share * values
    ao = np.clip(transport[..., 0] / UNOCCLUDED_T00, 0, 1)
    normal, depth = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32)  # networks infer no geometry
    alpha, albedo = coverage / np.float32(255), np.clip(albedo, 0, 1)
    maps = Maps(coverage > 0, alpha, albedo, normal, depth, ao, transport)
    picture = on_white(scene.picture.rgba) / np.float32(255)
    return Figure(scene.picture.name, maps, picture, scene.light[:9], notes=tuple(scene.notes))
