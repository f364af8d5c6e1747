"""Poly Haven's panoramas: made here by the layout of the package that holds them, and used by name."""

import io
from base64 import b64encode
from dataclasses import replace

import numpy as np
import OpenEXR
import pytest
from samples import tarball
from typer.testing import CliRunner

from relight.core.errors import UserError
from relight.lights import load_light
from relight.lights.commands import app
from relight.panoramas import Panorama, polyhaven, project
from relight.viewer.source import named_lights

PIXELS = np.random.default_rng(0).random((16, 32, 3)).astype(np.float32)


def exr(factor):
    file = io.BytesIO()
    OpenEXR.File({}, {"RGB": PIXELS * np.float32(factor)}).write(file)
    return file.getvalue()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of the known layout, which stands for the known version; each panorama has another brightness."""
    monkeypatch.setenv("RELIGHT_DATA", str(tmp_path / "data"))
    files = {"package/LICENSE": b"CC0", "package/models/bunny.glb.js": b""}
    for i, name in enumerate(polyhaven.NAMES, 1):
        files[f"package/hdri/{name}.exr.js"] = b"export default 'data:application/exr;base64,%s'\n" % b64encode(exr(i))
    path = tmp_path / "assets.tgz"
    monkeypatch.setattr(polyhaven, "PACKAGE", replace(polyhaven.PACKAGE, integrity=tarball(path, files)))
    return path


def test_setup_makes_names_of_lights(package):
    with pytest.raises(UserError, match="'park' is not set up: run once `relight light setup`"):
        load_light("park")
    done = CliRunner().invoke(app, ["setup", "--from", str(package)])
    assert done.exit_code == 0 and "apartment, bridge" in done.output
    assert len(list(polyhaven.panorama_folder().iterdir())) == 19
    for i, name in enumerate(polyhaven.NAMES, 1):
        np.testing.assert_allclose(load_light(name).coefficients, i * project(Panorama(PIXELS)), rtol=1e-5)
    assert [*named_lights(["hall", "park"])] == ["hall", "park"]
    turned = load_light("hall", yaw=90)
    assert turned.source == "hall" and turned.panorama.yaw == 90
    np.testing.assert_array_equal(load_light("hall:90").coefficients, turned.coefficients)


def test_load_light_prefers_a_file_and_lists_the_names(package, tmp_path, monkeypatch):
    polyhaven.setup(package)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hall").write_bytes(exr(0.5))
    np.testing.assert_allclose(load_light("hall").coefficients, 0.5 * project(Panorama(PIXELS)), rtol=1e-5)
    with pytest.raises(UserError, match=r"^hal is neither a file nor a light: give a lamp, .*, or hall$"):
        load_light("hal")
