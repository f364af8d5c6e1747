"""Data augmentation that makes relit images look like photographs.

Each image gets its own random parameters when it is relit. Framing, albedo and white balance change the image and its
ground truth; camera and mask change the image alone. The exposure is stored in `Batch.exposure` and not applied to the
ground truth: otherwise bright images would weigh more in the losses.
"""

import math
from dataclasses import replace

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from relight.learning.camera import Camera, simulate_camera
from relight.learning.color import shade
from relight.learning.data import Batch, compact_index
from relight.learning.harmonics import unoccluded
from relight.maps.square import extent
from relight.settings import NO_AUGMENTATION, Augment

FIGURE_SHARE = 0.9  # larger side of a figure's bounding box over the image's side (docs/conventions.md)
CUT_SHARE = 0.5  # of the pictures with a new framing, which end between chest and knees
ZOOM = (0.75, 1.15)  # range of the size of the figure, as a factor on the usual framing
SHIFT = 0.05  # largest shift of the figure's box from the centre, as a share of the side
CUT_HEIGHT = (0.4, 0.85)  # range of the share of a figure's height that a cut leaves
SIDE_CUT_SHARE = 0.25  # of these pictures, which also end at the left or right of the figure
CUT_WIDTH = (0.6, 0.95)  # range of the share of its width that this leaves
# ln(R/G) of a white balance for each ln(B/G): about the Planckian locus between 2,500 and 8,000 K in sRGB.
RED_PER_BLUE = -0.6
SKIN_RATIOS = ((1.12, 2.2), (1.02, 2.2))  # ranges of R/G and G/B of skin, which keeps its color
ALBEDO_SPREAD = 0.5  # standard deviation of ln albedo within one garment
PRINT_BEND = 0.03  # shift of a print across a surface that turns by 90 degrees, as a share of the image's side
PRINT_PERIOD = (0.012, 0.2)  # range of a print's period, as a share of the image's side
ROUGHNESS_RANGE = (0.25, 0.7)  # of glossy materials: the square root of GGX's alpha
SPECULAR_STRENGTH = (0.2, 1.5)  # of their reflectance at normal incidence, over 4 %
CAMERA = Camera(tone=0.25, blur=0.8, sharpen=0.8, noise=0.02, jpeg=0.4)  # at full strength
MAX_WEAR = 1.5  # largest factor, and its inverse the smallest, on roughness and reflectance of known materials


def augment_batch(batch: Batch, settings: Augment, generators: list[np.random.Generator], size: int) -> Batch:
    """Returns an augmented batch.

    Args:
        batch: relit images of the color model `photo`, at exposure 1.
        settings: strength of each part; with all at 0 and the batch's own size the batch is returned unchanged.
        generators: one per image, so that an image does not depend on its neighbours in the batch.
        size: side of the new images in pixels, at most `batch.size`.

    Returns:
        A batch of the same pairs at `size`. Its `light`, `shading` and `relit` are those before exposure.
    """
    if settings == NO_AUGMENTATION and size == batch.size:
        return batch
    batch = _recolored(batch, settings, generators)
    batch = _white_balanced(batch, settings, generators)
    names = ("albedo", "transport", "normal", "ao", "shading")
    maps = [getattr(batch, name) for name in names]
    channels = [x.shape[-1] for x in maps]
    if settings.gloss:
        maps.append(_specular_highlights(batch, settings, generators))
    dense, mask = batch.scatter(torch.cat(maps, -1)), batch.mask
    dense, mask = _reframed(dense, mask, settings, generators, size)
    input_mask = _perturbed_masks(mask, settings, generators)
    low, high = settings.exposure
    stops = [rng.uniform(low, high) for rng in generators]
    exposure = torch.tensor([2.0**stop for stop in stops], device=mask.device)
    dense, highlights = dense.split([sum(channels), dense.shape[1] - sum(channels)], 1)
    resampled = dict(zip(names, dense.split(channels, 1)))
    scene = resampled["albedo"] * resampled["shading"]
    if settings.gloss:
        scene = scene + highlights
    scene = scene * exposure[:, None, None, None]
    camera = Camera(*(settings.camera * value for value in vars(CAMERA).values()))
    image = simulate_camera(_over_random_background(scene, mask, generators), camera, generators) * input_mask
    index = compact_index(mask * input_mask > 0)
    truth = dict(zip(names, index.gather(dense).split(channels, -1)))
    truth["normal"] = F.normalize(truth["normal"], dim=-1) * index.inside
    return replace(
        batch,
        image=image,
        mask=input_mask,
        **truth,
        gloss=None,  # the image contains the highlights already
        relit=truth["albedo"] * truth["shading"],
        exposure=exposure,
        **vars(index),
        size=size,
        mask_pixels=float(index.inside.sum()),
    )


def _recolored(batch: Batch, settings: Augment, generators: list[np.random.Generator]) -> Batch:
    """Shifts ln albedo, which gives garments another color or a print and keeps their texture.

    Pixels whose linear albedo is close to that of a random pixel count as one garment.
    """
    albedo, normal = batch.albedo.clone(), batch.normal
    for i, rng in enumerate(generators):
        pixels = albedo[i]
        count = int(batch.inside[i].sum())
        if rng.random() < settings.recolor:
            for chosen in rng.integers(0, count, rng.integers(1, 4)):
                pixels = _shifted_albedo(pixels, pixels[chosen], _sample_dye(rng))
        if rng.random() < settings.prints:
            pixel = batch.pixel.view(len(generators), -1)[i]
            column, row = pixel % batch.size, pixel // batch.size % batch.size
            positions = torch.stack([column, row], -1) / batch.size + PRINT_BEND * normal[i, :, :2]
            for chosen in rng.integers(0, count, rng.integers(1, 3)):
                pixels = _shifted_albedo(pixels, pixels[chosen], _sample_dye(rng), _print_pattern(positions, rng))
        albedo[i] = pixels * batch.inside[i]
    return replace(batch, albedo=albedo)


def _shifted_albedo(albedo: Tensor, color: Tensor, dye: np.ndarray, strength: Tensor | float = 1.0) -> Tensor:
    """Returns an albedo whose pixels of about one color are shifted to another; skin keeps its color.

    `color` (3,) is the albedo of the garment, and `dye` (3,) the one that it gets; both are linear, as `albedo` (P,3).
    `strength` is the share of the shift in [0,1], a number or (P,1).
    """
    color = color.clamp_min(0.02)
    red, blue = float(color[0] / color[1]), float(color[1] / color[2])
    if SKIN_RATIOS[0][0] < red < SKIN_RATIOS[0][1] and SKIN_RATIOS[1][0] < blue < SKIN_RATIOS[1][1]:
        return albedo
    weight = strength * _color_similarity(albedo, color)
    return (albedo * (albedo.new_tensor(dye) / color) ** weight).clamp(0.004, 0.95)


def _print_pattern(positions: Tensor, rng: np.random.Generator) -> Tensor:
    """Returns the ink (P,1) in [0,1] of a random print (stripes, checks, dots or blots) at `positions` (P,2)."""
    period, angle, phase = np.exp(rng.uniform(*np.log(PRINT_PERIOD))), rng.uniform(0, math.pi), rng.uniform(0, 1, 2)
    turn = positions.new_tensor([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    waves = torch.cos(2 * math.pi * (positions @ turn / period + positions.new_tensor(phase)))
    kind = rng.integers(4)
    if kind == 0:
        height = waves[:, :1]
    elif kind == 1:
        height = waves[:, :1] * waves[:, 1:]
    elif kind == 2:
        height = waves.sum(-1, keepdim=True) - 1
    else:
        cells = math.ceil(2 / period)
        field = positions.new_tensor(rng.normal(size=(1, 1, cells, cells)))
        height = F.grid_sample(field, (2 * positions - 1)[None, None], align_corners=False)[0, 0, 0, :, None] - 0.3
    return torch.sigmoid(rng.uniform(2, 30) * (height - rng.uniform(-0.4, 0.4)))


def _sample_dye(rng: np.random.Generator) -> np.ndarray:
    """Draws a linear albedo (3,) of cloth: a quarter nearly black, a quarter nearly white, the rest of any hue."""
    kind = rng.random()
    if kind < 0.25:
        return rng.uniform(0.015, 0.05) * np.exp(rng.normal(0, 0.1, 3))
    if kind < 0.5:
        return rng.uniform(0.45, 0.85) * np.exp(rng.normal(0, 0.06, 3))
    saturation, hue = rng.uniform(0.1, 1.0), rng.uniform(0, 2 * math.pi)
    angles = hue + np.array([0, 2, 4]) * math.pi / 3
    return np.exp(rng.uniform(math.log(0.05), math.log(0.5))) * np.exp(saturation * np.cos(angles))


def _specular_highlights(batch: Batch, settings: Augment, generators: list[np.random.Generator]) -> Tensor:
    """Returns the specular reflection (B,P,3) of glossy materials, in the unit of relit images.

    Roughness and specular come from the maps and are varied at random; where the maps have none, pixels whose color is
    close to that of a random pixel get a random material. The batch is at exposure 1.
    """
    # The share of the light that arrives: highlights are occluded, too.
    visibility = (batch.shading / shade(unoccluded(batch.normal, 2), batch.light[:, :9]).clamp_min(1e-3)).clamp(0, 1)
    reflected = torch.zeros_like(batch.albedo)
    for i, rng in enumerate(generators):
        if rng.random() >= settings.gloss:
            continue
        if batch.gloss is not None:
            roughness_factor, specular_factor = MAX_WEAR ** rng.uniform(-1, 1, 2)
            roughness, specular = batch.gloss[i].split(1, -1)
            light = specular_reflection(
                batch.normal[i], batch.light[i], (roughness_factor * roughness).clamp(0.05, 1), 0.04
            )
            reflected[i] = specular_factor * specular * light * visibility[i]
            continue
        for chosen in rng.integers(0, int(batch.inside[i].sum()), rng.integers(1, 4)):
            similarity = _color_similarity(batch.albedo[i], batch.albedo[i, chosen].clamp_min(0.02))
            roughness, strength = rng.uniform(*ROUGHNESS_RANGE), rng.uniform(*SPECULAR_STRENGTH)
            light = specular_reflection(batch.normal[i], batch.light[i], roughness, 0.04 * strength)
            reflected[i] += similarity * (light * visibility[i] - reflected[i])
    return reflected * batch.inside


def specular_reflection(normal: Tensor, light: Tensor, roughness: float | Tensor, reflectance: float) -> Tensor:
    """Returns the radiance that a dielectric surface reflects toward an orthographic camera, times pi as in all images.

    Band 1 of the light is replaced by a directional light (Sloan 2008, Stupid Spherical Harmonics Tricks), which GGX
    microfacets with Smith's shadowing reflect (Walter et al. 2007); band 0 by uniform light from all directions.

    Args:
        normal: (P,3) unit, camera frame.
        light: (K,3) coefficients, K at least 4.
        roughness: the square root of GGX's alpha, a number or (P,1).
        reflectance: at normal incidence; Schlick's approximation gives it at other angles.

    Returns:
        (P,3), not negative; zero where the surface faces away from the camera.
    """
    linear = light[[3, 1, 2]]  # x, y, z
    to_light = F.normalize(linear.sum(1), dim=0)
    irradiance = (linear.T @ to_light).clamp_min(0) / math.sqrt(3 / (4 * math.pi))
    half = F.normalize(to_light + to_light.new_tensor([0.0, 0.0, 1.0]), dim=0)
    alpha2 = roughness**4
    cos_view, cos_light = normal[:, 2:].clamp_min(0), (normal @ to_light)[:, None].clamp_min(0)
    distribution = alpha2 / (math.pi * (1 - (1 - alpha2) * (normal @ half)[:, None].clamp(0, 1) ** 2) ** 2)
    smith = (
        cos_view * (alpha2 + (1 - alpha2) * cos_light**2).sqrt()
        + cos_light * (alpha2 + (1 - alpha2) * cos_view**2).sqrt()
    )
    directional = distribution * cos_light / (2 * smith).clamp_min(1e-6) * _schlick(half[2], reflectance) * irradiance
    uniform = _schlick(cos_view, reflectance) * light[0].clamp_min(0) / math.sqrt(4 * math.pi)
    return math.pi * (directional + uniform) * (cos_view > 0)


def _schlick(cosine: Tensor, reflectance: float) -> Tensor:
    """Returns Fresnel reflectance by the angle of incidence, given that at normal incidence (Schlick 1994)."""
    return reflectance + (1 - reflectance) * (1 - cosine) ** 5


def _color_similarity(albedo: Tensor, color: Tensor) -> Tensor:
    """Returns the similarity (P,1) of the pixels of an albedo (P,3) to `color` (3,), 1 where they are equal."""
    distance = ((albedo.clamp_min(0.02) / color).log() ** 2).sum(-1, keepdim=True)
    return torch.exp(-distance / (2 * ALBEDO_SPREAD**2))


def _white_balanced(batch: Batch, settings: Augment, generators: list[np.random.Generator]) -> Batch:
    """Returns the batch with a random white balance of light and shading; the largest gain is 1.

    `settings.tint` is the standard deviation of ln(B/G).
    """
    if not settings.tint:
        return batch
    blue = np.array([rng.normal(0, settings.tint) for rng in generators])
    red = RED_PER_BLUE * blue + np.array([rng.normal(0, settings.tint / 5) for rng in generators])
    gains = np.exp(np.stack([red, np.zeros_like(red), blue], 1))
    gains = batch.light.new_tensor(gains / gains.max(1, keepdims=True))[:, None]
    return replace(batch, light=batch.light * gains, shading=batch.shading * gains)


def _reframed(
    maps: Tensor, mask: Tensor, settings: Augment, generators: list[np.random.Generator], size: int
) -> tuple[Tensor, Tensor]:
    """Resamples maps and masks into new squares, with a random framing; cuts some figures.

    Interpolation is bilinear over the pixels inside the mask: at half the size and with unchanged framing, it is the
    mean of four pixels. From maps (B,C,S,S) and a mask (B,1,S,S) of 0 and 1, it returns maps (B,C,size,size), zero
    outside the mask, and a mask (B,1,size,size) of 0 and 1.
    """
    side, mask = mask.shape[-1], mask.clone()
    affine = torch.zeros(len(mask), 2, 3)  # from the new square to the old one, both from -1 to 1: scale and centre
    for i, rng in enumerate(generators):
        affine[i, 0, 0] = affine[i, 1, 1] = 1
        if rng.random() >= settings.framing:
            continue
        if rng.random() < CUT_SHARE:
            cut_figure(mask[i], rng)
        (top, bottom), (left, right) = extent(mask[i, 0].cpu().numpy())
        zoom = math.exp(rng.uniform(*np.log(ZOOM)))
        scale = max(bottom - top, right - left) / (FIGURE_SHARE * zoom * side)
        centre = np.array([(left + right) / 2, (top + bottom) / 2]) / side * 2 - 1
        shift = rng.uniform(-SHIFT, SHIFT, 2) * 2 * scale
        affine[i, 0, 0] = affine[i, 1, 1] = scale
        affine[i, :, 2] = torch.from_numpy(centre + shift)
    grid = F.affine_grid(affine, [len(mask), 1, size, size], align_corners=False).to(maps.device)
    share = F.grid_sample(mask, grid, align_corners=False)
    inside = (share >= 0.5).float()
    inside[..., 0, 0] = 0  # the padding of compact maps needs a pixel outside
    maps = F.grid_sample(maps * mask, grid, align_corners=False) / share.clamp_min(0.5)
    return maps * inside, inside


def cut_figure(mask: Tensor, rng: np.random.Generator) -> None:
    """Cuts a mask (1,S,S) in place as the edge of a photograph does: below, and in a quarter also at one side."""
    (top, bottom), _ = extent(mask[0].cpu().numpy())
    mask[:, top + math.ceil(rng.uniform(*CUT_HEIGHT) * (bottom - top)) :] = 0
    left, right = extent(mask[0].cpu().numpy())[1]
    if rng.random() < SIDE_CUT_SHARE:
        width = math.ceil(rng.uniform(*CUT_WIDTH) * (right - left))
        if rng.random() < 0.5:
            mask[..., left + width :] = 0
        else:
            mask[..., : right - width] = 0


def _perturbed_masks(mask: Tensor, settings: Augment, generators: list[np.random.Generator]) -> Tensor:
    """Dilates or erodes masks by random amounts that vary along the outline.

    Masks are (B,1,S,S) of 0 and 1, and `settings.mask` is the largest amount in pixels. The pixel at the top left is
    outside afterwards, as compact maps need.
    """
    radius = settings.mask
    if not radius:
        return mask
    fields = []
    for rng in generators:
        mean, variation = rng.uniform(-radius, radius), rng.uniform(0, radius / 2)
        fields.append(mean + variation * rng.normal(size=(8, 8)))
    offset = F.interpolate(
        mask.new_tensor(np.stack(fields))[:, None], mask.shape[-2:], mode="bilinear", align_corners=False
    ).clamp(-radius, radius)
    dilated = eroded = out = mask
    for step in range(1, radius + 1):
        dilated, eroded = F.max_pool2d(dilated, 3, 1, 1), 1 - F.max_pool2d(1 - eroded, 3, 1, 1)
        out = torch.where(offset >= step - 0.5, dilated, torch.where(offset <= 0.5 - step, eroded, out))
    out[..., 0, 0] = 0
    return out


def _over_random_background(scene: Tensor, mask: Tensor, generators: list[np.random.Generator]) -> Tensor:
    """Fills linear radiance (B,3,S,S) with random colors where the mask (B,1,S,S) is 0.

    The colors vary smoothly over a grid of 1, 4 or 16 cells a side. `generators` holds one for each image.
    """
    size = scene.shape[-1]
    fields = []
    for rng in generators:
        grain = int(rng.choice([1, 4, 16]))
        field = scene.new_tensor(np.exp(rng.uniform(-3, 0)) * np.exp(0.6 * rng.normal(size=(1, 3, grain, grain))))
        fields.append(F.interpolate(field, (size, size), mode="bilinear", align_corners=False))
    return torch.where(mask > 0, scene, torch.cat(fields))
