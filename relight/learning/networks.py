"""The networks: the paper's with its two predecessors (section 5), and a U-Net for photographs.

Channels and sizes of the paper's network at 1024 px and width 1:

    encoder   conv 4, stride 2   64@512 128@256 256@128 512@64 512@32 512@16
    decoder   residual block     512@16
              deconv 4, stride 2 512@32 512@64 256@128 128@256 64@512 maps@1024; skip connections append the
                                 encoder's features of the same size after all but the last
    light     conv 4, stride 2   (encoder and residual outputs) -> 512@8 256@4 128@2 27@1

A norm would turn a map of one pixel into zeros, since the pixel is its own mean: such a convolution has a bias instead.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from relight.core.errors import UserError
from relight.core.srgb import LUMINANCE
from relight.extensions import extension
from relight.learning.harmonics import unoccluded
from relight.settings import Model

ENCODER = (64, 128, 256, 512, 512, 512)  # channels at 1/2 to 1/64 of the size, at width 1
DECODER = (512, 512, 256, 128, 64)
LIGHT = (512, 256, 128)  # channels of the light head
STRIDE = 2 ** len(ENCODER)  # image sizes are multiples of it, since the encoder halves them so often
UNET = (64, 128, 192, 256, 384, 384)  # channels at 1/2 to 1/64 of the size, at width 1
FULL_SIZE = 32  # channels at full size of the U-Net, at width 1
PLAIN_LEVELS = 2  # finest levels of the U-Net, without residual blocks
SLOPE = 0.2  # of the leaky ReLUs
HE = partial(nn.init.kaiming_normal_, a=SLOPE)  # He's rule for the weights before them
DROPOUT_LAYERS = 3  # deconvolutions of each decoder of the paper's network that are followed by dropout


class InstanceNorm(nn.GroupNorm):
    """Normalises each channel of each image by its own mean and variance, then applies a scale and an offset."""

    def __init__(self, channels: int):
        super().__init__(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        """Normalises each channel of each image (B,C,H,W) over its pixels, then scales and shifts it."""
        if len(x) == 1:  # equal to instance norm, and this kernel keeps channels_last
            return F.batch_norm(x, None, None, self.weight, self.bias, training=True)
        return super().forward(x)  # twice as fast as instance_norm in channels_last


NORMS = {"instance": InstanceNorm, "batch": nn.BatchNorm2d}


def normalised(conv: type, inputs: int, outputs: int, kernel: tuple[int, int, int], side: int, norm: str) -> nn.Module:
    """Returns a (de)convolution followed by a norm; without the norm where the output's side has one pixel.

    `conv` is `nn.Conv2d` or `nn.ConvTranspose2d`, `kernel` its size, stride and padding, and `norm` a key of NORMS.
    """
    if side == 1:
        return conv(inputs, outputs, *kernel)
    return nn.Sequential(conv(inputs, outputs, *kernel, bias=False), NORMS[norm](outputs))


class Residual(nn.Module):
    """A residual block x + norm(conv(relu(norm(conv(x))))), without an activation after the sum."""

    def __init__(self, channels: int, side: int, norm: str):
        super().__init__()
        self.first = normalised(nn.Conv2d, channels, channels, (3, 1, 1), side, norm)
        self.second = normalised(nn.Conv2d, channels, channels, (3, 1, 1), side, norm)

    def forward(self, x: Tensor) -> Tensor:
        """Returns (B,C,S,S) for features (B,C,S,S)."""
        return x + self.second(F.relu(self.first(x)))


class Decoder(nn.Module):
    """The paper's decoder: a residual block, then six deconvolutions to a map of `outputs` channels at full size.

    `encoder` has the channels of the encoder's layers, the finest first, and `channels` those of the layers that double
    the `side` of the bottleneck, the coarsest first.
    """

    def __init__(self, encoder: list[int], channels: list[int], outputs: int, side: int, norm: str, dropout: float):
        super().__init__()
        self.dropout = dropout
        self.residual = Residual(encoder[-1], side, norm)
        self.up = nn.ModuleList()
        inputs = encoder[-1]
        for width, skip in zip(channels, reversed(encoder[:-1])):
            side *= 2
            self.up.append(normalised(nn.ConvTranspose2d, inputs, width, (4, 2, 1), side, norm))
            inputs = width + skip
        self.last = nn.ConvTranspose2d(inputs, outputs, 4, 2, 1)

    def forward(self, features: list[Tensor]) -> tuple[Tensor, Tensor]:
        """Decodes the encoder's features.

        Args:
            features: (B,C,s,s) of all levels of the encoder, finest first.

        Returns:
            The output of the residual block (B,C,S/64,S/64), and the map (B,outputs,S,S).
        """
        residual = x = self.residual(features[-1])
        for level, (up, skip) in enumerate(zip(self.up, reversed(features[:-1]))):
            x = up(x)
            if level < DROPOUT_LAYERS:
                x = F.dropout(x, self.dropout, self.training)
            x = torch.cat([F.relu(x), skip], 1)
        return residual, self.last(x)


class StridedHead(nn.Module):
    """The paper's light head: four strided convolutions down to one pixel.

    At 1024 px the sides are 16 -> 8 -> 4 -> 2 -> 1. A smaller bottleneck reaches one pixel early; the remaining layers
    are then 1x1 convolutions. A larger one ends with several pixels, which are averaged.
    """

    def __init__(self, inputs: int, channels: list[int], outputs: int, side: int, norm: str):
        super().__init__()
        self.layers = nn.ModuleList()
        for width in channels:
            # Kernel, stride and padding: halves the side, until it is one pixel.
            kernel, side = ((4, 2, 1), side // 2) if side > 1 else ((1, 1, 0), 1)
            self.layers.append(normalised(nn.Conv2d, inputs, width, kernel, side, norm))
            inputs = width
        self.last = nn.Conv2d(inputs, outputs, *((4, 2, 1) if side > 1 else (1, 1, 0)))

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        """Returns (B,outputs), the mean over the last features, for features (B,C,S,S); the mask is not used."""
        for layer in self.layers:
            x = F.leaky_relu(layer(x), SLOPE)
        return self.last(x).mean((2, 3))


class PooledHead(nn.Module):
    """A light head that averages features over the mask; their size is 1/stride of the image's."""

    def __init__(self, inputs: int, channels: list[int], outputs: int, stride: int):
        super().__init__()
        self.stride = stride
        sizes = [inputs, *channels]
        self.layers = nn.ModuleList(nn.Conv2d(a, b, 1) for a, b in pairwise(sizes))
        self.last = nn.Conv2d(sizes[-1], outputs, 1)

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        """Returns (B,outputs) for features (B,C,S,S), pooled over the mask (B,1,stride S,stride S)."""
        share = F.avg_pool2d(mask, self.stride)
        x = F.leaky_relu(self.layers[0](x), SLOPE)  # before the pooling: the network can weight pixels
        x = (x * share).sum((2, 3), keepdim=True) / share.sum((2, 3), keepdim=True).clamp_min(1e-6)
        for layer in self.layers[1:]:
            x = F.leaky_relu(layer(x), SLOPE)
        return self.last(x).flatten(1)


class Refinement(nn.Module):
    """Refines a light by ridge regression of the image on the inferred maps (not in the paper).

    The refined L minimises sum_c mean_p (a_pc T_p.L_c - I_pc)^2 + sum_k |C_k^T (L_k - s L0_k)|^2 over the pixels p of
    the figure and the color channels c, in closed form. a is the inferred albedo, T the inferred transport, I the
    image, L0 the light of the head, and s the factor from 0.25 to 4 with which L0 explains the image best, to the power
    of `rescale`; 1 in training. The matrices C_k (3,3) are learned: `trust` is the logarithm of their squared scale,
    and `coupling` their difference from diagonal ones, since the errors of the channels go together. The maps are
    detached: errors of the light pass no gradient to them.
    """

    SIDE = 64  # pixels per side to which maps are subsampled: hundreds of equations for 27 or 75 unknowns

    def __init__(self, coefficients: int, rescale: float = 0.0):
        super().__init__()
        self.rescale = rescale
        self.trust = nn.Parameter(torch.full((coefficients,), -4.0))
        self.coupling = nn.Parameter(torch.zeros(coefficients, 3, 3))

    def forward(self, light: Tensor, albedo: Tensor, transport: Tensor, image: Tensor, mask: Tensor) -> Tensor:
        """Returns the refined light (B,K,3), the solution of the regression.

        Args:
            light: (B,K,3) of the head.
            albedo: inferred (B,3,S,S).
            transport: inferred (B,K,S,S).
            image: linear (B,3,S,S).
            mask: (B,1,S,S).
        """
        with torch.autocast(light.device.type, enabled=False):
            step = max(1, image.shape[2] // self.SIDE)
            maps = [x[..., ::step, ::step].float().detach() for x in (albedo, transport, image, mask)]
            return torch.linalg.solve(*self.normal_equations(light.float(), *maps)).view_as(light.mT).mT

    def normal_equations(
        self, light: Tensor, albedo: Tensor, transport: Tensor, image: Tensor, mask: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Returns the linear system of the regression, for the 3K unknowns of each light, channel by channel.

        Maps are as for `forward`, of any sides; the matrix is (B,3K,3K), symmetric and positive definite, and the
        right-hand side (B,3K).
        """
        albedo, transport, image, mask = (x.flatten(2) for x in (albedo, transport, image, mask))
        pixels = mask.sum((1, 2)).clamp_min(1)[:, None, None]
        transport = transport * mask
        if self.rescale and not self.training:
            shaded = albedo * (light.mT @ transport)
            factor = ((shaded * image).sum((1, 2)) + 1e-6) / (shaded.square().sum((1, 2)) + 1e-6)
            light = light * factor.clamp(0.25, 4.0)[:, None, None] ** self.rescale
        weighted = (albedo**2)[:, :, None] * transport[:, None]  # (B,3,K,P)
        data = weighted @ transport[:, None].mT / pixels[..., None]
        eye = torch.eye(3, device=light.device)
        root = (0.5 * self.trust).exp()[:, None, None] * (eye + self.coupling)
        prior = root @ root.mT  # (K,3,3)
        blocks = torch.diag_embed(prior.permute(1, 2, 0)) + data[:, :, None] * eye.view(3, 3, 1, 1)  # (B,3,3,K,K)
        right = (albedo * image) @ transport.mT / pixels + (prior @ light[..., None])[..., 0].mT
        return blocks.transpose(2, 3).flatten(3).flatten(1, 2), right.flatten(1)


class Network(nn.Module):
    """Infers albedo, light and a shape map from an image and its mask.

    The shape map is transport (`ours`, `unet`), normal (`sfsnet`), or normal and AO (`sfsnet_ao`). Subclasses
    implement `infer`.

    Attributes:
        order: highest band of the harmonics.
        size: S of the images of the training, pixels.
        albedo: how albedo is constrained, see `constrain_albedo`.
        sees: `image`, or `mask` for a network that is given the silhouette only.
        refinement: refines the light, or None.
        rebalance: power of the light's color by which the image is divided at inference before it is seen: networks
            take a part of a warm light for warm cloth, and less of what is left of it. 0 to leave it.
    """

    unlearned: frozenset[str] = frozenset()  # outputs that no loss trained; set by the evaluation

    refinement: "Refinement | None"

    def __init__(self, model: Model, size: int):
        """Keeps the settings; subclasses create the layers. `size` is the side of the images, pixels."""
        super().__init__()
        self.order, self.size, self.albedo, self.sees = model.order, size, model.albedo, model.sees
        self.rebalance = model.rebalance

    def infer(self, seen: Tensor, mask: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Runs the layers; subclasses implement it.

        Args:
            seen: image (B,3,S,S) scaled to [-1,1], 0 outside the mask.
            mask: (B,1,S,S).

        Returns:
            The unconstrained maps (B,C,S,S) by name, and the light (B,3K).
        """
        raise NotImplementedError

    def forward(self, image: Tensor, mask: Tensor) -> dict[str, Tensor]:
        """Infers the maps and the light.

        Args:
            image: (B,3,S,S) linear, about [0,1]; S is a multiple of 64.
            mask: (B,1,S,S) of 0 and 1.

        Returns:
            `albedo` (B,3,S,S) in [0,1]; `light` (B,K,3), radiance coefficients; and `transport` (B,K,S,S), or `normal`
            (B,3,S,S), unit vectors in the camera frame, with `ao` (B,1,S,S) for `sfsnet_ao`. Maps are valid inside the
            mask only.
        """
        if not self.rebalance or self.training:
            return self.look(image, mask)
        color = self.color_of_light(image, mask)
        outputs = self.look(image / color[..., None, None], mask)
        outputs["light"] = outputs["light"] * color[:, None]
        return outputs

    def color_of_light(self, image: Tensor, mask: Tensor) -> Tensor:
        """Returns the color (B,3) of the mean shading over its luminance, to the power of `rebalance`.

        It is inferred at half the size, which is enough.
        """
        side = STRIDE * max(self.size // (2 * STRIDE), 2)
        image, mask = (F.interpolate(x, (side, side), mode="bilinear") for x in (image * mask, mask))
        mask = (mask > 0.5).to(image.dtype)
        outputs = self.look(image, mask)
        transport = (self.transport(outputs) * mask).sum((2, 3))
        color = (transport[:, None] @ outputs["light"])[:, 0].clamp_min(1e-3)
        return (color / (color @ color.new_tensor(LUMINANCE))[:, None]).clamp(0.25, 4.0) ** self.rebalance

    def look(self, image: Tensor, mask: Tensor) -> dict[str, Tensor]:
        """Infers from an image (B,3,S,S) and a mask (B,1,S,S) once, as `forward` returns it."""
        x = (2 * image - 1) * mask if self.sees == "image" else mask.expand_as(image)
        outputs, light = self.infer(x.contiguous(memory_format=torch.channels_last), mask)
        outputs["light"] = light.unflatten(1, (-1, 3))
        outputs["albedo"] = constrain_albedo(outputs["albedo"], self.albedo)
        if "normal" in outputs:
            outputs["normal"] = F.normalize(outputs["normal"].float(), dim=1, eps=1e-6)
        if self.refinement:
            transport = self.transport(outputs)
            outputs["light"] = self.refinement(outputs["light"], outputs["albedo"], transport, image, mask)
        return outputs

    def transport(self, outputs: dict[str, Tensor]) -> Tensor:
        """Returns the transport (B,K,S,S) of inferred maps, as `with_transport` adds it."""
        maps = {name: values.movedim(1, -1) for name, values in outputs.items() if name != "light"}
        return with_transport(maps, self.order)["transport"].movedim(-1, 1)


class PaperNetwork(Network):
    """One encoder, a decoder with skip connections for each map, and a light head (paper, section 5)."""

    def __init__(self, model: Model, size: int):
        super().__init__(model, size)
        coefficients = (model.order + 1) ** 2
        maps = {"ours": {"transport": coefficients}, "sfsnet": {"normal": 3}, "sfsnet_ao": {"normal": 3, "ao": 1}}
        encoder, decoder, light = ([scaled(c, model.width) for c in sizes] for sizes in (ENCODER, DECODER, LIGHT))
        side, inputs = size // 2, encoder[0]
        self.encoder = nn.ModuleList([nn.Conv2d(3, inputs, 4, 2, 1)])
        for width in encoder[1:]:
            side //= 2
            self.encoder.append(normalised(nn.Conv2d, inputs, width, (4, 2, 1), side, model.norm))
            inputs = width
        self.decoders = nn.ModuleDict(
            {
                name: Decoder(encoder, decoder, outputs, side, model.norm, model.dropout)
                for name, outputs in {**maps[model.name], "albedo": 3}.items()
            }
        )
        bottleneck = encoder[-1] * (1 + len(self.decoders))
        if model.light_head == "strided":
            self.light: StridedHead | PooledHead = StridedHead(bottleneck, light, 3 * coefficients, side, model.norm)
        else:
            self.light = PooledHead(bottleneck, light, 3 * coefficients, STRIDE)
        self.refinement = Refinement(coefficients, model.rescale) if model.refine else None
        if not on_meta(self):
            self.initialise(scaled=model.light_head == "pooled" or side < 16)

    def initialise(self, scaled: bool) -> None:
        """Draws the weights from N(0, .02), those of residual blocks by He's rule.

        A `scaled` light head follows He's rule, too. Below 1024 px its kernels see few inputs, and N(0, .02) would
        shrink the signal at each layer until only the mean light is left.
        """
        draw_weights(self, partial(nn.init.normal_, std=0.02))
        for block in (part for part in self.modules() if isinstance(part, Residual)):
            draw_weights(block, nn.init.kaiming_normal_)
        if scaled:
            draw_weights(self.light.layers, HE)
            nn.init.normal_(self.light.last.weight, 0, 0.01)

    def infer(self, seen: Tensor, mask: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Implements `Network.infer`; the light is inferred from the outputs of the residual blocks of all decoders."""
        x, features = seen, []
        for layer in self.encoder:
            x = F.leaky_relu(layer(x), SLOPE)
            features.append(x)
        bottleneck, outputs = [x], {}
        for name, decoder in self.decoders.items():
            residual, outputs[name] = decoder(features)
            bottleneck.append(residual)
        return outputs, self.light(torch.cat(bottleneck, 1), mask)


class UNet(Network):
    """A U-Net for photographs: one encoder, and one decoder for all maps.

    The decoder upsamples bilinearly, because transposed convolutions leave stripes in the maps. Its last two
    convolutions get the image at full size, because the maps are blurred without it. The light is pooled over the
    figure from decoder features at 1/8 of the size, which already describe the shape.
    """

    def __init__(self, model: Model, size: int):
        super().__init__(model, size)
        self.coefficients = (model.order + 1) ** 2
        sizes = [scaled(c, model.width) for c in UNET]
        side, inputs = size, 4

        def block(level: int, inputs: int, kernel: tuple[int, int, int], activation: nn.Module) -> nn.Sequential:
            layers = [normalised(nn.Conv2d, inputs, sizes[level], kernel, side, model.norm), activation]
            if level >= PLAIN_LEVELS:
                layers.append(Residual(sizes[level], side, model.norm))
            return nn.Sequential(*layers)

        self.encoder = nn.ModuleList()
        for level, width in enumerate(sizes):
            side //= 2
            self.encoder.append(block(level, inputs, (4, 2, 1), nn.LeakyReLU(SLOPE)))
            inputs = width
        self.reduce, self.decoder = nn.ModuleList(), nn.ModuleList()
        for level, width in reversed(list(enumerate(sizes[:-1]))):
            side *= 2
            self.reduce.append(nn.Conv2d(inputs, width, 1))  # before the upsampling: a quarter of the operations
            self.decoder.append(block(level, 2 * width, (3, 1, 1), nn.ReLU()))
            inputs = width
        sharp = scaled(FULL_SIZE, model.width)
        self.reduce.append(nn.Conv2d(inputs, sharp, 1))
        self.sharpen = nn.Conv2d(sharp + 4, sharp, 3, 1, 1)
        self.last = nn.Conv2d(sharp, self.coefficients + 3, 3, 1, 1)
        head = [scaled(c, model.width) for c in LIGHT]
        self.light = PooledHead(sizes[PLAIN_LEVELS], head, 3 * self.coefficients, 2 ** (PLAIN_LEVELS + 1))
        self.refinement = Refinement(self.coefficients, model.rescale) if model.refine else None
        if not on_meta(self):
            self.initialise()

    def initialise(self) -> None:
        """Draws the weights by He's rule, those of the last layers from N(0, .01).

        Biases are zero but for two: with zeros, some trainings kept a constant albedo for hundreds of steps, or
        diverged.
        """
        draw_weights(self, HE)
        for last in (self.last, self.light.last):
            nn.init.normal_(last.weight, 0, 0.01)
        assert self.sharpen.bias is not None and self.last.bias is not None
        nn.init.ones_(self.sharpen.bias)  # most of an image is negative, and units that start dead stay dead
        nn.init.constant_(self.last.bias[self.coefficients :], 0.3)  # albedo starts within [0,1]

    def infer(self, seen: Tensor, mask: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Implements `Network.infer`; the light is inferred from a coarse level of the decoder."""
        picture = torch.cat([seen, mask], 1).contiguous(memory_format=torch.channels_last)
        x, features = picture, []
        for layer in self.encoder:
            x = layer(x)
            features.append(x)
        light = None
        for level, reduce, layer in zip(reversed(range(len(self.decoder))), self.reduce, self.decoder):
            x = layer(torch.cat([upsampled(reduce(x)), features[level]], 1))
            if level == PLAIN_LEVELS:
                light = self.light(x, mask)
        x = F.relu(self.sharpen(torch.cat([upsampled(self.reduce[-1](x)), picture], 1)))
        transport, albedo = self.last(x).split([self.coefficients, 3], 1)
        assert light is not None  # PLAIN_LEVELS is one of the levels
        return {"transport": transport, "albedo": albedo}, light


def draw_weights(part: nn.Module, rule: Callable[[Tensor], Tensor]) -> None:
    """Draws the weights of all convolutions in a part of a network by a rule of `nn.init`; their biases are zero."""
    for module in part.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
            rule(module.weight)
            if module.bias is not None:
                nn.init.zeros_(module.bias)


def upsampled(x: Tensor) -> Tensor:
    """Upsamples a map (B,C,H,W) to twice the size, bilinearly."""
    return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


def scaled(channels: int, width: float) -> int:
    """Returns `channels` times a relative `width`, rounded to a multiple of 8 for vector instructions; at least 8."""
    return max(8, 8 * round(channels * width / 8))


def constrain_albedo(albedo: Tensor, mode: str) -> Tensor:
    """Constrains albedo to [0,1] by mode: `clip` (paper; no gradient outside), or `straight_through`."""
    clipped = albedo.clamp(0, 1)
    return clipped if mode == "clip" else albedo + (clipped - albedo).detach()


def with_transport(maps: dict[str, Tensor], order: int) -> dict[str, Tensor]:
    """Adds the transport to maps that lack it.

    Args:
        maps: inferred maps (..., C), channels last.
        order: largest degree of the spherical harmonics.

    Returns:
        The maps with `transport` (..., K): as inferred, or the unoccluded transport of the normals, times `ao` if there
        is one.
    """
    if "transport" in maps:
        return maps
    transport = unoccluded(maps["normal"], order)
    return {**maps, "transport": transport * maps["ao"] if "ao" in maps else transport}


def widened(weights: dict[str, Tensor], network: UNet) -> dict[str, Tensor]:
    """Returns the weights of a U-Net of the same or a lower order for `network`, whose further bands are zero at first.

    Their layers learn all the same, since the inputs of these are not zero.

    Args:
        weights: by name. Bands come first in every tensor that has them; the last layer has the albedo after them.
        network: of the same settings but the order.
    """
    wide = {name: torch.zeros_like(values) for name, values in network.state_dict().items()}
    for name, values in weights.items():
        bands = values[:-3] if name.startswith("last.") else values
        wide[name][tuple(slice(side) for side in bands.shape)] = bands
        if name.startswith("last."):
            wide[name][-3:] = values[-3:]
    return wide


def on_meta(network: nn.Module) -> bool:
    """Returns whether the parameters are on the meta device, where drawing weights would import torch's compiler."""
    return next(network.parameters()).is_meta


def build(model: Model, size: int) -> Network:
    """Returns a new network with weights drawn by torch's global generator.

    Args:
        model: settings of the network.
        size: S of the square images in pixels, a multiple of 64.

    Raises:
        UserError: if the size is not a multiple of 64, or no network or extension has the name `model.name`.
    """
    if size < STRIDE or size % STRIDE:
        raise UserError(
            f"the image size is {size} px: it must be a multiple of {STRIDE}, because the network halves it six times"
        )
    built_in = {"unet": UNet, "ours": PaperNetwork, "sfsnet": PaperNetwork, "sfsnet_ao": PaperNetwork}
    kind: type[Network] = built_in.get(model.name) or extension(model.name, "network")
    return kind(model, size).to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # not in torch's hints
