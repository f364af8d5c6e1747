"""What the camera sees: geometry, albedo and transport of scenes that can be computed by hand, and bad scenes."""

from dataclasses import replace

import numpy as np
import pytest
import samples
import trimesh

from relight.core.errors import UserError
from relight.core.srgb import LINEAR
from relight.meshes import Material
from relight.settings import read_preset
from relight.sh import basis, unoccluded
from relight.transport import Baker, bake
from relight.transport.integrate import integrate
from relight.transport.raycaster import RayCaster
from relight.transport.sampling import random_azimuths, tangent_frames, vogel_directions

GREY = Material(np.full(3, 0.5, np.float32))


def mesh_of(vertices, faces, materials=(GREY,), **fields):
    return samples.mesh_of(vertices, faces, materials=[*materials], info={"name": "test", "seed": 5}, **fields)


def ball(radius=0.5, center=(0, 0, 0), subdivisions=5):
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    return mesh_of(sphere.vertices * radius + center, sphere.faces)


def screen(texture=None, z=0.0, color=None):
    """The square that fills the image, its texture upright."""
    corners, quad = [[-1, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]], np.array([[0, 1, 2], [0, 2, 3]])
    uv = np.float32([(0, 0), (1, 0), (1, 1), (0, 1)])[quad]
    color = None if color is None else color[quad]
    return mesh_of(corners, quad, [Material(np.ones(3, np.float32), texture)], uv=uv, color=color)


def random_mesh(faces=40, seed=0):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (faces, 1, 3)) + rng.normal(size=(faces, 3, 3)) * 0.3
    return corners.reshape(-1, 3), np.arange(3 * faces).reshape(-1, 3)


def test_ball():
    maps = bake(ball(0.5, (0.1, 0.2, -0.3)), 96, 256)
    y, x = 1 - (2 * np.arange(96) + 1) / 96, (2 * np.arange(96) + 1) / 96 - 1
    dx, dy = np.meshgrid(x - 0.1, y - 0.2)
    inside = dx**2 + dy**2 < 0.5**2
    assert np.count_nonzero(maps.mask != inside) < 4
    both = maps.mask & (dx**2 + dy**2 < 0.49**2)
    dz = np.sqrt(0.25 - dx[both] ** 2 - dy[both] ** 2)
    np.testing.assert_allclose(maps.depth[both], 2 - (dz - 0.3), atol=2e-3)
    normal = np.stack([dx[both], dy[both], dz], -1) / 0.5
    np.testing.assert_allclose(maps.normal[both], normal, atol=5e-3)
    np.testing.assert_allclose(maps.transport[both], unoccluded(normal), atol=1e-2)
    assert maps.ao[both].min() > 0.99 and maps.ao.max() <= 1
    np.testing.assert_array_equal(maps.albedo[maps.mask], np.float32(0.5))
    for layer in (maps.albedo, maps.normal, maps.depth, maps.ao, maps.transport, maps.coverage):
        assert layer.dtype == np.float32 and not layer[~maps.mask].any()
    assert maps.info["name"] == "test" and maps.info["rays"] == 256 and maps.info["backs"] == 0
    assert (maps.info["seed"], maps.info["ray_seed"]) == (5, 0)  # the figure's history is not overwritten


def test_a_slow_twin_agrees():
    """Every ray by hand: float64 Moeller-Trumbore against all triangles, the basis in world directions."""
    vertices, faces = random_mesh()
    caster, rng = RayCaster(vertices, faces, threads=1), np.random.default_rng(1)
    points, normals = rng.uniform(-0.5, 0.5, (30, 3)), rng.normal(size=(30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    fast, _ = integrate(caster, points, normals, normals, 64, order=3, seed=7)

    a, b, c = (vertices[faces[:, k]] for k in range(3))
    world = np.einsum("pij,ni->pnj", tangent_frames(normals, random_azimuths(len(normals), 7)), vogel_directions(64))
    slow = np.empty_like(fast)
    for p, (point, normal) in enumerate(zip(points, normals)):
        w, start = world[p], point + caster.offset * normal
        assert (w @ normal > 0).all()
        q = np.cross(w[:, None], (c - a)[None])
        det, s = np.einsum("fx,nfx->nf", b - a, q), start - a
        u, r = np.einsum("fx,nfx->nf", s, q) / det, np.cross(s, b - a)
        v, t = np.einsum("nx,fx->nf", w, r) / det, np.einsum("fx,fx->f", c - a, r)[None] / det
        seen = ~((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).any(1)
        open_part = np.pi / 64 * (basis(w, 3) * seen[:, None]).sum(0)
        # The control variate: what the same rays give with nothing in the way, against the exact integral.
        slow[p] = open_part + unoccluded(normal, 3) - np.pi / 64 * basis(w, 3).sum(0)
    assert 0.2 < (fast[:, 0] / unoccluded(normals, 0)[:, 0]).mean() < 0.8  # half of it blocked: a real test
    np.testing.assert_allclose(fast, slow, atol=1e-6)


def test_texture_is_upright_decoded_and_bilinear_and_vertex_color_interpolated():
    texture = np.random.default_rng(0).integers(0, 256, (8, 8, 3)).astype(np.uint8)
    maps = bake(screen(texture), 8, 1)
    np.testing.assert_allclose(maps.albedo, LINEAR[texture], atol=1e-5)  # texel centres are pixel centres
    doubled, a = bake(screen(texture), 16, 1).albedo, LINEAR[texture]
    expected = (0.75 * a[3, 4] + 0.25 * a[2, 4]) * 0.75 + (0.75 * a[3, 5] + 0.25 * a[2, 5]) * 0.25
    np.testing.assert_allclose(doubled[6, 9], expected, atol=1e-5)
    color = np.zeros((4, 3), np.float32)
    color[1:3, 0] = 1  # red grows to the right
    maps = bake(screen(color=color), 16, 1)
    np.testing.assert_allclose(maps.albedo[:, :, 0], np.tile((np.arange(16) + 0.5) / 16, (16, 1)), atol=1e-5)


def test_supersampling():
    mesh = ball(0.7)
    plain, smooth = bake(mesh, 40, 4), bake(mesh, 40, 64, supersample=8)
    np.testing.assert_array_equal(plain.mask, smooth.mask)
    np.testing.assert_array_equal(plain.coverage, plain.mask)
    assert smooth.coverage.mean() * 4 == pytest.approx(np.pi * 0.49, rel=2e-3)
    assert ((smooth.coverage > 0) & (smooth.coverage < 1)).sum() > 50
    np.testing.assert_allclose(smooth.albedo[smooth.mask], 0.5, atol=1e-6)  # not darkened at the edge
    checker = (np.indices((64, 64)).sum(0) % 2 * 255).astype(np.uint8)[..., None].repeat(3, 2)
    np.testing.assert_allclose(bake(screen(checker), 16, 16, supersample=4).albedo, 0.5, atol=1e-5)


@pytest.mark.slow
def test_supersampled_maps_are_means_of_a_finer_image():
    """Four times the size has a pixel for each of the 4 x 4 places, and rays enough to be the truth."""
    rng = np.random.default_rng(3)
    parts = [screen(z=-0.5)] + [ball(0.25, c) for c in rng.uniform(-0.6, 0.6, (12, 3)) * [1, 1, 0.4]]
    first = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = np.concatenate([part.faces + begin for part, begin in zip(parts, first)])
    mesh = mesh_of(np.concatenate([part.vertices for part in parts]), faces)
    coarse, shared, fine = bake(mesh, 32, 256), bake(mesh, 32, 256, supersample=4), bake(mesh, 128, 1024)

    def blocks(values):
        return values.reshape(32, 4, 32, 4, *values.shape[2:]).sum((1, 3))

    hits = blocks(fine.mask.astype(float))
    np.testing.assert_array_equal(shared.coverage, (hits / 16).astype(np.float32))
    seen = shared.mask & (hits > 0)
    truth = blocks(fine.transport)[seen] / hits[seen][:, None]
    errors = [np.sqrt(((maps.transport[seen] - truth) ** 2).sum(1).mean()) for maps in (coarse, shared)]
    assert errors[1] < 0.03 and errors[1] < errors[0] / 4
    flat = seen & (blocks((fine.normal[..., 2] < 0.99).astype(float)) == 0)  # one surface, whose shadows are soft
    even = [np.abs(maps.transport[flat] - (blocks(fine.transport)[flat] / 16)).mean() for maps in (coarse, shared)]
    assert even[1] < 1.2 * even[0]  # places add no noise of their own
    normal = blocks(fine.normal)[seen]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(shared.normal[seen], normal, atol=1e-5)
    np.testing.assert_array_equal(shared.depth, coarse.depth)


def test_surfaces_that_all_samples_miss_are_sampled_at_the_centre():
    """A thread through the pixels' centres, thinner than the places lie apart."""
    y = 1 - 2 * 8.5 / 16
    thread = np.array([[-1, y - 1e-3, 0], [1, y - 1e-3, 0], [1, y + 1e-3, 0], [-1, y + 1e-3, 0]], np.float32)
    maps = bake(mesh_of(thread, np.array([[0, 1, 2], [0, 2, 3]])), 16, 16, supersample=4)
    assert maps.mask.sum() == 16 and maps.coverage.max() == 0
    np.testing.assert_allclose(maps.normal[maps.mask], [[0, 0, 1]] * 16, atol=1e-6)
    np.testing.assert_allclose(maps.ao[maps.mask], 1, atol=1e-6)
    with pytest.raises(UserError, match="at least 16, one for each"):
        bake(ball(0.5), 16, 15, supersample=4)


def test_backs_are_surfaces():
    """An open bowl seen from inside has the same maps whichever way its faces are wound."""
    bowl = trimesh.creation.icosphere(subdivisions=4)
    lower = bowl.triangles_center[:, 2] < 0
    faces = bowl.faces[lower][:, ::-1], bowl.faces[lower]
    right, wrong = (bake(mesh_of(bowl.vertices * 0.8, each), 48, 64) for each in faces)
    assert right.info["backs"] < 0.01 and wrong.info["backs"] > 0.99
    np.testing.assert_allclose(wrong.normal, right.normal, atol=1e-6)
    np.testing.assert_allclose(wrong.transport, right.transport, atol=1e-5)
    middle = right.mask & (right.normal[..., 2] > 0.99)
    assert right.ao[middle].mean() == pytest.approx(0.5, abs=5e-3)  # form factor of the opening, half a sphere


def test_cloth_on_skin():
    """A sheet 4e-5 of the diagonal above a surface, a tenth of a millimetre on a person, shuts the light out."""
    sheet, skin = screen(z=1e-4), screen(z=0)
    mesh = mesh_of(np.concatenate([sheet.vertices, skin.vertices]), np.concatenate([sheet.faces, skin.faces + 4]))
    caster = RayCaster(mesh.vertices, mesh.faces)
    points, up = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 3)) * [1, 1, 0], np.tile([0.0, 0.0, 1.0], (50, 1))
    transport, _ = integrate(caster, points, up, up, 256)
    assert np.abs(transport).max() < 3e-2  # the rule's own error where everything is blocked
    seen = bake(mesh, 16, 16)
    np.testing.assert_allclose(seen.transport, np.broadcast_to(unoccluded(up[0]), (16, 16, 9)), atol=1e-6)


def test_far_from_the_origin():
    """Transport doesn't depend on where the mesh is, to what float32 vertices hold there."""
    vertices, faces = random_mesh()
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (30, 3))
    normals = np.tile([0.0, 0.6, 0.8], (30, 1))
    near, _ = integrate(RayCaster(vertices, faces), points, normals, normals, 256)
    far, _ = integrate(RayCaster(vertices + 1e5, faces), points + 1e5, normals, normals, 256)
    assert np.sqrt(((near - far) ** 2).mean()) < 1e-3


@pytest.mark.slow
def test_results_do_not_depend_on_threads_or_batches(monkeypatch):
    vertices, faces = random_mesh()
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (101, 3))
    normals = np.tile([0.0, 0.6, 0.8], (101, 1))
    once, _ = integrate(RayCaster(vertices, faces, 1), points, normals, normals, 100, order=3)
    for threads, batch in ((2, 1 << 18), (0, 700), (1, 100), (2, 1)):
        monkeypatch.setattr("relight.transport.integrate.BATCH", batch)
        again, _ = integrate(RayCaster(vertices, faces, threads), points, normals, normals, 100, order=3)
        np.testing.assert_array_equal(once, again)
    other, _ = integrate(RayCaster(vertices, faces, 1), points, normals, normals, 100, order=3, seed=1)
    assert (once != other).any()


def test_outfits_share_all_but_albedo_and_gloss():
    mesh = screen(np.full((2, 2, 3), 200, np.uint8), z=-0.5)
    wall = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0]])  # casts its shade on the screen
    fields = {"uv": np.concatenate([mesh.uv, np.zeros((1, 3, 2), np.float32)]), "material": np.int16([0, 0, 1])}
    faces = np.concatenate([mesh.faces, [[4, 5, 6]]])
    mesh = mesh_of(np.concatenate([mesh.vertices, wall]), faces, [*mesh.materials, GREY], **fields)
    other = Material(np.array([0.1, 0.2, 0.3], np.float32), roughness=0.25, specular=0.75)
    settings = replace(read_preset("bake"), size=32, rays=32, supersample=2)
    own, changed = Baker(replace(mesh, outfits=[{0: other}]), settings).outfits()
    alone = Baker(mesh, settings).maps()
    repainted = Baker(replace(mesh, materials=[other, *mesh.materials[1:]]), settings).maps()
    for name in ("mask", "coverage", "albedo", "normal", "depth", "ao", "transport"):
        np.testing.assert_array_equal(getattr(own, name), getattr(alone, name))
        np.testing.assert_array_equal(getattr(changed, name), getattr(repainted, name))
    share = np.abs(changed.albedo[..., 0] - 0.1) < 1e-6  # pixels of the other material alone
    np.testing.assert_allclose(changed.gloss[share], np.broadcast_to([0.25, 0.75], (share.sum(), 2)), atol=1e-6)
    np.testing.assert_allclose(own.gloss[own.mask], np.broadcast_to([1.0, 0.0], (own.mask.sum(), 2)), atol=1e-6)
    mixed = changed.mask & (changed.gloss[..., 1] > 1e-3) & (changed.gloss[..., 1] < 0.749)
    np.testing.assert_allclose(1 - changed.gloss[mixed, 0], changed.gloss[mixed, 1], atol=1e-6)  # .75 of each
    assert share.sum() > 50 and mixed.any() and alone.gloss is None
    assert (changed.albedo != own.albedo).any() and own.info == changed.info and own.info is not changed.info
    with pytest.raises(UserError, match="bounces must be 0"):
        Baker(replace(mesh, outfits=[{0: other}]), replace(settings, bounces=1))


def broken(**changes):
    mesh = ball(0.5, subdivisions=2)
    for name, value in changes.items():
        setattr(mesh, name, value)
    return mesh


def test_bad_meshes_are_named():
    good = ball(0.5, subdivisions=2)
    poisoned, texture = good.vertices.copy(), np.zeros((2, 2, 3), np.uint8)
    poisoned[3] = np.nan
    cases = [
        (mesh_of(np.zeros((0, 3)), np.zeros((0, 3))), "no faces"),
        (broken(vertices=poisoned), "not finite"),
        (broken(vertices=np.zeros_like(good.vertices)), "degenerate"),
        (broken(faces=good.faces + 10), "162 vertices but its faces use 10 to 171"),
        (broken(vertices=good.vertices + np.float32([5, 0, 0])), "sees nothing.*x 4.5 to 5.5"),
        (broken(material=np.full(len(good.faces), 3, np.int16)), "1 materials"),
        (broken(color=np.full((len(good.faces), 3, 3), np.nan, np.float32)), "colors that are not finite"),
        (broken(materials=[Material(texture=texture)], uv=good.uv + np.float32(np.inf)), "texture coordinates"),
    ]
    for mesh, words in cases:
        with pytest.raises(UserError, match=words):
            bake(mesh, 16, 4)
    for setting in ({"rays": 0}, {"order": -1}, {"supersample": 0}, {"bounces": -1}, {"size": 0}):
        with pytest.raises(UserError, match="at least"):
            bake(good, **{"size": 8, "rays": 4, **setting})
    with pytest.raises(ValueError, match="finite"):
        integrate(RayCaster(good.vertices, good.faces), np.full((1, 3), np.nan), np.eye(3)[:1], np.eye(3)[:1], 4)


def test_bad_parts_of_a_mesh_are_ignored():
    """Unused NaN vertices, some degenerate faces, faces outside the image and holes: baked, by the stated rules."""
    good = ball(0.5, subdivisions=4)
    expected = bake(good, 32, 64)
    maps = bake(mesh_of(np.concatenate([good.vertices, np.full((1, 3), np.nan, np.float32)]), good.faces), 32, 64)
    np.testing.assert_array_equal(maps.transport, expected.transport)
    maps = bake(mesh_of(good.vertices, np.concatenate([good.faces, [[0, 0, 1], [5, 5, 5]]])), 32, 64)
    np.testing.assert_array_equal(maps.transport, expected.transport)
    assert np.isfinite(maps.transport).all() and np.isfinite(maps.normal).all()
    half_out = bake(mesh_of(good.vertices + np.float32([1, 0, 0]), good.faces), 32, 16)
    assert half_out.mask[:, -1].any() and half_out.mask.sum() == pytest.approx(expected.mask.sum() / 2, rel=0.1)
    holed = np.delete(good.faces, np.flatnonzero(good.vertices[good.faces].mean(1)[:, 2] < -0.45), axis=0)
    maps = bake(mesh_of(good.vertices, holed), 32, 64)  # open at the back, closed in front: nothing to see of it
    np.testing.assert_allclose(maps.transport, expected.transport, atol=1e-6)


def test_bad_normals_fall_back_to_the_face():
    """Randomly wound faces of a scan: vertex normals that mean nothing never turn a pixel away from its own face."""
    good = ball(0.5, subdivisions=4)
    flip = np.random.default_rng(0).random(len(good.faces)) < 0.5
    maps = bake(mesh_of(good.vertices, np.where(flip[:, None], good.faces[:, ::-1], good.faces)), 48, 64)
    expected = bake(good, 48, 64)
    inner = maps.mask & (expected.normal[..., 2] > 0.2)
    assert np.isfinite(maps.transport).all() and maps.transport[..., 0].max() < 0.8863
    assert (np.einsum("hwc,hwc->hw", maps.normal, expected.normal)[inner] > 0).all() and maps.ao[inner].min() > 0.5
