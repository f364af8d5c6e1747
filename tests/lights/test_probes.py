"""An angular map gives the coefficients of Ramamoorthi & Hanrahan 2001, by a twin of their program."""

import numpy as np
from samples import write_exr

from relight.lights import load_light
from relight.sh import from_relight


def prefilter(pixels):
    """A twin of the paper's prefilter.c: (9, 3) of an angular map (n, n, 3), row 0 at the top.

    Its v runs up and its u to the right, z is the centre of the map; its samples are the corners of pixels.
    """
    n = len(pixels)
    i, j = np.mgrid[:n, :n]
    v, u = (n / 2 - i) / (n / 2), (j - n / 2) / (n / 2)
    theta, phi = np.pi * np.hypot(u, v), np.arctan2(v, u)
    x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    solid_angle = (2 * np.pi / n) ** 2 * np.sinc(theta / np.pi) * (theta <= np.pi)
    polynomials = np.stack([
        0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z,
        0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y),
    ])  # fmt: skip
    return np.einsum("kij,ij,ijc->kc", polynomials, solid_angle, pixels)


def scene(directions):
    """Radiance (..., 3) toward directions in the camera's frame: a wide lamp in each of red, green, blue, not alike."""
    lamps = np.array([[0.7, 0.6, -0.39], [-0.5, 0.2, -0.84], [0.6, -0.3, 0.74]])
    lamps /= np.linalg.norm(lamps, axis=1, keepdims=True)
    return 0.1 + np.exp(4 * (directions @ lamps.T - 1))


def angular(n):
    t = (np.arange(n) + 0.5) / n * 2 - 1
    u, v = np.meshgrid(t, -t)
    r, phi = np.hypot(u, v), np.arctan2(v, u)
    theta = np.pi * r  # forward, -z, at the centre (Debevec: "straight forward")
    d = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)], -1)
    return (scene(d) * (r <= 1)[..., None]).astype(np.float32)


def test_an_angular_map_agrees_with_a_twin_of_prefilter_c(tmp_path):
    """But for its half pixel, which is 3 % of L00 here and .3 % at the 1,000 px of a probe; a wrong sign is 30 %."""
    pixels = angular(100)
    path = write_exr(tmp_path / "a_probe.exr", pixels)
    ours = from_relight(load_light(path, layout="angular").coefficients, "ramamoorthi2001")
    assert abs(ours - prefilter(pixels)).max() < 0.04 * ours[0].max()
    assert abs(ours[1:]).max(1).min() > 0.1 * ours[0].max()  # no coefficient is so small that its sign would not show
