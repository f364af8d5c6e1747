"""The package onnxruntime-web, by which a site of `relight web` runs networks in a browser.

It belongs to Microsoft and comes under the MIT licence from the npm registry. `setup` takes it from there once, pinned
by version and hash; neither npm nor node is needed.
"""

import base64
import hashlib
import os
import shutil
import tarfile
import urllib.error
import urllib.request
from pathlib import Path

from platformdirs import user_data_path

from relight.files import UserError, atomic_write, existing_file

PACKAGE, VERSION = "onnxruntime-web", "1.30.0"
INTEGRITY = "q0y+JrrtukXSzsBWEMccVfqX25LRmosXHF+CaRJmg8pZClzcV7svNc4rKY3jL02Vb7QmRMDs1SigqR4CXAfKYQ=="  # SHA-512
NAME = f"{PACKAGE}-{VERSION}.tgz"
REGISTRY = "https://registry.npmjs.org"
FILES = ("ort.wasm.bundle.min.mjs", "ort-wasm-simd-threaded.wasm")  # the script and the WebAssembly


def package_file() -> Path:
    """Returns the path of the package once it is set up: in the user's data folder, or in RELIGHT_DATA."""
    return Path(os.environ.get("RELIGHT_DATA") or user_data_path("relight")) / "web" / NAME


def setup(package: Path | str | None = None) -> Path:
    """Puts the package into the user's data folder.

    Args:
        package: its .tgz file, as `npm pack` writes it; by default it is downloaded (33 MB) from the npm registry, or
            from the one that the variable NPM_CONFIG_REGISTRY names, as for npm.

    Returns:
        The file.

    Raises:
        UserError: if it cannot be had, or its hash is not that of the version known here.
    """
    path = package_file()
    with atomic_write(path) as temporary:
        if package is not None:
            shutil.copyfile(existing_file(package, "--from"), temporary)
        else:
            registry = os.environ.get("NPM_CONFIG_REGISTRY") or REGISTRY
            try:
                with urllib.request.urlopen(f"{registry.rstrip('/')}/{PACKAGE}/-/{NAME}", timeout=60) as answer:
                    temporary.write_bytes(answer.read())
            except (urllib.error.URLError, TimeoutError, ValueError) as error:
                raise UserError(
                    f"{PACKAGE} {VERSION} could not be downloaded ({getattr(error, 'reason', error)}): run `npm pack "
                    f"{PACKAGE}@{VERSION}` where there is a network, then `relight web setup --from {NAME}`"
                ) from None
        if base64.b64encode(hashlib.sha512(temporary.read_bytes()).digest()).decode() != INTEGRITY:
            raise UserError(f"{package or NAME} is not {PACKAGE} {VERSION}: its SHA-512 differs")
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
        raise UserError(f"{PACKAGE}, which runs networks in a browser, is not set up: run once `relight web setup`")
    try:
        with tarfile.open(package) as archive:
            for name in FILES:
                file = archive.extractfile(f"package/dist/{name}")
                if file is None:
                    raise KeyError(name)
                (folder / name).write_bytes(file.read())
    except (tarfile.TarError, EOFError, KeyError):
        raise UserError(f"{package} is damaged: run `relight web setup` again") from None
    return [folder / name for name in FILES]
