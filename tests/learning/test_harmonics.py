"""The torch harmonics against the numpy ones, which have tests of their own."""

import numpy as np
import pytest
import torch

from relight.learning.harmonics import basis, unoccluded
from relight.sh import basis as numpy_basis
from relight.sh import unoccluded as numpy_unoccluded


@pytest.mark.parametrize("order", [0, 1, 2, 3, 4])
def test_twins(order):
    d = np.random.default_rng(0).normal(size=(200, 3))
    d = np.concatenate([d / np.linalg.norm(d, axis=1, keepdims=True), np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(basis(torch.tensor(d), order).numpy(), numpy_basis(d, order), atol=1e-12)
    np.testing.assert_allclose(unoccluded(torch.tensor(d), order).numpy(), numpy_unoccluded(d, order), atol=1e-7)
    single = unoccluded(torch.tensor(d, dtype=torch.float32), order).numpy()
    np.testing.assert_allclose(single, numpy_unoccluded(d, order), atol=1e-6)


def test_gradient_also_at_the_poles():
    d = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, 0.8]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda n: basis(n, 4), d)
