"""Compares the light of panoramas with Blender's Cycles, an independent renderer: values, axes and orientation.

    python benchmarks/cycles.py [FOLDER]

Cycles renders a white diffuse ball under each lat-long panorama of FOLDER, or under those of Blender (measured, CC0),
from the camera of docs/lights.md, which looks at the middle of the panorama. The result, irradiance / pi, is compared
with that of the light's harmonics up to order 2, 4, 8 and 16. Prints the relative RMS difference, which contains the
renderer's noise and the truncation error, and the same for the mirrored panorama.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

from relight.panoramas import project, read_panorama
from relight.sh import irradiance

SIDE = 64  # pixels of the picture of the ball
SAMPLES = 1024  # per pixel
ORDERS = (2, 4, 8, 16)

# Blender is z-up, and the middle of its lat-long panoramas is +x: a camera that looks there has -y to its right.
SCENE = """
import bpy, math, sys
out, samples, side, *panoramas = sys.argv[sys.argv.index("--") + 1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", int(samples), False
scene.cycles.max_bounces, scene.cycles.pixel_filter_type, scene.cycles.sample_clamp_direct = 0, "BOX", 0
scene.render.resolution_x = scene.render.resolution_y = int(side)
scene.render.resolution_percentage = 100
scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
bpy.ops.mesh.primitive_uv_sphere_add(segments=512, ring_count=256, radius=1)
ball = bpy.context.object
bpy.ops.object.shade_smooth()
material = bpy.data.materials.new("white")
material.use_nodes = True
nodes, links = material.node_tree.nodes, material.node_tree.links
nodes.clear()
matt = nodes.new("ShaderNodeBsdfDiffuse")
matt.inputs[0].default_value = (1, 1, 1, 1)
links.new(matt.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs[0])
ball.data.materials.append(material)
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.type, camera.data.ortho_scale = "ORTHO", 2
camera.location, camera.rotation_euler = (-5, 0, 0), (math.pi / 2, 0, -math.pi / 2)
scene.collection.objects.link(camera)
scene.camera = camera
scene.world = bpy.data.worlds.new("world")
scene.world.use_nodes = True
tree = scene.world.node_tree
sky = tree.nodes.new("ShaderNodeTexEnvironment")
tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs[0])
for number, path in enumerate(panoramas):
    sky.image = bpy.data.images.load(path)
    scene.render.filepath = f"{out}/{number}.exr"
    bpy.ops.render.render(write_still=True)
"""


def blender_panoramas() -> Path:
    """Returns the folder of Blender's panoramas."""
    expression = "import bpy; print('AT', bpy.utils.resource_path('LOCAL'), bpy.utils.resource_path('SYSTEM'), sep='|')"
    output = subprocess.run(
        ["blender", "-b", "--python-expr", expression], capture_output=True, text=True, check=True
    ).stdout
    roots = next(line for line in output.splitlines() if line.startswith("AT|")).split("|")[1:]
    places = [Path(root) / "datafiles/studiolights/world" for root in roots if root]
    return next(place for place in places if place.is_dir())


def main() -> None:
    """Prints, for each panorama, the relative error of our irradiance against the rendered sphere."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    folder = parser.parse_args().folder or blender_panoramas()
    panoramas = sorted(p for p in folder.iterdir() if p.suffix in (".exr", ".hdr"))
    x, y = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1, 1 - (np.arange(SIDE) + 0.5) / SIDE * 2
    x, y = np.meshgrid(x, y)
    on = x**2 + y**2 < 0.98**2
    normals = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], axis=-1)[on]
    print(f"{'panorama':16}" + "".join(f"order {order:<4}" for order in ORDERS) + "mirrored  mean ratio R, G, B")
    with tempfile.TemporaryDirectory() as out:
        script = Path(out) / "scene.py"
        script.write_text(SCENE)
        command = ["blender", "-b", "--python", script, "--", out, SAMPLES, SIDE, *panoramas]
        subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL)
        for number, path in enumerate(panoramas):
            channels = OpenEXR.File(f"{out}/{number}.exr").channels()
            traced = next(channels[name] for name in ("RGBA", "RGB") if name in channels).pixels[..., :3][on]
            panorama = read_panorama(path, layout="latlong")

            def relative_error(order: int, at: np.ndarray, traced: np.ndarray = traced, panorama=panorama) -> float:
                ours = irradiance(project(panorama, order), at) / np.pi
                return float(np.sqrt(((ours - traced) ** 2).mean() / (traced**2).mean()))

            level = irradiance(project(panorama, ORDERS[-1]), normals).mean(axis=0) / np.pi / traced.mean(axis=0)
            errors = "".join(f"{relative_error(order, normals):<10.4f}" for order in ORDERS)
            mirrored = relative_error(ORDERS[-1], normals * [-1, 1, 1])
            print(f"{path.stem:16}{errors}{mirrored:<10.3f}" + " ".join(f"{value:.4f}" for value in level))


if __name__ == "__main__":
    main()
