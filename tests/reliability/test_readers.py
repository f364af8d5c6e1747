"""Damaged and hostile files of every kind: read, or refused in one sentence, in little time and memory.

The suite takes a seeded sample, `make fuzz` more (RELIGHT_FUZZ: damaged files of all kinds together). Files that once
broke a reader are in `found/`.
"""

import json
import os
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from damage import damaged, outcomes
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from readers import write_whole

from relight.core.errors import UserError
from relight.lights import load_light

CASES = int(os.environ.get("RELIGHT_FUZZ", "450"))
READERS = "light light_set training_lights split record mesh maps packed network photo mask textured scores".split()
READERS += ["axes", "panorama"]
FOUND = Path(__file__).parent / "found"
MEMORY = 900_000  # kilobytes of one reader, torch and its libraries among them


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, list[Path]]:
    return write_whole(tmp_path_factory.mktemp("whole"))


@pytest.mark.slow
def test_no_damaged_file_crashes_hangs_or_swells(whole):
    sound = [(reader, path, None) for reader, paths in whole.items() for path in paths]
    assert set(outcomes(sound, MEMORY)) == {"read"}
    words = outcomes(damaged_files(whole), MEMORY)
    for i, reader in enumerate(READERS):
        errors = words[i : CASES : len(READERS)]
        assert errors.count("error") > 0.2 * len(errors), reader


@pytest.mark.parametrize("half", [np.float16, np.float32])
def test_a_small_file_of_a_huge_black_picture_is_refused_before_its_pixels(tmp_path, half):
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {"Y": np.zeros((6000, 6000), half)}).write(str(tmp_path / "bomb.exr"))
    assert outcomes([("panorama", tmp_path / "bomb.exr", None)], 200_000) == ["error"]


def damaged_files(whole: dict[str, list[Path]]) -> Iterator[tuple[str, Path, bytes | None]]:
    """Yields reader, path, and the bytes to write there: of CASES damaged copies, the readers in turn.

    Then come the files of FOUND, which once broke a reader; they exist, so their bytes are None.
    """
    rng = np.random.default_rng(0)
    for i in range(CASES):
        reader = READERS[i % len(READERS)]
        source = whole[reader][i // len(READERS) % len(whole[reader])]
        data, kind = damaged(source.read_bytes(), rng)
        yield reader, source.with_name(f"{i}-{kind}-{source.name}"), data
    for path in sorted(FOUND.glob("*-*")):
        yield path.name.partition("-")[0], path, None


def safetensors(header: dict, body: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


@pytest.mark.slow
def test_what_a_header_promises_is_not_allocated(whole, tmp_path):
    """Networks and data sets whose metadata ask for more memory than there is."""
    sizes, jobs = (10**6, 10**9, 10**300, -64, 0, "64", None, 64.5, [64]), []
    for reader in ("network", "packed"):
        data = whole[reader][0].read_bytes()
        length = struct.unpack("<Q", data[:8])[0]
        header, body = json.loads(data[8 : 8 + length]), data[8 + length :]
        files = []
        for key in ("size", "order", "width"):
            for value in sizes:
                notes = json.loads(json.dumps(header["__metadata__"]))
                if reader == "network":
                    config = json.loads(notes["relight"])
                    (config if key == "size" else config["model"])[key] = value
                    notes["relight"] = json.dumps(config)
                elif key != "width":
                    notes[key] = json.dumps(value)
                else:
                    notes["names"] = json.dumps(["a"] * (value if value == 10**6 else 2))
                files.append(safetensors({**header, "__metadata__": notes}, body))
        nested = {**header["__metadata__"], "relight": "[" * 10**5, "names": "[" * 10**5}
        files.append(safetensors({**header, "__metadata__": nested}, body))
        jobs += [(reader, tmp_path / f"{reader}-{number}", data) for number, data in enumerate(files)]
    assert set(outcomes(jobs, MEMORY)) == {"error"}


@given(st.recursive(st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
                    lambda inner: st.lists(inner, max_size=10) | st.dictionaries(
                        st.sampled_from(["coefficients", "convention", "object", "sh", "intensity", "x"]), inner
                    ), max_leaves=40))  # fmt: skip
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@pytest.mark.slow
def test_any_json_is_a_light_or_refused(tmp_path, content):
    (path := tmp_path / "light.json").write_text(json.dumps(content))
    try:
        light = load_light(path)
    except UserError as error:
        assert "\n" not in str(error) and str(path) in str(error)
    else:
        assert np.isfinite(light.coefficients).all() and light.coefficients.shape == (9, 3)
