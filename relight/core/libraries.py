"""The system libraries that Open3D and PyMeshLab link to. Standard library only: `make` runs it before it installs."""

import ctypes
import platform
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from relight.core.errors import UserError

# With the Debian package of each, and then those of what it links to.
LIBRARIES = {
    "libEGL.so.1": "libegl1 libglvnd0",
    "libGL.so.1": "libgl1 libglvnd0 libglx0",
    "libOpenGL.so.0": "libopengl0 libglvnd0",
    "libX11.so.6": "libx11-6 libxcb1 libxau6 libxdmcp6 libbsd0 libmd0",
    "libcom_err.so.2": "libcom-err2",
    "libidn2.so.0": "libidn2-0 libunistring?",
    "libudev.so.1": "libudev1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
FOLDER = Path(sys.prefix, "lib")  # of the environment: conda puts libraries there, and `make` without root


def with_libraries(package: str) -> Any:
    """Imports a package that links to the system libraries, open3d or pymeshlab, and returns it.

    Raises:
        UserError: if a library is missing. (PyMeshLab could be imported, but silently without some of its filters.)
    """
    if names := missing():
        raise UserError(f"{package} needs {', '.join(names)}: {remedy(names)}")
    return import_module(package)


def missing(folder: Path = FOLDER) -> list[str]:
    """Loads the libraries, and returns the names of those that neither the system nor the folder has.

    A library that is loaded is found by its name when another one links to it, wherever it lies.
    """
    return [name for name in LIBRARIES if platform.system() == "Linux" and not _load(name, folder)]


def remedy(names: list[str]) -> str:
    """Returns, in words, what brings these libraries."""
    packages = " ".join(LIBRARIES[name].split()[0] for name in names)
    return f"`apt-get install {packages}`, as root on Debian or Ubuntu, brings them, and conda by environment.yml"


def _load(name: str, folder: Path) -> bool:
    """Loads a library, from the folder if the system lacks it or what it links to; returns whether that worked."""
    wanted = [name]
    while wanted:
        try:
            ctypes.CDLL(wanted[-1])
            wanted.pop()
        except OSError as error:  # its text begins with the library that the system's loader did not find
            path = folder / str(error).partition(":")[0]
            if str(path) in wanted or not path.exists():
                return False
            wanted.append(str(path))
    return True
