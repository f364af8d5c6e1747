"""Damaged copies of whole files, and readers in a process of their own, so that a crash is seen and memory measured."""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

HANG = 60  # CPU-seconds for a file of some kilobytes, which takes hundredths of one: no slow machine needs so many
HEAD = 400  # bytes that most formats say their sizes in
ABSURD = (0, 1, -1, 255, 65535, 2**31 - 1, -(2**31), 2**32 + 256, 2**63 - 1)
LOOP = """
import sys, time
sys.path.insert(0, sys.argv[1])
import readers
from relight.core.errors import UserError
def most_memory():  # of this program alone, in kilobytes; getrusage would count the parent's before the exec
    try:
        status = open("/proc/self/status").read()
    except OSError:
        return 0
    return int(status.split("VmHWM:")[1].split()[0])
for line in sys.stdin:
    reader, path = line.rstrip("\\n").split(" ", 1)
    start = time.process_time()
    try:
        getattr(readers, reader)(path)
        outcome = "read"
    except UserError as error:
        assert len(str(error)) > 20 and "\\n" not in str(error), repr(str(error))
        outcome = "error"
    print(outcome, time.process_time() - start, most_memory(), path, flush=True)
"""


def damaged(data: bytes, rng: np.random.Generator) -> tuple[bytes, str]:
    """One damaged copy of a file, and the kind of the damage."""
    data = bytearray(data)
    kind = str(rng.choice(["cut", "flip", "head", "number", "word", "insert", "remove", "zeros", "tail"]))
    place = int(rng.integers(len(data)))
    match kind:
        case "cut":
            data = data[:place]
        case "flip":
            for i in rng.integers(0, len(data), rng.integers(1, 20)):
                data[i] = rng.integers(256)
        case "head":
            for i in rng.integers(0, min(len(data), HEAD), rng.integers(1, 6)):
                data[i] = rng.integers(256)
        case "number":
            found = list(re.finditer(rb"\d+", data[: 10 * HEAD])) or [re.match(b"", data)]
            first, last = found[rng.integers(len(found))].span()
            data[first:last] = str(ABSURD[rng.integers(len(ABSURD))]).encode()
        case "word":
            word = ABSURD[rng.integers(len(ABSURD))].to_bytes(9, "little", signed=True)[: rng.choice([4, 8])]
            data[place : place + len(word)] = word
        case "insert":
            data[place:place] = rng.integers(0, 256, rng.integers(1, 64), np.uint8).tobytes()
        case "remove":
            del data[place : place + int(rng.integers(1, 64))]
        case "zeros":
            data[place:] = bytes(len(data) - place)
        case "tail":
            data += data[place:]
    return bytes(data), kind


def outcomes(jobs: Iterable[tuple[str, Path, bytes | None]], memory: int) -> list[str]:
    """What readers, functions of readers.py by name, make of files one after the other: "read" or "error" for each.

    Fails where one ends otherwise than by UserError in one line, hangs, or takes more than `memory` kilobytes; the file
    stays. Jobs are reader, path, and the bytes of a file that is written for it and removed afterwards.
    """
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", LOOP, str(Path(__file__).parent)]
    pipe, found = subprocess.PIPE, []
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=errors, text=True, env=environment)
        with process:
            for reader, path, data in jobs:
                if data is not None:
                    path.write_bytes(data)
                print(reader, path, file=process.stdin, flush=True)
                # Libraries may print lines of their own.
                answer = next((line for line in process.stdout if line.startswith(("read ", "error "))), None)
                if answer is None:
                    process.wait()
                    errors.seek(0)
                    raise AssertionError(f"{reader} at {path}: {errors.read()[-2000:]}")
                outcome, seconds, most, _ = answer.split(" ", 3)
                assert float(seconds) < HANG, f"{reader} at {path}: {float(seconds):.1f} s"
                assert int(most) < memory, f"{reader} at {path}: {most} kB"
                if data is not None:
                    path.unlink()
                found.append(outcome)
            process.stdin.close()
        assert process.returncode == 0
    return found
