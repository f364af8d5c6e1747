import numpy as np
from PIL import Image
from typer.testing import CliRunner

from relight.core.srgb import LINEAR, encode
from relight.lights import Light, lit_ball, load_light
from relight.lights.commands import app
from relight.lights.show import ALBEDO, diffuse_panorama, format_statistics, write_light_picture
from relight.panoramas import Panorama, project
from relight.sh import basis


def constant(value=1.0):
    light = np.zeros((9, 3))
    light[0] = value * np.sqrt(4 * np.pi) / np.pi  # irradiance `value` everywhere
    return light


def test_a_ball_under_constant_light_is_constant_and_round_and_has_no_main_direction():
    picture = lit_ball(constant(), 64)
    assert picture.shape == (64, 64, 4)
    np.testing.assert_allclose(picture[32, 32], [*encode(np.full(3, ALBEDO)), 1], atol=1e-9)
    assert picture[0, 0, 3] == 0 and abs(picture[..., 3].mean() - np.pi / 4) < 2e-3
    assert dict(format_statistics(Light(constant(), "even")))["main direction: right, up"] == "none"
    lamp = dict(format_statistics(load_light("key:#ffffff@40,10")))
    assert lamp["main direction: right, up"] == "+40°  +10°"


def test_the_centre_of_the_diffuse_panorama_is_minus_z():
    picture = diffuse_panorama(basis(np.array([0.0, 0.0, -1.0]))[:, None] * np.ones(3), 32)[..., 0]
    assert np.unravel_index(picture.argmax(), picture.shape)[1] in (31, 32)
    np.testing.assert_allclose(diffuse_panorama(constant(np.pi), 8), 1)


def test_a_picture_of_a_light_has_its_panorama_and_a_ball(tmp_path):
    for name, shape in (("room:7", (512, 1024, 3)), ("key:#ffffff@90,0", (256, 768, 3))):
        done = CliRunner().invoke(app, [name, "-o", str(tmp_path / "a.png")])
        picture = np.asarray(Image.open(tmp_path / "a.png"))
        assert done.exit_code == 0 and picture.shape == shape
    ball = picture[:, 512:, 0].astype(int)
    assert ball[128, 250] > ball[128, 128] > ball[128, 20] > ball[0, 0] == 20  # lit from the right, on dark ground
    CliRunner().invoke(app, ["key:#ff8000@0,0,0", "-o", str(tmp_path / "b.png")])
    shown = LINEAR[np.asarray(Image.open(tmp_path / "b.png"))[128, 640]]
    np.testing.assert_allclose(shown, 0.85 * np.array([1, LINEAR[128], 0]), atol=5e-3, err_msg="its own color")
    studio = np.zeros((32, 64, 3), np.float32)
    studio[8:16, 4:12], studio[8:16, 40:48] = 1, 4  # two softboxes in the dark
    write_light_picture(Light(project(Panorama(studio)), "studio", Panorama(studio)), tmp_path / "c.png")
    dim, bright = np.asarray(Image.open(tmp_path / "c.png"))[96, [64, 352], 0].astype(int)
    assert 60 < dim < bright - 60
