"""Draws a set of the benchmark into a folder: resumable, each picture whole or absent."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from itertools import groupby
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from relight.benchmark.files import INDEX, MAPS, sha256, write_arrays
from relight.benchmark.picture import Picture, Settings, draw
from relight.benchmark.recipes import FIGURES, HASHES, SPARE, VIEWS, Recipe, digest, recipes, with_gloss
from relight.config import Align
from relight.files import UserError, atomic_folder, atomic_write, writable_folder
from relight.maps import write_maps
from relight.meshes import Mesh, align
from relight.panoramas import Panorama
from relight.progress import progress
from relight.transport.tracer import import_mitsuba

PADDING = 0.05  # of the picture's height, above and below a whole person
FORMAT = 1  # of the files; raised when they change
BYTES = 5e6  # of a picture at 512 px, about


def make(folder: Path | str, kind: str = "report", count: int | None = None, settings: Settings | None = None) -> str:
    """Draws what is missing of the set `report` or `choose`, or of its first `count` pictures; returns its hash.

    Raises UserError without Mitsuba, on settings out of range, and for a folder that holds another set.
    """
    folder, settings = Path(folder), settings or Settings()
    if settings.size < 64 or settings.size % 16:
        raise UserError(f"--size {settings.size}: a multiple of 16, 64 at least")
    made = recipes(kind, count)
    if len(made) == FIGURES * VIEWS and digest(made) != HASHES[kind]:
        raise RuntimeError(f"the recipes of {kind} are not those that were published: its pictures may not change")
    import_mitsuba()
    writable_folder(folder, "--out", int(BYTES * len(made) * (settings.size / 512) ** 2))
    same(folder, {"format": FORMAT, "set": kind, "settings": asdict(settings)})
    missing = [one for one in made if not (folder / "inputs" / one.name).is_dir()]
    for _ in progress(drawn(missing, folder, settings), "pictures", total=len(missing)):
        pass
    return index(folder, kind, [one.name for one in made], asdict(settings))


def same(folder: Path, plan: dict) -> None:
    """Leaves `plan` in the folder, or raises UserError when another one is there."""
    path = folder / "plan.json"
    if not path.is_file():
        with atomic_write(path) as tmp:
            tmp.write_text(json.dumps(plan, indent=1) + "\n")
    elif json.loads(path.read_text()) != plan:
        raise UserError(f"{folder} holds another set, or one with other settings ({path}): give another --out")


def drawn(missing: list[Recipe], folder: Path, settings: Settings) -> Iterator[Recipe]:
    """Draws and saves pictures; yields each when it is there."""
    for seed, group in groupby(missing, lambda one: one.seed):
        mesh = with_gloss(figure(seed, settings), seed)
        for recipe in group:
            picture = draw(recipe, mesh, settings)
            info = {"name": recipe.name, "subject": mesh.info["subject"], "view": asdict(recipe.view)}
            assert picture.maps is not None  # only photographs that were imported have none
            picture.maps.info = {**picture.maps.info, **info}
            save(folder, recipe.name, mesh.info["name"], asdict(recipe), picture)
            yield recipe


def figure(seed: int, settings: Settings) -> Mesh:
    """The aligned figure of a seed, or of the next that its generator does not refuse."""
    from relight.figures.dress import make_figure

    facing = Align(up="+y", front="+z", table=None, padding=PADDING, version=0)
    for spare in range(3):
        try:
            return align(make_figure(seed + spare * SPARE, settings.detail, settings.texture), facing)
        except UserError as error:
            reason = error
    raise UserError(f"seed {seed}: {reason}")


def save(folder: Path, name: str, figure: str, recipe: dict, picture: Picture) -> None:
    """Writes one picture, its folder of inputs last: where that is, all of it is."""
    truth, inputs = folder / "truth", folder / "inputs"
    if picture.maps:
        write_maps(truth / f"{name}.exr", picture.maps)
    for variant, shot in sorted(picture.shots.items(), reverse=True):  # the picture itself, "", comes last
        with atomic_folder(inputs / (f"{name}+{variant}" if variant else name)) as tmp:
            Image.fromarray(np.ascontiguousarray(shot.photo)).save(tmp / "photo.png")
            Image.fromarray(np.ascontiguousarray(shot.mask)).save(tmp / "mask.png")
            record = {
                "figure": figure,
                "of": name if variant else None,
                "size": shot.mask.shape,
                "side": shot.square.size,
                "square": [shot.square.top, shot.square.left, shot.square.side],
                "new": 0 if variant else len(picture.new),
                "recipe": recipe,
            }
            (tmp / "picture.json").write_text(json.dumps(record, indent=1) + "\n")
            if not variant:
                for number, panorama in enumerate(picture.new):
                    write_panorama(tmp / f"new_{number}.exr", panorama)
                seen = {key: getattr(picture.seen, key) for key in (*MAPS, "light")}
                arrays = {"full": picture.relit, **{key: values for key, values in seen.items() if values is not None}}
                write_arrays(truth / f"{name}.npz", sha256(tmp / "photo.png"), arrays)
                write_panorama(truth / f"{name}.light.exr", picture.light)


def write_panorama(path: Path, panorama: Panorama) -> None:
    """Lat-long, its centre toward -z, +x to the right: as `relight light` and `relight photo --light` read it."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with atomic_write(path) as tmp:
        OpenEXR.File(header, {"RGB": np.ascontiguousarray(panorama.pixels, np.float32)}).write(str(tmp))


def index(folder: Path, kind: str, names: list[str], settings: dict, **more: str) -> str:
    """Writes index.json: what is in the set, the hash of each file, and a hash of them all, which is returned."""
    pictures = []
    for name in names:
        for path in sorted(folder.glob(f"inputs/{name}")) + sorted(folder.glob(f"inputs/{name}+*")):
            record = json.loads((path / "picture.json").read_text())
            files = sorted(path.iterdir())
            if not record["of"]:
                files += sorted((folder / "truth").glob(f"{name}.*"))
            hashes = {str(file.relative_to(folder)): sha256(file) for file in files}
            pictures.append({"name": path.name, **record, "files": hashes})
    text = json.dumps([one["files"] for one in pictures], sort_keys=True)
    total = hashlib.sha256(text.encode()).hexdigest()
    content = {"format": FORMAT, "set": kind, "settings": settings, **more, "sha256": total, "pictures": pictures}
    with atomic_write(folder / INDEX) as tmp:
        tmp.write_text(json.dumps(content, indent=1) + "\n")
    return total
