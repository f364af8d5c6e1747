"""Packages of the npm registry come only in the version that is known."""

import base64
import hashlib
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest

from relight.core.download import Package, fetch
from relight.core.errors import UserError

DATA = b"the package"
PACKAGE = Package("@scope/name", "1.2.3", base64.b64encode(hashlib.sha512(DATA).digest()).decode(), "relight x setup")


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture
def registry(tmp_path, monkeypatch):
    (folder := tmp_path / "registry" / PACKAGE.name / "-").mkdir(parents=True)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=tmp_path / "registry"))
    Thread(target=server.serve_forever, daemon=True).start()
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", f"http://127.0.0.1:{server.server_port}/")
    yield folder
    server.shutdown()
    server.server_close()


def test_fetch_from_the_registry_that_npm_would_ask(registry):
    (registry / "name-1.2.3.tgz").write_bytes(DATA)
    assert fetch(PACKAGE) == DATA
    (registry / "name-1.2.3.tgz").unlink()
    hint = r"run `npm pack @scope/name@1\.2\.3` where .*, then `relight x setup --from scope-name-1\.2\.3\.tgz`$"
    with pytest.raises(UserError, match=rf"^@scope/name 1\.2\.3 could not be downloaded \(File not found\): {hint}"):
        fetch(PACKAGE)


@pytest.mark.parametrize("address", ["nonsense", "http://127.0.0.1:99999", "http://[bad", "file:///nowhere"])
def test_fetch_with_an_address_that_is_none(registry, monkeypatch, address):
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", address)
    with pytest.raises(UserError, match="could not be downloaded"):
        fetch(PACKAGE)


def test_fetch_refuses_another_file(tmp_path):
    (file := tmp_path / "other.tgz").write_bytes(DATA)
    assert fetch(PACKAGE, file) == DATA
    file.write_bytes(DATA + b"x")
    with pytest.raises(UserError, match=r"other\.tgz is not @scope/name 1\.2\.3: its SHA-512 differs"):
        fetch(PACKAGE, file)
    with pytest.raises(UserError, match="there is no file"):
        fetch(PACKAGE, tmp_path / "none.tgz")
