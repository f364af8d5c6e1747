"""Draws docs/images/transport.jpg, which explains light transport in three pictures.

python tools/transport.py [seed]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.gridspec import GridSpec, GridSpecFromSubplotSpec
from omegaconf import OmegaConf

from relight import srgb
from relight.config import ROOT, composed
from relight.figures.dress import make_figure
from relight.lights import lit_ball as ball
from relight.lights import load_light
from relight.meshes import align, clean
from relight.sh import basis
from relight.transport import bake
from relight.transport.raycaster import RayCaster

SIZE, BALL = 720, 96
LIGHT = "key:#ffd9b0@-40,35,0.3"
BAND = ("0,0", "1,-1", "1,0", "1,1", "2,-2", "2,-1", "2,0", "2,1", "2,2")


def main(seed: int) -> None:
    settings = OmegaConf.to_object(composed())
    mesh = make_figure(seed, "full", 1024)
    mesh.info.update(name=f"g{seed:04d}", axes={"up": "+y", "front": "+z"})
    mesh = align(clean(mesh, settings.clean), settings.align)
    maps = bake(mesh, SIZE, 256)
    light = load_light(LIGHT).normalised(0.8).coefficients
    open_point, dark_point = select_points(maps)

    figure = plt.figure(figsize=(15, 5.4), layout="constrained")
    grid = GridSpec(1, 3, figure, width_ratios=[1.25, 0.8, 1.6])
    left = GridSpecFromSubplotSpec(2, 2, grid[0], width_ratios=[1.1, 1])
    axis = figure.add_subplot(left[:, 0])
    rows, columns = np.flatnonzero(maps.mask.any(1)), np.flatnonzero(maps.mask.any(0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    show(axis, np.where(maps.mask[box][..., None], srgb.encode(maps.albedo[box] * maps.ao[box][..., None]), 1))
    scene = RayCaster(mesh.vertices, mesh.faces)
    for k, (name, point) in enumerate({"shoulder": open_point, "armpit": dark_point}.items()):
        at = np.array(point) - [box[0].start, box[1].start]
        axis.plot(*at[::-1], "o", ms=11, mfc="none", mec="crimson", mew=2)
        other = figure.add_subplot(left[k, 1])
        show(other, visibility(scene, maps, point))
        other.set_title(f"from the {name}", fontsize=10)
    figure.text(0.02, 0.98, "1  Visibility times cosine", va="top", fontsize=13, weight="bold")

    middle = GridSpecFromSubplotSpec(3, 3, grid[1])
    disc, normal = front()
    for k, values in enumerate(basis(normal, 2).T):
        picture = np.ones((BALL, BALL, 3))
        strength = values / np.abs(values).max()
        tint = np.where(strength[:, None] > 0, [0.85, 0.35, 0.1], [0.1, 0.4, 0.8])
        picture[disc] = 1 - np.abs(strength)[:, None] * (1 - tint)
        axis = figure.add_subplot(middle[k])
        show(axis, picture)
        axis.set_title(f"$Y_{{{BAND[k]}}}$", fontsize=10)
    figure.text(0.37, 0.98, "2  Nine patterns", va="top", fontsize=13, weight="bold")

    right = GridSpecFromSubplotSpec(1, 4, grid[2], width_ratios=[1, 0.45, 1, 1])
    transport = (maps.transport[..., [3, 1, 2]] / 1.03 + 1) / 2
    shading = maps.transport @ light
    lit = ball(light, BALL)
    panels = {
        "T (three of nine)": transport,
        "L": lit[..., :3] * lit[..., 3:] + 1 - lit[..., 3:],
        "T.L": srgb.encode(shading / 1.6),
        "albedo times T.L": srgb.encode(maps.albedo * shading),
    }
    for k, (name, picture) in enumerate(panels.items()):
        axis = figure.add_subplot(right[k])
        show(axis, picture if name == "L" else np.where(maps.mask[box][..., None], picture[box], 1))
        axis.set_title(name, fontsize=10)
    figure.text(0.58, 0.98, "3  One dot product for each pixel", va="top", fontsize=13, weight="bold")
    figure.get_layout_engine().set(rect=(0, 0, 1, 0.93))
    figure.savefig(ROOT / "docs" / "images" / "transport.jpg", dpi=100, pil_kwargs={"quality": 88})


def select_points(maps) -> tuple[tuple[int, int], tuple[int, int]]:
    """Returns two pixels (row, column) of the upper body that face the camera: the least and the most occluded one."""
    rows = np.flatnonzero(maps.mask.any(1))
    upper = np.zeros_like(maps.mask)
    upper[rows[0] + len(rows) // 6 : rows[0] + len(rows) // 3] = True
    candidates = maps.mask & upper & (maps.normal[..., 2] > 0.35)
    score = np.where(candidates, maps.ao, np.nan)
    return np.unravel_index(np.nanargmax(score), score.shape), np.unravel_index(np.nanargmin(score), score.shape)


def visibility(scene: RayCaster, maps, point: tuple[int, int]) -> np.ndarray:
    """Draws the visibility of the front hemisphere from a pixel as a disc: grey where visible, red where occluded."""
    row, column = point
    size = len(maps.mask)
    position = np.array([(2 * column + 1) / size - 1, 1 - (2 * row + 1) / size, 0])
    start = scene_point(scene, position)
    disc, direction = front()
    normal = maps.normal[point]
    rays = np.concatenate(
        [np.broadcast_to(scene.to_local(start + scene.offset * normal), direction.shape), direction], 1
    )
    blocked = scene.occluded(np.ascontiguousarray(rays, np.float32))
    cosine = np.maximum(direction @ normal, 0)
    picture = np.ones((BALL, BALL, 3))
    picture[disc] = np.where(blocked[:, None], [0.75, 0.2, 0.15], 0.15 + 0.8 * cosine[:, None])
    picture[disc] = np.where(cosine[:, None] > 0, picture[disc], 0.08)
    return picture


def scene_point(scene: RayCaster, position: np.ndarray) -> np.ndarray:
    """Returns the first point of the mesh behind (x, y) of the aligned frame."""
    ray = np.concatenate([scene.to_local(position + [0, 0, 2 * scene.diagonal]), [0, 0, -1]]).astype(np.float32)[None]
    return scene.points(*scene.intersect(ray))[0]


def front() -> tuple[np.ndarray, np.ndarray]:
    """Returns the disc (BALL,BALL) bool of a unit sphere seen from the front, and its directions (N,3)."""
    grid = (2 * np.arange(BALL) + 1) / BALL - 1
    x, y = np.meshgrid(grid, -grid)
    disc = x**2 + y**2 < 0.98
    x, y = x[disc], y[disc]
    return disc, np.stack([x, y, np.sqrt(1 - x**2 - y**2)], -1)


def show(axis: plt.Axes, picture: np.ndarray) -> None:
    axis.imshow(np.clip(picture, 0, 1))
    axis.axis("off")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 12)
