"""A TensorFlow Lite graph, read from its file and run by torch: the few operations of small segmentation networks.

Field and operation numbers are those of the format's schema (schema.fbs of TensorFlow Lite, version 3). Tensors are
(B,C,H,W) here and (B,H,W,C) in the file; weights lie as in the file and are permuted where they are used.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from flatbuffers import number_types as numbers
from flatbuffers.table import Table
from torch import Tensor

DTYPES = {0: np.float32, 1: np.float16, 2: np.int32}
NAMES = {
    0: "ADD",
    1: "AVERAGE_POOL_2D",
    3: "CONV_2D",
    4: "DEPTHWISE_CONV_2D",
    6: "DEQUANTIZE",
    14: "LOGISTIC",
    18: "MUL",
    19: "RELU",
    23: "RESIZE_BILINEAR",
    117: "HARD_SWISH",
}
CUSTOM = 32  # the operation has a name instead of a number
BYTE, INT = numbers.Int8Flags, numbers.Int32Flags
WINDOW = {"padding": (0, BYTE), "stride_w": (1, INT), "stride_h": (2, INT)}
# Of each operation's options the number and type of those that are read.
OPTIONS = {
    "ADD": {"activation": (0, BYTE)},
    "MUL": {"activation": (0, BYTE)},
    "AVERAGE_POOL_2D": {**WINDOW, "width": (3, INT), "height": (4, INT), "activation": (5, BYTE)},
    "CONV_2D": {**WINDOW, "activation": (3, BYTE), "dilation_w": (4, INT), "dilation_h": (5, INT)},
    "DEPTHWISE_CONV_2D": {**WINDOW, "activation": (4, BYTE), "dilation_w": (5, INT), "dilation_h": (6, INT)},
    "RESIZE_BILINEAR": {"align_corners": (2, BYTE), "half_pixel_centers": (3, BYTE)},
}
ACTIVATIONS: dict[int, Callable[[Tensor], Tensor]] = {0: lambda x: x, 1: F.relu, 3: F.relu6}
SAME = 0  # padding by which a window of stride 1 keeps the size; VALID, 1, is none


@dataclass(frozen=True)
class Operation:
    """One step of a graph: inputs and outputs are tensors' numbers, options those of OPTIONS."""

    name: str
    inputs: list[int]
    outputs: list[int]
    options: dict[str, int]


@dataclass(frozen=True)
class Graph:
    """A graph with one input and one output.

    Attributes:
        constants: by the number of their tensor.
        operations: in the order in which they run.
        input: the tensor's number.
        output: the tensor's number.
    """

    constants: dict[int, Tensor]
    operations: list[Operation]
    input: int
    output: int

    @torch.inference_mode()
    def __call__(self, images: Tensor) -> Tensor:
        """Runs the graph without gradients: as `run`."""
        return self.run(images)

    def run(self, images: Tensor) -> Tensor:
        """Runs the graph, also where torch traces it.

        Args:
            images: (B,C,H,W) float32.

        Returns:
            (B,C',H',W') float32.

        Raises:
            ValueError: for an operation, or a way to pad or to resize, that is not known here.
        """
        values = {**self.constants, self.input: images}
        for each in self.operations:
            found = _run(each.name, [values[i] for i in each.inputs], each.options)
            values[each.outputs[0]] = ACTIVATIONS[each.options.get("activation", 0)](found)
        return values[self.output]


def read_graph(path: Path | str) -> Graph:
    """Reads the first graph of a .tflite file; constants stored in half precision come in single.

    Raises:
        ValueError: if it has more than one input or output.
    """
    data = Path(path).read_bytes()
    model = _Record(data, int.from_bytes(data[:4], "little"))
    names = [_name(code) for code in model.records(1)]
    graph, buffers = model.records(2)[0], model.records(4)
    constants = {}
    for i, tensor in enumerate(graph.records(0)):
        stored = buffers[tensor.number(2, numbers.Uint32Flags)].numbers(0, np.uint8)
        if len(stored):
            values = stored.view(DTYPES[tensor.number(1, BYTE)]).reshape(tensor.numbers(0, np.int32))
            constants[i] = torch.from_numpy(values.copy())
    operations = []
    for record in graph.records(3):
        name = names[record.number(0, numbers.Uint32Flags)]
        inputs, outputs = (record.numbers(field, np.int32).tolist() for field in (1, 2))
        if name == "DEQUANTIZE" and inputs[0] in constants:
            constants[outputs[0]] = constants.pop(inputs[0]).float()
        else:
            operations.append(Operation(name, inputs, outputs, _options(name, record)))
    (first,), (last,) = graph.numbers(1, np.int32).tolist(), graph.numbers(2, np.int32).tolist()
    return Graph(constants, operations, first, last)


class _Record(Table):
    """A table of the file, with its fields by their numbers."""

    def number(self, field: int, kind: type, default: int = 0) -> int:
        return self.GetSlot(4 + 2 * field, default, kind)

    def numbers(self, field: int, dtype: type) -> np.ndarray:
        place = self.Offset(4 + 2 * field)
        if not place:
            return np.empty(0, dtype)
        return np.frombuffer(self.Bytes, dtype, self.VectorLen(place), self.Vector(place))

    def records(self, field: int) -> list["_Record"]:
        place = self.Offset(4 + 2 * field)
        count = self.VectorLen(place) if place else 0
        return [_Record(self.Bytes, self.Indirect(self.Vector(place) + 4 * i)) for i in range(count)]


def _name(code: _Record) -> str:
    number = max(code.number(0, BYTE), code.number(3, INT))  # the first is of older files, and up to 127
    if number == CUSTOM:
        return code.String(code.Pos + code.Offset(4 + 2 * 1)).decode()
    return NAMES.get(number, f"number {number}")


def _options(name: str, record: _Record) -> dict[str, int]:
    if name == "Convolution2DTransposeBias":  # MediaPipe's own
        _, stride_w, stride_h = struct.unpack("<3i", record.numbers(5, np.uint8).tobytes())
        return {"stride_w": stride_w, "stride_h": stride_h}
    fields, place = OPTIONS.get(name, {}), record.Offset(4 + 2 * 4)
    if not fields or not place:
        return dict.fromkeys(fields, 0)
    options = _Record(record.Bytes, record.Indirect(record.Pos + place))
    return {key: options.number(field, kind, int(key.startswith("dilation"))) for key, (field, kind) in fields.items()}


def _run(name: str, values: list[Tensor], options: dict[str, int]) -> Tensor:
    x = values[0]
    match name:
        case "ADD":
            return x + values[1]
        case "MUL":
            return x * values[1]
        case "RELU":
            return F.relu(x)
        case "HARD_SWISH":
            return F.hardswish(x)
        case "LOGISTIC":
            return torch.sigmoid(x)
        case "AVERAGE_POOL_2D":
            size = options["height"], options["width"]
            if any(_margins(x, size, options)):
                raise ValueError("padded pooling is not known here")  # there only what lies inside is averaged
            return F.avg_pool2d(x, size, _stride(options))
        case "CONV_2D":
            return _convolved(x, values[1].permute(0, 3, 1, 2), values[2], options)
        case "DEPTHWISE_CONV_2D":
            return _convolved(x, values[1].permute(3, 0, 1, 2), values[2], options, groups=x.shape[1])
        case "Convolution2DTransposeBias":
            weight = values[1].permute(3, 0, 1, 2)
            if tuple(weight.shape[2:]) != _stride(options):
                raise ValueError("a transposed convolution whose windows overlap is not known here")
            return F.conv_transpose2d(x, weight, values[2], _stride(options))
        case "RESIZE_BILINEAR":
            if not options["align_corners"] and not options["half_pixel_centers"]:
                raise ValueError("resizing by pixels' corners is not known here")
            height, width = values[1].tolist()
            return F.interpolate(x, (height, width), mode="bilinear", align_corners=bool(options["align_corners"]))
    raise ValueError(f"operation {name} is not known here")


def _convolved(x: Tensor, weight: Tensor, bias: Tensor, options: dict[str, int], groups: int = 1) -> Tensor:
    dilation = options["dilation_h"], options["dilation_w"]
    reach = [(n - 1) * d + 1 for n, d in zip(weight.shape[2:], dilation)]
    padded = F.pad(x, _margins(x, reach, options))
    return F.conv2d(padded, weight, bias, _stride(options), dilation=dilation, groups=groups)


def _margins(x: Tensor, size: Sequence[int], options: dict[str, int]) -> list[int]:
    """Returns padding SAME (left, right, above, below) for a window of `size` (rows, columns).

    An odd pixel goes to the right, or below.
    """
    margins = []
    for length, window, stride in zip(x.shape[:1:-1], size[::-1], _stride(options)[::-1]):
        missing = max((-(-length // stride) - 1) * stride + window - length, 0) if options["padding"] == SAME else 0
        margins += [missing // 2, missing - missing // 2]
    return margins


def _stride(options: dict[str, int]) -> tuple[int, int]:
    return options["stride_h"], options["stride_w"]
