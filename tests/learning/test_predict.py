"""Inference on arrays."""

import numpy as np
import pytest
import torch

from relight.core.errors import UserError
from relight.learning.networks import build
from relight.learning.predict import predict
from relight.sh import unoccluded


@pytest.mark.parametrize("name", ["ours", "sfsnet", "sfsnet_ao"])
def test_maps_of_one_and_of_several_images(model, name):
    torch.manual_seed(0)
    network, rng = build(model(name=name), 64).eval(), np.random.default_rng(0)
    images, masks = rng.random((2, 64, 64, 3)), rng.random((2, 64, 64)) > 0.4
    several = predict(network, images, masks)
    shapes = {"albedo": (64, 64, 3), "transport": (64, 64, 9), "light": (9, 3), "shading": (64, 64, 3)}
    shapes |= {"normal": (64, 64, 3)} if name != "ours" else {}
    shapes |= {"ao": (64, 64, 1)} if name == "sfsnet_ao" else {}
    assert {key: value.shape[1:] for key, value in several.items()} == shapes
    assert all(value.dtype == np.float32 for value in several.values())
    for key, value in several.items():
        if key != "light":
            assert (value[~masks] == 0).all() and np.abs(value[masks]).max() > 0
    one = predict(network, images[1], masks[1].astype(float))
    for key, value in one.items():
        np.testing.assert_allclose(value, several[key][1], atol=1e-5)
    np.testing.assert_allclose(one["shading"], np.clip(one["transport"] @ one["light"], 0, 10), atol=1e-5)
    if name != "ours":
        inside = masks[1]
        expected = unoccluded(one["normal"][inside], 2) * (one["ao"][inside] if "ao" in one else 1)
        np.testing.assert_allclose(one["transport"][inside], expected, atol=1e-5)


@pytest.mark.parametrize("image, mask", [((64, 64, 4), (64, 64)), ((128, 128, 3), (128, 128)), ((64, 64, 3), (64, 32))])
def test_sizes_that_do_not_fit(model, image, mask):
    with pytest.raises(UserError, match="takes 64x64"):
        predict(build(model(), 64), np.zeros(image), np.zeros(mask))
