"""Measures transport, albedo and normals of a person, and renders true pictures, from one-light-at-a-time frames.

A lamp l of a stage of radius R stands at p_l. It lights a diffuse point x of albedo a and normal n with

    I_l = k a V(x, w_l) max(n.w_l, 0) R^2 / r^2,    w_l = (p_l - x) / r,    r = |p_l - x|,

where k is unknown and the same for all frames. The lamp stands for the solid angle s_l = A_l c_l / r^2 about x: A_l is
its share of the stage's surface, and c_l the cosine between w_l and the stage's radius at the lamp. The integral of
a V max(n.w, 0) times any f(w) is therefore

    1/k sum_l A_l c_l / R^2 f(w_l) I_l,

in which the falloff with distance cancels. With f = Y_lm this is albedo times transport. With a panorama as f, it is
the picture of x under that panorama. Lamps are modelled as points of equal intensity in all directions.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import SphericalVoronoi

from relight.files import UserError
from relight.panoramas import Panorama
from relight.panoramas.radiosity import HEIGHT, WIDTH
from relight.photos.environment import lookup
from relight.sh import basis, sphere_quadrature, unoccluded
from relight.srgb import LINEAR

MAX_DEGREE = 8  # of the harmonics that `quadrature_weights` integrate exactly: more does not help with 331 lamps
STEREO_LEVELS = (0.5, 0.9)  # over a pixel's brightest frame: below, part of it may be in shadow; above, glossy
MIN_FRAMES = 12  # per pixel, for photometric stereo
MIN_EIGENVALUE = 0.02  # of the second moments of a pixel's lamp directions, over their trace
BLUR = 0.6  # standard deviation over the lamps' spacing: an even light has ripples of 6 exp(-2 pi^2 BLUR^2), .5 %
UPSAMPLING = 4  # of panoramas along each axis, before the nearest texel is taken
CODE_STEP = np.gradient(LINEAR).astype(np.float32)  # linear difference between neighbouring 8-bit codes

Frames = Callable[[], Iterable[tuple[int, np.ndarray]]]  # (lamp, its frame at P pixels: (P,3) uint8 sRGB)


@dataclass(frozen=True)
class Pinhole:
    """A calibrated camera with the interface of `relight.transport.camera.Camera`.

    Attributes:
        size: (height, width) of the image in pixels.
        focal: (2,) along x and y, pixels.
        centre: (2,) x and y of the principal point, pixels from the corner of the top left pixel.
        rotation: (3,3) from the world's axes to the camera's (+x right, +y up, +z toward the camera).
        eye: (3,) in the world.
    """

    size: tuple[int, int]
    focal: np.ndarray
    centre: np.ndarray
    rotation: np.ndarray
    eye: np.ndarray

    def rays(self, column: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Returns the rays (N,6) float64 of the world through points of the image; along each, z falls by 1."""
        x, y = (column - self.centre[0]) / self.focal[0], (self.centre[1] - row) / self.focal[1]
        toward = np.stack([x, y, np.full_like(x, -1.0)], -1) @ self.rotation
        return np.concatenate([np.broadcast_to(self.eye, toward.shape), toward], -1)

    def toward(self, points: np.ndarray) -> np.ndarray:
        """Returns the directions (N,3), not normalised, from points (N,3) of the world to the camera."""
        return self.eye - points

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Returns the depths (N,) of points (N,3) of the world, along the optical axis."""
        return (self.eye - points) @ self.rotation[2]

    def project(self, points: np.ndarray) -> np.ndarray:
        """Returns x and y (N,2) in the image of points (N,3) of the world; nan behind the camera."""
        x, y, z = (self.rotation @ (points - self.eye).T).astype(np.float64)
        z = np.where(z < 0, -z, np.nan)
        return np.stack([self.centre[0] + self.focal[0] * x / z, self.centre[1] - self.focal[1] * y / z], -1)


def quadrature_weights(directions: np.ndarray) -> np.ndarray:
    """Returns weights of a quadrature rule on the sphere with nodes at given directions.

    The areas of Voronoi cells have an error of second order where lamps are missing. So the weights are those with the
    least squared relative change from these areas that integrate all spherical harmonics up to a degree exactly. The
    degree is the highest one up to MAX_DEGREE for which all weights are positive.

    Args:
        directions: (L,3) unit vectors, all different.

    Returns:
        (L,) solid angles, whose sum is 4 pi.

    Raises:
        UserError: if two lamps have the same direction, or all lie in one plane.
    """
    try:
        cells = SphericalVoronoi(directions, threshold=1e-9).calculate_areas()
    except ValueError as error:
        raise UserError(f"the lamps' directions do not span a sphere ({str(error).split(chr(10))[0]})") from None
    weights = cells
    for degree in range(MAX_DEGREE + 1):
        values = basis(directions, degree)
        integrals = np.zeros(values.shape[1])
        integrals[0] = np.sqrt(4 * np.pi)
        change, *_ = np.linalg.lstsq(values.T * np.sqrt(cells), integrals - cells @ values, rcond=None)
        candidate = cells + np.sqrt(cells) * change
        if len(values) <= values.shape[1] or candidate.min() <= 0:
            break
        weights = candidate
    return weights


def projection_error(directions: np.ndarray, weights: np.ndarray) -> float:
    """Returns the RMS error, over all normals, of unoccluded transport (a vector of nine) by a quadrature rule.

    Shadow edges add to it: see `relight.benchmark.bakedstage.agreement`, `lamps`.

    Args:
        directions: (L,3) unit vectors to the lamps.
        weights: (L,) solid angles.
    """
    normals, solid_angles = sphere_quadrature(16)
    transport = (np.maximum(normals @ directions.T, 0) * weights) @ basis(directions)
    squared = ((transport - unoccluded(normals)) ** 2).sum(1)
    return float(np.sqrt(squared @ solid_angles / solid_angles.sum()))


@dataclass(frozen=True)
class LightStage:
    """The lamps of a light stage.

    Attributes:
        positions: (L,3), in any unit, in the frame of the points to be lit.
        centre: (3,) of the sphere fitted to them by least squares.
        radius: R, of that sphere.
        areas: (L,) A_l / R^2, the solid angle of each lamp seen from the centre.
        error: `projection_error` at the centre.
    """

    positions: np.ndarray
    centre: np.ndarray
    radius: float
    areas: np.ndarray
    error: float

    @classmethod
    def from_positions(cls, positions: np.ndarray) -> "LightStage":
        """Returns the stage with lamps at positions (L,3). Raises UserError as `quadrature_weights`."""
        system = np.concatenate([2 * positions, np.ones((len(positions), 1))], 1)
        sphere, *_ = np.linalg.lstsq(system, (positions**2).sum(1), rcond=None)  # |p|^2 = 2 p.c + R^2 - |c|^2
        centre = sphere[:3]
        radius = float(np.sqrt(max(sphere[3] + centre @ centre, 1e-12)))
        outward = positions - centre
        distance = np.linalg.norm(outward, axis=1, keepdims=True)
        directions = outward / np.maximum(distance, 1e-12)
        weights = quadrature_weights(directions)
        areas = weights * (distance[:, 0] / radius) ** 2
        return cls(positions, centre, radius, areas, projection_error(directions, weights))

    def lamp_seen_from(self, lamp: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the direction, weight and falloff of a lamp at points (P,3).

        Returns:
            Directions w (P,3); weights A_l c_l / R^2 (P,) of the lamp's frame; falloff R^2 / r^2 (P,) of its light.
        """
        directions = self.positions[lamp] - points
        distance = np.linalg.norm(directions, axis=1)
        directions /= distance[:, None]
        outward = self.positions[lamp] - self.centre
        cosine = directions @ (outward / np.linalg.norm(outward))
        return directions, self.areas[lamp] * np.maximum(cosine, 0), (self.radius / distance) ** 2


@dataclass
class Measured:
    """What is measured at P pixels. Albedo and pictures have one unknown factor in common, the lamps' intensity k.

    Attributes:
        known: (P,) bool, whether enough frames light the pixel for photometric stereo.
        albedo: (P,3), a k.
        normal: (P,3) unit, by photometric stereo.
        transport: (P,9), without 1/pi.
        noise: (P,9), standard deviation of `transport` from the rounding of frames to 8 bits. The errors of the sums
            and of the albedo are taken as independent; they are correlated, so the true value is smaller.
        pictures: (P,N,3) linear, under N panoramas, times k.
        clipped: fraction of all pixels of all frames with a channel at code 255.
    """

    known: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    transport: np.ndarray
    noise: np.ndarray
    pictures: np.ndarray
    clipped: float


class Panoramas:
    """Panoramas upsampled so far that a lookup can take the nearest texel.

    Attributes:
        count: N, the number of panoramas.
        texels: (UPSAMPLING * HEIGHT, UPSAMPLING * WIDTH, 3 N) float32.
    """

    def __init__(self, panoramas: Iterable[np.ndarray] = ()):
        """Takes panoramas (64,128,3), laid out like `relight.panoramas.radiosity.view_directions`."""
        height, width = UPSAMPLING * HEIGHT, UPSAMPLING * WIDTH
        theta = (np.arange(height) + 0.5)[:, None] / height * np.pi
        phi = (2 * (np.arange(width) + 0.5) / width - 1) * np.pi
        axes = np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi))
        layers = [lookup(Panorama(pixels), np.stack(axes, -1)) for pixels in panoramas]
        self.count = len(layers)
        self.texels = np.concatenate(layers, -1) if layers else np.zeros((height, width, 0), np.float32)

    def radiance(self, directions: np.ndarray) -> np.ndarray:
        """Returns the radiance (P,N,3) in directions (P,3)."""
        height, width = self.texels.shape[:2]
        x, y, z = directions.T
        row = np.minimum((np.arccos(np.clip(y, -1, 1)) / np.pi * height).astype(int), height - 1)
        column = ((np.arctan2(x, -z) / (2 * np.pi) + 0.5) * width).astype(int) % width
        return self.texels[row, column].reshape(len(directions), self.count, 3)


@dataclass
class FrameSums:
    """The sums of the module's formula over all frames, at P pixels.

    Attributes:
        products: (P,9,3), albedo times transport, times k.
        squared_steps: (P,9,3), 12 times the variance of the products that the rounding to 8 bits causes.
        pictures: (P,N,3), as in `Measured`.
        peak: (P,) the largest mean of the channels in any frame, with the falloff removed.
        clipped: as in `Measured`.
    """

    products: np.ndarray
    squared_steps: np.ndarray
    pictures: np.ndarray
    peak: np.ndarray
    clipped: float


@dataclass
class Stereo:
    """The result of photometric stereo at P pixels.

    Attributes:
        known: (P,) bool.
        normal: (P,3) unit.
        albedo: (P,3), a k; zero where not known.
        variance: (P,3) of the albedo, from the rounding to 8 bits.
    """

    known: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    variance: np.ndarray


def measure(frames: Frames, stage: LightStage, points: np.ndarray, panoramas: Panoramas | None = None) -> Measured:
    """Measures transport, albedo, normals, and pictures under panoramas.

    Frames are read twice, one at a time: for the sums of the module's formula, then for photometric stereo. The albedo
    is divided out of the sums by least squares over the three channels. If the lamps' spectra differ, k differs between
    the channels, and only the albedo is affected.

    Args:
        frames: yields all frames; called twice.
        stage: with the lamps.
        points: (P,3) of the pixels' surface, in the stage's frame, whose axes the maps have.
        panoramas: to render pictures under, in the same axes.
    """
    sums = sum_frames(frames, stage, points, panoramas or Panoramas())
    stereo = photometric_stereo(frames, stage, points, sums.peak)
    albedo, normal = stereo.albedo, stereo.normal
    square = np.maximum((albedo**2).sum(1), 1e-12)[:, None]
    transport = np.einsum("pkc,pc->pk", sums.products, albedo) / square
    noise = np.einsum("pkc,pc->pk", sums.squared_steps / 12, albedo**2) / square**2
    noise += transport**2 * ((albedo**2 * stereo.variance).sum(1)[:, None] / square**2)
    for values in (transport, noise, normal):
        values *= stereo.known[:, None]
    return Measured(stereo.known, albedo, normal, transport, np.sqrt(noise), sums.pictures, sums.clipped)


def sum_frames(frames: Frames, stage: LightStage, points: np.ndarray, panoramas: Panoramas) -> FrameSums:
    """Sums up frames, each weighted by the lamp's solid angle; arguments as for `measure`."""
    count = len(points)
    products, squared_steps = np.zeros((count, 9, 3), np.float32), np.zeros((count, 9, 3), np.float32)
    pictures = np.zeros((count, panoramas.count, 3), np.float32)
    peak, clipped, total = np.zeros(count, np.float32), 0, 0
    for lamp, codes in frames():
        lit = np.flatnonzero(codes.any(1))
        directions, weight, falloff = stage.lamp_seen_from(lamp, points[lit])
        linear = LINEAR[codes[lit]]
        harmonics = (weight[:, None] * basis(directions)).astype(np.float32)[..., None]
        products[lit] += harmonics * linear[:, None]
        squared_steps[lit] += (harmonics * CODE_STEP[codes[lit]][:, None]) ** 2
        if panoramas.count:
            pictures[lit] += weight[:, None, None] * panoramas.radiance(directions) * linear[:, None]
        peak[lit] = np.maximum(peak[lit], linear.mean(1) / falloff)
        clipped += int((codes == 255).any(1).sum())
        total += count
    return FrameSums(products, squared_steps, pictures, peak, clipped / max(total, 1))


def photometric_stereo(frames: Frames, stage: LightStage, points: np.ndarray, peak: np.ndarray) -> Stereo:
    """Finds normal and albedo by linear regression of a pixel's brightness on the directions of the lamps.

    For each pixel, only those frames are used in which its level relative to `peak` is in STEREO_LEVELS.

    Args:
        frames: as for `measure`.
        stage: with the lamps.
        points: (P,3).
        peak: (P,) of `FrameSums`.
    """
    count = len(points)
    moments, responses = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    errors, used = np.zeros((count, 3, 3, 3), np.float32), np.zeros(count, int)
    for lamp, codes in frames():
        lit = np.flatnonzero(codes.any(1))
        directions, _, falloff = stage.lamp_seen_from(lamp, points[lit])
        linear = LINEAR[codes[lit]] / falloff[:, None]
        level = linear.mean(1) / peak[lit]
        selected = np.flatnonzero((level > STEREO_LEVELS[0]) & (level < STEREO_LEVELS[1]))
        lit, directions, linear = lit[selected], directions[selected], linear[selected]
        outer = np.einsum("pi,pj->pij", directions, directions)
        moments[lit] += outer
        responses[lit] += np.einsum("pi,pc->pic", directions, linear)
        errors[lit] += np.einsum("pij,pc->pcij", outer, (CODE_STEP[codes[lit]] / falloff[selected, None]) ** 2)
        used[lit] += 1
    least = np.linalg.eigvalsh(moments)[:, 0]
    trace = np.einsum("pii->p", moments)
    known = (used >= MIN_FRAMES) & (least > MIN_EIGENVALUE * np.maximum(trace, 1e-12))
    solvable = np.where(known[:, None, None], moments, np.eye(3))
    normal = np.linalg.solve(solvable, responses.mean(2)[..., None])[..., 0]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    square = np.maximum(np.einsum("pi,pij,pj->p", normal, solvable, normal), 1e-12)[:, None]
    albedo = np.maximum(np.einsum("pi,pic->pc", normal, responses) / square, 0) * known[:, None]
    variance = np.einsum("pi,pcij,pj->pc", normal, errors, normal) / 12 / square**2
    return Stereo(known, normal, albedo, variance)


def blur_to_spacing(panoramas: np.ndarray, lamps: int) -> np.ndarray:
    """Returns panoramas (...,64,128,3) blurred to the resolution that a stage with so many lamps can show.

    Each texel becomes the mean about it with a von Mises-Fisher kernel, whose standard deviation is BLUR times the
    distance between lamps. Along the rows this is a convolution, computed as a product of Fourier coefficients.
    """
    theta = (np.arange(HEIGHT) + 0.5) / HEIGHT * np.pi
    azimuth = np.arange(WIDTH) / WIDTH * 2 * np.pi
    sine, cosine = np.sin(theta), np.cos(theta)
    between = np.outer(cosine, cosine)[..., None] + np.outer(sine, sine)[..., None] * np.cos(azimuth)
    variance = BLUR**2 * 4 * np.pi / lamps
    kernel = np.exp((between - 1) / variance) * sine[:, None]  # sine: proportional to a texel's solid angle
    kernel /= kernel.sum((1, 2), keepdims=True)
    spectrum = np.einsum("ijf,...jfc->...ifc", np.fft.rfft(kernel), np.fft.rfft(panoramas, axis=-2), optimize=True)
    return np.fft.irfft(spectrum, WIDTH, axis=-2)
