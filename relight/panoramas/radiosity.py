"""Renders panoramas of rooms: direct light on a grid of cells, then radiosity between the walls.

Furniture casts shadows and receives light. The light that it reflects is not traced; a lower albedo of the walls
accounts for what it absorbs.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from relight.panoramas.projection import latlong_directions, latlong_solid_angles

HEIGHT, WIDTH = 64, 128
CELLS = 8  # per side of a wall
BOX_CELLS = 3  # per side of a face of furniture
BOUNCES = 20  # leaves less than 1 % of the light in the room with the highest albedo
FURNITURE_ABSORPTION = 0.15  # share of the walls' reflected light that furniture absorbs
IN_PLANE = ((1, 2), (0, 2), (0, 1))  # the two axes in the plane of a wall whose normal is along x, y, z


@dataclass(frozen=True)
class AreaLight:
    """An emitting rectangle in a wall: sky or ground seen in a window, or a panel in the ceiling.

    Attributes:
        wall: its number, as in `Room`.
        low, high: (3,) metres, corners; equal along the wall's axis.
        radiance: (3,) linear RGB.
        daylight: whether it is a window, through which the sun can shine.
    """

    wall: int
    low: np.ndarray
    high: np.ndarray
    radiance: np.ndarray
    daylight: bool = False

    def contains(self, wall: np.ndarray, point: np.ndarray) -> np.ndarray:
        """Returns whether points (N,3) on walls (N,) lie in the rectangle, (N,) bool."""
        inside = (point >= self.low - 1e-6) & (point <= self.high + 1e-6)
        return (wall == self.wall) & inside[:, list(IN_PLANE[self.wall // 2])].all(1)


@dataclass(frozen=True)
class Lamp:
    """A spherical lamp.

    Attributes:
        centre: (3,) metres.
        radius: metres.
        radiance: (3,) linear RGB.
    """

    centre: np.ndarray
    radius: float
    radiance: np.ndarray


@dataclass(frozen=True)
class Box:
    """A piece of furniture.

    Attributes:
        low, high: (3,) metres, corners.
        albedo: (3,) linear RGB.
    """

    low: np.ndarray
    high: np.ndarray
    albedo: np.ndarray


@dataclass(frozen=True)
class Sun:
    """The sun, which shines through windows.

    Attributes:
        direction: (3,) unit vector toward the sun.
        irradiance: (3,) linear RGB, on a surface that faces the sun.
    """

    direction: np.ndarray
    irradiance: np.ndarray


@dataclass
class Room:
    """A box-shaped room from the origin to `size`, y up.

    Walls are numbered 2 * axis + side, with axes x, y, z and side 0 at the origin: FLOOR, CEILING and four more.

    Attributes:
        size: (3,) metres, along x, y and z.
        camera: (3,) metres, position of the panorama's camera.
        albedo: (6,3) of the walls, linear RGB.
        area_lights: windows and panels.
        lamps: spherical lamps.
        boxes: furniture.
        sun: the sun, or None.
    """

    size: np.ndarray
    camera: np.ndarray
    albedo: np.ndarray
    area_lights: list[AreaLight] = field(default_factory=list)
    lamps: list[Lamp] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    sun: Sun | None = None


def view_directions() -> np.ndarray:
    """Returns the directions (HEIGHT * WIDTH,3) of the pixels of the lat-long image; -z is at its centre."""
    return latlong_directions(HEIGHT, WIDTH).reshape(-1, 3)


class Grid:
    """Radiosity cells on the faces of boxes: the walls of a room (one box, from inside) or furniture (from outside).

    The faces of box b are numbered 6 b + 2 axis + side. There are N = faces * n * n cells.

    Attributes:
        low, high: (B,3) metres, opposite corners of the boxes.
        n: cells per side of a face.
        position: (N,3) metres, centres of the cells.
        normal: (N,3) unit normals.
        area: (N,) square metres.
    """

    def __init__(self, low: np.ndarray, high: np.ndarray, n: int, inside: bool):
        """Creates n x n cells on each face; normals point into the box if it is seen from `inside`."""
        self.low, self.high, self.n = low, high, n
        centre = (np.arange(n) + 0.5) / n
        unit = np.zeros((6, n, n, 3))
        normal = np.zeros((6, 3))
        for face in range(6):
            axis, side = divmod(face, 2)
            p, q = IN_PLANE[axis]
            unit[face, ..., axis] = side
            unit[face, ..., p], unit[face, ..., q] = centre[:, None], centre
            normal[face, axis] = (1 - 2 * side) if inside else (2 * side - 1)
        size = high - low
        self.position = (low[:, None, None, None] + unit * size[:, None, None, None]).reshape(-1, 3)
        self.normal = np.tile(np.repeat(normal, n * n, 0), (len(low), 1))
        area = np.stack([size[:, p] * size[:, q] for p, q in IN_PLANE], 1) / n**2
        self.area = np.repeat(np.repeat(area, 2, 1).ravel(), n * n)

    def interpolate(self, cells: np.ndarray, face: np.ndarray, point: np.ndarray) -> np.ndarray:
        """Interpolates cell values bilinearly, within each face.

        Args:
            cells: (N,3) values.
            face: (P,) of the points.
            point: (P,3) metres.

        Returns:
            (P,3) values at the points.
        """
        n, box, axis = self.n, face // 6, face % 6 // 2
        plane = np.array(IN_PLANE)[axis]
        low, high = (np.take_along_axis(edge[box], plane, 1) for edge in (self.low, self.high))
        place = (np.take_along_axis(point, plane, 1) - low) / np.maximum(high - low, 1e-9) * n - 0.5
        place = np.clip(place, 0, n - 1.001)
        i, j = place.astype(int).T
        f, g = (place - place.astype(int)).T[..., None]
        start = face * n * n + i * n + j
        near, far = cells[start] * (1 - g) + cells[start + 1] * g, cells[start + n] * (1 - g) + cells[start + n + 1] * g
        return near * (1 - f) + far * f


def intersect_walls(size: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Intersects rays that start inside a room with its walls.

    Args:
        size: (3,) of the room, metres; one corner is at 0.
        origin: (N,3) metres.
        direction: (N,3), any length.

    Returns:
        Distance (N,) in lengths of `direction`, and wall (N,) 0 to 5: 2 * axis, plus 1 for the wall at `size`.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(direction > 0, size - origin, -origin) / direction
    distance = np.where(direction == 0, np.inf, distance)
    axis = distance.argmin(-1)
    pick = axis[:, None]
    side = np.take_along_axis(direction, pick, 1)[:, 0] > 0
    return np.take_along_axis(distance, pick, 1)[:, 0], 2 * axis + side


def _intersect_boxes(
    low: np.ndarray, high: np.ndarray, origin: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Intersects rays (...,3) with boxes (B,3) by the slab method (Kay and Kajiya 1986).

    Returns ray parameters (...,B) of entry and exit, in units of `direction`, and the axis (...,B) of the face that is
    entered. A ray misses a box where entry > exit.
    """
    t_enter, t_exit, axis = np.array(-np.inf), np.array(np.inf), np.array(0)
    for a in range(3):
        d = direction[..., a, None]
        d = np.where(d == 0, 1e-12, d)
        t_low = (low[:, a] - origin[..., a, None]) / d
        t_high = (high[:, a] - origin[..., a, None]) / d
        t_near = np.minimum(t_low, t_high)
        axis = np.where(t_near > t_enter, a, axis)
        t_enter, t_exit = np.maximum(t_enter, t_near), np.minimum(t_exit, np.maximum(t_low, t_high))
    return t_enter, t_exit, axis


def _is_occluded(room: Room, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Returns whether furniture intersects the segments from `origin` (...,3) to `origin + direction`, (...) bool."""
    if not room.boxes:
        return np.zeros(np.broadcast_shapes(origin.shape, direction.shape)[:-1], bool)
    t_enter, t_exit, _ = _intersect_boxes(*_box_bounds(room), origin, direction)
    return np.any((t_enter <= t_exit) & (t_exit > 1e-3) & (t_enter < 1 - 1e-3), axis=-1)


def _box_bounds(room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners `low` and `high` (B,3) of the furniture."""
    return np.array([box.low for box in room.boxes]), np.array([box.high for box in room.boxes])


def _sample_emitters(room: Room) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Samples the emitters of a room: large area lights at 2 x 2 points, others at the centre.

    Returns points and normals (S,3), zero for lamps; areas (S,), for lamps of their disc; radiances (S,3).
    """
    samples = []
    for light in room.area_lights:
        axis, side = divmod(light.wall, 2)
        p, q = IN_PLANE[axis]
        size = light.high - light.low
        normal = np.zeros(3)
        normal[axis] = 1 - 2 * side
        steps = (0.25, 0.75) if size[p] * size[q] > 0.8 else (0.5,)
        for a in steps:
            for b in steps:
                share = np.zeros(3)
                share[p], share[q] = a, b
                area = size[p] * size[q] / len(steps) ** 2
                samples.append((light.low + share * size, normal, area, light.radiance))
    samples += [(lamp.centre, np.zeros(3), np.pi * lamp.radius**2, lamp.radiance) for lamp in room.lamps]
    points, normals, areas, radiances = (np.array(column) for column in zip(*samples))
    return points, normals, areas, radiances


def direct_irradiance(room: Room, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Returns the irradiance (N,3) from windows, panels and lamps, with shadows of the furniture, without the sun.

    Args:
        room: with at least one emitter.
        position: (N,3) metres, receiving points.
        normal: (N,3) unit normals of the points.
    """
    points, normals, areas, radiances = _sample_emitters(room)
    toward = points[None] - (position + 1e-3 * normal)[:, None]
    distance2 = (toward**2).sum(-1) + 0.05  # m^2: bounds the irradiance near lamps, since a cell is not a point
    receiver_cosine = np.maximum(np.einsum("nsk,nk->ns", toward, normal), 0)
    emitter_cosine = np.maximum(-np.einsum("nsk,sk->ns", toward, normals), 0)
    is_lamp = ~normals.any(1)
    emitter_cosine[:, is_lamp] = np.sqrt(distance2[:, is_lamp])
    geometry = receiver_cosine * emitter_cosine * areas / distance2**2
    n, s = np.nonzero(geometry > 0)
    geometry[n, s] *= ~_is_occluded(room, (position + 1e-3 * normal)[n], toward[n, s])
    return geometry @ radiances


def is_sunlit(room: Room, sun: Sun, point: np.ndarray) -> np.ndarray:
    """Returns whether the sun reaches points through a window or skylight.

    Args:
        room: with its windows, and the furniture that occludes.
        sun: its `direction` points toward it.
        point: (N,3) metres.

    Returns:
        (N,) bool.
    """
    toward = np.broadcast_to(sun.direction, point.shape)
    distance, wall = intersect_walls(room.size, point, toward)
    exit_point = point + toward * distance[:, None]
    passes_window = np.zeros(len(point), bool)
    for light in room.area_lights:
        if light.daylight:
            passes_window |= light.contains(wall, exit_point)
    to_window = toward[passes_window] * distance[passes_window, None]
    passes_window[passes_window] = ~_is_occluded(room, point[passes_window], to_window)
    return passes_window


def _sun_irradiance(room: Room, sun: Sun, grid: Grid) -> np.ndarray:
    """Returns the sun's irradiance (N,3), through the windows, on a grid's cells, sampled at four points per cell."""
    n = len(grid.position)
    cosine = np.maximum(grid.normal @ sun.direction, 0)
    lit = np.zeros(n)
    face = np.arange(n) // grid.n**2
    size = ((grid.high - grid.low)[face // 6]) / grid.n
    along = 1 - abs(grid.normal)
    facing = cosine > 0
    for a, b in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        sign = np.array([[b, a, b], [a, b, b], [a, b, a]], float)[face % 6 // 2]  # both in-plane axes get all signs
        shifted = grid.position + 0.25 * sign * size * along + 1e-3 * grid.normal
        lit[facing] += is_sunlit(room, sun, shifted[facing]) / 4
    return (lit * cosine)[:, None] * sun.irradiance


def form_factors(receiver: Grid, sender: Grid) -> np.ndarray:
    """Returns the form factors F_rs = cos_r cos_s A_s / (pi d^2) between cell centres, without occlusion.

    The irradiance from diffuse cells of radiosity B is F @ B (Goral et al. 1984, "Modeling the Interaction of Light
    Between Diffuse Surfaces").

    Args:
        receiver: R cells.
        sender: S cells.

    Returns:
        (R,S); rows are normalised to 1, since a room is closed.
    """
    r, s = receiver, sender
    # Matrix products are faster than differences (R,S,3); this step dominates the time of a room.
    distance2 = (r.position**2).sum(1)[:, None] + (s.position**2).sum(1) - 2 * r.position @ s.position.T + 1e-3
    receiver_cosine = np.maximum(r.normal @ s.position.T - (r.normal * r.position).sum(1)[:, None], 0)
    sender_cosine = np.maximum((r.position @ s.normal.T) - (s.normal * s.position).sum(1), 0)
    factors = receiver_cosine * sender_cosine * s.area / (np.pi * distance2**2)
    # Without the normalisation, cells near a corner would exceed 1.
    return factors / np.maximum(factors.sum(1, keepdims=True), 1e-9)


def indirect_irradiance(factors: np.ndarray, albedo: np.ndarray, irradiance: np.ndarray) -> np.ndarray:
    """Returns the irradiance (N,3) of cells from light that cells reflect, by Jacobi iterations.

    Args:
        factors: (N,N) form factors.
        albedo: (N,3) of the cells.
        irradiance: (N,3) of the cells from direct light.
    """
    bounced = np.zeros_like(irradiance)
    incoming = irradiance
    for _ in range(BOUNCES):
        incoming = factors @ (albedo * incoming)
        bounced += incoming
    return bounced


def render_room(room: Room) -> np.ndarray:
    """Renders a room from its camera to a lat-long panorama (HEIGHT,WIDTH,3) float64 of linear radiance."""
    walls = Grid(np.zeros((1, 3)), room.size[None], CELLS, inside=True)
    irradiance = direct_irradiance(room, walls.position, walls.normal)
    sunlight = _sun_irradiance(room, room.sun, walls) if room.sun else 0.0
    albedo = np.repeat(room.albedo, CELLS**2, 0) * (1 - FURNITURE_ABSORPTION)
    bounced = indirect_irradiance(form_factors(walls, walls), albedo, irradiance + sunlight)

    direction = view_directions()
    depth, wall = intersect_walls(room.size, room.camera, direction)
    point = room.camera + direction * depth[:, None]
    # Sunlight has sharp edges, so it is added per pixel, not per cell.
    image = walls.interpolate(irradiance + bounced, wall, point)
    if room.sun:
        cosine = walls.normal[wall * CELLS**2] @ room.sun.direction
        facing = np.flatnonzero(cosine > 0)
        lit = is_sunlit(room, room.sun, point[facing] + 1e-3 * walls.normal[wall[facing] * CELLS**2])
        image[facing] += (lit * cosine[facing])[:, None] * room.sun.irradiance
    image *= room.albedo[wall] / np.pi
    for light in room.area_lights:
        image[light.contains(wall, point)] = light.radiance
    if room.boxes:
        _render_boxes(room, walls, albedo * (irradiance + sunlight + bounced), image, depth)
    _render_lamps(room, image, depth)
    return image.reshape(HEIGHT, WIDTH, 3)


def _render_boxes(room: Room, walls: Grid, radiosity: np.ndarray, image: np.ndarray, depth: np.ndarray) -> None:
    """Renders the furniture into an image (N,3) of the room in `view_directions`, in place.

    `radiosity` (cells,3) is that of the walls, and `depth` (N,) the metres to the visible surface, which are updated.
    """
    direction = view_directions()
    low, high = _box_bounds(room)
    t_enter, t_exit, axis = _intersect_boxes(low, high, room.camera[None], direction)
    distance = np.where((t_enter <= t_exit) & (t_enter > 0), t_enter, np.inf)
    box = distance.argmin(1)
    hit = np.flatnonzero(distance[np.arange(len(box)), box] < depth)
    if not len(hit):
        return
    depth[hit] = distance[hit, box[hit]]
    grid = Grid(low, high, BOX_CELLS, inside=False)
    irradiance = direct_irradiance(room, grid.position, grid.normal) + form_factors(grid, walls) @ radiosity
    if room.sun:
        irradiance += _sun_irradiance(room, room.sun, grid)
    entered = axis[hit, box[hit]]
    face = 6 * box[hit] + 2 * entered + (direction[hit, entered] < 0)
    point = room.camera + direction[hit] * depth[hit, None]
    albedo = np.array([b.albedo for b in room.boxes])[box[hit]]
    image[hit] = albedo / np.pi * grid.interpolate(irradiance, face, point)


def _render_lamps(room: Room, image: np.ndarray, depth: np.ndarray) -> None:
    """Renders visible lamps into `image` (N,3), in place; a lamp fills whole pixels with its flux."""
    direction = view_directions()
    weight = pixel_solid_angles()
    for lamp in room.lamps:
        toward = lamp.centre - room.camera
        distance = float(np.linalg.norm(toward))
        cosine_limit = math.sqrt(max(1 - (lamp.radius / distance) ** 2, 0))
        cosine = direction @ (toward / distance)
        covered = cosine > cosine_limit
        if not covered.any():
            covered = np.arange(len(cosine)) == cosine.argmax()
        scale = 2 * np.pi * (1 - cosine_limit) / weight[covered].sum()
        image[covered & (depth > distance - lamp.radius)] = lamp.radiance * scale


def pixel_solid_angles() -> np.ndarray:
    """Returns the solid angles (HEIGHT * WIDTH,) of the pixels."""
    return np.repeat(latlong_solid_angles(HEIGHT, WIDTH), WIDTH)
