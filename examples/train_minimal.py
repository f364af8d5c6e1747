"""The paper's method in one file: relights figures, trains the paper's network on them, and draws what it learned.

The data are a packed set of figures (mask, albedo and light transport per pixel) and a set of lights. To make both for
twelve figures takes about two CPU-minutes, the training below less than two more:

    relight run scale=smoke name=minimal figures.count=12 bake.size=128 --target results/minimal/packed.safetensors \
        --target results/minimal/lights/lights.npz
    python examples/train_minimal.py results/minimal

After `make`, results/demo has thirty figures of the same size, and OMP_NUM_THREADS=1 saves time on a busy machine.
`relight run` trains the same network with more figures, checkpoints, validation and tables (docs/training.md).
"""

import argparse
import itertools
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image
from torch import nn

from relight.maps import PackedMaps

K = 9  # coefficients of spherical harmonics up to order 2
ENCODER = (64, 128, 256, 512, 512, 512)  # channels at 1/2 to 1/64 of the size, at width 1
DECODER = (512, 512, 256, 128, 64)  # channels at 1/32 to 1/2 of the size, at width 1
LIGHT = (512, 256, 128)  # channels of the light's layers, at width 1
HALVING, SAME_SIZE, POINTWISE = (4, 2, 1), (3, 1, 1), (1, 1, 0)  # kernel, stride and padding of convolutions


def shade(transport, light):
    """Returns the shading (B,3,S,S) of transport (B,K,S,S) under lights (B,K,3): one dot product per pixel."""
    return torch.einsum("bkhw,bkc->bchw", transport, light).clamp(0, 10)


class Step(nn.Sequential):
    """A convolution, and batch norm unless one pixel is left: that pixel would be its own mean."""

    def __init__(self, conv, inputs, outputs, shape, side):
        """Makes the layers: `conv` is the class, `shape` kernel, stride and padding, `side` that of the output."""
        layers = [conv(inputs, outputs, *shape, bias=side == 1)]
        super().__init__(*layers, *([] if side == 1 else [nn.BatchNorm2d(outputs)]))


class Decoder(nn.Module):
    """A residual block, then six deconvolutions; all but the last get the encoder's features of their size, too."""

    def __init__(self, encoder, decoder, outputs, side):
        """Makes the layers: channels of encoder, decoder and output, and side of the encoder's last features."""
        super().__init__()
        inputs = encoder[-1]
        self.first = Step(nn.Conv2d, inputs, inputs, SAME_SIZE, side)
        self.second = Step(nn.Conv2d, inputs, inputs, SAME_SIZE, side)
        self.up = nn.ModuleList()
        for width, skip in zip(decoder, reversed(encoder[:-1])):
            side *= 2
            self.up.append(Step(nn.ConvTranspose2d, inputs, width, HALVING, side))
            inputs = width + skip
        self.last = nn.ConvTranspose2d(inputs, outputs, *HALVING)

    def forward(self, features):
        """Returns the residual block's output (B,C,s,s) and the image, of the encoder's features, largest first."""
        residual = x = features[-1] + self.second(F.relu(self.first(features[-1])))
        for level, (up, skip) in enumerate(zip(self.up, reversed(features[:-1]))):
            x = up(x)
            x = F.dropout(x, 0.5, self.training) if level < 3 else x
            x = torch.cat([F.relu(x), skip], 1)
        return residual, self.last(x)


class Network(nn.Module):
    """From an image and its mask to albedo, transport and light (paper, section 5)."""

    def __init__(self, size, width):
        """Makes the layers for images of a size in pixels, with `width` times the paper's channels."""
        super().__init__()
        encoder, decoder, head = ([round(width * c) for c in sizes] for sizes in (ENCODER, DECODER, LIGHT))
        side, inputs = size // 2, encoder[0]
        self.encoder = nn.ModuleList([nn.Conv2d(3, inputs, *HALVING)])
        for outputs in encoder[1:]:
            side //= 2
            self.encoder.append(Step(nn.Conv2d, inputs, outputs, HALVING, side))
            inputs = outputs
        self.transport, self.albedo = (Decoder(encoder, decoder, outputs, side) for outputs in (K, 3))
        inputs *= 3  # the encoder's last features and those of both residual blocks
        self.light = nn.ModuleList()
        for outputs in head:
            shape, side = (HALVING, side // 2) if side > 1 else (POINTWISE, 1)
            self.light.append(Step(nn.Conv2d, inputs, outputs, shape, side))
            inputs = outputs
        self.last = nn.Conv2d(inputs, 3 * K, *(HALVING if side > 1 else POINTWISE))
        for module in self.modules():  # N(0, .02), but He's rule where a small image leaves few inputs
            if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
                nn.init.normal_(module.weight, 0, 0.02)
        for decoder in (self.transport, self.albedo):
            nn.init.kaiming_normal_(decoder.first[0].weight)
            nn.init.kaiming_normal_(decoder.second[0].weight)
        for layer in self.light:
            nn.init.kaiming_normal_(layer[0].weight, a=0.2)

    def forward(self, image, mask):
        """Returns albedo (B,3,S,S), transport (B,K,S,S) and light (B,K,3) of images (B,3,S,S) and masks (B,1,S,S)."""
        x, features = (2 * image - 1) * mask, []
        for layer in self.encoder:
            x = F.leaky_relu(layer(x), 0.2)
            features.append(x)
        from_transport, transport = self.transport(features)
        from_albedo, albedo = self.albedo(features)
        x = torch.cat([x, from_transport, from_albedo], 1)
        for layer in self.light:
            x = F.leaky_relu(layer(x), 0.2)
        light = self.last(x).mean((2, 3)).unflatten(1, (K, 3))
        albedo = albedo + (albedo.clamp(0, 1) - albedo).detach()  # clipped; the gradient is that of unclipped values
        return albedo * mask, transport * mask, light


def variation(x, mask):
    """Returns the mean of |dx| + |dy| of images x (B,C,S,S), of pixels whose four neighbours are in the mask."""
    outside = 1 - F.pad(mask, (1, 1, 1, 1))
    beside, above = F.max_pool2d(outside, (1, 3), 1)[..., 1:-1, :], F.max_pool2d(outside, (3, 1), 1)[..., 1:-1]
    inner = 1 - torch.maximum(beside, above)
    dx, dy = x.diff(dim=3, append=x[..., -1:]), x.diff(dim=2, append=x[..., -1:, :])
    return ((dx.abs() + dy.abs()) * inner).mean()


def loss(inferred, truth, mask):
    """Returns the paper's loss: the sum of fifteen L1 errors (section 4).

    `inferred` and `truth` are albedo, transport and light: each is compared, and so are all shadings and images that
    can be made of both.
    """
    total = sum(F.l1_loss(x, y) for x, y in zip(inferred, truth))  # albedo, transport, light
    total = total + variation(inferred[0], mask) + variation(inferred[1], mask) * mask.shape[-1] / 1024
    shading = shade(*truth[1:])
    for transport, light in itertools.product(*zip(truth[1:], inferred[1:])):
        if not (transport is truth[1] and light is truth[2]):
            total = total + F.l1_loss(shade(transport, light), shading)
    for albedo, transport, light in itertools.product(*zip(truth, inferred)):
        if not (albedo is truth[0] and transport is truth[1] and light is truth[2]):
            total = total + F.l1_loss(albedo * shade(transport, light), truth[0] * shading)
    return total


def read_data(folder):
    """Returns masks (F,1,S,S), albedos (F,3,S,S) and transports (F,K,S,S) of the figures, and lights (N,K,3)."""
    packed = PackedMaps(folder / "packed.safetensors")
    dense = torch.zeros(len(packed), 1 + 3 + K, packed.size**2)  # mask, albedo and transport of all pixels
    for i in range(len(packed)):
        figure = packed.figure(i)
        ones = np.ones((len(figure["pixel"]), 1))
        values = np.concatenate([ones, figure["albedo"], figure["transport"][:, :K]], 1)
        dense[i, :, figure["pixel"]] = torch.from_numpy(values.T.astype(np.float32))
    mask, albedo, transport = dense.unflatten(2, (packed.size, packed.size)).split([1, 3, K], 1)
    return mask, albedo, transport, torch.from_numpy(np.load(folder / "lights" / "lights.npz")["coefficients"])[:, :K]


def train(network, mask, albedo, transport, lights, steps, batch=4, peak=2e-3):
    """Trains by Adam with a short warm-up and a cosine schedule; every step draws figures and lights anew.

    Masks, albedos, transports and lights are those of `read_data`; `peak` is the largest learning rate.
    """
    optimizer = torch.optim.Adam(network.parameters(), peak)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, peak, total_steps=steps, pct_start=0.1)
    for step in range(steps):
        figure, light = torch.randint(len(mask), (batch,)), lights[torch.randint(len(lights), (batch,))]
        truth = albedo[figure], transport[figure], light
        error = loss(network(truth[0] * shade(*truth[1:]), mask[figure]), truth, mask[figure])
        optimizer.zero_grad()
        error.backward()
        optimizer.step()
        schedule.step()
        if step % 25 == 0 or step == steps - 1:
            print(f"step {step:4d}  loss {error.item():.3f}")


@torch.no_grad()
def relit(network, mask, albedo, transport, light, other):
    """Returns, side by side: the image, inferred albedo and shading, relit by `other`, and the truth (3,S,5S).

    Mask, albedo and transport are those of one figure, (1,...); it is seen under `light`.
    """
    image, truth = albedo * shade(transport, light), albedo * shade(transport, other)
    inferred_albedo, inferred_transport, inferred_light = network.eval()(image, mask)
    shading = shade(inferred_transport, inferred_light)
    result = inferred_albedo * shade(inferred_transport, other)

    def error(picture):
        """Returns the root of the squared error, summed over the channels, per pixel of the mask."""
        return ((picture - truth).square().sum() / mask.sum()).sqrt().item()

    print(f"error of the relit figure {error(result):.3f}; of its image, not relit, {error(image):.3f}")
    return torch.cat([(x + 1 - mask)[0] for x in (image, inferred_albedo, shading / 2, result, truth)], 2)


def main():
    """Reads the data, trains, and draws two figures that the network has not seen."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="results of relight run, such as results/minimal")
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--width", type=float, default=0.25, help="of the network, relative to the paper's")
    parser.add_argument("--out", type=Path, default=Path("minimal.png"))
    options = parser.parse_args()
    torch.manual_seed(0)
    mask, albedo, transport, lights = read_data(options.folder)
    network = Network(mask.shape[-1], options.width)
    size = sum(p.numel() for p in network.parameters())
    print(f"{len(mask)} figures, {len(lights)} lights with the unusual ones, {size:,} parameters")
    lights = lights[lights[:, 3].sum(1).argsort()]  # by L_11, from the left to the right
    train(network, mask[2:], albedo[2:], transport[2:], lights[1:-1], options.steps)
    ends = lights[[0, -1]]  # two figures and two lights are new to the network
    rows = [relit(network, *(x[i, None] for x in (mask, albedo, transport, ends, ends.flip(0)))) for i in range(2)]
    pixels = torch.cat(rows, 1).clamp(0, 1).permute(1, 2, 0) ** (1 / 2.2)
    Image.fromarray((255 * pixels).round().byte().numpy()).save(options.out)
    print(f"{options.out}: image, albedo, shading, relit, truth, of the two figures that were held out")


if __name__ == "__main__":
    main()
