import numpy as np
import pytest

from relight.panoramas import Panorama, project
from relight.sh import basis, coefficient_count, rotate_y, sphere_quadrature

ASPECTS = {  # rows and columns of faces
    "latlong": (1, 2), "angular": (1, 1), "ball": (1, 1), "cross": (4, 3), "cross-lying": (3, 4), "strip": (6, 1),
    "strip-gl": (1, 6),
}  # fmt: skip


@pytest.mark.parametrize("layout", ASPECTS)
def test_a_constant_map_has_l00_alone(layout):
    rows, columns = ASPECTS[layout]
    pixels = np.full((5 * rows, 5 * columns, 3), [1, 2, 3], np.float32)
    light, expected = project(Panorama(pixels, layout.removesuffix("-lying")), 4), np.eye(25, 1) * [1, 2, 3]
    np.testing.assert_allclose(light, np.sqrt(4 * np.pi) * expected, atol=1e-12 if layout == "latlong" else 3e-6)


@pytest.mark.parametrize("layout, shape", [("latlong", (9, 17)), ("latlong", (64, 128)), ("strip", (6 * 16, 16))])
def test_a_constant_map_of_corner_samples(layout, shape):
    light = project(Panorama(np.ones((*shape, 3), np.float32), layout, corners=True, front="+z"), 4)
    assert abs(light - np.sqrt(4 * np.pi) * np.eye(25, 1)).max() < 1e-9


def latlong_pixel_directions(h, w):
    theta = (np.arange(h) + 0.5)[:, None] / h * np.pi
    phi = (2 * (np.arange(w) + 0.5) / w - 1) * np.pi
    return np.stack(np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)), -1)


def test_latlong_cells_agree_with_brute_force():
    """The slow twin: every pixel cut into 40 x 40 and summed."""
    pixels = np.random.default_rng(0).random((6, 12, 3)).astype(np.float32)
    fine = pixels.repeat(40, 0).repeat(40, 1)
    h, w = fine.shape[:2]
    weight = -np.diff(np.cos(np.arange(h + 1) / h * np.pi)) * 2 * np.pi / w
    slow = np.einsum("hwk,h,hwc->kc", basis(latlong_pixel_directions(h, w), 3), weight, fine)
    np.testing.assert_allclose(project(Panorama(pixels), 3), slow, atol=5e-4)


@pytest.mark.parametrize("columns", [1, 5, -3])
def test_rolling_whole_columns_is_a_rotation_and_a_flip_the_mirror_image(columns):
    pixels = np.random.default_rng(1).random((16, 32, 3)).astype(np.float32)
    light = project(Panorama(pixels), 4)
    rolled = project(Panorama(np.roll(pixels, columns, axis=1)), 4)
    np.testing.assert_allclose(rolled, rotate_y(light, -2 * np.pi * columns / 32), atol=1e-12)
    np.testing.assert_allclose(project(Panorama(pixels, yaw=-360 * columns / 32), 4), rolled, atol=1e-12)
    np.testing.assert_allclose(project(Panorama(pixels, flip=True)), project(Panorama(pixels[:, ::-1])), atol=1e-12)


def smooth_scene(d):
    """A window, a lamp and a bounce, smooth enough to be sampled: (N, 3) -> (N, 3)."""
    window = np.exp(6 * (d @ np.array([0.6, 0.48, 0.64]) - 1))[..., None] * np.array([4.0, 5.0, 7.0])
    lamp = np.exp(20 * (d @ np.array([-0.8, 0.6, 0.0]) - 1))[..., None] * np.array([9.0, 6.0, 3.0])
    return 0.3 + window + lamp + 0.2 * np.maximum(-d[..., 1:2], 0) ** 2


def drawn(layout, n):
    """smooth_scene as a picture in `layout`: corner samples for the OpenEXR kinds."""
    if layout == "latlong":
        return Panorama(smooth_scene(latlong_pixel_directions(n, 2 * n)).astype(np.float32))
    if layout == "latlong-exr":
        theta, phi = np.linspace(0, np.pi, n)[:, None], np.linspace(np.pi, -np.pi, 2 * n)
        d = np.stack(np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)), -1)
        return Panorama(smooth_scene(d).astype(np.float32), corners=True, front="+z")
    corners = layout == "strip-exr"
    t = np.linspace(-1, 1, n) if corners else 2 * (np.arange(n) + 0.5) / n - 1
    if layout in ("angular", "ball"):
        u, v = np.meshgrid(t, t)
        r, phi = np.hypot(u, v), np.arctan2(-v, u)
        theta = np.pi * (1 - r) if layout == "angular" else 2 * np.arcsin(np.minimum(r, 1))
        d = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
        return Panorama(np.where(r[..., None] < 1 + 2 / n, smooth_scene(d), 1e6).astype(np.float32), layout)
    faces = {}
    for axis, (forward, right, down) in SEEN.items():
        forward, right, down = np.array(forward, float), np.array(right, float), np.array(down, float)
        d = forward + t[None, :, None] * right + t[:, None, None] * down
        faces[axis] = smooth_scene(d / np.linalg.norm(d, axis=-1, keepdims=True)).astype(np.float32)
    if layout.startswith("cross"):
        return Panorama(unfolded(faces, n, lying=layout == "cross-lying"), "cross")
    if layout == "strip-gl":  # left-handed: its +z face is the one ahead of our camera
        return Panorama(np.concatenate([faces[a] for a in ("+x", "-x", "+y", "-y", "-z", "+z")], 1), layout)
    return Panorama(np.concatenate(list(faces.values())), "strip", corners=corners)


# Axis, image right and image down of each face in an OpenEXR cube, from its documentation.
SEEN = {
    "+x": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-x": ((-1, 0, 0), (0, 0, -1), (0, -1, 0)),
    "+y": ((0, 1, 0), (1, 0, 0), (0, 0, -1)),
    "-y": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "+z": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),
    "-z": ((0, 0, -1), (1, 0, 0), (0, -1, 0)),
}


def unfolded(faces, n, lying):
    """A cross as a person would cut it from paper: -z in the middle, its neighbours around it."""
    picture = np.zeros((3 * n, 4 * n, 3) if lying else (4 * n, 3 * n, 3), np.float32)
    for axis, (i, j) in {"+y": (0, 1), "-x": (1, 0), "-z": (1, 1), "+x": (1, 2), "-y": (2, 1)}.items():
        picture[n * i : n * (i + 1), n * j : n * (j + 1)] = faces[axis]
    if lying:
        picture[n : 2 * n, 3 * n :] = faces["+z"]
    else:
        picture[3 * n :, n : 2 * n] = faces["+z"][::-1, ::-1]
    return picture


@pytest.mark.parametrize("layout", [*ASPECTS, "latlong-exr", "strip-exr"])
def test_every_layout_of_one_scene_is_the_same_light(layout):
    directions, weights = sphere_quadrature(80)
    truth = basis(directions).T @ (weights[:, None] * smooth_scene(directions))
    light = project(drawn(layout, 128), 2)
    assert light.shape == (coefficient_count(2), 3)
    # Half of what is asked between any two. The rim of a ball photo packs the back wall into a few pixels.
    assert abs(light - truth).max() < (2e-3 if layout in ("ball", "angular") else 5e-4) * truth[0].max()
