"""The networks of the built-in masks: MediaPipe's, of Google, taken from its Python package, whose code is not needed.

All come under Apache-2.0: selfie segmentation (relight.photos.mask.selfie) and pose (relight.photos.mask.pose).
"""

import hashlib
import subprocess
import sys
import tempfile
import zipfile
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from relight.core.errors import UserError
from relight.core.files import atomic_write, data_folder, existing_file
from relight.photos.network import open_session

PACKAGE, VERSION = "mediapipe", "0.10.21"
WHEEL = ("--python-version", "3.11", "--platform", "manylinux_2_28_x86_64", "--only-binary", ":all:")  # unpacked only
LICENSE = f"{PACKAGE}-{VERSION}.dist-info/LICENSE"


class Source(NamedTuple):
    """A network in the wheel: its folder there, its SHA-256, names of its first outputs, whether it is mirrored."""

    folder: str
    digest: str
    outputs: str
    mirrored: bool = False


SELFIE, DETECTOR, LANDMARKS = "selfie_segmentation", "pose_detection", "pose_landmark_full"
NETWORKS = {
    SELFIE: Source(SELFIE, "9ee168ec7c8f2a16c56fe8e1cfbc514974cbbb7e434051b455635f1bd1462f5c", "mask", mirrored=True),
    DETECTOR: Source(DETECTOR, "9ba9dd3d42efaaba86b4ff0122b06f29c4122e756b329d89dca1e297fd8f866c", "boxes scores"),
    LANDMARKS: Source(
        "pose_landmark", "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f", "points presence mask"
    ),
}


def network_file(name: str) -> Path:
    """Returns the path of one of NETWORKS in the data folder, once it is set up."""
    return data_folder() / "masks" / f"{name}.onnx"


def license_file() -> Path:
    """Returns the path of the networks' licence, beside them."""
    return network_file(SELFIE).with_name("LICENSE")


def is_set_up() -> bool:
    """Returns whether all networks are there."""
    return all(network_file(name).is_file() for name in NETWORKS)


def setup(wheel: Path | str | None = None) -> Path:
    """Puts the networks into the user's data folder, with their licence beside them.

    Args:
        wheel: a file of mediapipe, of any platform; by default pip downloads it (36 MB) to a temporary folder.

    Returns:
        The folder.

    Raises:
        UserError: if they cannot be had, or a hash is not that of the version known here.
    """
    if wheel is not None:
        return _unpack(existing_file(wheel, "--from"))
    with tempfile.TemporaryDirectory() as temporary:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", *WHEEL, "--dest", temporary]
        done = subprocess.run([*command, f"{PACKAGE}=={VERSION}"], capture_output=True, text=True, check=False)
        found = next(Path(temporary).glob("*.whl"), None)
        if done.returncode or found is None:
            reason = (done.stderr.strip().splitlines() or ["no wheel came"])[-1].removeprefix("ERROR: ")
            raise UserError(
                f"pip could not download {PACKAGE} {VERSION} ({reason}): run `pip download --no-deps {' '.join(WHEEL)} "
                f"{PACKAGE}=={VERSION}` where there is a network, then `relight mask setup --from FILE.whl`"
            )
        return _unpack(found)


def _unpack(wheel: Path) -> Path:
    """Converts the networks in a wheel to .onnx, writes them with their license, and returns their folder."""
    from relight.photos.mask.tflite import convert

    files = {}
    try:
        with zipfile.ZipFile(wheel) as archive:
            files[license_file()] = archive.read(LICENSE)
            for name, (folder, digest, outputs, mirrored) in NETWORKS.items():
                member = f"{PACKAGE}/modules/{folder}/{name}.tflite"
                data = archive.read(member)
                if hashlib.sha256(data).hexdigest() != digest:
                    raise UserError(f"{member} in {wheel} is not that of {PACKAGE} {VERSION}: its SHA-256 differs")
                files[network_file(name)] = convert(data, outputs.split(), mirrored)
    except (zipfile.BadZipFile, KeyError):
        raise UserError(f"{wheel} is no wheel of {PACKAGE} {VERSION}, or of a platform without its networks") from None
    for path, data in files.items():
        with atomic_write(path) as temporary:
            temporary.write_bytes(data)
    return license_file().parent


@cache
def load_network(name: str) -> Any:
    """Opens one of NETWORKS, once in a process.

    Raises:
        UserError: if it is damaged.
    """
    try:
        return open_session(network_file(name), threads=1)
    except UserError:
        raise UserError(f"{network_file(name)} is damaged: run `relight mask setup` again") from None
