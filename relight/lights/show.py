"""Draws a light: ball, diffuse panorama, statistics."""

from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.files import atomic_write
from relight.core.srgb import encode, to_bytes
from relight.lights.light import MIN_EIGENVALUE, Light
from relight.lights.statistics import measure
from relight.panoramas.lookup import lookup
from relight.panoramas.projection import latlong_directions
from relight.sh import irradiance, order_of, unoccluded

ALBEDO = 0.5  # of the balls, so that lights above the reference brightness are not clipped
BRIGHTEST = 0.85  # linear value in the picture of a light, of its brightest channel at the brightest normal
PANE = 256  # pixels of the height of a panorama in it
DARK = 0.08  # code around the ball
EVEN = 0.005  # contrast |L1| / L00 that is shown as 0.00: such light has no direction
SAMPLES = 4  # of a ball's edge, per pixel in each direction


def lit_ball(coefficients: np.ndarray, size: int, white: float = 1 / ALBEDO, linear: bool = True) -> np.ndarray:
    """Renders a diffuse ball under a light, as the camera sees it.

    Args:
        coefficients: (K,3) of the light.
        size: side of the square picture, pixels.
        white: the irradiance that is shown as 1.
        linear: whether the light is linear and the result is sRGB-encoded; otherwise, the codes are the light's.

    Returns:
        (size,size,4) float64 codes and alpha in [0,1].
    """
    inside, transport = unoccluded_ball(size, order_of(len(coefficients)), rim=1 + 2 / size)
    lit = np.einsum("pk,kc->pc", transport, coefficients)  # BLAS costs ten times as much, for its threads spin
    color = np.maximum(lit / white, 0)
    picture = np.zeros((size, size, 4))
    picture[inside, :3] = encode(color) if linear else np.minimum(color, 1)
    t = (2 * np.arange(size * SAMPLES) + 1) / (size * SAMPLES) - 1
    picture[..., 3] = (t[:, None] ** 2 + t**2 < 1).reshape(size, SAMPLES, size, SAMPLES).mean((1, 3))
    return picture


@lru_cache(maxsize=4)
def unoccluded_ball(size: int, order: int, rim: float = 1) -> tuple[np.ndarray, np.ndarray]:
    """Returns the disc and the transport of a unit ball seen from the front.

    Args:
        size: side of the square picture, pixels.
        order: largest degree of the spherical harmonics; there are K = (order + 1)^2 coefficients.
        rim: radius of the disc; beyond 1, normals are those at the ball's rim.

    Returns:
        The disc, (size,size) bool, and the unoccluded transport (P,K) of its pixels in raster order.
    """
    t = (2 * np.arange(size) + 1) / size - 1
    x, y = np.meshgrid(t, -t)
    inside = x * x + y * y < rim * rim
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x * x - y * y, 0))], -1)[inside]
    if rim > 1:
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return inside, unoccluded(normals, order)


def diffuse_panorama(coefficients: np.ndarray, height: int) -> np.ndarray:
    """Returns the radiance E(n) / pi of a white diffuse surface for all normals n.

    Args:
        coefficients: (K,3) of the light.
        height: height of the panorama in pixels.

    Returns:
        (height, 2 height,3) linear, lat-long with -z at the centre.
    """
    values = irradiance(coefficients, latlong_directions(height, 2 * height).reshape(-1, 3))
    return np.maximum(values, 0).reshape(height, 2 * height, 3) / np.pi


def write_light_picture(light: Light, path: Path | str) -> None:
    """Writes a picture of a light as PNG: its panorama if it is known, its diffuse panorama, and a lit ball.

    The panoramas are lat-long, with -z (away from the camera) in the middle. Ball and diffuse panorama are exposed for
    the brightest channel at its brightest normal, so that no color is clipped.
    """
    diffuse = diffuse_panorama(light.coefficients, PANE)
    exposure = BRIGHTEST / max(float(diffuse.max()), 1e-12)
    panes = [encode(diffuse * exposure)]
    if light.panorama is not None:
        panes.insert(0, _tone_mapped(lookup(light.panorama, latlong_directions(PANE, 2 * PANE))))
    ball = lit_ball(light.coefficients, PANE * len(panes), white=np.pi / exposure)
    color, alpha = np.split(ball, [3], axis=-1)
    picture = np.concatenate([np.concatenate(panes), color * alpha + DARK * (1 - alpha)], axis=1)
    with atomic_write(path) as temporary:
        Image.fromarray(to_bytes(picture)).save(temporary, "png")


def _tone_mapped(pixels: np.ndarray) -> np.ndarray:
    """Tone-maps linear pixels (h,w,3) to sRGB codes in [0,1], exposed for the 60th percentile of what is not black."""
    level = pixels.astype(np.float64).mean(-1)
    exposed = pixels * 0.35 / max(float(np.percentile(level[level > 0], 60)), 1e-9)
    return encode(exposed * (1 + exposed / 16) / (1 + exposed * 0.6))


def format_statistics(light: Light) -> list[tuple[str, str]]:
    """Returns the layout of a light's panorama and the light's statistics, as labels and formatted values."""
    stats = {name: float(value[0]) for name, value in measure(light.coefficients[None]).items()}
    direction = "none" if stats["first"] < EVEN else f"{stats['azimuth']:+.0f}°  {stats['elevation']:+.0f}°"
    layout = [("layout of the panorama", light.panorama.layout)] if light.panorama else []
    return [
        *layout,
        ("reference brightness, E(0,0,1)", f"{stats['reference']:.5g}"),
        ("mean irradiance", f"{stats['mean']:.5g}"),
        ("darkest, brightest / mean", f"{stats['least'] / stats['mean']:.2f}  {stats['most'] / stats['mean']:.2f}"),
        ("from above, below / mean", f"{stats['up']:.2f}  {stats['down']:.2f}"),
        ("front, back", f"{stats['front_mean']:.5g}  {stats['back_mean']:.5g}"),
        ("contrast |L1| / L00", f"{stats['first']:.2f}"),
        ("structure |L2| / L00", f"{stats['second']:.2f}"),
        ("main direction: right, up", direction),
        ("color ln R/G, ln B/G", f"{stats['red']:+.2f}  {stats['blue']:+.2f}"),
        ("realisable (moments)", f"{'yes' if stats['moment'] >= MIN_EIGENVALUE else 'NO'}  {stats['moment']:+.3f}"),
        ("order", f"{light.order}"),
    ]
