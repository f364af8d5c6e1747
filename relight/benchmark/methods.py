"""Answers the benchmark with relight's own networks, trivial baselines, and ground truth."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from PIL import Image

from relight.benchmark.files import Answer, BenchmarkSet, Entry, keep_record, square_mask, write_arrays
from relight.benchmark.lights import resampled
from relight.benchmark.make import make_mesh
from relight.benchmark.picture import MIN_ALBEDO, Settings, crop_maps, crop_window, scene_baker
from relight.benchmark.recipes import draw_recipes
from relight.core.errors import UserError
from relight.core.files import file_hash, writable_folder
from relight.core.progress import progress
from relight.core.srgb import LINEAR, decode
from relight.maps import read_maps
from relight.maps.square import fill_outside
from relight.panoramas import project, read_panorama
from relight.photos.backdrop import resized
from relight.photos.network import PhotoNetwork, read_network
from relight.photos.person import Person, infer_person
from relight.photos.render import frames
from relight.photos.shading import gain, gain_between, shade
from relight.photos.tone import apply_gain
from relight.pictures.codes import to_srgb8
from relight.transport.tracer import PathTracer

RECORD = "answers.json"  # in a folder of answers: what made them


def answer(folder: Path | str, out: Path | str, method: str, weights: Path | None = None) -> int:
    """Writes the missing answers of a method to a set.

    Args:
        folder: folder of the benchmark's set.
        out: folder of the answers.
        method: `network`, or a key of BASELINES.
        weights: file of the network; by default the package's.

    Returns:
        The number of answers written.

    Raises:
        UserError: for an unknown method, weights that it does not use, a missing set, a folder that cannot be written,
            or one that holds the answers of another method, network or set.
    """
    if method != "network" and method not in BASELINES:
        raise UserError(f"--method {method}: must be one of network, {', '.join(BASELINES)}")
    if method != "network" and weights:
        raise UserError(f"--weights {weights} is for --method network, not {method}: omit one of them")
    benchmark, out = BenchmarkSet(folder), writable_folder(out, "--out")
    record = {"set": benchmark.hash, "method": method}
    if method in BASELINES:
        apply = BASELINES[method]
        record |= {"weights": read_network().digest} if method == "mean_light" else {}
    else:
        network = read_network(weights, threads=1)
        apply, record["weights"] = partial(inferred, network=network), network.digest
    problem = f"{out} holds answers of another method, network or set: give another folder"
    if not (out / RECORD).is_file() and any(out.glob("*.npz")):
        raise UserError(problem)
    keep_record(out / RECORD, record, problem)
    wanted = [entry for entry in benchmark.entries if method == "network" or not entry.of]
    missing = [entry for entry in wanted if not (out / f"{entry.name}.npz").is_file()]
    for entry in progress(missing, f"answers of {out.name}"):
        write_arrays(out / f"{entry.name}.npz", file_hash(entry.folder / "photo.png"), apply(benchmark, entry))
    return len(missing)


def inferred(benchmark: BenchmarkSet, entry: Entry, network: PhotoNetwork) -> Answer:
    """Infers by a network and relights, like `relight photo`; lights keep their exposure.

    Returns:
        Albedo, shading and transport (side,side,C), light (9,3), and the relit pictures (N,H,W,3) uint8.
    """
    shot = entry.shot()
    person = infer_person(network, shot.photo, shot.mask, replace(shot.square, size=network.size))
    inside = square_mask(entry)
    # A network of train.color=paper, whose gamma is not 1, infers coded values.
    albedo = person.albedo if person.gamma == 1 else decode(person.albedo)
    maps = {"albedo": albedo, "shading": person.shading**person.gamma, "transport": person.transport[..., :9]}
    arrays = {name: _resize_to_square(values, person, inside) for name, values in maps.items()}
    arrays["light"] = person.light[:9]
    if entry.new:
        lights = [project(read_panorama(path), network.order).astype(np.float32) for path in entry.panoramas()]
        for mode in ("ratio", "full"):
            arrays[mode] = np.stack([*frames(shot.photo, [person], [(light, 0.0) for light in lights], mode)])
    return arrays


def _resize_to_square(values: np.ndarray, person: Person, inside: np.ndarray) -> np.ndarray:
    """Resamples maps (S,S,C) of a network's square, known where the mask of `person` is.

    Returns (side,side,C) float32 on the square of the benchmark, zero outside its mask `inside`.
    """
    if inside.shape != values.shape[:2]:
        values = resized(fill_outside(values, person.mask), inside.shape, method=Image.Resampling.BILINEAR)
    return values * inside[..., None]


def as_it_is(benchmark: BenchmarkSet, entry: Entry) -> Answer:
    """Answers with the photograph itself for every light."""
    return {"ratio": np.repeat(entry.shot().photo[None], entry.new, 0)}


def mean_light(benchmark: BenchmarkSet, entry: Entry) -> Answer:
    """Relights by true transport, and takes the mean training light for the old one.

    Returns:
        The mean light (9,3), the shading by it (S,S,3), and the relit pictures (N,H,W,3) uint8.
    """
    light = mean_training_light()
    maps, linear = read_maps(benchmark.maps(entry)), LINEAR[entry.shot().photo]
    new = (project(read_panorama(path), order=2) for path in entry.panoramas())
    gains = [gain(maps.transport, maps.mask, light, one) for one in new]
    ratio = np.stack([to_srgb8(apply_gain(linear, factor)) for factor in gains])
    truth, _ = benchmark.truth(entry)
    assert truth.transport is not None  # a set with true maps has it
    return {"light": light, "shading": shade(truth.transport, light), "ratio": ratio}


@cache
def mean_training_light() -> np.ndarray:
    """Returns the mean (9,3) of the lights that the package's network was trained on."""
    network = read_network()
    return np.reshape(network.config["lights"], (-1, (network.order + 1) ** 2, 3))[:, :9].mean(0)


def true_maps(benchmark: BenchmarkSet, entry: Entry, order: int = 2) -> Answer:
    """Answers with the true maps (S,S,C) and the true light (9,3), and with relit pictures (N,H,W,3) uint8 by them.

    Relit pictures are of light and transport of an `order`: their errors are those of the formulation.
    """
    maps = read_maps(benchmark.maps(entry)) if order == 2 else Scene(benchmark, entry, order).maps
    old, *new = (project(read_panorama(path), order) for path in (benchmark.light(entry), *entry.panoramas()))
    gains = [gain(maps.transport, maps.mask, old, light) for light in new]
    return _true(benchmark, entry, [maps.albedo * shade(maps.transport, light) for light in new], gains)


def exact(benchmark: BenchmarkSet, entry: Entry) -> Answer:
    """Answers like `true_maps`, but by irradiance that is traced in the lights themselves, without gloss or bounces."""
    scene, settings = Scene(benchmark, entry), benchmark.index["settings"]
    sources = [read_panorama(path) for path in (benchmark.light(entry), *entry.panoramas())]
    tracer = PathTracer(scene.mesh, settings["size"], scene.camera)
    skies = [resampled(source) for source in sources]
    traced = [np.pi * tracer.radiance(sky, settings["samples"], seed=n)[scene.window] for n, sky in enumerate(skies)]
    albedo = np.maximum(scene.maps.albedo * scene.maps.coverage[..., None], MIN_ALBEDO)
    old, *new = (project(source, order=2) for source in sources)
    gains = [
        gain_between(traced[0] / albedo, image / albedo, scene.maps.mask, old, light)
        for image, light in zip(traced[1:], new)
    ]
    return _true(benchmark, entry, traced[1:], gains)


def _true(benchmark: BenchmarkSet, entry: Entry, pictures: list[np.ndarray], gains: list[np.ndarray]) -> Answer:
    """Returns an answer with true maps and light, and with relit pictures (H,W,3), linear, and by gains (H,W,3)."""
    truth, linear = benchmark.truth(entry)[0], LINEAR[entry.shot().photo]
    # A set with true maps has all of them.
    assert truth.albedo is not None and truth.transport is not None and truth.light is not None
    relit = {"full": pictures, "ratio": [apply_gain(linear, factor) for factor in gains]}
    known = {"albedo": truth.albedo, "transport": truth.transport, "light": truth.light}
    known["shading"] = shade(truth.transport, truth.light)
    return known | {mode: np.stack([to_srgb8(picture) for picture in by_light]) for mode, by_light in relit.items()}


class Scene:
    """The figure of a picture of a set, made again.

    Attributes:
        mesh: of the figure.
        camera: of the picture.
        window: of the photo, in the camera's picture.
        maps: within the window.
    """

    def __init__(self, benchmark: BenchmarkSet, entry: Entry, order: int = 2):
        """Makes the figure of an entry, with transport of an order."""
        settings = Settings(**benchmark.index["settings"])
        (recipe,) = (recipe for recipe in draw_recipes(benchmark.index["set"]) if recipe.name == entry.name)
        self.mesh = make_mesh(recipe.seed, settings)
        baker = scene_baker(self.mesh, settings, order)
        maps, self.camera = baker.maps(recipe.view), baker.camera(recipe.view)
        self.window = crop_window(maps.mask, recipe.cut)
        self.maps = crop_maps(maps, self.window)


BASELINES: dict[str, Callable[[BenchmarkSet, Entry], Answer]] = {
    "as_it_is": as_it_is,
    "mean_light": mean_light,
    "true_maps": true_maps,
    **{f"true_maps_{order}": partial(true_maps, order=order) for order in (3, 4, 6)},
    "exact": exact,
}
