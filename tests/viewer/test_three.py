"""The loader for three.js of docs/transport.md, where npm's package three is in a folder of NODE_PATH."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from samples import serving

from relight.core import srgb
from relight.settings import ROOT
from relight.transport import VertexTransport

SIZE = 16
PAGE = """<script type="importmap">{"imports": {"three": "./three/build/three.module.js",
"three/addons/": "./three/examples/jsm/"}}</script><script type="module">
import { loadBaked } from "./loader.js"; import * as THREE from "three";
const renderer = new THREE.WebGLRenderer(), scene = new THREE.Scene();
window.relight = { ready: true, draw: async (light, url, size) => {
  renderer.setSize(size, size);
  scene.clear().add(await loadBaked(url, light));
  renderer.render(scene, new THREE.OrthographicCamera(-1, 1, 1, -1, -2, 2));
  const gl = renderer.getContext(), pixels = new Uint8Array(4 * size * size);
  gl.readPixels(0, 0, size, size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  return [...pixels];
} };</script>"""


@pytest.mark.parametrize("bounces", [False, True])
def test_three_shows_transport_per_vertex_times_light(page, tmp_path, bounces):
    """Of a sheet whose vertices are at the pixels' centers, so that each pixel has the color of a vertex."""
    packages = [Path(folder, "three") for folder in os.environ.get("NODE_PATH", "").split(os.pathsep)]
    if not (three := next(filter(Path.is_dir, packages), None)):
        pytest.skip("no three on this machine")
    (code,) = re.findall(r"```js\n(.*?)```", (ROOT / "docs" / "transport.md").read_text(), re.DOTALL)
    (tmp_path / "loader.js").write_text(code)
    (tmp_path / "three").symlink_to(three)
    (tmp_path / "index.html").write_text(PAGE)
    rng = np.random.default_rng(0)
    column, row = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    vertices = np.stack([(2 * column + 1) / SIZE - 1, (2 * row + 1) / SIZE - 1, 0 * row], -1).reshape(-1, 3)
    corner = (row[:-1, :-1] * SIZE + column[:-1, :-1]).ravel()[:, None]
    faces = np.concatenate([corner + [0, 1, SIZE], corner + [1, SIZE + 1, SIZE]])
    count = len(vertices)
    surface = {"faces": faces, "normals": np.tile(np.float32([0, 0, 1]), (count, 1))}
    surface |= {
        "albedo": rng.random((count, 3), np.float32),
        "transport": rng.normal(size=(count, 9)).astype(np.float32),
    }
    bounced = rng.normal(size=(count, 9, 3)).astype(np.float32) if bounces else None
    baked = VertexTransport(vertices.astype(np.float32), **surface, bounced=bounced)
    baked.save(tmp_path / "baked.glb")
    light = rng.normal(size=(9, 3))
    with serving(tmp_path) as server:
        page.open(f"{server.url}index.html")
        pixels = page.call("(light, size) => relight.draw(light, 'baked.glb', size)", light.tolist(), SIZE)
    shown = np.reshape(pixels, (SIZE, SIZE, 4))[1:-1, 1:-1, :3]
    total = baked.transport[..., None] + (0 if baked.bounced is None else baked.bounced)
    linear = baked.albedo / np.pi * np.einsum("vkc,kc->vc", total, light).clip(0)
    np.testing.assert_allclose(shown, 255 * srgb.encode(linear.clip(0, 1)).reshape(SIZE, SIZE, 3)[1:-1, 1:-1], atol=1)
    assert np.ptp(shown) > 200
