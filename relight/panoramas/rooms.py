"""Indoor panoramas from integer seeds.

A room is a box with colored walls, windows, lamps and furniture around a camera, rendered by radiosity
(relight.panoramas.radiosity). Three kinds of rooms exist: plain ones, darker ones lit from one side, and soft ones with
a high albedo, lit from all sides. Lamps range from tungsten to daylight, windows show day or night, and white balance
is set for daylight, for lamps, or from the picture. With these ranges, the statistics of the lights span those of
measured indoor panoramas and of the lights that the paper's authors released (docs/lab/lights.md).
"""

import numpy as np

from relight.panoramas.color import blackbody, daylight, luminance
from relight.panoramas.projection import latlong_solid_angles
from relight.panoramas.radiosity import HEIGHT, WIDTH, AreaLight, Box, Lamp, Room, Sun, render_room

FLOOR, CEILING, SIDE_WALLS = 2, 3, (0, 1, 4, 5)  # walls by number: at -x, +x, -y, +y, -z, +z
CLEARANCE = 0.6  # metres around the camera without lamps and furniture
KINDS = {"plain": 0.36, "sided": 0.4, "soft": 0.24}  # probabilities of the kinds of rooms


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draws a number from `low` to `high` whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sample_room(rng: np.random.Generator) -> Room:
    """Draws a room 2.8 to 14 m wide and long, with windows, lamps and furniture, and at least one emitter."""
    x, z = _log_uniform(rng, 2.8, 14), _log_uniform(rng, 2.8, 14)
    y = rng.uniform(2.3, 3.4) if rng.random() < 0.75 else rng.uniform(3.4, 7.0)
    eye_height = min(rng.uniform(1.1, 1.7), 0.7 * y)
    camera = np.array([x * rng.uniform(0.15, 0.85), eye_height, z * rng.uniform(0.15, 0.85)])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    room = Room(np.array([x, y, z]), camera, _sample_wall_albedo(rng, kind))
    day = rng.random() < 0.58
    if day:
        _add_daylight(room, rng, kind)
    elif rng.random() < 0.5:
        _add_night(room, rng)
    lamp_probability = {"plain": 0.55, "sided": 0.25, "soft": 0.75}[kind]  # by day
    if not day or not room.area_lights or rng.random() < lamp_probability:
        _add_lamps(room, rng, kind)
    _add_furniture(room, rng)
    return room


def _sample_wall_albedo(rng: np.random.Generator, kind: str) -> np.ndarray:
    """Draws the albedo (6,3) of a room's walls: one color, a few accent walls, a darker floor, a lighter ceiling.

    `kind` is `plain`; `sided`, dark but for its windows; or `soft`, bright on all sides.
    """
    walls = {"plain": (0.2, 0.9), "sided": (0.12, 0.45), "soft": (0.7, 0.92)}[kind]
    floor = {"plain": (0.06, 0.5), "sided": (0.06, 0.35), "soft": (0.25, 0.7)}[kind]
    wall = _log_uniform(rng, *walls) * np.array([1, rng.uniform(0.92, 1.0), rng.uniform(0.82, 1.02)])
    albedo = np.stack([wall] * 6)
    for i in SIDE_WALLS:
        if kind != "soft" and rng.random() < 0.22:
            albedo[i] = np.clip(rng.uniform(0.1, 0.75) * (0.5 + 0.7 * rng.random(3)), 0.03, 0.9)
    albedo[FLOOR] = _log_uniform(rng, *floor) * np.array([1, rng.uniform(0.75, 1.0), rng.uniform(0.5, 1.0)])
    has_light_ceiling = rng.random() < {"plain": 0.9, "sided": 0.6, "soft": 1.0}[kind]
    albedo[CEILING] = min(_log_uniform(rng, *((0.55, 0.95) if has_light_ceiling else (0.05, 0.4))), 0.92)
    return albedo


def _add_daylight(room: Room, rng: np.random.Generator, kind: str) -> None:
    """Adds up to four windows that show sky and ground, and sometimes a skylight and the sun.

    `plain` rooms have most windows in one wall or in two opposite walls, `sided` rooms all in one wall; `soft` rooms
    have windows with curtains on all sides.
    """
    sky = _log_uniform(rng, 2, 40)
    is_overcast = rng.random() < 0.7
    temperature = rng.uniform(5500, 7500) if is_overcast else _log_uniform(rng, 7500, 16000)
    main_wall = rng.choice(SIDE_WALLS)
    probabilities = {"plain": (0.55, 0.2, 0.25), "sided": (1.0, 0.0, 0.0), "soft": (0.25, 0.25, 0.5)}[kind]
    counts = (0.1, 0.1, 0.2, 0.3, 0.3) if kind == "soft" else (0.14, 0.34, 0.27, 0.15, 0.1)
    for _ in range(rng.choice(5, p=counts)):
        wall = int(rng.choice((main_wall, main_wall ^ 1, rng.choice(SIDE_WALLS)), p=probabilities))
        transmittance = 1.0 if kind != "soft" and rng.random() < 0.6 else rng.uniform(0.1, 0.5)  # of the curtain
        tint = daylight(temperature * rng.uniform(0.85, 1.2))  # the sky's color varies with direction
        above = tint * sky * rng.uniform(0.4, 1.0) * transmittance
        below = tint * [0.85, 1.0, 0.7] * sky * rng.uniform(0.05, 0.22) * transmittance
        _add_window(room, rng, wall, above, below)
    if rng.random() < 0.12:
        _add_skylight(room, rng, daylight(temperature) * sky)
    walls = [light.wall for light in room.area_lights if light.wall in SIDE_WALLS]
    if walls and rng.random() < 0.28:
        wall, elevation, azimuth = walls[0], np.radians(rng.uniform(15, 60)), rng.uniform(-1, 1)
        direction = np.zeros(3)
        direction[wall // 2] = (2 * (wall % 2) - 1) * np.cos(elevation) * np.cos(azimuth)
        direction[2 - wall // 2] = np.cos(elevation) * np.sin(azimuth)
        direction[1] = np.sin(elevation)
        room.sun = Sun(direction, blackbody(rng.uniform(4000, 5600)) * sky * rng.uniform(1.5, 8))


def _add_night(room: Room, rng: np.random.Generator) -> None:
    """Adds one or two dark windows, with street light below the horizon."""
    for _ in range(rng.integers(1, 3)):
        above = daylight(9000) * _log_uniform(rng, 0.002, 0.02)
        below = blackbody(rng.uniform(2000, 4000)) * _log_uniform(rng, 0.005, 0.1)
        _add_window(room, rng, int(rng.choice(SIDE_WALLS)), above, below)


def _add_window(room: Room, rng: np.random.Generator, wall: int, above: np.ndarray, below: np.ndarray) -> None:
    """Adds a window at a random place of a side wall, with a radiance (3,) above and one below the horizon."""
    along = 2 - wall // 2  # horizontal axis in the wall's plane
    length, height = room.size[along], room.size[1]
    width = min(_log_uniform(rng, 0.7, 4.0), 0.8 * length)
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
            room.area_lights.append(AreaLight(wall, low, high, radiance, daylight=True))


def _add_skylight(room: Room, rng: np.random.Generator, radiance: np.ndarray) -> None:
    """Adds a square window of `radiance` (3,), at a place of the ceiling that `rng` draws."""
    x, y, z = room.size
    side = _log_uniform(rng, 0.8, 3)
    sx, sz = min(side, 0.6 * x), min(side, 0.6 * z)
    low = np.array([rng.uniform(0, x - sx), y, rng.uniform(0, z - sz)])
    room.area_lights.append(AreaLight(CEILING, low, low + [sx, 0, sz], radiance, daylight=True))


def _add_lamps(room: Room, rng: np.random.Generator, kind: str) -> None:
    """Adds a luminous ceiling, two lamps on opposite sides, panels in the ceiling, or single lamps.

    `plain` rooms get any of these; `sided` rooms panels or one or two lamps; `soft` rooms a luminous ceiling, panels or
    many lamps.
    """
    temperature = _sample_temperature(rng)
    power = _log_uniform(rng, 0.3, 3.0) * room.size[0] * room.size[2] * 6  # proportional to the floor's area
    probabilities = {
        "plain": (0.2, 0.12, 0.36, 0.32),
        "sided": (0.0, 0.0, 0.15, 0.85),
        "soft": (0.5, 0.0, 0.3, 0.2),
    }[kind]
    mode = ("ceiling", "two lamps", "panels", "lamps")[rng.choice(4, p=probabilities)]
    if mode == "ceiling":
        _add_luminous_ceiling(room, rng, blackbody(temperature) * power)
    elif mode == "two lamps":
        _add_two_lamps(room, rng, temperature, 2 * power)
    elif mode == "panels":
        _add_panels(room, rng, blackbody(temperature) * power)
    else:
        count = {"plain": rng.integers(1, 7), "sided": rng.integers(1, 3), "soft": rng.integers(5, 13)}[kind]
        _add_single_lamps(room, rng, temperature, power, int(count), low_share=0.7 if kind == "sided" else 0.25)
    if mode in ("two lamps", "lamps") and not room.lamps:  # all were too close to the camera
        x, _, z = np.where(room.camera < room.size / 2, 0.8, 0.2) * room.size
        _add_lamp(room, rng, np.array([x, room.size[1] - 0.2, z]), 0.1, temperature, power)


def _sample_temperature(rng: np.random.Generator) -> float:
    """Draws the temperature of a lamp in kelvin: candle and tungsten, halogen and warm white, neutral, or daylight."""
    ranges = ((2300, 2900), (2900, 3500), (3500, 4500), (4500, 6500))
    return float(rng.uniform(*ranges[rng.choice(4, p=(0.18, 0.47, 0.2, 0.15))]))


def _add_luminous_ceiling(room: Room, rng: np.random.Generator, power: np.ndarray) -> None:
    """Adds an area light of `power` (3,) that nearly fills the ceiling, and raises the walls' albedo."""
    room.albedo[list(SIDE_WALLS)] = np.maximum(room.albedo[list(SIDE_WALLS)], rng.uniform(0.35, 0.75))
    low, high = np.array([0, room.size[1], 0]), room.size.copy()
    margin = rng.uniform(0.02, 0.12) * room.size * [1, 0, 1]
    low, high = low + margin, high - margin
    room.area_lights.append(AreaLight(CEILING, low, high, power / ((high - low)[0] * (high - low)[2] * np.pi)))


def _add_two_lamps(room: Room, rng: np.random.Generator, temperature: float, power: float) -> None:
    """Adds two lamps on opposite sides of the camera and darkens the room, for light with a strong second band.

    `power` is the radiant flux of both together, in the unit of radiance times square metres; color in kelvin.
    """
    room.albedo *= rng.uniform(0.25, 0.6)
    heading = rng.uniform(0, 2 * np.pi)
    for angle, share in ((0.0, 1.0), (np.pi + rng.normal(0, 0.4), rng.uniform(0.35, 0.8))):
        direction = np.array([np.sin(heading + angle), rng.uniform(0, 0.5), np.cos(heading + angle)])
        centre = np.clip(room.camera + _log_uniform(rng, 0.9, 2.5) * direction, 0.15, room.size - 0.15)
        _add_lamp(room, rng, centre, 0.1, temperature, share * power / 2)


def _add_panels(room: Room, rng: np.random.Generator, power: np.ndarray) -> None:
    """Adds a grid of ceiling panels with a total power (3,), linear RGB, if all were on; some are off."""
    x, y, z = room.size
    nx, nz = (int(np.clip(side / rng.uniform(1.8, 3.5), 1, 5)) for side in (x, z))
    sx, sz = min(rng.choice([0.3, 0.6, 0.6]), 0.8 * x / nx), min(rng.choice([0.6, 1.2, 1.2]), 0.8 * z / nz)
    radiance = power / (nx * nz * sx * sz * np.pi)
    is_on = rng.random((nx, nz)) > 0.12
    is_on[0, 0] |= not is_on.any()
    for i, j in np.ndindex(nx, nz):
        if is_on[i, j]:
            centre = np.array([(i + 0.5) * x / nx, y, (j + 0.5) * z / nz])
            half = np.array([sx / 2, 0, sz / 2])
            room.area_lights.append(AreaLight(CEILING, centre - half, centre + half, radiance))


def _add_single_lamps(
    room: Room, rng: np.random.Generator, temperature: float, power: float, count: int, low_share: float
) -> None:
    """Adds `count` lamps, none of them close to the camera; `power` is that of all.

    One is a floor or wall lamp with the probability `low_share`; the others hang from the ceiling.
    """
    x, y, z = room.size
    radius = rng.choice([0.06, 0.08, 0.15, 0.22])
    for _ in range(count):
        centre = np.array([rng.uniform(0.1, 0.9) * x, y - 0.2, rng.uniform(0.1, 0.9) * z])
        if rng.random() >= low_share:  # ceiling lamp
            centre[1] = y - rng.uniform(0.1, 0.9) if y > 2.7 else y - 0.2
        elif rng.random() < 0.5:  # floor lamp
            centre[1] = rng.uniform(1.3, 1.8)
        else:  # wall lamp
            axis = rng.choice([0, 2])
            centre[axis] = 0.12 if rng.random() < 0.5 else room.size[axis] - 0.12
            centre[1] = rng.uniform(1.6, 2.1)
        _add_lamp(room, rng, centre, radius, temperature, power / count)


def _add_lamp(
    room: Room, rng: np.random.Generator, centre: np.ndarray, radius: float, temperature: float, power: float
) -> None:
    """Adds a lamp, unless it is within CLEARANCE of the camera; its color is within 7 %, or random for one in six."""
    own_temperature = _sample_temperature(rng) if rng.random() < 1 / 6 else temperature * rng.uniform(0.93, 1.07)
    if np.linalg.norm(centre - room.camera) - radius > CLEARANCE:
        room.lamps.append(Lamp(centre, radius, blackbody(own_temperature) * power / (4 * np.pi**2 * radius**2)))


def _add_furniture(room: Room, rng: np.random.Generator) -> None:
    """Adds up to seven boxes on the floor, most of them against a wall, none close to or below the camera."""
    for _ in range(rng.integers(0, 8)):
        heights = (1.3, 2.2) if rng.random() < 0.25 else (0.35, 1.2)
        extents = [_log_uniform(rng, *limits) for limits in ((0.3, 2.2), heights, (0.3, 2.2))]
        size = np.minimum(extents, room.size * 0.6)
        low = np.array([rng.uniform(0, room.size[0] - size[0]), 0, rng.uniform(0, room.size[2] - size[2])])
        if rng.random() < 0.6:
            axis = rng.choice([0, 2])
            low[axis] = 0 if rng.random() < 0.5 else room.size[axis] - size[axis]
        albedo = np.clip(_log_uniform(rng, 0.06, 0.7) * (0.55 + 0.6 * rng.random(3)), 0.02, 0.9)
        gap = np.maximum(np.maximum(low - room.camera, room.camera - low - size), 0)[[0, 2]]
        if np.linalg.norm(gap) > CLEARANCE:
            room.boxes.append(Box(low, low + size, albedo))


def generate_room(seed: int) -> np.ndarray:
    """Generates the panorama of a room.

    The exposure is log-normal, as in photography: one room in fourteen has a reference brightness below the paper's
    threshold of 0.2.

    Returns:
        (64,128,3) float32 lat-long, linear, -z at the centre, samples at pixel centres.
    """
    rng = np.random.default_rng([seed, 0x100])
    pixels = render_room(sample_room(rng))
    while not pixels.any():  # in one room in 1,200 no light reaches the camera
        pixels = render_room(sample_room(rng))
    weight = latlong_solid_angles(HEIGHT, WIDTH)[:, None, None] / (4 * np.pi)
    pixels = pixels * white_balance(rng, (pixels * weight).sum((0, 1)))
    exposure = np.exp(rng.normal(np.log(0.28), 0.6)) / luminance((pixels * weight).sum((0, 1)))
    return (pixels * exposure).astype(np.float32)


def white_balance(rng: np.random.Generator, mean: np.ndarray) -> np.ndarray:
    """Draws the white balance of a camera, with a random error, as gains (3,) of the channels.

    It is set for daylight, which keeps lamps warm; for lamps, which makes daylight blue; or from the mean color (3,)
    of the picture, which removes most of a color cast.
    """
    mode = ("daylight", "lamps", "picture")[rng.choice(3, p=(0.66, 0.04, 0.3))]
    if mode == "daylight":
        gains = 1 / daylight(rng.uniform(4800, 6500))
    elif mode == "lamps":
        gains = 1 / blackbody(rng.uniform(2900, 4000))
    else:
        color = np.maximum(mean, 1e-3 * mean.max())
        gains = (color / luminance(color)) ** -rng.uniform(0.6, 1.0)
    warmer, greener = rng.normal(0, 0.08), rng.normal(-0.03, 0.05)
    return gains * np.exp([warmer, greener, -warmer])
