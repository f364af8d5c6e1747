"""Where the figures are: the mask of a photo, and one coverage map per person in it."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import distance_transform_edt, label

from relight.files import UserError
from relight.photos import selfie, u2net
from relight.photos.frame import SOLID
from relight.photos.read import Photo, read_mask

if TYPE_CHECKING:
    from relight.photos.infer import Figure

LEAST = 8  # pixels: a figure smaller than this in both directions is dirt
# Of a figure's height: a head is at least so wide and so high, a raised arm is thinner.
HEAD_WIDTH, HEAD_HEIGHT = 0.085, 0.06
AUTOMATIC = (
    "the mask is automatic, and misses hands, hats and bags at times: `relight mask draw` writes it for correction"
)
SIDES = {"upper": np.s_[0], "lower": np.s_[-1], "left": np.s_[:, 0], "right": np.s_[:, -1]}


def mask_of(photo: Photo, path: Path | str | None = None, model: Path | str | None = None) -> np.ndarray:
    """Coverage (H,W) uint8 of a photo: the mask file, else the photo's alpha, else an automatic mask.

    model: an ONNX segmentation model of rembg's kind, for the automatic mask instead of `automatic_model`'s choice.
    Raises UserError.
    """
    if path is not None:
        mask = read_mask(path, photo.pixels.shape[:2])
        if (mask >= SOLID).all():
            raise UserError(f"mask {path} covers the whole photo: it must be white on the person and black elsewhere")
        if not (mask >= SOLID).any():
            raise UserError(f"mask {path} is empty: no pixel of it is at least half white")
        if _is_the_photo(mask, photo.pixels):
            raise UserError(f"mask {path} is the photo itself: it must be white on the person and black elsewhere")
        return mask
    if photo.alpha is not None:
        if not (photo.alpha >= SOLID).any():
            raise UserError(f"photo {photo.name} has an alpha channel without any opaque pixel: nobody to relight")
        return photo.alpha
    return automatic(photo, model)


def automatic(photo: Photo, model: Path | str | None = None) -> np.ndarray:
    """Coverage (H,W) uint8 by the network that `automatic_model` names. Raises UserError."""
    path = automatic_model(model)
    if path is None:
        raise UserError(
            f"photo {photo.name} has no mask: for automatic masks run `relight mask setup` once; or give --mask FILE "
            "(white on the person) or a PNG with an alpha channel"
        )
    built_in = path == selfie.network_file()
    mask = selfie.coverage(photo.pixels) if built_in else u2net.coverage(photo.pixels, path)
    if not (mask >= SOLID).any() or (mask >= SOLID).all():
        raise UserError(
            f"the automatic mask found nobody in {photo.name}: give --mask FILE (white on the person) or a PNG with an "
            "alpha channel"
        )
    return mask


def automatic_model(model: Path | str | None = None) -> Path | None:
    """The network of automatic masks: `model`, else the built-in one where it is set up, else rembg's where fetched."""
    if model is not None:
        return Path(model)
    return selfie.network_file() if selfie.network_file().is_file() else u2net.fetched_model()


def people(coverage: np.ndarray, share: float = 0.05) -> list[np.ndarray]:
    """Splits coverage (H,W) uint8 into one such map per person, from left to right.

    A person is a connected solid part with at least `share` of the largest one's area; smaller parts (a hand
    behind a lamp post, a buckle) and soft edges go to the nearest person, so the parts' sum is the whole.
    """
    solid = coverage >= SOLID
    labels, count = label(solid, np.ones((3, 3)))
    areas = np.bincount(labels.ravel(), minlength=count + 1)
    areas[0] = 0
    whom = [i for i in np.flatnonzero(areas >= share * areas.max()) if i and _large_enough(labels == i)]
    if not whom:
        raise UserError(f"the mask holds no figure of at least {LEAST} pixels")
    if len(whom) == 1:
        return [coverage]
    nearest = distance_transform_edt(~np.isin(labels, whom), return_distances=False, return_indices=True)
    owner = labels[tuple(nearest)]
    whom.sort(key=lambda i: np.flatnonzero((labels == i).any(0)).mean())
    return [np.where(owner == i, coverage, np.uint8(0)) for i in whom]


def doubts(figures: Sequence["Figure"]) -> list[str]:
    """Sentences about masks that look wrong: inverted, a rectangle, several people in one, cut by the photo's edge."""
    whole = np.maximum.reduce([figure.coverage for figure in figures]) >= SOLID
    edges = np.concatenate([whole[side] for side in SIDES.values()])
    if edges.mean() > 0.6 and whole[0].mean() > 0.5:
        return ["the mask may be inverted, for it is white along the photo's edges: it must be white on the person"]
    says = []
    for number, figure in enumerate(figures, 1):
        who = "the figure" if len(figures) == 1 else f"person {number}"
        rows, columns = (np.flatnonzero((figure.coverage >= SOLID).any(axis)) for axis in (1, 0))
        solid = figure.coverage[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] >= SOLID
        if solid.mean() > 0.98:
            says.append(f"the mask of {who} is a rectangle: people are relit well only within their outlines")
        elif heads(solid) > 1:
            says.append(f"the mask of {who} may hold several people who touch: part them by a black line in --mask")
        cut = [name for name, side in SIDES.items() if (figure.coverage[side] >= SOLID).sum() > 0.1 * min(solid.shape)]
        if cut:
            says.append(
                f"{who} is cut by the photo's {' and '.join(cut)} edge{'s' * (len(cut) > 1)}: "
                "whole figures are inferred best"
            )
    return says


def heads(solid: np.ndarray) -> int:
    """How many parts of a figure (H,W) bool, cut to its box, stand beside each other in its upper quarter as heads do.

    Those are runs of at least HEAD_WIDTH in a row, which go on for HEAD_HEIGHT.
    """
    height = len(solid)
    wide, high = max(int(HEAD_WIDTH * height), 3), max(int(HEAD_HEIGHT * height), 3)
    upper = np.pad(solid[: height // 4], ((0, 0), (1, 1))).astype(np.int8)
    most = lasting = 0
    for row in np.diff(upper, axis=1):
        runs = np.flatnonzero(row == -1) - np.flatnonzero(row == 1)
        count = int((runs >= wide).sum())
        lasting = lasting + 1 if count > 1 else 0
        most = max(most, count) if lasting >= high else most
    return max(most, 1)


def _is_the_photo(mask: np.ndarray, pixels: np.ndarray) -> bool:
    """Whether a mask is mostly grey and goes with the photo's brightness."""
    part = np.s_[:: max(len(mask) // 256, 1), :: max(mask.shape[1] // 256, 1)]
    mask, grey = mask[part].astype(np.float64), pixels[part].astype(np.float64) @ [0.299, 0.587, 0.114]
    if ((mask > 15) & (mask < 240)).mean() < 0.2 or mask.std() < 1 or grey.std() < 1:
        return False
    return abs(np.corrcoef(mask.ravel(), grey.ravel())[0, 1]) > 0.98


def _large_enough(mask: np.ndarray) -> bool:
    return max(mask.any(1).sum(), mask.any(0).sum()) >= LEAST
