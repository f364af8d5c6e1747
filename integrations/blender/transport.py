"""Light transport from relight: baked per vertex by its program, or read from its maps."""

import subprocess
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

from . import shader
from .light import Problem, rotation

NAMES = [f"transport.{name}.Y" for name in "L0M0 L1Mn1 L1M0 L1M1 L2Mn2 L2Mn1 L2M0 L2M1 L2M2".split()]
AXES = "relight_axes"  # property of an object that follows the world: its axes (3,3) when its transport was made
POINTS, BESIDE = "relight_points", "relight_beside"  # and then of a baked one: points (N,3); what was baked with it
MANY = 500  # of these points at most
SAME = 0.005  # of the size: what points may be off in the same shape
MARK = "relight_mark"  # attribute of a bake, by which vertices are known behind modifiers
FEW = 100  # vertices of a mesh that is too coarse for light per vertex


def bake(items, program, rays):
    """Bakes objects that shade each other: three color attributes each, and copies of their materials that use them.

    Meshes are taken behind modifiers and shape keys. Yields what the program says, as long as it runs, and at last a
    list of what the user should know, or raises Problem.
    """
    if len({item.data for item in items}) < len(items):
        raise Problem("some of the objects share a mesh: make it their own (Object > Relations > Make Single User)")
    lines, count, parts, notes, depsgraph = [], 0, {}, [], bpy.context.evaluated_depsgraph_get()
    for item in items:
        vertices, faces = evaluated(item, depsgraph)
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in faces + count + 1]
        shown, own = item.evaluated_get(depsgraph), len(item.data.vertices)
        parts[item.name] = count, own, axes(shown).ravel().tolist(), sample(shown).ravel().tolist()
        count += len(vertices)
        if own < FEW:
            notes.append(f"{item.name} has {own} vertices: subdivide it, for light is kept per vertex")
    with tempfile.TemporaryDirectory() as folder, open(Path(folder) / "said", "w+") as said:
        path, out = Path(folder) / "mesh.obj", Path(folder) / "mesh.npz"
        path.write_text("\n".join(lines) + "\n")
        words = [program, "bake", path, "--out", out, "--rays", str(rays)]
        try:
            run = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=said)
        except OSError as error:
            raise Problem(f"{program} does not start ({error.strerror}): name the program in the preferences") from None
        try:
            while run.poll() is None:
                yield ["relight", *Path(said.name).read_text().splitlines()][-1]
                time.sleep(0.05)
            last = ["it wrote nothing: is it relight?", *Path(said.name).read_text().splitlines()][-1]
        finally:
            run.kill()
            run.wait()
        if run.returncode or not out.exists():
            raise Problem(f"{program}: {last}")
        transport = np.load(out)["transport"]

    def sources(nodes):
        for name in shader.TRANSPORT:
            node = nodes.new("ShaderNodeAttribute")
            node.attribute_name = name
            yield node.outputs["Vector"], name

    found = [bpy.data.objects.get(name) for name in parts]  # the user goes on to work, and may undo
    for (name, (_, own, *_)), item in zip(parts.items(), found):
        if not item or item.mode == "EDIT" or len(item.data.vertices) != own:
            raise Problem(f"{name} was changed in the meantime: bake it again")
    for item, (start, own, *shape) in zip(found, parts.values()):
        item[AXES], item[POINTS], item[BESIDE] = *shape, "\n".join(name for name in parts if name != item.name)
        for name, third in zip(shader.TRANSPORT, np.split(transport[start : start + own], 3, axis=1)):
            values = np.pad(third, ((0, 0), (0, 1)), constant_values=1).astype(np.float32)
            kept = item.data.color_attributes.get(name) or item.data.color_attributes.new(name, "FLOAT_COLOR", "POINT")
            kept.data.foreach_set("color", values.ravel())
        if not item.material_slots:
            item.data.materials.append(None)
        for slot in item.material_slots:
            material, slot.link = slot.material, "OBJECT"  # the mesh keeps its own
            slot.material, told = shader.lit_copy(material, item.name, sources)
            notes += told
    yield notes


def evaluated(item, depsgraph):
    """Returns a mesh behind modifiers, its own vertices first: vertices (V,3) in the scene, and triangles (F,3)."""
    attributes, marks = item.data.attributes, np.random.default_rng(0).random((len(item.data.vertices), 3), np.float32)
    attributes.new(MARK, "FLOAT_VECTOR", "POINT").data.foreach_set("vector", marks.ravel())
    depsgraph.update()
    shown = item.evaluated_get(depsgraph)
    vertices, mesh = placed(shown), shown.data
    mesh.calc_loop_triangles()
    faces, found = np.empty((len(mesh.loop_triangles), 3), np.int32), np.zeros_like(vertices, np.float32)
    mesh.loop_triangles.foreach_get("vertices", faces.ravel())
    if MARK in mesh.attributes:
        mesh.attributes[MARK].data.foreach_get("vector", found.ravel())
    attributes.remove(attributes[MARK])
    if not len(faces):
        raise Problem(f"{item.name} has no faces")
    if not np.array_equal(found[: len(marks)], marks) or len(np.unique(found, axis=0)) < len(found):
        raise Problem(f"{item.name} has a modifier that makes, copies or merges vertices: apply it")
    return vertices, faces[:, ::-1] if np.linalg.det(np.array(shown.matrix_world)[:3, :3]) < 0 else faces


def placed(item, chosen=slice(None)):
    """Returns the vertices (V,3) of an evaluated mesh, or chosen ones, in the scene."""
    values, matrix = np.empty((len(item.data.vertices), 3), np.float32), np.array(item.matrix_world)
    item.data.vertices.foreach_get("co", values.ravel())
    return values[chosen] @ matrix[:3, :3].T + matrix[:3, 3]


def sample(item):
    """Returns points (N,3) in the scene, on an evaluated mesh: vertices that no modifier made."""
    count = min(len(item.data.vertices), len(item.original.data.vertices))
    return placed(item, np.linspace(0, count - 1, min(count, MANY)).astype(int))


def axes(item):
    """Returns the axes (3,3) of an object, as columns in the scene's frame; those of a mirror image are one."""
    left, _, right = np.linalg.svd(np.array(item.matrix_world)[:3, :3])
    return left @ right


def turned(items):
    """Yields for evaluated objects how they are turned since their bakes (3,3), and if all is as it was then.

    A rotation may be applied to a mesh, or be that of bones, so points tell it, its own and those of what was baked
    with it (Kabsch 1976, and a change of size); if they have changed, or lie in a plane, its axes do.
    """
    places = {(item.name, item.library): (np.reshape(item.get(POINTS, ()), (-1, 3)), sample(item)) for item in items}
    for item in items:
        by_axes = axes(item) @ np.reshape(item[AXES], (3, 3)).T
        pairs = [places.get((name, item.library)) for name in (item.name, *item.get(BESIDE, "").splitlines())]
        changed = not all(pairs) or any(then.shape != now.shape or np.isnan(now).any() for then, now in pairs)
        if POINTS not in item or changed:
            yield by_axes, POINTS not in item
            continue
        then, now = (np.concatenate(points) - np.concatenate(points).mean(0) for points in zip(*pairs))
        across = now.T @ then
        left, sizes, right = np.linalg.svd(across)
        found = left @ right if sizes[2] > 1e-6 * sizes[0] else by_axes
        off = now - then @ found.T * np.sum(found * across) / np.square(then).sum()
        same = np.abs(off).max() < SAME * np.ptp(pairs[0][1], 0).max()
        yield found if same else by_axes, same


def read_maps(path):
    """Returns albedo and coverage (H,W,4) and transport (H,W,9) of maps of relight, the top row first.

    Albedo and transport are continued beyond the figure, since renders interpolate across its edge.
    """
    import OpenImageIO as oiio  # only Blender itself has it on its path

    maps = oiio.ImageBuf(str(path))
    if not maps.read(force=True):
        maps.geterror()  # or it prints that nobody read it
        raise Problem(f"{path} is not a readable OpenEXR file")
    place = {name: i for i, name in enumerate(maps.spec().channelnames)}
    needed = ["albedo.R", "albedo.G", "albedo.B", *NAMES, "coverage.A"]
    if missing := [name for name in needed if name not in place]:
        raise Problem(f"{path} holds no maps of relight: it lacks {', '.join(missing)}")
    pixels = maps.get_pixels(oiio.FLOAT, maps.roi_full)
    for name in NAMES:  # with the mean of what surfaces reflect onto each other: the shader has no color for it
        if bounced := [place[rgb] for c in "RGB" if (rgb := f"bounced{name[9:-1]}{c}") in place]:
            pixels[..., place[name]] += pixels[..., bounced].mean(axis=-1)
    values = pixels[..., [place[name] for name in needed]]
    known = values[..., 3:4] > 0
    holes = oiio.ImageBuf(np.ascontiguousarray(np.dstack([values[..., :12] * known, known]), np.float32))
    holes.specmod().alpha_channel = 12
    filled = oiio.ImageBufAlgo.fillholes_pushpull(holes).get_pixels()
    return np.dstack([filled[..., :3], values[..., 12]]), filled[..., 3:12]


def add_plane(path, context):
    """Adds an upright plane, two units high, that shows maps and faces -y, as people in Blender do; returns notes."""
    albedo, transport = read_maps(path)
    height, width, _ = albedo.shape
    name, right = Path(path).stem, width / height
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-right, 0, -1), (right, 0, -1), (right, 0, 1), (-right, 0, 1)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new().data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1])
    upright = rotation([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # maps have y up, and z toward the viewer
    thirds = np.split(transport @ upright, 3, axis=2)

    def sources(nodes):
        for target, values in zip(("Albedo", *shader.TRANSPORT), (albedo, *thirds)):
            values = np.pad(values, ((0, 0), (0, 0), (0, 4 - values.shape[2])), constant_values=1)
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
    item[AXES] = np.eye(3).ravel().tolist()
    context.view_layer.objects.active = item
    return []
