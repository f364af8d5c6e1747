"""A static site with the viewer in which photos are opened, masked and inferred in the browser."""

import hashlib
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.core.files import atomic_folder, file_hash
from relight.photos.mask.networks import SELFIE, license_file, network_file
from relight.viewer import runtime
from relight.viewer.build import Additions, build_viewer
from relight.viewer.bundle import bundle
from relight.viewer.figure import Figure

FILES = {*runtime.FILES, *"index.html network.onnx mask.onnx mask.LICENSE.txt LICENSES.txt README.md sw.js".split()}
STUDIO = Path(__file__).parent / "web" / "studio"
# To load the site's own files. Before it reads a photo, the page adds a policy without `connect-src` (engine.js).
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; connect-src 'self'; worker-src 'self' blob:; base-uri 'none'; form-action 'none'"
)


def build_site(
    out: Path, network: Path, size: int, figures: Sequence[Figure], lights: Mapping[str, np.ndarray]
) -> None:
    """Writes the site into the folder `out`, which is replaced as a whole.

    Where `relight mask setup` has been run, the user's copy of its network goes along, with its licence.

    Args:
        out: a folder that is new, empty, or a site of this function.
        network: .onnx file of a network for photos (`train.color=photo`); of higher orders, bands 0 to 2 are shown.
        size: S, of the network's images in pixels.
        figures: what the page offers before a photo is opened, in the order shown; at least one.
        lights: radiance coefficients (9,3) by name, in the order shown.

    Raises:
        UserError: if the folder is the current one or holds anything else, onnxruntime-web is not set up, the figures
            do not fit the page, or there is no figure or light.
    """
    if out.exists() and not out.is_dir():
        raise UserError(f"web: {out} is a file: give a folder")
    if out.resolve() == Path.cwd():
        raise UserError(f"web: {out} is the folder that you are in: give one in it, since it is replaced, or go up")
    found = {path.name for path in out.iterdir()} if out.is_dir() else set()
    if found and (others := found if "network.onnx" not in found else found - FILES):
        raise UserError(f"web: the folder {out} holds other files ({min(others)}): give a new or an empty one")
    with atomic_folder(out) as folder:
        shutil.copyfile(network, folder / "network.onnx")
        files = [*runtime.unpack(folder), folder / "network.onnx"]
        if network_file(SELFIE).is_file():
            shutil.copyfile(network_file(SELFIE), folder / "mask.onnx")
            shutil.copyfile(license_file(), folder / "mask.LICENSE.txt")
            files.append(folder / "mask.onnx")
        known = [{"name": path.name, "bytes": path.stat().st_size, "sha256": file_hash(path)} for path in files]
        parts = (STUDIO / "style.css", STUDIO / "stage.html", STUDIO / "panel.html")
        style, stage, panel = (part.read_text(encoding="utf-8") for part in parts)
        worker, settings = bundle(STUDIO / "worker.js"), {"web": {"size": size, "files": known}}
        additions = Additions(STUDIO / "studio.js", POLICY, style, stage, panel, worker, settings)
        build_viewer(folder / "index.html", figures, lights, title="Turn the light in a photo", additions=additions)
        shutil.copyfile(STUDIO / "licenses.txt", folder / "LICENSES.txt")
        shutil.copyfile(STUDIO / "space.md", folder / "README.md")  # its header makes a Space of a model hub of it
        version = hashlib.sha256("".join(map(file_hash, sorted(folder.iterdir()))).encode())
        # The service worker's version is a hash of all other files, so that browsers notice a site that was made anew.
        service = (STUDIO / "sw.js").read_text(encoding="utf-8")
        (folder / "sw.js").write_text(service.replace("%version%", version.hexdigest()[:16]), encoding="utf-8")
