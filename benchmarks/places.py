"""Measures how well the light of a place is estimated from one picture of it, and fits the statistics that ship.

    python benchmarks/places.py [--views 64] [--rooms 1200] [--write]

Views of the eighteen panoramas of `relight light setup`, each left out in turn of whatever is fitted, and of generated
rooms and skies of other seeds. The error is that of the nine coefficients of the irradiance, relative, at the factor
that makes it smallest: a photo's exposure is matched anyway. Prints the table of docs/lab/lights.md. With --write, fits
to all panoramas and writes relight/lights/place.json.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from relight.files import atomic_write
from relight.lights.chain import GENERATORS
from relight.lights.place import (
    IRRADIANCE,
    SIDE,
    STATISTICS,
    WHITE,
    PlaceStatistics,
    features,
    lamp_parts,
    thumbnail,
    tint,
)  # fmt: skip
from relight.panoramas import Panorama, luminance, polyhaven, project, read_panorama
from relight.photos.compose.environment import lookup
from relight.sh import rotate_y, rotation_about_y
from relight.srgb import encode, to_bytes

HEIGHT = SIDE * 3 // 4
MIRROR = np.array([1, 1, 1, -1, -1, 1, 1, -1, 1.0])[:, None]  # of coefficients, at the plane x = 0
KINDS = ("room", "room", "room", "sky")
TRAINING_SEED, TEST_SEED = 200_000, 900_000  # of generated panoramas
TEST_ROOMS = 120
FEATURE_PENALTY, RIDGE_GRID, RIDGE_PENALTY = 0.003, (3, 4), 0.03
AIM = np.radians([[20], [10]])  # deviation of a direction that a user states, azimuth and elevation


@dataclass
class Views:
    """Pictures of places and their lights.

    Attributes:
        codes: (N,HEIGHT,SIDE,3) uint8 sRGB.
        light: (N,9,3) irradiance coefficients in the frame of an upright camera.
        angle: (N,) field of view, radians.
    """

    codes: np.ndarray
    light: np.ndarray
    angle: np.ndarray

    def __post_init__(self) -> None:
        self.pictures = np.stack([thumbnail(codes) for codes in self.codes])
        self.tints = np.stack([tint(picture) for picture in self.pictures])[:, None]
        self.features = np.stack([features(picture) for picture in self.pictures])
        self.shapes = unit(self.light / self.tints)

    @cached_property
    def mirrored(self) -> "Views":
        """Returns the mirror images."""
        return Views(self.codes[:, :, ::-1], self.light * MIRROR, self.angle)


Method = Callable[[Views], np.ndarray]  # to lights (N,9,3)


def take_views(panoramas: Sequence[Panorama], count: int, seed: int) -> Views:
    """Takes pictures of panoramas in turn, as phones take them: hand-held, exposed by their median.

    Args:
        panoramas: to photograph.
        count: number of pictures.
        seed: of headings, angles, exposure, white balance and noise.

    Returns:
        The pictures with their true lights, in the frame of the camera, and angles of view.
    """
    rng = np.random.default_rng(seed)
    lights = [project(panorama) for panorama in panoramas]
    codes, light, angles = [], [], []
    for number in range(count):
        panorama = panoramas[number % len(panoramas)]
        yaw, pitch, angle = rng.uniform((-np.pi, *np.radians((-12, 45))), (np.pi, *np.radians((8, 80))))
        radiance = lookup(panorama, view_directions(pitch, angle) @ rotation_about_y(yaw))
        gain = 0.25 * np.exp(rng.uniform(-0.7, 0.7)) / max(float(np.median(luminance(radiance))), 1e-5)
        balance = gain * np.exp(np.array([-0.6, 0, 1]) * rng.normal(0, 0.08))
        noise = rng.normal(0, 2 / 255, radiance.shape)
        codes.append(to_bytes(encode(radiance * balance) + noise))
        light.append(rotate_y(lights[number % len(panoramas)], yaw) * balance * IRRADIANCE)
        angles.append(angle)
    return Views(np.stack(codes), np.stack(light), np.array(angles))


def view_directions(pitch: float, angle: float) -> np.ndarray:
    """Returns the directions (HEIGHT,SIDE,3) of a camera's pixels; it looks up by `pitch`, radians."""
    focal = SIDE / 2 / np.tan(angle / 2)
    x, y = (np.arange(SIDE) + 0.5 - SIDE / 2) / focal, (HEIGHT / 2 - np.arange(HEIGHT) - 0.5) / focal
    rays = np.stack(np.broadcast_arrays(x, y[:, None], -1.0), -1)
    up = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    return rays @ up.T


def errors(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Returns the relative errors (N,) of lights (N,9,3), each at its best factor."""
    a, b = (light.reshape(len(light), -1) for light in (estimate, truth))
    factor = (a * b).sum(1) / np.maximum((a * a).sum(1), 1e-12)
    return np.linalg.norm(factor[:, None] * a - b, axis=1) / np.linalg.norm(b, axis=1)


def unit(lights: np.ndarray) -> np.ndarray:
    """Scales lights (N,9,3) to norm 1."""
    return lights / np.linalg.norm(lights, axis=(1, 2))[:, None, None]


def fit(parts: Sequence[Sequence[Views]], inputs: Callable[[Views], np.ndarray], penalty: float = 0.0) -> np.ndarray:
    """Fits the shapes of lights (irradiance of norm 1, without the tint) by least squares.

    Args:
        parts: groups of views that have the same weight, whatever their sizes; mirror images are added.
        inputs: function to (N,J), whose first column is the constant.
        penalty: on the square of every coefficient but the constant's.

    Returns:
        (J,27).
    """
    square, cross = 0.0, 0.0
    for part in parts:
        views = [view for taken in part for view in (taken, taken.mirrored)]
        x = np.concatenate([inputs(view) for view in views])
        y = np.concatenate([view.shapes for view in views]).reshape(len(x), -1)
        square, cross = square + x.T @ x / len(x) / len(parts), cross + x.T @ y / len(x) / len(parts)
    ridge = penalty * np.eye(len(square))
    ridge[0, 0] = 0
    return np.linalg.solve(square + ridge, cross)


def constant(views: Views) -> np.ndarray:
    """Returns the input of the mean light."""
    return np.ones((len(views.light), 1))


def with_features(views: Views) -> np.ndarray:
    """Returns the inputs of `place_light`."""
    return np.concatenate([constant(views), views.features], 1)


def cells(views: Views) -> np.ndarray:
    """Returns the inputs of the ridge regression: a thumbnail, its root, and shares of clipped pixels."""
    rows, columns = RIDGE_GRID
    whole = views.pictures.reshape(-1, rows, HEIGHT // rows, columns, SIDE // columns, 3)
    mean = whole.mean((2, 4)).reshape(len(whole), -1) / views.pictures.mean((1, 2, 3))[:, None]
    clipped = (whole.max(-1) > WHITE).mean((2, 4)).reshape(len(whole), -1)
    return np.concatenate([constant(views), mean, np.sqrt(mean), clipped], 1)


def by(coefficients: np.ndarray, inputs: Callable[[Views], np.ndarray], tinted: bool = True) -> Method:
    """Returns the linear method of coefficients that `fit` found.

    Args:
        coefficients: (inputs, outputs).
        inputs: from views to (views, inputs).
        tinted: whether the method infers the light without the tint of the picture, which is then multiplied in.
    """
    return lambda views: (inputs(views) @ coefficients).reshape(-1, 9, 3) * (views.tints if tinted else 1)


def flat(views: Views) -> np.ndarray:
    """Lights by the picture's mean color from everywhere."""
    return np.eye(9)[0][:, None] * views.pictures.mean((1, 2))[:, None]


def mirrored_sphere(views: Views) -> np.ndarray:
    """Spreads the picture over the sphere, mirrored at its left and right edges; its rows reach from pole to pole."""
    height, width = 32, 64
    row = ((np.arange(height) + 0.5) / height * HEIGHT).astype(int)
    azimuth = (2 * (np.arange(width) + 0.5) / width - 1) * np.pi
    lights = []
    for picture, angle in zip(views.pictures, views.angle):
        across = (azimuth / angle + 0.5) % 2  # of the picture's width, and on through its mirror image
        column = (np.minimum(across, 2 - across) * (SIDE - 1)).round().astype(int)
        lights.append(project(Panorama(picture[row][:, column])) * IRRADIANCE)
    return np.stack(lights)


def main_directions(lights: np.ndarray) -> np.ndarray:
    """Returns the unit vectors (N,3) from which lights (N,9,3) mainly come."""
    vectors = luminance(lights)[:, [3, 1, 2]]  # band 1 has y, z, x
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def fit_lamp(parts: Sequence[Sequence[Views]]) -> np.ndarray:
    """Fits the factors (3,) of `lamp_parts`, for irradiance of norm 1 in grey."""
    square, cross = np.zeros((3, 3)), np.zeros(3)
    for part in parts:
        for views in part:
            x = lamp_parts(main_directions(views.light)) * IRRADIANCE
            weight = 1 / (len(x) * len(part))
            square += weight * np.einsum("nkj,nki->ji", x, x)
            cross += weight * np.einsum("nkj,nk->j", x, views.shapes.mean(2))
    return np.linalg.solve(square, cross)


def stated(lamp: np.ndarray, deviation: np.ndarray) -> Method:
    """Returns the method of a stated direction, which deviates from the light's main one: azimuth and elevation."""

    def method(views: Views) -> np.ndarray:
        x, y, z = main_directions(views.light).T
        a, e = (
            np.array([np.arctan2(x, z), np.arcsin(y)]) + np.random.default_rng(3).normal(size=(2, len(x))) * deviation
        )
        e = np.clip(e, -np.pi / 2, np.pi / 2)
        toward = np.stack([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)], -1)
        return (lamp_parts(toward) @ lamp)[..., None] * IRRADIANCE * views.tints

    return method


def fitted_methods(parts: Sequence[Sequence[Views]]) -> dict[str, Method]:
    """Returns the methods that know lights of places, fitted to groups of equal weight."""
    mean, lamp = fit(parts, constant), fit_lamp(parts)
    return {
        "mean light": by(mean, constant, tinted=False),
        "mean light, tinted": by(mean, constant),
        "**relight**: and toward the brighter side": by(fit(parts, with_features, FEATURE_PENALTY), with_features),
        f"ridge on a thumbnail of {RIDGE_GRID[1]} x {RIDGE_GRID[0]}": by(fit(parts, cells, RIDGE_PENALTY), cells),
        "**relight**, direction stated": stated(lamp, 0 * AIM),
        "the same, stated wrong by 20 degrees, and 10 up or down": stated(lamp, AIM),
    }


def statistics_of(parts: Sequence[Sequence[Views]]) -> PlaceStatistics:
    """Fits what ships."""
    every = [views for part in parts for views in part]
    measured = np.concatenate([views.features for views in every])
    limits = np.percentile(measured, (1, 99), axis=0)
    limits[:, 0] = np.abs(limits[:, 0]).max() * np.array([-1, 1])  # left is as right
    ratios = [
        np.log(np.linalg.norm(views.light, axis=(1, 2)) / luminance(views.pictures).mean((1, 2))) for views in every
    ]
    light = fit(parts, with_features, FEATURE_PENALTY).reshape(-1, 9, 3) / IRRADIANCE
    return PlaceStatistics(light, *limits, fit_lamp(parts), float(np.exp(np.concatenate(ratios).mean())))


def write(statistics: PlaceStatistics, provenance: str) -> None:
    """Writes the statistics as relight reads them."""
    limits = np.stack([statistics.least, statistics.most], -1)
    tables = {"lamp": statistics.lamp, "limits": limits, "light": statistics.light.reshape(len(statistics.light), -1)}
    content = {"provenance": provenance, "level": round(statistics.level, 4)}
    content |= {name: (table.round(4) + 0).tolist() for name, table in tables.items()}  # + 0: no -0.0
    text = json.dumps(content).replace('", "', '",\n"').replace(', "', ',\n"').replace("], [", "],\n [")
    with atomic_write(STATISTICS) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def main() -> None:
    """Prints the errors of all methods, each real place left out of its fit; writes the statistics if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=64, help="of each real panorama")
    parser.add_argument("--rooms", type=int, default=1200, help="generated panoramas, with four views each")
    parser.add_argument("--write", action="store_true", help="write what ships")
    options = parser.parse_args()
    start = time.process_time()
    real = [
        take_views([read_panorama(polyhaven.panorama_file(name))], options.views, 100 + number)
        for number, name in enumerate(polyhaven.NAMES)
    ]
    training, test = (
        take_views(generated(first, count), 4 * count, 1)
        for first, count in ((TRAINING_SEED, options.rooms), (TEST_SEED, TEST_ROOMS))
    )
    unfitted = {"picture mirrored over the sphere": mirrored_sphere, "its mean color": flat}
    found: dict[str, list[float]] = {}
    for number, held_out in enumerate(real):
        methods = unfitted | fitted_methods([real[:number] + real[number + 1 :], [training]])
        for name, method in methods.items():
            found.setdefault(name, []).append(float(errors(method(held_out), held_out.light).mean()))
    methods = unfitted | fitted_methods([real, [training]])
    print("| light | 18 real places, each left out | worst of them | generated, other seeds |\n|---|---|---|---|")
    for name, values in found.items():
        worst = int(np.argmax(values))
        numbers = np.mean(values), values[worst], errors(methods[name](test), test.light).mean()
        print("| {} | {:.3f} | {:.3f} ({}) | {:.3f} |".format(name, *numbers[:2], polyhaven.NAMES[worst], numbers[2]))
    if options.write:
        package = f"{polyhaven.PACKAGE.name} {polyhaven.PACKAGE.version}"
        write(
            statistics_of([real, [training]]),
            f"benchmarks/places.py: {options.views} views of each of the {len(real)} panoramas by Poly Haven (CC0) in "
            f"{package}, four of each of {options.rooms} generated rooms and skies",
        )
    print(f"{time.process_time() - start:.0f} CPU-seconds")


def generated(first: int, count: int) -> list[Panorama]:
    """Generates rooms and skies from the seed `first` on; rooms without any light are left out."""
    pictures = [GENERATORS[KINDS[seed % len(KINDS)]](seed) for seed in range(first, first + count)]
    return [Panorama(picture) for picture in pictures if np.isfinite(picture).all()]


if __name__ == "__main__":
    main()
