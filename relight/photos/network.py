"""The network for photos as one graph, an .onnx file that onnxruntime runs: relighting a photo needs no torch."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.files import existing_file, file_hash

INPUTS = ["image", "mask"]
OUTPUTS = ["albedo", "transport", "light"]
METADATA = "relight"  # key of the config in the file's metadata
WEIGHTS = Path(__file__).parent.parent / "weights" / "photo.onnx"


@dataclass(frozen=True)
class PhotoNetwork:
    """A network that is ready for photos.

    Attributes:
        size: S, the side of its images in pixels.
        config: settings of its training, by group: `model`, `train`, `augment`, and `lights` if known.
        digest: SHA-256 of its file.
        run: image (B,3,S,S) linear in [0,1] and mask (B,1,S,S) float32 -> albedo (B,3,S,S), transport (B,K,S,S) and
            light (B,K,3), averaged with the mirror image; maps are zero outside the mask.
    """

    size: int
    config: dict[str, Any]
    digest: str
    run: Callable[[np.ndarray, np.ndarray], list[np.ndarray]]

    @property
    def order(self) -> int:
        """The order of the spherical harmonics of transport and light: K = (order + 1)^2."""
        return int(self.config["model"]["order"])

    @property
    def stops(self) -> float:
        """By which the training made its lights brighter at most."""
        return float(self.config.get("augment", {}).get("exposure", [0.0])[-1])

    def infer(self, image: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns albedo (S,S,3), transport (S,S,K) and light (K,3), float32, of an image (S,S,3) and a mask (S,S)."""
        planes = np.ascontiguousarray(np.moveaxis(image, -1, 0)[None], np.float32)
        albedo, transport, light = self.run(planes, np.asarray(mask, np.float32)[None, None])
        return np.moveaxis(albedo[0], 0, -1), np.moveaxis(transport[0], 0, -1), light[0]


def read_network(path: Path | str | None = None, threads: int = 0) -> PhotoNetwork:
    """Reads a network that `relight export` wrote.

    Args:
        path: the .onnx file; by default the network that comes with the package.
        threads: number of threads of the inference; 0 for one per core.

    Raises:
        UserError: if there is no such file, or it holds no network of relight.
    """
    if path is None and not WEIGHTS.is_file():
        raise UserError("this installation has no weights: give a network with --weights FILE")
    path = existing_file(path or WEIGHTS, "network")
    if path.suffix == ".safetensors":
        raise UserError(f"{path} is a checkpoint: `relight export {path.name} {path.stem}.onnx` writes its network")
    if path.suffix != ".onnx":
        raise UserError(f"{path} is no network of relight: give an .onnx file that `relight export` wrote")
    session = open_session(path, threads)
    try:
        config = json.loads(session.get_modelmeta().custom_metadata_map[METADATA])
        size = int(config["size"])
    except (KeyError, ValueError, TypeError, RecursionError):
        raise UserError(f"{path} holds no network of relight: give one that `relight export` wrote") from None

    def run(image: np.ndarray, mask: np.ndarray) -> list[np.ndarray]:
        return session.run(OUTPUTS, dict(zip(INPUTS, (image, mask))))

    return PhotoNetwork(size, config, file_hash(path), run)


def open_session(path: Path, threads: int = 0) -> Any:
    """Opens an .onnx file in onnxruntime on the CPU, with a number of threads, 0 for one per core.

    Idle threads sleep: by default onnxruntime's wait in a loop, which costs CPU time and gains nothing here.

    Raises:
        UserError: if it is damaged, or of a version that onnxruntime does not know.
    """
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # before the import, which writes an id and a database of events
    import onnxruntime

    if hasattr(onnxruntime, "disable_telemetry_events"):  # where another program has imported it
        onnxruntime.disable_telemetry_events()
    np.ones((99, 99)) @ np.ones((99, 99))  # OpenBLAS takes its memory once, and ends the program where it finds none
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 4  # fatal errors only
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own kinds have no common base
        raise UserError(f"{path} cannot be read as a network ({str(error).splitlines()[0]})") from None
