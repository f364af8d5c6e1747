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
    archive = fetch(PACKAGE, package)
    with atomic_folder(panorama_folder()) as temporary:
        try:
            with tarfile.open(fileobj=io.BytesIO(archive)) as members:
                for name in NAMES:
                    (temporary / f"{name}.exr").write_bytes(_decode(_read(members, f"package/hdri/{name}.exr.js")))
                (temporary / "LICENSE").write_bytes(_read(members, "package/LICENSE"))
        except (tarfile.TarError, EOFError, KeyError, ValueError) as error:
            raise UserError(f"{package or PACKAGE.file_name} is not {PACKAGE.name}: {error}") from None
    return panorama_folder()


def _read(archive: tarfile.TarFile, name: str) -> bytes:
    """Returns the content of a member of an archive; raises KeyError if there is none, or if it is no file."""
    file = archive.extractfile(name)
    if file is None:
        raise KeyError(f"{name} is not a file")
    return file.read()


def _decode(module: bytes) -> bytes:
    """Returns the file that a module of JavaScript holds as a data address in base64; raises ValueError for none."""
    _, found, data = module.partition(b";base64,")
    if not found:
        raise ValueError("a panorama holds no data")
    return base64.b64decode(data.rstrip(b"'\"; \n"), validate=True)


def panorama_file(name: str) -> Path:
    """Returns the file of a panorama of NAMES; a repair rebuilds the suns of park and sunrise, stored without red.

    Raises:
        UserError: if the panoramas are not set up.
    """
    path = panorama_folder() / f"{name}.exr"
    if not path.is_file():
        raise UserError(f"the panorama {name!r} is not set up: run once `{PACKAGE.command}`")
    return path
