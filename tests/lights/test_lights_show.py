import numpy as np
from samples import lights_of
from typer.testing import CliRunner

from relight.core.errors import UserError
from relight.core.srgb import encode
from relight.lights import Light, lit_ball, load_light, write_contact_sheet, write_light_set
from relight.lights.commands import app
from relight.lights.show import ALBEDO, diffuse_panorama, format_statistics
from relight.sh import basis


def constant(value=1.0):
    light = np.zeros((9, 3))
    light[0] = value * np.sqrt(4 * np.pi) / np.pi  # irradiance `value` everywhere
    return light


def test_a_ball_under_constant_light_is_constant_and_round():
    picture = lit_ball(constant(), 64)
    assert picture.shape == (64, 64, 4)
    np.testing.assert_allclose(picture[32, 32], [*encode(np.full(3, ALBEDO)), 1], atol=1e-9)
    assert picture[0, 0, 3] == 0 and abs(picture[..., 3].mean() - np.pi / 4) < 2e-3


def test_even_light_has_no_main_direction():
    assert dict(format_statistics(Light(constant(), "even")))["main direction: right, up"] == "none"
    lamp = dict(format_statistics(load_light("key:#ffffff@40,10")))
    assert lamp["main direction: right, up"] == "+40°  +10°"


def test_a_ball_is_bright_on_the_side_of_the_lamp():
    for toward, (row, column) in {(1, 0, 0): (32, 60), (-1, 0, 0): (32, 3), (0, 1, 0): (3, 32)}.items():
        picture = lit_ball(basis(np.array(toward, float))[:, None] * np.ones(3), 64)[..., 0]
        assert picture[row, column] > picture[32, 32] > picture[63 - row, 63 - column]


def test_the_centre_of_the_diffuse_panorama_is_minus_z():
    away = basis(np.array([0.0, 0.0, -1.0]))[:, None] * np.ones(3)
    picture = diffuse_panorama(away, 32)[..., 0]
    assert np.unravel_index(picture.argmax(), picture.shape)[1] in (31, 32)
    np.testing.assert_allclose(diffuse_panorama(constant(np.pi), 8), 1)


def test_a_contact_sheet_of_any_size_is_drawn(tmp_path):
    source = np.array(["a/very/long/path/of/a/panorama_in_a_folder.exr"] * 7)
    reason = np.array([""] * 5 + ["bright", "bright back-lit"])
    lights = lights_of(["train"] * 4 + ["test"] + ["unusual"] * 2, source=source, reason=reason)
    write_contact_sheet(lights, tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000
    write_contact_sheet(lights.of("train"), tmp_path / "b.png")
    assert (tmp_path / "b.png").stat().st_size < (tmp_path / "a.png").stat().st_size

    write_light_set(lights, tmp_path / "lights.npz")
    done = CliRunner().invoke(app, [str(tmp_path / "lights.npz"), "-o", str(tmp_path / "c.png")])
    assert done.exit_code == 0 and (tmp_path / "c.png").read_bytes() == (tmp_path / "a.png").read_bytes()
    for options in ([], ["-o", str(tmp_path / "c.json")]):
        refused = CliRunner().invoke(app, [str(tmp_path / "lights.npz"), *options]).exception
        assert isinstance(refused, UserError) and "draw all with --out sheet.png" in str(refused)
