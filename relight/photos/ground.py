"""The ground that people stand on before a new background, with the shadows that they cast on it.

The outline of each person is filled with balls, as deep as they are wide, that stand upright where the feet are. From
points of the ground, rays are cast past the balls to the sky. That gives transport as everywhere here, T = integral of
Y V cos: under a light L the ground has the irradiance T . L, and T0 . L where nothing occludes it. T does not depend on
the light, so a light that turns costs one product a frame.

The camera is that of relight.photos.backdrop: level, it looks along -z, and the horizon is in the middle row. The
unit of length is its height above the ground, the plane y = -1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, gaussian_filter, label

from relight.maps.square import MASK_THRESHOLD, extent
from relight.photos.backdrop import focal_length, resized
from relight.photos.mask.pose import Body
from relight.sh import basis
from relight.transport.sampling import vogel_directions

RAYS = 160  # of each point of the ground
FINE = 150  # points of the ground to a person's height
COARSE = 120  # pixels of height to which a person is reduced to be filled
MAX_BALLS, MIN_RADIUS = 200, 1.4  # number of balls, and least radius in those pixels
SPACING = 0.9  # distance of the centres of two balls, in radii
FEET, LEGS = 0.12, 0.45  # of the height: where feet are separated, and up to where each leg stands over its foot
SUNK = 1.0  # of those pixels: how deep soles are in the ground, since balls leave a gap under what is flat
FOOT_JOINTS = slice(27, 33)  # ankles, heels and toes among the joints of a body
SEEN, SOLE = 0.5, 0.05  # how sure a joint is seen; from the lowest one to the ground, of the height, at most
RISE = 0.35  # of the height: least height of the horizon above the feet
REACH = 1.6  # heights from the feet at which the shadow has faded
AMBIENT = 0.1  # of the mean irradiance: what reaches the deepest shadow by further bounces


@dataclass(frozen=True)
class Camera:
    """A level camera.

    Attributes:
        focal: length in pixels.
        horizon: its row.
        middle: the column of its axis.
    """

    focal: float
    horizon: float
    middle: float

    def unproject(self, x: np.ndarray | float, y: np.ndarray | float, depth: np.ndarray | float) -> np.ndarray:
        """Returns the points (...,3) at columns x and rows y, in the unit of `depth`, which is along the axis, -z."""
        right, up = (x - self.middle) / self.focal, (self.horizon - y) / self.focal
        return np.stack(np.broadcast_arrays(right * depth, up * depth, -depth), -1)

    def ground_depth(self, y: np.ndarray | float) -> np.ndarray | float:
        """Returns the depth of the ground in rows y below the horizon."""
        return self.focal / (y - self.horizon)


@dataclass(frozen=True)
class Ground:
    """The ground in a photo and its transport at h x w points spread evenly over that part.

    Attributes:
        rows: of the photo, half-open.
        columns: likewise.
        occluded: (h,w,K) transport that the people occlude, T0 - T.
        unoccluded: (K,) T0, that of the open ground.
    """

    rows: tuple[int, int]
    columns: tuple[int, int]
    occluded: np.ndarray = field(repr=False)
    unoccluded: np.ndarray = field(repr=False)

    def shadows(self, light: np.ndarray) -> np.ndarray:
        """Returns the irradiance of the ground under a light (K,3), relative to the open ground: (h,w,3) in [0,1]."""
        count = min(len(self.unoccluded), len(light))
        light = np.asarray(light[:count], np.float32)
        mean = np.maximum(light[0], 1e-6) * np.float32(np.pi * 0.5 / np.sqrt(np.pi))  # pi Y00 L00
        ambient = AMBIENT * mean
        whole = np.maximum(self.unoccluded[:count] @ light, 0)
        left = np.maximum(self.unoccluded[:count] @ light - self.occluded[..., :count] @ light, 0)
        return np.minimum((left + ambient) / (whole + ambient), 1)

    def with_shadows(self, background: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Returns a background (H,W,3), linear, darkened under a light (K,3)."""
        shadows, out = self.shadows(light), np.array(background)
        (first, last), (start, stop) = self.rows, self.columns
        size = last - first, stop - start
        out[first:last, start:stop] *= resized(shadows, size, method=Image.Resampling.BILINEAR)
        return out


def standing_box(coverage: np.ndarray, body: Body | None = None) -> tuple[int, int, int, int] | None:
    """Returns the box (top, bottom, left, right) of a person down to the ground; None if no foot is in the picture.

    Args:
        coverage: (H,W) uint8 of the person.
        body: what networks found of them. Without it, feet are seen where the mask ends above the lower edge.
    """
    (top, bottom), columns = extent(coverage >= MASK_THRESHOLD)
    if body is None:
        return (top, bottom, *columns) if bottom < len(coverage) else None
    x, y, seen = body.joints.T
    shown = (seen > SEEN) & (x > 0) & (x < 1) & (y < 1)
    if not shown[FOOT_JOINTS].any():
        return None
    ground = int(y[shown].max() * len(coverage) + SOLE * (bottom - top))  # what is below is a reflection, or floor
    return (top, min(bottom, ground), *columns) if ground > top else None


def ground_under(coverages: Sequence[np.ndarray], order: int = 2, bodies: Sequence[Body | None] = ()) -> Ground | None:
    """Computes the ground under people.

    Args:
        coverages: (H,W) uint8 of each person.
        order: of the spherical harmonics.
        bodies: what networks found of each person.

    Returns:
        The ground, or None if nobody's feet are in the picture (`standing_box`).
    """
    height, width = coverages[0].shape
    boxes = map(standing_box, coverages, bodies or [None] * len(coverages))
    if not (standing := [(coverage, box) for coverage, box in zip(coverages, boxes) if box]):
        return None
    tops, bottoms, lefts, rights = zip(*(box for _, box in standing))
    tall = max(bottom - top for top, bottom in zip(tops, bottoms))
    focal = focal_length((height, width))
    camera = Camera(focal, min(height / 2, min(bottoms) - RISE * tall), width / 2)
    balls = np.concatenate([_fill_with_balls(coverage, box, camera) for coverage, box in standing])
    reach = REACH * tall * camera.ground_depth(max(bottoms)) / focal
    rows = int(camera.horizon + focal / (camera.ground_depth(min(bottoms)) + reach)), height
    columns = max(int(min(lefts) - REACH * tall), 0), min(int(max(rights) + REACH * tall), width)
    (y, x) = (
        first + (np.arange(count) + 0.5) * (last - first) / count
        for first, last in (rows, columns)
        for count in [max(round((last - first) * min(FINE / tall, 1)), 2)]
    )
    x, y = np.meshgrid(x, y)
    points = camera.unproject(x, y, camera.ground_depth(y))
    occluded, whole = _transport(points.reshape(-1, 3), balls, order)
    occluded = gaussian_filter(occluded.reshape(*x.shape, -1), (1, 1, 0), mode="nearest")
    middles = [((left + right) / 2, bottom) for _, (_, bottom, left, right) in standing]
    feet = np.array([camera.unproject(x, y, camera.ground_depth(y)) for x, y in middles])
    away = np.linalg.norm(points[..., None, :] - feet, axis=-1).min(-1) / reach
    fade = np.clip(2 - 2 * away, 0, 1)[..., None]
    return Ground(rows, columns, (occluded * fade).astype(np.float32), whole.astype(np.float32))


def _transport(points: np.ndarray, balls: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the transport (P,K) that balls (N,4) occlude at points (P,3) that face up, and that of the open sky."""
    directions = vogel_directions(RAYS)[:, [1, 2, 0]].astype(np.float32)  # about +y
    values = basis(directions, order) * (np.pi / RAYS)
    points, balls = points.astype(np.float32), balls.astype(np.float32)
    along = balls[:, :3] @ directions.T
    occluded = np.empty((len(points), values.shape[1]))
    for first in range(0, len(points), 256):
        part = points[first : first + 256]
        away = balls[:, :3] - part[:, None]
        # Distance to the tangent point: the distance of the ball times the cosine of its angular radius.
        tangent = np.sqrt(np.maximum((away**2).sum(-1) - balls[:, 3] ** 2, 0))
        nearest = (part @ directions.T)[:, None] + tangent[..., None]
        occluded[first : first + 256] = (along > nearest).any(1) @ values
    return occluded, values.sum(0)


def _fill_with_balls(coverage: np.ndarray, box: tuple[int, int, int, int], camera: Camera) -> np.ndarray:
    """Fills a person with balls (N,4), the largest first. Feet stand on the ground, the rest is above them."""
    top, bottom, left, right = box
    scale = min(COARSE / (bottom - top), 1)
    size = max(round((right - left) * scale), 1), max(round((bottom - top) * scale), 1)
    small = Image.fromarray(coverage[top:bottom, left:right]).resize(size, Image.Resampling.BOX)
    solid = np.asarray(small) >= MASK_THRESHOLD
    y, x = np.mgrid[: size[1], : size[0]]
    room = distance_transform_edt(np.pad(solid, 1))[1:-1, 1:-1] - 0.5  # to the outline, not to the next pixel's centre
    balls: list[tuple[float, float, float]] = []
    while len(balls) < MAX_BALLS and (radius := room.max()) >= MIN_RADIUS:
        row, column = np.unravel_index(room.argmax(), room.shape)
        balls.append((float(column), float(row), radius))
        room = np.where(np.hypot(x - column, y - row) < SPACING * radius, 0, room)
    column, row, radius = (np.array(balls).reshape(-1, 3).T + [[0.5], [0.5], [0.0]]) / scale
    foot = bottom - (_lift(solid, column * scale) + SUNK) / scale
    upright = np.clip((bottom - top - row) / (LEGS * (bottom - top)), 0, 1)
    depth = camera.ground_depth(foot) * (1 - upright) + camera.ground_depth(bottom) * upright
    return np.column_stack([camera.unproject(left + column, top + row, depth), radius * depth / camera.focal])


def _lift(solid: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Returns, for each of `columns`, by how many rows the nearest foot ends above the lowest row."""
    first = int((1 - FEET) * len(solid))
    parts, count = label(solid[first:])
    if not count:  # only what is too thin for this size reaches so low
        return np.zeros(len(columns))
    feet = [np.nonzero(parts == i) for i in range(1, count + 1)]
    middle = np.array([columns_.mean() for _, columns_ in feet])
    lift = np.array([len(solid) - first - 1 - rows.max() for rows, _ in feet])
    return lift[np.abs(columns[:, None] - middle).argmin(1)]
