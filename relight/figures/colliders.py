"""Warp's session and device, and surfaces that other things are measured against or kept out of."""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import warp as wp
from platformdirs import user_cache_path

from relight.figures.kernels import find_below, first_hit
from relight.figures.surfaces import normals
from relight.files import UserError

wp.config.log_level = wp.LOG_ERROR
DEVICES = ("cpu", "cuda", "auto")


def prepare() -> None:
    """Compiled kernels are kept in relight's cache folder (moved by RELIGHT_CACHE)."""
    folder = os.environ.get("RELIGHT_CACHE") or user_cache_path("relight")
    wp.config.kernel_cache_dir = os.path.join(str(folder), "warp")
    with quiet():
        wp.init()
    wp.set_device("cpu")


@contextmanager
def quiet() -> Iterator[None]:
    """Holds back what Warp's native code writes to stderr where there is no GPU: the drape runs on the CPU anyway."""
    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            os.write(2, b"".join(line for line in file if b"CUDA driver" not in line))


def working(device: str) -> wp.ScopedDevice:
    """A context in which cloth is worked on `device`: cpu | cuda | auto (cuda where there is a GPU). Raises UserError
    for another name, and for cuda without a GPU."""
    if device not in DEVICES:
        raise UserError(f"figures.device is {device!r}; it must be one of {', '.join(DEVICES)}")
    prepare()
    found = wp.is_cuda_available()
    if device == "cuda" and not found:
        raise UserError("figures.device is cuda, but there is no usable NVIDIA GPU here; cpu or auto would do")
    return wp.ScopedDevice("cuda" if found and device != "cpu" else "cpu")


def vectors(values: np.ndarray) -> wp.array:
    """Points (n,3) as an array of Warp."""
    return wp.array(np.ascontiguousarray(values, np.float32), dtype=wp.vec3)


class Collider:
    """A closed or open surface (V,3), (F,3) that moves from `before` to `after` during a frame. What is nearest is
    looked for on `before`, where cloth still is: limbs move further in a frame than they are thick."""

    def __init__(self, before: np.ndarray, after: np.ndarray, faces: np.ndarray):
        self.corner: wp.array = wp.array(faces.astype(np.int32).ravel(), dtype=int)
        self.before, self.after = vectors(before), vectors(after)
        self.normal = vectors(normals(after, faces))
        self.mesh = wp.Mesh(points=self.before, indices=self.corner)

    def nearest(self, points: np.ndarray, far: float) -> tuple[np.ndarray, np.ndarray]:
        """For points (n,3): the face (n,) nearest to each, -1 beyond `far`, and its barycentric weights (n,3)."""
        face = wp.zeros(len(points), dtype=int)
        at = wp.zeros(len(points), dtype=wp.vec2)
        wp.launch(find_below, dim=len(points), inputs=[self.mesh.id, vectors(points), far, face, at])
        weights = at.numpy().astype(float)
        return face.numpy(), np.c_[weights, 1 - weights.sum(1)]

    def cast(self, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The first face (n,) that rays (n,3), (n,3) meet, -1 for none, and how far (n,) it is, infinite for none."""
        face = wp.zeros(len(origin), dtype=int)
        depth = wp.zeros(len(origin), dtype=float)
        wp.launch(first_hit, dim=len(origin), inputs=[self.mesh.id, vectors(origin), vectors(direction), face, depth])
        return face.numpy(), np.where(face.numpy() >= 0, depth.numpy().astype(float), np.inf)
