"""Paints waistbands, pockets, plackets and buttons into the albedo of the panels."""

from dataclasses import dataclass

import numpy as np

from relight.figures.tailor.garments import Garment

STITCH = 0.0011  # half the width of a line of stitches, metres
WAISTBAND = 0.035  # metres of the waistband of trousers
WAISTBAND_STITCHES = 0.033  # metres from its upper edge to its stitches
DENIM_THREAD = (0.36, 0.20, 0.07)  # linear albedo, as the following
PALE_BUTTON, GREY_BUTTON = (0.6, 0.57, 0.5), (0.35, 0.33, 0.3)  # on dark and on pale cloth
ZIP = (0.30, 0.29, 0.27)


def line(distance: np.ndarray) -> np.ndarray:
    """Returns the coverage of a line of stitches at `distance` metres from it, in [0,1]."""
    return np.clip(1.5 - np.abs(distance) / STITCH, 0, 1)


def stitched(
    garment: Garment, kind: str, name: str, u: np.ndarray, v: np.ndarray, top: float, color: np.ndarray
) -> np.ndarray:
    """Adds sewn details to the albedo of a panel.

    Args:
        garment: garment to which the panel belongs.
        kind: kind of fabric.
        name: name of the panel.
        u: (...) cloth coordinate across, metres.
        v: (...) cloth coordinate along, metres, 0 at the crotch.
        top: v of the panel's upper end.
        color: (...,3) linear albedo.

    Returns:
        (...,3) linear albedo.
    """
    thread = np.array(DENIM_THREAD) if kind == "denim" else color * 0.6
    sewing = Sewing(color, dark=color * 0.55, thread=thread)
    if garment.kind == "trousers":
        _sew_trousers(sewing, kind, name, u, top - v)
    if name == "front":
        if garment.kind == "top":
            _sew_buttons(sewing, garment, u, v, top)
        if garment.kind == "top" and garment.collar == "fold" and garment.front == "none":
            pocket = np.maximum(np.abs(u - 0.085) - 0.05, np.abs(v - 0.36) - 0.058)  # on the chest of a shirt
            sewing.draw(0.7 * line(pocket) * (garment.sleeve_end > 0.6), sewing.dark)
        if garment.front == "zip":
            sewing.draw(0.8 * (np.abs(u) < 0.004) * (np.mod(v, 0.004) < 0.002), np.array(ZIP))
        if garment.kind == "top" and garment.collar == "hood":
            slant = 0.5 * np.clip(v - 0.19, 0, 1)  # the sides of a hoodie's pocket, narrower at the top
            pocket = np.maximum(np.abs(u) - 0.15 + slant, np.abs(v - 0.18) - 0.085)
            sewing.draw(0.7 * line(pocket), sewing.dark)
    return sewing.color


@dataclass
class Sewing:
    """The albedo of a panel, on which sewn details are drawn one after the other. Shapes are given by signed distances.

    Attributes:
        color: (...,3) linear albedo.
        dark: (...,3) of seams and of dark buttons.
        thread: (...,3) or (3,) of stitches.
    """

    color: np.ndarray
    dark: np.ndarray
    thread: np.ndarray

    def draw(self, share: np.ndarray, color: np.ndarray) -> None:
        """Mixes a share (...) of a color (...,3) or (3,) into the albedo."""
        self.color = self.color + (color - self.color) * np.clip(share, 0, 1)[..., None]


def _sew_trousers(sewing: Sewing, kind: str, name: str, u: np.ndarray, below: np.ndarray) -> None:
    """Draws the waistband of trousers, pockets at the front, and on denim pockets at the back.

    `u` (...) is across the panel, and `below` (...) from its upper end, metres.
    """
    outward = u * (1 if name.endswith("left") else -1)
    sewing.draw(line(below - WAISTBAND) * 0.8, sewing.dark)
    sewing.draw(line(below - WAISTBAND_STITCHES) * (np.mod(u, 0.005) < 0.0035), sewing.thread)  # stitches of 3.5 mm
    if name.startswith("front"):
        pocket = np.hypot((outward - 0.14) / 0.09, (below - WAISTBAND) / 0.075) - 1  # an arc of an ellipse
        on_arc = (below > WAISTBAND) * (outward < 0.13)
        sewing.draw(line(pocket * 0.08) * on_arc, sewing.dark)
        sewing.draw(line(pocket * 0.08 + 0.005) * on_arc, sewing.thread)
    elif kind == "denim":
        x, y = np.abs(outward - 0.015), below - 0.17  # from the middle of the pocket
        point = y - 0.07 + 0.25 * np.clip(0.062 - x, -1, 1) - 0.0155  # its lower end is pointed
        edge = np.maximum(x - 0.062, np.maximum(-y - 0.07, point))
        sewing.draw(line(edge), sewing.dark)
        sewing.draw(line(edge + 0.004), sewing.thread)


def _sew_buttons(sewing: Sewing, garment: Garment, u: np.ndarray, v: np.ndarray, top: float) -> None:
    """Draws the buttons of a closed front, if it has some; `top` is v of the panel's upper end."""
    is_shirt = garment.collar == "fold" and garment.front == "none"
    if garment.front not in ("buttons", "double", "placket") and not is_shirt:
        return
    if is_shirt:
        sewing.draw(0.7 * line(np.abs(u) - 0.016), sewing.dark)  # the edges of its placket
    has_buttons = v > top - 0.16 if garment.front == "placket" else np.ones(v.shape, bool)
    apart = 0.060 if garment.front == "double" else 0.0  # metres; the two rows are 1.4 times this apart
    radius, step = (0.0052, 0.085) if garment.collar == "fold" else (0.010, 0.12)  # metres, from one to the next
    button = np.hypot(np.abs(u - 0.5 * apart) - 0.7 * apart, np.mod(v, step) - 0.04) - radius
    pale = np.array(PALE_BUTTON if sewing.color.mean() < 0.3 else GREY_BUTTON)
    sewing.draw(np.clip(0.5 - button / 0.001, 0, 1) * has_buttons, pale if radius < 0.01 else sewing.dark)
