"""Test figures path traced in the panoramas of the test lights: what relit pictures are compared with.

Relighting takes a picture to be albedo * (T.L). It is the irradiance on the surface that is traced, so that albedo is
the same on both sides, in any colour model: once in the panorama cut to the order of T and L, once in the whole one,
and once with interreflection. Traced pictures are noisy, so each is made twice, from independent samples.
"""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from relight import config
from relight.evaluation.evaluate import chosen_pairs, pixels, torch_device
from relight.evaluation.panels import spaced
from relight.files import UserError, atomic_write
from relight.learning.data import RelitSet
from relight.lights import LightSet, read_light_set
from relight.meshes import Mesh
from relight.npz import read_npz
from relight.panoramas import Panorama
from relight.progress import progress
from relight.sh import basis, order_of
from relight.transport import PathTracer
from relight.transport.tracer import ROWS, block_means, sky_directions, sky_weights

FINE = 4  # k x k transports in a pixel stand for its area
OVER = 4  # k x k looks into the panorama per texel of the sky


@dataclass
class Scene:
    """A figure relit.

    Attributes:
        figure: its index in the packed set.
        seen, new: the lights in which it is shown and relit, by their row in the light set.
        light: (K,3), of the sky.
        area: (P,3), irradiance by transport as the mean over each pixel's area.
        cut, direct, full: (2,P,3), traced irradiance of the cut sky, of the whole one, and with interreflection too,
            each made twice.
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
    meshes: Path,
    panoramas: config.Panoramas,
    evaluate: config.Evaluate,
    settings: config.Trace,
    order: int,
    rays: int,
    out: Path,
) -> None:
    """Path traces test figures, each relit by one test light, having been seen under another.

    Args:
        packed, lights, split: the data set.
        meshes: the folder of aligned meshes.
        panoramas: where the panoramas of the lights are from.
        evaluate: which lights.
        settings: `figures`, how many, spread over the test set; `samples`, paths per pixel; `bounces`.
        order, rays: of the transport.
        out: their irradiance (.npz), a Scene each.

    Raises:
        UserError: Mitsuba is not installed, or a light has no panorama.
    """
    data = RelitSet(packed, lights, order, "paper", torch_device("cpu"))
    figures, lit = chosen_pairs(data, split, evaluate.lights)
    chosen = figures[spaced(len(figures), settings.figures)].tolist()
    table, scenes = read_light_set(lights), []
    for i, figure in enumerate(progress(chosen, "figures traced")):
        seen, new = (int(lit[(i + k) % len(lit)]) for k in (0, 1))
        mesh = Mesh.load(meshes / f"{data.names[figure]}.npz")
        sky = sky_of(table, new, panoramas)
        scenes.append(Scene(figure, seen, new, *traced(mesh, data, figure, sky, settings, rays)))
    arrays = {f"{i}.{name}": value for i, scene in enumerate(scenes) for name, value in vars(scene).items()}
    with atomic_write(out) as tmp, open(tmp, "wb") as file:
        np.savez_compressed(file, **arrays)


def read_scenes(path: Path) -> list[Scene]:
    """Reads what `trace` wrote.

    Raises:
        UserError: it is another file.
    """
    stored = read_npz(path, "set of traced pictures")
    count = len({name.partition(".")[0] for name in stored})
    names = [field.name for field in fields(Scene)]
    try:
        found = [{name: stored[f"{i}.{name}"] for name in names} for i in range(count)]
    except KeyError as error:
        raise UserError(f"{path}: not what relight-trace writes ({error})") from None
    return [
        Scene(int(figure), int(seen), int(new), *arrays)
        for figure, seen, new, *arrays in ([one[name] for name in names] for one in found)
    ]


def traced(
    mesh: Mesh, data: RelitSet, figure: int, sky: np.ndarray, settings: config.Trace, rays: int
) -> tuple[np.ndarray, ...]:
    """light, area, cut, direct, full of a Scene."""
    order = order_of(data.lights.shape[1])
    harmonics = basis(sky_directions(), order)
    light = np.einsum("hw,hwk,hwc->kc", sky_weights(), harmonics, sky)
    pixel = pixels(data, figure)
    tracer, samples = PathTracer(mesh, data.size), max(1, settings.samples // 2)

    def twice(source: np.ndarray, bounces: int, first: int) -> np.ndarray:
        images = [tracer.irradiance(source, samples, bounces, 10 * settings.seed + first + k) for k in (0, 1)]
        return np.stack([image.reshape(-1, 3)[pixel] for image in images]).astype(np.float32)

    area = area_irradiance(mesh, data.size, light, order, rays)[pixel]
    return light, area, twice(harmonics @ light, 0, 1), twice(sky, 0, 3), twice(sky, settings.bounces, 5)


def area_irradiance(mesh: Mesh, size: int, light: np.ndarray, order: int, rays: int) -> np.ndarray:
    """T.L (size^2, 3) as the mean over each pixel's area, its albedo being the weight, as in `Tracer.irradiance`."""
    from relight.transport import bake

    fine = bake(mesh, FINE * size, max(16, rays // FINE), order)  # the mean over FINE^2 places takes noise away
    color = np.maximum(fine.albedo, 1e-6) * fine.mask[..., None]
    lit = block_means(color * (fine.transport @ light), FINE) / np.maximum(block_means(color, FINE), 1e-12)
    return lit.reshape(-1, 3).astype(np.float32)


def sky_of(table: LightSet, row: int, panoramas: config.Panoramas) -> np.ndarray:
    """The panorama (ROWS, 2 ROWS, 3) that a light of the set was projected from, turned and scaled as the light was."""
    from relight.photos.environment import lookup

    panorama = panorama_of(str(table.source[row]), float(table.yaw[row]), panoramas)
    # Means over each texel's area: the lamps of a room are smaller than a texel, and their light must not be missed.
    fine = np.mean([lookup(panorama, directions) for directions in shifted_directions()], 0)
    return fine.astype(np.float64) * float(table.scale[row])


def shifted_directions() -> list[np.ndarray]:
    """OVER^2 sets of directions (ROWS, 2 ROWS, 3) that fill each texel evenly."""
    theta, phi = np.linspace(0, np.pi, ROWS), 2 * np.pi * (np.arange(2 * ROWS) + 0.5) / (2 * ROWS)
    sets = []
    for dv in (np.arange(OVER) + 0.5) / OVER - 0.5:
        for du in (np.arange(OVER) + 0.5) / OVER - 0.5:
            t = np.clip(theta + dv * np.pi / (ROWS - 1), 0, np.pi)[:, None]
            p = (phi + du * np.pi / ROWS)[None]
            sets.append(np.stack([np.sin(t) * np.sin(p), np.cos(t) + 0 * p, -np.sin(t) * np.cos(p)], -1))
    return sets


def panorama_of(source: str, yaw: float, panoramas: config.Panoramas) -> Panorama:
    """The panorama of a light set's `source`, turned by `yaw` degrees after what the settings do to all of them."""
    from relight.lights.chain import GENERATORS, read_from_folder

    if panoramas.source == "folder":
        return read_from_folder(source, panoramas, yaw)
    kind, _, seed = source.partition(":")
    if kind not in GENERATORS:
        raise UserError(f"{source}: path tracing needs the panorama of a light, and this one is in no file")
    return Panorama(GENERATORS[kind](int(seed)), flip=panoramas.flip, yaw=panoramas.yaw + yaw, source=source)
