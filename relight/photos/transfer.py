"""The command `transfer`: two photos, each in the light of the other."""

from pathlib import Path
from typing import Unpack

from relight.core.files import writable_folder
from relight.lights import Light
from relight.photos.look import Look
from relight.photos.network import PhotoNetwork
from relight.photos.scene import Scene, SceneOptions
from relight.photos.write import write_light_files, write_picture


def swap_lights(
    network: PhotoNetwork,
    paths: tuple[Path, Path],
    masks: tuple[Path | None, Path | None],
    out: Path | str,
    look: Look,
    **options: Unpack[SceneOptions],
) -> tuple[list[Path], list[str]]:
    """Relights each of two photos by the inferred light of the other, each in its own exposure.

    Args:
        network: that infers.
        paths: of the photos.
        masks: their files; by default they are found.
        out: folder of the results, named after the photos (me_1 and me_2, if both are called me).
        look: all but the light.
        **options: of `Scene.of`.

    Returns:
        The paths of the two pictures, and notes on the photos and their masks.
    """
    writable_folder(out, "--out")
    scenes = [Scene.of(path, mask, network, **options) for path, mask in zip(paths, masks)]
    names = [scene.picture.name for scene in scenes]
    if names[0].lower() == names[1].lower():  # some file systems do not distinguish a and A
        names = [f"{name}_{number}" for number, name in enumerate(names, 1)]
    lights = [Light(scene.light, name) for name, scene in zip(names, scenes)]
    relit = {}
    for name, scene, light in zip(names, scenes, lights[::-1]):
        path = Path(out) / f"{name}_lit_as_{light.source}{scene.picture.suffix}"
        relit[path] = scene.relit(look.lit_by(light, windowed=False))
    for path, pixels in relit.items():
        write_picture(path, pixels)
    for light in lights:
        write_light_files(Path(out) / f"{light.source}_light", light.coefficients, f"inferred from {light.source}")
    return list(relit), [f"{scene.picture.name}: {note}" for scene in scenes for note in scene.notes]
