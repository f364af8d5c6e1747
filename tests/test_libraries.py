"""The system libraries of Open3D and PyMeshLab: which they are, and how they are found."""

import re
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest

from relight.core import libraries
from relight.core.errors import UserError

NEEDS = {
    "libEGL.so.1": ["libGLdispatch.so.0"], "libGL.so.1": ["libGLdispatch.so.0", "libGLX.so.0"],
    "libOpenGL.so.0": ["libGLdispatch.so.0"], "libGLX.so.0": ["libX11.so.6", "libGLdispatch.so.0"],
    "libX11.so.6": ["libxcb.so.1"], "libxcb.so.1": ["libXau.so.6", "libXdmcp.so.6"],
    "libXdmcp.so.6": ["libbsd.so.0"], "libbsd.so.0": ["libmd.so.0"],
}  # fmt: skip
ALL = sorted({*libraries.LIBRARIES, *NEEDS, *(name for names in NEEDS.values() for name in names)})


def needs(name: str) -> set[str]:
    return {name}.union(*(needs(other) for other in NEEDS.get(name, [])))


@pytest.mark.parametrize("lacking", ["nothing", *ALL])
def test_libraries_of_the_folder_are_loaded_after_those_that_they_need(tmp_path, monkeypatch, lacking):
    """By a loader as glibc's: it finds names of what is loaded alone, and names the first that it lacks."""
    loaded = set()

    def load(path):
        for name in [*NEEDS.get(Path(path).name, []), *([] if "/" in path else [path])]:
            if name not in loaded:
                raise OSError(f"{name}: cannot open shared object file: No such file or directory")
        loaded.add(Path(path).name)

    monkeypatch.setattr(libraries.ctypes, "CDLL", load)
    for name in {*ALL} - {lacking}:
        (tmp_path / name).touch()
    assert libraries.missing(tmp_path) == [name for name in libraries.LIBRARIES if lacking in needs(name)]
    assert loaded <= {name for name in ALL if lacking not in needs(name)}


def test_a_missing_library_is_one_sentence(monkeypatch):
    monkeypatch.setitem(libraries.LIBRARIES, "libnone.so.9", "libnone9 libother1")
    with pytest.raises(UserError, match=r"^open3d needs libnone\.so\.9: `apt-get install libnone9`, as root"):
        libraries.with_libraries("open3d")


FILTERS = ["libfilter_clean.so", "libfilter_meshing.so", "libfilter_measure.so"]  # plugins of PyMeshLab's in use
EVERYWHERE = ("ld-linux", "libc.", "libdl.", "libgcc_s.", "libm.", "libpthread.", "libresolv.")
EVERYWHERE += ("libstdc++.", "libz.")  # on each Linux with Python


@pytest.mark.skipif(not shutil.which("readelf"), reason="needs readelf, of binutils")
def test_they_are_those_that_the_packages_link_to():
    outside = set()
    for package, module, plugins in (("open3d", "pybind", []), ("pymeshlab", "pmeshlab", FILTERS)):
        files = {path.name: path for path in Path(find_spec(package).origin).parent.rglob("*.so*")}
        own, seen = {*files}, set()
        pending = [*plugins, *(name for name in files if name.startswith(f"{module}."))]
        while pending:
            seen.add(name := pending.pop())
            if name in files:
                shown = subprocess.run(["readelf", "-d", files.pop(name)], capture_output=True, text=True, check=True)
                pending += re.findall(r"\(NEEDED\).*\[(.*)\]", shown.stdout)
        assert len(seen) > 10
        outside |= {name for name in seen - own if not name.startswith(EVERYWHERE)}
    assert outside == {*libraries.LIBRARIES}
