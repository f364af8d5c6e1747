"""A graph of every operation, written by the format's schema, says as .onnx what torch says."""

import numpy as np
import onnxruntime
import pytest
import torch
import torch.nn.functional as F

from relight.photos.mask.tflite import convert

# Numbers of the schema, as in schema.fbs: operations, types of options and of tensors.
ADD, POOL, CONV, DEPTHWISE, DEQUANTIZE, LOGISTIC, MUL, RELU, RESIZE, HARD_SWISH = 0, 1, 3, 4, 6, 14, 18, 19, 23, 117
CONCATENATE, TO_SPACE, MAX_POOL, RESHAPE, PAD, DENSIFY = 2, 5, 17, 22, 34, 124


def window(padding=0, stride=1):
    """Options of a window of SAME (0) or VALID (1) padding: fields 0 to 2 of them all."""
    return [(0, "Int8", padding), (1, "Int32", stride), (2, "Int32", stride)]


def slid(x, weight, bias, stride=2):
    """Convolution of (1,C,H,W) with SAME padding, which the format puts below and at the right first."""
    sizes = zip(x.shape[2:], weight.shape[2:])
    rows, columns = (max((-(-n // stride) - 1) * stride + size - n, 0) for n, size in sizes)
    padded = F.pad(x, (columns // 2, columns - columns // 2, rows // 2, rows - rows // 2))
    return F.conv2d(padded, weight, bias, stride, groups=x.shape[1] // weight.shape[1])


def test_convert_of_every_operation(tflite):
    rng = np.random.default_rng(0)
    image = rng.uniform(0, 1, (9, 7, 3))
    shapes = {"conv": (4, 3, 3, 3), "depth": (1, 5, 5, 4), "squeeze": (4, 1, 1, 4), "up": (2, 2, 2, 4)}
    outputs = {"conv": 4, "depth": 4, "squeeze": 4, "up": 2}
    w = {name: rng.normal(0, 0.6, shape).astype(np.float16) for name, shape in shapes.items()}
    bias = {name: rng.normal(0, 0.2, n).astype(np.float16) for name, n in outputs.items()}
    writer = tflite()
    first = writer.tensor(shape=[1, 9, 7, 3])

    def weights(name):
        return [writer.operation(DEQUANTIZE, [writer.tensor(each[name])]) for each in (w, bias)]

    swish = writer.operation(HARD_SWISH, [writer.operation(CONV, [first, *weights("conv")], window(0, 2))])
    relu = writer.operation(RELU, [writer.operation(DEPTHWISE, [swish, *weights("depth")], window(0, 2))])
    pooled = writer.operation(POOL, [relu])
    squeezed = writer.operation(RELU, [writer.operation(CONV, [pooled, *weights("squeeze")], window(1))])
    gate = writer.operation(LOGISTIC, [squeezed])
    large = writer.operation(RESIZE, [writer.operation(MUL, [relu, gate]), writer.tensor(np.array([5, 4], np.int32))])
    last = writer.operation("Convolution2DTransposeBias", [writer.operation(ADD, [large, swish]), *weights("up")])
    session = onnxruntime.InferenceSession(convert(writer.bytes(first, last)))
    axes = {"conv": (0, 3, 1, 2), "squeeze": (0, 3, 1, 2)}  # as torch orders those that the format stores as (O,h,w,C)
    w = {name: torch.tensor(each).double().permute(axes.get(name, (3, 0, 1, 2))) for name, each in w.items()}
    bias = {name: torch.tensor(each).double() for name, each in bias.items()}

    def by_torch(image):
        a = F.hardswish(slid(image, w["conv"], bias["conv"]))
        b = F.relu(slid(a, w["depth"], bias["depth"]))
        assert b.shape == (1, 4, 3, 2)
        gate = F.relu(F.conv2d(b.mean((2, 3), keepdim=True), w["squeeze"], bias["squeeze"])).sigmoid()
        c = F.interpolate(b * gate, (5, 4), mode="bilinear") + a  # half-pixel centres
        return F.conv_transpose2d(c, w["up"], bias["up"], stride=2)

    given = torch.tensor(image).permute(2, 0, 1)[None]
    (mask,) = session.run(None, {"image": given.float().numpy()})
    expected = (by_torch(given) + by_torch(given.flip(-1)).flip(-1)) / 2
    assert mask.shape == (1, 2, 10, 8)
    assert np.abs(mask - expected.numpy()).max() < 1e-5


def test_convert_of_networks_of_poses(tflite):
    """Weights that are sparse, padding, activations within operations, and two outputs whose layers are joined."""
    rng = np.random.default_rng(0)
    w = rng.normal(0, 1, (8, 3, 3, 4)) * (rng.uniform(size=(8, 3, 3, 4)) < 0.3)
    narrow, bias = rng.normal(0, 1, (1, 3, 3, 8)), rng.normal(0, 1, 8)
    w, narrow, bias = (each.astype(np.float32) for each in (w, narrow, bias))
    writer = tflite()
    first = writer.tensor(shape=[1, 7, 5, 3])
    pads = np.array([[0, 0], [1, 2], [3, 0], [0, 1]], np.int32)  # of B, H, W and C, before and after
    padded = writer.operation(PAD, [first, writer.tensor(pads)])
    kernel = writer.operation(DENSIFY, [writer.sparse(w)])
    conv = writer.operation(CONV, [padded, kernel, writer.tensor(bias)], [*window(1), (3, "Int8", 3)])
    sizes = [(3, "Int32", 2), (4, "Int32", 3)]  # width before height
    pooled = writer.operation(MAX_POOL, [conv], [*window(0, 2), *sizes])
    stored = [writer.tensor(narrow), writer.tensor(bias)]
    depth = writer.operation(DEPTHWISE, [pooled, *stored], [*window(), (4, "Int8", 1)])
    total = writer.operation(ADD, [depth, pooled], [(0, "Int8", 1)])
    spread = writer.operation(TO_SPACE, [total], [(0, "Int32", 2)])
    shape = np.array([1, -1, 2], np.int32)
    rows = [writer.operation(RESHAPE, [each, writer.tensor(shape)]) for each in (total, spread)]
    joined = writer.operation(CONCATENATE, rows, [(0, "Int32", 1)])
    data = convert(writer.bytes(first, joined, total), ["rows", "grid"], mirrored=False)
    image = rng.normal(0, 1, (1, 3, 7, 5)).astype(np.float32)
    found, grid = onnxruntime.InferenceSession(data).run(["rows", "grid"], {"image": image})
    x = F.pad(torch.tensor(image), (3, 0, 1, 2, 0, 1))
    x = F.conv2d(x, torch.tensor(w).permute(0, 3, 1, 2), torch.tensor(bias)).clamp(0, 6)
    assert x.shape == (1, 8, 8, 6) and x.max() == 6
    x = F.max_pool2d(F.pad(x, (0, 0, 0, 1), value=-np.inf), (3, 2), 2)
    x = F.relu(F.relu(slid(x, torch.tensor(narrow).permute(3, 0, 1, 2), torch.tensor(bias), 1)) + x)
    np.testing.assert_allclose(grid, x, atol=1e-5)
    last = x.permute(0, 2, 3, 1).numpy()  # as the format has it
    blocks = last.reshape(1, 4, 3, 2, 2, 2).transpose(0, 1, 3, 2, 4, 5)
    np.testing.assert_allclose(found, np.concatenate([each.reshape(1, -1, 2) for each in (last, blocks)], 1), atol=1e-5)


@pytest.mark.parametrize(("code", "says"), [(25, "operation 25"), ("Nobody", "operation Nobody")])
def test_convert_refuses_what_it_does_not_know(code, says, tflite):
    writer = tflite()
    first = writer.tensor(shape=[1, 3, 3, 1])
    with pytest.raises(ValueError, match=says):
        convert(writer.bytes(first, writer.operation(code, [first, first])))
