"""Views: what is seen from elsewhere is the frontal figure, turned; perspective against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from samples import mesh_of

from relight.core.errors import UserError
from relight.settings import read_preset
from relight.sh import rotation_matrix, unoccluded
from relight.transport import Baker, View, bake, random_view, view_names
from relight.transport.baker import primary_hits
from relight.transport.integrate import integrate
from relight.transport.sampling import random_azimuths
from relight.transport.surface import shading_normals
from relight.transport.view import place_mesh

CENTRES = np.array([[0.5, 0.3, 0.1], [-0.4, 0.6, -0.3], [-0.1, -0.5, 0.35], [0.15, 0.1, -0.1]])
RADII = np.array([0.3, 0.25, 0.3, 0.35])
VIEWS = (View(40, -8, 50), View(-150, 12, 25), View(100, 5), View(0, 0, 85), View(-35, 0))


def balls(subdivisions=4):
    """Four balls that touch and shade each other, at all depths and off the axis."""
    one = trimesh.creation.icosphere(subdivisions=subdivisions)
    vertices = np.concatenate([one.vertices * r + c for c, r in zip(CENTRES, RADII)])
    return mesh_of(vertices, np.concatenate([one.faces + i * len(one.vertices) for i in range(len(RADII))]))


def pixels(size):
    """x and y (size^2,) of the pixels' centres."""
    at = (2 * np.arange(size) + 1) / size - 1
    x, y = np.meshgrid(at, -at)
    return x.ravel(), y.ravel()


def hits_of_spheres(view, record, distance, size):
    """Every pixel's ray against the four spheres: depth (size^2, 4), inf where it misses; the ray; spheres in camera.

    record: the header's record of the view. |start + t step - centre|^2 = r^2, and t is the depth, since step_z = -1.
    """
    centres = record["scale"] * (CENTRES - record["centre"]) @ np.array(record["rotation"]).T
    radii, (x, y) = record["scale"] * RADII, pixels(size)
    zero, one = np.zeros_like(x), np.ones_like(x)
    if view.focal is None:
        start, step = np.stack([x, y, distance * one], -1), np.stack([zero, zero, -one], -1)
    else:
        start, step = np.stack([zero, zero, distance * one], -1), np.stack([x / distance, y / distance, -one], -1)
    gap = start[:, None] - centres
    a, b = (step**2).sum(1)[:, None], np.einsum("nx,nbx->nb", step, gap)
    root = b**2 - a * ((gap**2).sum(2) - radii**2)
    return np.where(root >= 0, (-b - np.sqrt(root.clip(0))) / a, np.inf), start, step, centres, radii


@pytest.mark.parametrize("view", VIEWS)
def test_balls_in_closed_form(view):
    """Silhouettes (ellipses in perspective), depth along the optical axis, and normals in the camera's axes."""
    size = 96
    maps = bake(balls(5), size, 1, view=view)
    distance = maps.info["camera_distance"]
    if view.focal is not None:
        assert maps.info["camera"] == "perspective" and distance == pytest.approx(view.focal / 18, abs=1e-6)
    depth, start, step, centres, radii = hits_of_spheres(view, maps.info["view"], distance, size)
    mask, which, nearest = np.isfinite(depth).any(1), depth.argmin(1), depth.min(1)
    assert np.count_nonzero(maps.mask.ravel() != mask) < 0.01 * mask.sum()  # facets lie inside of their sphere
    both = mask & maps.mask.ravel()
    normal = (start[both] + nearest[both, None] * step[both] - centres[which[both]]) / radii[which[both], None]
    facing = -np.einsum("nx,nx->n", normal, step[both]) / np.linalg.norm(step[both], axis=1)
    clear = facing > 0.2
    assert clear.mean() > 0.9
    same = np.abs(maps.depth.ravel()[both] - nearest[both]) < 5e-3
    assert same[clear].mean() > 0.99  # but along the seams where two balls meet
    turned = np.linalg.norm(maps.normal.reshape(-1, 3)[both] - normal, axis=1)
    assert np.median(turned[clear]) < 5e-3 and (turned[clear] < 0.02).mean() > 0.98


@pytest.mark.parametrize("view", VIEWS[:3])
def test_transport_and_what_is_bounced_are_the_frontal_ones_turned(view):
    """The same rays cast from the same points in the mesh's frame, their coefficients turned by the view's rotation."""
    size, rays, order = 40, 64, 3
    x, y = pixels(size)
    baker = Baker(balls(), replace(read_preset("bake"), size=size, rays=rays, order=order, bounces=1), seed=3)
    maps = baker.maps(view)
    pixel, face, weights = primary_hits(baker.caster, baker.camera(view), size * (1 + x) / 2, size * (1 - y) / 2)
    geometric = baker.caster.normals[face]
    normals = shading_normals(baker.normals, baker.mesh.faces, face, weights, geometric)
    np.testing.assert_array_equal(pixel, np.flatnonzero(maps.mask))
    rotation = np.array(maps.info["view"]["rotation"])
    np.testing.assert_allclose(maps.normal[maps.mask], normals @ rotation.T, atol=1e-6)
    found, turn = maps.transport[maps.mask], rotation_matrix(rotation, order)
    assert 0.5 < (found[:, 0] / unoccluded(normals, 0)[:, 0]).mean() < 0.95  # balls shade each other: a real test
    given = baker.caster.points(face, weights), normals, geometric, rays, order
    azimuth = random_azimuths(len(pixel), 3)
    there, _ = integrate(baker.caster, *given, azimuth=azimuth)
    np.testing.assert_allclose(found, there @ turn.T, atol=1e-5)
    _, bounced = integrate(baker.gather_caster, *given, azimuth=azimuth, radiosity=baker.radiosity)
    np.testing.assert_allclose(maps.bounced[maps.mask], np.einsum("jk,pkc->pjc", turn, bounced), atol=1e-5)
    assert maps.bounced[..., 0, 0].max() > 0.1


def shown(mesh, view):
    """The vertices' places (V, 2) in the picture of a view."""
    vertices = mesh.vertices.astype(float)
    placed = place_mesh(view, vertices)
    at = placed.to_camera(vertices)
    np.testing.assert_allclose(placed.to_mesh(at), vertices, atol=1e-9 * np.abs(vertices).max() + 1e-12)
    if view.focal is None:
        return at[:, :2]
    assert (at[:, 2] < view.distance).all()  # in front of the eye
    return view.distance * at[:, :2] / (view.distance - at[:, 2:])


@pytest.mark.parametrize("offset", [(0, 0, 0), (30, -20, 50)])
def test_the_figure_fills_the_picture_from_everywhere(offset):
    """Its box is centred, and the longer side that of the frontal view, whatever the lens."""
    vertices = np.random.default_rng(2).uniform(-1, 1, (198, 3)) ** 3 * [0.5, 0.9, 0.4]
    mesh = mesh_of(vertices + offset, np.arange(198).reshape(-1, 3))
    long = np.ptp(mesh.vertices.astype(float), axis=0)[:2].max()
    others = View(90, 15, 18), View(180, -15, 10000), View(20, 90), *(random_view(f"a{i}") for i in range(9))
    for view in (*VIEWS, *others):
        at = shown(mesh, view)
        np.testing.assert_allclose(at.min(0) + at.max(0), 0, atol=1e-9 * long)
        assert np.ptp(at, axis=0).max() == pytest.approx(long, rel=1e-9)


def test_the_frontal_view_is_left_as_it_is():
    mesh = balls()
    mesh.vertices -= (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    plain, frontal = bake(mesh, 32, 16), bake(mesh, 32, 16, view=View(0.0, -0.0, None))
    assert "view" not in plain.info and plain.info == frontal.info
    for name in ("mask", "albedo", "normal", "depth", "ao", "transport"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(frontal, name))
    turned = bake(mesh, 32, 16, view=View(1e-9))  # all but frontal: nothing is lost on the way
    assert np.count_nonzero(turned.mask != plain.mask) < 4
    both = turned.mask & plain.mask
    np.testing.assert_allclose(turned.normal[both], plain.normal[both], atol=1e-3)


def test_random_views():
    """The distribution that is stated; a view depends on its name and the seed alone."""
    names = [name for figure in range(1000) for name in view_names(f"g{figure:04d}", 3)]
    views = [random_view(name) for name in names]
    assert views[7] == random_view("g0002.v2")
    assert len({(view.yaw, view.pitch) for view in views}) == len(views) == 3000
    yaw, pitch = (np.array([getattr(view, key) for view in views]) for key in ("yaw", "pitch"))
    assert np.mean(np.abs(yaw) < 60) == pytest.approx(0.75 * 0.9545 + 0.25 / 3, abs=0.03)
    assert np.mean(np.abs(yaw) > 120) == pytest.approx(0.25 / 3, abs=0.02) and abs(yaw.mean()) < 4
    assert np.abs(pitch).max() == 15 and pitch.std() == pytest.approx(6, abs=0.4)
    lenses = np.array([view.focal for view in views if view.focal is not None])
    assert len(lenses) / len(views) == pytest.approx(0.75, abs=0.03) and lenses.min() >= 25 and lenses.max() <= 120
    assert np.median(lenses) == pytest.approx(np.sqrt(25 * 120), rel=0.06)


def test_invalid_views_are_refused():
    for view, words in (((181,), "yaw is 181"), ((float("nan"),), "yaw is nan"), ((0, 91), "pitch is 91"),
                        ((0, 0, 9), "from 10 to 10000")):  # fmt: skip
        with pytest.raises(UserError, match=words):
            View(*view)
    line = mesh_of([[0, 0, 0], [0, 0, 1], [0, 0, 2]], [[0, 1, 2]])
    with pytest.raises(UserError, match="no extent"):
        place_mesh(View(30), line.vertices.astype(float))
    spear = np.array([[-0.5, -0.9, 0], [0.5, -0.9, 0], [0, 0.9, 0], [0, 0, 1.2]])
    assert place_mesh(View(0, 0, 25), spear).scale > 0
    with pytest.raises(UserError, match="focal length 10: the eye would touch"):
        place_mesh(View(0, 0, 10), spear)
