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

    Args:
        items: objects with meshes, each its own; with their modifiers and shape keys.
        depsgraph: of the scene.
        program: path or name of relight's program.
        rays: per vertex.

    Returns:
        What the user should know, one sentence each.

    Raises:
        Problem: if a mesh has no faces or belongs to two of the objects, or the program is missing or fails.
    """
    if len({item.data for item in items}) < len(items):
        raise Problem("some of the objects share a mesh: make it their own (Object > Relations > Make Single User)")
    lines, count, kept = [], 1, []
    for item in items:
        vertices, faces, own = evaluated(item, depsgraph)
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in faces + count]
        kept.append(own + count - 1)
        count += len(vertices)
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "mesh.obj", Path(folder) / "mesh.npz"
        path.write_text("\n".join(lines) + "\n")
        run(program, "bake", path, "--out", out, "--rays", rays)
        with np.load(out) as file:
            transport = file["transport"].astype(np.float32)
    notes = []
    for item, own in zip(items, kept):
        item[PROPERTY] = MESH
        store(item.data, transport[own] @ rotation(axes(item, depsgraph)).T)
        notes += [f"{item.name} has {len(own)} vertices: subdivide it, for light is kept per vertex"] * (len(own) < FEW)
        notes += materials(item)
    return notes


def evaluated(item, depsgraph):
    """Returns an object's mesh behind its modifiers.

    Returns:
        Vertices (V,3) in the scene's frame, triangles (F,3), and the index (N,) of each of the object's own vertices.

    Raises:
        Problem: if it has no faces.
    """
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
    own = np.arange(count)
    if len(mesh.vertices) != count and len(faces):
        tree = KDTree(len(mesh.vertices))
        for i, point in enumerate(mesh.attributes[REST].data):
            tree.insert(point.vector, i)
        tree.balance()
        own = np.array([tree.find(point)[1] for point in rest.reshape(-1, 3)])
    shown.to_mesh_clear()
    attributes.remove(attributes[REST])
    if not len(faces):
        raise Problem(f"{item.name} has no faces")
    matrix = np.array(shown.matrix_world)
    return vertices.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3], faces.reshape(-1, 3), own


def store(mesh, transport):
    """Stores transport (V,9) in the color attributes of a mesh."""
    for third, name in enumerate(shader.TRANSPORT):
        if name in mesh.color_attributes:
            mesh.color_attributes.remove(mesh.color_attributes[name])
        values = np.ones((len(transport), 4), np.float32)
        values[:, :3] = transport[:, 3 * third : 3 * third + 3]
        mesh.color_attributes.new(name, "FLOAT_COLOR", "POINT").data.foreach_set("color", values.ravel())


def materials(item):
    """Gives an object, and not its mesh, copies of its materials that shine; yields what the user should know."""

    def sources(nodes):
        for name in shader.TRANSPORT:
            node = nodes.new("ShaderNodeAttribute")
            node.attribute_name = name
            yield node.outputs["Vector"], name

    if not item.material_slots:
        item.data.materials.append(None)
    for slot in item.material_slots:
        own, slot.link = slot.material, "OBJECT"
        if own is None:
            slot.material = shader.new_material(f"relight {item.name}", sources)
            continue
        slot.material, found = shader.lit_copy(own, sources)
        if not found:
            yield f"{own.name} has no base color: it is white here"


def run(program, *words):
    """Runs relight's program with these words as its arguments. Raises Problem with its last line if it fails."""
    try:
        done = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    except OSError as error:
        raise Problem(f"{program} does not start ({error.strerror}): name the program in the preferences") from None
    if done.returncode:
        raise Problem(f"relight: {(done.stderr.strip().splitlines() or ['it failed'])[-1]}")


def read_maps(path):
    """Reads maps of relight (docs/transport.md, docs/photos.md).

    Returns:
        Albedo (H,W,3) linear, transport (H,W,9) and coverage (H,W), of the display window, the top row first.

    Raises:
        Problem: if the file is none of them.
    """
    import OpenImageIO

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
    whole = np.zeros((spec.full_height, spec.full_width, len(needed)), np.float32)
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    whole[top : top + spec.height, left : left + spec.width] = pixels[..., [place[name] for name in needed]]
    filled = grown(whole[..., :12], whole[..., 3] > 0)
    return filled[..., :3], filled[..., 3:], whole[..., 12]


def grown(values, known, steps=4):
    """Fills pixels near the known ones by means of known neighbors, step by step.

    Maps end at the mask, but a render interpolates across its edge, which would get dark.

    Args:
        values: (H,W,C).
        known: (H,W) bool.
        steps: how far to fill, pixels.

    Returns:
        (H,W,C), 0 farther away.
    """
    values = np.where(known[..., None], values, 0)
    for _ in range(steps):
        padded = np.pad(np.dstack([values, known]), ((1, 1), (1, 1), (0, 0)))
        around = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
        new = ~known & (around[..., -1] > 0)
        values[new] = around[new, :-1] / around[new, -1:]
        known = known | new
    return values


def add_plane(path, context):
    """Adds an upright plane, two units high, that shows maps of relight and faces -y, as people in Blender do.

    Args:
        path: of the maps, .exr.
        context: Blender's, with the collection that gets the plane.

    Returns:
        What the user should know, one sentence each: nothing.

    Raises:
        Problem: if the file holds no maps.
    """
    albedo, transport, coverage = read_maps(path)
    height, width = coverage.shape
    name, right = Path(path).stem, width / height
    mesh = bpy.data.meshes.new(name)
    corners = [(-right, 0, -1), (right, 0, -1), (right, 0, 1), (-right, 0, 1)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.uv_layers.new().data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1])
    layers = {"Albedo": np.dstack([albedo, coverage])}
    for third, target in enumerate(shader.TRANSPORT):
        layers[target] = np.dstack([transport[..., 3 * third : 3 * third + 3], np.ones_like(coverage)])

    def sources(nodes):
        for target, values in layers.items():
            node = nodes.new("ShaderNodeTexImage")
            node.image = new_image(f"{name} {target}", values)
            node.extension = "CLIP" if target == "Albedo" else "EXTEND"
            yield node.outputs["Color"], target
            if target == "Albedo":
                yield node.outputs["Alpha"], "Alpha"

    mesh.materials.append(shader.new_material(f"relight {name}", sources))
    item = bpy.data.objects.new(name, mesh)
    context.collection.objects.link(item)
    item[PROPERTY] = PLANE
    context.view_layer.objects.active = item
    return []


def new_image(name, values):
    """Returns an image of Blender with values (H,W,4), the top row first, that no color management touches."""
    height, width, _ = values.shape
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True, is_data=True)
    image.alpha_mode = "CHANNEL_PACKED"  # otherwise colors count as multiplied by alpha
    image.pixels.foreach_set(np.ascontiguousarray(values[::-1], np.float32).ravel())
    image.pack()
    return image


def axes(item, depsgraph):
    """Returns the axes (3,3), as rows in the scene's frame, of the frame in which an object's transport is."""
    x, y, z = np.array(item.evaluated_get(depsgraph).matrix_world.to_quaternion().to_matrix()).T
    return np.stack([x, y, z] if item[PROPERTY] == MESH else [x, z, -y])  # of a plane: right, up, toward the viewer
