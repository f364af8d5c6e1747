"""Disks that are full, and folders that cannot be written: one line each, the old file kept, nothing left behind."""

import errno
import mmap
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import readers
import torch
from namespaces import mounted, namespaced
from samples import mesh_of, random_maps

from relight.core.errors import UserError, sentence_of
from relight.core.files import existing_file, system_errno, write_text
from relight.learning.checkpoint import restore_state, save_network, save_state
from relight.learning.networks import build
from relight.lights import Light, write_light
from relight.maps import pack_maps, write_maps
from relight.meshes import Material, list_scans, read_mesh
from relight.panoramas import list_panoramas, read_panorama
from relight.pictures.opening import list_photos
from relight.settings import ROOT, Model

MODEL = Model(name="unet", width=0.1, norm="batch", dropout=0.0, order=1, albedo="clip", light_head="pooled",
              refine=False, sees="image")  # fmt: skip


def writers(folder: Path) -> dict:
    """What writes results, as functions of a path; what they read is made in `folder`."""
    rng, maps = np.random.default_rng(0), random_maps("a", 32)
    write_maps(folder / "a.exr", maps)
    mesh = mesh_of(np.eye(3), [0, 1, 2], materials=[Material(texture=rng.integers(0, 256, (64, 64, 3), np.uint8))])
    network = build(MODEL, 64)
    return {
        "maps.exr": lambda path: write_maps(path, maps),
        "mesh.npz": mesh.save,
        "packed.safetensors": lambda path: pack_maps([folder / "a.exr"], path),
        "network.safetensors": lambda path: save_network(path, network, MODEL),
        "state.pt": lambda path: save_state(path, "digest", {"network": network}, 1, []),
        "light.json": lambda path: write_light(Light(rng.random((9, 3)), "test"), path),
    }


@contextmanager
def ordinary():
    """The rights of nobody where root runs the tests, whom no permission stops."""
    if os.geteuid():
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


@pytest.fixture
def shared() -> Iterator[Path]:
    """A folder that everybody may enter; pytest's are for its user alone."""
    with TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        yield Path(folder)


def test_a_folder_that_is_not_ones_own_is_told(shared):
    for name, writes in writers(shared).items():
        (folder := shared / "of others").mkdir()
        writes(folder / name)
        old = (folder / name).read_bytes()
        os.chmod(folder, 0o555)
        with ordinary(), pytest.raises(UserError) as error:
            writes(folder / name)
        assert str(error.value) == f"{folder / name} cannot be written: permission denied"
        assert (folder / name).read_bytes() == old and [path.name for path in folder.iterdir()] == [name]
        os.chmod(folder, 0o755)
        shutil.rmtree(folder)


def test_a_file_that_is_not_ones_own_is_told(shared):
    os.chmod(shared, 0o777)  # one of them writes a file beside
    for reader, paths in readers.write_whole(shared).items():
        read = getattr(readers, reader)
        read(str(paths[0]))
        for beside in shared.glob("names.*"):
            beside.unlink()
        os.chmod(paths[0], 0)
        with ordinary(), pytest.raises(UserError) as error:
            read(str(paths[0]))
        os.chmod(paths[0], 0o644)
        told = str(error.value)
        assert "\n" not in told and f"{paths[0].name} cannot be read: permission denied" in told, (reader, told)


@pytest.mark.parametrize("listed", [list_scans, list_panoramas, list_photos, read_mesh, read_panorama])
def test_what_is_not_ones_own_is_not_called_empty_or_missing(shared, listed):
    place = shared / ("a.obj" if listed is read_mesh else "a.hdr" if listed is read_panorama else "folder")
    place.mkdir() if place.name == "folder" else place.write_text("v 0 0 0\n")
    os.chmod(place, 0)
    with ordinary(), pytest.raises(UserError, match=f"{place} cannot be read: permission denied"):
        listed(place)


def test_a_refusal_is_known_through_any_library():
    hidden = RuntimeError("unexpected pos 64 vs 0")
    hidden.__context__ = OSError(errno.ENOSPC, "x")
    assert system_errno(hidden) == system_errno(ValueError("I/O error: (os error 28)")) == errno.ENOSPC
    assert system_errno(RuntimeError("Read-only file system: a.exr")) == errno.EROFS
    assert system_errno(ValueError("shape")) is None and system_errno(OSError(errno.EINTR, "x")) is None


# In a mount namespace of its own: `place` is a file system of four megabytes.
FULL = """
import sys
from pathlib import Path
sys.path[:0] = [sys.argv[1], str(Path(sys.argv[1]).parent)]
import os, subprocess, numpy as np
from test_disk import writers
from relight.core.errors import UserError
inputs, place = Path(sys.argv[2]), Path(sys.argv[3])
write, rng = writers(inputs), np.random.default_rng(1)
def told(name, why):
    try:
        write[name](place / name)
    except UserError as error:
        assert str(error) == f"{place / name} cannot be written: {why}", error
        return True
    return False
failed = 0
for name in write:
    write[name](place / name)
    old = (place / name).read_bytes()
    for size in rng.integers(0, len(old), 4):
        free = os.statvfs(place).f_bavail * os.statvfs(place).f_bsize
        (place / "ballast").write_bytes(bytes(max(0, free - int(size))))
        failed += told(name, "no space left on device")
        assert (place / name).read_bytes() == old, name
        assert {path.name for path in place.iterdir()} == {name, "ballast"}, name
        (place / "ballast").unlink()
    (place / name).unlink()
assert failed > 12, failed
subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
assert all(told(name, "read-only file system") for name in write)
"""


@pytest.mark.slow
@pytest.mark.skipif(not namespaced(), reason="no mount namespaces here")
def test_full_and_read_only_disks(tmp_path):
    """Four random amounts of free space for each writer, then a disk that is read-only."""
    (inputs := tmp_path / "inputs").mkdir()
    (place := tmp_path / "disk").mkdir()
    command = [*mounted(f"-o size=4m none {place}"), sys.executable, "-c", FULL, str(Path(__file__).parent)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run([*command, str(inputs), str(place)], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]


def test_a_state_that_is_damaged_begins_anew(tmp_path):
    for content in (b"", b"no state", b"PK\x03\x04" + bytes(100)):
        (path := tmp_path / "state.pt").write_bytes(content)
        step, history, told = restore_state(path, "digest", {}, "cpu")
        assert (step, history) == (0, []) and "cannot be read" in told and "beginning" in told


def misread():
    try:
        np.empty(1 << 50)
    except MemoryError:
        raise UserError("photo a.jpg is damaged or cut short") from None


# what fails for lack of memory, or not -> the beginning of what is said
FAILURES = {
    "numpy": (lambda: np.empty(1 << 50), "there is not enough memory (Unable to allocate"),
    "torch": (lambda: torch.empty(1 << 58), "there is not enough memory ("),
    "the system": (lambda: os.posix_fallocate(-1, 0, 1), None),
    "a mapping": (lambda: mmap.mmap(-1, 1 << 61), "there is not enough memory ([Errno 12] Cannot allocate memory)"),
    "what was read is called damaged": (misread, "there is not enough memory (Unable to allocate"),
    "a user's error": (lambda: existing_file("no.jpg", "photo"), "photo: there is no file no.jpg"),
    "a file's name": (lambda: existing_file("out of memory.jpg", "photo"), "photo: there is no file out of memory.jpg"),
    "a mistake of ours": (lambda: [][1], None),
}


@pytest.mark.parametrize("name", FAILURES)
def test_what_lacks_memory_says_so(name):
    fail, says = FAILURES[name]
    with pytest.raises(Exception) as error:
        fail()
    said = sentence_of(error.value)
    assert said is None if says is None else said.startswith(says)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="Linux only")
def test_a_photo_with_too_little_memory_is_one_line(tmp_path):
    words = f"exec {sys.executable} -m relight.cli photo relight/viewer/web/astronaut.jpg --out {tmp_path}/a"
    limited = ["bash", "-c", f"ulimit -v 560000; {words}"]
    done = subprocess.run(limited, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1 and "relight: there is not enough memory" in done.stderr, done.stderr[-2000:]
    assert "Traceback" not in done.stderr and not [*tmp_path.iterdir()]


def test_a_name_that_is_no_text_is_spelled_in_what_is_written(tmp_path):
    write_text(tmp_path / "page.html", os.fsdecode("Zoë ".encode() + b"\xff.jpg"))
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "Zoë \\udcff.jpg"
