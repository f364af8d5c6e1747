import json
import os
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from samples import write_exr
from typer.testing import CliRunner

from relight.cli import app
from relight.core.errors import UserError
from relight.lights import build_light_set, chain, measure, read_light_set, reference_brightness, write_light_set
from relight.lights.chain import generated_light, project_panoramas
from relight.lights.cluster import choose_validation_lights, irradiance_features, medoids
from relight.lights.load import GENERATED, NAMED, load_light
from relight.lights.select import RULES as ALL_RULES
from relight.lights.select import broken_rules, select_lights
from relight.lights.table import SPLITS
from relight.panoramas.color import blackbody, daylight
from relight.settings import Panoramas, read_preset
from relight.settings.setting import setting_of
from relight.sh import basis, irradiance, rotate_y, sphere_quadrature

SETTINGS = replace(read_preset("lights"), clusters=12, test=3)
RULES = ALL_RULES["rooms"]
ROOMS = Panoramas(source="generated", count=40, skies=0, layout="auto", flip=False)


@pytest.fixture(scope="module")
def rooms():
    return [f"room:{i}" for i in range(40)], np.stack([generated_light(f"room:{i}", 2) for i in range(40)])


@pytest.mark.parametrize("order", ["cut_first", "paper"])
@pytest.mark.parametrize("split", ["room", "random"])
@pytest.mark.slow
def test_the_light_set_has_the_properties_that_the_settings_ask_for(rooms, order, split):
    sources, coefficients = rooms
    lights, record = select_lights(coefficients, sources, replace(SETTINGS, order=order, split=split))
    usual = lights.rows(np.isin(lights.split, ("train", "validation", "test")))
    if order == "cut_first":
        assert [int((lights.split == part).sum()) for part in ("train", "validation", "test")] == [8, 1, 3]
    assert (lights.split == "test").sum() >= 1
    reference = reference_brightness(usual.coefficients)
    assert reference.min() >= 0.7 - 1e-6 and reference.max() <= 0.9 + 1e-6
    assert len(set(usual.source)) == len(usual)  # one light per room
    assert not np.any(list(broken_rules(usual.coefficients, RULES).values()))
    for mark in ("unusual", "rich"):
        assert len(lights.of(mark)) and all(lights.of(mark).reason)
    assert not any(usual.reason)
    train, validation, test, unusual, rich = ({*lights.of(mark).source} for mark in SPLITS)
    assert not unusual & (train | validation | rich) and not rich & (test - train) and not validation & (train | test)
    assert abs(len(lights.of("unusual")) - len(lights.of("rich"))) <= len(usual)
    by_source = dict(zip(sources, coefficients))
    for i in range(0, len(lights), 5):  # every row can be made again from what it says of itself
        again = rotate_y(by_source[lights.source[i]], np.radians(lights.yaw[i])) * lights.scale[i]
        np.testing.assert_allclose(lights.coefficients[i], again, rtol=1e-5, atol=1e-6)
    for before, after in zip(record["steps"], record["steps"][1:]):
        assert before["out"] == after["in"]
    json.dumps(record)


def test_no_room_is_on_both_sides(rooms):
    _, coefficients = rooms
    few = [f"room:{i // 8}" for i in range(40)]  # five rooms of eight pictures: more than one light each
    lights, _ = select_lights(coefficients, few, SETTINGS)
    assert not {*lights.of("train").source, *lights.of("validation").source} & set(lights.of("test").source)
    assert len(lights.of("test"))


def test_extra_test_lights_are_of_other_rooms_and_change_no_other_light(rooms):
    sources, coefficients = rooms
    plain, _ = select_lights(coefficients, sources, SETTINGS)
    more, record = select_lights(coefficients, sources, replace(SETTINGS, extra_test=500))
    extra = more.rows(np.arange(len(plain), len(more)))
    for name in vars(plain):
        np.testing.assert_array_equal(getattr(more, name)[: len(plain)], getattr(plain, name))
    assert set(extra.split) == {"test"} and record["lights"]["test"] == len(plain.of("test")) + len(extra)
    assert len(extra) and not set(extra.source) & set(plain.rows(plain.split != "unusual").source)
    assert not any(extra.reason) and not np.any(list(broken_rules(extra.coefficients, RULES).values()))
    assert any("of 500 found" in warning for warning in record["warnings"])


@pytest.mark.parametrize(("count", "chosen"), [(1, 0), (2, 1), (4, 1), (40, 4), (400, 8)])
def test_choose_validation_lights_takes_a_tenth_and_leaves_one(count, chosen):
    found = choose_validation_lights(np.random.default_rng(0).normal(size=(count, 9, 3)))
    assert len(set(found.tolist())) == len(found) == chosen and set(found.tolist()) <= set(range(count))


def test_a_single_lamp_from_behind_makes_a_light_set_with_a_warning(caplog):
    behind = 5 * lamp(0.0, -0.8, -0.6, fill=0)
    lights, record = select_lights(behind[None], ["lamp"], replace(SETTINGS, clusters=6, test=2))
    assert len(lights.of("test")) and len(lights.of("train"))
    assert any("rules" in warning for warning in record["warnings"]) and "rules" in caplog.text


def test_strong_lights_are_those_of_all_kinds_exposed_as_a_camera_would():
    sources, coefficients, *_ = project_panoramas(replace(ROOMS, count=1, skies=3, lamps=12), 2)
    assert sources == ["room:0", "sky:0", "sky:1", "sky:2", *(f"lamps:{seed}" for seed in range(12))]
    lights, _ = select_lights(coefficients, sources, replace(SETTINGS, rules="strong"))
    normals, _ = sphere_quadrature(24)
    brightest = [irradiance(light, normals[normals[:, 2] > 0]).max() for light in lights.coefficients]
    assert 0.95 * RULES.channel < max(brightest) < 1.001 * RULES.channel
    assert reference_brightness(lights.of("train").coefficients).min() < 0.6  # not to be brighter elsewhere


def test_the_threshold_removes_dark_rooms_unless_the_units_differ(rooms):
    sources, coefficients = rooms
    _, record = select_lights(coefficients, sources, SETTINGS)
    assert record["steps"][0]["why"].get("dark", 0) == int((reference_brightness(coefficients) < 0.2).sum())
    _, record = select_lights(coefficients / 1000, sources, SETTINGS)
    assert "other units" in record["warnings"][0] and record["steps"][0]["out"] == 40


def lamp(x, y, z, fill=0.3):
    light = basis(np.array([x, y, z]) / np.linalg.norm([x, y, z]))[:, None] * np.ones((1, 3))
    light[0] += fill
    return light * 0.8 / reference_brightness(light)


def test_each_rule_finds_its_kind_of_light():
    good = lamp(0.3, 0.6, 0.7)
    cases = {
        "back-lit": lamp(0, 0.3, -0.5, fill=0.8),
        "contrast": lamp(1, 0, 0.2, fill=0.0),
        "color": good * [1, 0.5, 0.1],
        "from-below": lamp(0.2, -0.8, 0.6),
        "dim": good * 0.3,
        "bright": good * 3,
    }
    found = broken_rules(np.stack([good, *cases.values()]), RULES)
    assert not any(rule[0] for rule in found.values())
    for i, name in enumerate(cases, 1):
        assert found[name][i], name


@pytest.mark.parametrize("kelvin, camera, unusual", [(2900, 5000, False), (3200, 6500, False), (2000, 6500, True)])
def test_tungsten_under_a_daylight_white_balance_is_usual_and_candles_are_not(kelvin, camera, unusual):
    """The lights that the paper's authors released have ln(B/G) down to -.8."""
    light = lamp(0.3, 0.6, 0.7) * (blackbody(kelvin) / daylight(camera))
    light *= 0.8 / reference_brightness(light)
    assert measure(light[None])["blue"][0] < -0.8
    found = {name for name, rule in broken_rules(light[None], RULES).items() if rule[0]}
    assert "color" in found if unusual else not found


def test_features_measure_the_distance_of_irradiance():
    a, b = np.random.default_rng(0).normal(size=(2, 9, 3))
    d, w = sphere_quadrature(8)
    squared = np.sum(w[:, None] * (irradiance(a, d) - irradiance(b, d)) ** 2)
    distance = np.linalg.norm(np.subtract(*irradiance_features(np.stack([a, b]))))
    assert abs(distance - np.sqrt(squared)) < 1e-12


def test_medoids_are_lights_of_the_set_from_different_sources():
    lights = np.random.default_rng(0).normal(size=(60, 9, 3))
    for sources, most in ((30, 1), (5, 2)):
        chosen = medoids(lights, np.repeat(np.arange(sources), 60 // sources), 10, 0)
        assert len(set(chosen)) == 10 and np.bincount(chosen // (60 // sources)).max() <= most


def test_the_weight_of_a_panorama_does_not_depend_on_its_number_of_copies():
    """Two panoramas with forty copies each lie together, twenty with two each far apart: those get the clusters."""
    rng = np.random.default_rng(0)
    crowd, few = rng.normal(0, 0.5, (80, 9, 3)), np.repeat(rng.normal(0, 1, (20, 9, 3)), 2, axis=0)
    sources = np.concatenate([np.repeat([20, 21], 40), np.repeat(np.arange(20), 2)])
    assert (sources[medoids(np.concatenate([crowd, few]), sources, 12, 0)] < 20).sum() >= 10


def test_statistics_of_known_lights():
    even = np.zeros((9, 3))
    even[0] = np.sqrt(4 * np.pi) / np.pi
    colored = basis(np.array([0.0, 0.6, 0.8]))[:, None] * np.array([1.0, 0.5, 0.25])
    m = measure(np.stack([even, colored]))
    assert np.allclose(m["reference"][0], 1) and np.allclose(m["mean"][0], 1) and np.allclose(m["up"][0], 1)
    assert np.allclose(m["first"][1], np.sqrt(3)) and np.allclose(m["second"][1], np.sqrt(5))
    assert np.allclose(m["elevation"][1], np.degrees(np.arcsin(0.6))) and np.allclose(m["azimuth"][1], 0)
    assert np.allclose(m["red"][1], np.log(2)) and np.allclose(m["blue"][1], -np.log(2))
    assert m["moment"][0] > 0.3 and abs(m["moment"][1]) < 1e-12  # a lamp is on the edge of what can exist
    colored[4:] *= 1.2
    assert measure(colored[None])["moment"][0] < -0.01


def test_table_round_trip(rooms, tmp_path):
    lights, _ = select_lights(rooms[1], rooms[0], SETTINGS)
    write_light_set(lights, tmp_path / "set")
    again = read_light_set(tmp_path / "set" / "lights.csv")
    for name in vars(lights):
        np.testing.assert_array_equal(getattr(lights, name), getattr(again, name))
    text = tmp_path / "set" / "lights.csv"
    lines = text.read_text().splitlines()
    assert len(lines) == 1 + len(lights) and "L2-1_G" in lines[0] and lights.source[0] in lines[1]
    with np.load(tmp_path / "set" / "lights.npz") as stored:  # what learning reads, without pandas or pickle
        assert stored["coefficients"].dtype == np.float32 and set(stored["split"]) <= set(SPLITS)
    np.testing.assert_array_equal(load_light(f"{text}:1").coefficients, lights.coefficients[1])
    with pytest.raises(UserError, match=r"lights.csv is a set of lights: name one of them, such as .*lights.csv:0$"):
        load_light(text)
    text.write_text("\n".join([lines[0], *lines[2:]]))  # a row less, so that numbers mean other lights
    with pytest.raises(UserError, match=r"lights\.csv has been changed, but .*lights\.npz, .* is read: name that"):
        load_light(f"{text}:1")
    (tmp_path / "set" / "lights.npz").rename(tmp_path / "L.NPZ")
    with pytest.raises(UserError, match=r"such as .*L\.NPZ:0$") as error:
        load_light(tmp_path / "L.NPZ")
    np.testing.assert_array_equal(load_light(str(error.value).split()[-1]).coefficients, lights.coefficients[0])
    (tmp_path / "L.NPZ").write_bytes(b"PK nothing")
    with pytest.raises(UserError, match="not a light set"):
        read_light_set(tmp_path / "L.NPZ")


def test_broken_files_of_a_folder_are_skipped_and_recorded(tmp_path):
    """Two panoramas are left, which are enough."""
    first, second = np.random.default_rng(0).random((2, 16, 32, 3)) ** 4
    (tmp_path / "deep").mkdir()
    write_exr(tmp_path / "a.exr", first)
    write_exr(tmp_path / "deep" / "b.exr", second)
    second[3, 4] = np.nan
    write_exr(tmp_path / "nan.exr", second)
    (tmp_path / "c.hdr").write_bytes(b"<html>")
    (tmp_path / os.fsdecode(b"\xff.exr")).write_bytes((tmp_path / "a.exr").read_bytes())
    (tmp_path / "notes.txt").write_text("not a panorama")
    folder, chosen = replace(ROOMS, source="folder", folder=str(tmp_path)), replace(SETTINGS, clusters=6, test=2)
    lights, record = build_light_set(folder, chosen, 2)
    assert {*lights.of("train").source} ^ {*lights.of("test").source} == {"a.exr", "deep/b.exr"}
    assert list(record["unreadable"]) == ["c.hdr", "nan.exr", "\\udcff.exr"]  # for pages in UTF-8
    assert record["steps"][0]["why"] == {"unreadable": 3} and "rename it" in record["unreadable"]["\\udcff.exr"]
    assert "1 of 512 pixels are not finite" in record["unreadable"]["nan.exr"] and record["repaired"] == {}
    _, record = build_light_set(replace(folder, repair=True), chosen, 2)
    assert list(record["unreadable"]) == ["c.hdr", "\\udcff.exr"] and list(record["repaired"]) == ["nan.exr"]
    with pytest.raises(UserError, match="no such folder"):
        build_light_set(replace(folder, folder=str(tmp_path / "nowhere")), SETTINGS, 2)


def test_of_copies_of_a_panorama_the_largest_is_used(tmp_path):
    """Copies are in one folder, and their names differ in size or format only; one that cannot be read is none."""
    rng = np.random.default_rng(0)
    (tmp_path / "b").mkdir()
    names = "park_1k.exr park_2K.exr park2_1k.exr b/park_4k.exr lamp_3200k.exr lamp_5600k.exr hall_8k.exr hall.exr"
    for name in names.split():
        write_exr(tmp_path / name, 0.5 + rng.random((16, 32, 3)))
    (tmp_path / "park_2k.hdr").write_bytes((tmp_path / "park_2K.exr").read_bytes())
    (tmp_path / "park_16k.hdr").write_bytes(b"<html>")
    folder = replace(ROOMS, source="folder", folder=str(tmp_path))
    lights, record = build_light_set(folder, replace(SETTINGS, clusters=50, test=10), 2)
    used = {"park_2K.exr", "park2_1k.exr", "b/park_4k.exr", "lamp_3200k.exr", "lamp_5600k.exr", "hall.exr"}
    assert set(lights.source.tolist()) == used
    assert record["steps"][0] == {"step": "read", "in": 10, "out": 6, "why": {"unreadable": 1, "copies": 3}}
    told = "3 of 9 panoramas are copies of others in another size or format, and were left out: "
    assert f"{told}hall_8k.exr; park_1k.exr; park_2k.hdr" in record["warnings"]


def test_what_a_folder_does_not_give_is_said(tmp_path):
    """A map that the rules cut at every heading, one that is upside down, and few maps behind many lights."""
    rng = np.random.default_rng(0)
    sky = np.linspace(1, 0.3, 16)[:, None, None] * np.ones((16, 32, 3)) * (1 + rng.random((16, 32, 3)))
    blue = sky * np.array([0.05, 0.2, 3])
    for name, pixels in {"a": sky, "b": sky[:, ::-1] ** 1.3, "blue": blue, "down": sky[::-1]}.items():
        write_exr(tmp_path / f"{name}.exr", pixels)
    folder = replace(ROOMS, source="folder", folder=str(tmp_path))
    lights, record = build_light_set(folder, replace(SETTINGS, clusters=8, test=3), 2)
    assert record["unlit"] == {"blue.exr": "dim at 36 of 36 headings, color at 36 of 36 headings"}
    assert "blue.exr" not in lights.of("train").source
    told = " | ".join(record["warnings"])
    assert "1 of 4 panoramas gave no light" in told and "blue.exr: dim at 36 of 36 headings" in told
    assert "1 of 4 panoramas are brighter from below (are their rows upside down?): down.exr" in told
    assert "the 3 test lights come from" in told


@pytest.mark.parametrize("source", ["generated", "folder"])
def test_every_setting_of_panoramas_is_read_or_says_that_it_is_not(tmp_path, monkeypatch, source):
    write_exr(tmp_path / "a.exr", np.ones((8, 16, 3)))
    read = set()

    class Spy(Panoramas):
        def __getattribute__(self, name):
            read.add(name)
            return super().__getattribute__(name)

    counts = {item.name: 1 for item in fields(Panoramas) if setting_of(item).kind}
    monkeypatch.setattr(chain, "generated_light", lambda *_, **__: np.ones((9, 3)))
    chain.project_panoramas(Spy(source=source, folder=str(tmp_path), layout="auto", flip=False, **counts), 2)
    for item in fields(Panoramas):
        assert (item.name in read) != (setting_of(item).unread == source) or item.name == "folder", item.name


def test_the_page_of_lights_and_the_help_name_every_kind():
    page = (Path(__file__).parents[2] / "docs" / "lights.md").read_text()
    told = CliRunner().invoke(app, ["photo", "--help"]).output
    assert [kind for kind in [*GENERATED, *NAMED] if f"`{kind}:" not in page or f"  {kind}:" not in told] == []
    assert {setting_of(item).kind for item in fields(Panoramas)} - {""} == {*GENERATED}
