"""A graph of every operation, written by the format's schema, says as .onnx what torch says."""

import numpy as np
import onnxruntime
import pytest
import torch
import torch.nn.functional as F

from relight.photos.mask.tflite import convert

# Numbers of the schema, as in schema.fbs: operations, types of options and of tensors.
ADD, POOL, CONV, DEPTHWISE, DEQUANTIZE, LOGISTIC, MUL, RELU = 0, 1, 3, 4, 6, 14, 18, 19
RESIZE, HARD_SWISH = 23, 117


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

    def held(values):
        return writer.operation(DEQUANTIZE, [writer.tensor(values)])

    def weights(name):
        return [held(w[name]), held(bias[name])]

    conv = writer.operation(CONV, [first, *weights("conv")], window(0, 2))
    swish = writer.operation(HARD_SWISH, [conv])
    depth = writer.operation(DEPTHWISE, [swish, *weights("depth")], window(0, 2))
    relu = writer.operation(RELU, [depth])
    pooled = writer.operation(POOL, [relu])
    squeezed = writer.operation(RELU, [writer.operation(CONV, [pooled, *weights("squeeze")], window(1))])
    gate = writer.operation(LOGISTIC, [squeezed])
    gated = writer.operation(MUL, [relu, gate])
    large = writer.operation(RESIZE, [gated, writer.tensor(np.array([5, 4], np.int32))])
    total = writer.operation(ADD, [large, swish])
    last = writer.operation("Convolution2DTransposeBias", [total, *weights("up")])
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


@pytest.mark.parametrize(("code", "says"), [(25, "operation 25"), ("Nobody", "operation Nobody")])
def test_convert_refuses_what_it_does_not_know(code, says, tflite):
    writer = tflite()
    first = writer.tensor(shape=[1, 3, 3, 1])
    with pytest.raises(ValueError, match=says):
        convert(writer.bytes(first, writer.operation(code, [first, first])))
