"""Path traces test figures in the panoramas of the test lights, as references for relit pictures.

A relit picture is albedo * (T.L). The irradiance on the surface is traced, so that the albedo is the same in relit and
traced pictures, in any color model. It is traced in the panorama cut to the order of T and L, in the whole panorama,
and with interreflection. Each is traced twice, from independent samples, since traced pictures are noisy.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from relight import settings as config
from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.core.npz import read_npz
from relight.core.progress import progress
from relight.evaluation.pictures.panels import evenly_spaced
from relight.evaluation.scoring.evaluate import pixels, select_pairs
from relight.learning.data import RelitSet
from relight.lights import LightSet, read_light_set
from relight.meshes import Mesh
from relight.panoramas import Panorama
from relight.sh import basis, order_of
from relight.transport import PathTracer
from relight.transport.tracer import block_means, sky_directions, sky_weights

PIXEL_SAMPLES = 4  # k: transport is averaged over k x k points of a pixel
MIN_RAYS = 16  # of each of these points
TEXEL_SAMPLES = 4  # k: the panorama is averaged over k x k points of a texel


@dataclass
class Scene:
    """A test figure traced under a new light.

    Attributes:
        figure: index in the packed set.
        seen, new: rows in the light set of the light of the input picture, and of the new light.
        light: (K,3) coefficients of the panorama.
        area: (P,3) irradiance by baked transport, as the mean over each pixel's area.
        cut, direct, full: (2,P,3) traced irradiance of the panorama cut to the order of T, of the whole panorama, and
            with interreflection; two independent renderings each.
    """

    figure: int
    seen: int
    new: int
    light: np.ndarray
    area: np.ndarray
    cut: np.ndarray
    direct: np.ndarray
    full: np.ndarray


def trace(
    packed: Path,
    lights: Path,
    split: Path,
    meshes: Mapping[str, Path],
    panoramas: config.Panoramas,
    settings: config.Trace,
    order: int,
    rays: int,
    out: Path,
) -> None:
    """Path traces test figures, each under a test light other than that of its input picture.

    Args:
        packed, lights, split: the data set.
        meshes: figure -> aligned mesh record (.npz).
        panoramas: source of the lights' panoramas.
        settings: number of figures, paths per pixel, bounces.
        order, rays: of the transport.
        out: the scenes (.npz).

    Raises:
        UserError: if Mitsuba is not installed, there is only one light, or a light has no panorama.
    """
    data = RelitSet(packed, lights, order, "paper")
    figures, light_indices = select_pairs(data, split)
    if len(light_indices) < 2:
        raise UserError("path tracing needs at least two test lights: raise lights.test")
    chosen = figures[evenly_spaced(len(figures), settings.figures)].tolist()
    table, scenes = read_light_set(lights), []
    for i, figure in enumerate(progress(chosen, "figures traced")):
        seen, new = (int(light_indices[(i + k) % len(light_indices)]) for k in (0, 1))
        mesh = Mesh.load(meshes[data.names[figure]])
        sky = sky_of(table, new, panoramas)
        scenes.append(Scene(figure, seen, new, **_trace_figure(mesh, data, figure, sky, settings, rays)))
    arrays = {f"{i}.{name}": value for i, scene in enumerate(scenes) for name, value in vars(scene).items()}
    with atomic_write(out) as tmp, open(tmp, "wb") as file:
        np.savez_compressed(file, **arrays)


def read_scenes(path: Path) -> list[Scene]:
    """Reads a file of `trace`. Raises UserError if it is another file."""
    stored = read_npz(path, "set of traced pictures")
    count = len({name.partition(".")[0] for name in stored})
    names = [field.name for field in fields(Scene)]
    try:
        scenes = [[stored[f"{i}.{name}"] for name in names] for i in range(count)]
    except KeyError as error:
        raise UserError(f"{path} is not a file of the stage trace ({error})") from None
    return [Scene(int(figure), int(seen), int(new), *arrays) for figure, seen, new, *arrays in scenes]


def _trace_figure(
    mesh: Mesh, data: RelitSet, figure: int, sky: np.ndarray, settings: config.Trace, rays: int
) -> dict[str, np.ndarray]:
    """Returns the arrays of a Scene by name, of a figure in a panorama (H,W,3) at `sky_directions`."""
    order = order_of(data.lights.shape[1])
    harmonics = basis(sky_directions(), order)
    light = np.einsum("hw,hwk,hwc->kc", sky_weights(), harmonics, sky)
    pixel = pixels(data, figure)
    tracer, samples = PathTracer(mesh, data.size), max(1, settings.samples // 2)  # each of two renderings has half

    def trace_twice(source: np.ndarray, bounces: int, seed: int) -> np.ndarray:
        """Returns the irradiance (2,P,3) from a panorama, with independent samples of `seed` and `seed + 1`."""
        images = [tracer.irradiance(source, samples, bounces, seed + k) for k in (0, 1)]
        return np.stack([image.reshape(-1, 3)[pixel] for image in images]).astype(np.float32)

    return {
        "light": light,
        "area": _area_irradiance(mesh, data.size, light, order, rays)[pixel],
        "cut": trace_twice(harmonics @ light, bounces=0, seed=1),  # negative in places, which the tracer allows
        "direct": trace_twice(sky, bounces=0, seed=3),
        "full": trace_twice(sky, settings.bounces, seed=5),
    }


def _area_irradiance(mesh: Mesh, size: int, light: np.ndarray, order: int, rays: int) -> np.ndarray:
    """Returns the irradiance T.L (size^2,3) by baked transport, as the mean over each pixel's area.

    The mean is weighted by the albedo, like that of `PathTracer.irradiance`, so that the two can be compared.
    """
    from relight.transport import bake

    # Fewer rays are enough, since the mean over PIXEL_SAMPLES^2 samples reduces noise.
    maps = bake(mesh, PIXEL_SAMPLES * size, max(MIN_RAYS, rays // PIXEL_SAMPLES), order)
    weight = np.maximum(maps.albedo, 1e-6) * maps.mask[..., None]  # black pixels have irradiance, too
    total = np.maximum(block_means(weight, PIXEL_SAMPLES), 1e-12)
    irradiance = block_means(weight * (maps.transport @ light), PIXEL_SAMPLES) / total
    return irradiance.reshape(-1, 3).astype(np.float32)


def sky_of(table: LightSet, row: int, panoramas: config.Panoramas) -> np.ndarray:
    """Returns the panorama of a row of a light set, rotated and scaled like it: (H,W,3), at `sky_directions`."""
    from relight.panoramas.lookup import lookup

    panorama = panorama_of(str(table.source[row]), float(table.yaw[row]), panoramas)
    # Means over each texel's area, since lamps of a room can be smaller than a texel.
    shifts = (np.arange(TEXEL_SAMPLES) + 0.5) / TEXEL_SAMPLES - 0.5
    radiance = np.mean([lookup(panorama, sky_directions(down, right)) for down in shifts for right in shifts], 0)
    return radiance.astype(np.float64) * float(table.scale[row])


def panorama_of(source: str, yaw: float, panoramas: config.Panoramas) -> Panorama:
    """Returns the panorama of a light by its source, a file or kind:seed. Raises UserError if it is of another kind."""
    from relight.lights.chain import GENERATORS, read_from_folder

    if panoramas.source == "folder":
        return read_from_folder(source, panoramas, yaw)
    kind, _, seed = source.partition(":")
    if kind not in GENERATORS:
        raise UserError(f"{source}: path tracing needs the panorama of a light, and this light has none")
    return Panorama(GENERATORS[kind](int(seed)), flip=panoramas.flip, yaw=yaw, source=source)
