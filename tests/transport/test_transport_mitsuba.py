"""The nine coefficients against a path tracer that shares no code with the baker (needs the `bench` extra)."""

import numpy as np
import pytest
import trimesh

from relight.meshes import Material, Mesh
from relight.sh import basis
from relight.transport import PathTracer, bake
from relight.transport.tracer import block_means, interior_blocks, sky_directions, sky_weights

pytest.importorskip("mitsuba")

ALBEDO = np.float32([0.8, 0.5, 0.3])


@pytest.fixture(scope="module")
def knot():
    """A bumpy ball with a ring around it: every pixel is partly occluded, smoothly shaded."""
    ball = trimesh.creation.icosphere(subdivisions=5)
    v = ball.vertices * (0.55 + 0.05 * np.sin(7 * ball.vertices).prod(1, keepdims=True))
    ring = trimesh.creation.torus(0.75, 0.12, major_sections=128, minor_sections=48)
    ring.apply_transform(trimesh.transformations.rotation_matrix(1.1, [1, 0.3, 0]))
    faces = np.concatenate([ball.faces, ring.faces + len(v)])
    return Mesh(
        vertices=np.concatenate([v, ring.vertices]).astype(np.float32),
        faces=faces.astype(np.int32),
        uv=np.zeros((len(faces), 3, 2), np.float32),
        material=np.zeros(len(faces), np.int16),
        materials=[Material(ALBEDO)],
    )


def test_every_coefficient(knot):
    """A constant plus one harmonic per colour channel, three renderings."""
    maps = bake(knot, 128, 256)
    transport, where = block_means(maps.transport, 4), interior_blocks(maps.mask, 4)
    assert where.sum() > 150 and maps.ao[maps.mask].mean() < 0.9
    tracer, values = PathTracer(knot, 32), basis(sky_directions())
    for first in (0, 3, 6):
        light = np.zeros((9, 3))
        light[0] = 1.5 * np.sqrt(4 * np.pi)
        light[range(first, first + 3), range(3)] += 1
        traced = tracer.radiance(values @ light, 144)[where]
        baked = (ALBEDO / np.pi * (transport @ light))[where]
        relative = (baked - traced) / traced.mean(0)
        assert np.abs(relative.mean(0)).max() < 2.5e-3
        assert relative.std(0).max() < 0.03  # the tracer's noise
        fit = [np.polyfit(traced[:, c] - traced[:, c].mean(), baked[:, c], 1)[0] for c in range(3)]
        np.testing.assert_allclose(fit, 1, atol=0.02)


def test_a_bounce_in_colour(knot):
    maps = bake(knot, 128, 256, bounces=1)
    direct, where = block_means(maps.transport, 4), interior_blocks(maps.mask, 4)
    bounced = block_means(maps.bounced, 4)
    light = np.zeros((9, 3))
    light[:3] = [[4.0] * 3, [1.5] * 3, [1.0] * 3]
    traced = PathTracer(knot, 32).radiance(basis(sky_directions()) @ light, 144, bounces=1)[where]
    first = (ALBEDO / np.pi * (direct @ light))[where]
    second = (ALBEDO / np.pi * np.einsum("hwkc,kc->hwc", bounced, light))[where]
    assert (second.mean(0) / traced.mean(0))[0] > 0.03  # it matters here
    relative = (first + second - traced) / traced.mean(0)
    assert np.abs(relative.mean(0)).max() < 3e-3


def test_irradiance_of_a_truncated_light(knot):
    """Light of both signs, and an albedo that varies within pixels: neither may show."""
    rng = np.random.default_rng(0)
    striped = Mesh(**{**vars(knot), "color": rng.uniform(0.2, 1, (len(knot.vertices), 3)).astype(np.float32)})
    light = np.zeros((9, 3))
    light[0], light[1:] = 1.5, rng.normal(0, 1, (8, 3))
    sky = basis(sky_directions()) @ light
    assert sky.min() < -1
    np.testing.assert_allclose(
        np.einsum("hw,hwk,hwc->kc", sky_weights(), basis(sky_directions()), sky), light, atol=1e-3
    )
    maps = bake(knot, 128, 64)
    baked, where = block_means(maps.transport, 4) @ light, interior_blocks(maps.mask, 4)
    traced = PathTracer(striped, 32).irradiance(sky, 64)
    assert np.abs((traced - baked)[where].mean(0)).max() < 0.02
    assert (traced - baked)[where].std(0).max() < 0.3  # the tracer's noise
    assert (traced[:, [0, -1]] == 0).all()  # no mesh
