"""People one by one, by MediaPipe's pose networks: where each is, their joints, and a mask of each.

The first network sees a part of the photo, with bars, and gives for each person a box, the middle of the hips and a
point of a circle around the body. The second sees the square around that circle, turned so that the body is upright.
Both come with that of relight.photos.mask.selfie; constants are those of MediaPipe's graphs (pose_detection_cpu,
pose_landmarks_to_roi).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image
from scipy.ndimage import label
from scipy.special import expit

from relight.maps.square import extent
from relight.photos.mask.networks import DETECTOR, LANDMARKS, load_network

SEEN, LOOKED_AT = 224, 256  # sides of what the two networks see, pixels
ANCHORS = (28, 2), (14, 2), (7, 6)  # cells along a side of each layer of the first, and boxes of each cell
FOUND, SAME = 0.5, 0.3  # least score of a person; intersection over union of two boxes of one person
HIDDEN = 0.75  # least score of a person whom others hide
ROOM = 1.25  # side of the square over the circle's diameter
LARGEST = 1.5  # radius of a circle over the photo's longer side; larger ones are in blurred crowds
WINDOW = 0.6  # width over height of the windows in which a wide photo is searched
NEW = 0.5  # share of a body's mask that no other one's covers, from which it is somebody else
COVERED = 0.3  # least value of a mask that covers others
KNOWN = 0.1  # least share of a part of another network's mask that a body's covers
JOINTS = 33
LIKELY = 0.5  # that both ends of a limb are seen
PARTS = {  # of the left side, each at the middle of two joints; the right side's have the next numbers
    "upper arm": (11, 13), "elbow": (13, 13), "forearm": (13, 15), "hand": (17, 19),
    "thigh": (23, 25), "knee": (25, 25), "shin": (25, 27), "foot": (27, 27),
}  # fmt: skip
LIMBS = {"head": (0, 0)} | {
    f"{side} {part}": (a + i, b + i) for i, side in enumerate(("left", "right")) for part, (a, b) in PARTS.items()
}


@dataclass(frozen=True, repr=False)
class Body:
    """A person as the networks see them. Lengths are shares of the photo's width and height.

    Attributes:
        joints: (33,3) x, y, and in [0,1] how sure it is that the joint is seen; in the order of MediaPipe.
        seen: (256,256) float32 in [0,1], the mask in the square.
        square: (2,3) from x, y and 1 in pixels of the square to the photo.
        place: (2,2) the middle of the hips and a point of a circle around the body, as the second network sees them.
        score: how sure the networks are of the person, in [FOUND,1].
    """

    joints: np.ndarray
    seen: np.ndarray
    square: np.ndarray
    place: np.ndarray
    score: float = 1.0

    def mask(self, size: tuple[int, int], part: Sequence[float] = (0, 0, 1, 1)) -> np.ndarray:
        """Returns the mask (height,width) in [0,1] of a part (left, upper, right, lower), `size` (width, height)."""
        back = np.linalg.inv(self.square[:, :2])
        corner, other = np.reshape(part, (2, 2))
        axes, start = back * (other - corner) / size, back @ (corner - self.square[:, 2])
        return np.asarray(_transformed(Image.fromarray(self.seen), axes, start, size))

    def limbs(self) -> np.ndarray:
        """Returns the middles (len(LIMBS),3) of the limbs, as `joints`; 0 is how sure ends outside of the photo are."""
        ends = self.joints[np.array([*LIMBS.values()])]
        is_inside = ((ends[..., :2] > 0) & (ends[..., :2] < 1)).all((1, 2))
        return np.column_stack([ends[..., :2].mean(1), ends[..., 2].min(1) * is_inside])

    def limbs_in(self, size: tuple[int, int], part: np.ndarray) -> tuple[np.ndarray, ...]:
        """Returns rows and columns of limbs that are likely seen in a part, as `mask` takes it."""
        corner, other = np.reshape(part, (2, 2))
        limbs = self.limbs()
        places = ((limbs[limbs[:, 2] > LIKELY, :2] - corner) / (other - corner) * size).astype(int)
        return tuple(places[((places >= 0) & (places < size)).all(1)].T[::-1])


def find_bodies(pixels: np.ndarray, found: np.ndarray) -> list[Body]:
    """Finds the people of a photo.

    Each is looked at again, in the circle that the second network gives and with the others painted over in the mean
    color of the background, so that no limb is cut off or taken for a neighbour's.

    Args:
        pixels: (H,W,3) uint8 sRGB.
        found: (H,W) float32 in [0,1], the mask of the people by another network.

    Returns:
        The people: the surest first, then those whom these hide, then those whom only `found` shows.
    """
    step = max(len(pixels) // (2 * SEEN), 1)
    photo = rest = np.asarray(Image.fromarray(pixels).reduce(step))
    bodies, masks = list[Body](), list[np.ndarray]()
    covered = np.zeros(photo.shape[:2], bool)

    def add(body: Body | None) -> None:
        if body is None:
            return
        mask = body.mask((photo.shape[1], photo.shape[0]))
        if (mask > 0.5)[~covered].sum() > NEW * (mask > 0.5).sum():
            bodies.append(body)
            masks.append(mask)
            np.logical_or(covered, mask > COVERED, out=covered)

    while True:
        known = len(bodies)
        for score, place in sorted(_search(rest), key=lambda each: -each[0]):
            if np.hypot(*(place[1] - place[0])) > LARGEST * max(photo.shape) or (rest is not photo and score < HIDDEN):
                continue
            body = _look_at(pixels, step * place) if rest is photo else _look_at(rest, place)
            add(body and replace(body, score=score))
        background = np.append(photo[~covered], [[128] * 3], 0).mean(0).astype(np.uint8)  # grey if none is seen
        if len(bodies) == known:
            break
        rest = np.where(covered[..., None], background, photo)
    for place in _missed(np.asarray(Image.fromarray(found).reduce(step)) > 0.5, covered):
        add(_look_at(pixels, step * place))
    for number, body in enumerate(bodies):
        others = np.maximum.reduce([np.zeros_like(masks[0]), *masks[:number], *masks[number + 1 :]])
        hidden = others > np.maximum(masks[number], COVERED)
        alone = pixels if len(bodies) == 1 else np.where(hidden[..., None], background, photo)
        if again := _look_at(alone, body.place * alone.shape[1::-1]):
            bodies[number] = replace(again, score=body.score)
    return bodies


def _missed(mask: np.ndarray, covered: np.ndarray) -> Iterator[np.ndarray]:
    """Yields where somebody who stands may be, in each part of a mask (h,w) bool that `covered` (h,w) bool has not."""
    parts, count = label(mask)
    for part in (parts == number for number in range(1, count + 1)):
        if covered[part].mean() < KNOWN:
            (top, bottom), (left, right) = extent(part)
            middle = np.array([left + right, top + bottom]) / 2
            yield np.stack([middle, middle - [0, max(right - left, bottom - top) / 2]])


def _search(photo: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
    """Yields the score and the place of each person in a photo (H,W,3) uint8, also in windows of a wide one."""
    height, width = photo.shape[:2]
    window = min(round(WINDOW * height), width)
    count = 1 + int(np.ceil((width - window) / (window / 2)))
    starts = np.linspace(0, width - window, count).astype(int)
    for left, right in sorted({(0, width), *((start, start + window) for start in starts)}):
        for score, place in _detect(photo[:, left:right]):
            yield score, place + [left, 0]


def _detect(pixels: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
    """Yields the score and the place of each person in a part of a photo (h,w,3) uint8."""
    height, width = pixels.shape[:2]
    scale = SEEN / max(height, width)
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    corner = (SEEN - size[0]) // 2, (SEEN - size[1]) // 2
    image = Image.new("RGB", (SEEN, SEEN))
    image.paste(Image.fromarray(pixels).resize(size, Image.Resampling.BILINEAR, reducing_gap=3), corner)
    given = np.asarray(image, np.float32).transpose(2, 0, 1)[None] / np.float32(127.5) - 1
    boxes, scores = load_network(DETECTOR).run(["boxes", "scores"], {"image": given})
    scores = expit(scores[0, :, 0])
    cells = [np.repeat(np.indices((n, n)).reshape(2, -1).T[:, ::-1] + 0.5, count, 0) / n for n, count in ANCHORS]
    points = boxes[0].reshape(-1, 6, 2) / SEEN  # middle, size and four points of each box
    points[:, [0, 2, 3, 4, 5]] += np.concatenate(cells)[:, None]
    left = np.flatnonzero(scores >= FOUND)
    left = left[np.argsort(-scores[left])]
    while len(left):
        same = _overlap(points[left[0]], points[left]) > SAME
        group, left = left[same], left[~same]
        yield float(scores[group[0]]), (np.average(points[group, 2:4], 0, scores[group]) * SEEN - corner) / scale


def _overlap(one: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Returns the intersection over union (N,) of a box (6,2), its middle and its size first, with others (N,6,2)."""
    low = np.maximum(others[:, 0] - others[:, 1] / 2, one[0] - one[1] / 2)
    high = np.minimum(others[:, 0] + others[:, 1] / 2, one[0] + one[1] / 2)
    both = np.prod(np.maximum(high - low, 0), -1)
    return both / (np.prod(others[:, 1], -1) + np.prod(one[1]) - both)


def _look_at(pixels: np.ndarray, place: np.ndarray) -> Body | None:
    """Returns the person in the square around a circle of a photo (H,W,3) uint8; None if nobody is there.

    `place` (2,2) are the middle of the hips, which is that of the circle, and the circle's point above it, pixels.
    """
    x, y = ROOM * 2 / LOOKED_AT * (place[1] - place[0])
    axes = np.array([[-y, -x], [x, -y]])  # of the square in the photo, a pixel long
    corner = place[0] - axes @ [LOOKED_AT / 2, LOOKED_AT / 2]
    step = max(int(np.hypot(x, y)), 1)
    image = _transformed(Image.fromarray(pixels).reduce(step), axes / step, corner / step, (LOOKED_AT, LOOKED_AT))
    given = np.asarray(image, np.float32).transpose(2, 0, 1)[None] / np.float32(255)
    points, presence, mask = load_network(LANDMARKS).run(["points", "presence", "mask"], {"image": given})
    if presence[0, 0] < FOUND:
        return None
    points = points.reshape(-1, 5)[: JOINTS + 2]
    square = np.column_stack([axes, corner]) / [[pixels.shape[1]], [pixels.shape[0]]]
    found = np.column_stack([points[:, :2] @ square[:, :2].T + square[:, 2], expit(points[:, 3])])
    joints, place = found[:JOINTS].astype(np.float32), found[JOINTS:, :2]
    return Body(joints, expit(mask[0, 0]), square, place, float(presence[0, 0]))


def _transformed(image: Image.Image, axes: np.ndarray, corner: np.ndarray, size: tuple[int, int]) -> Image.Image:
    """Samples an image at `axes @ [x, y] + corner` for each pixel of the result."""
    coefficients = (*axes[0], corner[0], *axes[1], corner[1])
    return image.transform(size, Image.Transform.AFFINE, coefficients, Image.Resampling.BILINEAR)
