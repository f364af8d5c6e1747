"""Fits the statistics by which the light of a place is estimated, and writes relight/lights/place.json.

python tools/places.py

It takes 64 views of each panorama of `relight light setup`, and four of each of 1,200 generated rooms and skies. The
errors are in docs/lab/lights.md.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from relight.core.files import atomic_write
from relight.core.srgb import encode, to_bytes
from relight.lights.chain import GENERATORS
from relight.lights.place import IRRADIANCE, SIDE, STATISTICS, features, lamp_parts, thumbnail, tint
from relight.panoramas import Panorama, luminance, polyhaven, project, read_panorama
from relight.panoramas.lookup import lookup
from relight.sh import rotate_y, rotation_about_y

VIEWS, ROOMS = 64, 1200  # of each real panorama; generated panoramas
ROOM_SEED = 200_000  # of the first generated panorama
KINDS = ("room", "room", "room", "sky")
HEIGHT = SIDE * 3 // 4
MIRROR = np.array([1, 1, 1, -1, -1, 1, 1, -1, 1.0])[:, None]  # of coefficients, at the plane x = 0
MEDIAN = 0.25  # linear value that a camera gives to the median of a picture
EXPOSURES = (-0.7, 0.7)  # range of the natural logarithm of its deviation from that
TINT = 0.08  # standard deviation of ln(B/G) of the white balance
PENALTY = 0.003  # on the square of the coefficients of features


@dataclass
class Views:
    """Pictures of places and their lights.

    Attributes:
        codes: (N,HEIGHT,SIDE,3) uint8 sRGB.
        light: (N,9,3) irradiance coefficients in the frame of an upright camera.
    """

    codes: np.ndarray
    light: np.ndarray

    def __post_init__(self) -> None:
        """Computes what is fitted: mean luminances (N,), features (N,J), and lights of norm 1 without their tint."""
        pictures = [thumbnail(codes) for codes in self.codes]
        self.level = np.array([luminance(picture).mean() for picture in pictures])
        self.features = np.stack([features(picture) for picture in pictures])
        untinted = self.light / np.stack([tint(picture) for picture in pictures])[:, None]
        self.shapes = untinted / np.linalg.norm(untinted, axis=(1, 2))[:, None, None]

    @cached_property
    def mirrored(self) -> "Views":
        """Returns the mirror images."""
        return Views(self.codes[:, :, ::-1], self.light * MIRROR)


Group = Sequence[Views]  # groups have the same weight, whatever their sizes


def take_views(panoramas: Sequence[Panorama], count: int, seed: int) -> Views:
    """Takes pictures of panoramas in turn as phones take them: hand-held, and exposed by their median."""
    rng = np.random.default_rng(seed)
    lights = [project(panorama) for panorama in panoramas]
    codes, light = [], []
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
    return Views(np.stack(codes), np.stack(light))


def view_directions(pitch: float, angle: float) -> np.ndarray:
    """Returns the directions (HEIGHT,SIDE,3) of a camera's pixels, not normalised, in the frame of an upright camera.

    Args:
        pitch: angle by which it looks up, radians.
        angle: horizontal field of view, radians.
    """
    focal = SIDE / 2 / np.tan(angle / 2)
    x, y = (np.arange(SIDE) + 0.5 - SIDE / 2) / focal, (HEIGHT / 2 - np.arange(HEIGHT) - 0.5) / focal
    rays = np.stack(np.broadcast_arrays(x, y[:, None], -1.0), -1)
    up = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    return rays @ up.T


def generated(first: int, count: int) -> list[Panorama]:
    """Generates rooms and skies of `count` seeds from `first` on; rooms without any light are left out."""
    pictures = [GENERATORS[KINDS[seed % len(KINDS)]](seed) for seed in range(first, first + count)]
    return [Panorama(picture) for picture in pictures if np.isfinite(picture).all()]


def fit_light(groups: Sequence[Group]) -> np.ndarray:
    """Fits the mean light and its change with each feature (J,9,3) by least squares, mirror images included."""
    square, cross = 0.0, 0.0  # of the normal equations, as means over the groups
    for group in groups:
        views = [view for taken in group for view in (taken, taken.mirrored)]
        measured = np.concatenate([view.features for view in views])
        x = np.concatenate([np.ones((len(measured), 1)), measured], 1)
        y = np.concatenate([view.shapes for view in views]).reshape(len(x), -1)
        square, cross = square + x.T @ x / len(x) / len(groups), cross + x.T @ y / len(x) / len(groups)
    ridge = PENALTY * np.eye(len(square))
    ridge[0, 0] = 0
    return np.linalg.solve(square + ridge, cross).reshape(-1, 9, 3) / IRRADIANCE


def fit_lamp(groups: Sequence[Group]) -> np.ndarray:
    """Fits the factors (3,) of `lamp_parts` for a lamp in the main direction of each view, in grey."""
    square, cross = np.zeros((3, 3)), np.zeros(3)  # of the normal equations
    for group in groups:
        for views in group:
            toward = luminance(views.light)[:, [3, 1, 2]]
            x = lamp_parts(toward / np.linalg.norm(toward, axis=1)[:, None]) * IRRADIANCE
            weight = 1 / (len(x) * len(group))
            square += weight * np.einsum("nkj,nki->ji", x, x)
            cross += weight * np.einsum("nkj,nk->j", x, views.shapes.mean(2))
    return np.linalg.solve(square, cross)


def main() -> None:
    """Writes what `relight.lights.place` reads."""
    panoramas = [read_panorama(polyhaven.panorama_file(name), repair=True) for name in polyhaven.NAMES]
    real = [take_views([panorama], VIEWS, seed=100 + number) for number, panorama in enumerate(panoramas)]
    groups = [real, [take_views(generated(ROOM_SEED, ROOMS), 4 * ROOMS, seed=1)]]
    every = [views for group in groups for views in group]
    limits = np.percentile(np.concatenate([views.features for views in every]), (1, 99), axis=0)
    limits[:, 0] = np.abs(limits[:, 0]).max() * np.array([-1, 1])  # left is as right
    ratios = [np.log(np.linalg.norm(views.light, axis=(1, 2)) / views.level) for views in every]
    light = fit_light(groups)
    tables = {"lamp": fit_lamp(groups), "limits": limits.T, "light": light.reshape(len(light), -1)}
    package = f"{polyhaven.PACKAGE.name} {polyhaven.PACKAGE.version}"
    content = {
        "provenance": f"tools/places.py: {VIEWS} views of each of the {len(real)} panoramas by Poly Haven (CC0) in "
        f"{package}, four of each of {ROOMS} generated rooms and skies",
        "level": round(float(np.exp(np.concatenate(ratios).mean())), 4),
        **{name: (table.round(4) + 0).tolist() for name, table in tables.items()},  # + 0: no -0.0
    }
    text = json.dumps(content).replace('", "', '",\n"').replace(', "', ',\n"').replace("], [", "],\n [")
    with atomic_write(STATISTICS) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
