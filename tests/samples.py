"""Meshes, files and sets of lights of which a test cares for one property."""

import base64
import hashlib
import io
import json
import os
import shutil
import struct
import tarfile
import zlib
from collections.abc import Sequence
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter
from skimage.metrics import structural_similarity

from relight.lights import LightSet
from relight.maps import Maps
from relight.meshes import Material, Mesh
from relight.photos.render import frames
from relight.sh import unoccluded


class Static(SimpleHTTPRequestHandler):
    """Any static server, which keeps account of what it was asked for, and lets browsers keep it for ten minutes."""

    def log_message(self, *_):
        self.server.asked.append(self.requestline)

    def end_headers(self):
        self.send_header("Cache-Control", "max-age=600")
        super().end_headers()


@contextmanager
def serving(folder):
    """A server of a folder."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Static, directory=folder))
    server.asked, server.url = [], f"http://127.0.0.1:{server.server_port}/"
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()


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


def encoded(image: Image.Image, kind: str, **options) -> bytes:
    """The bytes of a file of a picture."""
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


def png_chunks(*chunks: tuple[bytes, bytes]) -> bytes:
    """Chunks of a PNG, by kind and content."""
    sized = ((struct.pack(">I", len(body)), kind + body) for kind, body in chunks)
    return b"".join(size + chunk + struct.pack(">I", zlib.crc32(chunk)) for size, chunk in sized)


def png_of_size(width: int, height: int) -> bytes:
    """A PNG whose header promises a size, with nearly no pixels."""
    header = struct.pack(">II5B", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + png_chunks((b"IHDR", header), (b"IDAT", zlib.compress(b"\0")), (b"IEND", b""))


def tarball(path: Path, files: dict[str, bytes]) -> str:
    """Writes a package of npm's registry, and returns its integrity."""
    with tarfile.open(path, "w:gz") as archive:
        for name, data in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            archive.addfile(entry, io.BytesIO(data))
    return base64.b64encode(hashlib.sha512(path.read_bytes()).digest()).decode()


def node() -> str:
    """The program that runs JavaScript; without it the test is skipped."""
    return shutil.which("node") or pytest.skip("no node on this machine")


def rgbe(pixels: np.ndarray) -> np.ndarray:
    """The RGBE codes (H,W,4) uint8 of pixels (H,W,3)."""
    most = pixels.max(-1, keepdims=True)
    exponent = np.frexp(most)[1]
    codes = np.concatenate([np.floor(np.ldexp(pixels, 8 - exponent)), exponent + 128], -1)
    return (codes * (most > 0)).astype(np.uint8)


def write_exr(path: Path, pixels: np.ndarray) -> Path:
    """Writes a panorama (H,W,3) without loss."""
    OpenEXR.File({}, {"RGB": np.ascontiguousarray(pixels, np.float32)}).write(os.fspath(path))
    return path


def ssim_in_the_box(first, second, inside, span=1.0):
    """scikit-image's SSIM in the box of the mask, outside of which pictures are black."""
    rows, columns = np.nonzero(inside)
    box = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    pair = (np.where(inside[..., None], x, 0)[box] for x in (first, second))
    return structural_similarity(*pair, channel_axis=-1, data_range=span)


def photo_of_people(height, width, centres, seed=0):
    """A photo (H,W,3) uint8 with clipped parts, and soft ellipses about the columns `centres` as its mask."""
    generator = np.random.default_rng(seed)
    pixels = gaussian_filter(generator.random((height, width, 3)), (2, 2, 0)) * 700 - 150
    y, x = np.mgrid[:height, :width]
    reach = 0.3 * width / len(centres)
    down = (y - height / 2) / (0.42 * height)
    mask = sum(np.clip((1 - np.hypot((x - c) / reach, down)) * 900, 0, 255) for c in centres)
    return pixels.clip(0, 255).astype(np.uint8), np.rint(mask).clip(0, 255).astype(np.uint8)


def lights_of(split: Sequence[str], **fields) -> LightSet:
    """White lights of radiance alike from everywhere, of generated rooms as they are, unless `fields` of the set give
    others."""
    count = np.arange(len(split))
    coefficients = np.zeros((len(split), 9, 3), np.float32)
    coefficients[:, 0] = 1
    usual = {"source": np.array([f"room:{i}" for i in count]), "reason": np.full(len(split), ""), "yaw": 0.0 * count}
    usual |= {"coefficients": coefficients, "scale": 1.0 + 0 * count}
    return LightSet(split=np.array(split), **{**usual, **fields})


def random_maps(name: str = "figure ü", size: int = 9, order: int = 2, bounced: bool = False, seed: int = 0) -> Maps:
    """Maps of noise inside a mask of noise; AO is that of the transport."""
    rng = np.random.default_rng(seed)
    mask, k = rng.random((size, size)) < 0.5, (order + 1) ** 2

    def noise(*channels: int, low: float = 0.0) -> np.ndarray:
        inside = mask.reshape(size, size, *[1] * len(channels))
        return (inside * rng.uniform(low, 1, (size, size, *channels))).astype(np.float32)

    normal, transport = noise(3, low=-1), noise(k, low=-0.5)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True).clip(1e-9)
    ao = (transport[..., 0] / 0.886227).clip(0, 1)
    info = {"name": name, "subject": name[0], "size": size, "order": order, "repairs": {"holes": 3}}
    maps = Maps(mask, noise(), noise(3), normal, mask + noise(), ao, transport, info=info)
    maps.bounced = noise(k, 3) if bounced else None
    return maps


def snowman(size: int, seed: int) -> Maps:
    """Body and head, colored stripes, darker toward the neck; transport = AO * T(normal) exactly."""
    rng, x = np.random.default_rng(seed), (2 * np.arange(size) + 1) / size - 1
    x, y = np.meshgrid(x, -x)
    mask, normal, depth = np.zeros(x.shape, bool), np.zeros((*x.shape, 3)), np.zeros(x.shape)
    body, head = rng.uniform(0.28, 0.45), rng.uniform(0.16, 0.22)
    for centre, radii in ((-0.25, (body, 0.65)), (0.62, (head, 0.26))):
        u, v = x / radii[0], (y - centre) / radii[1]
        here = u**2 + v**2 < 1
        w = np.sqrt(np.where(here, 1 - u**2 - v**2, 0))
        n = np.stack([u / radii[0], v / radii[1], w / 0.3], -1)
        normal = np.where(here[..., None], n / np.linalg.norm(n, axis=-1, keepdims=True).clip(1e-9), normal)
        mask |= here
        depth = np.where(here, 3 - 0.3 * w, depth)
    ao = np.where(mask, 1 - 0.7 * np.exp(-(((y - 0.38) / 0.12) ** 2)), 0)
    colors = rng.uniform(0.1, 0.8, (2, 3))
    albedo = np.where((np.sin(12 * y + rng.uniform(0, 6)) > 0)[..., None], colors[0], colors[1]) * mask[..., None]
    layers = {"albedo": albedo, "normal": normal * mask[..., None], "depth": depth, "ao": ao}
    layers |= {"coverage": mask, "transport": unoccluded(normal) * (ao * mask)[..., None]}
    info = {"name": f"snowman{seed:02d}", "subject": f"s{seed}", "size": size, "order": 2, "repairs": []}
    return Maps(mask, **{name: values.astype(np.float32) for name, values in layers.items()}, info=info)


def render(pixels, people, light, mode="ratio", background=None, turn=0.0, stops=0.0):
    """A photo under one light, as `relight.photos.render.frames` takes it."""
    return next(frames(pixels, people, [(light, turn)], mode, background, stops))
