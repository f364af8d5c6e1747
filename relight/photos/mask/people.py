"""The people of a mask: one coverage map for each, and warnings about masks that look wrong."""

from collections.abc import Sequence

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, label, maximum_filter, minimum_filter, uniform_filter

from relight.core.errors import UserError
from relight.maps.square import MASK_THRESHOLD, extent
from relight.photos.mask.pose import KNOWN, LIMBS, Body

MIN_SIZE = 8  # rows or columns; a person with pixels in fewer of both is dirt
MIN_SHARE = 0.05  # least area of a person whom no network found, over that of the largest part
LOOK = 256  # pixels of a person's longer side at which doubts are looked for
SLACK = 0.015  # of it: how far a joint may be outside, and half the thickness of what networks may disagree about
SURE = 0.8  # that a joint is seen
APART = 0.03  # least share of a mask about which they disagree
FAINT, BESIDE = 0.2, 0.01  # least value of a body's mask, and share of it, that make what their mask lacks doubtful
KNOWN_AS, UNCLEAR = 0.7, 0.6  # least score of a person; most pixels of .1 to .9 over those of the person, in their mask
SEAM = 0.015  # of the people's longer side: half the width of what people who touch share
BRIDGE = 5  # pixels: what hangs by less on the body is apart from it
SPECK = 0.002  # least share of a mask that is apart from the body, for a doubt
HEAD_WIDTH, HEAD_HEIGHT = 0.085, 0.06  # least, of a person's height; a raised arm is thinner
SIDES: dict[str, tuple[int | slice, ...]] = {
    "upper": np.s_[0, :], "lower": np.s_[-1, :], "left": np.s_[:, 0], "right": np.s_[:, -1]
}  # fmt: skip


class NobodyFound(UserError):
    """A picture shows nobody, or its mask says so."""


def split_people(coverage: np.ndarray, bodies: Sequence[Body] = ()) -> list[tuple[np.ndarray, Body | None]]:
    """Splits the mask of a photo into one for each person.

    A person is what the mask of one of `bodies` covers, or a connected part that none of these masks touches, with at
    least MIN_SHARE of the largest one's area. Smaller parts (a hand behind a lamp post, a buckle) and soft edges go to
    the nearest person. Where masks of bodies touch, one passes into the other. The sum of all parts is the whole.

    Args:
        coverage: (H,W) uint8.
        bodies: the people whom networks found.

    Returns:
        Coverage maps (H,W) uint8 with their bodies, from left to right.

    Raises:
        NobodyFound: if no part has MIN_SIZE.
    """
    solid = coverage >= MASK_THRESHOLD
    labels, count = label(solid, np.ones((3, 3)))
    least = np.full(coverage.shape, 0.5, np.float32)
    owners = np.zeros_like(labels)
    for number, body in enumerate(bodies, 1):
        seen = body.mask(coverage.shape[::-1])
        np.copyto(owners, number, where=(seen > least) & solid)
        np.maximum(least, seen, out=least)
    known, whole = (np.bincount(labels[part], minlength=count + 1) for part in (owners > 0, solid))
    touched = (known > KNOWN * whole)[labels]
    labels = np.where(touched, owners + count * (owners > 0), labels)
    count += len(bodies)
    areas = np.bincount(labels[solid], minlength=count + 1)
    areas[0] = 0
    large = [
        i
        for i in np.flatnonzero(areas >= MIN_SHARE * areas.max())
        if i and max((labels == i).any(axis).sum() for axis in (0, 1)) >= MIN_SIZE
    ]
    if not large:
        raise NobodyFound(f"the mask holds no figure of at least {MIN_SIZE} pixels")
    body_of = {count - len(bodies) + number: body for number, body in enumerate(bodies, 1)}
    if len(large) == 1:
        return [(coverage, body_of.get(int(large[0])))]
    labels *= np.isin(np.arange(count + 1), large)[labels]
    apart = (labels == 0) & (coverage > 0)
    nearest = distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
    labels[apart] = labels[tuple(nearest[:, apart])]
    large.sort(key=lambda i: np.flatnonzero((labels == i).any(0)).mean())
    shares = np.stack([labels == i for i in large]).astype(np.float32)
    if bodies:  # a seam may cross somebody, so lights pass into each other
        side = 2 * round(SEAM * max(last - first for first, last in extent(solid))) + 1
        shares = np.stack([uniform_filter(share, side, mode="nearest") for share in shares])
    ends = np.cumsum(shares, 0)
    ends = np.rint(ends / np.maximum(ends[-1], 1e-6) * coverage).astype(np.uint8)
    return list(zip(np.diff(ends, axis=0, prepend=np.uint8(0)), (body_of.get(int(i)) for i in large)))


def mask_warnings(coverages: Sequence[np.ndarray], bodies: Sequence[Body | None] = ()) -> list[str]:
    """Returns sentences about masks that look wrong: inverted, rectangular, several people in one, cut by the edge.

    Args:
        coverages: (H,W) uint8 of each person.
        bodies: what networks found of each: somebody who is known is one person.
    """
    if is_inverted(np.maximum.reduce(coverages) >= MASK_THRESHOLD):
        return ["the mask may be inverted, for it is white along the photo's edges: it must be white on the person"]
    warnings = []
    for number, (coverage, body) in enumerate(zip(coverages, bodies or [None] * len(coverages)), 1):
        who = "the figure" if len(coverages) == 1 else f"person {number}"
        rows, columns = extent(coverage >= MASK_THRESHOLD)
        solid = coverage[slice(*rows), slice(*columns)] >= MASK_THRESHOLD
        if solid.mean() > 0.98:
            warnings.append(f"the mask of {who} is a rectangle: people are relit well only within their outlines")
        elif body is None and count_heads(solid) > 1:
            warnings.append(f"the mask of {who} may hold several people who touch: part them by a black line in --mask")
        least = 0.1 * min(solid.shape)
        if cut := [name for name, side in SIDES.items() if (coverage[side] >= MASK_THRESHOLD).sum() > least]:
            edges = " and ".join(filter(None, [", ".join(cut[:-1]), f"{cut[-1]} edge{'s' * (len(cut) > 1)}"]))
            warnings.append(f"{who} is cut by the photo's {edges}: whole figures are inferred best")
    return warnings


def mask_doubts(coverage: np.ndarray, bodies: Sequence[Body]) -> list[str]:
    """Returns why the automatic mask of a photo may be wrong, as sentences; none if all is well.

    Args:
        coverage: (H,W) uint8.
        bodies: the people whom networks found.
    """
    parts = split_people(coverage, bodies)
    return [
        f"{f'person {number}: ' if len(parts) > 1 else ''}{doubt}"
        for number, part in enumerate(parts, 1)
        for doubt in _doubts(*part, coverage, bodies)
    ]


def _doubts(own: np.ndarray, body: Body | None, coverage: np.ndarray, bodies: Sequence[Body]) -> list[str]:
    """Doubts about one person's `own` mask of the whole `coverage`; what a neighbour has is no doubt about them."""
    if body is None:
        return ["no joints were found in this part of the mask: it may be a thing, or background"]
    doubts = ["hardly recognized as a person: the mask may be wrong"] * (body.score < KNOWN_AS)
    if ((body.seen > 0.1) & (body.seen < 0.9)).sum() > UNCLEAR * (body.seen > 0.5).sum():
        doubts.append("the outline is unclear: background may be in the mask")
    rows, columns = extent(own >= MASK_THRESHOLD)
    shape, box = np.array(coverage.shape), np.s_[slice(*rows), slice(*columns)]
    scale = min(LOOK / max(own[box].shape), 1)
    size = max(round(own[box].shape[1] * scale), 1), max(round(own[box].shape[0] * scale), 1)
    solid, whole = (
        np.asarray(Image.fromarray(mask[box]).resize(size, Image.Resampling.BOX)) >= MASK_THRESHOLD
        for mask in (own, coverage)
    )
    slack = max(round(SLACK * max(size)), 1)
    known = np.pad(maximum_filter(np.pad(whole, slack), 2 * slack + 1), 1)
    limbs = body.limbs()
    shown = limbs[:, 2] > SURE
    places = ((limbs[:, 1::-1] * shape - [rows[0], columns[0]]) * scale).astype(int) + slack + 1
    lost = shown & ~known[tuple(places.clip(0, np.array(known.shape) - 1).T)]
    doubts += [f"the {name} is not in the mask" for name, absent in zip(LIMBS, lost) if absent]
    sides = [columns[0] / shape[1], rows[0] / shape[0], columns[1] / shape[1], rows[1] / shape[0]]
    other, anybody = body.mask(size, sides) > 0.5, np.maximum.reduce([each.mask(size, sides) for each in bodies]) > 0.5
    apart = _thick((solid & ~anybody) | (other & ~whole), 2 * slack + 1)
    if apart.sum() > APART * solid.sum():
        doubts.append(f"the networks disagree about the mask, mostly at the {_place(apart)}")
    elif (beside := _beside(body, coverage, scale, slack + 2)).sum() > BESIDE * solid.sum():
        doubts.append(f"what is not in the mask at the {_place(beside)} may belong to them, as what they hold does")
    parts, _ = label(minimum_filter(solid, BRIDGE))
    alone = maximum_filter((parts > 0) & ~np.isin(parts, parts[anybody]), BRIDGE)
    if alone.sum() > SPECK * solid.sum():
        doubts.append(f"a part apart from the body, at the {_place(alone)}, may be a thing, or background")
    return doubts


def _beside(body: Body, coverage: np.ndarray, scale: float, side: int) -> np.ndarray:
    """Returns where a body's mask is at least faint and nobody is covered, in its box (h,w) bool: thick parts."""
    x, y = np.nonzero(body.seen.T > FAINT)
    ends = (body.square @ [x, y, np.ones(len(x))]).clip(0, 1)
    left, upper, right, lower = part = [*ends.min(1, initial=1), *ends.max(1, initial=0)]
    height, width = coverage.shape
    size = max(round((right - left) * width * scale), 1), max(round((lower - upper) * height * scale), 1)
    box = left * width, upper * height, right * width, lower * height
    known = np.asarray(Image.fromarray(coverage).resize(size, Image.Resampling.BOX, box)) >= MASK_THRESHOLD
    return _thick((body.mask(size, part) > FAINT) & ~maximum_filter(known, side), side)


def _thick(mask: np.ndarray, side: int) -> np.ndarray:
    """Returns the parts of a mask (h,w) bool that hold a square of `side` pixels."""
    return maximum_filter(minimum_filter(mask, side), side)


def _place(mask: np.ndarray) -> str:
    """Returns in words where most of a mask (h,w) bool is."""
    y, x = np.argwhere(mask).mean(0) / mask.shape
    return f"{'upper' if y < 0.5 else 'lower'} {'left' if x < 0.5 else 'right'}"


def is_inverted(solid: np.ndarray) -> bool:
    """Returns whether a mask (H,W) bool is true along the top, and along most edges or more than in the middle."""
    edges = np.concatenate([solid[side] for side in SIDES.values()])
    middle = solid[tuple(slice(side // 3, side - side // 3) for side in solid.shape)]
    return bool(solid[0].mean() > 0.5 and edges.mean() > min(0.6, middle.mean()))


def count_heads(solid: np.ndarray) -> int:
    """Counts the parts of a mask's upper third that a horizontal line parts, as heads do, also at unequal heights.

    Such a part is HEAD_WIDTH wide over HEAD_HEIGHT.

    Args:
        solid: (H,W) bool, cut to its box.
    """
    step = max(len(solid) // 256, 1)
    solid = solid[::step, ::step]
    height, most = len(solid), 1
    width, rows = max(HEAD_WIDTH * height, 3), max(HEAD_HEIGHT * height, 3)
    for line in np.linspace(0.1, 0.35, 8):
        parts, count = label(solid[: round(line * height)])
        most = max(most, sum(((parts == part).sum(1) >= width).sum() >= rows for part in range(1, count + 1)))
    return int(most)
