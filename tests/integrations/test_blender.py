"""The extension in Blender itself, where `bpy` is installed; what needs none of it runs everywhere.

python -m venv bpyenv; bpyenv/bin/pip install bpy pytest "numpy<2"
bpyenv/bin/python -m pytest tests/integrations/test_blender.py     # with relight on the PATH
"""

import importlib.util
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "integrations" / "blender"
SIZE = 96  # pixels of a render
in_blender = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy, Blender as a module")


def load(name: str, path: Path, **options):
    """Imports a file as the module `name`."""
    spec = importlib.util.spec_from_file_location(name, path, **options)
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def light():
    """light.py, which imports no bpy."""
    return load("relight_blender_light", FOLDER / "light.py")


def test_basis_is_that_of_relight(light):
    harmonics = pytest.importorskip("relight.sh.harmonics")
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(light.basis(directions), harmonics.basis(directions, 2), atol=1e-7)


def test_sphere_integrates_the_basis_to_its_norms(light):
    directions, angle = light.sphere(64)
    values = light.basis(directions)
    products = np.einsum("hwa,hwb,hw->ab", values, values, np.broadcast_to(angle, values.shape[:2]))
    np.testing.assert_allclose(products, np.eye(9), atol=2e-3)


@pytest.mark.parametrize("shape", [(64, 128), (100, 200), (20, 40), (500, 1000)])
def test_shrunk_panorama_keeps_its_mean_and_its_sides(light, shape):
    ramp = np.broadcast_to(np.linspace(0, 1, shape[1])[:, None], (*shape, 3))
    small = light.shrunk(ramp, 16)
    assert small.shape == (16, 32, 3) and abs(small.mean() - 0.5) < 0.01
    assert (np.diff(small[:, :, 0], axis=1) > 0).all()


def test_manifest_has_what_blender_requires():
    manifest = tomllib.loads((FOLDER / "blender_manifest.toml").read_text())
    required = "schema_version id version name tagline maintainer type blender_version_min license".split()
    assert [key for key in required if not manifest.get(key)] == []
    assert len(manifest["tagline"]) <= 64 and manifest["tagline"][-1].isalnum()
    assert all(len(reason) <= 64 and reason[-1].isalnum() for reason in manifest["permissions"].values())
    assert manifest["license"] == ["SPDX:Apache-2.0"] and manifest["type"] == "add-on"


@pytest.fixture(scope="module")
def addon():
    """The extension, registered."""
    bpy = pytest.importorskip("bpy")
    sys.path += map(str, Path(bpy.utils.resource_path("LOCAL")).glob("python/lib/python3.*/site-packages"))
    module = load("relight_addon", FOLDER / "__init__.py", submodule_search_locations=[str(FOLDER)])
    module.register()
    yield module
    module.unregister()


@pytest.fixture
def scene(addon):
    """An empty scene with a panorama of smooth, lopsided, colored light, and a camera that sees x and z in [-1,1]."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon.KNOWN.clear()
    for handlers in addon.HANDLERS:  # new files remove all that do not persist
        assert addon.follow in handlers
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    nodes, link = scene.world.node_tree.nodes, scene.world.node_tree.links.new
    panorama, mapping, place = (nodes.new(f"ShaderNode{kind}") for kind in ("TexEnvironment", "Mapping", "TexCoord"))
    panorama.image = bpy.data.images.new("panorama", 128, 64, float_buffer=True)
    directions, _ = addon.light.sphere(64)
    x, y, z = np.moveaxis(directions, -1, 0)
    values = np.stack([1 + 0.9 * x + 0.3 * x * y, 1 + 0.8 * y, 1 + 0.7 * z - 0.2 * x * z, np.ones_like(x)], -1)
    panorama.image.pixels.foreach_set(np.ascontiguousarray(values[::-1], np.float32).ravel())
    panorama.image.pack()
    background = next(node for node in nodes if node.type == "BACKGROUND")
    link(place.outputs["Generated"], mapping.inputs["Vector"])
    link(mapping.outputs["Vector"], panorama.inputs["Vector"])
    link(panorama.outputs["Color"], background.inputs["Color"])
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    camera.location, camera.rotation_euler = (0, -5, 0), (np.pi / 2, 0, 0)
    camera.data.type, camera.data.ortho_scale = "ORTHO", 2.0
    scene.camera, scene.render.engine, scene.render.film_transparent = camera, "CYCLES", True
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.cycles.device, scene.cycles.use_denoising, scene.cycles.max_bounces = "CPU", False, 0
    scene.cycles.transparent_max_bounces = 4
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    return scene


def rendered(scene, path: Path, samples: int) -> np.ndarray:
    """Returns the render (SIZE,SIZE,4) of a scene by Cycles."""
    import bpy

    scene.cycles.samples, scene.render.filepath = samples, str(path)
    bpy.ops.render.render(write_still=True)
    values = np.empty(SIZE * SIZE * 4, np.float32)
    bpy.data.images.load(str(path)).pixels.foreach_get(values)
    return values.reshape(SIZE, SIZE, 4)[::-1]


def white():
    """Returns a matte white material."""
    import bpy

    material = bpy.data.materials.new("white")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    surface, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    surface.inputs["Color"].default_value = (1, 1, 1, 1)
    material.node_tree.links.new(surface.outputs[0], output.inputs[0])
    return material


def head():
    """Returns a monkey's head of fine faces that fits into the picture, turned by nothing."""
    import bpy

    bpy.ops.mesh.primitive_monkey_add(size=1.4)
    item = bpy.context.active_object
    bpy.ops.object.shade_smooth()
    item.modifiers.new("fine", "SUBSURF").levels = 2
    bpy.ops.object.modifier_apply(modifier="fine")
    return item


def agree(mine: np.ndarray, truth: np.ndarray) -> None:
    """Asserts that two renders show the same light; pixels at the edge are left out."""
    inside = (mine[..., 3] > 0.99) & (truth[..., 3] > 0.99)
    assert inside.sum() > 1000
    a, b = mine[inside][:, :3], truth[inside][:, :3]
    np.testing.assert_allclose(a.mean(0), b.mean(0), rtol=0.02)
    assert np.sqrt(((a - b) ** 2).mean()) < 0.06 and np.corrcoef(a.ravel(), b.ravel())[0, 1] > 0.98


@in_blender
def test_bake_transport_gives_what_cycles_renders(addon, scene, tmp_path):
    import bpy

    item = head()
    item.rotation_euler, item.scale = (0.3, 0.2, 0.7), (0.9, 0.9, 0.9)
    scene.world.node_tree.nodes["Mapping"].inputs["Rotation"].default_value = (0.4, -0.3, 1.1)
    bpy.context.view_layer.update()
    assert bpy.ops.relight.bake_transport(rays=256) == {"FINISHED"}
    mine = rendered(scene, tmp_path / "mine.exr", 16)
    item.data.materials[0] = white()
    agree(mine, rendered(scene, tmp_path / "truth.exr", 128))


@in_blender
def test_import_maps_shows_what_cycles_renders(addon, scene, tmp_path):
    """Of the same head, baked by relight in its own frame: x to the right, y up, z toward the camera."""
    import bpy

    item = head()
    item.data.materials.append(white())
    truth = rendered(scene, tmp_path / "truth.exr", 128)
    item.data.calc_loop_triangles()
    lines = [f"v {v.co.x} {v.co.z} {-v.co.y}" for v in item.data.vertices]
    lines += ["f " + " ".join(str(i + 1) for i in face.vertices) for face in item.data.loop_triangles]
    (tmp_path / "head.obj").write_text("\n".join(lines))
    words = ["bake", tmp_path / "head.obj", "--as-is", "--size", SIZE, "--rays", "256", "--out", tmp_path / "head.exr"]
    subprocess.run([shutil.which("relight"), *map(str, words)], check=True, capture_output=True)
    item.hide_render = True
    assert bpy.ops.relight.import_maps(filepath=str(tmp_path / "head.exr")) == {"FINISHED"}
    agree(rendered(scene, tmp_path / "mine.exr", 16), truth)


@in_blender
def test_grown_maps_keep_what_is_known_and_reach_four_pixels_further(addon):
    known = np.zeros((20, 20), bool)
    known[8:12, 8:12] = True
    values = np.random.default_rng(0).normal(size=(20, 20, 2)).astype(np.float32)
    grown = addon.transport.grown(values, known)
    np.testing.assert_array_equal(grown[known], values[known])
    filled = (grown != 0).any(-1)
    rows, columns = np.indices(known.shape)
    apart = np.maximum(0, np.maximum(8 - rows, rows - 11)) + np.maximum(0, np.maximum(8 - columns, columns - 11))
    np.testing.assert_array_equal(filled, apart <= 4)
    np.testing.assert_allclose(addon.transport.grown(np.ones_like(values), known)[filled], 1, rtol=1e-6)


@in_blender
def test_light_follows_world_and_object(addon, scene, tmp_path):
    import bpy

    item = head()
    bpy.ops.relight.bake_transport(rays=16)
    node = item.active_material.node_tree.nodes["relight"]

    def lights():
        bpy.context.view_layer.update()
        names = [name for channel in "RGB" for name in addon.shader.light_inputs(channel)]
        return np.array([list(node.inputs[name].default_value) for name in names]).reshape(3, 9).T

    first = lights()
    scene.world.node_tree.nodes["Mapping"].inputs["Rotation"].default_value = (0, 0, 1)
    turned = lights()
    assert not np.allclose(first, turned, atol=0.05)
    item.rotation_euler = (0, 0, -1)  # the light's rotation about the vertical, undone by the object's own
    np.testing.assert_allclose(lights(), first, atol=1e-3)
    next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND").inputs["Strength"].default_value = 3
    np.testing.assert_allclose(lights(), 3 * first, atol=3e-3)


@in_blender
def test_saved_file_keeps_plane_and_light(addon, scene, tmp_path):
    import bpy

    maps = tmp_path / "ball.exr"
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.9)
    bpy.ops.wm.obj_export(filepath=str(tmp_path / "ball.obj"), export_materials=False)
    words = ["bake", tmp_path / "ball.obj", "--as-is", "--size", SIZE, "--rays", "64", "--out", maps]
    subprocess.run([shutil.which("relight"), *map(str, words)], check=True, capture_output=True)
    bpy.context.active_object.hide_render = True
    bpy.ops.relight.import_maps(filepath=str(maps))
    before = rendered(scene, tmp_path / "before.exr", 8)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    maps.unlink()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    np.testing.assert_allclose(rendered(bpy.context.scene, tmp_path / "after.exr", 8), before, atol=0.02)


@in_blender
def test_problems_are_told_in_one_sentence(addon, scene, tmp_path, monkeypatch):
    import bpy

    head()
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match=r"relight does not start .*: name the program in the preferences"):
        bpy.ops.relight.bake_transport()
    with pytest.raises(RuntimeError, match="is not a readable OpenEXR file"):
        bpy.ops.relight.import_maps(filepath=str(tmp_path / "none.exr"))
    scene.camera.location = (0, -5, 0)
    rendered(scene, tmp_path / "picture.exr", 1)
    with pytest.raises(RuntimeError, match=r"holds no maps of relight: it lacks albedo\.R"):
        bpy.ops.relight.import_maps(filepath=str(tmp_path / "picture.exr"))


@in_blender
def test_blender_builds_the_extension(addon, tmp_path):
    import bpy

    (tool,) = Path(bpy.utils.resource_path("LOCAL")).glob("scripts/addons_core/bl_pkg/cli/blender_ext.py")
    words = ["build", "--source-dir", FOLDER, "--output-filepath", tmp_path / "relight.zip"]
    done = subprocess.run([sys.executable, tool, *words], capture_output=True, text=True)
    assert done.returncode == 0 and (tmp_path / "relight.zip").stat().st_size > 4000, done.stdout + done.stderr
