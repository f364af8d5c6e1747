"""Paints waistbands, pockets, plackets and buttons into the albedo of the panels."""

import numpy as np

from relight.figures.dye.aging import DENIM_THREAD, ZIP, Patch, line

WAISTBAND = 0.035  # metres of the waistband of trousers
WAISTBAND_STITCHES = 0.033  # metres from its upper edge to its stitches
PALE_BUTTON, GREY_BUTTON = (0.6, 0.57, 0.5), (0.35, 0.33, 0.3)  # linear albedo, on dark and on pale cloth


def stitch(patch: Patch, top: float) -> None:
    """Adds sewn details to the albedo of a panel. Shapes are given by signed distances.

    Args:
        patch: the panel, not yet aged; it is changed.
        top: v of the panel's upper end.
    """
    garment, u, v = patch.garment, patch.u, patch.v
    dark = patch.color * 0.55  # of seams and of dark buttons
    if garment.kind == "trousers":
        _sew_trousers(patch, top - v, dark)
    if patch.panel == "front":
        if garment.kind == "top":
            _sew_buttons(patch, top, dark)
        if garment.kind == "top" and garment.collar == "fold" and garment.front == "none":
            pocket = np.maximum(np.abs(u - 0.085) - 0.05, np.abs(v - 0.36) - 0.058)  # on the chest of a shirt
            patch.paint(dark, 0.7 * line(pocket) * (garment.sleeve_end > 0.6))
        if garment.front == "zip":
            patch.paint(np.array(ZIP), 0.8 * (np.abs(u) < 0.004) * (np.mod(v, 0.004) < 0.002))
        if garment.kind == "top" and garment.collar == "hood":
            slant = 0.5 * np.clip(v - 0.19, 0, 1)  # the sides of a hoodie's pocket, narrower at the top
            pocket = np.maximum(np.abs(u) - 0.15 + slant, np.abs(v - 0.18) - 0.085)
            patch.paint(dark, 0.7 * line(pocket))


def _sew_trousers(patch: Patch, below: np.ndarray, dark: np.ndarray) -> None:
    """Draws the waistband of trousers, pockets at the front, and on denim pockets at the back.

    `below` (...) is the distance from the panel's upper end, metres, and `dark` (...,3) the albedo of seams.
    """
    u, name, is_denim = patch.u, patch.panel, patch.fabric.kind == "denim"
    thread = np.array(DENIM_THREAD) if is_denim else patch.color * 0.6
    outward = u * (1 if name.endswith("left") else -1)
    patch.paint(dark, line(below - WAISTBAND) * 0.8)
    patch.paint(thread, line(below - WAISTBAND_STITCHES) * (np.mod(u, 0.005) < 0.0035))  # stitches of 3.5 mm
    if name.startswith("front"):
        pocket = np.hypot((outward - 0.14) / 0.09, (below - WAISTBAND) / 0.075) - 1  # an arc of an ellipse
        on_arc = (below > WAISTBAND) * (outward < 0.13)
        patch.paint(dark, line(pocket * 0.08) * on_arc)
        patch.paint(thread, line(pocket * 0.08 + 0.005) * on_arc)
    elif is_denim:
        x, y = np.abs(outward - 0.015), below - 0.17  # from the middle of the pocket
        point = y - 0.07 + 0.25 * np.clip(0.062 - x, -1, 1) - 0.0155  # its lower end is pointed
        edge = np.maximum(x - 0.062, np.maximum(-y - 0.07, point))
        patch.paint(dark, line(edge))
        patch.paint(thread, line(edge + 0.004))


def _sew_buttons(patch: Patch, top: float, dark: np.ndarray) -> None:
    """Draws the buttons of a closed front, if it has some.

    `top` is v of the panel's upper end, and `dark` (...,3) the albedo of seams and of large buttons.
    """
    garment, u, v = patch.garment, patch.u, patch.v
    is_shirt = garment.collar == "fold" and garment.front == "none"
    if garment.front not in ("buttons", "double", "placket") and not is_shirt:
        return
    if is_shirt:
        patch.paint(dark, 0.7 * line(np.abs(u) - 0.016))  # the edges of its placket
    has_buttons = v > top - 0.16 if garment.front == "placket" else np.ones(v.shape, bool)
    apart = 0.060 if garment.front == "double" else 0.0  # metres; the two rows are 1.4 times this apart
    radius, step = (0.0052, 0.085) if garment.collar == "fold" else (0.010, 0.12)  # metres, from one to the next
    button = np.hypot(np.abs(u - 0.5 * apart) - 0.7 * apart, np.mod(v, step) - 0.04) - radius
    pale = np.array(PALE_BUTTON if patch.color.mean() < 0.3 else GREY_BUTTON)
    patch.paint(pale if radius < 0.01 else dark, np.clip(0.5 - button / 0.001, 0, 1) * has_buttons)
