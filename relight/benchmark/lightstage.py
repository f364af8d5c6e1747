"""What the frames of a light stage, one light at a time, tell of a person: transport, albedo, normals, true pictures.

A lamp l of a stage of radius R stands at p_l, and lights a matt point x of albedo a and normal n with

    I_l = k a V(x, w_l) max(n.w_l, 0) R^2 / r^2,    w_l = (p_l - x) / r,    r = |p_l - x|,

where k is the same for all frames and unknown. Of the sphere of directions about x the lamp stands for the solid angle
s_l = A_l c_l / r^2, where A_l is its share of the stage's surface and c_l the cosine between w_l and the stage's radius
there. So the integral of a V max(n.w, 0) times any f(w) is

    1/k sum_l A_l c_l / R^2 f(w_l) I_l:

the falling off with distance cancels. With f = Y_lm this is albedo times transport; with f a panorama, it is the
picture of x under it. Lamps are taken for points that shine evenly toward all of the person.
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

HIGHEST = 8  # highest degree that `quadrature_weights` integrate exactly: more does not help with 331 lamps
LIT = (0.5, 0.9)  # of a pixel's brightest frame: darker may be shadow in part of the pixel, brighter may be gloss
ENOUGH = 12  # frames in between, which tell a normal and an albedo
FLATTEST = 0.02  # least eigenvalue of the lamps' second moments, over their sum, from which a normal is told
SOFTNESS = 0.6  # lamps side by side add up to an even light, within 6 exp(-2 pi^2 SOFTNESS^2), half a percent
FINE = 4  # texels of a panorama, along each axis, that it is looked up in
STEP = np.gradient(LINEAR).astype(np.float32)  # linear step between neighbouring 8-bit codes

Frames = Callable[[], Iterable[tuple[int, np.ndarray]]]  # each lamp with its frame at P pixels, (P,3) uint8 sRGB


@dataclass(frozen=True)
class Pinhole:
    """A calibrated camera, in place of `relight.transport.camera.Camera`.

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

    Voronoi cells leave an error of second order where lamps are missing. So the weights are those nearest to the cells'
    areas, relative to them, with which all spherical harmonics up to a degree integrate exactly, for the highest degree
    up to HIGHEST with which all weights stay positive.

    Args:
        directions: (L,3) unit vectors, all different.

    Returns:
        (L,) solid angles, whose sum is 4 pi.

    Raises:
        UserError: if two lamps have one direction, or all lie in one plane.
    """
    try:
        cells = SphericalVoronoi(directions, threshold=1e-9).calculate_areas()
    except ValueError as error:
        raise UserError(f"the lamps' directions do not span a sphere ({str(error).split(chr(10))[0]})") from None
    best = cells
    for degree in range(HIGHEST + 1):
        values = basis(directions, degree)
        goal = np.zeros(values.shape[1])
        goal[0] = np.sqrt(4 * np.pi)
        change, *_ = np.linalg.lstsq(values.T * np.sqrt(cells), goal - cells @ values, rcond=None)
        found = cells + np.sqrt(cells) * change
        if len(values) <= values.shape[1] or found.min() <= 0:
            break
        best = found
    return best


def projection_error(directions: np.ndarray, weights: np.ndarray) -> float:
    """Returns the RMS over all normals of the error, as a vector of nine, of unoccluded transport by this rule.

    That of a stage without shadows; edges of shadows add to it (`stage_transport` tells by how much).

    Args:
        directions: (L,3) of the lamps.
        weights: (L,) solid angles.
    """
    normals, spread = sphere_quadrature(16)
    found = (np.maximum(normals @ directions.T, 0) * weights) @ basis(directions)
    return float(np.sqrt(((found - unoccluded(normals)) ** 2).sum(1) @ spread / spread.sum()))


@dataclass(frozen=True)
class LightStage:
    """The lamps of a light stage.

    Attributes:
        positions: (L,3), in any unit, all of one frame with the points to be lit.
        centre: (3,) of the sphere that fits them best.
        radius: R, of that sphere.
        areas: (L,) A_l / R^2, each lamp's share of the sphere.
        error: `projection_error` at the centre.
    """

    positions: np.ndarray
    centre: np.ndarray
    radius: float
    areas: np.ndarray
    error: float

    @classmethod
    def of(cls, positions: np.ndarray) -> "LightStage":
        """Returns the stage with lamps at positions (L,3). Raises UserError as `quadrature_weights`."""
        system = np.concatenate([2 * positions, np.ones((len(positions), 1))], 1)
        found, *_ = np.linalg.lstsq(system, (positions**2).sum(1), rcond=None)  # |p|^2 = 2 p.c + R^2 - |c|^2
        centre = found[:3]
        radius = float(np.sqrt(max(found[3] + centre @ centre, 1e-12)))
        outward = positions - centre
        distance = np.linalg.norm(outward, axis=1, keepdims=True)
        directions = outward / np.maximum(distance, 1e-12)
        weights = quadrature_weights(directions)
        areas = weights * (distance[:, 0] / radius) ** 2
        return cls(positions, centre, radius, areas, projection_error(directions, weights))

    def seen_from(self, lamp: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns where a lamp stands as seen from points (P,3).

        Returns:
            Directions w (P,3); weights A_l c_l / R^2 (P,) of the frame; falling off R^2 / r^2 (P,) of the light.
        """
        toward = self.positions[lamp] - points
        distance = np.linalg.norm(toward, axis=1)
        toward /= distance[:, None]
        outward = self.positions[lamp] - self.centre
        cosine = toward @ (outward / np.linalg.norm(outward))
        return toward, self.areas[lamp] * np.maximum(cosine, 0), (self.radius / distance) ** 2


@dataclass
class Measured:
    """What the frames tell of P pixels; albedo and pictures share one unknown factor, the lamps' brightness.

    Attributes:
        known: (P,) bool, whether enough frames light the pixel to tell its albedo.
        albedo: (P,3), a k.
        normal: (P,3) unit, by photometric stereo.
        transport: (P,9), without 1/pi.
        noise: (P,9), the standard deviation of `transport` that the rounding of frames to 8 bits causes, as if those of
            the sums and of the albedo were independent; they go along, so it is less.
        pictures: (P,N,3) linear, under N panoramas, times k.
        clipped: share of the pixels' frames with a channel at code 255.
    """

    known: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    transport: np.ndarray
    noise: np.ndarray
    pictures: np.ndarray
    clipped: float


class Lighting:
    """Panoramas that pictures are summed up under, resampled to texels so fine that the nearest one will do.

    Attributes:
        count: N, of the panoramas.
        texels: (FINE HEIGHT, FINE WIDTH, 3 N) float32.
    """

    def __init__(self, panoramas: Iterable[np.ndarray] = ()):
        """Takes panoramas (64,128,3), laid out like `relight.panoramas.radiosity.view_directions`."""
        theta = (np.arange(FINE * HEIGHT) + 0.5)[:, None] / (FINE * HEIGHT) * np.pi
        phi = (2 * (np.arange(FINE * WIDTH) + 0.5) / (FINE * WIDTH) - 1) * np.pi
        axes = np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi))
        found = [lookup(Panorama(one), np.stack(axes, -1)) for one in panoramas]
        self.count = len(found)
        self.texels = np.concatenate(found, -1) if found else np.zeros((FINE * HEIGHT, FINE * WIDTH, 0), np.float32)

    def toward(self, directions: np.ndarray) -> np.ndarray:
        """Returns the radiance (P,N,3) in directions (P,3)."""
        height, width = self.texels.shape[:2]
        x, y, z = directions.T
        row = np.minimum((np.arccos(np.clip(y, -1, 1)) / np.pi * height).astype(int), height - 1)
        column = ((np.arctan2(x, -z) / (2 * np.pi) + 0.5) * width).astype(int) % width
        return self.texels[row, column].reshape(len(directions), self.count, 3)


def measure(frames: Frames, stage: LightStage, points: np.ndarray, lighting: Lighting | None = None) -> Measured:
    """Measures transport, albedo, normals, and pictures under panoramas.

    Frames are read twice, one at a time: first for the sums of the module's formula, then for albedo and normal by
    photometric stereo from the frames whose light reaches the pixel (LIT). With I_l = k (a V max(n.w, 0)) R^2/r^2, the
    three channels tell one transport, by least squares. Where the lamps' spectra differ, so does k between channels,
    and albedo alone takes that up.

    Args:
        frames: called twice.
        stage: with the lamps.
        points: (P,3) of the pixels' surface, in the stage's frame; maps are in its axes.
        lighting: panoramas in its axes.
    """
    lighting = lighting or Lighting()
    count = len(points)
    sums, spread = np.zeros((count, 9, 3), np.float32), np.zeros((count, 9, 3), np.float32)
    pictures = np.zeros((count, lighting.count, 3), np.float32)
    peak, clipped, seen = np.zeros(count, np.float32), 0, 0
    for lamp, codes in frames():
        lit = np.flatnonzero(codes.any(1))
        toward, weight, falloff = stage.seen_from(lamp, points[lit])
        light = LINEAR[codes[lit]]
        shape = (weight[:, None] * basis(toward)).astype(np.float32)[..., None]
        sums[lit] += shape * light[:, None]
        spread[lit] += (shape * STEP[codes[lit]][:, None]) ** 2
        if lighting.count:
            pictures[lit] += weight[:, None, None] * lighting.toward(toward) * light[:, None]
        peak[lit] = np.maximum(peak[lit], light.mean(1) / falloff)
        clipped += int((codes == 255).any(1).sum())
        seen += count
    moments, answers = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    errors, chosen = np.zeros((count, 3, 3, 3), np.float32), np.zeros(count, int)
    for lamp, codes in frames():
        lit = np.flatnonzero(codes.any(1))
        toward, _, falloff = stage.seen_from(lamp, points[lit])
        light = LINEAR[codes[lit]] / falloff[:, None]
        level = light.mean(1) / peak[lit]
        told = np.flatnonzero((level > LIT[0]) & (level < LIT[1]))
        lit, toward, light = lit[told], toward[told], light[told]
        outer = np.einsum("pi,pj->pij", toward, toward)
        moments[lit] += outer
        answers[lit] += np.einsum("pi,pc->pic", toward, light)
        errors[lit] += np.einsum("pij,pc->pcij", outer, (STEP[codes[lit]] / falloff[told, None]) ** 2)
        chosen[lit] += 1
    least = np.linalg.eigvalsh(moments)[:, 0]
    known = (chosen >= ENOUGH) & (least > FLATTEST * np.maximum(np.einsum("pii->p", moments), 1e-12))
    solvable = np.where(known[:, None, None], moments, np.eye(3))
    normal = np.linalg.solve(solvable, answers.mean(2)[..., None])[..., 0]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    facing = np.maximum(np.einsum("pi,pij,pj->p", normal, solvable, normal), 1e-12)[:, None]
    albedo = np.maximum(np.einsum("pi,pic->pc", normal, answers) / facing, 0) * known[:, None]
    slack = np.einsum("pi,pcij,pj->pc", normal, errors, normal) / 12 / facing**2  # variance of the albedo
    square = np.maximum((albedo**2).sum(1), 1e-12)[:, None]
    transport = np.einsum("pkc,pc->pk", sums, albedo) / square
    noise = np.einsum("pkc,pc->pk", spread / 12, albedo**2) / square**2
    noise += transport**2 * ((albedo**2 * slack).sum(1)[:, None] / square**2)
    for values in (transport, noise, normal):
        values *= known[:, None]
    share = clipped / max(seen, 1)
    return Measured(known, albedo, normal, transport, np.sqrt(noise), pictures, share)


def coarse(panoramas: np.ndarray, lamps: int) -> np.ndarray:
    """Returns panoramas (...,64,128,3) as coarse as a stage of so many lamps can show them.

    Each texel becomes the mean about it with a von Mises-Fisher kernel, whose standard deviation is SOFTNESS of the
    distance between lamps. Along the rows that is a convolution, hence a product of Fourier coefficients.
    """
    theta = (np.arange(HEIGHT) + 0.5) / HEIGHT * np.pi
    azimuth = np.arange(WIDTH) / WIDTH * 2 * np.pi
    sine, cosine = np.sin(theta), np.cos(theta)
    between = np.outer(cosine, cosine)[..., None] + np.outer(sine, sine)[..., None] * np.cos(azimuth)
    variance = SOFTNESS**2 * 4 * np.pi / lamps
    kernel = np.exp((between - 1) / variance) * sine[:, None]  # the sine: a texel's solid angle, but for a factor
    kernel /= kernel.sum((1, 2), keepdims=True)
    spectrum = np.einsum("ijf,...jfc->...ifc", np.fft.rfft(kernel), np.fft.rfft(panoramas, axis=-2), optimize=True)
    return np.fft.irfft(spectrum, WIDTH, axis=-2)
