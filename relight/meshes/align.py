"""Figures into the camera frame: up, front, centre and size."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from relight import files
from relight.config import Align
from relight.files import UserError, existing
from relight.meshes.axes import AXES, find_axes
from relight.meshes.mesh import Mesh

DOUBT = 0.3  # certainty of the front under which a person should look


def align(mesh: Mesh, settings: Align) -> Mesh:
    """The mesh in scene units of the image plane: +x image right, +y up, +z toward the camera.

    The bounding box is centred at the origin and 2 (1 - 2 padding) high, or so wide when it is wider than high. Units
    do not matter. `up` and `front` are axes of the file; auto takes them from info["axes"] where the mesh's maker knows
    them (generated figures), and finds them otherwise (`find_axes`). A row of `settings.table` with the figure's name
    comes before both, and may turn the figure by degrees about its vertical. info["align"] records
    rotation (3,3), centre and scale: aligned = scale * rotation @ (file - centre).
    Raises UserError on settings that name no axis or contradict.
    """
    name = str(mesh.info.get("name", ""))
    row = read_table(settings.table).get(name, {}) if settings.table else {}
    up, front = (
        _axis(key, row.get(key), getattr(settings, key), mesh.info.get("axes", {}).get(key)) for key in ("up", "front")
    )
    turn = float(row.get("turn") or 0)
    warnings = list(mesh.info.get("warnings", []))
    if up is None or front is None:
        axes = find_axes(mesh, up, front)
        up, front = axes.up, axes.front
        if axes.certainty < DOUBT:
            warnings.append(f"its front is a guess ({front} with {up} up): look at it, and correct it in align.table")
    rotation = _turn(turn) @ frame(up, front)
    vertices = mesh.vertices.astype(np.float64) @ rotation.T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = (high - low)[:2].max()
    if not extent > 0:
        raise UserError(f"{name or 'the mesh'} has no extent seen from {front} with {up} up")
    scale = float(2 * (1 - 2 * settings.padding) / extent)
    centre = (low + high) / 2
    record = {
        "up": up,
        "front": front,
        "turn": turn,
        "rotation": rotation.tolist(),
        "centre": (rotation.T @ centre).tolist(),
        "scale": scale,
    }
    return replace(
        mesh,
        vertices=((vertices - centre) * scale).astype(np.float32),
        info={**mesh.info, "align": record, "warnings": warnings},
    )


def _axis(key: str, *said: str | None) -> str | None:
    """The first that says something, or None. Raises UserError when that is no axis."""
    axis = next((axis for axis in said if axis not in (None, "", "auto")), None)
    if axis is not None and axis not in AXES:
        raise UserError(f"align.{key} {axis!r} is not an axis; {', '.join(AXES)} and auto are")
    return axis


def frame(up: str, front: str) -> np.ndarray:
    """The rotation (3,3) that takes the file's axis `up` to +y and `front` to +z, names in AXES.

    Raises UserError when they are not at right angles.
    """
    y, z = AXES[up], AXES[front]
    if y @ z:
        raise UserError(f"up {up} and front {front} are the same axis; they must be at right angles")
    return np.stack([np.cross(y, z), y, z])


def _turn(degrees: float) -> np.ndarray:
    """Rotation about +y; a positive angle turns the figure toward image right, z toward x."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def read_table(path: Path | str) -> dict[str, dict[str, str]]:
    """Rows by `name` of a CSV table with any of the columns up, front and turn (degrees); empty cells mean nothing.

    Raises UserError on a missing file, a table without `name`, a name given twice and a cell that means nothing.
    """
    path = existing(path, "align.table")
    columns, found = files.read_table(path)
    if "name" not in columns:
        raise UserError(f"{path} has no column `name`; a table of overrides has name, up, front, turn")
    rows: dict[str, dict[str, str]] = {}
    for row in found:
        if row["name"] in rows:
            raise UserError(f"{path} names {row['name']} twice")
        for key in ("up", "front"):
            if row.get(key) and row[key] not in (*AXES, "auto"):
                raise UserError(f"{path}: {key} {row[key]!r} of {row['name']}; {', '.join(AXES)} and auto are known")
        try:
            known = math.isfinite(float(row.get("turn") or 0))
        except ValueError:
            known = False
        if not known:
            raise UserError(f"{path}: turn {row['turn']!r} of {row['name']} is not a number of degrees")
        rows[row["name"]] = row
    return rows
