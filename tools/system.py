"""Makes .venv with pip in it, and gets the system libraries that are missing. Standard library only.

As root, apt-get installs them. Without root, it downloads their packages, and .venv/lib gets the libraries in them.
"""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

PYTHONS = ((3, 11), (3, 13))  # the oldest and the newest that relight runs on
PYTHON, PIP, LIB = (Path(".venv", name) for name in ("bin/python", "bin/pip3", "lib"))
WHEEL = "usr/share/python-wheels/pip-*.whl"  # of Debian, whose Python has no ensurepip


def main() -> None:
    """Ends with a sentence and exit code 1 if Python has another version, or no pip."""
    major, minor = sys.version_info[:2]
    if not PYTHONS[0] <= (major, minor) <= PYTHONS[1]:
        names = " to ".join(".".join(map(str, version)) for version in PYTHONS)
        advice = "delete .venv, and " * PYTHON.exists() + "make PYTHON=python3.12"
        sys.exit(f"relight needs Python {names}, and {sys.executable} is {major}.{minor}: {advice}")
    from relight.core.libraries import LIBRARIES, missing, remedy

    if not PYTHON.exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", "--without-pip", ".venv"], check=True)
    packages = [LIBRARIES[name] for name in missing(LIB)]
    if not (PIP.exists() or find_spec("ensurepip")):
        packages.append("python3-pip-whl")
    with TemporaryDirectory() as folder:
        if packages and shutil.which("apt-get"):
            get(packages, Path(folder))
        if not PIP.exists():
            subprocess.run([PYTHON, *pip(Path("/"), Path(folder))], stdout=subprocess.DEVNULL, check=True)
    if names := missing(LIB):
        print(f"going on without {', '.join(names)}: `relight run`, `bake` and `scans` will not work; {remedy(names)}")


def pip(*roots: Path) -> list[str]:
    """Returns the arguments with which Python installs pip: the one that came with it, or else a distribution's."""
    if find_spec("ensurepip"):
        return ["-m", "ensurepip"]
    wheels = [str(path) for root in roots for path in root.glob(WHEEL)]
    if not wheels:
        sys.exit(f"relight needs pip, and {sys.executable} has no ensurepip: install python3-venv")
    return [f"{wheels[0]}/pip", "install", "--no-index", wheels[0]]


def get(packages: list[str], folder: Path) -> None:
    """Installs Debian packages, each with those that it needs after it, or unpacks them into the folder, if it can."""
    apt, names = ["apt-get", "-qq", "-o", "Acquire::Languages=none"], [line.split()[0] for line in packages]
    print("installing" if os.geteuid() == 0 else "unpacking into .venv, without root:", *names, flush=True)
    if os.geteuid() == 0:
        subprocess.run([*apt, "update"])
        install = [*apt, "install", "-y", "--no-install-recommends", *names]
        subprocess.run(install, stdout=subprocess.DEVNULL, env={**os.environ, "DEBIAN_FRONTEND": "noninteractive"})
        return
    (folder / "partial").mkdir()
    apt += ["-o", f"Dir::State::Lists={folder}", "-o", f"Dir::Cache={folder}"]
    subprocess.run([*apt, "update"])
    subprocess.run([*apt, "download", *" ".join(packages).split()], cwd=folder)
    for package in folder.glob("*.deb"):
        subprocess.run(["dpkg-deb", "--extract", package, folder], check=True)
    for libraries in folder.glob("**/lib/*-linux-gnu*"):
        subprocess.run(["cp", "-a", f"{libraries}/.", LIB], check=True)


if __name__ == "__main__":
    main()
