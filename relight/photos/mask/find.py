"""Masks: where the people of a photo are, one coverage map for each, and warnings about masks that look wrong."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import distance_transform_edt, label

from relight.errors import UserError
from relight.maps.square import MASK_THRESHOLD, extent
from relight.photos.mask import selfie, u2net
from relight.photos.mask.edge import fit_edge
from relight.photos.read import Photo, read_mask

if TYPE_CHECKING:
    from relight.photos.person import Person

MIN_SIZE = 8  # pixels; a person smaller than this in both directions is dirt
HEAD_WIDTH, HEAD_HEIGHT = 0.085, 0.06  # least, of a person's height; a raised arm is thinner
AUTOMATIC = (
    "the mask is automatic: at times it misses hands and hats, takes in what is behind, or takes a thing for a person; "
    "`relight mask draw` writes it for correction"
)
BY_HAND = "draw a mask, white on the person (me_mask.png beside me.jpg), or give a PNG with an alpha channel"
SIDES: dict[str, tuple[int | slice, ...]] = {
    "upper": np.s_[0, :], "lower": np.s_[-1, :], "left": np.s_[:, 0], "right": np.s_[:, -1]
}  # fmt: skip


class NoMaskNetwork(UserError):
    """A photo needs an automatic mask, and no network for it has been set up."""


def find_mask(photo: Photo, path: Path | str | None = None, model: Path | str | None = None) -> np.ndarray:
    """Finds the mask of a photo: the file, else the photo's alpha, else an automatic mask.

    Args:
        photo: as read; gets notes where the file of the mask can mean two things.
        path: of the mask.
        model: an ONNX segmentation model of rembg's kind for automatic masks, instead of `automatic_model`'s choice.

    Returns:
        Coverage (H,W) uint8.

    Raises:
        UserError: if there is no mask, or it is empty, covers everything, or is the photo itself.
    """
    if path is not None:
        mask = read_mask(path, photo.pixels.shape[:2], photo.notes)
        if (mask >= MASK_THRESHOLD).all():
            raise UserError(f"mask {path} covers the whole photo: it must be white on the person and black elsewhere")
        if not (mask >= MASK_THRESHOLD).any():
            raise UserError(f"mask {path} is empty: no pixel of it is at least half white")
        if _is_the_photo(mask, photo.codes):
            raise UserError(f"mask {path} is the photo itself: it must be white on the person and black elsewhere")
        return mask
    if photo.alpha is not None:
        if not (photo.alpha >= MASK_THRESHOLD).any():
            raise UserError(f"{photo.what} has an alpha channel without any opaque pixel: nobody to relight")
        return photo.alpha
    return automatic_mask(photo, model)


def automatic_mask(photo: Photo, model: Path | str | None = None) -> np.ndarray:
    """Segments the people of a photo with the network that `automatic_model` chooses.

    Args:
        photo: as read.
        model: an ONNX segmentation model of rembg's kind; None for the one that is installed.

    Returns:
        Coverage (H,W) uint8, its edge fitted to the photo.

    Raises:
        UserError: if there is no such network (NoMaskNetwork), or it finds nobody.
    """
    path = automatic_model(model)
    if path is None:
        raise NoMaskNetwork(
            f"{photo.what} has no mask: for automatic masks run `relight mask setup` once; or {BY_HAND}"
        )
    built_in = path == selfie.network_file()
    mask = selfie.segment(photo.codes) if built_in else u2net.segment(photo.codes, path)
    if not (mask >= MASK_THRESHOLD).any() or (mask >= MASK_THRESHOLD).all():
        raise UserError(f"the automatic mask found nobody in {photo.what}: {BY_HAND}")
    return fit_edge(photo.pixels, mask, automatic=True)


def automatic_model(model: Path | str | None = None) -> Path | None:
    """Chooses the network for automatic masks: `model`, else the built-in one where it is set up, else rembg's."""
    if model is not None:
        return Path(model)
    return selfie.network_file() if selfie.network_file().is_file() else u2net.fetched_model()


def split_people(coverage: np.ndarray, share: float = 0.05) -> list[np.ndarray]:
    """Splits the mask of a photo into one for each person.

    A person is a connected part with at least `share` of the largest one's area. Smaller parts (a hand behind a lamp
    post, a buckle) and soft edges go to the nearest person, so the sum of all parts is the whole.

    Args:
        coverage: (H,W) uint8.
        share: least area of a person, over that of the largest part.

    Returns:
        Coverage maps (H,W) uint8, from left to right.

    Raises:
        UserError: if no part has MIN_SIZE.
    """
    solid = coverage >= MASK_THRESHOLD
    labels, count = label(solid, np.ones((3, 3)))
    areas = np.bincount(labels.ravel(), minlength=count + 1)
    areas[0] = 0
    large = [i for i in np.flatnonzero(areas >= share * areas.max()) if i and _has_min_size(labels == i)]
    if not large:
        raise UserError(f"the mask holds no figure of at least {MIN_SIZE} pixels")
    if len(large) == 1:
        return [coverage]
    nearest = distance_transform_edt(~np.isin(labels, large), return_distances=False, return_indices=True)
    owner = labels[tuple(nearest)]
    large.sort(key=lambda i: np.flatnonzero((labels == i).any(0)).mean())
    return [np.where(owner == i, coverage, np.uint8(0)) for i in large]


def mask_warnings(people: Sequence["Person"]) -> list[str]:
    """Returns sentences about masks that look wrong: inverted, rectangular, several people in one, cut by the edge."""
    whole = np.maximum.reduce([person.coverage for person in people]) >= MASK_THRESHOLD
    edges = np.concatenate([whole[side] for side in SIDES.values()])
    if edges.mean() > 0.6 and whole[0].mean() > 0.5:
        return ["the mask may be inverted, for it is white along the photo's edges: it must be white on the person"]
    warnings = []
    for number, person in enumerate(people, 1):
        who = "the figure" if len(people) == 1 else f"person {number}"
        rows, columns = extent(person.coverage >= MASK_THRESHOLD)
        solid = person.coverage[slice(*rows), slice(*columns)] >= MASK_THRESHOLD
        if solid.mean() > 0.98:
            warnings.append(f"the mask of {who} is a rectangle: people are relit well only within their outlines")
        elif count_heads(solid) > 1:
            warnings.append(f"the mask of {who} may hold several people who touch: part them by a black line in --mask")
        least = 0.1 * min(solid.shape)
        cut = [name for name, side in SIDES.items() if (person.coverage[side] >= MASK_THRESHOLD).sum() > least]
        if cut:
            warnings.append(
                f"{who} is cut by the photo's {_listed(cut)} edge{'s' * (len(cut) > 1)}: "
                "whole figures are inferred best"
            )
    return warnings


def _listed(words: list[str]) -> str:
    """Returns words as English lists them: a, b and c."""
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def count_heads(solid: np.ndarray) -> int:
    """Counts the parts that stand side by side in the upper quarter of a mask, as heads do.

    Such a part is HEAD_WIDTH wide in each row, over HEAD_HEIGHT.

    Args:
        solid: (H,W) bool, cut to its box.
    """
    height = len(solid)
    min_width, min_rows = max(int(HEAD_WIDTH * height), 3), max(int(HEAD_HEIGHT * height), 3)
    upper = np.pad(solid[: height // 4], ((0, 0), (1, 1))).astype(np.int8)
    most = rows = 0
    for row in np.diff(upper, axis=1):
        widths = np.flatnonzero(row == -1) - np.flatnonzero(row == 1)
        count = int((widths >= min_width).sum())
        rows = rows + 1 if count > 1 else 0
        most = max(most, count) if rows >= min_rows else most
    return max(most, 1)


def _is_the_photo(mask: np.ndarray, pixels: np.ndarray) -> bool:
    """Returns whether a mask is a grey version of the photo, saved by mistake: grey in places, and like its brightness.

    `mask` is (H,W) uint8, and `pixels` (H,W,3) are those of the photo.
    """
    part = np.s_[:: max(len(mask) // 256, 1), :: max(mask.shape[1] // 256, 1)]
    mask, grey = mask[part].astype(np.float64), pixels[part].astype(np.float64) @ [0.299, 0.587, 0.114]
    if ((mask > 15) & (mask < 240)).mean() < 0.2 or mask.std() < 1 or grey.std() < 1:
        return False
    return abs(np.corrcoef(mask.ravel(), grey.ravel())[0, 1]) > 0.98


def _has_min_size(mask: np.ndarray) -> bool:
    """Returns whether a mask has pixels in at least MIN_SIZE of its rows or of its columns."""
    return max(mask.any(1).sum(), mask.any(0).sum()) >= MIN_SIZE
