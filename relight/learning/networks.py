"""The networks: that of the paper with its two predecessors (section 5), and one for photographs.

Level sizes of the paper's at 1024 px and width 1:

    encoder   conv 4, stride 2   64@512 128@256 256@128 512@64 512@32 512@16
    decoder   residual block     512@16
              deconv 4, stride 2 512@32 512@64 256@128 128@256 64@512 maps@1024; after all but the last, the encoder's
                                 features of the same size are appended
    light     conv 4, stride 2   (encoder and residual outputs) -> 512@8 256@4 128@2 27@1
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from relight.config import Model
from relight.files import UserError
from relight.learning.blocks import Decoder, Residual, normalised
from relight.learning.harmonics import unoccluded
from relight.learning.heads import SLOPE, PooledHead, Refinement, StridedHead

ENCODER = (64, 128, 256, 512, 512, 512)
DECODER = (512, 512, 256, 128, 64)
LIGHT = (512, 256, 128)
STRIDE = 2 ** len(ENCODER)
UNET = (64, 128, 192, 256, 384, 384)  # channels at 1/2 to 1/64 of the size, at width 1
SHARP = 32  # channels at full size, at width 1
DEEP = 2  # levels from the finest one that have no residual block


class Network(nn.Module):
    """Image and mask to albedo, light, and transport (`ours`, `unet`), normal (`sfsnet`), or normal and AO
    (`sfsnet_ao`). Subclasses give `infer`."""

    layout = torch.channels_last  # of the features
    unlearned: frozenset[str] = frozenset()  # outputs that no loss asked for, where one who scores the network says so

    def __init__(self, model: Model, size: int):
        super().__init__()
        self.order, self.size, self.albedo, self.sees = model.order, size, model.albedo, model.sees

    def infer(self, seen: Tensor, mask: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """What the layers put out for seen (B,3,S,S) in [-1,1], 0 outside the mask: maps by name, and light (B,3K)."""
        raise NotImplementedError

    def forward(self, image: Tensor, mask: Tensor) -> dict[str, Tensor]:
        """image (B,3,S,S) linear, about [0,1]; mask (B,1,S,S) of 0 and 1; S a multiple of 64.

        Returns albedo (B,3,S,S) in [0,1]; light (B,K,3) radiance coefficients; and transport (B,K,S,S), or
        normal (B,3,S,S) unit in the camera frame, with ao (B,1,S,S) for `sfsnet_ao`. The maps hold inside the mask.
        """
        x = (2 * image - 1) * mask if self.sees == "image" else mask.expand_as(image)
        outputs, light = self.infer(x.contiguous(memory_format=self.layout), mask)
        outputs["light"] = light.unflatten(1, (-1, 3))
        outputs["albedo"] = limited(outputs["albedo"], self.albedo)
        if "normal" in outputs:
            outputs["normal"] = F.normalize(outputs["normal"].float(), dim=1, eps=1e-6)
        if self.refinement:
            maps = with_transport(
                {name: outputs[name].movedim(1, -1) for name in outputs if name != "light"}, self.order
            )
            transport = maps["transport"].movedim(-1, 1)
            outputs["light"] = self.refinement(outputs["light"], outputs["albedo"], transport, image, mask)
        return outputs


class PaperNetwork(Network):
    """One encoder, a decoder with skip connections for each map, and a light head (paper, section 5)."""

    def __init__(self, model: Model, size: int):
        super().__init__(model, size)
        coefficients = (model.order + 1) ** 2
        maps = {"ours": {"transport": coefficients}, "sfsnet": {"normal": 3}, "sfsnet_ao": {"normal": 3, "ao": 1}}
        encoder, decoder, light = ([channels(c, model.width) for c in sizes] for sizes in (ENCODER, DECODER, LIGHT))
        side, inputs = size // 2, encoder[0]
        self.encoder = nn.ModuleList([nn.Conv2d(3, inputs, 4, 2, 1)])
        for width in encoder[1:]:
            side //= 2
            self.encoder.append(normalised(nn.Conv2d, inputs, width, (4, 2, 1), side, model.norm))
            inputs = width
        self.decoders = nn.ModuleDict(
            (name, Decoder(encoder, decoder, outputs, side, model.norm, model.dropout))
            for name, outputs in {**maps[model.name], "albedo": 3}.items()
        )
        bottleneck = encoder[-1] * (1 + len(self.decoders))
        if model.light_head == "strided":
            self.light = StridedHead(bottleneck, light, 3 * coefficients, side, model.norm)
        else:
            self.light = PooledHead(bottleneck, light, 3 * coefficients, STRIDE)
        self.refinement = Refinement(coefficients) if model.refine else None
        self.initialise(scaled=model.light_head == "pooled" or side < 16)

    def initialise(self, scaled: bool) -> None:
        """N(0, .02), the residual convolutions He. A `scaled` light head is He too: with the few inputs that its
        kernels see below 1024 px, N(0, .02) would shrink the signal at each layer until only the mean light is left.
        """
        for module in self.modules():
            if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
                nn.init.normal_(module.weight, 0, 0.02)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        for decoder in self.decoders.values():
            for module in decoder.residual.modules():
                if isinstance(module, nn.Conv2d):
                    nn.init.kaiming_normal_(module.weight)
        if scaled:
            for module in self.light.layers.modules():
                if isinstance(module, nn.Conv2d):
                    nn.init.kaiming_normal_(module.weight, a=SLOPE)
            nn.init.normal_(self.light.last.weight, 0, 0.01)

    def infer(self, seen: Tensor, mask: Tensor) -> tuple[dict[str, Tensor], Tensor]:
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
    """One encoder and one decoder for all maps, made for photographs.

    What the paper's form leaves in a photograph's maps is avoided: transposed convolutions stripe them, and without the
    picture at full size they blur. Here the decoder enlarges bilinearly, and its last two convolutions see the picture.
    The light is pooled over the figure from decoder features at 1/8 of the size, which know the shape already.
    """

    layout = torch.contiguous_format  # a training step on a CPU takes 1.25 times as long in channels_last

    def __init__(self, model: Model, size: int):
        super().__init__(model, size)
        self.coefficients = (model.order + 1) ** 2
        sizes = [channels(c, model.width) for c in UNET]
        side, inputs = size, 4
        self.encoder = nn.ModuleList()
        for level, width in enumerate(sizes):
            side //= 2
            block = [normalised(nn.Conv2d, inputs, width, (4, 2, 1), side, model.norm), nn.LeakyReLU(SLOPE)]
            if level >= DEEP:
                block.append(Residual(width, side, model.norm))
            self.encoder.append(nn.Sequential(*block))
            inputs = width
        self.reduce, self.decoder = nn.ModuleList(), nn.ModuleList()
        for level, width in reversed(list(enumerate(sizes[:-1]))):
            side *= 2
            self.reduce.append(nn.Conv2d(inputs, width, 1))  # before the map is enlarged: a quarter of the work
            block = [normalised(nn.Conv2d, 2 * width, width, (3, 1, 1), side, model.norm), nn.ReLU()]
            if level >= DEEP:
                block.append(Residual(width, side, model.norm))
            self.decoder.append(nn.Sequential(*block))
            inputs = width
        sharp = channels(SHARP, model.width)
        self.reduce.append(nn.Conv2d(inputs, sharp, 1))
        self.sharpen = nn.Conv2d(sharp + 4, sharp, 3, 1, 1)
        self.last = nn.Conv2d(sharp, self.coefficients + 3, 3, 1, 1)
        head = [channels(c, model.width) for c in LIGHT]
        self.light = PooledHead(sizes[DEEP], head, 3 * self.coefficients, 2 ** (DEEP + 1))
        self.refinement = Refinement(self.coefficients) if model.refine else None
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, a=SLOPE)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        for last in (self.last, self.light.last):
            nn.init.normal_(last.weight, 0, 0.01)

    def infer(self, seen: Tensor, mask: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        picture = torch.cat([seen, mask], 1).contiguous(memory_format=self.layout)
        x, features = picture, []
        for layer in self.encoder:
            x = layer(x)
            features.append(x)
        light = None
        for level, reduce, layer in zip(reversed(range(len(self.decoder))), self.reduce, self.decoder):
            x = layer(torch.cat([twice(reduce(x)), features[level]], 1))
            if level == DEEP:
                light = self.light(x, mask)
        x = F.relu(self.sharpen(torch.cat([twice(self.reduce[-1](x)), picture], 1)))
        transport, albedo = self.last(x).split([self.coefficients, 3], 1)
        return {"transport": transport, "albedo": albedo}, light


def twice(x: Tensor) -> Tensor:
    """(B,C,H,W) at twice the size, bilinear."""
    return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


def channels(count: int, width: float) -> int:
    """`count` channels at a relative `width`, a multiple of 8 (whole vectors of every device)."""
    return max(8, 8 * round(count * width / 8))


def limited(albedo: Tensor, how: str) -> Tensor:
    """Albedo into [0,1]: `clip` (the paper; no gradient outside), `straight_through` (with gradient), `sigmoid`."""
    if how == "sigmoid":
        return torch.sigmoid(albedo)
    clipped = albedo.clamp(0, 1)
    return clipped if how == "clip" else albedo + (clipped - albedo).detach()


def with_transport(maps: dict[str, Tensor], order: int) -> dict[str, Tensor]:
    """`maps`, channels last, and their transport (..., K): inferred, or AO * T(normal) where normals are."""
    if "transport" in maps:
        return maps
    transport = unoccluded(maps["normal"], order)
    return {**maps, "transport": transport * maps["ao"] if "ao" in maps else transport}


def build(model: Model, size: int) -> Network:
    """A fresh network for square images of `size` pixels; its weights come from torch's generator.

    Raises UserError for a size that is no multiple of 64.
    """
    if size < STRIDE or size % STRIDE:
        raise UserError(f"the image size is {size} px: the network halves it six times, so give a multiple of {STRIDE}")
    kind = UNet if model.name == "unet" else PaperNetwork
    return kind(model, size).to(memory_format=kind.layout)
