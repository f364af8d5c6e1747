"""Paints waistbands, pockets, plackets and buttons into the albedo of the panels."""

import numpy as np

from relight.figures.tailor.garments import Garment

STITCH = 0.0011  # half the width of a line of stitches, metres


def line(distance: np.ndarray) -> np.ndarray:
    """Returns the coverage of a line of stitches at `distance` metres from it, in [0,1]."""
    return np.clip(1.5 - np.abs(distance) / STITCH, 0, 1)


def stitched(
    garment: Garment, kind: str, name: str, u: np.ndarray, v: np.ndarray, top: float, color: np.ndarray
) -> np.ndarray:
    """Adds sewn details to the albedo of a panel.

    Args:
        garment: of the panel.
        kind: of fabric.
        name: of the panel.
        u: (...) cloth coordinate across, metres.
        v: (...) cloth coordinate along, metres, 0 at the crotch.
        top: v of the panel's upper end.
        color: (...,3) linear albedo.

    Returns:
        (...,3) linear albedo.
    """
    dark, thread = color * 0.55, color * 0.6
    if kind == "denim":
        thread = np.broadcast_to(np.array([0.36, 0.20, 0.07]), color.shape)

    def draw(share: np.ndarray, goal: np.ndarray) -> None:
        nonlocal color
        color = color + (goal - color) * np.clip(share, 0, 1)[..., None]

    if garment.kind == "trousers":
        sign = 1 if name.endswith("left") else -1
        out = u * sign
        below = top - v
        draw(line(below - 0.035) * 0.8, dark)
        draw(line(below - 0.033) * (np.mod(u, 0.005) < 0.0035), thread)
        if name.startswith("front"):
            pocket = np.hypot((out - 0.14) / 0.09, (below - 0.035) / 0.075) - 1
            draw(line(pocket * 0.08) * (below > 0.035) * (out < 0.13), dark)
            draw(line(pocket * 0.08 + 0.005) * (below > 0.035) * (out < 0.13), thread)
        elif kind == "denim":
            x, y = np.abs(out - 0.015), below - 0.17
            edge = np.maximum(x - 0.062, np.maximum(-y - 0.07, y - 0.07 + 0.25 * np.clip(0.062 - x, -1, 1) - 0.0155))
            draw(line(edge), dark)
            draw(line(edge + 0.004), thread)
    buttoned = garment.front in ("buttons", "double", "placket") or (
        garment.collar == "fold" and garment.front == "none"
    )
    if garment.kind == "top" and buttoned and name == "front":
        reach = v > top - 0.16 if garment.front == "placket" else np.ones(v.shape, bool)
        apart = 0.060 if garment.front == "double" else 0.0  # of two rows of buttons from their middle
        middle = 0.5 * apart
        if garment.front == "none":
            draw(0.7 * line(np.abs(u) - 0.016), dark)
        size, step = (0.0052, 0.085) if garment.collar == "fold" else (0.010, 0.12)
        button = np.hypot(np.abs(u - middle) - 0.7 * apart, np.mod(v, step) - 0.04) - size
        pale = np.broadcast_to(
            np.array([0.6, 0.57, 0.5]) if color.mean() < 0.3 else np.array([0.35, 0.33, 0.3]), color.shape
        )
        draw(np.clip(0.5 - button / 0.001, 0, 1) * reach, pale if size < 0.01 else dark)
    if garment.kind == "top" and garment.collar == "fold" and garment.front == "none" and name == "front":
        pocket = np.maximum(np.abs(u - 0.085) - 0.05, np.abs(v - 0.36) - 0.058)
        draw(0.7 * line(pocket) * (garment.sleeve_end > 0.6), dark)
    if garment.front == "zip" and name == "front":
        draw(
            0.8 * (np.abs(u) < 0.004) * (np.mod(v, 0.004) < 0.002),
            np.broadcast_to(np.array([0.30, 0.29, 0.27]), color.shape),
        )
    if garment.kind == "top" and garment.collar == "hood" and name == "front":
        pocket = np.maximum(np.abs(u) - 0.15 + 0.5 * np.clip(v - 0.19, 0, 1), np.abs(v - 0.18) - 0.085)
        draw(0.7 * line(pocket), dark)
    return color
