"""The extension in Blender itself, where `bpy` is installed; what needs none of it runs everywhere.

python -m venv bpyenv; bpyenv/bin/pip install bpy pytest "numpy<2"
bpyenv/bin/python -m pytest tests/integrations/test_blender.py     # with relight on the PATH
"""

import importlib.util
import shutil
import subprocess
import sys
import tomllib
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "integrations" / "blender"
SIZE = 96  # pixels of a render
bpy = importlib.import_module("bpy") if importlib.util.find_spec("bpy") else None


def load(name: str, path: Path, **options):
    spec = importlib.util.spec_from_file_location(name, path, **options)
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def light():
    return load("relight_blender_light", FOLDER / "light.py")


def test_basis_and_rotation_are_those_of_relight(light):
    sh = pytest.importorskip("relight.sh")
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(light.basis(directions), sh.basis(directions, 2), atol=1e-7)
    axes = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    axes *= np.linalg.det(axes)
    np.testing.assert_allclose(light.rotation(axes), sh.rotation_matrix(axes, 2), atol=1e-6)


def test_light_on_matte_surfaces_is_found_again(light):
    """Radiance L lights a surface by pi, 2 pi / 3 and pi / 4 of its bands (Ramamoorthi and Hanrahan 2001)."""
    coefficients = np.random.default_rng(1).normal(size=(9, 3))
    share = np.array([1, 2 / 3, 2 / 3, 2 / 3, 1 / 4, 1 / 4, 1 / 4, 1 / 4, 1 / 4])[:, None]
    fine = light.basis(light.sphere(160)) @ (share * coefficients)
    found, error = light.light_on(fine.reshape(32, 5, 64, 5, 3).mean((1, 3)))
    np.testing.assert_allclose(found, coefficients, atol=8e-3)
    assert error < 0.01
    lamp = np.maximum(light.sphere(64)[..., 2:].repeat(3, -1), 0)  # by its share in each of Legendre's polynomials
    assert light.light_on(lamp)[1] == pytest.approx(np.sqrt(1 / 6 - 1 / 16 - 1 / 12 - 5 / 256), abs=0.001)


def test_manifest_has_what_blender_requires():
    manifest = tomllib.loads((FOLDER / "blender_manifest.toml").read_text())
    required = "schema_version id version name tagline maintainer type blender_version_min license".split()
    assert [key for key in required if not manifest.get(key)] == []
    assert len(manifest["tagline"]) <= 64 and manifest["tagline"][-1].isalnum()
    assert all(len(reason) <= 64 and reason[-1].isalnum() for reason in manifest["permissions"].values())
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"] and manifest["type"] == "add-on"


@pytest.fixture(scope="module")
def addon():
    """The extension, registered; without Blender as a module its tests are skipped."""
    pytest.importorskip("bpy")
    sys.path += map(str, Path(bpy.utils.resource_path("LOCAL")).glob("python/lib/python3.*/site-packages"))
    module = load("relight_addon", FOLDER / "__init__.py", submodule_search_locations=[str(FOLDER)])
    module.register()
    yield module
    module.unregister()


@pytest.fixture
def scene(addon):
    """An empty scene with a panorama of smooth, lopsided, colored light, and a camera that sees x and z in [-1,1]."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for handlers in addon.HANDLERS:  # new files remove all that do not persist
        assert addon.follow in handlers
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("world")
    nodes, link = scene.world.node_tree.nodes, scene.world.node_tree.links.new
    panorama, mapping, place = (nodes.new(f"ShaderNode{kind}") for kind in ("TexEnvironment", "Mapping", "TexCoord"))
    panorama.image = bpy.data.images.new("panorama", 128, 64, float_buffer=True)
    x, y, z = np.moveaxis(addon.light.sphere(64), -1, 0)
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
    scene.cycles.samples, scene.render.filepath = samples, str(path)
    bpy.ops.render.render(write_still=True)
    return read_render(path)


def read_render(path: Path) -> np.ndarray:
    values = np.empty(SIZE * SIZE * 4, np.float32)
    bpy.data.images.load(str(path)).pixels.foreach_get(values)
    return values.reshape(SIZE, SIZE, 4)[::-1]


def white():
    material = bpy.data.materials.new("white")
    nodes = material.node_tree.nodes
    nodes.clear()
    surface, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    surface.inputs["Color"].default_value = (1, 1, 1, 1)
    material.node_tree.links.new(surface.outputs[0], output.inputs[0])
    return material


def head(rays=0):
    """Returns a monkey's head of fine faces that fits into the picture, turned by nothing; baked by that many rays."""
    bpy.ops.mesh.primitive_monkey_add(size=1.4)
    item = bpy.context.active_object
    bpy.ops.object.shade_smooth()
    item.modifiers.new("fine", "SUBSURF").levels = 2
    bpy.ops.object.modifier_apply(modifier="fine")
    if rays:
        bpy.ops.relight.bake_transport(rays=rays)
    return item


def light_of(addon, item) -> np.ndarray:
    """Returns the light (27,) that an object has, as its shader reads it."""
    return np.ravel([list(item[name]) for name in addon.shader.LIGHT])[:-1]  # without its error


def agree(mine: np.ndarray, truth: np.ndarray, mean: float = 0.02, like: float = 0.98) -> None:
    """Asserts that two renders show the same light: means to a share `mean`, correlated by `like`; no edges."""
    inside = (mine[..., 3] > 0.99) & (truth[..., 3] > 0.99)
    assert inside.sum() > 1000
    a, b = mine[inside][:, :3], truth[inside][:, :3]
    np.testing.assert_allclose(a.mean(0), b.mean(0), rtol=mean)
    assert np.sqrt(((a - b) ** 2).mean()) < 0.06 * max(b.max(), 1) and np.corrcoef(a.ravel(), b.ravel())[0, 1] > like


@pytest.mark.parametrize("bounces", [0, 2])
def test_import_maps_shows_what_cycles_renders(addon, scene, tmp_path, bounces):
    """Of the same head, baked by relight in its own frame: x to the right, y up, z toward the camera."""
    item = head()
    item.data.materials.append(white())
    scene.cycles.max_bounces = bounces
    truth = rendered(scene, tmp_path / "truth.exr", 128)
    scene.cycles.max_bounces = 0
    item.data.calc_loop_triangles()
    lines = [f"v {v.co.x} {v.co.z} {-v.co.y}" for v in item.data.vertices]
    lines += ["f " + " ".join(str(i + 1) for i in face.vertices) for face in item.data.loop_triangles]
    (tmp_path / "head.obj").write_text("\n".join(lines))
    words = ["bake", tmp_path / "head.obj", "--as-is", "--size", SIZE, "--rays", "256", "--out", tmp_path / "head.exr"]
    words += ["--bounces", bounces] if bounces else []
    subprocess.run([shutil.which("relight"), *map(str, words)], check=True, capture_output=True)
    item.hide_render = True
    assert bpy.ops.relight.import_maps(filepath=str(tmp_path / "head.exr")) == {"FINISHED"}
    agree(rendered(scene, tmp_path / "mine.exr", 16), truth)


def test_a_rendered_animation_has_the_light_of_each_frame(addon, scene, tmp_path):
    item, sockets = head(), [node.inputs for node in scene.world.node_tree.nodes]
    rotation, strength = (next(s[name] for s in sockets if name in s) for name in ("Rotation", "Strength"))
    bpy.ops.relight.bake_transport(rays=16)
    for frame, turn in ((1, 0), (4, 2)):
        rotation.default_value, strength.default_value, item.rotation_euler = (0, 0, -2 * turn), 1 + turn, (0, turn, 0)
        for animated, path in ((rotation, "default_value"), (strength, "default_value"), (item, "rotation_euler")):
            animated.keyframe_insert(path, frame=frame)
    stills = []
    for frame in range(1, 5):
        scene.frame_set(frame)
        stills.append(rendered(scene, tmp_path / f"still{frame}.exr", 4))
    scene.frame_set(2)
    scene.frame_start, scene.frame_end, scene.render.filepath = 1, 4, str(tmp_path / "film")
    bpy.ops.render.render(animation=True)
    film = [read_render(tmp_path / f"film{frame:04d}.exr") for frame in range(1, 5)]
    assert all(np.abs(a - b).mean() > 0.02 for a, b in pairwise(stills))
    np.testing.assert_allclose(film, stills, atol=1e-3)
    np.testing.assert_allclose(rendered(scene, tmp_path / "again.exr", 4), stills[1], atol=1e-3)


@pytest.mark.parametrize("linked", [True, False])
def test_a_duplicate_turns_on_its_own(addon, scene, linked):
    item = head(16)
    before = light_of(addon, item)
    bpy.ops.object.duplicate(linked=linked)
    copy = bpy.context.active_object
    copy.rotation_euler = (0, 0, 2)
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(light_of(addon, item), before)
    assert np.abs(light_of(addon, copy) - before).max() > 0.5
    copy.location.x = 3
    assert told(addon) == []


def test_what_is_appended_twice_is_lit_twice(addon, scene, tmp_path):
    head(16)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"), copy=True)
    for x in (2, 4):
        with bpy.data.libraries.load(str(tmp_path / "library.blend")) as (_, new):
            new.objects = ["Suzanne"]
        scene.collection.objects.link(new.objects[0])
        new.objects[0].location.x = x
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 2
    assert told(addon) == []
    first, *others = (light_of(addon, item) for item in scene.objects if item.type == "MESH")
    assert len(others) == 2
    np.testing.assert_allclose(others, [first] * 2, atol=1e-6)


def test_two_windows_of_other_worlds_do_not_take_turns(addon, scene):
    """The first window that shows an object has its light; the panel tells it of another one."""
    item, two = head(16), bpy.data.scenes.new("two")
    mine = light_of(addon, item)
    two.world = bpy.data.worlds.new("other")
    two.collection.objects.link(item)
    for shown in (two, scene):  # one after the other in one window: each has its own
        bpy.context.window.scene = shown
        bpy.context.view_layer.update()
        assert (np.abs(light_of(addon, item) - mine).max() < 1e-6) == (shown == scene)
    addon.follow(two, two.view_layers[0].depsgraph)
    np.testing.assert_array_equal(light_of(addon, item), mine)
    assert addon.WARNINGS == ["Suzanne has the light of another window: give this scene a copy of it"]


def test_mirrored_objects_bake_and_turn_as_mirrors(addon, scene, tmp_path):
    """Baked as a mirror image, and back: each time as Cycles renders it in matte white."""
    item = head()
    item.data.materials.append(white())
    item.scale.x, item.rotation_euler = -1, (0, 0, 0.6)
    bpy.ops.relight.bake_transport(rays=256)
    for mirror in (-1, 1):
        item.scale.x = mirror
        bpy.context.view_layer.update()
        mine, item.material_slots[0].link = rendered(scene, tmp_path / "mine.exr", 16), "DATA"
        agree(mine, rendered(scene, tmp_path / "truth.exr", 128))
        item.material_slots[0].link = "OBJECT"


def test_baking_keeps_materials_and_undo_restores_all(addon, scene, tmp_path):
    """The base color, here red and a picture, becomes the albedo; so the render is Cycles' of two matte materials."""
    item = head()
    red, painted = white(), white()
    red.name, painted.name = "red", "painted"
    red.node_tree.nodes["Diffuse BSDF"].inputs["Color"].default_value = (0.8, 0.1, 0.1, 1)
    picture = painted.node_tree.nodes.new("ShaderNodeTexImage")
    picture.image = bpy.data.images.new("picture", 8, 8, float_buffer=True)
    picture.image.pixels.foreach_set(np.tile(np.float32([0.1, 0.2, 0.9, 1]), 64))
    painted.node_tree.links.new(picture.outputs["Color"], painted.node_tree.nodes["Diffuse BSDF"].inputs["Color"])
    for material in (red, painted):
        item.data.materials.append(material)
    for face in item.data.polygons:
        face.material_index = int(face.center.x > 0)
    truth = rendered(scene, tmp_path / "truth.exr", 64)
    bpy.ops.ed.undo_push(message="before")
    for _ in range(2):  # a second time, of the user's materials again
        assert bpy.ops.relight.bake_transport(rays=256) == {"FINISHED"}
        agree(rendered(scene, tmp_path / "mine.exr", 16), truth)
        assert [material.name for material in item.data.materials] == ["red", "painted"]
        assert [slot.material.name for slot in item.material_slots] != ["red", "painted"]
    bpy.ops.ed.undo_push(message="baked")
    bpy.ops.ed.undo()
    item = bpy.data.objects["Suzanne"]
    assert [slot.material.name for slot in item.material_slots] == ["red", "painted"]
    assert not item.data.color_attributes and not {addon.transport.AXES, *addon.shader.LIGHT} & set(item.keys())
    assert "relight_mark" not in item.data.attributes


def sky(nodes, link, source):
    texture = nodes.new("ShaderNodeTexSky")
    texture.sun_elevation, texture.sun_size = 0.9, 0.02
    nodes["Background"].inputs["Strength"].default_value = 0.1
    link(texture.outputs[0], nodes["Background"].inputs["Color"])


def hue(nodes, link, source):
    change = nodes.new("ShaderNodeHueSaturation")
    change.inputs["Hue"].default_value, change.inputs["Saturation"].default_value = 0.2, 2
    link(source, change.inputs["Color"])
    link(change.outputs[0], nodes["Background"].inputs["Color"])


def two_backgrounds(nodes, link, source):
    """The camera sees blue, which lights nothing."""
    mix, path, seen = (nodes.new(f"ShaderNode{kind}") for kind in ("MixShader", "LightPath", "Background"))
    seen.inputs["Color"].default_value = (0, 0, 5, 1)
    link(path.outputs["Is Camera Ray"], mix.inputs[0])
    link(nodes["Background"].outputs[0], mix.inputs[1])
    link(seen.outputs[0], mix.inputs[2])
    link(mix.outputs[0], nodes["World Output"].inputs["Surface"])


def turned_texture(nodes, link, source):
    mapping = nodes["Mapping"]
    mapping.vector_type, mapping.inputs["Rotation"].default_value = "TEXTURE", (0.3, 0.2, 2)


def turned_by_object(nodes, link, source):
    """The panorama in the axes of an object, which turns after it is chosen."""
    place, empty = nodes["Texture Coordinate"], bpy.data.objects.new("empty", None)
    bpy.context.collection.objects.link(empty)
    place.object = empty
    link(place.outputs["Object"], nodes["Mapping"].inputs["Vector"])
    bpy.context.view_layer.update()
    empty.rotation_euler = (0.5, -0.3, 2)


def only_matte_surfaces(nodes, link, source):
    """The panorama is hidden from what shines through, which sees blue."""
    two_backgrounds(nodes, link, source)
    mix, path = nodes["Mix Shader"], nodes["Light Path"]
    link(path.outputs["Is Transmission Ray"], mix.inputs[0])
    bpy.context.scene.world.cycles_visibility.transmission = False


def driven_by_the_scene(nodes, link, source):
    """The strength is a property of the scene that is active, in a group of nodes."""
    bpy.context.scene["much"] = 2.5
    group = bpy.data.node_groups.new("group", "ShaderNodeTree")
    group.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketFloat")
    value, user = group.nodes.new("ShaderNodeValue"), nodes.new("ShaderNodeGroup")
    group.links.new(value.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    driver = value.outputs[0].driver_add("default_value").driver
    driver.expression, variable = "much", driver.variables.new()
    variable.name, variable.type = "much", "CONTEXT_PROP"
    variable.targets[0].context_property, variable.targets[0].data_path = "ACTIVE_SCENE", '["much"]'
    user.node_tree = group
    link(user.outputs[0], nodes["Background"].inputs["Strength"])


def of_the_view_layer(nodes, link, source):
    other = bpy.context.scene.world.copy()
    other.node_tree.nodes["Mapping"].inputs["Rotation"].default_value = (0, 1, 3)
    bpy.context.view_layer.world_override = other


WORLDS = [sky, hue, two_backgrounds, turned_texture, turned_by_object]
WORLDS += [only_matte_surfaces, driven_by_the_scene, of_the_view_layer]


@pytest.mark.parametrize("change", WORLDS)
def test_any_world_gives_the_light_that_cycles_gives(addon, scene, tmp_path, change):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
    bpy.ops.object.shade_smooth()
    item = bpy.context.active_object
    bpy.ops.relight.bake_transport(rays=256)
    nodes = scene.world.node_tree.nodes
    change(nodes, scene.world.node_tree.links.new, nodes["Background"].inputs["Color"].links[0].from_socket)
    bpy.context.view_layer.update()
    assert any("too sharp for nine numbers" in warning for warning in addon.WARNINGS) == (change is sky)
    mine, item.material_slots[0].material = rendered(scene, tmp_path / "mine.exr", 16), white()
    limits = (0.05, 0.95) if change is sky else (0.02, 0.98)  # order 2 makes a sun soft
    agree(mine, rendered(scene, tmp_path / "truth.exr", 128), *limits)


def test_a_change_that_no_key_holds_is_followed_until_the_frame_changes(addon, scene):
    """And what the world was then is not taken for another that has the same values; handlers of others rest."""
    item, calls = head(16), []
    strength = scene.world.node_tree.nodes["Background"].inputs["Strength"]
    once = light_of(addon, item)
    strength.keyframe_insert("default_value", frame=1)
    for name in ("render_init", "render_write", "render_complete", "frame_change_post"):
        getattr(bpy.app.handlers, name).append(lambda *_: calls.append(_))
    kept = [each[:] for each in bpy.app.handlers if isinstance(each, list)]
    strength.default_value = 3
    bpy.context.view_layer.update()
    np.testing.assert_allclose(light_of(addon, item), 3 * once, rtol=1e-4, atol=1e-4)
    assert not calls and kept == [each for each in bpy.app.handlers if isinstance(each, list)]
    scene.frame_set(1)
    np.testing.assert_allclose(light_of(addon, item), once, rtol=1e-4, atol=1e-4)
    shown = scene.world.evaluated_get(bpy.context.evaluated_depsgraph_get())
    light, _ = addon.world.render(scene, shown)
    strength.default_value = 3  # as in a render in a window, whose frame the file's own world does not have
    np.testing.assert_allclose(addon.world.render(scene, shown)[0], light, rtol=1e-4)


@pytest.mark.parametrize("collection", [False, True])
def test_what_another_file_holds_has_the_light_of_this_one(addon, scene, tmp_path, collection):
    """An object, or the instance of a collection, whose file has another world."""
    item, strength = head(16), scene.world.node_tree.nodes["Background"].inputs["Strength"]
    once = light_of(addon, item)
    strength.default_value, library = 0.2, tmp_path / "library.blend"
    bpy.context.view_layer.update()
    scene.collection.children.link(bpy.data.collections.new("people"))
    bpy.data.collections["people"].objects.link(item)
    bpy.ops.wm.save_as_mainfile(filepath=str(library), copy=True)
    strength.default_value = 1
    bpy.data.objects.remove(item)
    with bpy.data.libraries.load(str(library), link=True) as (_, linked):
        linked.objects, linked.collections = ["Suzanne"], ["people"]
    shown = linked.objects[0]
    if collection:
        shown = bpy.data.objects.new("instance", None)
        shown.instance_type, shown.instance_collection = "COLLECTION", linked.collections[0]
    scene.collection.objects.link(shown)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(light_of(addon, linked.objects[0]), once, atol=1e-3)


def test_a_large_panorama_gives_the_same_light(addon, scene):
    item, panorama = head(16), next(node for node in scene.world.node_tree.nodes if node.type == "TEX_ENVIRONMENT")
    before = light_of(addon, item)
    small = np.empty(64 * 128 * 4, np.float32)
    panorama.image.pixels.foreach_get(small)
    large = bpy.data.images.new("large", 4096, 2048, float_buffer=True)
    large.pixels.foreach_set(small.reshape(64, 128, 4).repeat(32, 0).repeat(32, 1).ravel())
    large.pack()
    panorama.image = large
    bpy.context.view_layer.update()
    np.testing.assert_allclose(light_of(addon, item), before, atol=0.02)
    panorama.texture_mapping.rotation[2] = 1
    bpy.context.view_layer.update()
    assert np.abs(light_of(addon, item) - before).max() > 0.1 and not addon.WARNINGS


def test_what_cannot_be_followed_is_told_in_the_panel(addon, scene):
    head(16)
    panorama = next(node for node in scene.world.node_tree.nodes if node.type == "TEX_ENVIRONMENT")
    panorama.image = bpy.data.images.new("lost", 8, 4)
    panorama.image.source, panorama.image.filepath = "FILE", "//lost.exr"
    bpy.context.view_layer.update()
    assert addon.WARNINGS == ["the panorama lost has no pixels: its file is missing"]
    with pytest.raises(RuntimeError, match="the panorama lost has no pixels"):
        bpy.ops.relight.update_light()
    panorama.image = bpy.data.images["panorama"]
    bpy.context.view_layer.update()
    assert addon.WARNINGS == []
    bpy.ops.preferences.addon_disable(module="cycles")
    bpy.context.object.rotation_euler.z = 1
    bpy.context.view_layer.update()
    bpy.ops.preferences.addon_enable(module="cycles")
    assert addon.WARNINGS == ["enable Cycles (Edit > Preferences > Add-ons): it renders the light of the world"]


def test_baking_needs_object_mode_and_wants_vertices(addon, scene, capfd):
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.relight.bake_transport.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.relight.bake_transport(rays=16)
    assert "Cube has 8 vertices: subdivide it" in capfd.readouterr().out


def test_modifiers_and_shape_keys_are_baked_and_objects_shade_each_other(addon, scene, tmp_path):
    """A head behind a subdivision and a shape key, beside a ball; against Cycles in matte white."""
    bpy.ops.mesh.primitive_monkey_add(size=1)
    item = bpy.context.active_object
    bpy.ops.object.shade_smooth()
    bpy.ops.object.modifier_add(type="SUBSURF")
    item.modifiers[0].levels = item.modifiers[0].render_levels = 1
    item.shape_key_add(name="base")
    key = item.shape_key_add(name="wide")
    for point in key.data:
        point.co.x *= 1.3
    key.value, item.location, item.rotation_euler = 1, (-0.3, 0, 0.2), (0.2, 0, 0.5)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.45, location=(0.55, 0, -0.3), segments=64, ring_count=32)
    ball = bpy.context.active_object
    bpy.ops.object.shade_smooth()
    item.select_set(True)
    ball.data.materials.append(white())
    bpy.context.view_layer.update()
    assert bpy.ops.relight.bake_transport(rays=256) == {"FINISHED"}
    mine = rendered(scene, tmp_path / "mine.exr", 16)
    for slot in (*item.material_slots, *ball.material_slots):
        slot.material = white()
    agree(mine, rendered(scene, tmp_path / "truth.exr", 128))
    alone = ball.data.color_attributes["Transport 0"].data
    open_side = [alone[i].color[0] for i, v in enumerate(ball.data.vertices) if v.co.x < -0.4]
    other_side = [alone[i].color[0] for i, v in enumerate(ball.data.vertices) if v.co.x > 0.4]
    assert np.mean(open_side) < 0.9 * np.mean(other_side), "the head takes light from the ball"


def told(addon) -> list[str]:
    bpy.context.view_layer.update()
    return [warning.partition(": bake it again, for its shape")[0] for warning in addon.WARNINGS]


def rig(item):
    """Moves an object by two bones, of its lower and its upper part. Returns their poses."""
    armature = bpy.data.armatures.new("rig")
    holder = bpy.data.objects.new("rig", armature)
    bpy.context.collection.objects.link(holder)
    bpy.context.view_layer.objects.active = holder
    bpy.ops.object.mode_set(mode="EDIT")
    bones = [armature.edit_bones.new(name) for name in ("root", "top")]
    for bone, low in zip(bones, (-1, 0)):
        bone.head, bone.tail = (0, 0, low), (0, 0, low + 1)
        item.vertex_groups.new(name=bone.name).add(
            [v.index for v in item.data.vertices if (v.co.z > 0.2) == (low == 0)], 1, "REPLACE"
        )
    bones[1].parent = bones[0]
    bpy.ops.object.mode_set(mode="OBJECT")
    item.modifiers.new("rig", "ARMATURE").object = holder
    bpy.context.view_layer.objects.active = item
    for bone in holder.pose.bones:
        bone.rotation_mode = "XYZ"
    return holder.pose.bones


def test_a_bake_knows_its_shape(addon, scene, tmp_path):
    """Rotations that are applied, or of all bones, are followed; another shape is told until it is baked again."""
    item = head()
    item.data.materials.append(white())
    poses = rig(item)
    item.rotation_euler = (0.3, 0.5, 2)
    assert bpy.ops.relight.bake_transport(rays=256) == {"FINISHED"}
    bpy.ops.object.transform_apply(rotation=True)
    poses["root"].rotation_euler.y, item.scale = 1.2, (0.7, 0.7, -0.7)
    assert told(addon) == []
    mine, item.material_slots[0].link = rendered(scene, tmp_path / "mine.exr", 16), "DATA"
    agree(mine, rendered(scene, tmp_path / "truth.exr", 128))
    item.material_slots[0].link = "OBJECT"
    poses["top"].rotation_euler.x = 0.6
    assert told(addon) == [item.name]
    item.select_set(False)
    bpy.ops.relight.bake_transport(rays=16, again=True)
    assert told(addon) == [] and not bpy.ops.relight.bake_transport.poll()


def test_a_bake_knows_what_stood_beside_it(addon, scene):
    items = [head() for _ in range(2)]
    items[0].location.x, items[0].name = 1.5, "other"
    for item in items:
        item.select_set(True)
    bpy.ops.relight.bake_transport(rays=16)
    empty = bpy.data.objects.new("empty", None)
    for item in items:
        item.parent = empty
    scene.collection.objects.link(empty)
    empty.rotation_euler = (0, 1, 0.5)
    assert told(addon) == []
    items[0].location.x = 2
    assert sorted(told(addon)) == sorted(item.name for item in items)
    items[0].location.x = 1.5
    assert told(addon) == []
    items[1].location.x = -1
    assert len(told(addon)) == 2
    for item in items:
        item.select_set(False)
    bpy.ops.relight.bake_transport(rays=16, again=True)
    assert told(addon) == [] and items[0][addon.transport.BESIDE] == items[1].name
    bpy.data.objects.remove(items[0])
    assert told(addon) == [items[1].name]


def test_modifiers_whose_vertices_have_no_light_of_their_own_are_refused(addon, scene):
    item = head()
    for kind in ("SOLIDIFY", "MIRROR", "DECIMATE", "REMESH"):
        modifier = item.modifiers.new("new", kind)
        if kind == "DECIMATE":
            modifier.ratio = 0.5
        with pytest.raises(RuntimeError, match="a modifier that makes, copies or merges vertices: apply it"):
            bpy.ops.relight.bake_transport(rays=16)
        item.modifiers.remove(modifier)
    assert not item.data.color_attributes and "relight_mark" not in item.data.attributes


@pytest.mark.parametrize("part", ["inside out", "open", "half"])
def test_the_back_of_faces_is_as_cycles_shows_it(addon, scene, tmp_path, part):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, rotation=(1, 0, 0))
    item = bpy.context.active_object
    item.data.materials.append(white())
    bpy.ops.object.shade_smooth()
    import bmesh

    mesh = bmesh.new()
    mesh.from_mesh(item.data)
    if part == "open":
        bmesh.ops.delete(mesh, geom=[face for face in mesh.faces if face.normal.z > 0.2], context="FACES")
    else:
        faces = [face for face in mesh.faces if part == "inside out" or face.calc_center_median().x > 0]
        bmesh.ops.reverse_faces(mesh, faces=faces)
    mesh.to_mesh(item.data)
    mesh.free()
    bpy.ops.relight.bake_transport(rays=256)
    mine, item.material_slots[0].link = rendered(scene, tmp_path / "mine.exr", 64), "DATA"
    agree(mine, rendered(scene, tmp_path / "truth.exr", 128))


@pytest.mark.parametrize("other", ["BsdfTransparent", "Emission", "BsdfGlossy"])
def test_what_is_mixed_with_matte_shaders_stays(addon, scene, tmp_path, other):
    """By half, or added; so the render is that of the user's material, cut-outs included."""
    item, material = head(), white()
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    first, mix = (nodes.new(f"ShaderNode{n}") for n in (other, "AddShader" if other == "Emission" else "MixShader"))
    first.inputs["Color"].default_value = (0.3, 0.9, 0.6, 1)
    matte = nodes["Diffuse BSDF"]
    matte.inputs["Color"].default_value = (0.8, 0.3, 0.2, 1)
    link(first.outputs[0], mix.inputs[-2])
    link(matte.outputs[0], mix.inputs[-1])
    link(mix.outputs[0], nodes["Material Output"].inputs["Surface"])
    item.data.materials.append(material)
    bpy.ops.relight.bake_transport(rays=256)
    mine, item.material_slots[0].link = rendered(scene, tmp_path / "mine.exr", 64), "DATA"
    truth = rendered(scene, tmp_path / "truth.exr", 256)
    np.testing.assert_allclose(mine[..., 3].mean(), truth[..., 3].mean(), rtol=0.02)
    inside = truth[..., 3] > 0.2
    np.testing.assert_allclose(mine[inside].mean(0), truth[inside].mean(0), rtol=0.05)


def test_materials_that_are_not_matte_are_told(addon, scene, capfd):
    item = head()
    for name in ("metal", "glass"):
        item.data.materials.append(bpy.data.materials.new(name))
    metal, glass = item.data.materials
    metal.node_tree.nodes["Principled BSDF"].inputs["Metallic"].default_value = 1
    nodes = glass.node_tree.nodes
    glass.node_tree.links.new(nodes.new("ShaderNodeBsdfGlass").outputs[0], nodes["Material Output"].inputs["Surface"])
    nodes.remove(nodes["Principled BSDF"])
    bpy.ops.relight.bake_transport(rays=16)
    out = capfd.readouterr().out
    assert "metal is more than matte: of its Principled BSDF, base color and alpha are kept" in out
    assert "glass has no Diffuse or Principled BSDF, but in groups: it stays so" in out


def test_a_bake_goes_on_in_the_background_and_ends_at_escape(addon, scene, monkeypatch, tmp_path):
    """Blender without windows sends no events, so they are sent here."""
    item, shown, runs = head(), [], []
    workspace = SimpleNamespace(status_text_set=shown.append)
    manager = SimpleNamespace(event_timer_remove=shown.append)
    context = SimpleNamespace(workspace=workspace, window_manager=manager, scene=scene)
    start = subprocess.Popen
    monkeypatch.setattr(addon.transport.subprocess, "Popen", lambda *a, **k: runs.append(start(*a, **k)) or runs[-1])

    def send(operator, *kinds):
        return [addon.BakeTransport.modal(operator, context, SimpleNamespace(type=kind)) for kind in kinds]

    program = tmp_path / "program"
    program.write_text('#!/bin/sh\necho "casting rays 1/9, 8 s left" >&2; sleep 1; exec relight "$@"\n')
    program.chmod(0o700)

    def operator(rays):
        work = addon.transport.bake([item], str(program), rays)
        return SimpleNamespace(work=work, timer="timer", report=lambda *_: None)

    one = operator(65536)
    assert send(one, "TIMER", "MOUSEMOVE") == [{"RUNNING_MODAL"}, {"PASS_THROUGH"}] and runs[0].poll() is None
    assert send(one, "ESC") == [{"CANCELLED"}] and runs[0].poll() is not None and shown[-2:] == ["timer", None]
    assert addon.transport.AXES not in item and "relight_mark" not in item.data.attributes
    two = operator(64)
    while (result := send(two, "TIMER")[0]) == {"RUNNING_MODAL"}:
        pass
    assert result == {"FINISHED"} and addon.transport.AXES in item
    assert any("casting rays" in str(text) for text in shown)
    three = operator(64)
    send(three, "TIMER")
    bpy.ops.object.mode_set(mode="EDIT")
    while (result := send(three, "TIMER")[0]) == {"RUNNING_MODAL"}:
        pass
    assert result == {"CANCELLED"}


def test_disabling_works_after_others_cleared_the_handlers(addon, scene):
    bpy.app.handlers.frame_change_post.clear()
    addon.unregister()
    addon.register()
    assert all(handlers.count(addon.follow) == 1 for handlers in addon.HANDLERS)
    assert bpy.types.TOPBAR_MT_file_import._dyn_ui_initialize().count(addon.menu) == 1


def test_saved_file_keeps_plane_and_light(addon, scene, tmp_path):
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


def test_problems_are_told_in_one_sentence(addon, scene, tmp_path, monkeypatch):
    head()
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match=r"relight does not start .*: name the program in the preferences"):
        bpy.ops.relight.bake_transport()
    (tmp_path / "relight").symlink_to("/bin/true")
    with pytest.raises(RuntimeError, match="relight: it wrote nothing: is it relight"):
        bpy.ops.relight.bake_transport()
    with pytest.raises(RuntimeError, match="is not a readable OpenEXR file"):
        bpy.ops.relight.import_maps(filepath=str(tmp_path / "none.exr"))
    scene.camera.location = (0, -5, 0)
    rendered(scene, tmp_path / "picture.exr", 1)
    with pytest.raises(RuntimeError, match=r"holds no maps of relight: it lacks albedo\.R"):
        bpy.ops.relight.import_maps(filepath=str(tmp_path / "picture.exr"))


def test_blender_builds_the_extension(addon, tmp_path):
    (tool,) = Path(bpy.utils.resource_path("LOCAL")).glob("scripts/addons_core/bl_pkg/cli/blender_ext.py")
    words = ["build", "--source-dir", FOLDER, "--output-filepath", tmp_path / "relight.zip"]
    done = subprocess.run([sys.executable, tool, *words], capture_output=True, text=True)
    assert done.returncode == 0 and (tmp_path / "relight.zip").stat().st_size > 4000, done.stdout + done.stderr
