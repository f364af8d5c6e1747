"""The light of Blender's world as Cycles gives it to matte surfaces, so that any world is followed."""

import hashlib
import tempfile
from pathlib import Path

import bmesh
import bpy
import numpy as np

from .light import Problem, light_on

ROWS, SAMPLES = 32, 16  # of the render, and of each of its pixels: lights are right to half a percent
WIDTH = 1024  # pixels of a side to which Cycles shrinks panoramas: less noise
PLACEMENT = {"rna_type", "location", "location_absolute", "width", "height", "dimensions", "select"}
LIGHTS = {}  # coefficients (9,3) and their error by `state`: each is rendered once


def state(world, frame):
    """Returns a text that changes with the light of an evaluated world in a frame, but not with a picture's pixels."""
    text = repr(world and [world.cycles_visibility.diffuse, *leaves(world.node_tree)])
    moves = "'MOVIE'" in text or "'SEQUENCE'" in text
    return hashlib.blake2s(f"{text} {frame if moves else 0}".encode()).hexdigest()


def leaves(thing):
    """Yields the values on which a tree of nodes, or a part of it, depends."""
    names = ["nodes", "links"] if isinstance(thing, bpy.types.NodeTree) else thing.bl_rna.properties.keys()
    for name, value in ((name, getattr(thing, name)) for name in names if name not in PLACEMENT):
        if isinstance(value, bpy.types.Image):
            yield value.name_full, value.filepath, value.source, value.alpha_mode, value.colorspace_settings.name
        elif isinstance(value, bpy.types.Node | bpy.types.NodeSocket):  # of a link
            yield value.name, getattr(value, "identifier", "")
        elif isinstance(value, bpy.types.ID) and not isinstance(value, bpy.types.NodeTree):
            yield getattr(value, "matrix_world", value.name_full)
        elif isinstance(value, bpy.types.bpy_prop_collection):
            for part in value:
                yield from leaves(part)
        elif isinstance(value, bpy.types.bpy_struct):
            yield from leaves(value)
        else:
            yield name, list(value) if isinstance(value, bpy.types.bpy_prop_array) else value


def render(scene, world):
    """Returns `light_on` of the evaluated world of a scene; raises Problem if Cycles does not render it.

    A panoramic camera stands in a white ball that only cameras see: the point that it sees in a direction is a matte
    surface, lit by all of the world, whose normal is the opposite direction. No handlers are called.
    """
    if not world:
        return np.zeros((9, 3)), 0.0
    import OpenImageIO  # only Blender itself has it on its path

    made = []

    def new(kind, *words):
        made.append(getattr(bpy.data, kind).new("relight", *words))
        return made[-1]

    def still(tree):
        """Gives a copy of an evaluated tree parts of its own, which nothing animates."""
        tree.animation_data_clear()
        for node in tree.nodes:
            if image := getattr(node, "image", None):
                node.image = image.original
                if not node.image.size[0]:  # it is read here, if it is not in memory
                    raise Problem(f"the panorama {image.name} has no pixels: its file is missing")
            if seen := getattr(node, "object", None):
                node.object = new("objects", None)
                node.object.matrix_world = seen.matrix_world
            if group := getattr(node, "node_tree", None):
                node.node_tree = group.copy()
                made.append(node.node_tree)
                still(node.node_tree)

    handlers = [each for each in bpy.app.handlers if isinstance(each, list)]
    kept = [each[:] for each in handlers]
    try:
        for each in handlers:
            each.clear()
        own, mesh, material, lens = new("scenes"), new("meshes"), new("materials"), new("cameras")
        own.world = world.copy()
        made.append(own.world)
        still(own.world.node_tree)
        own.world.cycles.sampling_method, own.world.cycles.sample_map_resolution = "MANUAL", WIDTH
        own.render.use_simplify, own.cycles.texture_limit_render = True, str(WIDTH)
        ball = bmesh.new()
        bmesh.ops.create_icosphere(ball, subdivisions=5, radius=1)
        ball.to_mesh(mesh)
        ball.free()
        mesh.shade_smooth()
        mesh.materials.append(material)
        white = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED").inputs
        white["Base Color"].default_value, white["Specular IOR Level"].default_value = (1, 1, 1, 1), 0
        lens.type, lens.panorama_type, lens.clip_start = "PANO", "EQUIRECTANGULAR", 0.01
        own.camera, item = new("objects", lens), new("objects", mesh)
        own.camera.rotation_euler = (np.pi / 2, 0, -np.pi / 2)  # it looks along +x
        item.visible_diffuse = item.visible_shadow = False
        for each in (own.camera, item):
            own.collection.objects.link(each)
        picture, cycles = own.render, own.cycles
        picture.engine, own.view_settings.view_transform = "CYCLES", "Raw"
        picture.resolution_x, picture.resolution_y = 2 * ROWS, ROWS
        picture.image_settings.file_format, picture.image_settings.color_depth = "OPEN_EXR", "32"
        cycles.device, cycles.samples, cycles.max_bounces, cycles.pixel_filter_type = "CPU", SAMPLES, 1, "BOX"
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0
        own.frame_current, own.frame_subframe = scene.frame_current, scene.frame_subframe
        with tempfile.TemporaryDirectory() as folder:
            picture.filepath = str(Path(folder) / "light.exr")
            bpy.ops.render.render(write_still=True, scene=own.name)
            pixels = OpenImageIO.ImageBuf(picture.filepath).get_pixels()
    except (RuntimeError, TypeError) as error:
        raise Problem(f"Cycles does not render the light of the world: {str(error).strip()}") from None
    finally:
        bpy.data.batch_remove(made)
        for each, calls in zip(handlers, kept):
            each[:] = calls
    return light_on(np.roll(pixels[::-1], ROWS, 1)[..., :3])  # from below, and from behind: the opposite
