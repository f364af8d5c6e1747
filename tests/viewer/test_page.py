import io
import json
from dataclasses import replace

import av
import numpy as np
import pytest
from PIL import Image
from samples import render, rgbe
from scipy.ndimage import binary_fill_holes, gaussian_filter
from scipy.spatial.transform import Rotation

from relight.core.srgb import LINEAR, decode, encode
from relight.lights.load import key_light
from relight.lights.place import place_light
from relight.maps import Maps
from relight.maps.square import Crop
from relight.panoramas import Panorama, project
from relight.photos.background import Background
from relight.photos.person import Person, balanced, with_light
from relight.photos.shading import exposure_factor, shade, steady
from relight.photos.tone import display_shading, roll_off
from relight.sh import basis, deringed, irradiance, rotation_about_y, rotation_matrix
from relight.viewer.build import build_viewer
from relight.viewer.figure import Figure

START = {
    "light": 0, "yaw": 0, "tilt": 0, "stops": 0, "view": "relit", "before": "none", "split": 0.5,
    "background": "studio", "mode": "ratio", "auto": False, "room": 1, "lamps": [], "taken": "", "takenYaw": 0,
}  # fmt: skip


def rotation_of(yaw, tilt):
    return Rotation.from_rotvec([-np.radians(tilt), 0, 0]).as_matrix() @ rotation_about_y(np.radians(yaw))


def turned(light, yaw, tilt):
    return rotation_matrix(rotation_of(yaw, tilt), 2) @ light


def codes(light):
    return 255 * encode(roll_off(np.asarray(light, np.float64)))


def farthest(pixels, expected, where):
    return np.abs(pixels[..., :3].astype(float) - expected)[where].max()


@pytest.fixture(scope="module")
def html(tmp_path_factory, maps, lights):
    path = tmp_path_factory.mktemp("page") / "balls.html"
    build_viewer(path, [Figure("Six balls", maps)], lights, title="Six balls")
    return path


@pytest.fixture(scope="module")
def photograph(maps, lights):
    light = turned(lights["Lamp"], -30, 0) * 0.8
    generator = np.random.default_rng(1)
    noise = 0.8 + 0.4 * generator.random(maps.mask.shape)[..., None]
    behind = decode(gaussian_filter(generator.random((*maps.mask.shape, 3)), (4, 4, 0)))
    scene = np.where(maps.mask[..., None], maps.albedo * noise * shade(maps.transport, light), behind)
    return np.rint(codes(scene)).astype(np.uint8), light


@pytest.fixture(scope="module")
def photo_html(tmp_path_factory, maps, lights, photograph):
    path = tmp_path_factory.mktemp("page") / "photo.html"
    build_viewer(path, [Figure("Photo", maps, photograph[0] / 255, photograph[1])], lights, title="Photo")
    return path


@pytest.fixture
def balls(page, html):
    page.open(html)
    return page


def relit_shading(maps, light):
    """The shading that the page shows under a light that it was given."""
    return steady(shade(maps.transport, light), light)


@pytest.mark.parametrize("name", ["Window", "Lamp", "Behind"])
@pytest.mark.slow
def test_relit_and_shading_equal_python_under_turned_lights(balls, maps, lights, name):
    index = list(lights).index(name)
    for yaw, tilt, stops in [(0, 0, 0), (70, 0, 0), (-155, 40, 1), (10, -75, -1.5)]:
        state = START | {"light": index, "yaw": yaw, "tilt": tilt, "stops": stops}
        lit = 2**stops * relit_shading(maps, turned(lights[name], yaw, tilt))
        assert farthest(balls.pixels(**state), codes(maps.albedo * lit), maps.mask) <= 2
        assert farthest(balls.pixels(**state | {"view": "shading"}), 255 * encode(display_shading(lit)), maps.mask) <= 2


def test_the_other_views_equal_python(balls, maps, lights):
    still = {"albedo": 255 * encode(maps.albedo), "ao": 255 * maps.ao[..., None], "normal": 255 * (maps.normal + 1) / 2}
    for view, expected in still.items():
        assert farthest(balls.pixels(**START | {"view": view, "stops": 2}), expected, maps.mask) <= 1.01
    split = balls.pixels(**START | {"before": "open", "yaw": 30})
    light = turned(lights["Window"], 30, 0)
    left = np.arange(maps.mask.shape[1]) < maps.mask.shape[1] // 2
    assert farthest(split, codes(maps.albedo * np.maximum(irradiance(light, maps.normal), 0)), maps.mask & left) <= 2
    assert farthest(split, codes(maps.albedo * relit_shading(maps, light)), maps.mask & ~left) <= 2


@pytest.mark.parametrize("is_disc", [False, True])
def test_a_figure_drawn_in_tiles_has_no_seam_and_no_gap(page, tmp_path, is_disc):
    """One of even albedo, at an odd zoom, before a background of another color."""
    y, x = np.mgrid[:75, :91]
    mask = np.hypot(x - 45, y - 37) < 34 if is_disc else np.ones(y.shape, bool)
    albedo = np.where(mask[..., None], decode(np.array([200, 100, 50]) / 255), 0)
    coverage, zero = mask.astype(np.float32), np.zeros((75, 91, 9))
    figure = Figure("even", Maps(mask, coverage, albedo, zero[..., :3], zero[..., 0], coverage, zero))
    build_viewer(tmp_path / "even.html", [figure], {"Dim": np.full((9, 3), 0.1)})
    page.open(tmp_path / "even.html")
    pixels = page.pixels(**START | {"view": "albedo", "background": "color", "color": "#00ff00"})
    assert (np.abs(pixels[..., :3] - np.where(mask[..., None], [200, 100, 50], [0, 255, 0])) <= 1).all()
    page.run("relight.placement.zoom(1.37, 123.4, 77.7), relight.redraw()")
    shown = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)[140:440, 80:500]
    even, behind = np.abs(shown - [200, 100, 50]).max(-1) <= 1, np.abs(shown - [0, 255, 0]).max(-1) <= 1
    rows, columns = np.flatnonzero(even.any(1)), np.flatnonzero(even.any(0))
    assert even.mean() > 0.5 and (shown.max(-1) > 150).all()
    if is_disc:
        assert behind.any() and (binary_fill_holes(even) == even).all()
    else:
        assert even[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all()


def towards(size):
    """Unit directions (H,W,3) in which the camera sees its pixels."""
    grid = np.tan(np.radians(25)) * ((2 * np.arange(size) + 1) / size - 1)
    x, y = np.meshgrid(grid, -grid)
    return np.stack([x, y, -np.ones_like(x)], -1) / np.hypot(np.hypot(x, y), 1)[..., None]


def test_backgrounds_and_soft_edges_are_mixed_as_light(page, tmp_path, maps, lights):
    coverage = np.clip(gaussian_filter(maps.mask.astype(np.float32), 1) * 2, 0, 1) * maps.mask
    build_viewer(tmp_path / "soft.html", [Figure("soft", replace(maps, coverage=coverage))], lights)
    page.open(tmp_path / "soft.html")
    figure, alpha = maps.albedo * relit_shading(maps, lights["Window"]), np.rint(255 * coverage)[..., None] / 255
    for background, behind in {
        "color": decode(np.array([0x33, 0xCC, 0x66]) / 255),
        "light": roll_off(np.maximum(irradiance(lights["Window"], towards(len(coverage))), 0)),
    }.items():
        pixels = page.pixels(**START | {"background": background, "color": "#33cc66"})
        assert farthest(pixels, 255 * encode(alpha * roll_off(figure) + (1 - alpha) * behind), ...) <= 2
        assert (pixels[..., 3] == 255).all()
    pixels = page.pixels(**START | {"background": "clear"})
    np.testing.assert_array_equal(pixels[..., 3], np.rint(255 * coverage))
    assert farthest(pixels, codes(figure), coverage == 1) <= 2
    assert farthest(pixels, codes(figure), coverage > 0.2) <= 6  # 8 bits of a color that was multiplied by alpha


def inferred(photo, coverage, maps, light):
    """The figure of `maps`, as it is inferred of a photo whose square is all of it."""
    square = Crop(0, 0, len(photo), (0, len(photo)), (0, len(photo)), len(photo))
    return Person(square, coverage, maps.mask, LINEAR[photo], maps.albedo, maps.transport, light.astype(np.float32))


@pytest.mark.slow
def test_soft_photo_equals_the_photo_command(page, tmp_path, maps, lights, photograph):
    photo, own = photograph
    coverage = np.rint(255 * gaussian_filter(maps.mask.astype(np.float32), 1.5)).astype(np.uint8)
    soft = replace(maps, coverage=coverage / np.float32(255))
    build_viewer(tmp_path / "soft.html", [Figure("soft", soft, photo / 255, own)], lights)
    page.open(tmp_path / "soft.html")
    figure = inferred(photo, coverage, maps, own)
    factor = exposure_factor(own, lights["Behind"], maps.transport, maps.mask, turning=True)
    new = turned(lights["Behind"] * factor, -60, 20)
    state = START | {"light": 3, "yaw": -60, "tilt": 20, "stops": 0.5, "color": "#4080c0"}
    color = Background("color", color=np.array([0x40, 0x80, 0xC0], np.uint8), shadow=False)
    for mode in ("ratio", "full"):
        for name, behind in {"photo": Background("keep"), "color": color}.items():
            expected = render(photo, [figure], new, mode, behind, stops=0.5)
            pixels = page.pixels(**state | {"background": name, "mode": mode})
            assert farthest(pixels, expected, (coverage == 255) | (coverage < 240)) <= 2
            assert farthest(pixels, expected, ...) <= 5  # between, Python still looks at the photo for detail
        expected = render(photo, [figure], new, mode, Background("transparent"), stops=0.5)
        pixels = page.pixels(**state | {"background": "clear", "mode": mode})
        np.testing.assert_array_equal(pixels[..., 3], expected[..., 3])
        assert farthest(pixels, expected[..., :3], coverage == 255) <= 2
        assert farthest(pixels, expected[..., :3], coverage > 60) <= 6
    known = balanced([with_light(figure, turned(lights["Lamp"], 40, 0))])
    words = state | {"background": "photo", "mode": "ratio", "taken": "Lamp", "takenYaw": 40}
    expected = render(photo, known, new, "ratio", stops=0.5)
    assert farthest(page.pixels(**words), expected, (coverage == 255) | (coverage < 240)) <= 4
    assert page.run("new URLSearchParams(relight.address()).get('taken')") == "Lamp"


def hdr(pixels):
    height, width = pixels.shape[:2]
    return f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode() + rgbe(pixels).tobytes()


def values(pixels):
    coded = rgbe(pixels).astype(float)
    return coded[..., :3] * 2 ** (coded[..., 3:] - 136)


def test_panoramas_that_are_dropped_or_pasted_light_the_figure(balls, maps, lights):
    panorama = np.random.default_rng(2).random((16, 32, 3)) ** 6 * 40
    panorama[10:, 5:25] = [0.5, 0.25, 2.0]  # runs
    balls.call(
        """(bytes) => { const data = new DataTransfer();
        for (const name of ["kitchen.hdr", "b.hdr"]) data.items.add(new File([new Uint8Array(bytes)], name));
        document.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
        document.dispatchEvent(new ClipboardEvent("paste", { clipboardData: data, bubbles: true })); }""",
        list(hdr(panorama)),
    )
    balls.run("(async () => { while (relight.lights().length < 7) await new Promise(requestAnimationFrame); })()")
    assert sorted(balls.run("relight.lights().slice(3).map(({ name }) => name)")) == ["b", "b", "kitchen", "kitchen"]
    light = project(Panorama(values(panorama).astype(np.float32)))
    light = light * exposure_factor(lights["Window"], light, maps.transport, maps.mask, turning=True)
    expected = codes(maps.albedo * relit_shading(maps, turned(light, 25, 0)))
    assert farthest(balls.pixels(**START | {"light": 3, "yaw": 25}), expected, maps.mask) <= 2
    assert "kitchen" in balls.run("document.getElementById('light-list').innerText")


def test_saving_is_within_reach_on_a_small_phone(page, photo_html):
    page.open(photo_html, 360, 640, mobile=True)
    for button in ("save", "jpeg", "movie", "help"):
        box = page.run(f"document.getElementById('{button}').getBoundingClientRect().toJSON()")
        assert 0 <= box["left"] and box["right"] <= 360 and 0 <= box["top"] and box["bottom"] <= 640, button


def test_a_view_is_not_compared_with_itself(page, photo_html):
    page.open(photo_html)
    page.run(f"relight.set({json.dumps(START | {'view': 'photo'})})")
    page.run("document.body.dispatchEvent(new KeyboardEvent('keydown', { key: 'c', bubbles: true }))")
    assert page.run("[relight.state.view, relight.state.before]") == ["photo", "open"]
    assert page.run("[...document.getElementById('before').options].find(({ value }) => value === 'photo').disabled")
    page.run("relight.set({ view: 'albedo', before: 'albedo' })")
    assert page.run("relight.state.before") == "none"


def test_a_panorama_is_seen_behind_the_figure(balls, maps, lights):
    """Sharp, turned with the light and at its brightness; compared where the blocks of the panorama are flat."""
    blocks = np.kron(np.random.default_rng(4).uniform(0.02, 0.2, (8, 16, 3)), np.ones((16, 16, 1))).astype(np.float32)
    balls.call("(bytes) => relight.openPanorama(new File([new Uint8Array(bytes)], 'blocks.hdr'))", list(hdr(blocks)))
    state = START | {"light": 3, "background": "light", "yaw": 40, "tilt": 20, "room": 0.5, "stops": 0.3}
    pixels = balls.pixels(**state)
    light = project(Panorama(values(blocks).astype(np.float32)))
    gain = exposure_factor(lights["Window"], light, maps.transport, maps.mask, turning=True)
    rotation = rotation_of(40, 20)
    x, y, z = np.moveaxis(towards(len(maps.mask)) @ rotation, -1, 0)  # the inverse rotation of each direction
    column, row = (np.arctan2(x, -z) / (2 * np.pi) + 0.5) * 256, np.arccos(y) / np.pi * 128
    inside = (np.abs(column % 16 - 8) < 7) & (np.abs(row % 16 - 8) < 7) & ~maps.mask
    behind = values(blocks)[np.minimum(row.astype(int), 127), np.minimum(column.astype(int), 255)]
    assert inside.sum() > 2000
    assert farthest(pixels, codes(np.pi * behind * gain * 0.5 * 2**0.3), inside) <= 2


def test_lamps_are_those_of_python_and_add_to_the_dimmed_room(balls, maps, lights):
    names, room = ("azimuth", "elevation", "color", "strength", "softness"), lights["Window"]
    lamps = [dict(zip(names, lamp)) for lamp in ((45, 30, "#ffaa66", 1.5, 0), (-120, -10, "#6699ff", 0.7, 0))]
    state = START | {"lamps": lamps, "room": 0.25, "yaw": 60}
    mean, light = 0.886227 * float(room[0] @ [0.2126, 0.7152, 0.0722]), 0.25 * turned(room, 60, 0)
    for lamp in lamps:
        own = key_light(lamp["color"][1:], lamp["azimuth"], lamp["elevation"], 0, 2)
        light = light + lamp["strength"] * mean * deringed(own)
    assert farthest(balls.pixels(**state), codes(maps.albedo * relit_shading(maps, light)), maps.mask) <= 2


@pytest.mark.parametrize("softness", [0, 25, 90])
def test_a_soft_lamp_is_a_disc_of_light(balls, softness):
    """Its coefficients are the mean of those of points all over the disc, at the same irradiance."""
    lamp = {"azimuth": 20, "elevation": 50, "color": "#ffffff", "strength": 1, "softness": softness}
    found = np.reshape(balls.call("(lamp) => [...relight.lampLight(lamp, 1)]", lamp), (9, 3))[:, 0]
    a, e = np.radians([20, 50])
    centre = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    points = np.random.default_rng(0).normal(size=(400_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    disc = points[points @ centre >= np.cos(np.radians(softness))] if softness else centre[None]
    np.testing.assert_allclose(found, deringed(np.outer(basis(disc).mean(0), np.ones(3)))[:, 0], atol=0.01)


def test_deringed_is_that_of_python(balls):
    rng = np.random.default_rng(2)
    lights = [np.outer(basis(d / np.linalg.norm(d)), rng.random(3)) for d in rng.normal(size=(6, 3))]
    lights += [light + lights[0] + np.eye(9, 1) * rng.random(3) for light in lights]
    lights += [np.eye(9, 3), np.zeros((9, 3)), lights[0] * [1, 0, 0]]
    for light in lights:
        found = balls.call("(light) => [...relight.deringed(light)]", light.ravel().tolist())
        np.testing.assert_allclose(np.reshape(found, (9, 3)), deringed(light), atol=1e-12)


def test_lamps_are_placed_by_mouse_and_keys(balls):
    balls.run(f"relight.set({json.dumps(START)}), document.getElementById('add-lamp').click()")
    boxes = "['button.lamp', '#stage'].map((name) => document.querySelector(name).getBoundingClientRect().toJSON())"
    lamp, stage = balls.run(boxes)
    x, y, side = stage["width"] / 2, stage["height"] / 2, 0.46 * min(stage["width"], stage["height"]) / 2
    middle = lamp["x"] + lamp["width"] / 2, lamp["y"] + lamp["height"] / 2
    for kind, at in {"mousePressed": middle, "mouseMoved": (x + side, y), "mouseReleased": (0, 0)}.items():
        point = {"x": at[0], "y": at[1], "button": "left", "buttons": 1, "clickCount": 1}
        balls.send("Input.dispatchMouseEvent", type=kind, **point)
    lamp = balls.run("relight.state.lamps[0]")
    assert lamp["azimuth"] == pytest.approx(90, abs=1) and lamp["elevation"] == pytest.approx(0, abs=1)
    balls.run("document.querySelector('button.lamp').focus()")
    balls.send("Input.dispatchKeyEvent", type="keyDown", key="ArrowUp")
    assert balls.run("relight.state.lamps[0].elevation") > 1 and balls.run("relight.state.tilt") == 0
    balls.run("document.querySelector('.remove').click()")
    assert balls.run("relight.state.lamps.length") == 0


@pytest.mark.slow
def test_the_address_shows_the_same_picture(page, html):
    page.open(html)
    lamp = {"azimuth": 45, "elevation": 30, "color": "#ffaa66", "strength": 1.5, "softness": 12}
    state = START | dict(light=2, yaw=-35.5, tilt=10, view="shading", stops=0.5, lamps=[lamp], room=0.5)
    expected = page.pixels(**state)
    page.open(html, address="#" + page.run("relight.address()"))
    np.testing.assert_array_equal(page.pixels(), expected)
    page.open(html, address="#yaw=x&view=nothing&lamps=1,2;rubbish&figure=7&sh=1,2&light=none&split=9")
    page.run("relight.set({background: 'studio', split: 0.5})")
    assert {key: page.run(f"relight.state.{key}") for key in START} == START


def test_the_page_opens_with_one_turn_that_a_touch_ends(page, html):
    page.open(html, motion="no-preference")
    page.run("(async () => { while (!relight.state.yaw) await new Promise(requestAnimationFrame); })()")
    page.send("Input.dispatchKeyEvent", type="keyDown", key="0")
    page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    yaw = page.run("relight.state.yaw")
    page.run("new Promise((done) => setTimeout(done, 100))")
    assert page.run("relight.state.yaw") == yaw != 0


AS_FIREFOX = """{ const { prototype } = CanvasCaptureMediaStreamTrack, own = prototype.requestFrame;
MediaStream.prototype.requestFrame = function () { own.call(this.getVideoTracks()[0]); };
delete prototype.requestFrame; }"""


@pytest.mark.slow
@pytest.mark.parametrize("browser", ["", AS_FIREFOX], ids=["Chromium", "Firefox"])
def test_a_movie_is_one_turn_at_the_size_of_the_image(page, html, tmp_path, maps, lights, browser):
    page.open(html)
    page.run(browser)
    page.run(f"relight.set({json.dumps(START | {'yaw': 15})})")
    kind, data = page.run(
        """relight.record(() => {}, 1.5).then(async (movie) =>
        [movie.type, [...new Uint8Array(await movie.arrayBuffer())]])"""
    )
    path = tmp_path / ("turn.mp4" if "mp4" in kind else "turn.webm")
    path.write_bytes(bytes(data))
    with av.open(str(path)) as movie:
        frames = [frame.to_ndarray(format="rgb24") for frame in movie.decode(video=0)]
    assert len(frames) > 1 and frames[0].shape == (96, 96, 3)  # a slow machine leaves frames out
    turn = [codes(maps.albedo * relit_shading(maps, turned(lights["Window"], yaw, 0))) for yaw in range(15, 375, 20)]
    nearest = [np.argmin([np.abs(frame - picture)[maps.mask].mean() for picture in turn]) for frame in frames]
    onward = [step or len(turn) for step in np.trim_zeros(nearest, "f")]  # the last may be nearest to a whole turn
    assert nearest[0] == 0 and onward and onward == sorted(onward), "the light goes around"
    assert page.run("relight.state.yaw") == pytest.approx(15)


def test_a_browser_without_webgl_is_told_what_helps_for_good(page, html):
    source = "HTMLCanvasElement.prototype.getContext = () => null;"
    script = page.send("Page.addScriptToEvaluateOnNewDocument", source=source)["identifier"]
    try:
        with pytest.raises(RuntimeError, match="WebGL2"):
            page.open(html, 360, 700)
        page.run("window.dispatchEvent(new Event('resize'))")
        assert page.run("document.getElementById('panel').inert && document.getElementById('hint').hidden")
        assert "allow hardware acceleration" in page.run("document.getElementById('loading').innerText")
        box = page.run("document.getElementById('loading').getBoundingClientRect().toJSON()")
        assert 0 <= box["left"] and box["right"] <= 360
    finally:
        page.send("Page.removeScriptToEvaluateOnNewDocument", identifier=script)


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [("no.hdr", "no", "not a Radiance"),
     ("room.exr", "v/1\1\2", "OpenEXR panoramas are not read here: save it as Radiance .hdr.")],
)  # fmt: skip
def test_a_dropped_file_that_is_not_read_is_told_and_changes_nothing(page, html, name, data, says):
    page.open(html)
    told = page.call(
        """(name, text) => new Promise((done) => {
        const data = new DataTransfer(), toast = document.getElementById("toast");
        data.items.add(new File([text], name));
        new MutationObserver(() => done(toast.innerText)).observe(toast, { childList: true, characterData: true });
        document.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true })); })""",
        name, data,
    )  # fmt: skip
    assert says in told
    assert page.run("relight.lights().length") == 3 and page.run("document.getElementById('drop').hidden")


@pytest.mark.slow
def test_keyboard_mouse_and_touch_turn_the_light(page, html):
    page.open(html, 390, 844, 2, mobile=True)
    page.run(f"relight.set({json.dumps(START)})")

    keys = {"ArrowRight": ("yaw", 5), "ArrowUp": ("tilt", 5), "]": ("light", 1), "3": ("view", "shading")}
    for key, (name, value) in keys.items():
        for kind in ("keyDown", "keyUp"):
            page.send("Input.dispatchKeyEvent", type=kind, key=key)
        assert page.run(f"relight.state.{name}") == value
    page.run(f"relight.set({json.dumps(START)})")
    for kind, x in [("touchStart", 150), ("touchMove", 190), ("touchMove", 250)]:
        page.send("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": 200}])
    page.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert page.run("[relight.state.yaw, relight.state.tilt]") == pytest.approx([50, 0])
    page.open(html)
    for kind, y in [("mousePressed", 300), ("mouseMoved", 260), ("mouseReleased", 260)]:
        page.send("Input.dispatchMouseEvent", type=kind, x=200, y=y, button="left", buttons=1, clickCount=1)
    assert page.run("[relight.state.yaw, relight.state.tilt]") == pytest.approx([0, 20])


SAVED = """(button) => new Promise((done) => {
URL.createObjectURL = (blob) => { blob.arrayBuffer().then((b) => done([...new Uint8Array(b)])); return "#"; };
HTMLAnchorElement.prototype.click = function () { window.saved = this.download; };
document.getElementById(button).click(); })"""


@pytest.mark.parametrize(("button", "mode", "name"), [("save", "RGBA", "png"), ("jpeg", "RGB", "jpg")])
def test_a_saved_picture_is_that_of_the_page_at_its_own_size(balls, button, mode, name):
    expected = balls.pixels(**START | {"background": "clear", "yaw": 33})
    image = Image.open(io.BytesIO(bytes(balls.call(SAVED, button))))
    assert image.mode == mode and balls.run("window.saved") == f"Six balls Window.{name}"
    alpha, found = expected[..., 3:] / 255, np.asarray(image)
    if mode == "RGBA":
        np.testing.assert_array_equal(found[expected[..., 3] == 255], expected[expected[..., 3] == 255])
        np.testing.assert_array_equal(found[..., 3], expected[..., 3])
    else:
        off = [np.abs(found - expected[..., :3] * alpha - behind * (1 - alpha)).mean() for behind in (255, 0)]
        assert image.format == "JPEG" and off[0] < 2 < 20 < off[1]


def test_every_control_has_a_name_and_nothing_was_fetched(page, photo_html):
    page.open(photo_html)
    nodes = page.send("Accessibility.getFullAXTree")["nodes"]
    roles = ("button", "slider", "radio", "combobox", "ColorWell", "image", "img")
    names = [n["name"]["value"] for n in nodes if n["role"]["value"] in roles and not n["ignored"]]
    assert len(names) > 18 and all(name.strip() for name in names)
    requests = [e["params"]["request"]["url"] for e in page.events if e.get("method") == "Network.requestWillBeSent"]
    assert all(url.startswith(("file:", "data:")) for url in requests)
    assert not [e for e in page.events if e.get("method") == "Runtime.exceptionThrown"]


@pytest.mark.slow
def test_a_figure_has_its_maps_from_each_source(page, tmp_path, maps, lights):
    """Two figures with two sources each: one entry a figure, and the source stays when the figure changes."""
    dark = replace(maps, albedo=maps.albedo / 2)
    sources = {"truth": maps, "net": dark}
    figures = [Figure(title, own, source=source) for title in ("One", "Two") for source, own in sources.items()]
    build_viewer(tmp_path / "g.html", figures, lights)
    page.open(tmp_path / "g.html")

    pick = """async (name, text) => {
      const list = document.getElementById(name);
      list.value = [...list.options].find((option) => option.text === text).value;
      list.dispatchEvent(new Event("change"));
      while (!document.getElementById("loading").hidden) await new Promise(requestAnimationFrame);
    }"""
    chosen = "['figure', 'source'].map((name) => document.getElementById(name).selectedOptions[0].text)"
    assert page.run("document.getElementById('figure').options.length") == 2 and page.run(chosen) == ["One", "truth"]
    bright, half = (codes(a * relit_shading(maps, lights["Window"])) for a in (maps.albedo, dark.albedo))
    assert farthest(page.pixels(**START), bright, maps.mask) <= 2
    page.call(pick, "source", "net")
    assert page.run(chosen) == ["One", "net"]
    assert farthest(page.pixels(**START), half, maps.mask) <= 2
    page.call(pick, "figure", "Two")
    assert page.run(chosen) == ["Two", "net"]


STREET = """async (pixels, width, height, isBehind) => {
  const image = new ImageData(Uint8ClampedArray.from(pixels), width, height);
  const canvas = new OffscreenCanvas(width, height);
  canvas.getContext("2d").putImageData(image, 0, 0);
  const file = new File([await canvas.convertToBlob({ type: "image/png" })], "street.png", { type: "image/png" });
  await relight.openPlace(file, isBehind);
  const shown = relight.lights()[relight.state.light];
  return { name: shown.name, values: [...shown.values], background: relight.state.background };
}"""


def test_gallery_offers_its_figures_and_forgets_the_photo(page, tmp_path, maps, lights, photograph):
    layers = ("mask", "coverage", "albedo", "normal", "depth", "ao", "transport")
    small = replace(maps, **{name: getattr(maps, name)[8:88] for name in layers})
    figures = [Figure("One", maps, photograph[0] / 255, photograph[1]), Figure("Two", small)]
    build_viewer(tmp_path / "g.html", figures, lights, title="All")
    page.open(tmp_path / "g.html")
    assert page.run("[...document.getElementById('figure').options].map((option) => option.text)") == ["One", "Two"]
    assert page.run("relight.state.background") == "photo"
    page.run("relight.choose(1)")
    assert page.run("relight.state.background") == "studio"
    expected = codes(small.albedo * relit_shading(small, lights["Window"]))
    assert farthest(page.pixels(**START), expected, small.mask) <= 2
    page.run("relight.choose(0)")
    opened_place(page, photograph[0], False)
    for figure in (1, 0, 1):  # the light stays, though only a photo has the light that it was taken in
        page.run(f"relight.choose({figure})")
        assert page.run("relight.lights()[relight.state.light].name") == "street"
    own = page.run("[relight.lights()[0], relight.lights().at(-1)].map(({ values }) => [...values])")
    factor = exposure_factor(*np.reshape(own, (2, 9, 3)), small.transport, small.mask, turning=True)
    assert factor == pytest.approx(1, rel=0.01), "the user's light is as bright as the first"


@pytest.fixture(scope="module")
def street():
    """A picture of a place (H,W,3) uint8, bright on its left; of the size of the figure's images."""
    y, x = np.mgrid[:96, :96] / 96
    noise = np.random.default_rng(5).uniform(0.8, 1, (96, 96, 1))
    return np.rint(255 * encode((0.9 - 0.8 * x + 0 * y)[..., None] * noise * [1, 0.8, 0.5])).astype(np.uint8)


def opened_place(page, pixels, is_behind, alpha=255):
    rgba = np.dstack([pixels, np.full(pixels.shape[:2], alpha, np.uint8)])
    return page.call(STREET, rgba.ravel().tolist(), *pixels.shape[1::-1], is_behind)


@pytest.mark.slow
def test_a_place_lights_the_figure_before_its_picture_as_in_python(page, photo_html, maps, photograph, street):
    page.open(photo_html)
    photo, own = photograph
    before = page.run("relight.state.background")
    light = deringed(place_light(street))
    light = light * exposure_factor(own, light, maps.transport, maps.mask, turning=True)
    alone = opened_place(page, street, False)
    np.testing.assert_allclose(np.reshape(alone["values"], (9, 3)), light, rtol=1e-4, atol=1e-5 * light.max())
    assert alone["name"] == "street" and alone["background"] == before
    alpha = np.where(np.arange(96) < 48, np.uint8(0), np.uint8(255))
    half = deringed(place_light(np.where(alpha[:, None], street, 255)))
    half = half * exposure_factor(own, half, maps.transport, maps.mask, turning=True)
    found = np.reshape(opened_place(page, street, False, alpha)["values"], (9, 3))
    np.testing.assert_allclose(found, half, rtol=1e-4, atol=1e-5 * half.max(), err_msg="what is transparent is white")
    assert opened_place(page, street, True)["background"] == "picture"
    figure = inferred(photo, np.where(maps.mask, 255, 0).astype(np.uint8), maps, own)
    new = turned(light, 70, 0)
    behind = Background("picture", picture=street, shadow=False).matched(light, 1.0)
    for stops in (0, 1):
        expected = render(photo, [figure], new, "ratio", behind, stops=stops)
        index = page.run("relight.lights().length - 1")
        pixels = page.pixels(**START | {"light": index, "yaw": 70, "stops": stops, "background": "picture"})
        assert farthest(pixels, expected, ...) <= 2
    dark = page.pixels(**START | {"light": index, "room": 0.25, "background": "picture"})
    behind = Background("picture", picture=street, shadow=False).matched(light, 1.0, 0.25)
    assert farthest(dark, render(photo, [figure], light / 4, "ratio", behind), ~maps.mask) <= 2


@pytest.mark.slow
def test_a_picture_behind_covers_the_image_and_keeps_its_shape(page, photo_html, street):
    """A tall one and a wide one with a white disc in the middle: the disc stays round and in the middle."""
    page.open(photo_html)
    for height, width in ((300, 120), (120, 300)):
        y, x = np.mgrid[:height, :width]
        disc = np.hypot(x - width / 2 + 0.5, y - height / 2 + 0.5) < 50
        opened_place(page, np.where(disc[..., None], 255, 60).repeat(3, 2).astype(np.uint8), True)
        page.run(f"relight.set({json.dumps(START | {'background': 'picture'})})")
        pixels = page.pixels()[..., :3].astype(int)
        rim = np.hypot(*(np.mgrid[:96, :96] - 47.5)) / (50 * 96 / 120)
        bright = pixels.sum(-1) > pixels[0, 0].sum() + 60
        figure = page.pixels(background="clear")[..., 3] > 0
        assert bright[(rim < 0.95) & ~figure].all() and not bright[(rim > 1.05) & ~figure].any()
        assert bright[~figure].any() and not bright[~figure].all()
