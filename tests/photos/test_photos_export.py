"""The exported network says what the network says, at batches and sizes that it was not exported at."""

import pytest
import torch

from relight.files import UserError
from relight.learning.networks import build
from relight.photos.export import HALF_TOLERANCE, check, export, halve, least, sample


@pytest.fixture(scope="module")
def network(small):
    """All that exports differently from how it is trained: instance norms, a pooled head, a refined light."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    return build(small(light_head="pooled", refine=True), 128).eval()


def test_onnx(network, tmp_path):
    pytest.importorskip("onnxscript")
    onnxruntime = pytest.importorskip("onnxruntime")
    path = tmp_path / "a.onnx"
    assert export(network, path) < 1e-4
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    image, mask = sample(4, 256, 192)
    albedo, transport, light = session.run(None, {"image": image.numpy(), "mask": mask.numpy()})
    assert albedo.shape == (4, 3, 256, 192) and transport.shape == (4, 9, 256, 192) and light.shape == (4, 9, 3)
    assert (transport[:, :, :8] == 0).all()
    size = path.stat().st_size
    halve(path)
    assert path.stat().st_size < 0.75 * size
    assert 0 < check(network, path, HALF_TOLERANCE) < HALF_TOLERANCE


def test_torch_export(small, tmp_path):
    network = build(small(), 128).eval()
    path = tmp_path / "a.pt2"
    assert export(network, path) < 1e-4
    with torch.no_grad():
        next(network.decoders["albedo"].last.parameters()).add_(0.1)
    with pytest.raises(RuntimeError, match="differs"):  # the check does compare
        check(network, path)


def test_names_are_checked(small, tmp_path):
    network = build(small(), 64)
    assert least(network) == 128
    with pytest.raises(UserError, match=r"must end in .onnx or .pt2"):
        export(network, tmp_path / "a.pth")
    with pytest.raises(UserError, match=r"only .onnx is written in half precision"):
        export(network, tmp_path / "a.pt2", half=True)
