"""Converts the TensorFlow Lite graphs of the built-in masks to .onnx: the operations and options they have, no others.

Field and operation numbers are those of the formats' schemas (schema.fbs of TensorFlow Lite, version 3; onnx.proto).
Tensors are (B,C,H,W) in the .onnx and (B,H,W,C) in the .tflite.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from flatbuffers import number_types as numbers
from flatbuffers.table import Table

VTABLE_HEADER = 4  # bytes: a vtable has two sizes, then an offset of two bytes for each field
DTYPES = {0: np.float32, 1: np.float16, 2: np.int32}
INDICES = {1: np.int32, 2: np.uint16, 3: np.uint8}  # types of the indices of sparse matrices
CUSTOM = 32  # the operation has a name instead of a number
CONCATENATE, CONV, DEPTHWISE, TO_SPACE, DEQUANTIZE, MAX_POOL = "2", "3", "4", "5", "6", "17"
RESHAPE, RESIZE, PAD, DENSIFY, TRANSPOSED = "22", "23", "34", "124", "Convolution2DTransposeBias"
# Operations by number; averages are over the whole image.
SIMPLE = {"0": "Add", "1": "GlobalAveragePool", "14": "Sigmoid", "18": "Mul", "19": "Relu", "117": "HardSwish"}
FUSED = {"0": 0, "18": 0, CONCATENATE: 1, CONV: 3, DEPTHWISE: 4, MAX_POOL: 5}  # option that names what follows
RELU, RELU6 = 1, 3
BYTE, INT = numbers.Int8Flags, numbers.Int32Flags
PADDING = {0: "SAME_UPPER", 1: "VALID"}
OPSET, IR_VERSION = 18, 8
FLOAT, INT64 = 1, 7  # types of tensors in ONNX
ATTRIBUTES = {int: (3, 2), str: (4, 3), list: (8, 7)}  # field and type of an attribute's value


def convert(data: bytes, names: Sequence[str] = ("mask",), mirrored: bool = True) -> bytes:
    """Converts the first graph of a .tflite file's content, with one input, to a model in ONNX.

    Args:
        data: the file's content.
        names: of the first outputs, which are kept. Those of rank 4 become (1,C',H',W').
        mirrored: whether the model returns the mean of what the graph, of one output, returns for the image and for
            its mirror image.

    Returns:
        A model that takes `image` (1,C,H,W) float32.

    Raises:
        ValueError: for an operation that is not known here, and for several inputs.
    """
    model = _Record(data, int.from_bytes(data[:4], "little"))
    operations = [_name(code) for code in model.records(1)]
    graph, buffers = model.records(2)[0], model.records(4)
    (first,), lasts = graph.numbers(1, np.int32).tolist(), graph.numbers(2, np.int32).tolist()
    tensors = graph.records(0)
    constants = {}
    for i, tensor in enumerate(tensors):
        stored = buffers[tensor.number(2, numbers.Uint32Flags)].numbers(0, np.uint8)
        if len(stored):
            values, shape = stored.view(DTYPES[tensor.number(1, BYTE)]), tensor.numbers(0, np.int32)
            constants[i] = _dense(tensor.record(6), values, shape) if tensor.has(6) else values.reshape(shape)
    writer = _Writer(constants)
    if mirrored:
        writer.node("Concat", ["image", writer.flipped("image")], str(first), axis=0)
    else:
        writer.node("Identity", ["image"], str(first))
    for record in graph.records(3):
        name = operations[record.number(0, numbers.Uint32Flags)]
        inputs, outputs = (record.numbers(field, np.int32).tolist() for field in (1, 2))
        if name in (DEQUANTIZE, DENSIFY):
            constants[outputs[0]] = constants.pop(inputs[0]).astype(np.float32)
        else:
            writer.operation(name, inputs, str(outputs[0]), record)
    for name, last in zip(names, lasts):
        if mirrored:
            writer.node("Split", [str(last)], "straight", "mirrored", axis=0, num_outputs=2)
            writer.node("Mean", ["straight", writer.flipped("mirrored")], name)
        else:
            writer.node("Identity", [str(last)], name)
    _, height, width, channels = tensors[first].numbers(0, np.int32).tolist()
    return writer.model([1, channels, height, width], names)


class _Writer:
    """Collects the nodes and constants of an ONNX graph.

    Attributes:
        constants: those of the .tflite file, by the number of the tensor.
        nodes, initializers: what was added, as Protocol Buffers; constants by their names.
    """

    def __init__(self, constants: dict[int, np.ndarray]):
        self.constants = constants
        self.nodes: list[bytes] = []
        self.initializers: dict[str, bytes] = {}

    def operation(self, name: str, inputs: list[int], output: str, record: "_Record") -> None:
        """Adds an operation of the .tflite file; ValueError if it is not known here."""
        image = str(inputs[0])
        options: Any = record.record(4) if record.has(4) else None
        activation = options.number(FUSED[name], BYTE) if options and name in FUSED else 0
        if activation:
            output, fused = f"{output}.linear", output
        if name in SIMPLE:
            self.node(SIMPLE[name], list(map(str, inputs)), output)
        elif name in (CONV, DEPTHWISE):
            axes, group = ((0, 3, 1, 2), 1) if name == CONV else ((3, 0, 1, 2), self.constants[inputs[1]].shape[3])
            self.node("Conv", [image, *self._weights(inputs, axes)], output, group=group, **_window(options))
        elif name == MAX_POOL:
            size = [options.number(4, INT), options.number(3, INT)]
            self.node("MaxPool", [image], output, kernel_shape=size, **_window(options))
        elif name == TRANSPOSED:  # MediaPipe's own; its windows do not overlap
            strides = list(self.constants[inputs[1]].shape[1:3])
            self.node("ConvTranspose", [image, *self._weights(inputs, (3, 0, 1, 2))], output, strides=strides)
        elif name == RESIZE:
            sizes = self.constant(self.constants[inputs[1]].astype(np.int64), f"{output}.sizes")
            self.node("Resize", [image, "", "", sizes], output, mode="linear", axes=[2, 3])
        elif name == PAD:
            pads = self.constants[inputs[1]][[0, 3, 1, 2]].T.ravel().astype(np.int64)
            self.node("Pad", [image, self.constant(pads, f"{output}.pads")], output)
        elif name == TO_SPACE:
            self.node("DepthToSpace", [image], output, blocksize=options.number(0, INT))
        elif name == RESHAPE:  # of (B,H,W,C)
            self.node("Transpose", [image], f"{output}.last", perm=[0, 2, 3, 1])
            shape = self.constant(self.constants[inputs[1]].astype(np.int64), f"{output}.shape")
            self.node("Reshape", [f"{output}.last", shape], output)
        elif name == CONCATENATE:  # of what was reshaped
            self.node("Concat", list(map(str, inputs)), output, axis=options.number(0, INT))
        else:
            raise ValueError(f"operation {name} is not known here")
        if activation == RELU:
            self.node("Relu", [output], fused)
        elif activation == RELU6:
            bounds = [self.constant(np.float32(bound), f"{output}.{bound}") for bound in (0, 6)]
            self.node("Clip", [output, *bounds], fused)
        elif activation:
            raise ValueError(f"activation {activation} is not known here")

    def flipped(self, name: str) -> str:
        """Adds the mirror image of a tensor and returns its name."""
        bounds = (-1, np.iinfo(np.int64).min, 3, -1)  # start, end, axis, step
        operands = [self.constant(np.array([value], np.int64), f"{name}.flip{n}") for n, value in enumerate(bounds)]
        self.node("Slice", [name, *operands], f"{name}.flipped")
        return f"{name}.flipped"

    def constant(self, values: np.ndarray | np.generic, name: str) -> str:
        """Adds a constant and returns its name."""
        values = np.asarray(values)
        dims = b"".join(_number(1, n) for n in values.shape)
        kind = INT64 if values.dtype == np.int64 else FLOAT
        content = values.astype(np.int64 if kind == INT64 else np.float32).tobytes()
        self.initializers[name] = dims + _number(2, kind) + _text(8, name) + _field(9, content)
        return name

    def node(self, kind: str, inputs: Sequence[str], *outputs: str, **attributes: Any) -> None:
        """Adds a node: an operation `kind` on tensors, named by `inputs` and `outputs`, with its attributes."""
        parts = [_text(1, name) for name in inputs] + [_text(2, name) for name in outputs] + [_text(4, kind)]
        for name, value in attributes.items():
            field, number = ATTRIBUTES[type(value)]
            if isinstance(value, list):
                content = b"".join(_number(field, int(n)) for n in value)
            else:
                content = _text(field, value) if isinstance(value, str) else _number(field, int(value))
            parts.append(_field(5, _text(1, name) + content + _number(20, number)))
        self.nodes.append(b"".join(parts))

    def model(self, shape: list[int], names: Sequence[str]) -> bytes:
        """Returns the whole model, whose input has this shape, with its outputs by name."""
        graph = b"".join(_field(1, node) for node in self.nodes) + _text(2, "network")
        graph += b"".join(_field(5, initializer) for initializer in self.initializers.values())
        graph += _field(11, _described("image", shape)) + b"".join(_field(12, _described(name, None)) for name in names)
        return _number(1, IR_VERSION) + _field(7, graph) + _field(8, _number(2, OPSET))

    def _weights(self, inputs: list[int], axes: tuple[int, ...]) -> tuple[str, str]:
        """Adds the kernel of a convolution, with its axes in this order, and its bias, and returns their names."""
        _, kernel, bias = inputs
        return (
            self.constant(self.constants[kernel].transpose(axes), str(kernel)),
            self.constant(self.constants[bias], str(bias)),
        )


def _window(options: "_Record") -> dict[str, Any]:
    """Returns the padding and the strides of a window in the terms of ONNX."""
    return {"auto_pad": PADDING[options.number(0, BYTE)], "strides": [options.number(2, INT), options.number(1, INT)]}


def _dense(sparsity: "_Record", values: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Fills in the zeros of a constant whose last axis alone is sparse, in compressed rows."""
    rows = sparsity.records(2)[-1]
    ends, columns = (rows.record(field + 1).numbers(0, INDICES[rows.number(field, BYTE)]) for field in (2, 4))
    dense = np.zeros((len(ends) - 1, shape[-1]), values.dtype)
    dense[np.repeat(np.arange(len(dense)), np.diff(ends.astype(int))), columns] = values
    return dense.reshape(shape)


def _described(name: str, shape: list[int] | None) -> bytes:
    """Returns a ValueInfoProto of a float tensor; a shape of None is left open."""
    dims = b"" if shape is None else _field(2, b"".join(_field(1, _number(1, n)) for n in shape))
    return _text(1, name) + _field(2, _field(1, _number(1, FLOAT) + dims))


def _varint(value: int) -> bytes:
    """Encodes an integer as Protocol Buffers do: 7 bits a byte, the lowest first; bit 7 marks all but the last."""
    value &= (1 << 64) - 1
    groups = [value >> shift & 127 for shift in range(0, max(value.bit_length(), 1), 7)]
    return bytes([*(group | 128 for group in groups[:-1]), groups[-1]])


def _number(field: int, value: int) -> bytes:
    """Returns an integer field of a protobuf message: key (wire type 0) and value as varints."""
    return _varint(field << 3) + _varint(value)


def _field(field: int, content: bytes) -> bytes:
    """Returns a field of bytes of a protobuf message: key (wire type 2), length and content."""
    return _varint(field << 3 | 2) + _varint(len(content)) + content


def _text(field: int, text: str) -> bytes:
    return _field(field, text.encode())


class _Record(Table):  # type: ignore[misc]
    """A table of the file, with its fields by their numbers."""

    def number(self, field: int, kind: type) -> int:
        """Returns the number in a field, counted from 0, read by `kind` of flatbuffers; 0 if it is left out."""
        return self.GetSlot(VTABLE_HEADER + 2 * field, 0, kind)

    def numbers(self, field: int, dtype: type) -> np.ndarray:
        """Returns the vector in a field; empty if the field is absent."""
        if not (offset := self.Offset(VTABLE_HEADER + 2 * field)):
            return np.empty(0, dtype)
        return np.frombuffer(self.Bytes, dtype, self.VectorLen(offset), self.Vector(offset))

    def has(self, field: int) -> bool:
        """Returns whether a field is there."""
        return bool(self.Offset(VTABLE_HEADER + 2 * field))

    def record(self, field: int) -> "_Record":
        """Returns the table in a field."""
        return _Record(self.Bytes, self.Indirect(self.Pos + self.Offset(VTABLE_HEADER + 2 * field)))

    def records(self, field: int) -> list["_Record"]:
        """Returns the tables in a field that is a vector of them; an empty list if it is left out."""
        place = self.Offset(VTABLE_HEADER + 2 * field)
        count = self.VectorLen(place) if place else 0
        return [_Record(self.Bytes, self.Indirect(self.Vector(place) + 4 * i)) for i in range(count)]


def _name(code: _Record) -> str:
    """Returns the number of an operation, as text, or its name."""
    number = code.number(3, INT)
    return code.String(code.Pos + code.Offset(VTABLE_HEADER + 2)).decode() if number == CUSTOM else str(number)
