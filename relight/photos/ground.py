"""The ground that figures stand on before a new background, with the shadows that they cast there and where they touch.

Each figure's outline is filled with balls, as deep as they are wide, that stand upright where its feet are. From points
of the ground the sky is looked at past the balls. That gives transport, as everywhere here, T = integral of Y V cos:
under a light L the ground is as bright as T.L, and as T0.L where nothing is in the way. T knows no light, so a light
that turns costs no more than a product.

The camera is that of relight.photos.environment: it looks along -z, level, with the horizon in the middle row. The unit
of length is its height above the ground, which is the plane y = -1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, gaussian_filter, label

from relight.photos.environment import VIEW
from relight.photos.frame import SOLID
from relight.sh import basis
from relight.transport.sampling import vogel_directions

RAYS = 160  # of each point of the ground
FINE = 150  # points of the ground to a figure's height
COARSE = 120  # pixels to which a figure is reduced to be filled
BALLS, LEAST = 200, 1.4  # at most so many, with a radius of so many of those pixels at least
SPACING = 0.9  # of a ball's radius, from its centre to the next one's
FEET, LEGS = 0.12, 0.45  # of the height: where feet are told apart, and up to where each leg stands over its foot
RISE = 0.35  # of the height: that the horizon is above the feet at least
REACH = 1.6  # heights from the feet to where the shadow has faded
DIMMEST = 0.1  # of the mean irradiance: what reaches the deepest shadow by further bounces


@dataclass(frozen=True)
class Camera:
    """focal: in pixels; horizon: its row; middle: column that the camera looks at."""

    focal: float
    horizon: float
    middle: float

    def at(self, x: np.ndarray, y: np.ndarray, depth: np.ndarray | float) -> np.ndarray:
        """The points (...,3) that are seen at pixels (x, y), at this depth."""
        right, up = (x - self.middle) / self.focal, (self.horizon - y) / self.focal
        return np.stack(np.broadcast_arrays(right * depth, up * depth, -depth), -1)

    def depth(self, y: np.ndarray | float) -> np.ndarray | float:
        """Of the ground in rows y below the horizon."""
        return self.focal / (y - self.horizon)


@dataclass(frozen=True)
class Ground:
    """Part of a photo in which ground is seen, rows and columns half-open, and how it is lit at points (h,w) evenly in
    it: transport that is hidden (h,w,K), T0 - T, and of the open ground, T0 (K,).
    """

    rows: tuple[int, int]
    columns: tuple[int, int]
    hidden: np.ndarray
    open: np.ndarray

    def shade(self, light: np.ndarray) -> np.ndarray:
        """(h,w,3) in [0,1]: the ground's brightness under `light` (K,3), as a share of that with nobody there."""
        count = min(len(self.open), len(light))
        light = np.asarray(light[:count], np.float32)
        least = DIMMEST * np.maximum(light[0], 1e-6) * np.float32(np.pi * 0.5 / np.sqrt(np.pi))  # pi Y00 L00: the mean
        whole = np.maximum(self.open[:count] @ light, 0)
        left = np.maximum(self.open[:count] @ light - self.hidden[..., :count] @ light, 0)
        return np.minimum((left + least) / (whole + least), 1)

    def darken(self, background: np.ndarray, light: np.ndarray, top: int = 0, left: int = 0) -> None:
        """Puts the shadows under `light` (K,3) on `background` (h,w,3), linear, in place. That holds all of the ground,
        and its first pixel is the photo's at `top` and `left`.
        """
        shade = self.shade(light)
        (first, last), (start, stop) = self.rows, self.columns
        part = background[first - top : last - top, start - left : stop - left]
        for channel in range(3):
            small = Image.fromarray(np.ascontiguousarray(shade[..., channel]))
            part[..., channel] *= np.asarray(small.resize((stop - start, last - first), Image.Resampling.BILINEAR))


def ground(coverages: Sequence[np.ndarray], order: int = 2) -> Ground | None:
    """The ground under people, each (H,W) uint8 of a photo; None when nobody's feet are in the picture."""
    height, width = coverages[0].shape
    boxes = [(coverage, _box(coverage)) for coverage in coverages]
    standing = [(coverage, box) for coverage, box in boxes if box[1] < height]
    if not standing:
        return None
    tops, bottoms, lefts, rights = zip(*(box for _, box in standing))
    tall = max(bottom - top for top, bottom in zip(tops, bottoms))
    focal = max(height, width) / 2 / np.tan(np.radians(VIEW / 2))
    camera = Camera(focal, min(height / 2, min(bottoms) - RISE * tall), width / 2)
    balls = np.concatenate([_balls(coverage, box, camera) for coverage, box in standing])
    reach = REACH * tall * camera.depth(max(bottoms)) / focal
    rows = int(camera.horizon + focal / (camera.depth(min(bottoms)) + reach)), height
    columns = max(int(min(lefts) - REACH * tall), 0), min(int(max(rights) + REACH * tall), width)
    (y, x) = (
        first + (np.arange(count) + 0.5) * (last - first) / count
        for first, last in (rows, columns)
        for count in [max(round((last - first) * min(FINE / tall, 1)), 2)]
    )
    x, y = np.meshgrid(x, y)
    points = camera.at(x, y, camera.depth(y))
    hidden, whole = _transport(points.reshape(-1, 3), balls, order)
    hidden = gaussian_filter(hidden.reshape(*x.shape, -1), (1, 1, 0), mode="nearest")
    feet = np.array([camera.at((box[2] + box[3]) / 2, box[1], camera.depth(box[1])) for _, box in standing])
    away = np.linalg.norm(points[..., None, :] - feet, axis=-1).min(-1) / reach
    fade = np.clip(2 - 2 * away, 0, 1)[..., None]
    return Ground(rows, columns, (hidden * fade).astype(np.float32), whole.astype(np.float32))


def _transport(points: np.ndarray, balls: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """For points (P,3) that face up: the transport that `balls` (N,4) hide (P,K), and that of the open sky (K,)."""
    directions = vogel_directions(RAYS)[:, [1, 2, 0]].astype(np.float32)  # about +y
    values = basis(directions, order) * (np.pi / RAYS)
    points, balls = points.astype(np.float32), balls.astype(np.float32)
    along = balls[:, :3] @ directions.T
    hidden = np.empty((len(points), values.shape[1]))
    for first in range(0, len(points), 256):
        part = points[first : first + 256]
        away = balls[:, :3] - part[:, None]
        tangent = np.sqrt(
            np.maximum((away**2).sum(-1) - balls[:, 3] ** 2, 0)
        )  # cosine of the ball's edge, times distance
        nearest = (part @ directions.T)[:, None] + tangent[..., None]
        hidden[first : first + 256] = (along > nearest).any(1) @ values
    return hidden, values.sum(0)


def _box(coverage: np.ndarray) -> tuple[int, int, int, int]:
    """Top, bottom, left and right of the solid part."""
    solid = coverage >= SOLID
    rows, columns = np.flatnonzero(solid.any(1)), np.flatnonzero(solid.any(0))
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def _balls(coverage: np.ndarray, box: tuple[int, int, int, int], camera: Camera) -> np.ndarray:
    """(N,4): centres and radii of the balls that fill a figure."""
    top, bottom, left, right = box
    scale = min(COARSE / (bottom - top), 1)
    size = max(round((right - left) * scale), 1), max(round((bottom - top) * scale), 1)
    small = Image.fromarray(coverage[top:bottom, left:right]).resize(size, Image.Resampling.BOX)
    solid = np.asarray(small) >= SOLID
    y, x = np.mgrid[: size[1], : size[0]]
    room = distance_transform_edt(np.pad(solid, 1))[1:-1, 1:-1] - 0.5  # to the outline, not to the next pixel's centre
    found = []
    while len(found) < BALLS and (radius := room.max()) >= LEAST:
        row, column = np.unravel_index(room.argmax(), room.shape)
        found.append((column, row, radius))
        room = np.where(np.hypot(x - column, y - row) < SPACING * radius, 0, room)
    column, row, radius = (np.array(found).reshape(-1, 3).T + [[0.5], [0.5], [0.0]]) / scale
    foot = bottom - _lift(solid, column * scale) / scale
    upright = np.clip((bottom - top - row) / (LEGS * (bottom - top)), 0, 1)
    depth = camera.depth(foot) * (1 - upright) + camera.depth(bottom) * upright
    centres = camera.at(left + column, top + row, depth)
    return np.column_stack([centres, radius * depth / camera.focal])


def _lift(solid: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """How many rows above the lowest one the foot ends that is nearest to each of `columns`."""
    first = int((1 - FEET) * len(solid))
    parts, count = label(solid[first:])
    feet = [np.nonzero(parts == i) for i in range(1, count + 1)]
    middle = np.array([columns_.mean() for _, columns_ in feet])
    lift = np.array([len(solid) - first - 1 - rows.max() for rows, _ in feet])
    return lift[np.abs(columns[:, None] - middle).argmin(1)]
