"""Measures the hair of generated heads from eight directions: visible scalp, black pixels, softness of the outline.

    python benchmarks/hair.py --seeds 20000-20011 --sheet heads.png

Heads are made without clothes, in the pose, style and colors of each seed, and baked from eight directions.
Scalp: fraction of skin inside the hairline among pixels of hair and scalp. Black: fraction of hair pixels on the side
of the camera, above the jaw, with ambient occlusion under .1. Edge: width in millimetres over which coverage falls at
the outline, the integral of 4 c (1 - c) over the image divided by the length of the outline of the smoothed coverage.
Grain: standard deviation of ln luminance between Gaussians of 1 and 3 mm, in albedo and in shading. The sheet shows
each head lit by a generated room.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is imported, see transport.py

import argparse
import json
import time

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from relight.figures import assembly, dress
from relight.figures.body import makehuman, skin
from relight.figures.body.person import build_body
from relight.figures.builder import Builder
from relight.figures.cloth import colliders
from relight.figures.commands import seeds_of
from relight.figures.hair.combing import head_centre
from relight.figures.hair.styles import styles
from relight.figures.paints import skin_material
from relight.figures.pose.motion import build_motion
from relight.figures.wear import DETAILS
from relight.srgb import LUMINANCE, encode, to_bytes
from relight.transport.baker import Baker, pixel_corners, primary_hits
from relight.transport.view import View

CUT_BELOW_EYES = 0.17  # metres, where a head is cut off
ROOM = 11


class Head:
    """The head of a seed, ready for baking, with the kind of each face."""

    def __init__(self, seed: int, style: str | None, detail: str, texture: int, rays: int):
        """Generates the head of a seed, without the rest of the figure.

        Args:
            seed: of the figure.
            style: name of the hair style; None for the seed's own.
            detail: a key of DETAILS.
            texture: side of the textures, pixels.
            rays: of the baker, per pixel.
        """
        draw = dress.sample(seed, 0, 1, 0.0)
        outfit, detail = draw.outfit, dress.replace(DETAILS[detail], texture=texture)
        if style is not None:
            outfit = dress.replace(outfit, hair=styles()[style])
        body = build_body(draw.person, draw.expression)
        motion = build_motion(body, draw.pose, 1)
        base = makehuman.base()
        faces, uv = base.faces["body"], base.uv[base.uv_faces["body"]]
        posed = motion.posed_skin
        eye = body.vertices[makehuman.EYES["L"]].mean(0)
        near = (body.skin[:, 1] > eye[1] - CUT_BELOW_EYES) & (np.abs(body.skin[:, 0]) < 0.14)
        shown = near[faces].all(1) & ~assembly.mouth_cavity()
        self.name, self.style, self.sex = f"g{seed:05d}", outfit.hair.name, draw.person.female > 0.5
        builder = Builder()
        rest, _, _ = assembly.refined(base.vertices[makehuman.BODY], faces[shown], uv[shown], detail.body)
        vertices, shown, corners = assembly.refined(posed, faces[shown], uv[shown], detail.body)
        builder.add(vertices, shown, corners, skin_material(body.person, outfit, texture, seed), layer=0)
        inside = skin.above_hairline(rest[shown].mean(1)) > 0.1
        start = time.process_time()
        colliders.init_warp()
        figure = assembly.Assembly(builder, motion, outfit, [], detail, seed)
        figure.add_eyes()
        figure.add_hair((posed, faces))
        self.seconds = time.process_time() - start
        mesh = builder.mesh({"name": self.name}, [outfit])
        low, high = mesh.vertices.min(0), mesh.vertices.max(0)
        self.scale = 1.9 / float((high - low).max())
        mesh.vertices = ((mesh.vertices - (low + high) / 2) * self.scale).astype(np.float32)
        kinds = {"skin": 0, "hair": 2}  # of faces; 1 is scalp, 3 is anything else
        self.kind = np.array([kinds.get(material.name, 3) for material in mesh.materials])[mesh.material]
        self.kind[: len(inside)] = inside
        self.faces = len(mesh.faces)
        centre = motion.transforms[-1, motion.bones["head"]]
        centre = centre[:, :3] @ head_centre(body) + centre[:, 3]
        grounded = np.concatenate(builder.vertices)[:, 1].min()
        self.centre = (centre - [0, grounded, 0] - (low + high) / 2) * self.scale
        self.baker = Baker(mesh, rays)

    def seen(self, size: int, supersample: int, yaw: float) -> dict:
        """Returns maps from one direction, the kind at each pixel (-1: none), the camera's side, and the pixel size."""
        view = View(yaw)
        maps = self.baker.maps(size, supersample, view)
        camera = self.baker.camera(size, view)
        pixel, face, weights = primary_hits(self.baker.caster, camera, *pixel_corners(size) + 0.5)
        kind = np.full(size * size, -1)
        kind[pixel] = self.kind[face]
        off = self.baker.caster.points(face, weights) - self.centre
        ahead = np.zeros(size * size, bool)
        scale = 1.0 if camera.pose is None else camera.pose.scale
        toward = view.rotation[2]
        ahead[pixel] = (off @ toward > 0) & (off[:, 1] > -0.10 * self.scale)
        metres = 2 / size / (scale * self.scale)
        return {"maps": maps, "kind": kind.reshape(size, size), "ahead": ahead.reshape(size, size), "metres": metres}


def measured(view: dict) -> dict[str, tuple[float, float]]:
    """Returns the numerators and denominators of the measures in one view."""
    maps, kind, pixel = view["maps"], view["kind"], 1000 * view["metres"]
    hair, outside = kind == 2, view["ahead"] & (kind == 2)
    scalp = kind == 1
    cover = maps.coverage.astype(float)
    smooth = gaussian_filter(cover, 4 / pixel) > 0.5
    outline = np.abs(np.diff(smooth.astype(float), axis=0)).sum() + np.abs(np.diff(smooth.astype(float), axis=1)).sum()
    outline *= np.pi / 4  # mean ratio of the length of a line to that of its raster steps
    out = {
        "scalp": (scalp.sum(), (scalp | hair).sum()),
        "black": ((outside & (maps.ao < 0.1)).sum(), outside.sum()),
        "ao": (maps.ao[outside].sum(), outside.sum()),
        "edge": ((4 * cover * (1 - cover)).sum() * pixel, outline),
    }
    shading = maps.transport[..., 0]
    for name, values in (("albedo", maps.albedo @ LUMINANCE), ("shading", shading)):
        log = np.log(np.maximum(values, 1e-3))
        weight = outside.astype(float)
        fine, coarse = (
            gaussian_filter(log * weight, s / pixel) / np.maximum(gaussian_filter(weight, s / pixel), 1e-9)
            for s in (1.0, 3.0)
        )
        out[f"grain of {name}"] = (np.square((fine - coarse)[outside]).sum(), outside.sum())
    return out


def lit(maps, light: np.ndarray) -> np.ndarray:
    """Returns the picture (H,W,3) uint8 under a light (9,3), on grey."""
    picture = maps.albedo * np.maximum(maps.transport @ light, 0)
    cover = (maps.coverage * maps.mask)[..., None]
    return to_bytes(encode(picture * cover + 0.35 * (1 - cover)))


def main() -> None:
    """Prints the measurements of each head and their means, and draws the heads."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="20000-20011")
    parser.add_argument("--styles", nargs="*", help="hair styles instead of the seeds' own, one a seed, in turn")
    parser.add_argument("--detail", default="full", choices=DETAILS)
    parser.add_argument("--texture", type=int, default=1024)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--supersample", type=int, default=3)
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--yaws", type=int, nargs="+", default=list(range(-180, 180, 45)))
    parser.add_argument("--sheet", help="a picture of all heads, one a row")
    parser.add_argument("--columns", type=int, default=1, help="heads in a row of the sheet")
    args = parser.parse_args()
    from relight.panoramas import Panorama, generate_room, project

    light = project(Panorama(generate_room(ROOM)))
    irradiance_of_constant = 0.8862  # pi Y_00, of a constant light with coefficient 1
    light = light * (0.5 / (light[0] @ LUMINANCE * irradiance_of_constant))
    rows, total = [], []
    for number, seed in enumerate(seeds_of(args.seeds)):
        style = args.styles[number % len(args.styles)] if args.styles else None
        head = Head(seed, style, args.detail, args.texture, args.rays)
        sums: dict[str, np.ndarray] = {}
        pictures, start = [], time.process_time()
        for yaw in args.yaws:
            view = head.seen(args.size, args.supersample, yaw)
            for name, pair in measured(view).items():
                sums[name] = sums.get(name, 0) + np.array(pair, float)
            pictures.append(lit(view["maps"], light))
        rows.append(np.concatenate(pictures, 1))
        values = {name: float(a / b) if b else None for name, (a, b) in sums.items()}
        for name in values:
            if name.startswith("grain") and values[name] is not None:
                values[name] **= 0.5
        total.append(values)
        record = {"head": head.name, "hair": head.style, "CPU s": round(head.seconds, 2), "faces": head.faces}
        record["bake, CPU s"] = round(time.process_time() - start, 1)
        record |= {name: None if value is None else round(value, 4) for name, value in values.items()}
        print(json.dumps(record), flush=True)
    for name in total[0]:
        known = [values[name] for values in total if values[name] is not None]
        print(f"{name}: {np.mean(known):.4f} (worst {max(known):.4f}, least {min(known):.4f}; {len(known)} heads)")
    if args.sheet:
        blank = np.zeros_like(rows[0])
        rows += [blank] * (-len(rows) % args.columns)
        lines = [np.concatenate(rows[i : i + args.columns], 1) for i in range(0, len(rows), args.columns)]
        Image.fromarray(np.concatenate(lines)).save(args.sheet)


if __name__ == "__main__":
    main()
