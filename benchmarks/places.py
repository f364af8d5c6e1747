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
from relight.panoramas.lookup import lookup
from relight.sh import rotate_y, rotation_about_y
from relight.srgb import encode, to_bytes

HEIGHT = SIDE * 3 // 4
MIRROR = np.array([1, 1, 1, -1, -1, 1, 1, -1, 1.0])[:, None]  # of coefficients, at the plane x = 0
KINDS = ("room", "room", "room", "sky")
TRAINING_SEED, TEST_SEED = 200_000, 900_000  # of generated panoramas
TEST_ROOMS = 120
MEDIAN = 0.25  # linear value that a camera gives to the median of a picture
EXPOSURES = (-0.7, 0.7)  # range of the natural logarithm of its deviation from that
TINT = 0.08  # standard deviation of ln(B/G) of the white balance
FEATURE_PENALTY = 0.003  # on the coefficients of the features
RIDGE_GRID, RIDGE_PENALTY = (3, 4), 0.03  # rows and columns of the thumbnail, and the penalty on its coefficients
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
        """Computes what is fitted: thumbnails, their tints (N,1,3) and features (N,J), and lights of norm 1."""
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
    """Takes pictures of panoramas as phones take them: hand-held, and exposed by their median.

    Args:
        panoramas: of which pictures are taken in turn.
        count: number of pictures.
        seed: of directions, fields of view, exposures and white balances.
    """
    rng = np.random.default_rng(seed)
    lights = [project(panorama) for panorama in panoramas]
    codes, light, angles = [], [], []
    for number in range(count):
        panorama = panoramas[number % len(panoramas)]
        # Radians; pitch from -12 to 8 degrees, field of view from 45 to 80.
        yaw, pitch, angle = rng.uniform((-np.pi, *np.radians((-12, 45))), (np.pi, *np.radians((8, 80))))
        radiance = lookup(panorama, view_directions(pitch, angle) @ rotation_about_y(yaw))
        exposed = MEDIAN * np.exp(rng.uniform(*EXPOSURES))
        gain = exposed / max(float(np.median(luminance(radiance))), 1e-5)
        balance = gain * np.exp(np.array([-0.6, 0, 1]) * rng.normal(scale=TINT))  # of red, green and blue
        noise = rng.normal(scale=2 / 255, size=radiance.shape)
        codes.append(to_bytes(encode(radiance * balance) + noise))
        light.append(rotate_y(lights[number % len(panoramas)], yaw) * balance * IRRADIANCE)
        angles.append(angle)
    return Views(np.stack(codes), np.stack(light), np.array(angles))


def view_directions(pitch: float, angle: float) -> np.ndarray:
    """Returns the directions of a camera's pixels.

    Args:
        pitch: angle by which it looks up, radians.
        angle: horizontal field of view, radians.

    Returns:
        (HEIGHT,SIDE,3), not normalised, in the frame of an upright camera.
    """
    focal = SIDE / 2 / np.tan(angle / 2)
    x, y = (np.arange(SIDE) + 0.5 - SIDE / 2) / focal, (HEIGHT / 2 - np.arange(HEIGHT) - 0.5) / focal
    rays = np.stack(np.broadcast_arrays(x, y[:, None], -1.0), -1)
    up = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    return rays @ up.T


def errors(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Returns the relative errors (N,) of lights (N,9,3), each at its best factor."""
    estimate, truth = (lights.reshape(len(lights), -1) for lights in (estimate, truth))
    factor = (estimate * truth).sum(1) / np.maximum((estimate**2).sum(1), 1e-12)
    return np.linalg.norm(factor[:, None] * estimate - truth, axis=1) / np.linalg.norm(truth, axis=1)


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
    square, cross = 0.0, 0.0  # of the normal equations, as means over the groups
    for part in parts:
        views = [view for taken in part for view in (taken, taken.mirrored)]
        x = np.concatenate([inputs(view) for view in views])
        y = np.concatenate([view.shapes for view in views]).reshape(len(x), -1)
        square, cross = square + x.T @ x / len(x) / len(parts), cross + x.T @ y / len(x) / len(parts)
    ridge = penalty * np.eye(len(square))
    ridge[0, 0] = 0
    return np.linalg.solve(square + ridge, cross)


def constant(views: Views) -> np.ndarray:
    """Returns the input (N,1) of the mean light, which is 1 for every view."""
    return np.ones((len(views.light), 1))


def with_features(views: Views) -> np.ndarray:
    """Returns the inputs (N,J) of `relight.lights.place.place_light`: 1, and the features of the views."""
    return np.concatenate([constant(views), views.features], 1)


def cells(views: Views) -> np.ndarray:
    """Returns the inputs (N,J) of the ridge regression: 1, a thumbnail, its root, and shares of clipped pixels."""
    rows, columns = RIDGE_GRID
    whole = views.pictures.reshape(-1, rows, HEIGHT // rows, columns, SIDE // columns, 3)
    mean = whole.mean((2, 4)).reshape(len(whole), -1) / views.pictures.mean((1, 2, 3))[:, None]
    clipped = (whole.max(-1) > WHITE).mean((2, 4)).reshape(len(whole), -1)
    return np.concatenate([constant(views), mean, np.sqrt(mean), clipped], 1)


def fitted(coefficients: np.ndarray, inputs: Callable[[Views], np.ndarray], tinted: bool = True) -> Method:
    """Returns the method of a fit.

    Args:
        coefficients: (J,27), from `fit`.
        inputs: function to (N,J), with which they were fitted.
        tinted: whether lights get the tint of their picture.
    """
    return lambda views: (inputs(views) @ coefficients).reshape(-1, 9, 3) * (views.tints if tinted else 1)


def flat(views: Views) -> np.ndarray:
    """Returns lights (N,9,3) of the picture's mean color from everywhere."""
    only_constant = np.eye(9)[0][:, None]
    return only_constant * views.pictures.mean((1, 2))[:, None]


def mirrored_sphere(views: Views) -> np.ndarray:
    """Returns lights (N,9,3) by spreading each picture over the sphere.

    It is mirrored at its left and right edges; its rows reach from pole to pole.
    """
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
    vectors = luminance(lights)[:, [3, 1, 2]]
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def fit_lamp(parts: Sequence[Sequence[Views]]) -> np.ndarray:
    """Fits the light of a lamp in the main direction of each view, by least squares of its irradiance in grey.

    Args:
        parts: groups of views that have the same weight, whatever their sizes.

    Returns:
        The factors (3,) of the parts of `relight.lights.place.lamp_parts`, for irradiance of norm 1.
    """
    square, cross = np.zeros((3, 3)), np.zeros(3)  # of the normal equations
    for part in parts:
        for views in part:
            x = lamp_parts(main_directions(views.light)) * IRRADIANCE
            weight = 1 / (len(x) * len(part))
            square += weight * np.einsum("nkj,nki->ji", x, x)
            cross += weight * np.einsum("nkj,nk->j", x, views.shapes.mean(2))
    return np.linalg.solve(square, cross)


def stated(lamp: np.ndarray, deviation: np.ndarray) -> Method:
    """Returns the method that is told the main direction of the light.

    Args:
        lamp: (3,) factors, from `fit_lamp`.
        deviation: (2,1) standard deviation of the error of its azimuth and elevation, radians.
    """

    def method(views: Views) -> np.ndarray:
        """Returns lights (N,9,3) of a lamp in the stated directions."""
        x, y, z = main_directions(views.light).T
        errors = np.random.default_rng(3).normal(size=(2, len(x))) * deviation
        azimuth, elevation = np.array([np.arctan2(x, z), np.arcsin(y)]) + errors
        elevation = np.clip(elevation, -np.pi / 2, np.pi / 2)
        horizontal = np.cos(elevation)
        toward = np.stack([np.sin(azimuth) * horizontal, np.sin(elevation), np.cos(azimuth) * horizontal], -1)
        return (lamp_parts(toward) @ lamp)[..., None] * IRRADIANCE * views.tints

    return method


def fitted_methods(parts: Sequence[Sequence[Views]]) -> dict[str, Method]:
    """Returns the methods that know lights of places, fitted to groups of equal weight."""
    mean, lamp = fit(parts, constant), fit_lamp(parts)
    return {
        "mean light": fitted(mean, constant, tinted=False),
        "mean light, tinted": fitted(mean, constant),
        "**relight**: and toward the brighter side": fitted(fit(parts, with_features, FEATURE_PENALTY), with_features),
        f"ridge on a thumbnail of {RIDGE_GRID[1]} x {RIDGE_GRID[0]}": fitted(fit(parts, cells, RIDGE_PENALTY), cells),
        "**relight**, direction stated": stated(lamp, 0 * AIM),
        "the same, stated wrong by 20 degrees, and 10 up or down": stated(lamp, AIM),
    }


def statistics_of(parts: Sequence[Sequence[Views]]) -> PlaceStatistics:
    """Fits the statistics that ship with relight to groups of views of equal weight."""
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
    """Prints the table, and writes the statistics if `--write` is given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=64, help="of each real panorama")
    parser.add_argument("--rooms", type=int, default=1200, help="generated panoramas, with four views each")
    parser.add_argument("--write", action="store_true", help="write what ships")
    options = parser.parse_args()
    start = time.process_time()
    real = [
        take_views([read_panorama(polyhaven.panorama_file(name))], options.views, seed=100 + number)
        for number, name in enumerate(polyhaven.NAMES)
    ]
    training, test = (
        take_views(generated(first, count), 4 * count, seed=1)
        for first, count in ((TRAINING_SEED, options.rooms), (TEST_SEED, TEST_ROOMS))
    )
    unfitted = {"picture mirrored over the sphere": mirrored_sphere, "its mean color": flat}
    errors_of: dict[str, list[float]] = {}  # method -> mean error in each place
    for number, held_out in enumerate(real):
        methods = unfitted | fitted_methods([real[:number] + real[number + 1 :], [training]])
        for name, method in methods.items():
            errors_of.setdefault(name, []).append(float(errors(method(held_out), held_out.light).mean()))
    methods = unfitted | fitted_methods([real, [training]])
    print("| light | 18 real places, each left out | worst of them | generated, other seeds |\n|---|---|---|---|")
    for name, values in errors_of.items():
        worst = int(np.argmax(values))
        on_generated = errors(methods[name](test), test.light).mean()
        of_worst = f"{values[worst]:.3f} ({polyhaven.NAMES[worst]})"
        print(f"| {name} | {np.mean(values):.3f} | {of_worst} | {on_generated:.3f} |")
    if options.write:
        package = f"{polyhaven.PACKAGE.name} {polyhaven.PACKAGE.version}"
        write(
            statistics_of([real, [training]]),
            f"benchmarks/places.py: {options.views} views of each of the {len(real)} panoramas by Poly Haven (CC0) in "
            f"{package}, four of each of {options.rooms} generated rooms and skies",
        )
    print(f"{time.process_time() - start:.0f} CPU-seconds")


def generated(first: int, count: int) -> list[Panorama]:
    """Generates rooms and skies of `count` seeds from `first` on; rooms without any light are left out."""
    pictures = [GENERATORS[KINDS[seed % len(KINDS)]](seed) for seed in range(first, first + count)]
    return [Panorama(picture) for picture in pictures if np.isfinite(picture).all()]


if __name__ == "__main__":
    main()
