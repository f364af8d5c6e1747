"""A site of `relight web` in a real Chromium: a photo in, and the maps of Python out; then without the server."""

import base64
import io
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from samples import encoded, photo_of_people, serving

from relight.core.errors import UserError
from relight.photos.network import read_network
from relight.photos.scene import Scene
from relight.viewer import runtime
from relight.viewer.build import build_viewer
from relight.viewer.figure import Figure
from relight.viewer.site import build_site
from relight.viewer.source import photo_figure

SIDE = 128  # of the network
PIXELS, ALPHA = photo_of_people(150, 110, (55,), 4)
STATE = {"light": 0, "yaw": 40, "tilt": 0, "stops": 0, "background": "photo", "before": "none", "view": "relit"}
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def exported(exported_network):
    if not runtime.package_file().is_file():
        pytest.skip("onnxruntime-web is not set up")
    return exported_network / "a.onnx"


@pytest.fixture(scope="module")
def site(tmp_path_factory, exported, maps, lights):
    folder = tmp_path_factory.mktemp("site") / "site"
    with pytest.MonkeyPatch.context() as patch:  # the user's network for masks would find somebody, or not
        patch.setattr("relight.viewer.site.network_file", lambda _: folder / "none")
        build_site(folder, exported, SIDE, [Figure("Balls", maps)], lights)
    return folder


@pytest.fixture
def server(site):
    with serving(site) as server:
        yield server


def until(page, expression, seconds=120):
    end = time.monotonic() + seconds
    while not page.run(expression):
        assert time.monotonic() < end, expression
        time.sleep(0.1)


def opened(page, data, name="me.png", is_whole=True):
    """Gives a file to the page as its button does, and waits for the figure if the photo `is_whole`, with a mask."""
    text = base64.b64encode(data).decode()
    page.call(
        """(text, name) => { const files = new DataTransfer();
        files.items.add(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], name, { type: "image/png" }));
        const input = document.getElementById("photo-file"); input.files = files.files;
        input.dispatchEvent(new Event("change")); }""",
        text, name,
    )  # fmt: skip
    if is_whole:
        until(page, f"relight.figure().title === '{name[:-4]}'")


def png(*layers):
    return encoded(Image.fromarray(np.dstack(layers)), "png")


def by_python(page, folder, exported, lights, *layers):
    """Opens the page that `relight view` makes of a photo."""
    figure = photo_figure(Scene.of(Image.fromarray(np.dstack(layers)), network=read_network(exported)))
    build_viewer(folder / "me.html", [figure], lights)
    page.open(folder / "me.html")


def test_a_photo_becomes_the_maps_of_python_and_nothing_is_sent(page, server, exported, lights, tmp_path):
    page.open(server.url)
    page.run("relight.engine()")
    before = list(server.asked)
    assert {line.split()[1] for line in before} >= {"/", "/sw.js", "/network.onnx"}
    opened(page, png(PIXELS, ALPHA))
    states = [STATE | {"mode": "full", "view": view} for view in ("albedo", "shading", "ao", "relit")]
    found = [page.pixels(**state) for state in states]
    for url in (f"{server.url}index.html?photo", "http://127.0.0.1:9/", "data:,x"):
        assert page.call("(url) => fetch(url).then(() => 'sent', () => 'refused')", url) == "refused"
    assert page.run(
        "new Promise((done) => { const image = new Image(); image.onload = () => done('sent'); "
        "image.onerror = () => done('refused'); image.src = 'index.html?photo'; })"
    ) == "refused"  # fmt: skip
    assert server.asked == before
    by_python(page, tmp_path, exported, lights, PIXELS, ALPHA)
    for state, mine in zip(states, found):
        assert np.abs(mine.astype(int) - page.pixels(**state)).max() <= 2, state["view"]


def test_a_photo_is_saved_at_its_own_size(page, server, exported, lights, tmp_path):
    pixels, alpha = (np.asarray(Image.fromarray(part).resize((300, 1200))) for part in (PIXELS, ALPHA))
    page.open(server.url)
    opened(page, png(pixels, alpha))
    shown = page.pixels(**STATE | {"mode": "ratio"})
    text = page.run(
        """new Promise((done) => { const made = URL.createObjectURL;
        URL.createObjectURL = (blob) => {
          const reader = new FileReader(); reader.onload = () => done(reader.result.split(",")[1]);
          reader.readAsDataURL(blob); URL.createObjectURL = made; return made(blob); };
        document.getElementById("save").click(); })"""
    )
    mine = np.asarray(Image.open(io.BytesIO(base64.b64decode(text))))
    assert shown.shape[:2] == (1024, 256) and mine.shape[:2] == (1200, 300)
    assert np.array_equal(page.pixels(), shown), "the page shows what it showed"
    by_python(page, tmp_path, exported, lights, pixels, alpha)
    assert np.abs(mine.astype(int) - page.pixels(**STATE | {"mode": "ratio"})).max() <= 2


def test_a_place_is_read_only_when_nothing_can_be_sent_any_more(page, server):
    page.open(server.url)
    sent, name = page.call(
        """async (text) => { const decode = window.createImageBitmap; let sent = "not read";
        window.createImageBitmap = async (...values) => {
          sent = await fetch("index.html?place").then(() => "sent", () => "refused");
          return decode(...values);
        };
        await relight.openPlace(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], "street.png"), true);
        return [sent, relight.lights().at(-1).name]; }""",
        base64.b64encode(png(PIXELS)).decode(),
    )
    assert sent == "refused" and name == "street"


def test_the_site_works_without_its_server(page, server):
    page.open(server.url)
    page.run("relight.engine()")
    until(
        page,
        """caches.keys().then(async (names) => { for (const name of names) {
        if ((await (await caches.open(name)).keys()).length >= 4) return true; } })""",
    )
    server.shutdown()
    server.server_close()
    page.open(server.url)
    page.run("relight.engine()")
    opened(page, png(PIXELS, ALPHA), "offline.png")


def released(site, folder, mark):
    """Another release of a site: its page and its worker differ by a mark."""
    shutil.copytree(site, folder, dirs_exist_ok=True)
    for name, words in (("index.html", "<title>"), ("sw.js", "${KIND}")):
        text = (folder / name).read_text()
        assert words in text
        (folder / name).write_text(text.replace(words, words + mark))


def test_a_returning_visitor_gets_the_new_release_whatever_the_browser_kept(page, site, tmp_path):
    """Not the page of the browser's own cache; and no page runs with the network of another release."""
    with serving(tmp_path / "live") as server:
        for mark in ("one ", "two "):
            released(site, tmp_path / "live", mark)
            page.open(server.url)
            page.run("relight.engine()")
            until(page, f"caches.keys().then((names) => names.some((name) => name.includes('{mark}')))")
        until(page, "caches.keys().then((names) => !names.some((name) => name.includes('one ')))")
        page.open(server.url)
        assert page.run("document.title").startswith("two ")
        network = (tmp_path / "live" / "network.onnx").read_bytes()
        (tmp_path / "live" / "network.onnx").write_bytes(network[:-1] + bytes([network[-1] ^ 1]))
        page.run("caches.keys().then((names) => Promise.all(names.map((name) => caches.delete(name))))")
        page.open(server.url)
        with pytest.raises(RuntimeError, match=r"network\.onnx is of another version than this page: reload the page"):
            page.run("relight.engine()")


def test_a_mask_is_painted_where_there_is_none(page, server):
    page.open(server.url, 900, 700)
    opened(page, png(PIXELS), is_whole=False)
    until(page, "!document.getElementById('brush').hidden")
    box = page.run("document.getElementById('brush').getBoundingClientRect().toJSON()")
    left, top, width, height = (box[name] for name in ("left", "top", "width", "height"))

    def stroke(*points):
        for i, (x, y) in enumerate(points):
            kind = "mousePressed" if i == 0 else "mouseMoved"
            page.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
        page.send("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", clickCount=1)

    middle = left + width / 2
    stroke((middle, top + 0.2 * height), (middle, top + 0.6 * height))
    stroke((middle, top + 0.5 * height), (middle + 60, top + 0.5 * height))
    page.run("document.getElementById('brush-undo').click()")
    page.run("document.querySelector('[name=brush][value=background]').click()")
    stroke((middle - 60, top + 0.25 * height), (middle + 60, top + 0.25 * height))
    page.run("document.getElementById('brush-done').click()")
    until(page, "relight.figure().title === 'me'")
    painted = page.pixels(view="albedo", background="clear")[..., 3]
    rows = np.flatnonzero(painted.any(1))
    scale = height / 150 if width / 110 > height / 150 else width / 110
    assert len(rows) > 20 and (painted > 0).sum() > 300
    assert painted.max(0).nonzero()[0].size <= 48 / scale + 2  # the stroke to the side was undone
    gap = painted[rows[0] : rows[-1]].max(1)
    assert (gap == 0).any()  # where the background was painted across
    assert page.run("document.getElementById('brush').hidden && !document.getElementById('edit-mask').hidden")


def press(page, *keys):
    """Presses keys; S- before a name holds Shift."""
    for key in keys:
        name = key.removeprefix("S-")
        event = {"key": " " if name == "Space" else name, "modifiers": 8 if name != key else 0}
        for kind in ("rawKeyDown", "keyUp"):
            page.send("Input.dispatchKeyEvent", type=kind, **event)


def test_a_mask_is_painted_by_keys_and_not_lost_by_escape(page, server):
    page.open(server.url, 900, 700)
    opened(page, png(PIXELS, ALPHA))
    figures = page.run("document.getElementById('figure').length")
    errors = [event for event in page.events if event.get("method") == "Runtime.exceptionThrown"]
    is_open = "!document.getElementById('brush').hidden"
    asks = "document.getElementById('brush-discard').open"

    def pixels_inside():
        return int((page.pixels(view="albedo", background="clear")[..., 3] > 0).sum())

    before = pixels_inside()
    page.run("document.getElementById('edit-mask').click()")
    until(page, is_open)
    press(page, "Escape")
    assert not page.run(is_open), "nothing was painted"
    page.run("document.getElementById('edit-mask').click()")
    until(page, is_open)
    press(page, "x", "Space", *["S-ArrowUp"] * 3, "ArrowLeft")
    press(page, "Escape")
    assert page.run(is_open) and page.run(asks)
    page.run("document.querySelector('#brush-discard [value=keep]').click()")
    assert page.run(is_open) and not page.run(asks)
    page.run("window.painted = relight.figure()")
    press(page, "z", "z", "y", "y", "Enter")
    until(page, f"!({is_open}) && relight.figure() !== window.painted")
    assert 0 < before - pixels_inside() < before
    assert page.run("document.getElementById('figure').length") == figures, "a correction takes the figure's place"
    page.run("document.getElementById('edit-mask').click()")
    until(page, is_open)
    press(page, "Space", "Escape")
    page.run("document.querySelector('#brush-discard [value=discard]').click()")
    until(page, f"!({is_open})")
    assert [event for event in page.events if event.get("method") == "Runtime.exceptionThrown"] == errors == []


def test_that_nobody_was_found_is_told_before_the_brush(page, server):
    page.open(server.url)
    page.run("relight.engine()")
    page.call(
        """async () => { const send = Worker.prototype.postMessage;
        Worker.prototype.postMessage = function (task, ...rest) {
        if (task.task !== "mask") return send.call(this, task, ...rest);
        const { width, height } = task.values.photo; Worker.prototype.postMessage = send;
        this.onmessage({ data: { id: task.id, result: new Uint8Array(width * height) } }); }; }"""
    )
    opened(page, png(PIXELS), is_whole=False)
    until(page, "document.getElementById('brush-why').checkVisibility()")
    assert page.run("document.getElementById('brush-why').innerText") == "Nobody was found in this photo."


def test_a_browser_without_simd_is_told_before_anything_is_loaded(page, server):
    source = "WebAssembly.validate = () => false;"
    script = page.send("Page.addScriptToEvaluateOnNewDocument", source=source)["identifier"]
    try:
        page.open(server.url)
        with pytest.raises(RuntimeError, match="no WebAssembly with SIMD"):
            page.run("relight.engine()")
    finally:
        page.send("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
    assert not any("network.onnx" in line for line in server.asked)


def test_what_is_no_picture_is_told(page, server):
    page.open(server.url)
    opened(page, b"no picture", is_whole=False)
    until(page, "document.getElementById('toast').innerText.includes('no picture that this browser reads')")
    assert page.run("relight.figure().title") == "Balls"


def test_other_folders_are_left_alone(tmp_path, monkeypatch, maps, lights):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    (tmp_path / "hosted").mkdir()
    for name in ("file", "hosted/sw.js", "hosted/network.onnx", "hosted/.git"):
        (tmp_path / name).write_text("")
    for name, message in {"mine": "letter.txt", "hosted": r"holds other files \(\.git\)", "file": "is a file"}.items():
        with pytest.raises(UserError, match=message):
            build_site(tmp_path / name, Path("none.onnx"), SIDE, [Figure("Balls", maps)], lights)
    assert (tmp_path / "mine" / "letter.txt").read_text() == "dear"
    (tmp_path / "new").mkdir()
    monkeypatch.chdir(tmp_path / "new")  # a shell there would see an empty folder that is no more
    for name in (".", "../new"):
        with pytest.raises(UserError, match="is the folder that you are in"):
            build_site(Path(name), Path("none.onnx"), SIDE, [Figure("Balls", maps)], lights)
