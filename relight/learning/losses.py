"""The fifteen L1 losses of the paper (section 4), two under another light, and four of detail for photographs.

They are computed on the pixels inside the masks. Outside, ground truth and masked outputs are both zero, so sums over
the masks are sums over the images. Let A, T, L be the ground truth, A^, T^, L^ the prediction, S = T.L and I = A*S.
Four of the seven reconstructions need no new map: |A*(T^.L) - I| = A*|T^.L - S|, the same for the other two shadings,
and |A^*S - I| = S*|A^ - A|.

All shadings and reconstructions of the paper have the light of the image, and a transport can fit that light at the
cost of others. The losses `relit` compare T^.L' and A^*(T^.L') with T.L' and A*(T.L') under L', the light of another
image of the batch.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor

from relight.config import Loss
from relight.extensions import extension
from relight.learning.camera import shade
from relight.learning.data import Batch
from relight.learning.networks import with_transport
from relight.sh import order_of

OCTAVES = 5  # of detail: structures of about 2 to 64 pixels
LEVEL = 0.05  # of the true map's root mean square: bounds the divisor where the true detail is weaker
DARK = 0.02  # lower bound of values whose ln is taken


def losses(outputs: dict[str, Tensor], batch: Batch, loss: Loss) -> dict[str, Tensor]:
    """Computes the losses whose weights are not zero.

    The name of a shading or reconstruction lists its inferred factors: `reconstruction_albedo_light` compares A^*(T.L^)
    with the image. A network that infers normals has the losses `normal` (and `ao`) instead of `transport`; its other
    losses use the transport that follows from its normals (and AO).

    Args:
        outputs: of the network, maps (B,C,S,S) and light (B,K,3).
        batch: the ground truth.
        loss: weights and reduction. Losses of weight 0 are skipped. The reduction is the mean over the channels and
            over all pixels, background included (`image`, the authors'), or over those of the masks (`mask`).

    Returns:
        Unweighted scalars by name.
    """
    order = order_of(batch.light.shape[1])
    maps = with_transport({k: batch.gather(v) for k, v in outputs.items() if k != "light"}, order)
    albedo, transport, light = maps["albedo"], maps["transport"], outputs["light"].float()
    if "normal" in maps:
        transport = transport * batch.inside  # zero normals of the padding have non-zero transport
    pixels = len(light) * batch.size**2 if loss.reduction == "image" else batch.mask_pixels
    values = {}

    def mean(error: Tensor) -> Tensor:
        return error.sum() / (pixels * error.shape[-1])

    def weighted(weight: Tensor, error: Tensor) -> Tensor:
        """Returns the mean of weight * error without storing the product."""
        return torch.dot(weight.flatten(), error.flatten()) / (pixels * error.shape[-1])

    albedo_error = (albedo - batch.albedo).abs()
    if loss.albedo:
        values["albedo"] = mean(albedo_error)
    if loss.transport:
        for name in ("transport", "normal", "ao"):
            if name in outputs:
                values[name] = mean((maps[name] - getattr(batch, name)).abs())
    if loss.light:
        values["light"] = F.l1_loss(light, batch.light)
    if loss.tv_albedo:
        values["tv_albedo"] = mean(variation(albedo, batch))
    if loss.tv_transport:
        values["tv_transport"] = mean(variation(transport, batch))

    shadings = {}
    if loss.shading or loss.reconstruction:
        shadings["transport"] = shade(transport, batch.light)
        shadings["light"] = shade(batch.transport, light)
    if loss.shading or loss.reconstruction or loss.reconstruction_full:
        shadings["transport_light"] = shade(transport, light)
    for name in ("albedo", "transport", "shading"):
        if getattr(loss, f"detail_{name}"):
            inferred = {"albedo": albedo, "transport": transport, "shading": shade(transport, batch.light)}[name]
            truth = getattr(batch, name)
            values[f"detail_{name}"] = detail(inferred - truth, truth, batch)
    if loss.exclusion:
        inferred_maps, true_maps = (albedo, shade(transport, batch.light)), (batch.albedo, batch.shading)
        values["exclusion"] = exclusion(inferred_maps, true_maps, batch)
    if loss.shading or loss.reconstruction:
        errors = {name: (shading - batch.shading).abs() for name, shading in shadings.items()}
    if loss.shading:
        values |= {f"shading_{name}": mean(error) for name, error in errors.items()}
    if loss.reconstruction:
        values |= {f"reconstruction_{name}": weighted(batch.albedo, error) for name, error in errors.items()}
        values["reconstruction_albedo"] = weighted(batch.shading, albedo_error)
        for name in ("transport", "light"):
            values[f"reconstruction_albedo_{name}"] = mean((albedo * shadings[name] - batch.relit).abs())
    if loss.reconstruction_full:
        values["reconstruction_full"] = mean((albedo * shadings["transport_light"] - batch.relit).abs())
    if loss.relit:
        other = batch.light.roll(1, 0) if batch.other_light is None else batch.other_light
        inferred, truth = shade(transport, other), shade(batch.transport, other)
        values["relit_shading"] = mean((inferred - truth).abs())
        values["relit_image"] = mean((albedo * inferred - batch.albedo * truth).abs())
    extra = {f"extra_{name}": extension(name, "loss")(outputs, batch) for name, weight in loss.extra.items() if weight}
    return values | extra


def variation(compact: Tensor, batch: Batch) -> Tensor:
    """Returns absolute forward differences |dx| + |dy| (B,P,C) in the mask eroded by one pixel, zero elsewhere."""
    right = (compact[:, 1:] - compact[:, :-1]).abs()
    below = compact.flatten(0, 1).index_select(0, batch.below).view_as(compact)
    return (F.pad(right, (0, 0, 0, 1)) + (below - compact).abs()) * batch.interior


def detail(error: Tensor, truth: Tensor, batch: Batch) -> Tensor:
    """Returns the energy of the error's detail over that of the true detail, as a mean over octaves and images.

    The squared error is minimal at the expected detail. The absolute error is minimal at the median, which is close to
    zero for folds that the picture leaves ambiguous.

    Args:
        error: inferred minus true values (B,P,C).
        truth: (B,P,C).
        batch: the batch of the compact maps.
    """
    level = LEVEL**2 * (truth**2).sum((1, 2))
    wrong, true = detail_energies(error, batch), detail_energies(truth, batch)
    return (wrong / (true + level).clamp_min(1e-9)).mean()


def detail_energies(compact: Tensor, batch: Batch) -> Tensor:
    """Returns the sums of squares (octaves,B) of the detail of maps (B,P,C), the finest octave first.

    What the means over small squares have beyond those over larger ones needs no difference: both have the same sums
    over a larger square, so the energy of their difference is the difference of their energies. These are added in
    double precision, since they may be nearly equal.
    """
    energies = [(compact**2).sum((1, 2), dtype=torch.float64)]
    weight = batch.scatter(batch.inside)
    sums = batch.scatter(compact)
    for _ in octave_range(batch):
        # Of 2^k x 2^k pixels; avg_pool2d with the divisor 1 adds.
        weight, sums = (F.avg_pool2d(x, 2, divisor_override=1) for x in (weight, sums))
        energies.append((sums**2 / weight.clamp_min(1)).sum((1, 2, 3), dtype=torch.float64))
    return torch.stack([finer - coarser for finer, coarser in pairwise(energies)]).clamp_min(0).to(compact.dtype)


def exclusion(inferred: tuple[Tensor, Tensor], truth: tuple[Tensor, Tensor], batch: Batch) -> Tensor:
    """Returns by how much the correlation of two inferred maps' detail exceeds that of the true maps.

    Correlation is mean |a s| over the root mean squares of a and s, the detail of the ln of the maps' channel means;
    excess is averaged over octaves and images. The idea is the exclusion loss of Zhang et al. 2018, Single Image
    Reflection Separation. With squared errors alone, an ambiguous edge appears in both maps; with this loss, in one.

    Args:
        inferred: two maps (B,P,C), here albedo and shading.
        truth: the true maps.
        batch: the batch of the compact maps.
    """
    maps = [x.mean(-1, keepdim=True).clamp_min(DARK).log() for x in (*inferred, *truth)]
    excess = []
    for images, weight in octaves(maps, batch):
        energy = torch.stack([(x**2 * weight).sum((1, 2, 3)) for x in images])
        energy[:2] += LEVEL**2 * energy[2:]
        shared = torch.stack([((a * s).abs() * weight).sum((1, 2, 3)) for a, s in (images[:2], images[2:])])
        inferred_correlation, true_correlation = shared / (energy[::2] * energy[1::2]).clamp_min(1e-12).sqrt()
        excess.append((inferred_correlation - true_correlation).clamp_min(0).mean())
    return torch.stack(excess).mean()


def octaves(maps: Sequence[Tensor], batch: Batch) -> Iterator[tuple[list[Tensor], Tensor]]:
    """Yields the detail of maps (B,P,C) by octave, the finest first, as a Laplacian pyramid within the mask.

    Octave k is the difference between means over 2^k x 2^k and over 2^(k+1) x 2^(k+1) pixels.

    Yields:
        Maps (B,C,S,S) of side S = size / 2^k, and (B,1,S,S), the share of each of their pixels inside the mask.
    """
    *images, weight = (batch.scatter(x) for x in (*maps, batch.inside))
    for _ in octave_range(batch):
        share = F.avg_pool2d(weight, 2)
        means = [F.avg_pool2d(x * weight, 2) / share.clamp_min(1e-6) for x in images]
        yield [x - F.interpolate(mean, scale_factor=2.0) for x, mean in zip(images, means)], weight
        images, weight = means, share


def octave_range(batch: Batch) -> range:
    """Returns a range over the octaves of detail that images of a batch have."""
    return range(min(OCTAVES, batch.size.bit_length() - 1))


def weighted_sum(values: dict[str, Tensor], weight: dict[str, float]) -> Tensor:
    """Returns the sum of the losses, each times its weight."""
    first, *others = (weight[name] * value for name, value in values.items())
    return sum(others, first)


def weights(loss: Loss, size: int) -> dict[str, float]:
    """Returns the weight of each loss, by name, for images of `size` pixels.

    Total variation is a mean over pixels. For transport it decreases with the image size, since a smaller share of the
    pixels lies on edges of shapes; so its weight is multiplied by size / loss.tv_reference. For albedo it does not:
    textures have edges at every scale (.036, .083 and .048 per pixel in three texture maps at 1024 px, .074, .073 and
    .057 at 128 px).
    """
    return {
        "albedo": loss.albedo,
        "transport": loss.transport,
        "normal": loss.transport,
        "ao": loss.transport,
        "light": loss.light,
        "tv_albedo": loss.tv_albedo,
        "tv_transport": loss.tv_transport * size / loss.tv_reference,
        "shading_transport": loss.shading,
        "shading_light": loss.shading,
        "shading_transport_light": loss.shading,
        "reconstruction_albedo": loss.reconstruction,
        "reconstruction_transport": loss.reconstruction,
        "reconstruction_light": loss.reconstruction,
        "reconstruction_albedo_transport": loss.reconstruction,
        "reconstruction_albedo_light": loss.reconstruction,
        "reconstruction_transport_light": loss.reconstruction,
        "reconstruction_full": loss.reconstruction_full,
        "relit_shading": loss.relit,
        "relit_image": loss.relit,
        "detail_albedo": loss.detail_albedo,
        "detail_transport": loss.detail_transport,
        "detail_shading": loss.detail_shading,
        "exclusion": loss.exclusion,
        **{f"extra_{name}": weight for name, weight in loss.extra.items()},
    }
