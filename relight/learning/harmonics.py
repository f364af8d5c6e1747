"""Spherical harmonics in torch: the differentiable unoccluded transport of normals, for SfSNet's networks."""

import math

import torch
from torch import Tensor

from relight.sh import cosine_factors


def basis(directions: Tensor, order: int) -> Tensor:
    """Returns real orthonormal spherical harmonics, as `relight.sh.basis` does for NumPy.

    No Condon-Shortley phase, pole +z, sines for m < 0. With c_m + i s_m = (x + iy)^m the functions are polynomials in
    x, y and z, so the gradient also exists at the poles.

    Args:
        directions: unit vectors (..., 3).
        order: highest band, any.

    Returns:
        Y_lm at index l*l+l+m, (..., (order+1)^2).
    """
    x, y, z = directions.unbind(-1)
    cosine, sine = [torch.ones_like(x)], [torch.zeros_like(x)]
    for _ in range(order):
        c, s = cosine[-1], sine[-1]
        cosine.append(x * c - y * s)
        sine.append(x * s + y * c)
    out: dict[int, Tensor] = {}
    for m in range(order + 1):
        # q is the associated Legendre function P_l^m over sin^m, by the three-term recurrence in l.
        before, q = torch.zeros_like(x), torch.full_like(x, float(math.prod(range(1, 2 * m, 2))))
        for l in range(m, order + 1):
            if l > m:
                before, q = q, ((2 * l - 1) * z * q - (l + m - 1) * before) / (l - m)
            scale = math.sqrt((2 * l + 1) / (4 * math.pi) * math.factorial(l - m) / math.factorial(l + m))
            if m == 0:
                out[l * l + l] = scale * q
            else:
                out[l * l + l + m] = math.sqrt(2) * scale * q * cosine[m]
                out[l * l + l - m] = math.sqrt(2) * scale * q * sine[m]
    return torch.stack([out[index] for index in range((order + 1) ** 2)], -1)


def unoccluded(normals: Tensor, order: int) -> Tensor:
    """Returns the transport T_lm(n) = A_l Y_lm(n), (..., (order+1)^2), of unit normals (..., 3) without occlusion."""
    factors = cosine_factors(order)
    bands = [float(factors[l]) for l in range(order + 1) for _ in range(2 * l + 1)]
    return basis(normals, order) * normals.new_tensor(bands)


def mirror_signs(order: int) -> Tensor:
    """Returns the sign ((order+1)^2,) of each coefficient under the reflection x -> -x."""
    direction = torch.tensor([0.48, 0.6, 0.64], dtype=torch.float64)
    mirrored = direction * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    odd = (basis(direction, order) - basis(mirrored, order)).abs() > 1e-9
    return 1.0 - 2.0 * odd.float()
