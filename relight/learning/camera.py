"""Simulates a camera on linear pictures: blur, tone curve, sharpening, noise and JPEG compression."""

import math
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from relight.learning.color import decode, encode, photograph

JPEG_QUALITY = (40, 95)  # the end is excluded

# Quantisation tables of JPEG (ITU-T T.81, Annex K) for luminance and chrominance.
_LUMINANCE_TABLE = (
    "16 11 10 16 24 40 51 61 12 12 14 19 26 58 60 55 14 13 16 24 40 57 69 56 14 17 22 29 51 87 80 62 "
    "18 22 37 56 68 109 103 77 24 35 55 64 81 104 113 92 49 64 78 87 103 121 120 101 72 92 95 98 112 100 103 99"
)
_CHROMINANCE_TABLE = (
    "17 18 24 47 99 99 99 99 18 21 26 66 99 99 99 99 24 26 56 99 99 99 99 99 47 66 99 99 99 99 99 99 "
    + " ".join(["99"] * 32)
)
_QUANTISATION = torch.tensor(
    [[float(n) for n in table.split()] for table in (_LUMINANCE_TABLE, _CHROMINANCE_TABLE, _CHROMINANCE_TABLE)]
).view(3, 8, 8)
_RGB_TO_YCC = torch.tensor([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]])


@dataclass(frozen=True)
class Camera:
    """What a camera does to a picture.

    Attributes:
        tone: strength of the tone curve and of changes of saturation, below 1.
        blur: largest standard deviation of the blur, pixels.
        sharpen: largest weight of the unsharp mask.
        noise: largest standard deviation of the noise, of codes in [0,1].
        jpeg: share of the pictures that are compressed.
    """

    tone: float
    blur: float
    sharpen: float
    noise: float
    jpeg: float


def simulate_camera(image: Tensor, camera: Camera, generators: list[np.random.Generator]) -> Tensor:
    """Simulates a camera: blur, tone curve, sharpening, noise and JPEG compression.

    Args:
        image: (B,3,S,S) linear; S must be a multiple of 8 unless `camera.jpeg` is 0.
        camera: strength of each part.
        generators: one per image.

    Returns:
        (B,3,S,S), the linear values of 8-bit sRGB codes.
    """
    image = torch.cat([_blurred(picture[None], rng.uniform(0, camera.blur)) for picture, rng in zip(image, generators)])
    coded = encode(image.clamp(0, 1))
    pictures = []
    for picture, rng in zip(coded, generators):
        picture = _with_tone_curve(picture, camera.tone, rng)
        picture = picture + rng.uniform(0, camera.sharpen) * (picture - _blurred(picture[None], 1.0)[0])
        noise_generator = torch.Generator(picture.device).manual_seed(int(rng.integers(2**62)))
        if strength := rng.uniform(0, camera.noise):
            picture = picture + strength * torch.randn(picture.shape, generator=noise_generator, device=picture.device)
        picture = picture.clamp(0, 1)
        if rng.random() < camera.jpeg:
            picture = compress_jpeg(picture, int(rng.integers(*JPEG_QUALITY)))
        pictures.append(picture)
    return photograph(decode(torch.stack(pictures)), "photo")


def _with_tone_curve(coded: Tensor, strength: float, rng: np.random.Generator) -> Tensor:
    """Applies a random gamma, S-curve and saturation to an image.

    `coded` (3,S,S) has codes in [0,1]. With a strength below 1, the curve is monotone.
    """
    if not strength:
        return coded
    coded = coded ** math.exp(rng.uniform(-strength, strength))
    coded = coded - rng.uniform(-strength / 2, strength) * torch.sin(2 * math.pi * coded) / (2 * math.pi)
    grey = coded.mean(0, keepdim=True)
    return (grey + (coded - grey) * (1 + rng.uniform(-strength, strength))).clamp(0, 1)


def _blurred(image: Tensor, sigma: float) -> Tensor:
    """Blurs (B,3,S,S) by a Gaussian of `sigma` pixels; border pixels are replicated."""
    if sigma < 0.2:
        return image
    radius = math.ceil(3 * sigma)
    kernel = torch.exp(-(torch.arange(-radius, radius + 1, device=image.device) ** 2) / (2 * sigma**2))
    kernel = (kernel / kernel.sum()).expand(3, 1, 1, -1)
    image = F.conv2d(F.pad(image, (radius, radius, 0, 0), mode="replicate"), kernel, groups=3)
    return F.conv2d(F.pad(image, (0, 0, radius, radius), mode="replicate"), kernel.mT, groups=3)


def compress_jpeg(coded: Tensor, quality: int) -> Tensor:
    """Returns coded values after JPEG compression without chroma subsampling (ITU-T T.81).

    Args:
        coded: (3,S,S) in [0,1]; S is a multiple of 8.
        quality: 1 to 100; scales the quantisation tables of Annex K as libjpeg does.

    Returns:
        (3,S,S) in [0,1].
    """
    scale = 50 / quality if quality < 50 else 2 - quality / 50
    tables = (_QUANTISATION.to(coded.device) * scale).round().clamp(1, 255)
    k, n = torch.arange(8.0, device=coded.device)[:, None], torch.arange(8.0, device=coded.device)
    cosine = torch.cos(math.pi * (2 * n + 1) * k / 16) * torch.where(k == 0, math.sqrt(1 / 8), 0.5)
    matrix = _RGB_TO_YCC.to(coded.device)
    size = coded.shape[-1]
    planes = torch.tensordot(matrix, coded * 255 - 128, 1)  # grey is 0 in all three planes
    blocks = planes.view(3, size // 8, 8, size // 8, 8).transpose(2, 3)
    spectrum = cosine @ blocks @ cosine.T
    tables = tables[:, None, None]
    blocks = cosine.T @ ((spectrum / tables).round() * tables) @ cosine
    planes = blocks.transpose(2, 3).reshape(3, size, size)
    return ((torch.tensordot(torch.linalg.inv(matrix), planes, 1) + 128) / 255).clamp(0, 1)
