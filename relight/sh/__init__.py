"""Spherical harmonics: basis, rotation, irradiance, windows, and the conventions of other programs."""

from relight.sh.conventions import CONVENTIONS, from_relight, to_relight
from relight.sh.harmonics import (
    UNOCCLUDED_T00,
    bands,
    basis,
    coefficient_count,
    cosine_factors,
    irradiance,
    mean_direction,
    order_of,
    per_coefficient,
    rotate_y,
    rotation_about_y,
    rotation_matrix,
    sphere_quadrature,
    sphere_spiral,
    unoccluded,
)
from relight.sh.window import deringed

__all__ = [
    "CONVENTIONS",
    "UNOCCLUDED_T00",
    "bands",
    "basis",
    "coefficient_count",
    "cosine_factors",
    "deringed",
    "from_relight",
    "irradiance",
    "mean_direction",
    "order_of",
    "per_coefficient",
    "rotate_y",
    "rotation_about_y",
    "rotation_matrix",
    "sphere_quadrature",
    "sphere_spiral",
    "to_relight",
    "unoccluded",
]
