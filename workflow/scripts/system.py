"""Checks the system libraries that `make` needs; standard library only.

Without them, Open3D cannot be imported, and pymeshlab silently lacks readers. Missing packages are installed as root on
Debian or Ubuntu; otherwise the command is printed.
"""

import ctypes
import os
import platform
import shutil
import subprocess
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
PYTHONS = ((3, 11), (3, 13))


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
    found = sys.version_info[:2]
    if not PYTHONS[0] <= found <= PYTHONS[1]:
        names = " to ".join(".".join(map(str, version)) for version in PYTHONS)
        sys.exit(f"relight needs Python {names}, and {sys.executable} is {found[0]}.{found[1]}: make PYTHON=python3.12")
    packages = missing()
    if not packages:
        return
    apt = shutil.which("apt-get")
    line = f"apt-get install -y --no-install-recommends {' '.join(packages)}"
    if not apt:
        sys.exit(f"relight needs these system libraries (Debian's names): {' '.join(packages)}")
    if os.geteuid() != 0:
        sys.exit(f"relight needs system packages; type:\n    sudo {line}")
    print(f"installing system packages: {' '.join(packages)}", flush=True)
    quiet = {"stdout": subprocess.DEVNULL, "env": {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}}
    subprocess.run([apt, "update", "-qq"], check=False, **quiet)
    if subprocess.run([apt, *line.split()[1:]], check=False, **quiet).returncode:
        sys.exit(f"the installation of system packages failed; type:\n    {line}")
    # Only a new process finds new libraries.
    left = subprocess.run(
        [sys.executable, __file__, "--list"], capture_output=True, text=True, check=False
    ).stdout.split()
    if left:
        sys.exit(f"these system packages are still missing: {' '.join(left)}")


if __name__ == "__main__":
    if "--list" in sys.argv:
        print(*missing())
    else:
        main()
