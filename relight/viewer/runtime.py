"""The package onnxruntime-web, by which a site of `relight web` runs networks in a browser.

It belongs to Microsoft and comes under the MIT licence from the npm registry, from which `setup` takes it once.
"""

import tarfile
import zlib
from contextlib import suppress
from pathlib import Path

from relight.core.download import Package, fetch
from relight.core.errors import UserError
from relight.core.files import atomic_write, data_folder

INTEGRITY = "q0y+JrrtukXSzsBWEMccVfqX25LRmosXHF+CaRJmg8pZClzcV7svNc4rKY3jL02Vb7QmRMDs1SigqR4CXAfKYQ=="
PACKAGE = Package("onnxruntime-web", "1.30.0", INTEGRITY, "relight web setup")
FILES = ("ort.wasm.bundle.min.mjs", "ort-wasm-simd-threaded.wasm")  # the script and the WebAssembly


def package_file() -> Path:
    """Returns the path of the package once it is set up."""
    return data_folder() / "web" / PACKAGE.file_name


def setup(package: Path | str | None = None) -> Path:
    """Puts onnxruntime-web (33 MB) into the user's data folder (`relight.core.download.fetch`).

    Args:
        package: its .tgz file; by default it is downloaded.

    Returns:
        The file.

    Raises:
        UserError: if it cannot be downloaded, or its hash is not that of the version known here.
    """
    path = package_file()
    with atomic_write(path) as temporary:
        temporary.write_bytes(fetch(PACKAGE, package))
    return path


def unpack(folder: Path) -> list[Path]:
    """Puts FILES into an existing folder.

    Args:
        folder: where to put them.

    Returns:
        Their paths, in the order of FILES.

    Raises:
        UserError: if the package is not set up, or damaged.
    """
    package = package_file()
    if not package.is_file():
        raise UserError(
            f"{PACKAGE.name}, which runs networks in a browser, is not set up: run once `{PACKAGE.command}`"
        )
    missing = {f"package/dist/{name}": folder / name for name in FILES}
    # A stream, since going back in it would decompress it again. What is missing says that it is damaged.
    with suppress(tarfile.TarError, EOFError, zlib.error), tarfile.open(package, "r|gz") as archive:
        while missing and (member := archive.next()):
            if member.name in missing and (file := archive.extractfile(member)):
                missing[member.name].write_bytes(file.read())
                del missing[member.name]
    if missing:
        raise UserError(f"{package} is damaged: run `relight web setup` again")
    return [folder / name for name in FILES]
