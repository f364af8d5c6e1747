"""Malformed panoramas: each is an error or a stated repair; no crash, no hang, no more than 500 MB.

The suite takes a seeded sample, `make fuzz` more (RELIGHT_FUZZ). Files are read in a process of their own, so that a
crash is seen and memory is measured.
"""

import itertools
import os

import numpy as np
import OpenEXR
import pytest
from damage import damaged, outcomes

CASES = int(os.environ.get("RELIGHT_FUZZ", "400"))
MEMORY = 500_000  # kilobytes of the reader


def pixels(rng, h=24, w=48):
    return (rng.random((h, w, 3)) * 10.0 ** rng.uniform(-2, 2, (h, w, 1))).astype(np.float32)


def hdr(rng, coding):
    body, w = bytearray(), 48
    for _ in range(24):
        if coding == "flat":
            body += rng.integers(2, 255, 4 * w, np.uint8).tobytes()
        elif coding == "old":
            body += bytes(rng.integers(2, 140, 4, np.uint8)) + bytes([1, 1, 1, w - 1])
        else:
            body += bytes([2, 2, 0, w])
            for _ in range(4):
                body += bytes([128 + 20, int(rng.integers(256)), 28]) + rng.integers(90, 140, 28, np.uint8).tobytes()
    header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.5\nCOLORCORR=1 1 1\n\n"
    return header + b"-Y 24 +X 48\n" + bytes(body)


def write_seeds(folder):
    """Whole files of every kind, by name: what the malformed ones are made from."""
    rng = np.random.default_rng(0)
    seeds = {f"{coding}.hdr": hdr(rng, coding) for coding in ("flat", "old", "new")}
    seeds["a.pfm"] = b"PF\n48 24\n-1.0\n" + pixels(rng).tobytes()
    path = str(folder / "seed.exr")

    def store(name, *parts, **header):
        header = {"type": OpenEXR.scanlineimage, **header}
        if len(parts) == 1:
            OpenEXR.File(header, parts[0]).write(path)
        else:
            OpenEXR.File([OpenEXR.Part({"name": str(i), **header}, part) for i, part in enumerate(parts)]).write(path)
        seeds[name] = (folder / "seed.exr").read_bytes()

    for name in ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "DWAA"):
        dtype = np.float16 if name in ("B44", "PIZ") else np.float32
        store(f"{name}.exr", {"RGB": pixels(rng).astype(dtype)}, compression=getattr(OpenEXR, f"{name}_COMPRESSION"))
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 16
    store("tiled.exr", {"RGB": pixels(rng)}, type=OpenEXR.tiledimage, tiles=tiles)
    store("envmap.exr", {"RGB": pixels(rng)}, envmap=OpenEXR.ENVMAP_LATLONG)
    store("parts.exr", {"Z": pixels(rng)[..., 0]}, {"RGB": pixels(rng)})
    store("chroma.exr", {name: pixels(rng)[..., 0] for name in ("Y", "RY", "BY")})
    store("negative.exr", {"RGB": -pixels(rng)})
    nan = pixels(rng)
    nan[5, 5] = np.nan
    store("nan.exr", {"RGB": nan})
    deep = np.empty((4, 8), object)
    for place in np.ndindex(deep.shape):
        deep[place] = np.ones(2, np.float32)
    store("deep.exr", {name: deep for name in "RGB"}, type=OpenEXR.deepscanline, compression=OpenEXR.ZIPS_COMPRESSION)
    return seeds


def malformed(data, rng):
    """One damaged copy of a whole file, and what was done to it: also sizes of pictures that cannot be."""
    if rng.random() > 1 / 8:
        return damaged(data, rng)
    data = bytearray(data)
    absurd = [b"99999999", b"0", b"-1", b"4294967552", b"1e9", b"8192"]
    for number in (b"48", b"24"):
        if rng.random() < 0.7:
            data = data.replace(number, absurd[rng.integers(len(absurd))], 1)
    window = data.find(b"Window\0box2i\0")
    if window > 0:
        words = rng.choice(np.array([0, -1, 47, 2**31 - 1, -(2**31), 8191, 65535], np.int64), 4).astype("<i4")
        data[window + 17 : window + 33] = words.tobytes()
    return bytes(data), "size"


@pytest.mark.slow
def test_malformed_panoramas_neither_crash_nor_hang_nor_fill_the_memory(tmp_path):
    rng = np.random.default_rng(1)
    seeds = write_seeds(tmp_path)
    refused = {"chroma.exr", "negative.exr", "nan.exr", "deep.exr"}
    sound = [("panorama", tmp_path / f"whole-{name}", data) for name, data in seeds.items()]
    assert outcomes(sound, MEMORY) == ["error" if name in refused else "read" for name in seeds]
    words = outcomes(damages(seeds, tmp_path, rng), MEMORY)
    assert words.count("error") > 0.3 * len(words)


def damages(seeds, folder, rng):
    for i, name in zip(range(CASES), itertools.cycle(seeds)):
        data, kind = malformed(seeds[name], rng)
        yield "panorama", folder / f"{i}-{kind}-{name}", data


@pytest.mark.parametrize("half", [np.float16, np.float32])
def test_a_small_file_of_a_huge_black_picture_is_refused_before_its_pixels(tmp_path, half):
    black = np.zeros((6000, 6000), half)
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {"Y": black}).write(str(tmp_path / "bomb.exr"))
    assert outcomes([("panorama", tmp_path / "bomb.exr", None)], 200_000) == ["error"]
