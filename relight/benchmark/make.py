"""Writes a set of the benchmark to a folder. Can be resumed; each picture is complete or absent."""

import hashlib
import json
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from PIL import Image

from relight.benchmark import recipes
from relight.benchmark.files import INDEX, MAPS, keep_record, write_arrays
from relight.benchmark.picture import Picture, Settings, render_picture
from relight.core.errors import UserError
from relight.core.files import atomic_folder, atomic_write, file_hash, writable_folder, write_json
from relight.core.progress import progress
from relight.maps import write_maps
from relight.meshes import Mesh, align
from relight.panoramas import Panorama
from relight.panoramas.polyhaven import NAMES, panorama_file
from relight.settings import Align
from relight.transport.tracer import import_mitsuba

FORMAT = 1  # version of the file format
ATTEMPTS = 3  # seeds that are tried for a figure
BYTES_PER_PICTURE = 5e6  # at 512 px, approximately


def make(folder: Path | str, kind: str = "report", count: int | None = None, settings: Settings | None = None) -> str:
    """Renders the missing pictures of a set.

    Args:
        folder: folder of the benchmark's set.
        kind: `report`, `choose` or `real`.
        count: number of pictures, from the first; by default all.
        settings: settings of the pictures.

    Returns:
        The set's hash.

    Raises:
        UserError: without Mitsuba, for settings out of range, if the folder holds another set, or if the panoramas
            of the set `real` are not set up.
    """
    folder, settings = Path(folder), settings or Settings()
    if settings.size < 64 or settings.size % 16:
        raise UserError(f"--size {settings.size}: must be a multiple of 16, and at least 64")
    wanted = recipes.draw_recipes(kind, count)
    if len(wanted) == recipes.FIGURES * recipes.VIEWS and recipes.digest(wanted) != recipes.HASHES[kind]:
        raise RuntimeError(f"the recipes of {kind} have changed, but those of a published set must not")
    import_mitsuba()
    if kind == recipes.REAL:
        panorama_file(NAMES[0])  # fails before the first figure is drawn
    writable_folder(folder, "--out", int(BYTES_PER_PICTURE * len(wanted) * (settings.size / 512) ** 2))
    plan = {"format": FORMAT, "set": kind, "settings": asdict(settings)}
    problem = f"{folder} holds another set, or one with other settings: give another --out"
    keep_record(folder / "plan.json", plan, problem)
    missing = [recipe for recipe in wanted if not (folder / "inputs" / recipe.name).is_dir()]
    for seed, group in groupby(progress(missing, "pictures"), lambda recipe: recipe.seed):
        mesh = recipes.with_gloss(make_mesh(seed, settings), seed)
        for recipe in group:
            picture = render_picture(recipe, mesh, settings)
            info = {"name": recipe.name, "subject": mesh.info["subject"], "view": asdict(recipe.view)}
            picture.maps.info = {**picture.maps.info, **info}
            save_picture(folder, recipe.name, mesh.info["name"], asdict(recipe), picture)
    return write_index(folder, kind, [recipe.name for recipe in wanted], asdict(settings))


def make_mesh(seed: int, settings: Settings) -> Mesh:
    """Generates the aligned figure of a seed, or of a spare one if the generator refuses it.

    Raises:
        UserError: if it refuses all ATTEMPTS.
    """
    from relight.figures.make import make_figure

    facing = Align(up="+y", front="+z")
    for spare in range(ATTEMPTS):
        try:
            return align(make_figure(seed + spare * recipes.SPARE_OFFSET, settings.detail, settings.texture), facing)
        except UserError as error:
            reason = error
    raise UserError(f"seed {seed}: {reason}")


def save_picture(folder: Path, name: str, figure: str, recipe: dict[str, Any], picture: Picture) -> None:
    """Writes one picture. Its folder of inputs is written last, so its presence means that the picture is complete.

    `figure` is the name of the person, and `recipe` says how the picture was made, in values of JSON.
    """
    truth, inputs = folder / "truth", folder / "inputs"
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
            write_json(tmp / "picture.json", record)
            if not variant:
                for number, panorama in enumerate(picture.new):
                    write_panorama(tmp / f"new_{number}.exr", panorama)
                arrays = {"full": picture.relit, **{key: getattr(picture.truth, key) for key in (*MAPS, "light")}}
                write_arrays(truth / f"{name}.npz", file_hash(tmp / "photo.png"), arrays)
                write_panorama(truth / f"{name}.light.exr", picture.light)


def write_panorama(path: Path, panorama: Panorama) -> None:
    """Writes a lat-long panorama as OpenEXR. Its centre is toward -z, away from the camera, and +x is to the right."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with atomic_write(path) as tmp:
        OpenEXR.File(header, {"RGB": np.ascontiguousarray(panorama.pixels, np.float32)}).write(str(tmp))


def write_index(folder: Path, kind: str, names: list[str], settings: dict[str, Any]) -> str:
    """Writes index.json: the named pictures, whose variants follow each, hashes of their files, and that of the set.

    Returns the last: the SHA-256 of all hashes of files.
    """
    pictures = []
    for name in names:
        for path in sorted(folder.glob(f"inputs/{name}")) + sorted(folder.glob(f"inputs/{name}+*")):
            record = json.loads((path / "picture.json").read_text())
            files = sorted(path.iterdir())
            if not record["of"]:
                files += sorted((folder / "truth").glob(f"{name}.*"))
            hashes = {str(file.relative_to(folder)): file_hash(file) for file in files}
            pictures.append({"name": path.name, **record, "files": hashes})
    text = json.dumps([picture["files"] for picture in pictures], sort_keys=True)
    total = hashlib.sha256(text.encode()).hexdigest()
    content = {"format": FORMAT, "set": kind, "settings": settings, "sha256": total, "pictures": pictures}
    write_json(folder / INDEX, content)
    return total
