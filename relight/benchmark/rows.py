"""Answers of this project's own: its networks, and what costs nothing or knows everything."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from relight.benchmark.files import Entry, Set, inside_of, sha256, write_arrays
from relight.files import UserError, writable_folder
from relight.maps import read_maps
from relight.panoramas import project, read_panorama
from relight.photos.api import Relighter, load
from relight.photos.color import apply_gain, to_srgb8
from relight.photos.crop import fill_outside
from relight.photos.infer import Person
from relight.photos.render import render
from relight.photos.shading import shading, shading_floor, shading_ratio
from relight.progress import progress
from relight.srgb import LINEAR, decode

Method = Callable[[Set, Entry], dict[str, np.ndarray]]


def answer(folder: Path | str, out: Path | str, method: str, weights: Path | None = None) -> int:
    """Writes the answers of `method` to the set in `folder`, those that are missing; returns how many it wrote.

    method: `network` (of `weights`, those of the package by default), or one of TRIVIAL. Raises UserError.
    """
    if method != "network" and method not in TRIVIAL:
        raise UserError(f"--method {method}: network, {', '.join(TRIVIAL)}")
    benchmark, out = Set(folder), writable_folder(out, "--out")
    make = network(load(weights, threads=1)) if method == "network" else TRIVIAL[method]()
    asked = [entry for entry in benchmark.entries if method == "network" or not entry.of]
    missing = [entry for entry in asked if not (out / f"{entry.name}.npz").is_file()]
    for entry in progress(missing, f"answers of {out.name}"):
        write_arrays(out / f"{entry.name}.npz", sha256(entry.folder / "photo.png"), make(benchmark, entry))
    return len(missing)


def network(relighter: Relighter) -> Method:
    """A network, by the code of `relight photo`: relit pictures by `ratio` and `full`, lights not matched."""

    def apply(benchmark: Set, entry: Entry) -> dict[str, np.ndarray]:
        shot = entry.shot()
        figure = relighter.infer_person(shot.photo, shot.mask, replace(shot.square, size=relighter.network.size))
        inside = inside_of(entry)
        linear = figure.albedo if figure.gamma == 1 else decode(figure.albedo)
        found = {"albedo": linear, "shading": figure.shading**figure.gamma, "transport": figure.transport[..., :9]}
        found = {name: on_side(values, figure, inside) for name, values in found.items()} | {"light": figure.light[:9]}
        if entry.new:
            lights = [project(read_panorama(path), relighter.order).astype(np.float32) for path in entry.panoramas()]
            for mode in ("ratio", "full"):
                found[mode] = np.stack([render(shot.photo, [figure], light, mode) for light in lights])
        return found

    return apply


def on_side(values: np.ndarray, figure: Person, inside: np.ndarray) -> np.ndarray:
    """Maps (S,S,C) of a network's square at the pixels of `inside` (side,side), zero outside of it."""
    side = len(inside)
    if side != len(values):
        whole = fill_outside(values, figure.mask)
        channels = [np.ascontiguousarray(whole[..., c], np.float32) for c in range(whole.shape[-1])]
        kind = Image.Resampling.BILINEAR
        values = np.stack([np.asarray(Image.fromarray(c).resize((side, side), kind)) for c in channels], -1)
    return values * inside[..., None]


def as_it_is() -> Method:
    """The photograph, whatever the light."""
    return lambda benchmark, entry: {"ratio": np.repeat(entry.shot().photo[None], entry.new, 0)}


def mean_light() -> Method:
    """The mean of the lights that the package's network was trained on, and true maps."""
    lights = load().lights
    assert lights is not None  # the package's weights hold them
    light = lights[:, :9].mean(0).astype(np.float64)

    def apply(benchmark: Set, entry: Entry) -> dict[str, np.ndarray]:
        ratio = by_ratio(benchmark, entry, light)
        seen, _ = benchmark.truth(entry)
        assert seen.transport is not None  # a set with true maps has it
        return {"light": light, "shading": shading(seen.transport, light), "ratio": ratio}

    return apply


def true_maps() -> Method:
    """The true maps, and the true light in nine coefficients: its errors are those of the formulation."""

    def apply(benchmark: Set, entry: Entry) -> dict[str, np.ndarray]:
        maps = read_maps(benchmark.maps(entry))
        seen, _ = benchmark.truth(entry)
        full = [to_srgb8(maps.albedo * shading(maps.transport, light)) for light in new_lights(entry)]
        assert seen.albedo is not None and seen.transport is not None and seen.light is not None  # as the set has maps
        return {
            "albedo": seen.albedo,
            "transport": seen.transport,
            "light": seen.light,
            "shading": shading(seen.transport, seen.light),
            "full": np.stack(full),
            "ratio": by_ratio(benchmark, entry, seen.light),
        }

    return apply


def new_lights(entry: Entry) -> list[np.ndarray]:
    """The coefficients (9,3) of each of a picture's new lights."""
    return [project(read_panorama(path), 2) for path in entry.panoramas()]


def by_ratio(benchmark: Set, entry: Entry, light: np.ndarray) -> np.ndarray:
    """The photograph (N,H,W,3) times new over old shading of the true transport, the old one under `light` (9,3)."""
    maps, linear = read_maps(benchmark.maps(entry)), LINEAR[entry.shot().photo]
    old = shading(maps.transport, light)
    floor = shading_floor(old, maps.mask)
    gains = [shading_ratio(old, shading(maps.transport, new), floor) for new in new_lights(entry)]
    return np.stack([to_srgb8(apply_gain(linear, gain)) for gain in gains])


TRIVIAL: dict[str, Callable[[], Method]] = {"as_it_is": as_it_is, "mean_light": mean_light, "true_maps": true_maps}
