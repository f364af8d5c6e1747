"""The lamps of a light stage, and their weights as nodes of a quadrature rule on the sphere."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import SphericalVoronoi

from relight.errors import UserError
from relight.sh import basis, sphere_quadrature, unoccluded

NORMAL_ORDER = 16  # of the quadrature over all normals by which `projection_error` averages
MAX_DEGREE = 8  # of the harmonics that `quadrature_weights` integrate exactly: more does not help with 331 lamps


def quadrature_weights(directions: np.ndarray) -> np.ndarray:
    """Returns weights of a quadrature rule on the sphere with nodes at given directions.

    The areas of Voronoi cells have an error of second order where lamps are missing. So the weights are those with the
    least squared relative change from these areas that integrate all spherical harmonics up to a degree exactly. The
    degree is the highest one up to MAX_DEGREE for which all weights are positive.

    Args:
        directions: (L,3) unit vectors, all different.

    Returns:
        (L,) solid angles, whose sum is 4 pi.

    Raises:
        UserError: if two lamps have the same direction, or all lie in one plane.
    """
    try:
        cells = SphericalVoronoi(directions, threshold=1e-9).calculate_areas()
    except ValueError as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"the lamps' directions do not span a sphere ({reason})") from None
    weights = cells
    for degree in range(MAX_DEGREE + 1):
        values = basis(directions, degree)
        integrals = np.zeros(values.shape[1])
        integrals[0] = np.sqrt(4 * np.pi)  # of Y_00; those of all others are 0
        # With weights A + sqrt(A) x, the solution x of least norm has the least relative changes.
        change, *_ = np.linalg.lstsq(values.T * np.sqrt(cells), integrals - cells @ values, rcond=None)
        candidate = cells + np.sqrt(cells) * change
        if len(values) <= values.shape[1] or candidate.min() <= 0:
            break
        weights = candidate
    return weights


def projection_error(directions: np.ndarray, weights: np.ndarray) -> float:
    """Returns the RMS error, over all normals, of unoccluded transport (a vector of nine) by a quadrature rule.

    Args:
        directions: (L,3) unit vectors to the lamps.
        weights: (L,) solid angles.
    """
    normals, solid_angles = sphere_quadrature(NORMAL_ORDER)
    transport = (np.maximum(normals @ directions.T, 0) * weights) @ basis(directions)
    squared = ((transport - unoccluded(normals)) ** 2).sum(1)
    return float(np.sqrt(squared @ solid_angles / solid_angles.sum()))


@dataclass(frozen=True)
class LightStage:
    """The lamps of a light stage.

    Attributes:
        positions: (L,3), in any unit, in the frame of the points to be lit.
        centre: (3,) of the sphere fitted to them by least squares.
        radius: R, of that sphere.
        areas: (L,) A_l / R^2, the solid angle of each lamp seen from the centre.
        error: `projection_error` at the centre.
    """

    positions: np.ndarray
    centre: np.ndarray
    radius: float
    areas: np.ndarray
    error: float

    @classmethod
    def from_positions(cls, positions: np.ndarray) -> "LightStage":
        """Returns the stage with lamps at positions (L,3).

        Raises:
            UserError: if two lamps have the same direction, or all lie in one plane.
        """
        system = np.concatenate([2 * positions, np.ones((len(positions), 1))], 1)
        sphere, *_ = np.linalg.lstsq(system, (positions**2).sum(1), rcond=None)  # |p|^2 = 2 p.c + R^2 - |c|^2
        centre = sphere[:3]
        radius = float(np.sqrt(max(sphere[3] + centre @ centre, 1e-12)))
        outward = positions - centre
        distance = np.linalg.norm(outward, axis=1, keepdims=True)
        directions = outward / np.maximum(distance, 1e-12)
        weights = quadrature_weights(directions)
        areas = weights * (distance[:, 0] / radius) ** 2
        return cls(positions, centre, radius, areas, projection_error(directions, weights))

    def lamp_seen_from(self, lamp: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the direction, weight and falloff of a lamp at points (P,3).

        Returns:
            Directions w (P,3); weights A_l c_l / R^2 (P,) of the lamp's frame; falloff R^2 / r^2 (P,) of its light.
        """
        directions = self.positions[lamp] - points
        distance = np.linalg.norm(directions, axis=1)
        directions /= distance[:, None]
        outward = self.positions[lamp] - self.centre
        cosine = directions @ (outward / np.linalg.norm(outward))
        return directions, self.areas[lamp] * np.maximum(cosine, 0), (self.radius / distance) ** 2
