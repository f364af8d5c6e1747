"""Checks the system libraries that `make` needs; standard library only.

Without them, Open3D cannot be imported, and pymeshlab silently lacks readers. If some are missing, this prints the
command that installs them on Debian or Ubuntu, and fails; with `--list`, it prints the names of the packages alone.
"""

import ctypes
import platform
import sys

LIBRARIES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libOpenGL.so.0": "libopengl0",
    "libX11.so.6": "libx11-6",
    "libudev.so.1": "libudev1",
    "libidn2.so.0": "libidn2-0",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
PYTHONS = ((3, 11), (3, 13))  # the oldest and the newest that relight runs on


def missing() -> list[str]:
    """Returns the Debian packages of libraries that cannot be loaded and of missing modules."""
    packages = []
    try:
        import ensurepip  # noqa: F401  (Debian keeps it in a package of its own)
    except ImportError:
        packages.append("python3-venv")
    if platform.system() == "Linux":
        for library, package in LIBRARIES.items():
            try:
                ctypes.CDLL(library)
            except OSError:
                packages.append(package)
    return packages


def main() -> None:
    """Ends with what is missing, and exit code 1, if Python has another version or system packages are missing."""
    major, minor = sys.version_info[:2]
    if not PYTHONS[0] <= (major, minor) <= PYTHONS[1]:
        names = " to ".join(".".join(map(str, version)) for version in PYTHONS)
        sys.exit(f"relight needs Python {names}, and {sys.executable} is {major}.{minor}: make PYTHON=python3.12")
    if packages := missing():
        line = f"apt-get install -y --no-install-recommends {' '.join(packages)}"
        sys.exit(f"relight needs system packages; on Debian or Ubuntu, type:\n    sudo {line}")


if __name__ == "__main__":
    if "--list" in sys.argv:
        print(*missing())
    else:
        main()
