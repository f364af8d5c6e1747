"""Light transport from relight: baked per vertex by its program, or read from its maps."""

import subprocess
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils.kdtree import KDTree

from . import shader
from .light import Problem, rotation

NAMES = [f"transport.{name}.Y" for name in "L0M0 L1Mn1 L1M0 L1M1 L2Mn2 L2Mn1 L2M0 L2M1 L2M2".split()]
MESH, PLANE = "mesh", "plane"  # values of the property by which objects that follow the world are known
PROPERTY = "relight"
REST = "relight_rest"  # attribute by which a vertex is found again behind modifiers
FEW = 100  # vertices of a mesh that is too coarse for light per vertex


def bake(items, depsgraph, program, rays):
    """Bakes objects that shade each other: three color attributes each, and copies of their materials that use them.

    Meshes are taken behind modifiers and shape keys. Returns what the user should know, or raises Problem.
    """
    if len({item.data for item in items}) < len(items):
        raise Problem("some of the objects share a mesh: make it their own (Object > Relations > Make Single User)")
    lines, count, kept, notes = [], 0, [], []
    for item in items:
        vertices, faces, own = evaluated(item, depsgraph)
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in faces + count + 1]
        kept.append(own + count)
        count += len(vertices)
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "mesh.obj", Path(folder) / "mesh.npz"
        path.write_text("\n".join(lines) + "\n")
        words = [program, "bake", path, "--out", out, "--rays", str(rays)]
        try:
            subprocess.run(words, capture_output=True, text=True, check=True)
        except OSError as error:
            raise Problem(f"{program} does not start ({error.strerror}): name the program in the preferences") from None
        except subprocess.CalledProcessError as error:
            raise Problem(f"relight: {(error.stderr.strip().splitlines() or ['it failed'])[-1]}") from None
        transport = np.load(out)["transport"]

    def sources(nodes):
        for name in shader.TRANSPORT:
            node = nodes.new("ShaderNodeAttribute")
            node.attribute_name = name
            yield node.outputs["Vector"], name

    for item, own in zip(items, kept):
        item[PROPERTY] = MESH
        in_frame = transport[own] @ rotation(axes(item)).T
        for name, third in zip(shader.TRANSPORT, np.split(in_frame, 3, axis=1)):
            if name in item.data.color_attributes:
                item.data.color_attributes.remove(item.data.color_attributes[name])
            values = np.pad(third, ((0, 0), (0, 1)), constant_values=1).astype(np.float32)
            item.data.color_attributes.new(name, "FLOAT_COLOR", "POINT").data.foreach_set("color", values.ravel())
        if len(own) < FEW:
            notes.append(f"{item.name} has {len(own)} vertices: subdivide it, for light is kept per vertex")
        if not item.material_slots:
            item.data.materials.append(None)
        for slot in item.material_slots:
            material, slot.link = slot.material, "OBJECT"  # the mesh keeps its own
            slot.material, said = shader.lit_copy(material, item.name, sources)
            notes += said
    return notes


def evaluated(item, depsgraph):
    """Returns a mesh behind modifiers: vertices (V,3) in the scene's frame, triangles (F,3), and its own of V (N,)."""
    count, attributes = len(item.data.vertices), item.data.attributes
    rest = np.empty(3 * count, np.float32)
    item.data.vertices.foreach_get("co", rest)
    attributes.new(REST, "FLOAT_VECTOR", "POINT").data.foreach_set("vector", rest)
    depsgraph.update()
    shown = item.evaluated_get(depsgraph)
    mesh = shown.to_mesh()
    mesh.calc_loop_triangles()
    vertices, faces = np.empty(3 * len(mesh.vertices), np.float32), np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loop_triangles.foreach_get("vertices", faces)
    own, problem = np.arange(count), None if len(faces) else "has no faces"
    if len(mesh.vertices) != count and REST not in mesh.attributes:
        problem = "has a modifier that makes a new mesh: apply it"
    elif len(mesh.vertices) != count:
        tree = KDTree(len(mesh.vertices))
        for i, point in enumerate(mesh.attributes[REST].data):
            tree.insert(point.vector, i)
        tree.balance()
        own = np.array([tree.find(point)[1] for point in rest.reshape(-1, 3)])
    shown.to_mesh_clear()
    attributes.remove(attributes[REST])
    if problem:
        raise Problem(f"{item.name} {problem}")
    matrix, faces = np.array(shown.matrix_world), faces.reshape(-1, 3)
    outward = faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else faces
    return vertices.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3], outward, own


def read_maps(path):
    """Returns albedo (H,W,3), transport (H,W,9) and coverage (H,W) of maps of relight, the top row first."""
    import OpenImageIO  # only Blender itself has it on its path

    file = OpenImageIO.ImageInput.open(str(path))
    if file is None:
        OpenImageIO.geterror()  # or it prints that nobody read it
        raise Problem(f"{path} is not a readable OpenEXR file")
    spec, pixels = file.spec(), file.read_image(format="float")
    file.close()
    place = {name: i for i, name in enumerate(spec.channelnames)}
    needed = ["albedo.R", "albedo.G", "albedo.B", *NAMES, "coverage.A"]
    missing = [name for name in needed if name not in place]
    if pixels is None or missing:
        raise Problem(f"{path} holds no maps of relight: it lacks {', '.join(missing) or 'pixels'}")
    for name in NAMES:  # with the mean of what surfaces reflect onto each other: the shader has no color for it
        if bounced := [place[rgb] for c in "RGB" if (rgb := f"bounced{name[9:-1]}{c}") in place]:
            pixels[..., place[name]] += pixels[..., bounced].mean(axis=-1)
    whole = np.zeros((spec.full_height, spec.full_width, len(needed)), np.float32)
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    whole[top : top + spec.height, left : left + spec.width] = pixels[..., [place[name] for name in needed]]
    filled = grown(whole[..., :12], whole[..., 3] > 0)
    return filled[..., :3], filled[..., 3:], whole[..., 12]


def grown(values, known, steps=4):
    """Fills values (H,W,C) near the known pixels (H,W) by means of neighbors: renders interpolate across the edge."""
    values = np.where(known[..., None], values, 0)
    for _ in range(steps):
        padded = np.pad(np.dstack([values, known]), ((1, 1), (1, 1), (0, 0)))
        around = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
        new = ~known & (around[..., -1] > 0)
        values[new] = around[new, :-1] / around[new, -1:]
        known = known | new
    return values


def add_plane(path, context):
    """Adds an upright plane, two units high, that shows maps and faces -y, as people in Blender do; returns notes."""
    albedo, transport, coverage = read_maps(path)
    height, width = coverage.shape
    name, right = Path(path).stem, width / height
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-right, 0, -1), (right, 0, -1), (right, 0, 1), (-right, 0, 1)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new().data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1])
    layers = {"Albedo": np.dstack([albedo, coverage])}
    for target, third in zip(shader.TRANSPORT, np.split(transport, 3, axis=2)):
        layers[target] = np.dstack([third, np.ones_like(coverage)])

    def sources(nodes):
        for target, values in layers.items():
            node = nodes.new("ShaderNodeTexImage")
            image = bpy.data.images.new(f"{name} {target}", width, height, alpha=True, float_buffer=True, is_data=True)
            image.alpha_mode = "CHANNEL_PACKED"  # otherwise colors count as multiplied by alpha
            image.pixels.foreach_set(np.ascontiguousarray(values[::-1], np.float32).ravel())
            image.pack()
            node.image, node.extension = image, "CLIP" if target == "Albedo" else "EXTEND"
            yield node.outputs["Color"], target
            if target == "Albedo":
                yield node.outputs["Alpha"], "Alpha"

    mesh.materials.append(shader.lit_copy(None, name, sources)[0])
    item = bpy.data.objects.new(name, mesh)
    context.collection.objects.link(item)
    item[PROPERTY] = PLANE
    context.view_layer.objects.active = item
    return []


def axes(item):
    """Returns the axes (3,3) of the frame of an evaluated object's transport, as rows in the scene's frame."""
    left, _, right = np.linalg.svd(np.array(item.matrix_world)[:3, :3])  # a mirror stays one
    x, y, z = (left @ right).T
    return np.stack([x, y, z] if item[PROPERTY] == MESH else [x, z, -y])  # of a plane: right, up, toward the viewer
