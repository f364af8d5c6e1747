import numpy as np
import pytest
from PIL import Image
from samples import lights_of

from relight.core.errors import UserError
from relight.core.srgb import encode
from relight.evaluation.pictures.canvas import ball, heat, transport_bands
from relight.evaluation.pictures.charts import plot_errors
from relight.evaluation.pictures.contact import clearest_light, contact_sheet, light_sheet
from relight.evaluation.pictures.panels import COLUMNS, Shown, evenly_spaced, plates, relit, shadings, swapped
from relight.evaluation.scoring.evaluate import infer, load, select_pairs
from relight.evaluation.scoring.scores import Scores
from relight.evaluation.scoring.tables import TABLE2_COLUMNS, experiment_table
from relight.maps import read_maps, write_left_out
from relight.photos.shading import shade
from relight.sh import unoccluded


def test_transport_bands_of_an_open_surface_that_faces_the_camera():
    grey, first, second = transport_bands(unoccluded(np.array([[0.0, 0, 1]])))
    np.testing.assert_allclose(grey, 1)
    np.testing.assert_allclose([first[0], second[0]], [[0.5, 0.5, 1]] * 2, atol=1e-6)


def test_ball_in_both_color_models():
    """Light from everywhere with irradiance (.4, .2, 1.25), white at .5: sRGB-encoded where it is linear."""
    light = np.zeros((9, 3))
    light[0] = np.array([0.4, 0.2, 1.25]) * np.sqrt(4 * np.pi) / np.pi
    shown = np.array([0.8, 0.4, 1])
    for linear, codes in ((True, encode(shown)), (False, shown)):
        picture = np.asarray(ball(light, 33, 0.5, linear))
        assert picture[16, 16, :3] == pytest.approx(255 * codes, abs=1)
        assert picture[0, 0, 3] == 0 and picture[16, 16, 3] == 255


def test_contact_sheet_shows_every_figure_that_is_not_left_out(world, tmp_path):
    write_left_out(tmp_path / "broken.exr", {"name": "broken"}, "it has no faces")
    light = np.zeros((9, 3), np.float32)
    light[0] = 0.9
    contact_sheet([*world.maps, tmp_path / "broken.exr"], light, tmp_path / "sheet.png")
    sheet = np.asarray(Image.open(tmp_path / "sheet.png"))
    assert sheet.shape[:2] == (48 + 2 * (240 + 26), 3 * (5 * (144 + 3) + 18) + 9)  # two rows of three figures
    assert (sheet == (243, 243, 240)).all(-1).mean() > 0.1
    contact_sheet([*world.maps, tmp_path / "broken.exr"], light, tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "sheet.png").read_bytes()
    with pytest.raises(UserError, match="no maps"):
        contact_sheet([tmp_path / "broken.exr"], light, tmp_path / "none.png")


def test_light_sheet_shows_every_light(tmp_path):
    reason = np.array([""] * 12 + ["bright back-lit"] * 2)
    light_sheet(lights_of(["train"] * 11 + ["test"] + ["unusual"] * 2, reason=reason), tmp_path / "lights.png")
    sheet = np.asarray(Image.open(tmp_path / "lights.png"))
    assert sheet.shape[:2] == (3 * 48 + 4 * 162, 10 * 162)  # rows of ten
    cells = (sheet == (243, 243, 240)).all(-1)
    corners = [cells[48 + 1, 81 - 54], cells[48 + 162 + 1, 81 - 54], cells[48 + 162 + 1, 81 - 54 + 162]]
    assert corners == [True, True, False]  # the eleventh stands alone in its row


def test_clearest_light_is_frontal_and_white():
    white, red = np.ones(3), np.array([1.5, 0.8, 0.7])
    lights = np.zeros((4, 9, 3))
    lights[:, 0] = 1  # the first is flat
    lights[1, [2, 3]] = 0.6 * red  # from the front, and red
    lights[1, 0] = red
    lights[2, 2] = -0.8 * white  # from behind
    lights[3, [2, 3]] = 0.6 * white  # from the front and the right
    assert (clearest_light(lights) == lights[3]).all() and (clearest_light(lights[:1]) == lights[0]).all()


def drawn(draw, folder, world, small_network, *names: str) -> tuple[np.ndarray, dict]:
    """The sheet (H,W,3) of untrained networks of these names, and their checkpoints."""
    networks = {name: folder / f"{name}.safetensors" for name in names}
    for name, checkpoint in networks.items():
        small_network(checkpoint, name, "photo")
    draw(Shown(networks, world.packed, world.lights, world.split, world.condition), folder / "sheet.png")
    return np.asarray(Image.open(folder / "sheet.png")).astype(int), networks


@pytest.mark.slow
def test_plates_show_the_truth_and_each_network(world, small_network, tmp_path):
    sheet, _ = drawn(plates, tmp_path, world, small_network, "ours", "sfsnet_ao")
    assert sheet.shape[0] == 60 + 3 * (3 * 306 + 24) + 4 * 24
    # Albedo of the truth: the sheet holds the first test figure's two stripe colors, sRGB-encoded.
    maps = read_maps(world.maps[3])
    colors = {tuple(c) for c in (encode(maps.albedo[maps.mask]) * 255).round().astype(int)}
    shown = sheet[60:360, 156:].reshape(-1, 3)
    for color in colors:
        assert (np.abs(shown - color).max(1) <= 2).sum() > 500
    surfaces = {"normal": (maps.normal[maps.mask] + 1) / 2, "AO": np.repeat(maps.ao[maps.mask, None], 3, 1)}
    for column, true in surfaces.items():
        truth, ours, sfsnet_ao = cells(sheet, COLUMNS.index(column))
        assert share_shown(truth, true) > 0.9
        assert np.ptp(ours) == 0 and np.ptp(sfsnet_ao) > 50, "only one of the two infers it"
    truth, ours, _ = cells(sheet, COLUMNS.index("shading error"))
    assert share_shown(truth, np.repeat(heat(np.zeros(1), 1), 40, 0)) == 1, "the truth has no error"
    assert truth.min() > 220 > ours.min()


def cells(sheet: np.ndarray, column: int) -> list[np.ndarray]:
    """The cells of a column of COLUMNS, of the first figure and two networks."""
    width = (sheet.shape[1] - 150 - 6) // len(COLUMNS) - 6
    left = 150 + column * (width + 6)
    return [sheet[top : top + 300, left : left + width] for top in (84 + 306 * row for row in range(3))]


def share_shown(cell: np.ndarray, colors: np.ndarray) -> float:
    """The share of colors (N,3) in [0,1], display-coded, that pixels of a cell have."""
    some = (colors[:: len(colors) // 40] * 255).round()
    return float(np.mean([(np.abs(cell.reshape(-1, 3) - color).max(1) <= 4).any() for color in some]))


def test_shadings_are_under_the_true_light_with_their_errors_below(world, small_network, tmp_path):
    sheet, networks = drawn(shadings, tmp_path, world, small_network, "ours", "sfsnet")
    wide = (sheet.shape[1] - 150 - 6) // 4
    columns = [sheet[:, 150 + place * wide : 144 + (place + 1) * wide] for place in range(4)]
    views, errors = ([column[top : top + 300] for column in columns] for top in (84, 84 + 306))
    maps = read_maps(world.maps[4])
    lights, split = (np.load(world.lights)[name] for name in ("coefficients", "split"))
    light = lights[split == "test"][0]
    true = np.maximum(maps.transport[maps.mask] @ light, 0)
    white = max(1.0, np.percentile(true, 99.5))
    assert share_shown(views[1], encode((true / white).clip(0, 1))) > 0.9
    for view, error, checkpoint in zip(views[2:], errors[2:], networks.values()):
        network, data = load(checkpoint, world.packed, world.lights)
        inferred = infer(network, data, 4, np.flatnonzero(split == "test")[:1])
        shading = shade(inferred.occluded_transport[0], light)
        assert share_shown(view, encode((shading / white).clip(0, 1))) > 0.9
        assert share_shown(error, heat(np.linalg.norm(shading - true, axis=-1), 0.5)) > 0.9


@pytest.mark.parametrize("unlearned", [frozenset(), frozenset({"light"})])
def test_relit_by_several_lights(world, small_network, tmp_path, monkeypatch, unlearned):
    """The truth has the colors of each test light; a network, which sees the first alone, has others."""
    monkeypatch.setattr("relight.evaluation.scoring.evaluate.unlearned", lambda loss: unlearned)
    sheet, _ = drawn(relit, tmp_path, world, small_network, "ours")
    lights, split = (np.load(world.lights)[name] for name in ("coefficients", "split"))
    maps = read_maps(world.maps[4])
    assert sheet.shape[0] == 60 + 24 + 2 * 306 + 4 * 24
    wide = (sheet.shape[1] - 150 - 6) // 2
    for place, light in enumerate(lights[split == "test"]):
        true = maps.albedo[maps.mask] * np.maximum(maps.transport[maps.mask] @ light, 0)
        column = sheet[:, 150 + place * wide : 150 + (place + 1) * wide]
        found = [share_shown(column[top : top + 300], encode(true.clip(0, 1))) for top in (84, 84 + 306)]
        assert found[0] > 0.9 and found[0] > found[1] + 0.3


def test_people_who_swap_lights(world, small_network, tmp_path, monkeypatch):
    """Each is relit by the light that is inferred of the other, and compared with their own picture in that light."""
    with monkeypatch.context() as patch:  # one light is none to swap: the sheet says so
        pairs = select_pairs
        patch.setattr("relight.evaluation.pictures.panels.select_pairs", lambda *a: (pairs(*a)[0], pairs(*a)[1][:1]))
        assert drawn(swapped, tmp_path, world, small_network, "ours")[0].shape[:2] == (60, 600)
    sheet, networks = drawn(swapped, tmp_path, world, small_network, "ours")
    assert sheet.shape[0] == 60 + 24 + 2 * 306 + 4 * 24, "the third test figure has no partner"
    lights, split = (np.load(world.lights)[name] for name in ("coefficients", "split"))
    first, second = np.flatnonzero(split == "test")
    network, data = load(networks["ours"], world.packed, world.lights)
    wide = (sheet.shape[1] - 150 - 6) // 4
    for row, (own, other, seen, new) in enumerate([(3, 4, first, second), (4, 3, second, first)]):
        cells = [sheet[84 + 306 * row :][:300, 150 + place * wide : 144 + (place + 1) * wide] for place in range(4)]
        maps = read_maps(world.maps[own])
        shaded = (np.maximum(maps.transport[maps.mask] @ lights[light], 0) for light in (seen, new))
        before, true = (maps.albedo[maps.mask] * shading for shading in shaded)
        mine, told = (infer(network, data, who, np.array([light])) for who, light in ((own, seen), (other, new)))
        relit_by_other = mine.albedo[0] * np.maximum(mine.transport[0] @ told.light[0], 0)
        for cell, colors in zip(cells, (before, relit_by_other, None, true)):
            assert colors is None or share_shown(cell, encode(colors.clip(0, 1))) > 0.9
        assert share_shown(cells[2], heat(np.linalg.norm(relit_by_other - true, axis=-1), 0.5)) > 0.9
    assert evenly_spaced(7, 3) == [0, 3, 6] and evenly_spaced(1, 4) == [0] and evenly_spaced(0, 3) == []


def test_plot_errors_is_reproducible(tmp_path):
    rng = np.random.default_rng(0)
    columns = {c: rng.random((5, 2)) for c in TABLE2_COLUMNS}
    given = {name: [Scores(list("abcde"), [0, 1], columns)] for name in ("sfsnet", "ours_full")}
    table = experiment_table("table1", given, {"mean_light": given["sfsnet"]})
    for name in ("a.png", "b.png"):
        plot_errors(table, ["sfsnet", "ours_full"], tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert Image.open(tmp_path / "a.png").width > 500
    for name in ("normal_rmse", "shading_rmse"):  # of quantities that no network infers, the shading
        table.columns = (name,)
        plot_errors(table, ["sfsnet", "ours_full"], tmp_path / f"{name}.png")
    assert (tmp_path / "normal_rmse.png").read_bytes() == (tmp_path / "shading_rmse.png").read_bytes()
