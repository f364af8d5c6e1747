"""Eighteen panoramas by Poly Haven (CC0), 512 x 256, by name once `setup` took them from the package @pmndrs/assets."""

import base64
import io
import tarfile
from pathlib import Path

from relight.core.download import Package, fetch
from relight.core.errors import UserError
from relight.core.files import atomic_folder, data_folder

INTEGRITY = "zHmKNS+3Jvu9K3zJBQfYQKT9Pn9IQt8s0q/eJC3CXKpWpyg6IBa+ivN9NgDn+fDT2AVjUh2YRZ//GXUueuAdCg=="
PACKAGE = Package("@pmndrs/assets", "1.7.0", INTEGRITY, "relight light setup")
NAMES = (
    "apartment", "bridge", "city", "dawn", "esplanade", "forest", "hall", "lab", "lobby", "night", "park", "sky",
    "studio", "sunrise", "sunset", "venice", "warehouse", "workshop",
)  # fmt: skip


def panorama_folder() -> Path:
    """Returns the folder of the panoramas once they are set up."""
    return data_folder() / "panoramas"


def setup(package: Path | str | None = None) -> Path:
    """Puts all panoramas and their licence into the user's data folder, as .exr files.

    Args:
        package: the .tgz file of the package; by default it is downloaded (14 MB, of which 2.8 MB are kept).

    Returns:
        The folder.

    Raises:
        UserError: if the package cannot be had, or is another one.
    """
    archive = io.BytesIO(fetch(PACKAGE, package))
    with atomic_folder(panorama_folder()) as temporary, tarfile.open(fileobj=archive) as members:
        for name in NAMES:
            _, _, data = _read(members, f"hdri/{name}.exr.js").partition(b";base64,")  # a module of JavaScript
            (temporary / f"{name}.exr").write_bytes(base64.b64decode(data.rstrip(b"'\"; \n")))
        (temporary / "LICENSE").write_bytes(_read(members, "LICENSE"))
    return panorama_folder()


def _read(archive: tarfile.TarFile, name: str) -> bytes:
    file = archive.extractfile(f"package/{name}")
    assert file is not None  # `fetch` checked the hash of the archive
    return file.read()


def panorama_file(name: str) -> Path:
    """Returns the file of a panorama of NAMES; a repair rebuilds the suns of park and sunrise, stored without red.

    Raises:
        UserError: if the panoramas are not set up.
    """
    path = panorama_folder() / f"{name}.exr"
    if not path.is_file():
        raise UserError(f"the panorama {name!r} is not set up: run once `{PACKAGE.command}`")
    return path
