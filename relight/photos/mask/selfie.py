"""The built-in mask: by two networks of MediaPipe, and fitted to the photo's edges.

The first, selfie segmentation (256 x 256, 106,000 parameters, a MobileNetV3 with a decoder), sees all people at once,
three times. It is good at hair and at what people hold, and loses limbs. The second (relight.photos.mask.pose) sees
them one by one. Thick pieces that one of them lacks stay unless they look like the background beside them; elsewhere
the odds that both give multiply.
"""

import math

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, label, maximum_filter, minimum_filter, uniform_filter
from scipy.special import expit, logit

from relight.maps.square import extent
from relight.photos.mask.networks import SELFIE, load_network
from relight.photos.mask.pose import Body, find_bodies

SIDE = 256  # pixels that the network sees
WIDEST = 4 / 3  # width over height of what it sees at a time: people who are squeezed further are missed
PASSES = 3  # of the network: over the whole photo, then over the box of the figure found so far
MARGIN = 0.06  # around that box, as a share of the figure's height
SHARE = 0.05  # of the largest part's area: smaller parts are dropped,
NEAR = 0.01  # unless they are nearer than this share of SIDE to one that is kept
THICK = 0.009  # of a person's height: half the least thickness of pieces that are looked at
SEAM = 5  # pixels across, in which the soft edges of such pieces are taken, too
BESIDE = 0.06  # of a person's height: how far from a piece its colors are compared
SURE = 0.9  # least value of both masks on people, and of what both lack on the background, in that comparison
ALIKE, MOST = 12, 0.9  # largest distance of like colors, 8-bit codes; share of a dropped piece's that are so
LARGEST = 0.25  # of the people's area: larger pieces are not dropped, since they may be people;
UNSURE = 0.2  # of the largest person's: of smaller ones that the first network is unsure of, half the colors suffice
WEIGHT, CLEAR = 0.2, 1e-3  # of the second network's odds, and how near 0 and 1 they end
STEP = 7  # of the pixels that are compared, one in so many
DETAIL = 900  # pixels of the figure's longer side at which its edge is fitted to the photo
WINDOW = 1 / 90  # of those: radius in which the edge is fitted
SMOOTH = 1e-4  # variance of the colors under which a window counts as flat
BAND = 1 / 250  # of the figure's longer side: radius of the band along the edge in which a mask may be soft
STEEP = 1.6  # the fitted edge is that much too soft


def segment(pixels: np.ndarray) -> tuple[np.ndarray, list[Body]]:
    """Segments the people of a photo.

    Args:
        pixels: (H,W,3) uint8 sRGB.

    Returns:
        Coverage (H,W) uint8, zero everywhere when the networks find nobody; and the people whom the second one finds.

    Raises:
        UserError: if a network is damaged.
    """
    found = segment_coarsely(pixels)
    bodies = find_bodies(pixels, found)
    size = found.shape[::-1]
    boxes = [np.array(box_around(found))] if (found > 0.5).any() else []
    for body in bodies:
        if ((seen := body.mask((SIDE, SIDE))) > 0.5).any():
            boxes.append(np.ceil(np.array(box_around(seen)) * (*size, *size) / SIDE).astype(int))
    if boxes:
        box = np.concatenate([np.min(boxes, 0)[:2], np.max(boxes, 0)[2:]])
        left, upper, right, lower = box.tolist()
        window = slice(upper, lower), slice(left, right)
        scale = min(DETAIL / max(right - left, lower - upper), 1)
        detail = max(round((right - left) * scale), 1), max(round((lower - upper) * scale), 1)
        small = np.asarray(Image.fromarray(found[window]).resize(detail, Image.Resampling.BILINEAR))
        if bodies:
            masks = [body.mask(detail, box / (*size, *size)) for body in bodies]
            picture = np.asarray(Image.fromarray(pixels[window]).resize(detail, Image.Resampling.BOX))
            small = joined(small, masks, [body.limbs_in(detail, box / (*size, *size)) for body in bodies], picture)
        found[window] = fit_to_edges(pixels[window], small)
    return np.round(found * 255).astype(np.uint8), bodies


def joined(
    mask: np.ndarray, others: list[np.ndarray], limbs: list[tuple[np.ndarray, ...]], picture: np.ndarray
) -> np.ndarray:
    """Joins the mask (h,w) in [0,1] of all people with `others`, of one person each, by a picture (h,w,3) uint8.

    Thick pieces of either that look like the background are left out, unless they hold one of the person's `limbs`, of
    which rows and columns are given: gaps between limbs are no part of a person, and hair and bags are. Of those that
    only the first has, half the colors suffice if it is unsure of them.
    """
    union, added = np.maximum.reduce(others), mask
    known = minimum_filter(np.minimum(mask, union), SEAM) > SURE, np.maximum(mask, union) < 1 - SURE
    for other, own in zip(others, limbs):
        height = height_of(other)
        pieces = thick_pieces((other > 0.5) & (added <= 0.5), height)
        kept = [piece for piece in pieces if piece[own].any() or not is_background(piece, known, picture, height)]
        added = np.where(maximum_filter(np.any(kept, 0), SEAM), np.maximum(added, other), added) if kept else added
    odds = [logit(each.clip(CLEAR, 1 - CLEAR)) for each in (added, union)]
    both = result = expit(odds[0] + np.float32(WEIGHT) * odds[1])
    largest, height = max((other > 0.5).sum() for other in others), height_of(union)
    for piece in thick_pieces((added > 0.5) & (union <= 0.5), height):
        is_unsure = both[piece].mean() < 0.5 and piece.sum() < UNSURE * largest
        is_small = is_unsure or piece.sum() < LARGEST * (union > 0.5).sum()
        leaves = is_small and is_background(piece, known, picture, height, is_unsure)
        result = np.where(maximum_filter(piece, SEAM), np.minimum(added, union) if leaves else added, result)
    return result


def is_background(
    piece: np.ndarray, known: tuple[np.ndarray, ...], picture: np.ndarray, height: int, is_unsure: bool = False
) -> bool:
    """Returns whether a piece (h,w) bool of a mask has the colors of the background, and not of people, beside it.

    `known` (h,w) bool are where people and background surely are, and `height` is a person's, pixels.
    """
    from scipy.spatial import cKDTree

    reach = max(round(BESIDE * height), 1)
    (top, bottom), (left, right) = extent(piece)
    box = np.s_[max(top - reach, 0) : bottom + reach, max(left - reach, 0) : right + reach]
    colors, *beside = (picture[box][where[box]][::STEP].astype(np.float32) for where in (piece, *known))
    if not min(map(len, beside)):
        return False
    to_people, to_background = (cKDTree(some).query(colors)[0] for some in beside)
    if is_unsure:
        return bool((to_background < to_people).mean() > 0.5)
    return bool((to_background < np.minimum(to_people, ALIKE)).mean() > MOST)


def height_of(mask: np.ndarray) -> int:
    """Returns the rows that the values above .5 of a mask (h,w) reach over; 0 if there are none."""
    rows = np.flatnonzero((mask > 0.5).any(1))
    return int(rows[-1] - rows[0]) if len(rows) else 0


def thick_pieces(mask: np.ndarray, height: int) -> list[np.ndarray]:
    """Returns the pieces (h,w) bool of a mask that are thicker than 2 THICK of a person's height, pixels."""
    side = 2 * max(int(THICK * height), 1) + 1
    labels, count = label(maximum_filter(minimum_filter(mask, side), 2 * side - 1) & mask)
    return [labels == number for number in range(1, count + 1)]


def segment_coarsely(pixels: np.ndarray) -> np.ndarray:
    """Returns the mask (H,W) float32 in [0,1] of a photo (H,W,3) uint8 after all PASSES, at the network's detail."""
    height, width = pixels.shape[:2]
    found = np.zeros((height, width), np.float32)
    box = (0, 0, width, height)
    for _ in range(PASSES):
        size = box[2] - box[0], box[3] - box[1]
        part = Image.fromarray(drop_small_parts(predict_wide(pixels, box)))
        found[:] = 0
        found[box[1] : box[3], box[0] : box[2]] = np.asarray(part.resize(size, Image.Resampling.BICUBIC)).clip(0, 1)
        if not (found > 0.5).any():
            break
        box = box_around(found)
    return found


def predict_wide(pixels: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    """Runs the network on a part of any width, such as a group: in windows that overlap by half at least.

    Args:
        pixels: (H,W,3) uint8 sRGB.
        box: the part's left, upper, right and lower edge, pixels.

    Returns:
        The mask (SIDE,columns) float32 in [0,1], of SIDE columns for each window.
    """
    left, upper, right, lower = box
    width, window = right - left, min(right - left, int(WIDEST * (lower - upper) + 0.5))
    if window == width:
        return predict(pixels, box)
    total = np.zeros((2, SIDE, int(width * SIDE / window + 0.5)), np.float32)  # of weighted masks, and of weights
    weight = np.minimum(np.arange(1, SIDE + 1), np.arange(SIDE, 0, -1))  # people are cut at a window's edge
    last = width - window
    count = 1 + math.ceil(last / (window / 2))
    for n in range(count):
        start = last * n / (count - 1)
        first, column = left + int(start + 0.5), int(start * SIDE / window + 0.5)
        mask = predict(pixels, (first, upper, first + window, lower))
        total[:, :, column : column + SIDE] += np.stack([weight * mask, np.broadcast_to(weight, mask.shape)])
    return total[0] / total[1]


def predict(pixels: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    """Returns the mask (SIDE,SIDE) float32 in [0,1] of a part, as `predict_wide` takes it, and of its mirror image."""
    square = Image.fromarray(pixels).resize((SIDE, SIDE), Image.Resampling.BILINEAR, box, reducing_gap=3)
    image = np.asarray(square, np.float32).transpose(2, 0, 1)[None] / np.float32(255)
    (mask,) = load_network(SELFIE).run(None, {"image": image})
    return mask[0, 0]


def drop_small_parts(found: np.ndarray) -> np.ndarray:
    """Removes the parts of a mask (SIDE,columns) in [0,1] that are small and far from the largest one (SHARE, NEAR)."""
    labels, count = label(found > 0.5)
    if count < 2:
        return found
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    kept = (areas >= SHARE * areas.max())[labels] & (labels > 0)
    return np.where(distance_transform_edt(~kept) <= NEAR * SIDE, found, np.float32(0))


def box_around(found: np.ndarray) -> tuple[int, int, int, int]:
    """Returns the box (left, upper, right, lower) of the values above .5 in a mask (H,W), with a margin."""
    (top, bottom), (left, right) = extent(found > 0.5)
    margin = int(MARGIN * (bottom - top))
    height, width = found.shape
    return max(left - margin, 0), max(top - margin, 0), min(right + margin, width), min(bottom + margin, height)


def fit_to_edges(pixels: np.ndarray, small: np.ndarray) -> np.ndarray:
    """Moves the edges of a mask, float32 in [0,1] and of at most DETAIL pixels, to those of the photo (h,w,3) uint8.

    A guided filter of the colors (He, Sun and Tang 2013), computed on fewer pixels (He and Sun 2015): in each window
    the mask is a linear function of red, green and blue.
    """
    (height, width), size = pixels.shape[:2], small.shape[::-1]
    guide = np.asarray(Image.fromarray(pixels).resize(size, Image.Resampling.BOX)).transpose(2, 0, 1) / np.float32(255)
    reach = 2 * max(round(WINDOW * max(size)), 2) + 1

    def mean(plane: np.ndarray) -> np.ndarray:
        return uniform_filter(plane, reach, mode="nearest")

    average, level = [mean(plane) for plane in guide], mean(small)
    spread = [
        mean(guide[i] * guide[j]) - average[i] * average[j] + np.float32(SMOOTH * (i == j))
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    ]
    along = [mean(plane * small) - plane_mean * level for plane, plane_mean in zip(guide, average)]
    slope = solve_symmetric(spread, along)
    offset = level - sum(a * b for a, b in zip(slope, average))
    planes = [Image.fromarray(mean(plane)) for plane in (*slope, offset)]
    *slopes, edge = (np.asarray(plane.resize((width, height), Image.Resampling.BILINEAR)) for plane in planes)
    edge = edge + sum(slopes[c] * (pixels[..., c] / np.float32(255)) for c in range(3))
    return tighten(np.clip((edge - 0.5) * STEEP + 0.5, 0, 1), max(round(BAND * max(height, width)), 1))


def tighten(mask: np.ndarray, radius: int) -> np.ndarray:
    """Makes a mask (h,w) in [0,1] opaque inside and empty outside, but for a band of this radius along its edge.

    The network is unsure about dark cloth and about what is dark behind: without this a leg lets the background shine
    through, and black background stays above a hood. What is thinner than the band keeps its values.
    """
    share = uniform_filter((mask > 0.5).astype(np.float32), 2 * radius + 1, mode="nearest")  # 1/2 on a straight edge
    return np.clip(mask, np.clip(2 * share - 1, 0, 1), np.clip(2 * share, 0, 1))


def solve_symmetric(matrix: list[np.ndarray], right: list[np.ndarray]) -> list[np.ndarray]:
    """Solves A x = b in each pixel by the adjugate, for symmetric A of the planes [[a, b, c], [b, d, e], [c, e, f]]."""
    a, b, c, d, e, f = matrix
    first = d * f - e * e, c * e - b * f, b * e - c * d
    middle, last = (a * f - c * c, b * c - a * e), a * d - b * b
    adjugate = first, (first[1], *middle), (first[2], middle[1], last)
    determinant = a * first[0] + b * first[1] + c * first[2]
    return [sum(x * y for x, y in zip(row, right)) / determinant for row in adjugate]
