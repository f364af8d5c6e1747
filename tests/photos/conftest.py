"""A tiny network with random weights, a photo and its soft mask: enough for all that is not about quality."""

import numpy as np
import pytest
from PIL import Image


@pytest.fixture(scope="session")
def small():
    """The function that makes small model settings out of the paper's."""
    from relight.config import Model, composed

    ours = dict(composed().model)

    def settings(**changes):
        return Model(**{**ours, "width": 0.125, "norm": "instance", **changes})

    return settings


@pytest.fixture(scope="session")
def weights(tmp_path_factory, small):
    import torch

    from relight.learning.checkpoint import save_network
    from relight.learning.networks import build

    torch.set_num_threads(1)
    torch.manual_seed(3)
    model = small(albedo="sigmoid")
    network = build(model, 64)
    bias = torch.zeros(9)
    bias[:3] = torch.tensor([0.8, 0.2, 0.3])  # a transport like that of a surface, so that shadings are positive
    with torch.no_grad():
        network.decoders["transport"].last.bias.copy_(bias)
        light = torch.zeros(9, 3)
        light[0], light[1], light[2], light[3] = 0.8, 0.15, 0.2, -0.1
        network.light.last.bias.copy_(light.flatten())
    path = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
    rng = np.random.default_rng(5)
    lights = light.numpy() * rng.uniform(0.5, 1.5, (12, 9, 3))
    save_network(path, network, model, train={"color": "photo"}, lights=lights.ravel().round(4).tolist())
    return path


@pytest.fixture(scope="session")
def relighter(weights):
    from relight.photos.api import load

    return load(weights, threads=1)


@pytest.fixture(scope="session", name="draw")
def drawing():
    """The function that draws a photo and its mask."""
    return draw


def draw(height=180, width=140, seed=0):
    """A photo (H,W,3) uint8 full of detail and of all 256 codes, and a soft mask (H,W) uint8 of an upright figure."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    photo = np.stack([x * 255 // width, y * 255 // height, (x + y) * 255 // (height + width)], -1)
    photo = np.clip(photo + rng.integers(-20, 20, photo.shape), 0, 255).astype(np.uint8)
    reach = np.hypot((x - width * 0.45) / (0.2 * width), (y - height * 0.55) / (0.4 * height))
    return photo, np.clip((1.05 - reach) * 255 / 0.1, 0, 255).astype(np.uint8)


@pytest.fixture
def photo_files(tmp_path):
    """me.png, me_mask.png and their arrays."""
    pixels, mask = draw()
    Image.fromarray(pixels).save(tmp_path / "me.png")
    Image.fromarray(mask).save(tmp_path / "me_mask.png")
    return tmp_path / "me.png", tmp_path / "me_mask.png", pixels, mask
