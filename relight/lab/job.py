"""What every job of the workflow does: it writes its log, says errors in a sentence, and ends with its Snakemake."""

import os
import pdb
import platform
import resource
import select
import signal
import sys
import threading
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from relight.core.errors import sentence_of
from relight.core.version import __version__
from relight.lab.made import begin, describe, finish

PACKAGES = ("numpy", "scipy", "torch", "mlflow", "open3d-cpu", "pymeshlab", "warp-lang")  # whose versions are told


@contextmanager
def job(snakemake: Any) -> Iterator[set[str]]:
    """Runs a script of the workflow, unless its outputs are already what it would make (`relight.lab.made`).

    What it prints goes to its log and, behind its name, to the console. Yields the figures in a folder that stay.
    `snakemake` is the object that scripts are given.
    """
    end_with(snakemake.config["job"]["process"])
    name, log = " ".join([snakemake.rule, *filter(None, snakemake.wildcards)]), Path(snakemake.log[0])
    with copied_output(str(log), f"{name}: "):
        try:
            outputs, params = [*snakemake.output], dict(snakemake.params.items())
            rule = Path(sys.modules["__main__"].__file__ or "").stem  # of the script: `module` may give a prefix
            record = describe(rule, params, snakemake.input, outputs[0])
            yield begin(outputs, record)
            finish(outputs, {**record, "by": header()})
        except KeyboardInterrupt:
            os._exit(130)
        except Exception as error:
            print(sentence_of(error) or traceback.format_exc(), file=sys.stderr)
            sys.exit(1)
    with open(log, "a", encoding="utf-8") as file:
        used = resource.getrusage(resource.RUSAGE_SELF)
        file.write(f"# {used.ru_utime + used.ru_stime:.1f} s of CPU, {used.ru_maxrss / 1e6:.2f} GB at most\n")


def map_files(batches: Iterable[str], names: Iterable[Iterable[str]]) -> list[Path]:
    """Returns the files of maps in the folders of batches by the names of each."""
    return [Path(batch, f"{name}.exr") for batch, of_batch in zip(batches, names) for name in of_batch]


def end_with(process: int) -> None:
    """Ends this process as soon as another one, its Snakemake, has ended for any reason (on Linux)."""
    if not hasattr(os, "pidfd_open"):
        return
    try:
        handle = os.pidfd_open(process)
    except ProcessLookupError:
        sys.exit("the Snakemake that started this has ended")

    def wait() -> None:
        select.select([handle], [], [])
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def copied_output(log: str, prefix: str) -> Iterator[None]:
    """Adds all that this process prints to a log, below when, where and with what, and with a prefix to the console."""
    console = os.dup(2)
    reading, writing = os.pipe()

    def copy() -> None:
        with open(reading, "rb") as lines, open(log, "ab", buffering=0) as file:
            file.write(f"# {header()}\n".encode())
            for line in lines:
                file.write(line)
                with suppress(OSError):  # a closed terminal
                    os.write(console, prefix.encode() + line)

    copying = threading.Thread(target=copy, daemon=True)
    copying.start()
    for number in (1, 2):
        os.dup2(writing, number)
    os.close(writing)

    def restore() -> None:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
            os.dup2(console, stream.fileno())

    def debug() -> None:
        restore()
        pdb.Pdb().set_trace(sys._getframe(1))

    sys.breakpointhook = debug
    try:
        yield
    finally:
        restore()
        copying.join(timeout=5)  # a process that was left behind may still hold the pipe


def header() -> str:
    """Returns when and where a job runs, and the versions of what it uses."""
    versions = [f"relight {__version__}", f"Python {platform.python_version()}"]
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            versions.append(f"{package} {version(package)}")
    return f"{datetime.now().astimezone().isoformat(timespec='seconds')} on {platform.node()}; {', '.join(versions)}"
