"""The nine coefficients against a path tracer that shares no code with the baker (needs the `bench` extra)."""

import numpy as np
import pytest
import trimesh
from samples import mesh_of
from scipy import ndimage

from relight.meshes import Material
from relight.sh import basis
from relight.transport import PathTracer, bake
from relight.transport.tracer import sky_directions

pytest.importorskip("mitsuba")

ALBEDO = np.float32([0.8, 0.5, 0.3])


def block_means(image, k):
    """The means (H/k,W/k,...) over the k x k blocks of an image (H,W,...)."""
    height, width = image.shape[0] // k, image.shape[1] // k
    return image.reshape(height, k, width, k, *image.shape[2:]).mean((1, 3))


def interior_blocks(mask, k):
    return ndimage.binary_erosion(block_means(mask.astype(float), k) == 1, np.ones((3, 3)))


@pytest.fixture(scope="module")
def knot():
    """A bumpy ball with a ring around it: every pixel is partly occluded, smoothly shaded."""
    ball = trimesh.creation.icosphere(subdivisions=5)
    v = ball.vertices * (0.55 + 0.05 * np.sin(7 * ball.vertices).prod(1, keepdims=True))
    ring = trimesh.creation.torus(0.75, 0.12, major_sections=128, minor_sections=48)
    ring.apply_transform(trimesh.transformations.rotation_matrix(1.1, [1, 0.3, 0]))
    faces = np.concatenate([ball.faces, ring.faces + len(v)])
    return mesh_of(np.concatenate([v, ring.vertices]), faces, materials=[Material(ALBEDO)])


def test_every_coefficient(knot):
    """A constant plus one harmonic per color channel, three renderings."""
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


def test_a_bounce_in_color(knot):
    maps = bake(knot, 128, 256, bounces=1)
    direct, bounced = block_means(maps.transport, 4), block_means(maps.bounced, 4)
    where = interior_blocks(maps.mask, 4)
    light = np.zeros((9, 3))
    light[:3] = [[4.0] * 3, [1.5] * 3, [1.0] * 3]
    traced = PathTracer(knot, 32).radiance(basis(sky_directions()) @ light, 144, bounces=1)[where]
    first = (ALBEDO / np.pi * (direct @ light))[where]
    second = (ALBEDO / np.pi * np.einsum("hwkc,kc->hwc", bounced, light))[where]
    assert (second.mean(0) / traced.mean(0))[0] > 0.03  # it matters here
    relative = (first + second - traced) / traced.mean(0)
    assert np.abs(relative.mean(0)).max() < 3e-3


@pytest.fixture
def plate():
    """A square that faces the camera and fills its picture, with a texture of 16 x 16 random colors."""
    corners = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    faces = np.int32([[0, 1, 2], [0, 2, 3]])
    texture = np.random.default_rng(4).integers(60, 250, (16, 16, 3)).astype(np.uint8)
    return mesh_of(corners, faces, uv=((corners[:, :2] + 1) / 2)[faces], materials=[Material(texture=texture)])


def test_textures_are_those_that_are_baked(plate):
    traced = PathTracer(plate, 64).radiance(np.ones((64, 128, 3)), 64)
    albedo = bake(plate, 64, 16, supersample=4).albedo
    assert np.abs(traced - albedo).mean() < 0.01 and np.abs((traced - albedo).mean()) < 0.003
    assert np.abs(traced[::-1] - albedo).mean() > 0.1 < np.abs(traced[:, ::-1] - albedo).mean()


def test_gloss_adds_four_percent(plate):
    """Fresnel's ((n - 1) / (n + 1))^2 of n = 1.5 at right angles, on top of the albedo."""
    for albedo, specular in ((0.0, 1.0), (0.0, 0.5), (0.5, 1.0)):
        plate.materials = [Material(np.full(3, albedo, np.float32), roughness=0.2, specular=specular)]
        found = PathTracer(plate, 16, gloss=True).radiance(np.ones((64, 128, 3)), 256)
        assert np.isclose(found.mean(), albedo + 0.04 * specular, atol=0.003 + 0.02 * albedo)
