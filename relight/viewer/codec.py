"""Planes of integers as few bytes: predicted from their neighbours inside a region, split into bytes, deflated.

A browser undoes it with `DecompressionStream` and one pass over the pixels (`page/codec.js`), without decoding an
image, so neither color management nor premultiplied alpha can touch the values.
"""

import zlib

import numpy as np

LEVEL = 6  # 9 takes more than twice the time, for 1 % fewer bytes


def deflate(data: bytes) -> bytes:
    """Compresses bytes, most of them small, to a zlib stream."""
    coder = zlib.compressobj(LEVEL, memLevel=9, strategy=zlib.Z_FILTERED)
    return coder.compress(data) + coder.flush()


def neighbours(values: np.ndarray, region: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the left, upper and upper-left neighbours of each pixel.

    The decoder does not know pixels outside the region. If one of left and upper is missing, all three take the other's
    value; if both are, they are 0; an upper-left that is missing alone is the mean of the others.

    Args:
        values: (H,W) integers.
        region: (H,W) bool.

    Returns:
        Three arrays (H,W) int32.
    """
    known = np.pad(region, ((1, 0), (1, 0)))
    padded = np.pad(np.where(region, values, 0), ((1, 0), (1, 0)))
    left, up, corner = padded[1:, :-1], padded[:-1, 1:], padded[:-1, :-1]
    has_left, has_up, has_corner = known[1:, :-1], known[:-1, 1:], known[:-1, :-1]
    left, up = np.where(has_left, left, up), np.where(has_up, up, left)  # both are 0 if both are missing
    corner = np.where(has_left & has_up & has_corner, corner, (left + up) >> 1)
    return left, up, corner


def predictions(left: np.ndarray, up: np.ndarray, corner: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predicts each pixel from its neighbours in three ways; the page knows each by its index.

    Args:
        left, up, corner: (H,W) integers, the left, upper and upper left neighbours.

    Returns:
        Three arrays (H,W): the mean of left and up, for noise; the median predictor of JPEG-LS (ITU-T T.87), for edges;
        a damped gradient, for noisy ramps.
    """
    low, high = np.minimum(left, up), np.maximum(left, up)
    median = np.where(corner >= high, low, np.where(corner <= low, high, left + up - corner))
    return (left + up) >> 1, median, (3 * (left + up) - 2 * corner) >> 2


def encode(values: np.ndarray, region: np.ndarray) -> tuple[bytes, list[int]]:
    """Codes planes inside a region.

    The stream holds for each plane the low bytes and then the high bytes of the residuals in raster order, signed
    values folded: 0, -1, 1, -2, ...

    Args:
        values: (H,W,C) integers, whose residuals fit 16 bits.
        region: (H,W) bool.

    Returns:
        The zlib stream, and the index of the predictor of each plane.

    Raises:
        ValueError: if a residual exceeds 16 bits.
    """
    streams, chosen = [], []
    for plane in np.moveaxis(values.astype(np.int32), -1, 0):
        residuals = [(plane - predicted)[region] for predicted in predictions(*neighbours(plane, region))]
        bits = [np.log2(1 + np.abs(residual)).sum() for residual in residuals]  # about the length of each code
        best = int(np.argmin(bits))
        folded = (residuals[best] << 1) ^ (residuals[best] >> 31)  # >> 31: -1 for negative values
        if folded.size and folded.max() > 0xFFFF:
            raise ValueError("residuals exceed 16 bits")
        streams += [(folded & 0xFF).astype(np.uint8).tobytes(), (folded >> 8).astype(np.uint8).tobytes()]
        chosen.append(best)
    return deflate(b"".join(streams)), chosen
