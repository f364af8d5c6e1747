"""Answers the benchmark with relight's own networks, trivial baselines, and ground truth."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from relight.benchmark.files import BenchmarkSet, Entry, keep_record, square_mask, write_arrays
from relight.core.errors import UserError
from relight.core.files import file_hash, writable_folder
from relight.core.progress import progress
from relight.core.srgb import LINEAR, decode
from relight.maps import read_maps
from relight.maps.square import fill_outside
from relight.panoramas import project, read_panorama
from relight.photos.color import apply_gain
from relight.photos.network import PhotoNetwork, read_network
from relight.photos.person import Person, infer_person
from relight.photos.render import render
from relight.photos.shading import gain, shading
from relight.pictures.codes import to_srgb8

Method = Callable[[BenchmarkSet, Entry], dict[str, np.ndarray]]  # to the arrays of an answer
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
    if method == "network":
        network = read_network(weights, threads=1)
        apply, record["weights"] = _inferred_by(network), network.digest
    else:
        apply = BASELINES[method]
        record |= {"weights": read_network().digest} if method == "mean_light" else {}
    problem = f"{out} holds answers of another method, network or set: give another folder"
    if not (out / RECORD).is_file() and any(out.glob("*.npz")):
        raise UserError(problem)
    keep_record(out / RECORD, record, problem)
    wanted = [entry for entry in benchmark.entries if method == "network" or not entry.of]
    missing = [entry for entry in wanted if not (out / f"{entry.name}.npz").is_file()]
    for entry in progress(missing, f"answers of {out.name}"):
        write_arrays(out / f"{entry.name}.npz", file_hash(entry.folder / "photo.png"), apply(benchmark, entry))
    return len(missing)


def _inferred_by(network: PhotoNetwork) -> Method:
    """Returns the method that infers by a network and relights, like `relight photo`; lights keep their exposure."""

    def apply(benchmark: BenchmarkSet, entry: Entry) -> dict[str, np.ndarray]:
        """Returns albedo, shading and transport (side,side,C), light (9,3), and the relit pictures (N,H,W,3) uint8."""
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
                arrays[mode] = np.stack([render(shot.photo, [person], light, mode) for light in lights])
        return arrays

    return apply


def _resize_to_square(values: np.ndarray, person: Person, inside: np.ndarray) -> np.ndarray:
    """Resamples maps (S,S,C) of a network's square, known where the mask of `person` is.

    Returns (side,side,C) float32 on the square of the benchmark, zero outside its mask `inside`.
    """
    side = len(inside)
    if side != len(values):
        whole = fill_outside(values, person.mask)
        channels = [np.ascontiguousarray(whole[..., c], np.float32) for c in range(whole.shape[-1])]
        size, bilinear = (side, side), Image.Resampling.BILINEAR
        values = np.stack([np.asarray(Image.fromarray(c).resize(size, bilinear)) for c in channels], -1)
    return values * inside[..., None]


def as_it_is(benchmark: BenchmarkSet, entry: Entry) -> dict[str, np.ndarray]:
    """Answers with the photograph itself for every light."""
    return {"ratio": np.repeat(entry.shot().photo[None], entry.new, 0)}


def mean_light(benchmark: BenchmarkSet, entry: Entry) -> dict[str, np.ndarray]:
    """Relights by true transport, and takes the mean training light for the old one.

    Returns:
        The mean light (9,3), the shading by it (S,S,3), and the relit pictures (N,H,W,3) uint8.
    """
    light = mean_training_light()
    ratio = _relight_by_ratio(benchmark, entry, light)
    truth, _ = benchmark.truth(entry)
    assert truth.transport is not None  # a set with true maps has it
    return {"light": light, "shading": shading(truth.transport, light), "ratio": ratio}


@cache
def mean_training_light() -> np.ndarray:
    """Returns the mean (9,3) of the lights that the package's network was trained on."""
    lights = read_network().lights
    assert lights is not None  # the package's weights hold them
    return lights[:, :9].mean(0).astype(np.float64)


def true_maps(benchmark: BenchmarkSet, entry: Entry) -> dict[str, np.ndarray]:
    """Answers with the true maps (S,S,C) and the true light (9,3), and with relit pictures (N,H,W,3) uint8 by them.

    Light and transport have nine coefficients, and relit pictures are computed from them: their errors are those of
    the formulation.
    """
    maps = read_maps(benchmark.maps(entry))
    truth, _ = benchmark.truth(entry)
    full = [to_srgb8(maps.albedo * shading(maps.transport, light)) for light in new_lights(entry)]
    # A set with true maps has all of them.
    assert truth.albedo is not None and truth.transport is not None and truth.light is not None
    return {
        "albedo": truth.albedo,
        "transport": truth.transport,
        "light": truth.light,
        "shading": shading(truth.transport, truth.light),
        "full": np.stack(full),
        "ratio": _relight_by_ratio(benchmark, entry, truth.light),
    }


def new_lights(entry: Entry) -> list[np.ndarray]:
    """Returns the radiance coefficients (9,3) of each new light of a picture."""
    return [project(read_panorama(path), order=2) for path in entry.panoramas()]


def _relight_by_ratio(benchmark: BenchmarkSet, entry: Entry, light: np.ndarray) -> np.ndarray:
    """Relights a photograph by the ratio of new to old shading, both by true transport: (N,H,W,3) uint8.

    `light` (9,3) is taken for that of the photograph.
    """
    maps, linear = read_maps(benchmark.maps(entry)), LINEAR[entry.shot().photo]
    gains = (gain(maps.transport, maps.mask, light, new) for new in new_lights(entry))
    return np.stack([to_srgb8(apply_gain(linear, factor)) for factor in gains])


BASELINES: dict[str, Method] = {"as_it_is": as_it_is, "mean_light": mean_light, "true_maps": true_maps}
