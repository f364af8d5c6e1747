"""A network as `relight photo` runs it: one graph from image and mask to maps and light, in torch or as an .onnx file.

The weights keep the names of the checkpoint and no two layers are fused, so a training can start from the file
(`train.start`). They are stored in half precision; the computation is in single precision.
"""

import copy
import json
import logging
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.export import Dim

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.learning.checkpoint import HALF, PREFIX
from relight.learning.harmonics import mirror_signs
from relight.learning.networks import STRIDE, InstanceNorm, Network, Refinement
from relight.photos.network import INPUTS, METADATA, OUTPUTS, read_network

TOLERANCE = 5e-3  # largest difference between the file and torch, of values of about 1: weights are rounded
LARGE = 256  # numbers in a constant from which it is stored in half precision
# Pixels along the silhouette whose maps are clamped, since the network sees least and errs most there.
NEIGHBOURHOOD = 5  # side of the square in which the inside near such a pixel is searched
SLACK = 0.5  # how far a value may leave the range of the inside, over that range: gradients continue to the silhouette


class PhotoGraph(nn.Module):
    """The mean of what a network infers from an image and from its mirror image, with clamped rims.

    Inputs are image (B,3,H,W) linear in [0,1] and mask (B,1,H,W) of 0 and 1, outputs are albedo (B,3,H,W), transport
    (B,K,H,W) and light (B,K,3); maps are zero outside the mask. H and W are multiples of 64.
    """

    signs: Tensor

    def __init__(self, network: Network):
        super().__init__()
        self.network = network.eval()
        self.register_buffer("signs", mirror_signs(network.order), persistent=False)

    def forward(self, image: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Averages what the network infers of an image (B,3,H,W), linear in [0,1], and of its mirror image.

        It is albedo (B,3,H,W) and transport (B,K,H,W), 0 outside the mask (B,1,H,W), and light (B,K,3).
        """
        maps = self.network(torch.cat([image, image.flip(3)]), torch.cat([mask, mask.flip(3)]))
        n, albedo, transport, light = image.shape[0], maps["albedo"], self.network.transport(maps), maps["light"]
        albedo = (albedo[:n] + albedo[n:].flip(3)) / 2
        transport = (transport[:n] + self.signs[:, None, None] * transport[n:].flip(3)) / 2
        light = (light[:n] + self.signs[:, None] * light[n:]) / 2
        return clamp_rim(albedo, mask) * mask, clamp_rim(transport, mask) * mask, light


def clamp_rim(maps: Tensor, mask: Tensor) -> Tensor:
    """Clamps the outermost pixels of a figure to the range of the inside next to them.

    Values may leave that range by SLACK of it, so a gradient toward the silhouette continues and an outlier does not
    stand out. Parts as thin as the rim, such as fingers, keep their values.

    Args:
        maps: (B,C,H,W).
        mask: (B,1,H,W) of 0 and 1.

    Returns:
        (B,C,H,W).
    """
    padded = F.pad(mask, (1, 1, 1, 1))
    inside = -F.max_pool2d(-padded, (3, 1), 1)[..., 1:-1] * -F.max_pool2d(-padded, (1, 3), 1)[..., 1:-1, :]
    far = 1e6 * (1 - inside)
    radius = NEIGHBOURHOOD // 2
    high = F.max_pool2d(maps - far, NEIGHBOURHOOD, 1, radius)
    low = -F.max_pool2d(-maps - far, NEIGHBOURHOOD, 1, radius)
    slack = SLACK * (high - low)
    clamped = torch.minimum(torch.maximum(maps, low - slack), high + slack)
    return torch.where((mask - inside > 0.5) & (high > low - 1), clamped, maps)


class OpenRefinement(Refinement):
    """Refinement for every size, and with Newton's iteration for the inverse (Schulz 1933) in place of a solver.

    ONNX has none, and elimination takes hundreds of nodes, which are slow to load. The system is symmetric and positive
    definite. With a diagonal of ones its condition is about 6, and the steps suffice for 3,000.
    """

    STEPS = 16

    def __init__(self, refinement: Refinement):
        super().__init__(len(refinement.trust), refinement.rescale)
        self.load_state_dict(refinement.state_dict())

    def forward(self, light: Tensor, albedo: Tensor, transport: Tensor, image: Tensor, mask: Tensor) -> Tensor:
        """Returns the refined light, the solution of the normal equations."""
        rows, columns = torch.arange(image.shape[2]), torch.arange(image.shape[3])  # of open sizes: no arithmetic
        kept = columns % ((rows[-1] + 1) // self.SIDE) == 0
        seen = albedo, transport, image, mask * kept
        albedo, transport, image, mask = (x.unflatten(2, (self.SIDE, -1))[:, :, :, 0] for x in seen)
        left, right = self.normal_equations(light, albedo, transport, image, mask)
        eye = torch.eye(3 * len(self.trust))
        scale = (left * eye).sum(-1).rsqrt()
        left = scale[:, :, None] * left * scale[:, None]
        inverse = eye / left.abs().sum(-1).amax(-1)[:, None, None]
        for _ in range(self.STEPS):  # each squares the error
            inverse = 2 * inverse - inverse @ left @ inverse
        solution = scale * (inverse @ (scale * right)[..., None])[..., 0]
        return solution.view(-1, 3, len(self.trust)).mT


def export(network: Network, path: Path | str, config: dict[str, Any]) -> float:
    """Writes a network as .onnx with batch, height and width left open.

    Args:
        network: any.
        path: the file.
        config: plain values to store in the header, with the settings `model`; `size` is added.

    Returns:
        The largest difference from torch at batches and sizes that the export has not seen.

    Raises:
        UserError: for another suffix, a missing package, or a network that torch cannot export for any batch and size.
    """
    path = Path(path)
    if path.suffix != ".onnx":
        raise UserError(f"export {path}: the name must end in .onnx")
    graph = PhotoGraph(_open_sized(copy.deepcopy(network)))
    inputs = sample_inputs(2, smallest_side(network), smallest_side(network) + STRIDE)
    batch, height, width = Dim("batch", min=1, max=64), Dim("h", min=1, max=64), Dim("w", min=1, max=64)
    shape = {0: batch, 2: STRIDE * height, 3: STRIDE * width}
    with warnings.catch_warnings(), atomic_write(path) as tmp:
        warnings.simplefilter("ignore")  # the exporters' own, about their internals
        from onnxscript.optimizer import fold_constants, remove_unused_nodes

        try:
            program = torch.export.export(graph, inputs, dynamic_shapes=(shape, shape))
        except RuntimeError as error:
            reason = str(error).strip().split("\n")[0]
            raise UserError(
                f"this network cannot be exported for any batch and size ({reason}): its code must take numbers from "
                "shapes as x.shape[0], not as len(x)"
            ) from None
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        onnx = torch.onnx.export(
            program, input_names=INPUTS, output_names=OUTPUTS, dynamo=True, optimize=False, verbose=False
        )
        assert onnx is not None  # as it is where dynamo=False

        # All that torch.onnx would do to the graph but to fuse layers and to compute with weights.
        def should_fold(node: Any) -> bool | None:
            reads_weights = any(value is not None and value.name.startswith(PREFIX) for value in node.inputs)
            return False if reads_weights else None

        fold_constants(onnx.model, should_fold=should_fold)
        remove_unused_nodes(onnx.model)
        onnx.save(str(tmp), external_data=False)
        _finish(tmp, {"size": network.size, **config})
        return check(network, tmp)


def check(network: Network, path: Path) -> float:
    """Compares an .onnx file with torch, at two shapes new to the export.

    Args:
        network: that was exported.
        path: the file.

    Returns:
        The largest difference between their outputs.

    Raises:
        RuntimeError: if it is above TOLERANCE.
    """
    graph, run = PhotoGraph(network), read_network(path).run
    worst, size = 0.0, smallest_side(network)
    for shape in ((1, size, size), (3, size + STRIDE, size)):
        image, mask = sample_inputs(*shape)
        with torch.inference_mode():
            expected = graph(image, mask)
        result = run(image.numpy(), mask.numpy())
        worst = float(np.max([worst, *(np.abs(a.numpy() - b).max() for a, b in zip(expected, result))]))
    if not worst <= TOLERANCE:  # nor NaN
        raise RuntimeError(f"{path} differs from torch by {worst:.1e}")
    return worst


def smallest_side(network: Network) -> int:
    """Returns the smallest side that the network can take. Its bottleneck must have more than one pixel."""
    return max(network.size, 2 * STRIDE)


def sample_inputs(batch: int, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Returns an image (batch,3,height,width) linear in [0,1] and a mask (batch,1,height,width) of a rectangle.

    Sizes are in pixels. The same sizes give the same values.
    """
    rng = np.random.default_rng(batch * height + width)
    image = torch.from_numpy(rng.random((batch, 3, height, width), np.float32))
    mask = torch.zeros(batch, 1, height, width)
    mask[:, :, height // 8 : -height // 8, width // 4 : -width // 4] = 1
    return image, mask


def _open_sized(network: Network) -> Network:
    """Replaces the layers that have a size, or what ONNX has not, in place."""
    for module in list(network.modules()):
        for name, child in module.named_children():
            if isinstance(child, InstanceNorm):
                norm = nn.InstanceNorm2d(len(child.weight), affine=True)
                norm.weight, norm.bias = child.weight, child.bias
                setattr(module, name, norm)
            elif isinstance(child, Refinement):
                setattr(module, name, OpenRefinement(child))
    return network


def _finish(path: Path, config: dict[str, Any]) -> None:
    """Stores the large constants of an .onnx file in half precision, cast back when it is loaded, and the config."""
    import onnx

    model = onnx.load(path)
    casts = []
    for constant in model.graph.initializer:
        values = onnx.numpy_helper.to_array(constant)
        if values.dtype == np.float32 and values.size >= LARGE:
            name = constant.name
            constant.CopyFrom(onnx.numpy_helper.from_array(values.astype(np.float16), f"{name}{HALF}"))
            casts.append(onnx.helper.make_node("Cast", [f"{name}{HALF}"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    for node in nodes:  # the exporter notes from which line of which file a node comes
        del node.metadata_props[:]
    del model.graph.node[:], model.graph.value_info[:]
    model.graph.node.extend(nodes)
    onnx.helper.set_model_props(model, {METADATA: json.dumps(config)})
    onnx.save(model, path)
