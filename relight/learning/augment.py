"""Data augmentation that makes relit images look like photographs.

All parts are drawn anew for each image while it is relit. Framing, new albedo and white balance change the image and
its ground truth; camera and mask change the image alone. The exposure is kept apart in `Batch.exposure`: the ground
truth is that of the light before it, so that bright images do not weigh more in the losses.
"""

import math
from dataclasses import replace

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from relight.config import STRENGTHS, Augment
from relight.learning.camera import decode, encode, photograph, shade
from relight.learning.data import Batch, index_of
from relight.learning.harmonics import unoccluded

FRAME = 0.9  # larger side of a figure's bounding box over the image's side (docs/conventions.md)
CUT = (0.4, 0.85)  # share of a figure's height that a cut leaves
RED = -0.6  # ln(R/G) of a white balance for each ln(B/G): about the Planckian locus between 2,500 and 8,000 K in sRGB
SKIN = ((1.12, 2.2), (1.02, 2.2))  # ranges of R/G and G/B of skin, which keeps its colour
SPREAD = 0.5  # standard deviation of ln albedo within one garment
PRINT_BEND = 0.03  # shift of a print across a surface that turns by 90 degrees, as a share of the image's side
PERIOD = (0.012, 0.2)  # of a print, as a share of the image's side
ROUGHNESS = (0.25, 0.7)  # of glossy materials, the square root of GGX's alpha
STRENGTH = (0.2, 1.5)  # of their reflection, over that of a reflectance of 4 % at right angles
WEAR = 1.5  # factor up to which the roughness and reflection of known materials vary, each way
QUALITY = (40, 95)  # of JPEG

# Quantisation tables of JPEG's Annex K, for luminance and chrominance.
_LUMA = (
    "16 11 10 16 24 40 51 61 12 12 14 19 26 58 60 55 14 13 16 24 40 57 69 56 14 17 22 29 51 87 80 62 "
    "18 22 37 56 68 109 103 77 24 35 55 64 81 104 113 92 49 64 78 87 103 121 120 101 72 92 95 98 112 100 103 99"
)
_CHROMA = "17 18 24 47 99 99 99 99 18 21 26 66 99 99 99 99 24 26 56 99 99 99 99 99 47 66 99 99 99 99 99 99 " + " ".join(
    ["99"] * 32
)
_TABLES = torch.tensor([[float(n) for n in table.split()] for table in (_LUMA, _CHROMA, _CHROMA)]).view(3, 8, 8)
_YCC = torch.tensor([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]])


def augmented(batch: Batch, settings: Augment, generators: list[np.random.Generator], size: int) -> Batch:
    """Augments a batch.

    Args:
        batch: relit images of the colour model `photo`, at exposure 1.
        settings: strength of each part; with all at 0 and the batch's own size the batch is returned unchanged.
        generators: one per image, so that an image does not depend on its neighbours in the batch.
        size: of the new images in pixels, at most the batch's.

    Returns:
        A batch of the same pairs, of the size asked for. Its `light`, `shading` and `relit` are those before exposure.
    """
    if is_off(settings) and size == batch.size:
        return batch
    batch = _recoloured(batch, settings, generators)
    batch = _tinted(batch, settings, generators)
    truth = [batch.albedo, batch.transport, batch.normal, batch.ao, batch.shading]
    widths = [x.shape[-1] for x in truth]
    if settings.gloss:
        truth.append(_highlights(batch, settings, generators))
    dense, mask = batch.put(torch.cat(truth, -1)), batch.mask
    dense, mask = _framed(dense, mask, settings, generators, size)
    seen = _inexact(mask, settings, generators)
    least, most = settings.exposure
    stops = [rng.uniform(least, most) for rng in generators]
    exposure = torch.tensor([2.0**stop for stop in stops], device=mask.device)
    dense, highlights = dense.split([sum(widths), dense.shape[1] - sum(widths)], 1)
    scene = dense[:, : widths[0]] * dense[:, -widths[-1] :]
    if settings.gloss:
        scene = scene + highlights
    scene = scene * exposure[:, None, None, None]
    image = developed(_before_background(scene, mask, generators), settings, generators) * seen
    index = index_of(mask * seen > 0)
    albedo, transport, normal, ao, shading = index.take(dense).split(widths, -1)
    return replace(
        batch,
        image=image,
        mask=seen,
        albedo=albedo,
        transport=transport,
        normal=F.normalize(normal, dim=-1) * index.inside,
        ao=ao,
        gloss=None,  # it is in the picture by now
        shading=shading,
        relit=albedo * shading,
        exposure=exposure,
        inside=index.inside,
        interior=index.interior,
        pixel=index.pixel,
        below=index.below,
        size=size,
        scope=float(index.inside.sum()),
    )


def is_off(settings: Augment) -> bool:
    """Whether the settings leave every image as it is."""
    return not any([*(getattr(settings, name) for name in STRENGTHS), *settings.exposure])


def _recoloured(batch: Batch, settings: Augment, generators: list[np.random.Generator]) -> Batch:
    """Gives garments another colour or a print and keeps their texture, by shifts of ln albedo.

    A garment is what has about the colour of a random pixel.
    """
    albedo, normal = batch.albedo.clone(), batch.normal
    for i, rng in enumerate(generators):
        own = albedo[i]
        count = int(batch.inside[i].sum())
        if rng.random() < settings.recolour:
            for place in rng.integers(0, count, rng.integers(1, 4)):
                own = _dyed(own, own[place], _dye(rng))
        if rng.random() < settings.prints:
            pixel = batch.pixel.view(len(generators), -1)[i]
            across, down = pixel % batch.size, pixel // batch.size % batch.size
            places = torch.stack([across, down], -1) / batch.size + PRINT_BEND * normal[i, :, :2]
            for place in rng.integers(0, count, rng.integers(1, 3)):
                own = _dyed(own, own[place], _dye(rng), _print(places, rng))
        albedo[i] = own * batch.inside[i]
    return replace(batch, albedo=albedo)


def _dyed(albedo: Tensor, colour: Tensor, dye: np.ndarray, strength: Tensor | float = 1.0) -> Tensor:
    """Shifts the pixels of an albedo (P,3) that look like `colour` (3,) toward `dye` (3,), by `strength` (P,1).

    Where `colour` is that of skin, the albedo is returned unchanged.
    """
    colour = colour.clamp_min(0.02)
    red, blue = float(colour[0] / colour[1]), float(colour[1] / colour[2])
    if SKIN[0][0] < red < SKIN[0][1] and SKIN[1][0] < blue < SKIN[1][1]:
        return albedo
    weight = strength * _resemblance(albedo, colour)
    return (albedo * (albedo.new_tensor(dye) / colour) ** weight).clamp(0.004, 0.95)


def _print(places: Tensor, rng: np.random.Generator) -> Tensor:
    """The amount of ink (P,1) in [0,1] of a random print of stripes, checks, dots or blots at `places` (P,2)."""
    period, angle, phase = np.exp(rng.uniform(*np.log(PERIOD))), rng.uniform(0, math.pi), rng.uniform(0, 1, 2)
    turn = places.new_tensor([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    waves = torch.cos(2 * math.pi * (places @ turn / period + places.new_tensor(phase)))
    kind = rng.integers(4)
    if kind == 0:
        height = waves[:, :1]
    elif kind == 1:
        height = waves[:, :1] * waves[:, 1:]
    elif kind == 2:
        height = waves.sum(-1, keepdim=True) - 1
    else:
        cells = math.ceil(2 / period)
        field = places.new_tensor(rng.normal(size=(1, 1, cells, cells)))
        height = F.grid_sample(field, (2 * places - 1)[None, None], align_corners=False)[0, 0, 0, :, None] - 0.3
    return torch.sigmoid(rng.uniform(2, 30) * (height - rng.uniform(-0.4, 0.4)))


def _dye(rng: np.random.Generator) -> np.ndarray:
    """A random linear albedo (3,) of cloth: a quarter nearly black, a quarter nearly white, the rest of any hue."""
    kind = rng.random()
    if kind < 0.25:
        return rng.uniform(0.015, 0.05) * np.exp(rng.normal(0, 0.1, 3))
    if kind < 0.5:
        return rng.uniform(0.45, 0.85) * np.exp(rng.normal(0, 0.06, 3))
    saturation, hue = rng.uniform(0.1, 1.0), rng.uniform(0, 2 * math.pi)
    angles = hue + np.array([0, 2, 4]) * math.pi / 3
    return np.exp(rng.uniform(math.log(0.05), math.log(0.5))) * np.exp(saturation * np.cos(angles))


def _highlights(batch: Batch, settings: Augment, generators: list[np.random.Generator]) -> Tensor:
    """What glossy materials reflect (B,P,3), in the unit of relit images; the albedo explains none of it.

    Materials are those of the maps, more or less worn and wet; in maps that hold none, a material is what has about the
    colour of a random pixel.
    """
    cosine = (batch.shading / shade(unoccluded(batch.normal, 2), batch.light[:, :9]).clamp_min(1e-3)).clamp(0, 1)
    out = torch.zeros_like(batch.albedo)
    for i, rng in enumerate(generators):
        if rng.random() >= settings.gloss:
            continue
        if batch.gloss is not None:
            rougher, stronger = WEAR ** rng.uniform(-1, 1, 2)
            roughness, specular = batch.gloss[i].split(1, -1)
            light = reflection(batch.normal[i], batch.light[i], (rougher * roughness).clamp(0.05, 1), 0.04)
            out[i] = stronger * specular * light * cosine[i]
            continue
        for place in rng.integers(0, int(batch.inside[i].sum()), rng.integers(1, 4)):
            seen = _resemblance(batch.albedo[i], batch.albedo[i, place].clamp_min(0.02))
            roughness, strength = rng.uniform(*ROUGHNESS), rng.uniform(*STRENGTH)
            light = reflection(batch.normal[i], batch.light[i], roughness, 0.04 * strength)
            out[i] += seen * (light * cosine[i] - out[i])
    return out * batch.inside


def reflection(normal: Tensor, light: Tensor, roughness: float | Tensor, reflectance: float) -> Tensor:
    """Light that a clear surface reflects toward an orthographic camera, times pi as all images are.

    The linear band of the light is taken for a lamp in its direction (Sloan 2008, Stupid Spherical Harmonics Tricks),
    reflected by GGX's microfacets with Smith's shadowing (Walter et al. 2007), and band 0 for light from everywhere.

    Args:
        normal: (P,3) unit, camera frame.
        light: (K,3) coefficients, K at least 4.
        roughness: the square root of GGX's alpha, one or (P,1).
        reflectance: at right angles (Schlick's approximation tells that at others).

    Returns:
        (P,3), not negative; zero where the surface looks away from the camera.
    """
    linear = light[[3, 1, 2]]  # x, y, z
    lamp = F.normalize(linear.sum(1), dim=0)
    irradiance = (linear.T @ lamp).clamp_min(0) / math.sqrt(3 / (4 * math.pi))
    half = F.normalize(lamp + lamp.new_tensor([0.0, 0.0, 1.0]), dim=0)
    alpha2 = roughness**4
    to_eye, to_lamp = normal[:, 2:].clamp_min(0), (normal @ lamp)[:, None].clamp_min(0)
    lobe = alpha2 / (math.pi * (1 - (1 - alpha2) * (normal @ half)[:, None].clamp(0, 1) ** 2) ** 2)
    smith = to_eye * (alpha2 + (1 - alpha2) * to_lamp**2).sqrt() + to_lamp * (alpha2 + (1 - alpha2) * to_eye**2).sqrt()
    mirrored = lobe * to_lamp / (2 * smith).clamp_min(1e-6) * _schlick(half[2], reflectance) * irradiance
    everywhere = _schlick(to_eye, reflectance) * light[0].clamp_min(0) / math.sqrt(4 * math.pi)
    return math.pi * (mirrored + everywhere) * (to_eye > 0)


def _schlick(cosine: Tensor, reflectance: float) -> Tensor:
    return reflectance + (1 - reflectance) * (1 - cosine) ** 5


def _resemblance(albedo: Tensor, colour: Tensor) -> Tensor:
    """How much pixels of an albedo (P,3) look like `colour` (3,): (P,1), 1 where they are the same."""
    distance = ((albedo.clamp_min(0.02) / colour).log() ** 2).sum(-1, keepdim=True)
    return torch.exp(-distance / (2 * SPREAD**2))


def _tinted(batch: Batch, settings: Augment, generators: list[np.random.Generator]) -> Batch:
    """Changes the white balance of light and shading; the largest gain is 1."""
    if not settings.tint:
        return batch
    blue = np.array([rng.normal(0, settings.tint) for rng in generators])
    red = RED * blue + np.array([rng.normal(0, settings.tint / 5) for rng in generators])
    gains = np.exp(np.stack([red, np.zeros_like(red), blue], 1))
    gains = batch.light.new_tensor(gains / gains.max(1, keepdims=True))[:, None]
    return replace(batch, light=batch.light * gains, shading=batch.shading * gains)


def _framed(
    maps: Tensor, mask: Tensor, settings: Augment, generators: list[np.random.Generator], size: int
) -> tuple[Tensor, Tensor]:
    """Resamples maps (B,C,S,S) and mask (B,1,S,S) into new squares of `size` pixels, some with figures that are cut.

    Bilinear over the pixels inside the mask; at half the size and unchanged framing that is the mean of four pixels.
    """
    side, mask = mask.shape[-1], mask.clone()
    squares = torch.zeros(len(mask), 2, 3)
    for i, rng in enumerate(generators):
        squares[i, 0, 0] = squares[i, 1, 1] = 1
        if rng.random() >= settings.framing:
            continue
        if rng.random() < settings.cut:
            top, bottom, left, right = _box(mask[i, 0])
            mask[i, :, top + math.ceil(rng.uniform(*CUT) * (bottom - top)) :] = 0
            if rng.random() < 0.25:  # at a side of the photograph, too
                width = math.ceil(rng.uniform(0.6, 0.95) * (right - left))
                mask[i, ..., *((slice(left + width, None),) if rng.random() < 0.5 else (slice(0, right - width),))] = 0
        top, bottom, left, right = _box(mask[i, 0])
        zoom = math.exp(rng.uniform(*np.log(settings.zoom)))
        scale = max(bottom - top, right - left) / (FRAME * zoom * side)  # of the old square in the new one
        centre = np.array([(left + right) / 2, (top + bottom) / 2]) / side * 2 - 1
        shift = rng.uniform(-settings.shift, settings.shift, 2) * 2 * scale
        squares[i, 0, 0] = squares[i, 1, 1] = scale
        squares[i, :, 2] = torch.from_numpy(centre + shift)
    grid = F.affine_grid(squares, [len(mask), 1, size, size], align_corners=False).to(maps.device)
    share = F.grid_sample(mask, grid, align_corners=False)
    inside = (share >= 0.5).float()
    inside[..., 0, 0] = 0  # the padding of compact maps needs a pixel outside
    maps = F.grid_sample(maps * mask, grid, align_corners=False) / share.clamp_min(0.5)
    return maps * inside, inside


def _box(mask: Tensor) -> tuple[int, int, int, int]:
    """Bounding box of what is not 0 in (S,S): first and end row, first and end column."""
    rows, columns = (torch.nonzero(mask.any(axis))[:, 0] for axis in (1, 0))
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def _inexact(mask: Tensor, settings: Augment, generators: list[np.random.Generator]) -> Tensor:
    """Dilates or erodes masks (B,1,S,S) by up to `settings.mask` pixels, by amounts that vary along the outline."""
    reach = settings.mask
    if not reach:
        return mask
    fields = []
    for rng in generators:
        mean, ripple = rng.uniform(-reach, reach), rng.uniform(0, reach / 2)
        fields.append(mean + ripple * rng.normal(size=(8, 8)))
    error = F.interpolate(
        mask.new_tensor(np.stack(fields))[:, None], mask.shape[-2:], mode="bilinear", align_corners=False
    ).clamp(-reach, reach)
    grown = thinned = mask
    out = mask
    for step in range(1, reach + 1):
        grown, thinned = F.max_pool2d(grown, 3, 1, 1), 1 - F.max_pool2d(1 - thinned, 3, 1, 1)
        out = torch.where(error >= step - 0.5, grown, torch.where(error <= 0.5 - step, thinned, out))
    out[..., 0, 0] = 0
    return out


def _before_background(scene: Tensor, mask: Tensor, generators: list[np.random.Generator]) -> Tensor:
    """Puts random colours behind linear radiance (B,3,S,S), where the mask (B,1,S,S) is 0."""
    size = scene.shape[-1]
    fields = []
    for rng in generators:
        grain = int(rng.choice([1, 4, 16]))
        fields.append(np.exp(rng.uniform(-3, 0)) * np.exp(0.6 * rng.normal(size=(3, grain, grain))))
    behind = torch.cat(
        [
            F.interpolate(scene.new_tensor(field)[None], (size, size), mode="bilinear", align_corners=False)
            for field in fields
        ]
    )
    return torch.where(mask > 0, scene, behind)


def developed(image: Tensor, settings: Augment, generators: list[np.random.Generator]) -> Tensor:
    """What a camera makes of linear values (B,3,S,S): blur, tone, sharpening, noise, JPEG; linear values of 8 bits.

    S must be a multiple of 8 where `settings.jpeg` is not 0; `generators`: one for each picture.
    """
    image = torch.cat([_blurred(one[None], rng.uniform(0, settings.blur)) for one, rng in zip(image, generators)])
    coded = encode(image.clamp(0, 1))
    pictures = []
    for one, rng in zip(coded, generators):
        one = _toned(one, settings.tone, rng)
        one = one + rng.uniform(0, settings.sharpen) * (one - _blurred(one[None], 1.0)[0])
        source = torch.Generator(one.device).manual_seed(int(rng.integers(2**62)))
        strength = rng.uniform(0, settings.noise)
        if strength:
            one = one + strength * torch.randn(one.shape, generator=source, device=one.device)
        one = one.clamp(0, 1)
        if rng.random() < settings.jpeg:
            one = compressed(one, int(rng.integers(*QUALITY)))
        pictures.append(one)
    return photograph(decode(torch.stack(pictures)), "photo")


def _toned(coded: Tensor, strength: float, rng: np.random.Generator) -> Tensor:
    """Applies a gamma, an S-curve and a saturation to coded values (3,S,S); monotone for strengths below 1."""
    if not strength:
        return coded
    coded = coded ** math.exp(rng.uniform(-strength, strength))
    coded = coded - rng.uniform(-strength / 2, strength) * torch.sin(2 * math.pi * coded) / (2 * math.pi)
    grey = coded.mean(0, keepdim=True)
    return (grey + (coded - grey) * (1 + rng.uniform(-strength, strength))).clamp(0, 1)


def _blurred(image: Tensor, sigma: float) -> Tensor:
    """Blurs (B,3,S,S) by a Gaussian of `sigma` pixels; the border's pixels are repeated outside."""
    if sigma < 0.2:
        return image
    reach = math.ceil(3 * sigma)
    kernel = torch.exp(-(torch.arange(-reach, reach + 1, device=image.device) ** 2) / (2 * sigma**2))
    kernel = (kernel / kernel.sum()).expand(3, 1, 1, -1)
    image = F.conv2d(F.pad(image, (reach, reach, 0, 0), mode="replicate"), kernel, groups=3)
    return F.conv2d(F.pad(image, (0, 0, reach, reach), mode="replicate"), kernel.mT, groups=3)


def compressed(coded: Tensor, quality: int) -> Tensor:
    """Coded values after JPEG compression without chroma subsampling (ITU-T T.81).

    Args:
        coded: (3,S,S) in [0,1]; S is a multiple of 8.
        quality: 1 to 100; scales the quantisation tables of Annex K as libjpeg does.
    """
    scale = 50 / quality if quality < 50 else 2 - quality / 50
    tables = (_TABLES.to(coded.device) * scale).round().clamp(1, 255)
    k, n = torch.arange(8.0, device=coded.device)[:, None], torch.arange(8.0, device=coded.device)
    cosine = torch.cos(math.pi * (2 * n + 1) * k / 16) * torch.where(k == 0, math.sqrt(1 / 8), 0.5)
    matrix = _YCC.to(coded.device)
    size = coded.shape[-1]
    planes = torch.tensordot(matrix, coded * 255 - 128, 1)  # grey is 0 in all three planes
    blocks = planes.view(3, size // 8, 8, size // 8, 8).transpose(2, 3)
    spectrum = cosine @ blocks @ cosine.T
    tables = tables[:, None, None]
    blocks = cosine.T @ ((spectrum / tables).round() * tables) @ cosine
    planes = blocks.transpose(2, 3).reshape(3, size, size)
    return ((torch.tensordot(torch.linalg.inv(matrix), planes, 1) + 128) / 255).clamp(0, 1)
