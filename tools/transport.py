"""Draws docs/images/transport.jpg, which explains light transport in three pictures.

python tools/transport.py [seed]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from omegaconf import OmegaConf

from relight import srgb
from relight.config import ROOT, composed
from relight.figures.dress import make_figure
from relight.lights import lit_ball, load_light
from relight.maps import Maps
from relight.maps.square import extent
from relight.meshes import align, clean
from relight.sh import basis
from relight.transport import bake
from relight.transport.raycaster import RayCaster

SIZE, BALL = 720, 96  # pixels of the maps, and of a ball
RAYS = 256  # per pixel
BRIGHTNESS = 0.8  # reference brightness of the light
MAX_SHADING = 1.6  # that is drawn as white
MAX_BAND_1 = 1.03  # of transport: its value where nothing is occluded and the normal points along the axis
LIGHT = "key:#ffd9b0@-40,35,0.3"
COEFFICIENTS = ("0,0", "1,-1", "1,0", "1,1", "2,-2", "2,-1", "2,0", "2,1", "2,2")


def main(seed: int) -> None:
    """Draws the figure of a seed in three pictures side by side, and writes them."""
    settings = OmegaConf.to_object(composed())
    mesh = make_figure(seed, detail="full", texture=1024)
    mesh = align(clean(mesh, settings.clean), settings.align)
    maps = bake(mesh, SIZE, RAYS)
    figure = plt.figure(figsize=(15, 5.4), layout="constrained")
    left, middle, right = GridSpec(1, 3, figure, width_ratios=[1.25, 0.8, 1.6])
    draw_visibility(figure, left, RayCaster(mesh.vertices, mesh.faces), maps)
    figure.text(0.02, 0.98, "1  Visibility times cosine", va="top", fontsize=13, weight="bold")
    draw_harmonics(figure, middle)
    figure.text(0.37, 0.98, "2  Nine patterns", va="top", fontsize=13, weight="bold")
    draw_product(figure, right, maps)
    figure.text(0.58, 0.98, "3  One dot product for each pixel", va="top", fontsize=13, weight="bold")
    figure.get_layout_engine().set(rect=(0, 0, 1, 0.93))
    figure.savefig(ROOT / "docs" / "images" / "transport.jpg", dpi=100, pil_kwargs={"quality": 88})


def draw_visibility(figure: Figure, place: SubplotSpec, scene: RayCaster, maps: Maps) -> None:
    """Draws a figure with two of its points marked, and what each of the two sees."""
    grid = place.subgridspec(2, 2, width_ratios=[1.1, 1])
    axis = figure.add_subplot(grid[:, 0])
    (top, _), (left, _) = extent(maps.mask)
    show(axis, cut_out(maps, srgb.encode(maps.albedo * maps.ao[..., None])))
    open_point, dark_point = select_points(maps)
    for number, (name, (row, column)) in enumerate({"shoulder": open_point, "armpit": dark_point}.items()):
        axis.plot(column - left, row - top, "o", ms=11, mfc="none", mec="crimson", mew=2)
        seen = figure.add_subplot(grid[number, 1])
        show(seen, visibility(scene, maps, (row, column)))
        seen.set_title(f"from the {name}", fontsize=10)


def draw_harmonics(figure: Figure, place: SubplotSpec) -> None:
    """Draws the nine spherical harmonics of order 2 on balls: positive values orange, negative ones blue."""
    grid = place.subgridspec(3, 3)
    disc, normal = front()
    for number, values in enumerate(basis(normal, order=2).T):
        picture = np.ones((BALL, BALL, 3))
        strength = values / np.abs(values).max()
        tint = np.where(strength[:, None] > 0, [0.85, 0.35, 0.1], [0.1, 0.4, 0.8])
        picture[disc] = 1 - np.abs(strength)[:, None] * (1 - tint)
        axis = figure.add_subplot(grid[number])
        show(axis, picture)
        axis.set_title(f"$Y_{{{COEFFICIENTS[number]}}}$", fontsize=10)


def draw_product(figure: Figure, place: SubplotSpec, maps: Maps) -> None:
    """Draws transport, light, their product for each pixel, and that times the albedo."""
    grid = place.subgridspec(1, 4, width_ratios=[1, 0.45, 1, 1])
    light = load_light(LIGHT).normalised(BRIGHTNESS).coefficients
    shading = maps.transport @ light
    ball = lit_ball(light, BALL)
    panels = {
        "T (three of nine)": cut_out(maps, (maps.transport[..., [3, 1, 2]] / MAX_BAND_1 + 1) / 2),
        "L": ball[..., :3] * ball[..., 3:] + 1 - ball[..., 3:],  # on white
        "T.L": cut_out(maps, srgb.encode(shading / MAX_SHADING)),
        "albedo times T.L": cut_out(maps, srgb.encode(maps.albedo * shading)),
    }
    for number, (name, picture) in enumerate(panels.items()):
        axis = figure.add_subplot(grid[number])
        show(axis, picture)
        axis.set_title(name, fontsize=10)


def cut_out(maps: Maps, picture: np.ndarray) -> np.ndarray:
    """Returns the part (h,w,3) of a picture (S,S,3) around the figure, white outside of the mask."""
    box = tuple(slice(*ends) for ends in extent(maps.mask))
    return np.where(maps.mask[box][..., None], picture[box], 1)


def select_points(maps: Maps) -> tuple[tuple[int, int], tuple[int, int]]:
    """Returns two pixels (row, column) of the upper body that face the camera: the least and the most occluded one."""
    rows = np.flatnonzero(maps.mask.any(1))
    upper = np.zeros_like(maps.mask)
    upper[rows[0] + len(rows) // 6 : rows[0] + len(rows) // 3] = True
    candidates = maps.mask & upper & (maps.normal[..., 2] > 0.35)
    score = np.where(candidates, maps.ao, np.nan)
    return np.unravel_index(np.nanargmax(score), score.shape), np.unravel_index(np.nanargmin(score), score.shape)


def visibility(scene: RayCaster, maps: Maps, point: tuple[int, int]) -> np.ndarray:
    """Draws what a point sees of the hemisphere in front of the camera's plane, as a disc.

    Args:
        scene: the figure.
        maps: of the figure, (S,S).
        point: a pixel (row, column).

    Returns:
        (BALL,BALL,3): red where it is occluded, grey by the cosine where it is visible, black behind the surface.
    """
    row, column = point
    size = len(maps.mask)
    on_image_plane = np.array([(2 * column + 1) / size - 1, 1 - (2 * row + 1) / size, 0])
    normal = maps.normal[point]
    start = scene.to_local(scene_point(scene, on_image_plane) + scene.offset * normal)
    disc, directions = front()
    rays = np.concatenate([np.broadcast_to(start, directions.shape), directions], axis=1)
    blocked = scene.occluded(np.ascontiguousarray(rays, np.float32))
    cosine = np.maximum(directions @ normal, 0)
    picture = np.ones((BALL, BALL, 3))
    picture[disc] = np.where(blocked[:, None], [0.75, 0.2, 0.15], 0.15 + 0.8 * cosine[:, None])
    picture[disc] = np.where(cosine[:, None] > 0, picture[disc], 0.08)
    return picture


def scene_point(scene: RayCaster, position: np.ndarray) -> np.ndarray:
    """Returns the first point (3,) of the mesh that a ray from the front hits at (x, y) of a position (3,)."""
    in_front = scene.to_local(position + [0, 0, 2 * scene.diagonal])
    ray = np.concatenate([in_front, [0, 0, -1]]).astype(np.float32)[None]
    return scene.points(*scene.intersect(ray))[0]


def front() -> tuple[np.ndarray, np.ndarray]:
    """Returns the disc (BALL,BALL) bool of a unit sphere seen from the front, and its directions (N,3)."""
    grid = (2 * np.arange(BALL) + 1) / BALL - 1
    x, y = np.meshgrid(grid, -grid)
    disc = x**2 + y**2 < 0.98  # without the rim, whose directions are hardly in front
    x, y = x[disc], y[disc]
    return disc, np.stack([x, y, np.sqrt(1 - x**2 - y**2)], -1)


def show(axis: plt.Axes, picture: np.ndarray) -> None:
    """Shows a picture (H,W,3), clipped to [0,1], without ticks and frame."""
    axis.imshow(np.clip(picture, 0, 1))
    axis.axis("off")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 12)
