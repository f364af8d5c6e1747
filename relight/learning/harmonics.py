"""Spherical harmonics in torch: the differentiable unoccluded transport of normals, for SfSNet's networks."""

import torch
from torch import Tensor

from relight.sh import cosine_factors, per_coefficient
from relight.sh.harmonics import polynomials


def basis(directions: Tensor, order: int) -> Tensor:
    """Returns real orthonormal spherical harmonics, as `relight.sh.basis` does for NumPy.

    Args:
        directions: unit vectors (..., 3).
        order: highest band, any.

    Returns:
        Y_lm at index l*l+l+m, (..., (order+1)^2).
    """
    x, y, z = directions.unbind(-1)
    values = dict(polynomials(x, y, z, torch.ones_like(x), order))
    return torch.stack([values[index] for index in range(len(values))], -1)


def unoccluded(normals: Tensor, order: int) -> Tensor:
    """Returns the transport T_lm(n) = A_l Y_lm(n), (..., (order+1)^2), of unit normals (..., 3) without occlusion."""
    return basis(normals, order) * normals.new_tensor(per_coefficient(cosine_factors(order)).tolist())


def mirror_signs(order: int) -> Tensor:
    """Returns the sign ((order+1)^2,) of each coefficient under the reflection x -> -x."""
    direction = torch.tensor([0.48, 0.6, 0.64], dtype=torch.float64)  # any unit vector where no coefficient is zero
    mirrored = direction * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    odd = (basis(direction, order) - basis(mirrored, order)).abs() > 1e-9
    return 1.0 - 2.0 * odd.float()
