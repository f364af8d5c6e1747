"""The printed tables of Ramamoorthi & Hanrahan 2001, from maps of the same probes.

Debevec's light probes are not ours to give away: RELIGHT_PROBES=<folder> has them (docs/lab/lights.md), and
the tests that read them are skipped without it. What can be known without them is a twin of the paper's program.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from relight.lights import load_light
from relight.lights.load import PROBES, printed_probe
from relight.panoramas import Panorama, project, read_panorama
from relight.panoramas.read import SUFFIXES
from relight.sh import from_relight

FOLDER = Path(os.environ.get("RELIGHT_PROBES", ""))
# What names of probe files begin with, their table, and the scale of figure 2 of the paper over the file's; the scale
# of the tables that the paper does not have is not known.
TABLES = {
    "grace": ("grace", 1.0),  # prefilter.c prints the file's own units
    "rnl": ("eucalyptus", 0.1),
    "eucalyptus": ("eucalyptus", 0.1),
    "stpeters": ("stpeters", 0.1),
    "kitchen": ("kitchen", None),
    "galileo": ("galileo", None),
}


def prefilter(pixels):
    """A twin of the paper's prefilter.c, pixel by pixel: (9, 3) of an angular map (n, n, 3), row 0 at the top.

    Its v runs up and its u to the right, z is the centre of the map; its samples are the corners of pixels.
    """
    n = len(pixels)
    table = np.zeros((9, 3))
    for i in range(n):
        for j in range(n):
            v, u = (n / 2 - i) / (n / 2), (j - n / 2) / (n / 2)
            r = np.hypot(u, v)
            if r > 1:
                continue
            theta, phi = np.pi * r, np.arctan2(v, u)
            x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
            solid_angle = (2 * np.pi / n) ** 2 * np.sinc(theta / np.pi)
            polynomials = (
                0.282095, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z,
                0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y),
            )  # fmt: skip
            table += np.outer(polynomials, pixels[i, j]) * solid_angle
    return table


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


def latlong(h):
    theta = (np.arange(h) + 0.5)[:, None] / h * np.pi
    phi = ((np.arange(2 * h) + 0.5) / (2 * h) * 2 - 1) * np.pi
    x, y, z = np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi))
    return scene(np.stack([x, y, z], -1)).astype(np.float32)


def test_an_angular_map_agrees_with_a_twin_of_prefilter_c(tmp_path):
    """But for its half pixel, which is 3 % of L00 here and .3 % at the 1,000 px of a probe; a wrong sign is 30 %."""
    pixels = angular(100)
    (tmp_path / "a_probe.pfm").write_bytes(b"PF\n100 100\n-1.0\n" + pixels[::-1].tobytes())
    ours = from_relight(load_light(tmp_path / "a_probe.pfm", layout="angular").coefficients, "ramamoorthi2001")
    assert abs(ours - prefilter(pixels)).max() < 0.04 * ours[0].max()
    assert abs(ours[1:]).max(1).min() > 0.1 * ours[0].max()  # no coefficient is so small that its sign would not show


def test_angular_map_and_latlong_of_one_scene_are_one_light():
    """Both have forward, -z, at the centre and +x to the right: no yaw lies between them."""
    ball, flat = (project(Panorama(p, kind)) for p, kind in ((angular(256), "angular"), (latlong(128), "latlong")))
    assert abs(ball - flat).max() < 1e-3 * flat[0].max()


def probe_files():
    """Files of RELIGHT_PROBES whose table is known."""
    if not os.environ.get("RELIGHT_PROBES"):
        return []
    files = sorted(file for file in FOLDER.rglob("*") if file.suffix.lower() in SUFFIXES)
    return [file for file in files if file.stem.lower().startswith(tuple(TABLES))]


@pytest.mark.skipif(not probe_files(), reason="RELIGHT_PROBES names no folder with light probes")
@pytest.mark.parametrize("file", probe_files(), ids=lambda file: file.name)
def test_a_measured_probe_gives_the_printed_table(file):
    """Grace to 1 % of L00; the others to their two digits and 1 %; unknown scales are fitted."""
    name, scale = next(entry for start, entry in TABLES.items() if file.stem.lower().startswith(start))
    table = printed_probe(name)
    tolerance = 0.01 * abs(table[0]) + (0 if name == "grace" else 0.006)
    tried = []
    for upside_down in (False, True):  # pbrt's grace_latlong.exr has its rows from the bottom up
        panorama = read_panorama(file, layout=layout_of(file), upside_down=upside_down)
        ours = from_relight(project(panorama), "ramamoorthi2001")
        ours *= float((ours * table).sum() / (ours * ours).sum()) if scale is None else scale
        tried.append(ours)
    best = min(tried, key=lambda ours: float((abs(ours - table) / tolerance).max()))
    assert (abs(best - table) < tolerance).all(), f"{file.name}:\n{best}\nprinted:\n{table}"


def layout_of(file):
    """Light probes are square and angular; what is not square tells itself."""
    from relight.core.errors import UserError

    try:
        return read_panorama(file).layout
    except UserError:
        return "angular"


def test_every_printed_table_has_a_test():
    assert {name for name, _ in TABLES.values()} == set(PROBES)
