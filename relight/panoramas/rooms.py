"""Rooms: indoor panoramas drawn from a seed.

A room is a box with coloured walls, windows, lamps and furniture, seen by a camera that stands in it. Radiosity gives
the light (relight.panoramas.radiosity). Plain rooms, darker ones that are lit from one side, and soft ones that are
pale and lit from all around; lamps from tungsten to daylight, windows by day and by night, and cameras that are set to
daylight, to lamps, or to the picture itself. The ranges are set so that the statistics of the resulting lights span
those of measured indoor maps and of the lights that the paper's authors released (docs/lights.md); nothing here needs
a file.
"""

from dataclasses import dataclass, field

import numpy as np

from relight.panoramas.colour import blackbody, daylight, luminance
from relight.panoramas.layouts import latlong_solid_angles
from relight.panoramas.radiosity import HEIGHT, WIDTH, render


@dataclass(frozen=True)
class Patch:
    """A lit rectangle in a wall: a window's sky, its ground, or a panel of the ceiling."""

    wall: int  # 2 * axis + side
    low: np.ndarray  # (3,) metres; low and high agree along the wall's axis
    high: np.ndarray
    radiance: np.ndarray  # (3,) linear RGB
    daylight: bool = False  # the sun shines in through it


@dataclass(frozen=True)
class Lamp:
    """A glowing sphere."""

    centre: np.ndarray  # (3,) metres
    radius: float
    radiance: np.ndarray  # (3,)


@dataclass(frozen=True)
class Box:
    """A piece of furniture."""

    low: np.ndarray
    high: np.ndarray
    albedo: np.ndarray


@dataclass
class Room:
    """A box from the origin to `size`, metres, y up. Walls are numbered 2 * axis + side: floor 2, ceiling 3."""

    size: np.ndarray
    camera: np.ndarray
    albedo: np.ndarray  # (6, 3) of the walls
    patches: list[Patch] = field(default_factory=list)
    lamps: list[Lamp] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    sun: tuple[np.ndarray, np.ndarray] | None = None  # direction toward it, and its irradiance on a facing surface


UPRIGHT = (0, 1, 4, 5)  # the walls that are neither floor nor ceiling
CLEARANCE = 0.6  # metres around the camera in which nothing stands or hangs
KINDS = {"plain": 0.36, "sided": 0.4, "soft": 0.24}  # and their shares


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_room(rng: np.random.Generator) -> Room:
    """A room of 2.8-14 m, its surfaces, daylight, lamps and furniture; it always has a source of light."""
    x, z = log_uniform(rng, 2.8, 14), log_uniform(rng, 2.8, 14)
    y = rng.uniform(2.3, 3.4) if rng.random() < 0.75 else rng.uniform(3.4, 7.0)
    eye = min(rng.uniform(1.1, 1.7), 0.7 * y)
    camera = np.array([x * rng.uniform(0.15, 0.85), eye, z * rng.uniform(0.15, 0.85)])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    room = Room(np.array([x, y, z]), camera, draw_albedo(rng, kind))
    day = rng.random() < 0.58
    if day:
        add_daylight(room, rng, kind)
    elif rng.random() < 0.5:
        add_night(room, rng)
    on = {"plain": 0.55, "sided": 0.25, "soft": 0.75}[kind]  # lamps that burn by day
    if not day or not room.patches or rng.random() < on:
        add_lamps(room, rng, kind)
    add_furniture(room, rng)
    return room


def draw_albedo(rng: np.random.Generator, kind: str) -> np.ndarray:
    """(6, 3): walls of one colour with an accent wall here and there, a darker floor, a light ceiling."""
    walls = {"plain": (0.2, 0.9), "sided": (0.12, 0.45), "soft": (0.7, 0.92)}[kind]
    floor = {"plain": (0.06, 0.5), "sided": (0.06, 0.35), "soft": (0.25, 0.7)}[kind]
    wall = log_uniform(rng, *walls) * np.array([1, rng.uniform(0.92, 1.0), rng.uniform(0.82, 1.02)])
    albedo = np.stack([wall] * 6)
    for i in UPRIGHT:
        if kind != "soft" and rng.random() < 0.22:
            albedo[i] = np.clip(rng.uniform(0.1, 0.75) * (0.5 + 0.7 * rng.random(3)), 0.03, 0.9)
    albedo[2] = log_uniform(rng, *floor) * np.array([1, rng.uniform(0.75, 1.0), rng.uniform(0.5, 1.0)])
    pale = rng.random() < {"plain": 0.9, "sided": 0.6, "soft": 1.0}[kind]
    albedo[3] = min(log_uniform(rng, *((0.55, 0.95) if pale else (0.05, 0.4))), 0.92)
    return albedo


def add_daylight(room: Room, rng: np.random.Generator, kind: str) -> None:
    """Up to four windows, mostly in one wall or in two that face each other, with sky above and ground below; now and
    then a skylight and the sun. A sided room has them in one wall, a soft one on all sides, behind curtains."""
    sky = log_uniform(rng, 2, 40)
    # Overcast, or the blue of a clear sky.
    temperature = rng.uniform(5500, 7500) if rng.random() < 0.7 else log_uniform(rng, 7500, 16000)
    main = rng.choice(UPRIGHT)
    odds = {"plain": (0.55, 0.2, 0.25), "sided": (1.0, 0.0, 0.0), "soft": (0.25, 0.25, 0.5)}[kind]
    counts = (0.1, 0.1, 0.2, 0.3, 0.3) if kind == "soft" else (0.14, 0.34, 0.27, 0.15, 0.1)
    for _ in range(rng.choice(5, p=counts)):
        wall = int(rng.choice((main, main ^ 1, rng.choice(UPRIGHT)), p=odds))
        curtain = 1.0 if kind != "soft" and rng.random() < 0.6 else rng.uniform(0.1, 0.5)
        tint = daylight(temperature * rng.uniform(0.85, 1.2))  # the sky toward the sun is not that away from it
        above = tint * sky * rng.uniform(0.4, 1.0) * curtain
        below = tint * [0.85, 1.0, 0.7] * sky * rng.uniform(0.05, 0.22) * curtain
        add_window(room, rng, wall, above, below)
    if rng.random() < 0.12:
        add_skylight(room, rng, daylight(temperature) * sky)
    walls = [patch.wall for patch in room.patches if patch.wall in UPRIGHT]
    if walls and rng.random() < 0.28:
        outward, elevation, azimuth = walls[0], np.radians(rng.uniform(15, 60)), rng.uniform(-1, 1)
        toward = np.zeros(3)
        toward[outward // 2] = (2 * (outward % 2) - 1) * np.cos(elevation) * np.cos(azimuth)
        toward[2 - outward // 2] = np.cos(elevation) * np.sin(azimuth)
        toward[1] = np.sin(elevation)
        room.sun = toward, blackbody(rng.uniform(4000, 5600)) * sky * rng.uniform(1.5, 8)


def add_night(room: Room, rng: np.random.Generator) -> None:
    """One or two windows that are dark, with the glow of a street below."""
    for _ in range(rng.integers(1, 3)):
        above = daylight(9000) * log_uniform(rng, 0.002, 0.02)
        below = blackbody(rng.uniform(2000, 4000)) * log_uniform(rng, 0.005, 0.1)
        add_window(room, rng, int(rng.choice(UPRIGHT)), above, below)


def add_window(room: Room, rng: np.random.Generator, wall: int, above: np.ndarray, below: np.ndarray) -> None:
    """A window somewhere in a wall: radiance `above` the horizon and `below` it."""
    along = 2 - wall // 2  # a wall across x runs along z and the reverse
    length, height = room.size[along], room.size[1]
    width = min(log_uniform(rng, 0.7, 4.0), 0.8 * length)
    start = rng.uniform(0.05 * length, 0.95 * length - width)
    sill = rng.uniform(0.2, 1.1) if rng.random() < 0.8 else rng.uniform(0.5, 0.6) * height
    top = min(height - 0.15, sill + rng.uniform(0.9, 2.2))
    horizon = float(np.clip(room.camera[1] + rng.uniform(-0.3, 0.2), sill, top))
    for bottom, end, radiance in ((sill, horizon, below), (horizon, top, above)):
        if end - bottom > 0.05:
            low, high = np.zeros(3), np.zeros(3)
            low[wall // 2] = high[wall // 2] = room.size[wall // 2] * (wall % 2)
            low[along], high[along] = start, start + width
            low[1], high[1] = bottom, end
            room.patches.append(Patch(wall, low, high, radiance, daylight=True))


def add_skylight(room: Room, rng: np.random.Generator, radiance: np.ndarray) -> None:
    x, y, z = room.size
    side = log_uniform(rng, 0.8, 3)
    sx, sz = min(side, 0.6 * x), min(side, 0.6 * z)
    low = np.array([rng.uniform(0, x - sx), y, rng.uniform(0, z - sz)])
    room.patches.append(Patch(3, low, low + [sx, 0, sz], radiance, daylight=True))


def add_lamps(room: Room, rng: np.random.Generator, kind: str) -> None:
    """A ceiling that is lit all over, two lamps on both sides, ceiling panels in a grid, or lamps one by one; a sided
    room has a lamp or two, a soft one light from all over."""
    temperature = draw_temperature(rng)
    power = log_uniform(rng, 0.3, 3.0) * room.size[0] * room.size[2] * 6  # a room's lighting grows with its floor
    chances = {"plain": (0.2, 0.12, 0.36, 0.32), "sided": (0.0, 0.0, 0.15, 0.85), "soft": (0.5, 0.0, 0.3, 0.2)}[kind]
    way = rng.choice(4, p=chances)
    if way == 0:
        add_bright_ceiling(room, rng, blackbody(temperature) * power)
    elif way == 1:
        add_two_lamps(room, rng, temperature, 2 * power)
    elif way == 2:
        add_panels(room, rng, blackbody(temperature) * power)
    else:
        count = {"plain": rng.integers(1, 7), "sided": rng.integers(1, 3), "soft": rng.integers(5, 13)}[kind]
        add_some_lamps(room, rng, temperature, power, int(count), low=0.7 if kind == "sided" else 0.25)
    if way in (1, 3) and not room.lamps:  # all of them were close to the camera
        x, _, z = np.where(room.camera < room.size / 2, 0.8, 0.2) * room.size
        add_lamp(room, rng, np.array([x, room.size[1] - 0.2, z]), 0.1, temperature, power)


def draw_temperature(rng: np.random.Generator) -> float:
    """Kelvin of a lamp: candle and tungsten, halogen and warm white, neutral white, or daylight."""
    ranges = ((2300, 2900), (2900, 3500), (3500, 4500), (4500, 6500))
    return float(rng.uniform(*ranges[rng.choice(4, p=(0.18, 0.47, 0.2, 0.15))]))


def add_bright_ceiling(room: Room, rng: np.random.Generator, power: np.ndarray) -> None:
    """Coves, uplights or a luminous ceiling, in a room that is not dark: light that is broad, and directed for all."""
    room.albedo[list(UPRIGHT)] = np.maximum(room.albedo[list(UPRIGHT)], rng.uniform(0.35, 0.75))
    low, high = np.array([0, room.size[1], 0]), room.size.copy()
    margin = rng.uniform(0.02, 0.12) * room.size * [1, 0, 1]
    low, high = low + margin, high - margin
    room.patches.append(Patch(3, low, high, power / ((high - low)[0] * (high - low)[2] * np.pi)))


def add_two_lamps(room: Room, rng: np.random.Generator, temperature: float, power: float) -> None:
    """Two lamps on opposite sides of where one stands, in a dark room: light with more structure than direction."""
    room.albedo *= rng.uniform(0.25, 0.6)
    heading = rng.uniform(0, 2 * np.pi)
    for turn, share in ((0.0, 1.0), (np.pi + rng.normal(0, 0.4), rng.uniform(0.35, 0.8))):
        toward = np.array([np.sin(heading + turn), rng.uniform(0, 0.5), np.cos(heading + turn)])
        centre = np.clip(room.camera + log_uniform(rng, 0.9, 2.5) * toward, 0.15, room.size - 0.15)
        add_lamp(room, rng, centre, 0.1, temperature, share * power / 2)


def add_panels(room: Room, rng: np.random.Generator, power: np.ndarray) -> None:
    """Panels in the ceiling, in a grid, some of them dead."""
    x, y, z = room.size
    nx, nz = (int(np.clip(side / rng.uniform(1.8, 3.5), 1, 5)) for side in (x, z))
    sx, sz = min(rng.choice([0.3, 0.6, 0.6]), 0.8 * x / nx), min(rng.choice([0.6, 1.2, 1.2]), 0.8 * z / nz)
    radiance = power / (nx * nz * sx * sz * np.pi)
    works = rng.random((nx, nz)) > 0.12
    works[0, 0] |= not works.any()
    for i, j in np.ndindex(nx, nz):
        if works[i, j]:
            centre = np.array([(i + 0.5) * x / nx, y, (j + 0.5) * z / nz])
            half = np.array([sx / 2, 0, sz / 2])
            room.patches.append(Patch(3, centre - half, centre + half, radiance))


def add_some_lamps(
    room: Room, rng: np.random.Generator, temperature: float, power: float, count: int, low: float
) -> None:
    """Lamps that hang or, a share `low` of them, stand or sit on a wall; none is close to the camera."""
    x, y, z = room.size
    radius = rng.choice([0.06, 0.08, 0.15, 0.22])
    for _ in range(count):
        centre = np.array([rng.uniform(0.1, 0.9) * x, y - 0.2, rng.uniform(0.1, 0.9) * z])
        if rng.random() >= low:  # hangs
            centre[1] = y - rng.uniform(0.1, 0.9) if y > 2.7 else y - 0.2
        elif rng.random() < 0.5:  # stands
            centre[1] = rng.uniform(1.3, 1.8)
        else:  # on a wall
            axis = rng.choice([0, 2])
            centre[axis] = 0.12 if rng.random() < 0.5 else room.size[axis] - 0.12
            centre[1] = rng.uniform(1.6, 2.1)
        add_lamp(room, rng, centre, radius, temperature, power / count)


def add_lamp(
    room: Room, rng: np.random.Generator, centre: np.ndarray, radius: float, temperature: float, power: float
) -> None:
    """A lamp unless it is close to the camera. Its colour strays a little from the others', and one in six has a
    colour of its own."""
    own = draw_temperature(rng) if rng.random() < 1 / 6 else temperature * rng.uniform(0.93, 1.07)
    if np.linalg.norm(centre - room.camera) - radius > CLEARANCE:
        room.lamps.append(Lamp(centre, radius, blackbody(own) * power / (4 * np.pi**2 * radius**2)))


def add_furniture(room: Room, rng: np.random.Generator) -> None:
    """Up to seven boxes on the floor, most of them against a wall, none close to the camera or under it."""
    for _ in range(rng.integers(0, 8)):
        tall = rng.random() < 0.25
        size = [
            log_uniform(rng, 0.3, 2.2),
            log_uniform(rng, *((1.3, 2.2) if tall else (0.35, 1.2))),
            log_uniform(rng, 0.3, 2.2),
        ]
        size = np.minimum(size, room.size * 0.6)
        low = np.array([rng.uniform(0, room.size[0] - size[0]), 0, rng.uniform(0, room.size[2] - size[2])])
        if rng.random() < 0.6:
            axis = rng.choice([0, 2])
            low[axis] = 0 if rng.random() < 0.5 else room.size[axis] - size[axis]
        albedo = np.clip(log_uniform(rng, 0.06, 0.7) * (0.55 + 0.6 * rng.random(3)), 0.02, 0.9)
        beside = np.maximum(np.maximum(low - room.camera, room.camera - low - size), 0)[[0, 2]]
        if np.linalg.norm(beside) > CLEARANCE:
            room.boxes.append(Box(low, low + size, albedo))


def room(seed: int) -> np.ndarray:
    """The panorama of room number `seed`: (64, 128, 3) float32 lat-long, linear, centre toward -z, pixel centres.

    The exposure is log-normal, as a photographer's is; so one room in fourteen is darker at the front than the paper's
    threshold of 0.2.
    """
    rng = np.random.default_rng([seed, 0x100])
    pixels = render(draw_room(rng))
    weight = latlong_solid_angles(HEIGHT, WIDTH)[:, None, None] / (4 * np.pi)
    pixels = pixels * white_balance(rng, (pixels * weight).sum((0, 1)))
    exposure = np.exp(rng.normal(np.log(0.28), 0.6)) / luminance((pixels * weight).sum((0, 1)))
    return (pixels * exposure).astype(np.float32)


def white_balance(rng: np.random.Generator, mean: np.ndarray) -> np.ndarray:
    """Gains (3,) of the channels of a camera that sees light of this mean colour (3,).

    It is set to daylight, so that lamps stay as warm as they are; or to lamps, so that daylight turns blue; or by the
    picture itself, which takes most of a cast away. Each errs a little.
    """
    way = rng.choice(3, p=(0.66, 0.04, 0.3))
    if way == 0:
        gains = 1 / daylight(rng.uniform(4800, 6500))
    elif way == 1:
        gains = 1 / blackbody(rng.uniform(2900, 4000))
    else:
        colour = np.maximum(mean, 1e-3 * mean.max())
        gains = (colour / luminance(colour)) ** -rng.uniform(0.6, 1.0)
    warmer, greener = rng.normal(0, 0.08), rng.normal(-0.03, 0.05)
    return gains * np.exp([warmer, greener, -warmer])
