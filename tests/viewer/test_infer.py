"""What a site of `relight web` computes in the browser, run by node, against Python."""

import base64
import json
import re
import subprocess
import zlib
from types import SimpleNamespace

import numpy as np
import pytest
import samples
from PIL import Image
from scipy.ndimage import distance_transform_edt

from relight.core.srgb import LINEAR, encode, to_bytes
from relight.lights.place import STATISTICS, place_light
from relight.photos.background import Background, estimate_white
from relight.photos.mask import selfie
from relight.photos.mask.edge import fit_edge
from relight.photos.network import PhotoNetwork
from relight.photos.render import estimate_foreground
from relight.photos.scene import Scene
from relight.photos.tone import chroma, clipping_excess
from relight.viewer.bundle import bundle
from relight.viewer.codec import encode as encode_planes
from relight.viewer.figure import EXCESS_STEPS, QUALITIES, pack
from relight.viewer.site import STUDIO
from relight.viewer.source import photo_figure

SIZE = 64
# Reads its input from the standard input, and prints what `main` makes of it; arrays of numbers as base64.
PROGRAM = """
const coded = (key, value) => ArrayBuffer.isView(value)
  ? { kind: value.constructor.name, data: Buffer.from(value.buffer).toString("base64") } : value;
const text = require("fs").readFileSync(0, "utf8");
(async () => process.stdout.write(JSON.stringify(await main(JSON.parse(text)), coded)))();
"""
# What the worker finds in a browser; its networks take what is redder than blue for people.
REDNESS = """
globalThis.self = { postMessage: ({ result, message }) => self.answer(result, message) };
class Tensor { constructor(kind, data) { this.data = data; } }
const person = (image, i) => 1 / (1 + Math.exp(-30 * (image[i] - image[i + 2 * 256 * 256] - 0.1)));
const find = (image) => Float32Array.from({ length: 256 * 256 }, (_, i) => person(image, i));
const session = { run: async ({ image: { data } }) => ({ mask: { data: find(data) } }) };
globalThis.ort = { env: { wasm: {} }, Tensor, InferenceSession: { create: async () => session } };
"""
ASK = """
const ask = (task, values) => new Promise((done, fail) => {
  self.answer = (result, message) => (message ? fail(new Error(message)) : done(result));
  self.onmessage({ data: { task, values } });
});
"""
# The twin of `invented`, below, as a network of order 4, of which the page takes bands 0 to 2.
RUN = """
async function run(image, mask) {
  const area = 64 * 64, at = (i) => -1 + (2 * i) / 63, scale = [1, 0.3, 0.2, 0.5, 0.1, 0.05, 0.02, 0.07, 0.03];
  const albedo = new Float32Array(3 * area), transport = new Float32Array(25 * area).fill(9);
  const light = new Float32Array(75);
  for (let i = 0; i < area; i++) {
    const x = at(i % 64), y = at(Math.floor(i / 64)), color = [0, 1, 2].map((c) => image[c * area + i]);
    color.forEach((v, c) => (albedo[c * area + i] = mask[i] * Math.min(0.9 * v + 0.05, 1)));
    for (let k = 0; k < 9; k++) {
      const value = 0.8 * (k === 0) + 0.2 * color[k % 3] + 0.1 * k * x * y + 0.3 * x * (k % 2);
      transport[k * area + i] = mask[i] * value;
      for (let c = 0; c < 3; c++) light[3 * k + c] += (scale[k] * color[c]) / area;
    }
  }
  for (let c = 0; c < 3; c++) light[c] += 0.5;
  return { albedo, transport, light };
}
"""


def invented(image, mask):
    """Maps and a light that depend on the image, its place and its sides, without training."""
    x, y = np.meshgrid(*2 * [np.linspace(-1, 1, SIZE, dtype=np.float32)])
    transport = [0.8 * (k == 0) + 0.2 * image[0, k % 3] + 0.1 * k * x * y + 0.3 * x * (k % 2) for k in range(9)]
    scale = np.array([1, 0.3, 0.2, 0.5, 0.1, 0.05, 0.02, 0.07, 0.03], np.float32)
    light = image.mean((2, 3))[:, None] * scale[:, None]
    light[:, 0] += 0.5
    return [(0.9 * image + 0.05).clip(0, 1) * mask, np.stack(transport)[None] * mask, light]


NETWORK = PhotoNetwork(SIZE, {"model": {"order": 2}}, "", invented)


def node(module, program, values, before=""):
    """What `program`, a function `main` of JSON values, returns; it can use all that `module` imports as $name.

    `before` runs before the module.
    """
    (path,) = STUDIO.parent.glob(f"*/{module}.js")
    script = before + bundle(path) + program + PROGRAM
    done = subprocess.run([samples.node(), "-e", script], input=json.dumps(values), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout, object_hook=arrays)


def arrays(value):
    if "kind" not in value:
        return value
    return np.frombuffer(base64.b64decode(value["data"]), re.sub("Clamped|Array", "", value["kind"]).lower())


@pytest.mark.parametrize(("shape", "centres"), [((120, 160), (43, 115)), ((40, 30), (15,)), ((150, 110), (20,))])
def test_a_figure_is_that_of_the_view_command(shape, centres):
    """Two people, joined by a soft bridge; one smaller than the network's square; one that the photo's border cuts."""
    pixels, mask = samples.photo_of_people(*shape, centres)
    mask[2:5, 2:4] = 255  # dirt
    mask[60:63, 66:92] = np.maximum(mask[60:63, 66:92], 40)
    figure = photo_figure(Scene.of(pixels, mask, NETWORK))
    fitted = fit_edge(pixels, mask)
    rgba = np.dstack([pixels, np.full(shape, 255, np.uint8)])
    program = """const main = ({ pixels, width, height, coverage }) => $infer.inferFigure(
    { pixels: Uint8Array.from(pixels), width, height }, Uint8Array.from(coverage), run, 64);"""
    photo = {"width": shape[1], "height": shape[0], "pixels": rgba.ravel().tolist()}
    found = node("infer", RUN + program, photo | {"coverage": mask.ravel().tolist()})
    header, _ = pack(figure, QUALITIES[0])
    assert found["box"] == header["box"] and found["floor"] == pytest.approx(header["floor"], abs=1e-6)
    np.testing.assert_allclose(found["mean"], header["mean"], atol=2e-6)
    np.testing.assert_allclose(found["light"], figure.photo_light, atol=1e-6)
    left, top, width, height = header["box"]
    window = np.s_[top : top + height, left : left + width]
    inside = fitted[window] > 0
    first, second, third, surface = (each.reshape(height, width, 4) for each in found["maps"])
    transport = np.concatenate([first, second, third[..., :1]], -1)
    np.testing.assert_allclose(transport[inside], figure.maps.transport[window][inside], atol=1e-5)
    np.testing.assert_allclose(surface[inside][:, :3], figure.maps.albedo[window][inside], atol=1e-5)
    np.testing.assert_array_equal(np.rint(255 * surface[..., 3]), fitted[window])
    np.testing.assert_array_equal(found["photo"].reshape(*shape, 4), rgba)
    own = estimate_foreground(LINEAR[pixels], fitted / np.float32(255))
    np.testing.assert_allclose(found["front"].reshape(height, width, 4)[..., :3], own[window], atol=1e-5)
    above = EXCESS_STEPS * clipping_excess(own[window], chroma(LINEAR[pixels], fitted > 0)[window])
    np.testing.assert_allclose(found["excess"].reshape(height, width, 4)[inside][:, :3], above[inside], atol=0.51)
    assert above.max() > 10
    assert node("infer", "const main = (mask) => $infer.splitPeople(Uint8Array.from(mask), 90);", [0] * 90) == []


@pytest.mark.parametrize("size, kind", [(150, "soft"), (150, "binary"), (640, "soft"), (150, "hair"), (150, "noisy")])
@pytest.mark.slow
def test_fit_edge_is_that_of_python(size, kind):
    """A mask that is two pixels off: soft, of two values, with a soft part, with a coder's noise; cells of 2 pixels."""
    y, x = np.mgrid[:size, : size // 2]
    away = 0.45 * size - np.hypot(x - 0.25 * size, (y - 0.5 * size) / 1.2) - 0.25 * size
    alpha = np.clip(away + 0.5, 0, 1)[..., None]
    noise = np.random.default_rng(4).normal(0, 6, (*y.shape, 3))
    pixels = (alpha * [40, 45, 60] + (1 - alpha) * [190, 120, 90] + noise).clip(0, 255).astype(np.uint8)
    mask = np.rint(255 * np.clip(away / 2 + 1.5, 0, 1)).astype(np.uint8)
    hard = np.where(mask > 127, np.uint8(255), np.uint8(0))
    mask = {
        "soft": mask,
        "binary": hard,
        "hair": np.where(y < 0.35 * size, mask, hard),
        "noisy": np.abs(hard.astype(int) - np.random.default_rng(5).integers(0, 40, hard.shape)).astype(np.uint8),
    }[kind]
    expected = fit_edge(pixels, mask)
    away = np.abs(expected.astype(int) - mask)
    assert away.max() == 0 if kind in ("soft", "hair") else (away > 50).sum() >= 100 * (kind == "binary")
    image = [LINEAR[pixels[..., channel]].ravel().tolist() for channel in range(3)]
    program = """const main = ({ image, mask, width }) =>
    $edges.fitEdge(image.map((plane) => Float32Array.from(plane)), Uint8Array.from(mask), width);"""
    found = node("edges", program, {"image": image, "mask": mask.ravel().tolist(), "width": mask.shape[1]})
    assert np.abs(found.reshape(mask.shape).astype(int) - expected).max() <= 1


def test_planes_come_back_from_the_codec_in_any_region_smooth_ones_are_small_and_steep_ones_refused():
    cases, expected = [], []
    for seed in range(6):
        generator = np.random.default_rng(seed)
        shape = generator.integers(1, 24, 2)
        region = generator.random(shape) < generator.choice([0.0, 0.3, 0.9, 1.0])
        smooth = np.add.outer(np.arange(shape[0]), np.arange(shape[1]))
        planes = np.stack([7 * smooth, smooth**2, generator.integers(-9000, 9000, shape), 0 * smooth], -1)
        stream, predictors = encode_planes(planes, region)
        cases.append([list(zlib.decompress(stream)), region.ravel().astype(int).tolist(), int(shape[1]), predictors])
        expected.append(planes * region[..., None])
    program = """const main = (cases) => cases.map(([data, region, width, predictors]) =>
    $codec.decodePlanes(Uint8Array.from(data), Uint8Array.from(region), width, predictors));"""
    for found, planes in zip(node("codec", program, cases), expected, strict=True):
        np.testing.assert_array_equal(np.stack(found, -1).reshape(planes.shape), planes)
    region, ramp = np.ones((64, 64), bool), np.add.outer(3 * np.arange(64), np.arange(64))[..., None]
    assert len(encode_planes(ramp, region)[0]) < 100  # of 4096 values
    with pytest.raises(ValueError, match="16 bits"):
        encode_planes(np.where(np.arange(64) % 2, 40000, -40000)[None, :, None] + 0 * ramp, region)


@pytest.mark.parametrize("share", [0.02, 0.5, 0.97])
def test_the_nearest_pixel_is_scipys_also_where_several_are(share):
    inside = np.random.default_rng(1).random((37, 52)) < share
    nearest = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    program = "const main = ({ set, width }) => $regions.nearest(Uint8Array.from(set), width);"
    found = node("regions", program, {"set": inside.ravel().astype(int).tolist(), "width": 52})
    np.testing.assert_array_equal(found, np.ravel_multi_index(tuple(nearest), inside.shape).ravel())


SIZES = {"lanczos": (21, 13), "bicubic": (90, 70), "bilinear": (23, 40), "box": (9, 17)}.items()


@pytest.mark.parametrize(("name", "size"), SIZES)
def test_resampling_is_pillows(name, size):
    program = """const main = ({ plane, size, part }) => [Float32Array, Uint8Array].map((Kind) =>
    $resample.resample(Kind.from(plane), 52, size, $resample[FILTER], part));""".replace("FILTER", json.dumps(name))
    plane, part = np.random.default_rng(2).integers(0, 256, (37, 52)).astype(np.uint8), [3.3, 2.1, 47.9, 30.5]
    floats, integers = node("resample", program, {"plane": plane.ravel().tolist(), "size": size, "part": part})
    images = (Image.fromarray(values) for values in (plane.astype(np.float32), plane))
    exact, rounded = (np.asarray(image.resize(size, Image.Resampling[name.upper()], part)) for image in images)
    np.testing.assert_allclose(floats.reshape(size[::-1]), exact, atol=1e-3)
    assert np.abs(integers.reshape(size[::-1]).astype(int) - rounded).max() <= 1
    assert (integers.reshape(size[::-1]) == rounded).mean() > 0.99


@pytest.mark.parametrize("width", [150, 421])
def test_the_mask_is_that_of_python_whatever_the_network_says(monkeypatch, width):
    """A network that takes what is redder than blue for people; a small part is dropped. Two people in a wide photo."""
    y, x = np.mgrid[:110, :width]
    redness = np.maximum(0.3 - np.hypot(x - 140, y - 9) / 15, 0)
    for middle in (60, 350):
        redness += np.maximum(1 - np.hypot((x - middle) / 30, (y - 60) / 45), 0)
    noise = np.random.default_rng(3).normal(0, 6, (110, width, 3))
    pixels = (90 + noise + 150 * redness[..., None].clip(0, 0.5) * [1, 0, -1]).clip(0, 255).astype(np.uint8)

    def run(_, inputs):
        image = inputs["image"]
        return [1 / (1 + np.exp(-30 * (image[:, :1] - image[:, 2:] - np.float32(0.1))))]

    monkeypatch.setattr(selfie, "load_network", lambda _: SimpleNamespace(run=run))
    monkeypatch.setattr(selfie, "find_bodies", lambda *_: [])
    expected, _ = selfie.segment(pixels)
    program = """const main = async (photo) => {
      await ask("start", { network: 1, mask: 2 });
      return ask("mask", { photo });
    };"""
    photo = {"pixels": np.dstack([pixels, pixels[..., :1]]).ravel().tolist(), "width": width, "height": 110}
    found = node("worker", ASK + program, photo, REDNESS).reshape(expected.shape)
    assert (expected > 128).sum() > 1000 and (expected[:20, 130:200] < 128).all()
    assert ((expected[:, 200:] > 128).sum() > 1000) == (width > 200)
    assert np.abs(found.astype(int) - np.minimum(expected, pixels[..., 0])).max() <= 2, "alpha is as pixels[..., 0]"


@pytest.mark.parametrize("longest", [300, 100])
def test_a_cut_out_is_prepared_without_what_it_hides(longest):
    """As Pillow scales it. An alpha that is no outline counts for no mask."""
    y, x = np.mgrid[:300, :200]
    soft = np.rint(255 * np.clip(80.5 - np.hypot(x - 100, y - 150), 0, 1)).astype(np.uint8)
    program = f"""{ASK} const main = async (photo) => {{
      const {{ photo: {{ pixels }}, alpha }} = await ask("prepare", {{ photo, longest: {longest} }});
      return {{ pixels, alpha }};
    }};"""

    def prepared(alpha):
        pixels = np.dstack([red, alpha]).ravel().tolist()
        return node("worker", program, {"pixels": pixels, "width": 200, "height": 300}, REDNESS)

    red = np.where(soft[..., None], [60, 50, 40], [200, 30, 30]).astype(np.uint8)
    found = prepared(soft)
    size = round(200 * longest / 300), longest
    small = Image.fromarray(np.dstack([red, soft])).resize(size, Image.Resampling.LANCZOS)
    pixels, alpha = (np.reshape(found[part], (*size[::-1], -1)) for part in ("pixels", "alpha"))
    away, opaque = np.abs(pixels - np.asarray(small).astype(int)), np.asarray(small)[..., 3] > 100
    assert away[opaque].max() <= 2 and away[..., 3].max() <= 1 and np.array_equal(alpha[..., 0], pixels[..., 3])
    corners = np.where(np.hypot(x - 100, y - 150) > 160, 0, 255)
    for alpha in (np.full_like(soft, 7), 255 - (soft == 255) * (x == 99) * (y == 9), 255 * (x + y > 0), corners):
        assert prepared(alpha)["alpha"] is None


def places():
    """Pictures of places of several shapes and sizes: bright sides, color casts, clipped parts, and extremes."""
    generator = np.random.default_rng(7)
    for height, width in ((36, 48), (301, 222), (40, 640), (30, 20)):
        y, x = np.mgrid[:height, :width] / np.array([height, width])[:, None, None]
        light = np.exp(generator.normal(0, 1.5) * x + generator.normal(-1, 1) * y) * generator.uniform(0.1, 1.5)
        linear = light[..., None] * np.exp(generator.normal(0, 0.4, 3)) * generator.uniform(0.5, 1, (height, width, 1))
        yield to_bytes(encode(linear.clip(0, 1)))
    yield np.zeros((20, 30, 3), np.uint8)
    yield np.full((20, 30, 3), 255, np.uint8)


@pytest.mark.slow
def test_the_light_of_a_place_is_that_of_python():
    program = """const main = ({ pixels, width, height, known, light }) => {
      const picture = { pixels: Uint8Array.from(pixels), width, height }, white = $place.whiteOf(picture);
      return { light: $place.placeLight(picture, known), white, tint: $place.tintOf(white, light) };
    };"""
    for pixels in places():
        height, width = pixels.shape[:2]
        expected = place_light(pixels)
        values = {"known": json.loads(STATISTICS.read_text()), "light": expected.ravel().tolist()}
        values |= {"pixels": np.dstack([pixels, pixels[..., :1]]).ravel().tolist(), "width": width, "height": height}
        found = node("place", program, values)
        np.testing.assert_allclose(found["light"].reshape(9, 3), expected, atol=1e-5 * np.abs(expected).max())
        np.testing.assert_allclose(found["white"], estimate_white(pixels), rtol=1e-5, atol=1e-9)
        tint = Background("picture", picture=pixels).matched(expected, 1.0).tint
        np.testing.assert_allclose(found["tint"], tint, rtol=1e-5)
