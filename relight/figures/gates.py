"""What a figure must pass before it is used: finite, in place, not over-stretched, nothing through the cloth."""

import numpy as np
import warp as wp
from scipy import ndimage

from relight.figures import makehuman
from relight.figures.body import Body
from relight.figures.drape import Collider, Draped, vectors
from relight.figures.layers import sided
from relight.figures.patterns import Pattern
from relight.figures.poses import Motion
from relight.meshes.mesh import Mesh

STRETCH = 1.35  # 95th percentile of an edge's length over its pattern's
TORN = 2.5  # 99.9th percentile
SUNK = 0.012  # share of the cloth inside the body
PIXEL = 0.003  # metres between the rays that look for what comes through
SPECK = 40  # pixels: a smaller patch of a lower layer inside a higher one came through the cloth
THROUGH = 60  # pixels of such patches that a figure may have
SPREAD = 0.25  # metres beyond the body that cloth may reach sideways


def cloth(pattern: Pattern, draped: Draped, way: Motion, body: Body) -> str | None:
    """Why the drape is bad, or None."""
    name, x = pattern.garment.name, draped.positions
    if not np.isfinite(x).all():
        return f"{name}: not finite"
    if (high := np.percentile(draped.strain, 95)) > STRETCH:
        return f"{name}: stretched to {high:.2f} of its pattern"
    if (high := np.percentile(draped.strain, 99.9)) > TORN:
        return f"{name}: torn, edges at {high:.2f} of their pattern"
    skin = way.skin(makehuman.rig().weights[makehuman.BODY], body.skin)
    reach = SPREAD + pattern.garment.drop * (0.4 + pattern.garment.flare)
    low, high = skin.min(0) - reach, skin.max(0) + reach
    if (x < low).any() or (x > high).any():
        return f"{name}: flew away from the body"
    end = x[pattern.fields["tube"] > 0.999, 1]
    swept = np.ptp(np.percentile(end, [5, 95])) if pattern.garment.drop > 0.2 else 0.0
    if swept > 0.10 + 0.35 * pattern.garment.drop:
        return f"{name}: its hem was swept up by {swept:.2f} m"
    if (share := sunk(x, skin)) > SUNK:
        return f"{name}: {100 * share:.1f} % of it inside the body"
    slid = x[:, 1].max() - way.skin(pattern.levels[0].weights, pattern.levels[0].held)[:, 1].max()
    if slid < -0.12:
        return f"{name}: slid down by {-slid:.2f} m"
    return None


def sunk(x: np.ndarray, skin: np.ndarray) -> float:
    """Share of the cloth's vertices more than 12 mm inside the skin, hands left out."""
    faces, rig = makehuman.base().faces["body"], makehuman.rig()
    hands = [i for i, bone in enumerate(rig.bones) if bone.startswith(("finger", "metacarpal", "wrist"))]
    loose = rig.weights[makehuman.BODY][:, hands].sum(1) > 0.3
    _, distance, _ = sided(x, Collider(skin, skin, faces[~loose[faces].any(1)]), 0.12)
    return float((distance < -0.012).mean())


@wp.kernel
def first_hit(
    mesh: wp.uint64, origin: wp.array(dtype=wp.vec3), face: wp.array(dtype=int), depth: wp.array(dtype=float)
):
    i = wp.tid()
    hit = wp.mesh_query_ray(mesh, origin[i], wp.vec3(0.0, 0.0, -1.0), 10.0)
    face[i] = -1
    if hit.result:
        face[i] = hit.face
        depth[i] = hit.t


def seen(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first face (H,W) that each front ray meets, -1 for none, and how far (H,W) it is; PIXEL between rays."""
    low, high = vertices.min(0), vertices.max(0)
    x, y = np.arange(low[0], high[0], PIXEL), np.arange(high[1], low[1], -PIXEL)
    origin = np.stack([*np.meshgrid(x, y), np.full((len(y), len(x)), high[2] + 0.1)], axis=-1).reshape(-1, 3)
    corner = wp.array(faces.astype(np.int32).ravel(), dtype=int, device="cpu")
    surface = wp.Mesh(points=vectors(vertices), indices=corner)
    face = wp.zeros(len(origin), dtype=int, device="cpu")
    depth = wp.zeros(len(origin), dtype=float, device="cpu")
    wp.launch(first_hit, dim=len(origin), inputs=[surface.id, vectors(origin), face, depth], device="cpu")
    return face.numpy().reshape(len(y), len(x)), depth.numpy().reshape(len(y), len(x))


def through(vertices: np.ndarray, faces: np.ndarray, layer: np.ndarray) -> int:
    """Pixels of small patches of a lower layer that show inside a higher one at nearly the same depth, from the front.

    layer (F,): 0 the skin, 1, 2, ... the clothes outward, -1 anything else.
    """
    face, depth = seen(vertices, faces)
    label = np.where(face >= 0, layer[face], -2)
    total = 0
    for lower in range(int(layer.max())):
        patches = ndimage.label(label == lower)[0]
        for number, box in enumerate(ndimage.find_objects(patches), 1):
            box = tuple(slice(max(s.start - 2, 0), s.stop + 2) for s in box)
            mine = patches[box] == number
            if mine.sum() > SPECK:
                continue
            ring = ndimage.binary_dilation(mine) & ~mine
            over = label[box][ring] > lower
            if over.all() and abs(depth[box][ring].mean() - depth[box][mine].mean()) < 0.02:
                total += int(mine.sum())
    return total


def figure(mesh: Mesh, layer: np.ndarray) -> str | None:
    """Why the assembled figure is bad, or None. layer (F,): as for `through`."""
    if not np.isfinite(mesh.vertices).all():
        return "vertices not finite"
    height = float(np.ptp(mesh.vertices[:, 1]))
    if not 1.0 < height < 2.7:
        return f"{height:.2f} m high"
    if (count := through(mesh.vertices, mesh.faces, layer)) > THROUGH:
        return f"{count} pixels of a lower layer show through the cloth"
    return None
