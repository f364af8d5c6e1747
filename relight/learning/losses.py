"""The fifteen L1 losses of the paper (section 4), two under another light, and four of detail for photographs.

`TERMS` is the table of the losses: the name of a weight in `relight.settings.Loss`, and the function that computes what
it weighs. To add a loss, add a weight there and a term here.

They are computed on the pixels inside the masks. Outside, ground truth and masked outputs are both zero, so sums over
the masks are sums over the images. Let A, T, L be the ground truth, A^, T^, L^ the prediction, S = T.L and I = A*S.
Four of the seven reconstructions need no new map: |A*(T^.L) - I| = A*|T^.L - S|, the same for the other two shadings,
and |A^*S - I| = S*|A^ - A|.

All shadings and reconstructions of the paper have the light of the image, and a transport can fit that light at the
cost of others. The losses `relit` compare T^.L' and A^*(T^.L') with T.L' and A*(T.L') under L', the light of another
image of the batch.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor

from relight.core.errors import UserError
from relight.extensions import extension
from relight.learning.color import shade
from relight.learning.data import Batch
from relight.learning.networks import with_transport
from relight.settings import Loss
from relight.sh import order_of

OCTAVES = 5  # of detail: structures of about 2 to 64 pixels
LEVEL = 0.05  # of the true map's root mean square: bounds the divisor where the true detail is weaker
SHADINGS = ("transport", "light", "transport_light")  # by what is inferred: see `Comparison.shading`
DARK = 0.02  # lower bound of values whose ln is taken


class Comparison:
    """The inferred maps of a batch beside the true ones, as the terms need them; what several terms need is kept.

    Attributes:
        outputs: outputs of the network, maps (B,C,S,S) and light (B,K,3).
        batch: the ground truth.
        maps: the inferred maps (B,P,C) inside the masks, with the transport that follows from normals (and AO).
        albedo, transport: two of them.
        light: (B,K,3).
    """

    def __init__(self, outputs: dict[str, Tensor], batch: Batch, reduction: str):
        """Gathers pixels of maps (B,C,S,S) by name, and `light` (B,K,3); `reduction` is that of `Loss`."""
        order = order_of(batch.light.shape[1])
        self.outputs, self.batch = outputs, batch
        self.maps = with_transport({k: batch.gather(v) for k, v in outputs.items() if k != "light"}, order)
        self.albedo, self.transport, self.light = self.maps["albedo"], self.maps["transport"], outputs["light"].float()
        if "normal" in self.maps:
            self.transport = self.transport * batch.inside  # zero normals of the padding have non-zero transport
        self.pixels = len(self.light) * batch.size**2 if reduction == "image" else batch.mask_pixels
        self._kept: dict[str, Tensor] = {}

    def _keep(self, name: str, compute: Callable[[], Tensor]) -> Tensor:
        """Returns the result of `compute`, which is called once for each name: several losses use the same error."""
        if name not in self._kept:
            self._kept[name] = compute()
        return self._kept[name]

    def shading(self, inferred: str) -> Tensor:
        """Returns the shading (B,P,3) by the inferred "transport", by the inferred "light", or by "transport_light"."""
        transport = self.batch.transport if inferred == "light" else self.transport
        light = self.batch.light if inferred == "transport" else self.light
        return self._keep(inferred, lambda: shade(transport, light))

    def shading_error(self, inferred: str) -> Tensor:
        """Returns the absolute error (B,P,3) of such a shading."""
        return self._keep(f"{inferred} error", lambda: (self.shading(inferred) - self.batch.shading).abs())

    def albedo_error(self) -> Tensor:
        """Returns the absolute error (B,P,3) of the albedo."""
        return self._keep("albedo error", lambda: (self.albedo - self.batch.albedo).abs())

    def mean(self, error: Tensor, weight: Tensor | None = None) -> Tensor:
        """Returns the mean of an error (B,P,C), times a weight of the same shape if there is one."""
        total = error.sum() if weight is None else torch.dot(weight.flatten(), error.flatten())
        return total / (self.pixels * error.shape[-1])


def losses(outputs: dict[str, Tensor], batch: Batch, loss: Loss) -> tuple[Tensor, dict[str, Tensor]]:
    """Computes the losses whose weights are not zero, and their weighted sum.

    The name of a shading or reconstruction lists its inferred factors: `reconstruction_albedo_light` compares A^*(T.L^)
    with the image. A network that infers normals has the losses `normal` (and `ao`) instead of `transport`; its other
    losses use the transport that follows from its normals (and AO).

    Args:
        outputs: outputs of the network, maps (B,C,S,S) and light (B,K,3).
        batch: the ground truth.
        loss: weights and reduction. Losses of weight 0 are skipped. The reduction is the mean over the channels and
            over all pixels, background included (`image`, the authors'), or over those of the masks (`mask`).

    Returns:
        The weighted sum, and the unweighted scalars by name.

    Raises:
        UserError: if a loss of an extension is no scalar.
    """
    comparison = Comparison(outputs, batch, loss.reduction)
    values: dict[str, Tensor] = {}
    weighted: list[Tensor] = []

    def add(terms: dict[str, Tensor], weight: float) -> None:
        values.update(terms)
        weighted.extend(weight * value for value in terms.values())

    for name, term in TERMS.items():
        if weight := getattr(loss, name):
            # A mean over pixels. A larger image has a smaller share of them on edges of shapes, where transport
            # varies; textures have edges at every scale (0.036, 0.083 and 0.048 per pixel in three texture maps at
            # 1024 px, 0.074, 0.073 and 0.057 at 128 px).
            add(term(comparison), weight * batch.size / loss.tv_reference if name == "tv_transport" else weight)
    for name, weight in loss.extra.items():
        if weight:
            value = extension(name, "loss")(outputs, batch)
            if not isinstance(value, Tensor) or value.ndim:
                raise UserError(f"the loss of the extension {name} must be a tensor of one number, without axes")
            add({f"extra_{name}": value}, weight)
    return sum(weighted[1:], weighted[0]), values


def transport_losses(c: Comparison) -> dict[str, Tensor]:
    """Returns the error of transport, or those of the normals and AO that a network infers in its place."""
    names = [name for name in ("transport", "normal", "ao") if name in c.outputs]
    return {name: c.mean((c.maps[name] - getattr(c.batch, name)).abs()) for name in names}


def reconstruction_losses(c: Comparison) -> dict[str, Tensor]:
    """Returns the errors of the image of which one or two of albedo, transport and light are inferred."""
    values = {f"reconstruction_{name}": c.mean(c.shading_error(name), c.batch.albedo) for name in SHADINGS}
    values["reconstruction_albedo"] = c.mean(c.albedo_error(), c.batch.shading)
    for name in ("transport", "light"):
        values[f"reconstruction_albedo_{name}"] = c.mean((c.albedo * c.shading(name) - c.batch.relit).abs())
    return values


def relit_losses(c: Comparison) -> dict[str, Tensor]:
    """Returns the errors of shading and image under another light."""
    light = c.batch.light.roll(1, 0) if c.batch.other_light is None else c.batch.other_light
    inferred, truth = shade(c.transport, light), shade(c.batch.transport, light)
    image_error = (c.albedo * inferred - c.batch.albedo * truth).abs()
    return {"relit_shading": c.mean((inferred - truth).abs()), "relit_image": c.mean(image_error)}


def detail_losses(c: Comparison) -> dict[str, Tensor]:
    """Returns the energies of the detail of the errors of albedo, transport, and shading under the true light."""
    inferred = {"albedo": c.albedo, "transport": c.transport, "shading": c.shading("transport")}
    truth = {name: getattr(c.batch, name) for name in inferred}
    return {f"detail_{name}": detail(inferred[name] - truth[name], truth[name], c.batch) for name in inferred}


TERMS: dict[str, Callable[[Comparison], dict[str, Tensor]]] = {
    "albedo": lambda c: {"albedo": c.mean(c.albedo_error())},
    "transport": transport_losses,
    "light": lambda c: {"light": F.l1_loss(c.light, c.batch.light)},
    "tv_albedo": lambda c: {"tv_albedo": c.mean(variation(c.albedo, c.batch))},
    "tv_transport": lambda c: {"tv_transport": c.mean(variation(c.transport, c.batch))},
    "shading": lambda c: {f"shading_{name}": c.mean(c.shading_error(name)) for name in SHADINGS},
    "reconstruction": reconstruction_losses,
    "reconstruction_full": lambda c: {
        "reconstruction_full": c.mean((c.albedo * c.shading("transport_light") - c.batch.relit).abs())
    },
    "relit": relit_losses,
    "detail": detail_losses,
    "exclusion": lambda c: {"exclusion": exclusion(c)},
}


def variation(compact: Tensor, batch: Batch) -> Tensor:
    """Returns |dx| + |dy| (B,P,C), absolute forward differences of maps in the mask eroded by one pixel, else zero.

    Args:
        compact: (B,P,C) the maps at the P pixels of each figure, row by row, so that most right neighbours come next.
        batch: knows the pixels below and those of the eroded mask.
    """
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

    Returns:
        A scalar.
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


def exclusion(c: Comparison) -> Tensor:
    """Returns by how much the detail of inferred albedo and shading correlates beyond that of the true ones.

    Correlation is mean |a s| over the root mean squares of a and s, the detail of the ln of the maps' channel means;
    excess is averaged over octaves and images. The idea is the exclusion loss of Zhang et al. 2018, Single Image
    Reflection Separation. With squared errors alone, an ambiguous edge appears in both maps; with this loss, in one.

    Args:
        c: whose shading is that of the inferred transport under the true light.

    Returns:
        A scalar, 0 if no octave's correlation exceeds the true one.
    """
    maps = (c.albedo, c.shading("transport"), c.batch.albedo, c.batch.shading)
    excess = []
    for images, weight in octaves([x.mean(-1, keepdim=True).clamp_min(DARK).log() for x in maps], c.batch):
        energy = torch.stack([(x**2 * weight).sum((1, 2, 3)) for x in images])
        energy[:2] += LEVEL**2 * energy[2:]  # bounds the divisor where the inferred detail is weak
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
