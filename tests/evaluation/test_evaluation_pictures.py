import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from relight.config import Evaluate
from relight.evaluation.canvas import box_of, cut_out, fitted, font, heat, light_sphere, transport_bands
from relight.evaluation.contact import clearest, contact_sheet, grown, views
from relight.evaluation.occlusion import UNTOLD, Occlusion, by_garment, by_pose, occlusion, occlusions, read_occlusions
from relight.evaluation.page import Section, build_page, fold, grid, picture, prose, settings_list
from relight.evaluation.plates import plates
from relight.evaluation.plots import plot_curves, plot_errors, plot_occlusion
from relight.evaluation.scores import Scores
from relight.evaluation.tables import COLUMNS2, experiment_table
from relight.files import UserError
from relight.maps import read_maps, write_left_out
from relight.sh import unoccluded
from relight.srgb import encode


def test_occlusion_has_the_worlds_closed_form(world, tmp_path):
    """There T = AO * T(n), so |T - T(n)| = (1 - AO) |T(n)|."""
    maps = read_maps(world.maps[0])
    found = occlusion(maps)
    ao = maps.ao[maps.mask]
    norm = np.linalg.norm(unoccluded(maps.normal[maps.mask]), axis=1)
    assert found.lost == pytest.approx(np.sqrt((((1 - ao) * norm) ** 2).mean()), rel=2e-3)
    assert (found.ao, found.dark) == pytest.approx((ao.mean(), (ao < 0.5).mean()))
    np.testing.assert_allclose(found.histogram, np.histogram(ao, 20, (0, 1))[0] / len(ao))
    assert found.histogram[:10].sum() == pytest.approx(found.dark, abs=2 / len(ao))


def test_occlusion_is_a_table_of_all_that_were_not_left_out(world, tmp_path):
    write_left_out(tmp_path / "broken.exr", {"name": "broken"}, "it is a plane")
    made = occlusions([*world.maps, tmp_path / "broken.exr"], tmp_path / "occlusion.csv")
    assert [one.name for one in made] == [path.stem for path in world.maps]
    assert {one.pose for one in made} == {UNTOLD} and all(one.garments == [UNTOLD] for one in made)
    for one, read in zip(made, read_occlusions(tmp_path / "occlusion.csv"), strict=True):
        assert (read.name, read.pose, read.garments, read.pixels) == (one.name, one.pose, one.garments, one.pixels)
        assert (read.ao, read.dark, read.lost) == pytest.approx((one.ao, one.dark, one.lost), abs=1e-5)
        np.testing.assert_allclose(read.histogram, one.histogram, atol=1e-5)
    (tmp_path / "other.csv").write_text("name,pixels\na,1\n")
    with pytest.raises(UserError, match="not a table of occlusion"):
        read_occlusions(tmp_path / "other.csv")


def a_figure(name, pose, garments, ao):
    return Occlusion(name, pose, garments, 100, ao, 1 - ao, 2 * (1 - ao), np.full(20, 0.05))


def test_occlusion_is_grouped_by_pose_and_by_garment():
    found = [
        a_figure("a", "sitting", ["jeans", "shirt"], 0.7),
        a_figure("b", "walking", ["jeans", "jeans"], 0.9),
        a_figure("c", "walking", ["hooded coat"], 0.8),
    ]
    sitting, walking = by_pose(found)
    assert (sitting.name, sitting.figures, sitting.ao) == ("sitting", 1, 0.7)
    assert (walking.figures, walking.least, walking.most) == (2, 0.8, 0.9)
    assert (walking.ao, walking.dark, walking.lost) == pytest.approx((0.85, 0.15, 0.3))
    counts = {one.name: (one.figures, round(one.ao, 6)) for one in by_garment(found)}
    assert counts == {"shirt": (1, 0.7), "jeans": (2, 0.8), "hooded coat": (1, 0.8)}
    assert list(counts) == ["shirt", "hooded coat", "jeans"]  # darkest first, then by name


def test_bands_of_an_open_surface_that_faces_the_camera():
    grey, first, second = transport_bands(unoccluded(np.array([[0.0, 0, 1]])))
    np.testing.assert_allclose(grey, 1)
    np.testing.assert_allclose(first[0], [0.5, 0.5, 1], atol=1e-6)
    np.testing.assert_allclose(second[0], [0.5, 0.5, 1], atol=1e-6)


def test_cells_show_the_figure_on_the_ground():
    colors, alpha = np.zeros((8, 8, 3)), np.zeros((8, 8))
    colors[2:6, 2:6], alpha[2:6, 2:6] = (1, 0, 0), 1
    cell = np.asarray(cut_out(colors, alpha, (80, 80)))
    assert tuple(cell[40, 40]) == (255, 0, 0) and tuple(cell[1, 1]) == (243, 243, 240)
    assert np.all(np.diff(heat(np.linspace(0, 1, 9), 1).sum(-1)) < 0)  # darker with the error


def test_the_light_sphere_is_brightest_toward_the_light():
    light = np.zeros((9, 3))
    light[0], light[1] = 0.6, (0.5, 0.3, 0.1)  # from above, reddish
    ball = np.asarray(light_sphere(light, 64, 2.5, linear=True)).astype(int)
    assert ball[4, 32, 0] > ball[32, 32, 0] > ball[60, 32, 0]
    assert ball[0, 0, 3] == 0 and ball[32, 32, 3] == 255


def test_words_are_broken_and_shrunk_to_fit():
    width = font(14).getlength("extraordinarily")
    words, size = fitted("an extraordinarily long word", 20, int(width), False)
    assert words == "an\nextraordinarily\nlong word" and size <= 14
    assert fitted("short", 20, 200, False) == ("short", 20)


def test_box_holds_all_masks():
    masks = np.zeros((2, 50, 50), bool)
    masks[0, 10:20, 5:9], masks[1, 30:45, 20:30] = True, True
    assert box_of(list(masks)) == (slice(8, 47), slice(3, 32))


def test_contact_sheet_shows_every_figure(world, tmp_path):
    write_left_out(tmp_path / "broken.exr", {"name": "broken"}, "it has no faces")
    light = np.zeros((9, 3), np.float32)
    light[0] = 0.9
    contact_sheet([*world.maps, tmp_path / "broken.exr"], light, tmp_path / "sheet.png", height=100)
    sheet = np.asarray(Image.open(tmp_path / "sheet.png"))
    assert sheet.shape[:2] == (48 + 126, 7 * (5 * (60 + 3) + 18) + 9)  # seven figures side by side
    assert (sheet == (243, 243, 240)).all(-1).mean() > 0.1
    again = tmp_path / "again.png"
    contact_sheet([*world.maps, tmp_path / "broken.exr"], light, again, height=100)
    assert again.read_bytes() == (tmp_path / "sheet.png").read_bytes()
    with pytest.raises(UserError, match="no maps"):
        contact_sheet([], light, tmp_path / "none.png")


def test_sheets_are_lit_by_what_shows_forms_and_colours():
    white, red = np.ones(3), np.array([1.5, 0.8, 0.7])
    lights = np.zeros((4, 9, 3))
    lights[:, 0] = 1  # the first is flat
    lights[1, [2, 3]] = 0.6 * red  # from the front, and red
    lights[1, 0] = red
    lights[2, 2] = -0.8 * white  # from behind
    lights[3, [2, 3]] = 0.6 * white  # from the front and the right
    assert (clearest(lights) == lights[3]).all()
    assert (clearest(lights[:1]) == lights[0]).all()


def test_a_sheet_is_exposed_for_each_figure(world):
    maps = read_maps(world.maps[0])
    light = np.zeros((9, 3), np.float32)
    light[0] = 0.9
    for dim, bright in zip(views(maps, 0.1 * light), views(maps, light), strict=True):
        np.testing.assert_allclose(dim, bright, atol=1e-5)


def test_edges_of_a_figure_take_its_colours():
    mask = np.zeros((8, 8), bool)
    mask[2:6, 2:6] = True
    colors = np.where(mask[..., None], 0.7, 0.0)
    assert (grown(colors, mask) == 0.7).all()


def test_plates_show_the_truth_and_each_network(world, small_network, tmp_path):
    checkpoints = {}
    for name in ("ours", "sfsnet_ao"):
        checkpoints[name] = tmp_path / f"{name}.safetensors"
        small_network(checkpoints[name], name, "photo")
    out = tmp_path / "plates.png"
    plates(checkpoints, world.packed, world.lights, world.split, world.settings, out)
    sheet = np.asarray(Image.open(out)).astype(int)
    assert sheet.shape[0] == 60 + 2 * (3 * 306 + 24) + 76
    # Albedo of the truth: the sheet holds the first test figure's two stripe colours, sRGB-encoded.
    maps = read_maps(world.maps[3])
    colors = {tuple(c) for c in (encode(maps.albedo[maps.mask]) * 255).round().astype(int)}
    shown = sheet[60:360, 156:].reshape(-1, 3)
    for color in colors:
        assert (np.abs(shown - color).max(1) <= 2).sum() > 500


def test_charts_are_made_and_are_the_same_again(tmp_path):
    rng = np.random.default_rng(0)
    columns = {c: rng.random((5, 2)) for c in COLUMNS2}
    given = {name: [Scores(list("abcde"), [0, 1], columns)] for name in ("sfsnet", "ours_full")}
    table = experiment_table("table1", given, {"mean_light": given["sfsnet"]}, Evaluate(100, 1, 6, "test", "cpu", 0, 1))
    for name in ("a.svg", "b.svg", "c.png"):
        plot_errors(table, ("shading_rmse", "transport_rmse", "ao_rmse"), tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert Image.open(tmp_path / "c.png").width > 500
    curve = "step,lr,loss,light\n10,.1,3,.2\n20,.1,1,.1\n"
    for name in ("ours_full.s0.csv", "ours_full.s1.csv", "sfsnet.s0.csv"):
        (tmp_path / name).write_text(curve)
    plot_curves(sorted(tmp_path.glob("*.csv")), tmp_path / "curves.svg")
    assert (tmp_path / "curves.svg").stat().st_size > 5000
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match="not a training curve"):
        plot_curves([tmp_path / "bad.csv"], tmp_path / "none.svg")


def test_occlusion_is_charted_beside_what_the_paper_implies(tmp_path):
    found = [a_figure("a", "sitting", [], 0.7), a_figure("b", "walking", [], 0.9)]
    for name in ("a.svg", "b.svg"):
        plot_occlusion(found, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    with pytest.raises(UserError, match="no figures"):
        plot_occlusion([], tmp_path / "none.svg")


class Outline(HTMLParser):
    """Names and links of a page, and whether its elements that need an end have one."""

    def __init__(self):
        super().__init__()
        self.names, self.links, self.sources, self.open = [], [], [], []

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.names += [attrs["id"]] if "id" in attrs else []
        self.links += [attrs["href"]] if tag == "a" else []
        self.sources += [attrs["src"]] if "src" in attrs else []
        if tag in ("table", "div", "figure", "section", "main", "details", "nav", "p", "label"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag in ("table", "div", "figure", "section", "main", "details", "nav", "p", "label"):
            assert self.open.pop() == tag


def test_the_page_stands_alone(tmp_path):
    Image.new("RGB", (30, 20), "red").save(tmp_path / "a.png")
    noise = np.random.default_rng(0).integers(0, 255, (600, 700, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "big.png")
    sections = [
        Section("Tables & more", prose("One **bold** <word>.\n\nTwo `code`."), "an aside"),
        Section("Tables & more", picture(tmp_path / "a.png", 'a "red" <box>') + picture(tmp_path / "big.png", "noise")),
        Section("Settings", fold("all", settings_list({"train": {"lr": 0.1, "none": None}, "name": "demo"}))),
        Section("Left out", grid(["figure", "why", "share"], [["<g1>", "too thin", 0.12345], ["g2", "holes", 3]])),
    ]
    out = tmp_path / "report.html"
    build_page("A <report>", sections, out, lead="of a run")
    text = out.read_text()
    page = Outline()
    page.feed(text)
    assert page.open == [] and page.links == [f"#{name}" for name in page.names] and len(set(page.names)) == 4
    assert len(page.sources) == 2 and all(source.startswith("data:image/") for source in page.sources)
    assert page.sources[1].startswith("data:image/jpeg")
    assert not re.search(r"(?:src|href)=[\"']?(?:https?:|//)|@import|url\(", text)
    assert "A &lt;report&gt;" in text and "<b>bold</b> &lt;word&gt;" in text and "train.lr" in text and "0.123" in text
    assert "&lt;g1&gt;" in text and "&quot;red&quot;" in text
    first = out.read_bytes()
    build_page("A <report>", sections, out, lead="of a run")
    assert out.read_bytes() == first
    (tmp_path / "a.gif").write_bytes(b"GIF")
    with pytest.raises(UserError, match="kinds"):
        picture(tmp_path / "a.gif", "no")
