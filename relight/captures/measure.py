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

from relight.captures.lightstage import LightStage
from relight.sh import basis
from relight.srgb import LINEAR

STEREO_LEVELS = (0.5, 0.9)  # over a pixel's brightest frame: below, part of it may be in shadow; above, glossy
MIN_FRAMES = 12  # per pixel, for photometric stereo
MIN_EIGENVALUE = 0.02  # of the second moments of a pixel's lamp directions, over their trace

Frames = Callable[[], Iterable[tuple[int, np.ndarray]]]  # (lamp, its frame at P pixels: (P,3) uint8 sRGB)
Radiance = Callable[[np.ndarray], np.ndarray]  # directions (P,3) -> the radiance (P,N,3) of N panoramas


@dataclass
class Measured:
    """What is measured at P pixels. Albedo and pictures have one unknown factor in common, the lamps' intensity k.

    Attributes:
        known: (P,) bool, whether enough frames light the pixel for photometric stereo.
        albedo: (P,3), a k.
        normal: (P,3) unit, by photometric stereo.
        transport: (P,9), without 1/pi.
        pictures: (P,N,3) linear, under N panoramas, times k.
        clipped: fraction of all pixels of all frames with a channel at code 255.
    """

    known: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    transport: np.ndarray
    pictures: np.ndarray
    clipped: float


@dataclass
class FrameSums:
    """The sums of the module's formula over all frames, at P pixels.

    Attributes:
        products: (P,9,3), albedo times transport, times k.
        pictures: (P,N,3), as in `Measured`.
        peak: (P,) the largest mean of the channels in any frame, with the falloff removed.
        clipped: as in `Measured`.
    """

    products: np.ndarray
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
    """

    known: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray


def measure(frames: Frames, stage: LightStage, points: np.ndarray, radiance: Radiance | None = None) -> Measured:
    """Measures transport, albedo, normals, and pictures under panoramas.

    Frames are read twice, one at a time: for the sums over lamps (the module's docstring), then for photometric stereo.
    The albedo is divided out of the sums by least squares over the three channels. If the lamps' spectra differ, the
    factor k of their intensity differs between the channels, and only the albedo is affected.

    Args:
        frames: yields all frames; called twice.
        stage: with the lamps.
        points: (P,3) of the pixels' surface, in the stage's frame, whose axes the maps have.
        radiance: radiance of the panoramas to render pictures under, in the same axes.
    """
    sums = sum_frames(frames, stage, points, radiance)
    stereo = photometric_stereo(frames, stage, points, sums.peak)
    albedo, normal = stereo.albedo, stereo.normal
    square = np.maximum((albedo**2).sum(1), 1e-12)[:, None]
    transport = np.einsum("pkc,pc->pk", sums.products, albedo) / square
    for values in (transport, normal):
        values *= stereo.known[:, None]
    return Measured(stereo.known, albedo, normal, transport, sums.pictures, sums.clipped)


def sum_frames(frames: Frames, stage: LightStage, points: np.ndarray, radiance: Radiance | None) -> FrameSums:
    """Sums up frames, each weighted by the lamp's solid angle (the formula in the module's docstring).

    Args:
        frames: yields (number of a lamp, its frame (P,3) uint8 sRGB).
        stage: with the lamps.
        points: (P,3) of the pixels' surface, in the stage's frame.
        radiance: of N panoramas, from directions (P,3) to (P,N,3); None for no pictures.
    """
    count = len(points)
    products = np.zeros((count, 9, 3), np.float32)
    any_direction = np.array([[0.0, 0.0, 1.0]])  # by which to count the panoramas
    panoramas = radiance(any_direction).shape[1] if radiance else 0
    pictures = np.zeros((count, panoramas, 3), np.float32)
    peak, clipped, total = np.zeros(count, np.float32), 0, 0
    for lamp, codes in frames():
        lit_pixels = np.flatnonzero(codes.any(1))
        directions, weight, falloff = stage.lamp_seen_from(lamp, points[lit_pixels])
        linear = LINEAR[codes[lit_pixels]]
        harmonics = (weight[:, None] * basis(directions)).astype(np.float32)[..., None]
        products[lit_pixels] += harmonics * linear[:, None]
        if radiance:
            pictures[lit_pixels] += weight[:, None, None] * radiance(directions) * linear[:, None]
        peak[lit_pixels] = np.maximum(peak[lit_pixels], linear.mean(1) / falloff)
        clipped += int((codes == 255).any(1).sum())
        total += count
    return FrameSums(products, pictures, peak, clipped / max(total, 1))


def photometric_stereo(frames: Frames, stage: LightStage, points: np.ndarray, peak: np.ndarray) -> Stereo:
    """Finds normal and albedo by linear regression of a pixel's brightness on the directions of the lamps.

    For each pixel, only those frames are used in which its level relative to `peak` is in STEREO_LEVELS.

    Args:
        frames: yields (number of a lamp, its frame (P,3) uint8 sRGB).
        stage: with the lamps.
        points: (P,3) of the pixels' surface, in the stage's frame.
        peak: (P,) the largest mean of the channels in any frame, with the falloff removed.
    """
    count = len(points)
    moments = np.zeros((count, 3, 3))  # sum of w w^T over the frames that are used, w the direction of the lamp
    responses = np.zeros((count, 3, 3))  # sum of w I^T, I the color in a frame
    used = np.zeros(count, int)
    for lamp, codes in frames():
        lit_pixels = np.flatnonzero(codes.any(1))
        directions, _, falloff = stage.lamp_seen_from(lamp, points[lit_pixels])
        linear = LINEAR[codes[lit_pixels]] / falloff[:, None]
        level = linear.mean(1) / peak[lit_pixels]
        selected = np.flatnonzero((level > STEREO_LEVELS[0]) & (level < STEREO_LEVELS[1]))
        lit_pixels, directions, linear = lit_pixels[selected], directions[selected], linear[selected]
        moments[lit_pixels] += np.einsum("pi,pj->pij", directions, directions)
        responses[lit_pixels] += np.einsum("pi,pc->pic", directions, linear)
        used[lit_pixels] += 1
    least = np.linalg.eigvalsh(moments)[:, 0]  # small if all directions lie in a plane, which leaves n undetermined
    trace = np.einsum("pii->p", moments)
    known = (used >= MIN_FRAMES) & (least > MIN_EIGENVALUE * np.maximum(trace, 1e-12))
    solvable = np.where(known[:, None, None], moments, np.eye(3))
    # The normal is the direction of the grey a n that fits I = a n.w best; with it, the albedo a fits each channel.
    normal = np.linalg.solve(solvable, responses.mean(2)[..., None])[..., 0]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    square = np.maximum(np.einsum("pi,pij,pj->p", normal, solvable, normal), 1e-12)[:, None]
    albedo = np.maximum(np.einsum("pi,pic->pc", normal, responses) / square, 0) * known[:, None]
    return Stereo(known, normal, albedo)
