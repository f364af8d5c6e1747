"""A small figure, and a real Chromium driven over a pipe (DevTools protocol, no dependency)."""

import base64
import fcntl
import json
import os
import select
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from samples import snowman

from relight.sh import basis


@pytest.fixture(scope="session")
def maps():
    return snowman(96, 0)


@pytest.fixture(scope="session")
def lights():
    """Lamps of color over a soft sky: strong enough in bands 1 and 2 to show any slip of sign or order."""

    def light(direction, color, ambient):
        direction = np.array(direction) / np.linalg.norm(direction)
        return 0.8 * np.outer(basis(direction), color) + np.outer([1, 0.25, 0, 0, 0, 0, 0, 0, 0], ambient)

    return {
        "Window": light([-0.7, 0.5, 0.6], [1.0, 0.85, 0.7], [0.35, 0.4, 0.5]),
        "Lamp": light([0.6, 0.9, 0.2], [1.4, 0.9, 0.4], [0.25, 0.25, 0.3]),
        "Behind": light([0.3, 0.3, -0.9], [0.7, 0.9, 1.5], [0.3, 0.3, 0.3]),
    }


FLAGS = """--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --no-first-run
--disable-background-networking --disable-component-update --disable-sync --disable-quic --hide-scrollbars
--disable-renderer-backgrounding --disable-backgrounding-occluded-windows --remote-debugging-pipe"""


class Page:
    """One tab: `run` evaluates JavaScript (awaiting promises) and returns its JSON value."""

    def __init__(self, folder):
        found = filter(None, map(shutil.which, ("chromium", "google-chrome")))
        program = os.environ.get("CHROMIUM") or next(found, None)
        if program is None:
            pytest.skip("no Chromium on this machine")
        here, there = os.pipe(), os.pipe()  # the browser reads descriptor 3 and writes descriptor 4
        flags = [*FLAGS.split(), f"--user-data-dir={folder}"]

        def connect():
            read, write = fcntl.fcntl(here[0], fcntl.F_DUPFD, 10), fcntl.fcntl(there[1], fcntl.F_DUPFD, 10)
            os.dup2(read, 3)
            os.dup2(write, 4)

        options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
        options["env"] = os.environ | {"TMPDIR": str(folder)}
        self.process = subprocess.Popen([program, *flags], preexec_fn=connect, pass_fds=(3, 4), **options)
        os.close(here[0])
        os.close(there[1])
        self.to, self.back, self.buffer, self.number, self.session = here[1], there[0], b"", 0, None
        self.events = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.send("Page.bringToFront")  # a page behind another one draws once a second
        for domain in ("Page", "Runtime", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method, timeout=60, **parameters):
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + timeout
        while True:
            answer = self.receive(end - time.monotonic())
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self.events.append(answer)

    def receive(self, timeout):
        while b"\0" not in self.buffer:
            if not select.select([self.back], [], [], max(timeout, 0))[0]:
                raise TimeoutError("Chromium does not answer")
            if not (read := os.read(self.back, 1 << 20)):
                raise OSError("Chromium has ended")
            self.buffer += read
        message, _, self.buffer = self.buffer.partition(b"\0")
        return json.loads(message)

    def open(self, path, width=900, height=640, ratio=1, mobile=False, motion="reduce", address=""):
        """Loads a file or an http address; with reduced motion, as by default, it opens without a turn of the light."""
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": motion}])
        size = {"width": width, "height": height, "deviceScaleFactor": ratio, "mobile": mobile}
        self.send("Emulation.setDeviceMetricsOverride", **size)
        self.send("Emulation.setTouchEmulationEnabled", enabled=mobile)
        self.events.clear()
        self.send("Page.navigate", url="about:blank")  # else another address of the same page would not load it anew
        url = path if str(path).startswith("http") else Path(path).resolve().as_uri()
        self.send("Page.navigate", url=url + address)
        for _ in range(200):
            if self.run("document.readyState === 'complete' && !!window.relight"):
                break
            time.sleep(0.05)
        self.run("relight.ready")

    def run(self, script):
        answer = self.send("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise RuntimeError(details.get("exception", {}).get("description", details["text"]))
        return answer["result"].get("value")

    def call(self, function, *arguments):
        return self.run(f"({function})({', '.join(json.dumps(a) for a in arguments)})")

    def pixels(self, **state):
        """The picture at the image's own size, (H,W,4) uint8, in the state given."""
        text = self.call(
            """(state) => { relight.set(state); const all = relight.pixels(); let text = "";
            for (let i = 0; i < all.length; i += 8192) text += String.fromCharCode(...all.subarray(i, i + 8192));
            return btoa(text); }""",
            state,
        )
        size = self.run("[relight.figure().height, relight.figure().width, 4]")
        return np.frombuffer(base64.b64decode(text), np.uint8).reshape(size)

    def screenshot(self):
        """PNG bytes of what the window shows, after the next frame."""
        self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])

    def close(self):
        self.session = None
        try:
            self.send("Browser.close", timeout=5)
            self.process.wait(10)
        except (OSError, TimeoutError, subprocess.TimeoutExpired):
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        os.close(self.to)
        os.close(self.back)


@pytest.fixture(scope="session")
def page(tmp_path_factory):
    page = Page(tmp_path_factory.mktemp("chromium"))
    yield page
    page.close()
