"""Draws the pictures of the README and the pages, docs/images/NAME.jpg.

python tools/pictures.py teaser | photo | transport
python tools/pictures.py benchmark SET ANSWERS
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import relight
from relight.benchmark.files import BenchmarkSet
from relight.benchmark.score import read_scores
from relight.core import srgb
from relight.core.npz import read_npz
from relight.figures.make import make_figure
from relight.lights import lit_ball, load_light
from relight.maps import Maps
from relight.maps.square import extent, fill_outside
from relight.meshes import Mesh, align, clean
from relight.photos.background import read_background
from relight.settings import composed
from relight.sh import basis
from relight.transport import bake
from relight.transport.raycaster import RayCaster
from relight.viewer.source import PORTRAIT_MASK

IMAGES = Path(__file__).parents[1] / "docs" / "images"
MAX_BAND_1 = 1.03  # of transport: its value where nothing is occluded and the normal points along the axis
BALL = 96  # pixels


def teaser() -> None:
    """Draws a row for each of two figures: lit, albedo, AO, band 1 of transport, and in three more lights."""
    size, width, paper = 448, 224, 0.97
    lights = [light(text) for text in ("room:7", "sky:5:40", "key:#a9c6ff@-75,10", "key:#ffd9b0@60,20")]
    rows = []
    for seed in (45, 22):
        _, maps = baked(seed, 2 * size)
        relit = [srgb.encode(maps.albedo * (maps.transport @ each)) for each in lights]
        views = [relit[0], srgb.encode(maps.albedo), maps.ao[..., None].repeat(3, -1), band_1(maps), *relit[1:]]
        middle = slice((size - width) // 2, (size + width) // 2)
        pictures = [np.where(maps.mask[..., None], view, paper) for view in views]
        pictures = [each.reshape(size, 2, size, 2, 3).mean((1, 3))[:, middle] for each in pictures]
        for picture, each in zip([pictures[0], *pictures[4:]], lights):
            ball = lit_ball(each, size // 9)
            corner = picture[-len(ball) :, -len(ball) :]
            corner[:] = ball[..., :3] * ball[..., 3:] + corner * (1 - ball[..., 3:])
        rows.append(np.concatenate(pictures, axis=1))
    save("teaser", srgb.to_bytes(np.concatenate(rows)))


def photo() -> None:
    """Draws a photograph (NASA, by scikit-image), its albedo, half its shading, and the photograph in three lights."""
    from skimage import data

    grey, relighter = 0x80, relight.load()
    pixels, mask = data.astronaut(), np.asarray(Image.open(PORTRAIT_MASK))
    person = relighter.infer(pixels, mask)[0]
    coverage, shown = person.coverage[..., None] / 255, [pixels]
    for values in (person.albedo, person.shading / 2):
        placed = np.zeros(pixels.shape)
        placed[person.crop.window] = person.crop.place(fill_outside(values, person.mask))
        shown.append(np.uint8(srgb.to_bytes(srgb.encode(placed)) * coverage + grey * (1 - coverage)))
    plain, room = read_background(f"#{3 * f'{grey:02x}'}"), read_background("panorama", blur=3)
    for text, behind in (("key:#ffd9a0@70,20,0.15", plain), ("key:#a8c8ff@-70,20,0.15", plain), ("room:36", room)):
        shown.append(relighter.relight(pixels, mask, text, background=behind)[..., :3])
    save("photo", np.concatenate(shown, axis=1), scale=0.5, quality=90)


def transport() -> None:
    """Explains light transport: what two points of a figure see, nine spherical harmonics, and one dot product."""
    mesh, maps = baked(31, 720)
    figure = plt.figure(figsize=(15, 5.4), layout="constrained")
    figure.get_layout_engine().set(rect=(0, 0, 1, 0.93))
    parts = figure.add_gridspec(1, 3, width_ratios=[1.25, 0.8, 1.6])
    titles = {0.02: "1  Visibility times cosine", 0.37: "2  Nine patterns", 0.58: "3  One dot product for each pixel"}
    for x, title in titles.items():
        figure.text(x, 0.98, title, va="top", fontsize=13, weight="bold")
    box = tuple(slice(*ends) for ends in extent(maps.mask))

    def show(place, picture: np.ndarray, title: str = "") -> plt.Axes:
        axis = figure.add_subplot(place)
        axis.imshow(np.clip(picture, 0, 1))
        axis.axis("off")
        axis.set_title(title, fontsize=10)
        return axis

    def cut_out(picture: np.ndarray) -> np.ndarray:
        return np.where(maps.mask[box][..., None], picture[box], 1)

    grid = parts[0].subgridspec(2, 2, width_ratios=[1.1, 1])
    whole = show(grid[:, 0], cut_out(srgb.encode(maps.albedo * maps.ao[..., None])))
    rows = np.flatnonzero(maps.mask.any(1))
    upper = slice(rows[0] + len(rows) // 6, rows[0] + len(rows) // 3)
    faces = maps.mask & (maps.normal[..., 2] > 0.35)
    ao = np.where(faces, maps.ao, np.nan)[upper]
    scene = RayCaster(mesh.vertices, mesh.faces)
    for number, (name, rank) in enumerate({"an open": np.nanargmax(ao), "a hidden": np.nanargmin(ao)}.items()):
        row, column = np.add(np.unravel_index(rank, ao.shape), (upper.start, 0))
        whole.plot(column - box[1].start, row - box[0].start, "o", ms=11, mfc="none", mec="crimson", mew=2)
        show(grid[number, 1], seen_from(scene, maps, row, column), f"from {name} point")

    grid, (disc, normals) = parts[1].subgridspec(3, 3), ball()
    for number, (values, name) in enumerate(
        zip(basis(normals, order=2).T, "0,0 1,-1 1,0 1,1 2,-2 2,-1 2,0 2,1 2,2".split())
    ):
        picture, strength = np.ones((BALL, BALL, 3)), values[:, None] / np.abs(values).max()
        tint = np.where(strength > 0, [0.85, 0.35, 0.1], [0.1, 0.4, 0.8])  # orange where positive, blue where negative
        picture[disc] = 1 - np.abs(strength) * (1 - tint)
        show(grid[number], picture, f"$Y_{{{name}}}$")

    coefficients = light("key:#ffd9b0@-40,35,0.3")
    shading, lit = maps.transport @ coefficients, lit_ball(coefficients, BALL)
    panels = {
        "T (three of nine)": cut_out(band_1(maps)),
        "L": lit[..., :3] * lit[..., 3:] + 1 - lit[..., 3:],
        "T.L": cut_out(srgb.encode(shading / 1.6)),
        "albedo times T.L": cut_out(srgb.encode(maps.albedo * shading)),
    }
    for place, (title, picture) in zip(parts[2].subgridspec(1, 4, width_ratios=[1, 0.45, 1, 1]), panels.items()):
        show(place, picture, title)
    figure.savefig(IMAGES / "transport.jpg", dpi=100, pil_kwargs={"quality": 88})


def benchmark(truth: str, answers: str) -> None:
    """Draws six photos of a benchmark from the least to the largest `full: RMSE`, relit in two ways, and the truth."""
    side, paper = 200, 242  # pixels of a tile; code of the background
    known = BenchmarkSet(Path(truth))
    entries = [entry for entry in known.entries if not entry.of]
    order, columns = np.argsort(read_scores(Path(answers))["full"].to_numpy()), []
    for rank in np.linspace(0, len(entries) - 1, 6).round().astype(int):
        entry = entries[order[rank]]
        answer, shot = read_npz(Path(answers) / f"{entry.name}.npz", "answer"), entry.shot()
        coverage = shot.mask[..., None] / 255
        relit = (answer["ratio"][0], answer["full"][0], known.truth(entry)[1][0])  # in the first new light
        pictures = [shot.photo, *(np.uint8(each * coverage + paper * (1 - coverage) + 0.5) for each in relit)]
        top, left, edge = (round(value) for value in (shot.square.top, shot.square.left, shot.square.side))
        tiles = []
        for picture in pictures:
            tile = Image.new("RGB", (edge, edge), (paper,) * 3)
            tile.paste(Image.fromarray(picture), (-left, -top))
            tiles.append(np.asarray(tile.resize((side, side), Image.Resampling.LANCZOS)))
        columns.append(np.concatenate(tiles))
    save("benchmark", np.concatenate(columns, axis=1))


def baked(seed: int, size: int) -> tuple[Mesh, Maps]:
    """Returns the generated figure of a seed, and its maps."""
    settings = composed()
    mesh = align(clean(make_figure(seed, detail="full", texture=1024)), settings.align)
    return mesh, bake(mesh, size, rays=256)


def light(text: str) -> np.ndarray:
    """Returns the coefficients (9,3) of a light, at a brightness that suits pictures."""
    return load_light(text).normalised(0.8).coefficients


def band_1(maps: Maps) -> np.ndarray:
    """Shows band 1 of transport (H,W,3): x, y and z as red, green and blue."""
    return (maps.transport[..., [3, 1, 2]] / MAX_BAND_1 + 1) / 2


def ball() -> tuple[np.ndarray, np.ndarray]:
    """Returns the disc (BALL,BALL) bool of a unit sphere seen from the front, and its normals (N,3)."""
    x, y = np.meshgrid(*[(2 * np.arange(BALL) + 1) / BALL - 1] * 2)
    disc = x**2 + y**2 < 0.98  # without the rim, whose directions are hardly in front
    x, y = x[disc], -y[disc]
    return disc, np.stack([x, y, np.sqrt(1 - x**2 - y**2)], -1)


def seen_from(scene: RayCaster, maps: Maps, row: int, column: int) -> np.ndarray:
    """Draws what the point in a pixel sees in front of it (BALL,BALL,3): grey by the cosine, red where it is occluded,
    black behind the surface."""
    size, normal = len(maps.mask), maps.normal[row, column]
    camera = scene.to_local(np.array([(2 * column + 1) / size - 1, 1 - (2 * row + 1) / size, 2 * scene.diagonal]))
    hit = scene.points(*scene.intersect(np.array([[*camera, 0, 0, -1]], np.float32)))[0]
    disc, directions = ball()
    start = np.broadcast_to(scene.to_local(hit + scene.offset * normal), directions.shape)
    blocked = scene.occluded(np.concatenate([start, directions], axis=1).astype(np.float32))
    cosine, picture = (directions @ normal)[:, None], np.ones((BALL, BALL, 3))
    picture[disc] = np.where(blocked[:, None], [0.75, 0.2, 0.15], 0.15 + 0.8 * cosine)
    picture[disc] = np.where(cosine > 0, picture[disc], 0.08)
    return picture


def save(name: str, pixels: np.ndarray, scale: float = 1, quality: int = 88) -> None:
    """Writes a picture (H,W,3) uint8."""
    size = round(scale * pixels.shape[1]), round(scale * pixels.shape[0])
    image = Image.fromarray(pixels).resize(size, Image.Resampling.LANCZOS)
    image.save(IMAGES / f"{name}.jpg", quality=quality, optimize=name != "photo")


if __name__ == "__main__":
    {each.__name__: each for each in (teaser, photo, transport, benchmark)}[sys.argv[1]](*sys.argv[2:])
