"""Converts the TensorFlow Lite graph of the built-in mask to .onnx: the operations and options that it has, no others.

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
CUSTOM = 32  # the operation has a name instead of a number
CONV, DEPTHWISE, DEQUANTIZE, RESIZE, TRANSPOSED = "3", "4", "6", "23", "Convolution2DTransposeBias"
# Operations by number; averages are over the whole image.
SIMPLE = {"0": "Add", "1": "GlobalAveragePool", "14": "Sigmoid", "18": "Mul", "19": "Relu", "117": "HardSwish"}
BYTE, INT = numbers.Int8Flags, numbers.Int32Flags
PADDING = {0: "SAME_UPPER", 1: "VALID"}
OPSET, IR_VERSION = 18, 8
FLOAT, INT64 = 1, 7  # types of tensors in ONNX
ATTRIBUTES = {int: (3, 2), str: (4, 3), list: (8, 7)}  # field and type of an attribute's value


def convert(data: bytes) -> bytes:
    """Converts the first graph of a .tflite file's content, with one input and one output, to a model in ONNX.

    The model takes `image` (1,C,H,W) float32 and returns `mask` (1,C',H',W'), the mean of what the graph returns for
    the image and for its mirror image.

    Raises:
        ValueError: for an operation that is not known here, and for several inputs or outputs.
    """
    model = _Record(data, int.from_bytes(data[:4], "little"))
    names = [_name(code) for code in model.records(1)]
    graph, buffers = model.records(2)[0], model.records(4)
    (first,), (last,) = graph.numbers(1, np.int32).tolist(), graph.numbers(2, np.int32).tolist()
    tensors = graph.records(0)
    constants = {}
    for i, tensor in enumerate(tensors):
        stored = buffers[tensor.number(2, numbers.Uint32Flags)].numbers(0, np.uint8)
        if len(stored):
            constants[i] = stored.view(DTYPES[tensor.number(1, BYTE)]).reshape(tensor.numbers(0, np.int32))
    writer = _Writer(constants)
    writer.node("Concat", ["image", writer.flipped("image")], str(first), axis=0)
    for record in graph.records(3):
        name = names[record.number(0, numbers.Uint32Flags)]
        inputs, outputs = (record.numbers(field, np.int32).tolist() for field in (1, 2))
        if name == DEQUANTIZE:
            constants[outputs[0]] = constants.pop(inputs[0]).astype(np.float32)
        else:
            writer.operation(name, inputs, str(outputs[0]), record)
    writer.node("Split", [str(last)], "straight", "mirrored", axis=0, num_outputs=2)
    writer.node("Mean", ["straight", writer.flipped("mirrored")], "mask")
    _, height, width, channels = tensors[first].numbers(0, np.int32).tolist()
    return writer.model([1, channels, height, width])


class _Writer:
    """Collects the nodes and constants of an ONNX graph.

    Attributes:
        constants: those of the .tflite file, by the number of the tensor.
        nodes, initializers: what was added, as Protocol Buffers.
    """

    def __init__(self, constants: dict[int, np.ndarray]):
        self.constants = constants
        self.nodes: list[bytes] = []
        self.initializers: list[bytes] = []

    def operation(self, name: str, inputs: list[int], output: str, record: "_Record") -> None:
        """Adds an operation of the .tflite file; ValueError if it is not known here."""
        image = str(inputs[0])
        if name in SIMPLE:
            self.node(SIMPLE[name], list(map(str, inputs)), output)
        elif name in (CONV, DEPTHWISE):
            axes, group = ((0, 3, 1, 2), 1) if name == CONV else ((3, 0, 1, 2), self.constants[inputs[1]].shape[3])
            options = record.record(4)
            padding, strides = PADDING[options.number(0, BYTE)], [options.number(2, INT), options.number(1, INT)]
            operands = [image, *self._weights(inputs, axes)]
            self.node("Conv", operands, output, auto_pad=padding, strides=strides, group=group)
        elif name == TRANSPOSED:  # MediaPipe's own; its windows do not overlap
            strides = list(self.constants[inputs[1]].shape[1:3])
            self.node("ConvTranspose", [image, *self._weights(inputs, (3, 0, 1, 2))], output, strides=strides)
        elif name == RESIZE:
            sizes = self.constant(self.constants[inputs[1]].astype(np.int64), f"{output}.sizes")
            self.node("Resize", [image, "", "", sizes], output, mode="linear", axes=[2, 3])
        else:
            raise ValueError(f"operation {name} is not known here")

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
        self.initializers.append(dims + _number(2, kind) + _text(8, name) + _field(9, content))
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

    def model(self, shape: list[int]) -> bytes:
        """Returns the whole model, whose input has this shape."""
        graph = b"".join(_field(1, node) for node in self.nodes) + _text(2, "mask")
        graph += b"".join(_field(5, initializer) for initializer in self.initializers)
        graph += _field(11, _described("image", shape)) + _field(12, _described("mask", None))
        return _number(1, IR_VERSION) + _field(7, graph) + _field(8, _number(2, OPSET))

    def _weights(self, inputs: list[int], axes: tuple[int, ...]) -> tuple[str, str]:
        """Adds the kernel of a convolution, with its axes in this order, and its bias, and returns their names."""
        _, kernel, bias = inputs
        return (
            self.constant(self.constants[kernel].transpose(axes), str(kernel)),
            self.constant(self.constants[bias], str(bias)),
        )


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
        offset = self.Offset(VTABLE_HEADER + 2 * field)
        if not offset:
            return np.empty(0, dtype)
        return np.frombuffer(self.Bytes, dtype, self.VectorLen(offset), self.Vector(offset))

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
