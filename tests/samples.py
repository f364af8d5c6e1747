"""Meshes, files and sets of lights of which a test cares for one property."""

import json
import struct
from collections.abc import Sequence

import numpy as np

from relight.lights import LightSet
from relight.meshes import Material, Mesh


def mesh_of(vertices, faces, **fields) -> Mesh:
    """A mesh of vertices (V,3) and faces (F,3), of one white material and without texture coordinates unless `fields`
    of the mesh give others."""
    faces = np.asarray(faces, np.int32).reshape(-1, 3)
    usual = {"uv": np.zeros((len(faces), 3, 2), np.float32), "material": np.zeros(len(faces), np.int16)}
    return Mesh(np.asarray(vertices, np.float32), faces, **{**usual, "materials": [Material()], **fields})


def glb_of(scene: dict, data: bytes = b"", pad: bytes = b" ", version: int = 2) -> bytes:
    """A binary glTF file of a description, which is padded, and of the bytes of its buffer."""
    text = json.dumps(scene).encode()
    text, data = text + pad * (4 + -len(text) % 4), data + b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return b"glTF" + struct.pack("<II", version, 12 + len(chunks)) + chunks


def lights_of(split: Sequence[str], **fields) -> LightSet:
    """White lights of radiance alike from everywhere, of generated rooms as they are, unless `fields` of the set give
    others."""
    count = np.arange(len(split))
    coefficients = np.zeros((len(split), 9, 3), np.float32)
    coefficients[:, 0] = 1
    usual = {"source": np.array([f"room:{i}" for i in count]), "reason": np.full(len(split), ""), "yaw": 0.0 * count}
    usual |= {"coefficients": coefficients, "seed": count, "cluster": count, "scale": 1.0 + 0 * count}
    return LightSet(split=np.array(split), **{**usual, **fields})
