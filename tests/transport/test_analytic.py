"""The baker against scenes whose transport is known in closed form, every coefficient, at four ray counts."""

import numpy as np
import pytest
import trimesh

from relight.sh import basis, sphere_spiral, unoccluded
from relight.transport.integrate import integrate
from relight.transport.raycaster import RayCaster

UP = np.array([0.0, 0.0, 1.0])
FAR = 1e4
RAYS = (64, 256, 1024, 4096)


def from_moments(m, mx, my, mz, mxx, myy, mzz, mxy=0.0, myz=0.0, mxz=0.0):
    """Order-2 transport from the moments M(f) = integral of V max(n.w, 0) f(w) dw, by the definition of the basis."""
    c0, c1, c2, c20 = 0.5 / np.sqrt(np.pi), np.sqrt(0.75 / np.pi), np.sqrt(3.75 / np.pi), np.sqrt(5 / np.pi) / 4
    band2 = [c2 * mxy, c2 * myz, c20 * (3 * mzz - m), c2 * mxz, c2 / 2 * (mxx - myy)]
    return np.array([c0 * m, c1 * my, c1 * mz, c1 * mx, *band2])


def wedge(low, high):
    """n = +z; visible: directions whose angle about the y axis, from +x toward +z, lies in (low, high).

    A wall of height h at distance d on the -x side leaves (0, pi - atan(h/d)); both walls bound it from both sides.
    """

    def upto(b):
        c, s = np.cos(b), np.sin(b)
        return np.array([-c, (b - s * c) / 2, s * s / 2, -c + c**3 / 3, s**3 / 3, -(c**3) / 3])

    m, mz, mx, mzz, mxz, mxx = upto(high) - upto(low)
    k = np.pi / 8
    return from_moments(4 * k * m, 4 / 3 * mx, 0, 4 / 3 * mz, 3 * k * mxx, k * m, 3 * k * mzz, mxz=3 * k * mxz)


def cap(n, c, angle):
    """What comes through the cap of half-angle `angle` about c, when all of it is above n's horizon."""
    k = np.cos(angle)
    e0, e1, e2, e3 = 2 * np.pi * (1 - k), np.pi * (1 - k**2), 2 * np.pi * (1 - k**3) / 3, np.pi * (1 - k**4) / 2
    across, p = (e0 - e2) / 2, (e1 - e3) / 2
    eye = np.eye(3)
    second = across * eye + (e2 - across) * np.outer(c, c)
    third = (e3 - 3 * p) * np.einsum("i,j,k->ijk", c, c, c)
    third += p * (np.einsum("ij,k->ijk", eye, c) + np.einsum("ik,j->ijk", eye, c) + np.einsum("jk,i->ijk", eye, c))
    q = third @ n
    return from_moments(e1 * c @ n, *(second @ n), q[0, 0], q[1, 1], q[2, 2], q[0, 1], q[1, 2], q[0, 2])


def quad(*corners):
    return np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]])


def wall(x, height):
    """It goes as far down as up, so that the scene's centre, where float32 is finest, is near the origin."""
    return quad([x, -FAR, -height], [x, FAR, -height], [x, FAR, height], [x, -FAR, height])


def ball(center, radius):
    sphere = trimesh.creation.icosphere(subdivisions=6)
    return sphere.vertices * radius + center, sphere.faces


def well(angle):
    pipe = trimesh.creation.cylinder(radius=1, height=1 / np.tan(angle), sections=1024)
    return pipe.vertices - [0, 0, pipe.vertices[:, 2].min()], pipe.faces[np.abs(pipe.face_normals[:, 2]) < 0.5]


FLOOR = quad([-FAR, -FAR, 0], [FAR, -FAR, 0], [FAR, FAR, 0], [-FAR, FAR, 0])
OVER = np.array([0.3, 0.2, 1.0])
TILT = np.array([0.2, 0.1, 1.0]) / np.linalg.norm([0.2, 0.1, 1.0])
BESIDE = np.array([0.2, -0.3, 1.0])


def shadow(n, center, radius):
    distance = np.linalg.norm(center)
    return unoccluded(n) - cap(n, center / distance, np.arcsin(radius / distance))


BETWEEN = wedge(np.arctan(2.0), np.pi - np.arctan(0.7))
# name: (parts, normal, answer, RMSE at 64, 256, 1024, 4096 rays)
SCENES = {
    "plane": ([FLOOR], UP, unoccluded(UP), (1e-7, 1e-7, 1e-7, 1e-7)),
    "infinite wall": ([FLOOR, wall(-0.01, FAR)], UP, wedge(0, np.pi / 2), (1.1e-2, 2.9e-3, 7.5e-4, 2.1e-4)),
    "finite wall": ([FLOOR, wall(-1, 0.7)], UP, wedge(0, np.pi - np.arctan(0.7)), (1.3e-2, 3.8e-3, 1.1e-3, 5.4e-4)),
    "two walls": ([FLOOR, wall(-1, 0.7), wall(1, 2.0)], UP, BETWEEN, (2.0e-2, 5.8e-3, 2.2e-3, 7.4e-4)),
    "sphere overhead": ([FLOOR, ball(UP, 0.5)], UP, shadow(UP, UP, 0.5), (4.5e-3, 1.3e-3, 3.1e-4, 7.7e-5)),
    "sphere oblique": ([FLOOR, ball(OVER, 0.4)], UP, shadow(UP, OVER, 0.4), (1.5e-2, 3.5e-3, 1.9e-3, 4.1e-4)),
    "tilted normal": ([ball(BESIDE, 0.3)], TILT, shadow(TILT, BESIDE, 0.3), (1.2e-2, 3.6e-3, 1.4e-3, 4.2e-4)),
    "closed sphere": ([ball(0 * UP, 1)], UP, np.zeros(9), (8.0e-3, 2.0e-3, 4.9e-4, 1.2e-4)),
    "well": ([FLOOR, well(0.6)], UP, cap(UP, UP, 0.6), (1.1e-2, 2.5e-3, 7.0e-4, 1.7e-4)),
}


def caster_of(parts, offset=1e-5):
    vertices, faces = zip(*parts)
    start = np.cumsum([0, *map(len, vertices)])
    faces = np.concatenate([each + first for each, first in zip(faces, start)])
    caster = RayCaster(np.concatenate(vertices), faces, threads=1)
    caster.offset = offset  # walls of 10 km would make it 17 cm
    return caster


@pytest.mark.parametrize("name", SCENES)
def test_closed_forms(name):
    parts, normal, answer, bounds = SCENES[name]
    caster = caster_of(parts)
    points, normals = np.zeros((64, 3)), np.repeat(normal[None], 64, 0)
    for rays, bound in zip(RAYS, bounds):
        transport, _ = integrate(caster, points, normals, normals, rays)
        error = transport - answer
        # 15 % for the luck of 64 azimuths: the bounds are the prototype's own draw.
        assert np.sqrt((error**2).mean()) < 1.15 * bound, f"{rays} rays"
    assert np.abs(error.mean(0)).max() < 1.5e-4  # no bias in any coefficient


def test_infinite_wall_in_numbers():
    """The vector itself, so that the formulas above are not their own judge."""
    expected = [0.44311, 0, 0.51166, 0.32574, 0, 0, 0.24771, 0.42904, 0]
    np.testing.assert_allclose(wedge(0, np.pi / 2), expected, atol=1e-5)


@pytest.mark.parametrize("order", [0, 1, 3, 4, 6])
def test_any_order(order):
    """A wall's half space by quadrature over the sphere, at orders without a formula here."""
    w = sphere_spiral(400_000)
    upper = w[(w[:, 2] > 0) & (w[:, 0] > 0)]
    answer = (basis(upper, order) * upper[:, 2:]).sum(0) * 4 * np.pi / len(w)
    normals = np.repeat(UP[None], 64, 0)
    transport, _ = integrate(caster_of([FLOOR, wall(-0.01, FAR)]), 0 * normals, normals, normals, 4096, order)
    assert np.abs(transport.mean(0) - answer).max() < 2e-4 and np.sqrt(((transport - answer) ** 2).mean()) < 3.5e-4
