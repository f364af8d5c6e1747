"""The network for other programs, as ONNX or torch.export, checked against torch."""

import copy
import logging
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.export import Dim

from relight.files import UserError, atomic_write
from relight.learning.networks import STRIDE, InstanceNorm, Network, Refinement, with_transport
from relight.photos import selfie
from relight.photos.tflite import Graph

INPUTS = ["image", "mask"]
OUTPUTS = ["albedo", "transport", "light"]
TOLERANCE = 2e-4  # largest difference between runtimes, of values of about 1
HALF_TOLERANCE = 5e-3  # the same where weights are rounded to half precision
LARGE = 256  # numbers in a constant from which it is stored in half precision


class Exported(nn.Module):
    """The network with tensors out: image (B,3,H,W) linear in [0,1] and mask (B,1,H,W) to albedo (B,3,H,W),
    transport (B,K,H,W), light (B,K,3); maps are zero outside the mask. H and W are multiples of 64.
    """

    def __init__(self, network: Network):
        super().__init__()
        network = copy.deepcopy(network)
        _open_sized(network)
        self.network, self.order = network.eval(), network.order

    def forward(self, image: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        maps = self.network(image, mask)
        return *finished(maps, mask, self.order), maps["light"]


def finished(maps: dict[str, Tensor], mask: Tensor, order: int) -> tuple[Tensor, Tensor]:
    """Returns the albedo (B,3,H,W) and transport (B,K,H,W) of a network's maps, zero outside the mask."""
    maps = with_transport({name: maps[name].permute(0, 2, 3, 1) for name in maps if name != "light"}, order)
    return maps["albedo"].permute(0, 3, 1, 2) * mask, maps["transport"].permute(0, 3, 1, 2) * mask


class OpenRefinement(nn.Module):
    """Refinement for every size, and with elimination in place of a solver that ONNX does not have.

    The system is symmetric and positive definite, so that elimination needs no pivots.
    """

    def __init__(self, refinement: Refinement):
        super().__init__()
        self.refinement = refinement

    def forward(self, light: Tensor, albedo: Tensor, transport: Tensor, image: Tensor, mask: Tensor) -> Tensor:
        """Returns the refined light (B,K,3), as `Refinement.forward` does."""
        mask = mask * _thinning(*image.shape[-2:])
        left, right = self.refinement.normal_equations(light, albedo, transport, image, mask)
        system = torch.cat([left, right[..., None]], -1)
        for k in range(3 * len(self.refinement.trust)):
            row = system[:, k : k + 1] / system[:, k : k + 1, k : k + 1]
            others = system - system[..., k : k + 1] * row
            system = torch.cat([others[:, :k], row, others[:, k + 1 :]], 1)
        return system[..., -1].view(-1, 3, len(self.refinement.trust)).mT


def _thinning(height: int, width: int) -> Tensor:
    """Returns (H,W): 1 at the pixels that Refinement keeps of an image, 0 elsewhere."""
    rows, columns = torch.arange(height), torch.arange(width)
    every = ((columns[-1] + 1) // Refinement.SIDE).clamp_min(1)  # a tensor: ONNX knows no arithmetic with open sizes
    return (rows % every == 0).float()[:, None] * (columns % every == 0).float()


def export(network: Network, path: Path | str, half: bool = False) -> float:
    """Writes `network` as .onnx or .pt2 (torch.export) with batch, height and width left open.

    Args:
        network: in evaluation mode.
        path: the file.
        half: weights are stored in half precision, which halves an .onnx file; computation stays in single.

    Returns:
        The largest difference from torch at batches and sizes that the export has not seen.

    Raises:
        UserError: for another suffix, a missing package, or half precision of a .pt2.
    """
    path = Path(path)
    if half and path.suffix != ".onnx":
        raise UserError(f"export {path}: only .onnx is written in half precision")
    if path.suffix not in (".onnx", ".pt2"):
        raise UserError(f"export {path}: the name must end in .onnx or .pt2 (torch.export)")
    model = Exported(network)
    inputs = sample(2, least(network), least(network) + STRIDE)
    batch, height, width = Dim("batch", min=1, max=64), Dim("h", min=1, max=64), Dim("w", min=1, max=64)
    shape = {0: batch, 2: STRIDE * height, 3: STRIDE * width}
    with warnings.catch_warnings(), atomic_write(path) as tmp:
        warnings.simplefilter("ignore")  # the exporters' own, about their internals
        program = torch.export.export(model, inputs, dynamic_shapes=(shape, shape))
        if path.suffix == ".onnx":
            _write_onnx(program, tmp, INPUTS, OUTPUTS)
            if half:
                halve(tmp)
        else:
            torch.export.save(program, tmp)
        return check(network, tmp, HALF_TOLERANCE if half else TOLERANCE)


def check(network: Network, path: Path, tolerance: float = TOLERANCE) -> float:
    """Returns the largest difference between the file's outputs and the network's, at two shapes new to the export.

    Raises RuntimeError when it is above `tolerance`.
    """
    run = _onnx_runner(path) if path.suffix == ".onnx" else torch.export.load(path).module()
    worst, size = 0.0, least(network)
    for shape in ((1, size, size), (3, size + STRIDE, size)):
        image, mask = sample(*shape)
        with torch.inference_mode():
            maps = network(image, mask)
            expected = *finished(maps, mask, network.order), maps["light"]
            got = run(image, mask)
        worst = max(worst, *(float((a - torch.as_tensor(b)).abs().max()) for a, b in zip(expected, got)))
    if worst > tolerance:
        raise RuntimeError(f"{path} differs from torch by {worst:.1e}")
    return worst


def least(network: Network) -> int:
    """Returns the smallest side that the network can take. Its bottleneck must have more than one pixel."""
    return max(network.size, 2 * STRIDE)


def sample(batch: int, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Returns an image and a mask of the right kind, always the same ones."""
    rng = np.random.default_rng(batch * height + width)
    image = torch.from_numpy(rng.random((batch, 3, height, width), np.float32))
    mask = torch.zeros(batch, 1, height, width)
    mask[:, :, height // 8 : -height // 8, width // 4 : -width // 4] = 1
    return image, mask


def _open_sized(module: nn.Module) -> None:
    """Replaces the layers that have a size, or what ONNX has not, in place."""
    for name, child in module.named_children():
        if isinstance(child, InstanceNorm):
            norm = nn.InstanceNorm2d(len(child.weight), affine=True)
            norm.weight, norm.bias = child.weight, child.bias
            setattr(module, name, norm)
        elif isinstance(child, Refinement):
            setattr(module, name, OpenRefinement(child))
        else:
            _open_sized(child)


def _write_onnx(
    program: torch.export.ExportedProgram, path: Path, inputs: Sequence[str], outputs: Sequence[str]
) -> None:
    try:
        import onnxscript  # noqa: F401  (torch's exporter writes through it)
    except ImportError:
        raise UserError("export to ONNX needs more packages: pip install 'relight[export]'") from None
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    onnx = torch.onnx.export(program, input_names=inputs, output_names=outputs, dynamo=True, verbose=False)
    assert onnx is not None  # as it is where dynamo=False
    onnx.save(str(path), external_data=False)


class _Graph(nn.Module):
    def __init__(self, graph: Graph):
        super().__init__()
        self.graph = graph

    def forward(self, images: Tensor) -> Tensor:
        return self.graph.run(images)


def export_mask_network(path: Path) -> None:
    """Writes the network of the built-in mask as .onnx: `images` (2,3,256,256) in [0,1] to `masks` (2,1,256,256).

    Raises:
        UserError: if it is not set up, or a package is missing.
    """
    images = torch.rand(2, 3, selfie.SIDE, selfie.SIDE)
    with warnings.catch_warnings(), atomic_write(path) as tmp:
        warnings.simplefilter("ignore")
        program = torch.export.export(_Graph(selfie.load_network()), (images,))
        _write_onnx(program, tmp, ["images"], ["masks"])


def halve(path: Path) -> None:
    """Stores the large constants of an .onnx file in half precision; they are cast back when it is loaded."""
    import onnx

    model = onnx.load(path)
    casts = []
    for constant in model.graph.initializer:
        values = onnx.numpy_helper.to_array(constant)
        if values.dtype == np.float32 and values.size >= LARGE:
            name = constant.name
            constant.CopyFrom(onnx.numpy_helper.from_array(values.astype(np.float16), f"{name}.half"))
            casts.append(onnx.helper.make_node("Cast", [f"{name}.half"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    onnx.save(model, path)


def _onnx_runner(path: Path):
    try:
        import onnxruntime
    except ImportError:
        raise UserError("checking the ONNX file needs onnxruntime: pip install 'relight[export]'") from None
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    return lambda image, mask: session.run(OUTPUTS, {"image": image.numpy(), "mask": mask.numpy()})
