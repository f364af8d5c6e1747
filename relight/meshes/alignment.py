"""Aligns figures to the camera frame: up, front, centre and size."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.files import existing_file
from relight.core.numbers import finite
from relight.core.text import read_table
from relight.maps.square import PADDING
from relight.meshes.axes import AXES, find_axes, flat_side
from relight.meshes.mesh import Mesh
from relight.meshes.scans import named_rows
from relight.settings import Align
from relight.sh import rotation_about_y

MAX_PADDING = 0.49
MIN_CERTAINTY = 0.5  # of the front, below which there is a warning


def align(mesh: Mesh, settings: Align, padding: float = PADDING) -> Mesh:
    """Aligns a mesh: +x image right, +y up, +z toward the camera, in units of the image plane.

    The bounding box is centred at the origin and 2 (1 - 2 padding) high, or so wide if it is wider than high. The units
    of the file do not matter. The axes are those of a row of `settings.table` with the figure's name, else of the
    settings, else of info["axes"] (generated figures), else those that `find_axes` finds.

    Args:
        mesh: in the file's frame.
        settings: up and front, axes of the file or `auto`; table.
        padding: margin at each edge, as a share of the image, 0 to MAX_PADDING.

    Returns:
        The aligned mesh. Its info["align"] has rotation (3,3), centre and scale, with
        aligned = scale * rotation @ (file - centre).

    Raises:
        UserError: if a setting names no axis, up and front are the same, or the mesh has no extent.
    """
    name = str(mesh.info.get("name", ""))
    row = read_align_table(settings.table).get(name, {}) if settings.table else {}

    def given_axis(key: str) -> str | None:
        """Returns the first axis that is given; None if all values are None, "" or "auto"."""
        values = row.get(key), getattr(settings, key), mesh.info.get("axes", {}).get(key)
        axis = next((value for value in values if value not in (None, "", "auto")), None)
        if axis not in (None, *AXES):
            raise UserError(f"align.{key} {axis!r} is not an axis; {', '.join(AXES)} and auto are")
        return axis

    up, front = given_axis("up"), given_axis("front")
    turn = float(row.get("turn", 0))
    warnings = list(mesh.info.get("warnings", []))
    if "axes" not in mesh.info and (side := flat_side(mesh)):
        warnings.append(
            f"its {side} side is flat, as a floor or plinth: cut it off, or check the axes (--up, --front, align.table)"
        )
    if up is None or front is None:
        up, front, certainty = find_axes(mesh, up, front)
        if certainty < MIN_CERTAINTY:
            warnings.append(
                f"its front is uncertain ({front} with {up} up): check it, and its turn (--front, in a run align.table)"
            )
    rotation = rotation_about_y(np.radians(turn)) @ axes_rotation(up, front)
    vertices = mesh.vertices.astype(np.float64) @ rotation.T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = (high - low)[:2].max()
    if not extent > 0:
        raise UserError(f"{name or 'the mesh'} has no extent in the view from {front} with {up} up")
    scale = float(2 * (1 - 2 * finite("padding", padding, 0, MAX_PADDING)) / extent)
    centre = (low + high) / 2
    in_file = (rotation.T @ centre + mesh.info.get("origin", 0)).tolist()
    record = {"up": up, "front": front, "turn": turn, "rotation": rotation.tolist(), "centre": in_file, "scale": scale}
    placed = ((vertices - centre) * scale).astype(np.float32)
    return replace(mesh, vertices=placed, normal=None, info={**mesh.info, "align": record, "warnings": warnings})


def axes_rotation(up: str, front: str) -> np.ndarray:
    """Returns the rotation (3,3) that takes the file's axis `up` to +y and `front` to +z, names in AXES.

    Raises:
        UserError: if the axes are not perpendicular.

    >>> axes_rotation("+z", "-y") @ np.array([0, 0, 1])
    array([0., 1., 0.])
    """
    y, z = AXES[up], AXES[front]
    if y @ z:
        raise UserError(f"up {up} and front {front} are the same axis; they must be at right angles")
    return np.stack([np.cross(y, z), y, z])


def read_align_table(path: Path | str) -> dict[str, dict[str, str]]:
    """Reads a CSV table with a column `name` or `path` and any of up, front and turn (degrees); cells may be empty.

    Returns:
        Rows by the name of the figure, as `relight.meshes.scans.list_scans` gives it; without those that are not used.

    Raises:
        UserError: if the file does not exist, has no column `name` or `path`, has a name twice, or a cell cannot be
            parsed.
    """
    path = existing_file(path, "align.table")
    columns, table = read_table(path)
    if not {"name", "path"} & set(columns):
        raise UserError(f"{path} has no column `name`; a table of overrides has name, up, front, turn")
    rows: dict[str, dict[str, str]] = {}
    for name, row in named_rows(path, table):
        for key in ("up", "front"):
            if row.get(key) and row[key] not in (*AXES, "auto"):
                raise UserError(f"{path}: {key} {row[key]!r} of {name}; {', '.join(AXES)} and auto are known")
        row["turn"] = (row.get("turn") or "0").replace(",", ".")  # a decimal comma
        finite(f"{path}: turn of {name}", row["turn"])
        rows[name] = row
    return rows
