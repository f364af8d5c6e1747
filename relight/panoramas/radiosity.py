"""Light in a room: direct light on a grid of cells, radiosity between the walls, and a panorama of it.

Furniture throws shadows and receives light, but its own bounce is only in the share of light that the walls lose.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from relight.panoramas.layouts import latlong_solid_angles

if TYPE_CHECKING:
    from relight.panoramas.rooms import Room

HEIGHT, WIDTH = 64, 128
CELLS = 8  # per side of a wall
FACE_CELLS = 3  # per side of a face of furniture
BOUNCES = 20  # of the light of the palest room less than 1 % is left
ABSORBED = 0.15  # by what stands in a room beside the boxes
IN_PLANE = ((1, 2), (0, 2), (0, 1))  # the axes of a wall across x, y, z


@cache
def view_directions() -> np.ndarray:
    """(HEIGHT * WIDTH, 3) pixel centres of the lat-long image; the centre looks along -z."""
    theta = (np.arange(HEIGHT) + 0.5)[:, None] / HEIGHT * np.pi
    phi = (2 * (np.arange(WIDTH) + 0.5) / WIDTH - 1) * np.pi
    x, y, z = np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi))
    return np.stack([x, y, z], -1).reshape(-1, 3)


class Grid:
    """Cells on the faces of boxes: the room seen from inside (one box) or its furniture seen from outside.

    Faces of box b are numbered 6 b + 2 axis + side; arrays over cells are (faces * n * n, ...).
    """

    def __init__(self, low: np.ndarray, high: np.ndarray, n: int, inside: bool):
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

    def lookup(self, cells: np.ndarray, face: np.ndarray, point: np.ndarray) -> np.ndarray:
        """Bilinear values (N, 3) of `cells` (faces * n * n, 3) at points (N, 3) that lie on faces (N,)."""
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


def walls_hit(size: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (N,) and wall (N,) at which rays from inside the room meet it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(direction > 0, size - origin, -origin) / direction
    distance = np.where(direction == 0, np.inf, distance)
    axis = distance.argmin(-1)
    pick = axis[:, None]
    side = np.take_along_axis(direction, pick, 1)[:, 0] > 0
    return np.take_along_axis(distance, pick, 1)[:, 0], 2 * axis + side


def slabs(low: np.ndarray, high: np.ndarray, origin: np.ndarray, direction: np.ndarray):
    """Entry and exit (..., B) of rays (..., 3) through boxes (B, 3), and the axis through which they enter.

    Distances in units of `direction`; a ray misses a box when entry > exit.
    """
    entry, leave, axis = -np.inf, np.inf, 0
    for a in range(3):
        d = direction[..., a, None]
        d = np.where(d == 0, 1e-12, d)
        t = (low[:, a] - origin[..., a, None]) / d
        u = (high[:, a] - origin[..., a, None]) / d
        first = np.minimum(t, u)
        axis = np.where(first > entry, a, axis)
        entry, leave = np.maximum(entry, first), np.minimum(leave, np.maximum(t, u))
    return entry, leave, axis


def blocked(room: Room, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Whether furniture stands between `origin` and `origin + direction` (broadcast (..., 3))."""
    if not room.boxes:
        return np.zeros(np.broadcast_shapes(origin.shape, direction.shape)[:-1], bool)
    entry, leave, _ = slabs(*box_bounds(room), origin, direction)
    return ((entry <= leave) & (leave > 1e-3) & (entry < 1 - 1e-3)).any(-1)


def box_bounds(room: Room) -> tuple[np.ndarray, np.ndarray]:
    return np.array([box.low for box in room.boxes]), np.array([box.high for box in room.boxes])


def light_samples(room: Room) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points (S, 3) that stand for the room's emitters, normals (S, 3) (zero for lamps), areas (S,), radiances (S, 3).

    Large patches are cut into 2 x 2; a lamp counts with the disc that it shows.
    """
    points, normals, areas, radiances = [], [], [], []
    for patch in room.patches:
        axis, side = divmod(patch.wall, 2)
        p, q = IN_PLANE[axis]
        size = patch.high - patch.low
        normal = np.zeros(3)
        normal[axis] = 1 - 2 * side
        steps = (0.25, 0.75) if size[p] * size[q] > 0.8 else (0.5,)
        for a in steps:
            for b in steps:
                share = np.zeros(3)
                share[p], share[q] = a, b
                points.append(patch.low + share * size)
                normals.append(normal)
                areas.append(size[p] * size[q] / len(steps) ** 2)
                radiances.append(patch.radiance)
    for lamp in room.lamps:
        points.append(lamp.centre)
        normals.append(np.zeros(3))
        areas.append(np.pi * lamp.radius**2)
        radiances.append(lamp.radiance)
    return np.array(points), np.array(normals), np.array(areas), np.array(radiances)


def direct(room: Room, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Irradiance (N, 3) at cells (N, 3) from windows, panels and lamps, with the shadows of furniture; not the sun."""
    points, normals, areas, radiances = light_samples(room)
    toward = points[None] - (position + 1e-3 * normal)[:, None]
    distance2 = (toward**2).sum(-1) + 0.05  # a cell is not a point: keeps lamps at a wall from burning holes
    cosine = np.maximum(np.einsum("nsk,nk->ns", toward, normal), 0)
    facing = np.maximum(-np.einsum("nsk,sk->ns", toward, normals), 0)
    lamp = ~normals.any(1)
    facing[:, lamp] = np.sqrt(distance2[:, lamp])
    share = cosine * facing * areas / distance2**2
    lit = share > 0
    n, s = np.nonzero(lit)
    share[n, s] *= ~blocked(room, (position + 1e-3 * normal)[n], toward[n, s])
    return share @ radiances


def sunlit(room: Room, point: np.ndarray) -> np.ndarray:
    """Whether the sun reaches points (N, 3) through a window or skylight, past the furniture."""
    toward = np.broadcast_to(room.sun[0], point.shape)
    distance, wall = walls_hit(room.size, point, toward)
    exit_point = point + toward * distance[:, None]
    through = np.zeros(len(point), bool)
    for patch in room.patches:
        if patch.daylight:
            inside = (exit_point >= patch.low - 1e-6) & (exit_point <= patch.high + 1e-6)
            plane = list(IN_PLANE[patch.wall // 2])
            through |= (wall == patch.wall) & inside[:, plane].all(1)
    through[through] = ~blocked(room, point[through], toward[through] * distance[through, None])
    return through


def sun_on_cells(room: Room, grid: Grid) -> np.ndarray:
    """Irradiance (N, 3) of the sun on the cells of `grid`, each sampled at four places."""
    n = len(grid.position)
    cosine = np.maximum(grid.normal @ room.sun[0], 0)
    lit = np.zeros(n)
    face = np.arange(n) // grid.n**2
    size = ((grid.high - grid.low)[face // 6]) / grid.n
    along = 1 - abs(grid.normal)
    facing = cosine > 0
    for a, b in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        sign = np.array([[b, a, b], [a, b, b], [a, b, a]], float)[face % 6 // 2]  # two signs in the cell's own plane
        shifted = grid.position + 0.25 * sign * size * along + 1e-3 * grid.normal
        lit[facing] += sunlit(room, shifted[facing]) / 4
    return (lit * cosine)[:, None] * room.sun[1]


def form_factors(receiver: Grid, sender: Grid) -> np.ndarray:
    """(R, S) share of a receiving cell's half-space that each sending cell fills; rows sum to 1."""
    r, s = receiver, sender
    # Products of matrices in place of differences (R, S, 3): this is most of the time that a room takes.
    distance2 = (r.position**2).sum(1)[:, None] + (s.position**2).sum(1) - 2 * r.position @ s.position.T + 1e-3
    here = np.maximum(r.normal @ s.position.T - (r.normal * r.position).sum(1)[:, None], 0)
    there = np.maximum((r.position @ s.normal.T) - (s.normal * s.position).sum(1), 0)
    factors = here * there * s.area / (np.pi * distance2**2)
    return factors / np.maximum(
        factors.sum(1, keepdims=True), 1e-9
    )  # the room is closed: cells near a corner overshoot


def interreflected(factors: np.ndarray, albedo: np.ndarray, irradiance: np.ndarray) -> np.ndarray:
    """Irradiance (N, 3) that cells of `albedo` (N, 3) get from one another, when `irradiance` (N, 3) falls on them from
    without and `factors` (N, N) are their form factors."""
    bounced = np.zeros_like(irradiance)
    arriving = irradiance
    for _ in range(BOUNCES):
        arriving = factors @ (albedo * arriving)
        bounced += arriving
    return bounced


def render(room: Room) -> np.ndarray:
    """The panorama (HEIGHT, WIDTH, 3) float64 of a room from its camera, lat-long, linear radiance."""
    walls = Grid(np.zeros((1, 3)), room.size[None], CELLS, inside=True)
    irradiance = direct(room, walls.position, walls.normal)
    sun = sun_on_cells(room, walls) if room.sun else 0.0
    albedo = np.repeat(room.albedo, CELLS**2, 0) * (1 - ABSORBED)
    bounced = interreflected(form_factors(walls, walls), albedo, irradiance + sun)
    total = albedo * (irradiance + sun + bounced)

    direction = view_directions()
    depth, wall = walls_hit(room.size, room.camera, direction)
    point = room.camera + direction * depth[:, None]
    # The sun's patches are sharp, so they are added per pixel and not from the cells.
    image = walls.lookup(irradiance + bounced, wall, point)
    if room.sun:
        cosine = walls.normal[wall * CELLS**2] @ room.sun[0]
        facing = np.flatnonzero(cosine > 0)
        inward = walls.normal[wall[facing] * CELLS**2]
        lit = sunlit(room, point[facing] + 1e-3 * inward)
        image[facing] += (lit * cosine[facing])[:, None] * room.sun[1]
    image *= room.albedo[wall] / np.pi
    for patch in room.patches:
        inside = (point >= patch.low - 1e-6) & (point <= patch.high + 1e-6)
        image[(wall == patch.wall) & inside[:, list(IN_PLANE[patch.wall // 2])].all(1)] = patch.radiance
    if room.boxes:
        draw_boxes(room, walls, total, image, depth)
    draw_lamps(room, image, depth)
    return image.reshape(HEIGHT, WIDTH, 3)


def draw_boxes(room: Room, walls: Grid, radiosity: np.ndarray, image: np.ndarray, depth: np.ndarray) -> None:
    """Draws the furniture into `image` (N, 3) and brings `depth` (N,) up to date."""
    direction = view_directions()
    low, high = box_bounds(room)
    entry, leave, axis = slabs(low, high, room.camera[None], direction)
    distance = np.where((entry <= leave) & (entry > 0), entry, np.inf)
    box = distance.argmin(1)
    row = np.arange(len(box))
    hit = np.flatnonzero(distance[row, box] < depth)
    if not len(hit):
        return
    depth[hit] = distance[hit, box[hit]]
    grid = Grid(low, high, FACE_CELLS, inside=False)
    irradiance = direct(room, grid.position, grid.normal) + form_factors(grid, walls) @ radiosity
    if room.sun:
        irradiance += sun_on_cells(room, grid)
    entered = axis[hit, box[hit]]
    face = 6 * box[hit] + 2 * entered + (direction[hit, entered] < 0)
    point = room.camera + direction[hit] * depth[hit, None]
    albedo = np.array([b.albedo for b in room.boxes])[box[hit]]
    image[hit] = albedo / np.pi * grid.lookup(irradiance, face, point)


def draw_lamps(room: Room, image: np.ndarray, depth: np.ndarray) -> None:
    """Draws the lamps that are in sight, each with the energy of its true solid angle whatever pixels it falls on."""
    direction = view_directions()
    weight = pixel_solid_angles()
    for lamp in room.lamps:
        toward = lamp.centre - room.camera
        distance = np.linalg.norm(toward)
        edge = np.sqrt(max(1 - (lamp.radius / distance) ** 2, 0))
        cosine = direction @ (toward / distance)
        covered = cosine > edge
        if not covered.any():
            covered = np.arange(len(cosine)) == cosine.argmax()
        share = 2 * np.pi * (1 - edge) / weight[covered].sum()
        seen = covered & (depth > distance - lamp.radius)
        image[seen] = lamp.radiance * share


@cache
def pixel_solid_angles() -> np.ndarray:
    """(HEIGHT * WIDTH,) steradians."""
    return np.repeat(latlong_solid_angles(HEIGHT, WIDTH), WIDTH)
