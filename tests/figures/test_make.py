"""Whole figures: completeness, gates, constraints, and exported files."""

import csv
import json
import re
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from relight.core.errors import UserError
from relight.figures import make
from relight.figures.commands import app, seeds_of, write_table
from relight.figures.cut import patterns
from relight.figures.drape.dress import DrapedGarment
from relight.figures.drape.simulate import DrapeResult
from relight.figures.draw.constraints import Constraints
from relight.figures.draw.garments import wardrobe
from relight.figures.draw.poses import poses
from relight.figures.dye.gloss import with_gloss
from relight.figures.export import write_glb
from relight.figures.gates import checks
from relight.figures.gates.rings import lost_rings
from relight.figures.make import make_figure
from relight.figures.surfaces import grid_faces
from relight.meshes import Material, Mesh, clean, read_mesh

SEED, SUBJECT = 5005, 3  # the second of three figures of one person


@pytest.mark.slow
def test_make_figure_record_is_complete_and_faces_forward(figure):
    assert figure.vertices.dtype == np.float32 and figure.vertices.shape[1] == 3 and np.isfinite(figure.vertices).all()
    assert figure.vertices[:, 1].min() == 0 and 1.3 < figure.vertices[:, 1].max() < 2.6
    assert figure.faces.max() == len(figure.vertices) - 1 and len(np.unique(figure.faces)) == len(figure.vertices)
    assert figure.material.max() == len(figure.materials) - 1
    assert figure.uv.shape == (*figure.faces.shape, 2) and figure.uv.min() >= 0 and figure.uv.max() <= 1
    keys = "name subject source seed generator garments pose hair skin age build redrawn crossing covered"
    assert {*keys.split()} <= figure.info.keys()
    assert figure.info["name"] == f"g{SEED:04d}" and figure.info["subject"] == "s1668"
    assert len(figure.info["garments"]) >= 1
    face, _ = checks.first_seen(figure.vertices, figure.faces)
    rows = np.flatnonzero((face >= 0).any(1))
    upper = face[rows[: len(rows) // 3]]
    assert (np.isin(figure.material[upper[upper >= 0]], [1, 2])).sum() >= 4  # eyes are seen from +z


def test_sample_per_subject_is_one_person_in_other_poses():
    first = make.sample(9600, 0, 1, 0.0)
    draws = [make.sample(seed, 0, 12, 0.0) for seed in range(9600, 9613)]
    for part in ("person", "outfit"):
        assert all(getattr(draw, part) == getattr(first, part) for draw in draws[:-1])
        assert getattr(draws[-1], part) != getattr(first, part)
    assert draws[-1].person == make.sample(9612, 0, 1, 0.0).person
    assert len({draw.pose for draw in draws}) == len(draws)
    assert make.subject_of(5, 3) == "s0001" and make.subject_of(6, 3) == "s0002" and make.subject_of(6, 1) == "g0006"


@pytest.mark.slow
def test_make_figure_outfits_are_other_fabrics_on_the_same_figure(figure):
    assert len(figure.outfits) == 2 and len(figure.info["outfits"]) == 3
    assert figure.info["outfits"][0] == figure.info["fabrics"]
    assert any(material.texture is not None for material in figure.outfits[0].values())
    for outfit in figure.outfits:
        assert len(outfit) >= len(figure.info["garments"]) and 0 not in outfit, "the skin stays"
        for number, material in outfit.items():
            if material.texture is not None:
                assert (material.texture != figure.materials[number].texture).any()
                assert (figure.outfits[0][number].texture != figure.outfits[1][number].texture).any()


def failing(monkeypatch, times: int, mesh: Mesh) -> list[make.Draw]:
    """Lets `times` draws fail without draping them; returns the list of what is drawn."""
    draws = []

    def attempt(draw, *_):
        draws.append(draw)
        return "torn" if len(draws) <= times else mesh

    monkeypatch.setattr(make, "attempt_figure", attempt)
    return draws


@pytest.mark.slow
def test_make_figure_draws_failed_attempts_again_and_counts_them(figure, monkeypatch):
    draws = failing(monkeypatch, 2, figure)
    mesh = make_figure(SEED, "draft", 128)
    assert len(draws) == 3 and mesh.info["redrawn"] == 2 and mesh.info["redrawn_because"] == ["torn", "torn"]
    assert draws[0].person == draws[1].person == draws[2].person and draws[0].outfit != draws[1].outfit
    failing(monkeypatch, 99, figure)
    with pytest.raises(UserError, match="8 attempts"):
        make_figure(SEED, "draft", 128)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "sits"), [(0.0, [False] * 6), (0.99, [True] * 4 + [False] * 2), (1.0, [True] * 6)])
def test_make_figure_redraws_sit_only_at_first_if_by_chance(figure, monkeypatch, share, sits):
    draws = failing(monkeypatch, 5, figure)
    make_figure(SEED, "draft", 128, constraints=Constraints(share))
    assert [draw.pose.sitting for draw in draws] == sits


@pytest.fixture(scope="module")
def snug(body):
    """A dress as its pattern lies around a standing body, not draped: a drape that passes."""
    motion = make.build_motion(body, poses()["straight"], 4)
    pattern = patterns.build_pattern(body, wardrobe()["dress"], 0)
    level = pattern.levels[0]
    return body, motion, pattern, motion.skin(level.weights, level.rest_shape), np.ones(1000)


@pytest.mark.parametrize(("spoil", "message"), [
    (lambda x, strain, pattern: (x, strain), None),
    (lambda x, strain, pattern: (np.where(np.arange(len(x))[:, None] == 5, np.nan, x), strain), "finite"),
    (lambda x, strain, pattern: (x, strain * 1.5), "stretched"),
    (lambda x, strain, pattern: (x, np.where(np.arange(1000) < 5, 4.0, strain)), "torn"),
    (lambda x, strain, pattern: (x + [2.0, 0, 0], strain), "flew"),
    (lambda x, strain, pattern: (x - [0, 0.3, 0], strain), "slid|inside"),
    (lambda x, strain, pattern: (x * [0.6, 1, 0.6], strain), "inside"),
])  # fmt: skip
@pytest.mark.slow
def test_check_garment_rejects_what_is_spoilt(snug, spoil, message):
    _, motion, pattern, x, strain = snug
    x, strain = spoil(x, strain, pattern)
    reason = checks.check_garment(pattern, DrapeResult(x, [], strain), motion)
    assert reason is None if message is None else re.search(message, reason)


def test_hem_swept_finds_a_swept_hem_and_no_leaning_one(snug):
    body, motion = snug[:2]
    pattern = patterns.build_pattern(body, wardrobe()["t-shirt"], 0)
    level = pattern.levels[0]
    x = motion.skin(level.weights, level.fitted)
    assert checks.hem_swept(pattern, x, motion) < 0.001
    leaning = motion.transforms.copy()
    leaning[:, :, 1] += 0.4 * leaning[:, :, 0]  # half of the body higher than the other
    leaned = replace(motion, transforms=leaning)
    moved = leaned.skin(level.weights, level.fitted)
    assert np.ptp(moved[pattern.fields["drop"] > 0.999, 1] - x[pattern.fields["drop"] > 0.999, 1]) > 0.1
    assert checks.hem_swept(pattern, moved, leaned) < 0.001
    swept = x + [0, 0.35, 0] * ((pattern.fields["drop"] > 0) & (x[:, 0] > 0))[:, None]
    assert checks.hem_swept(pattern, swept, motion) > 0.3
    assert "swept" in checks.check_garment(pattern, DrapeResult(swept, [], np.ones(1000)), motion)


@pytest.mark.parametrize(("garment", "limb", "root", "tip", "middle"), [
    (wardrobe()["long sleeve"], "arm", "upperarm01", "lowerarm01", 0.5),
    (wardrobe()["long sleeve"], "arm", "lowerarm01", "wrist", 1.5),
    (wardrobe()["jeans"], "leg", "upperleg01", "lowerleg01", 0.55),
    (wardrobe()["jeans"], "leg", "lowerleg01", "foot", 1.5),
], ids=["upper arm", "forearm", "thigh", "shin"])  # fmt: skip
@pytest.mark.parametrize("turned", [False, True])
def test_lost_rings_finds_a_limb_that_left(snug, monkeypatch, garment, limb, root, tip, middle, turned):
    """And none that twists."""
    body, motion = snug[:2]
    pattern = patterns.build_pattern(body, garment, 0)
    level = pattern.levels[0]
    x = motion.skin(level.weights, level.rest_shape)
    assert {*(rings := lost_rings(pattern, x, motion))} == {f"left {limb}", f"right {limb}"}
    assert all(lost == 0 and found > 25 for lost, found in rings.values())
    bone = motion.transforms[-1][motion.bones[f"{root}.L"]]
    upper, lower = (body.joints[f"{name}.L"] @ bone[:, :3].T + bone[:, 3] for name in (root, tip))
    axis = (lower - upper) / np.linalg.norm(lower - upper)
    off = x - upper - ((x - upper) @ axis)[:, None] * axis
    middling = 1 - np.abs(pattern.fields[f"{limb}L"] - middle) / 0.3
    on = (middling > 0) & (pattern.fields["x"] > 0) & ((pattern.fields["arm_shareL"] > 0.5) | (limb == "leg"))
    if turned:  # up to half a turn about the limb
        angle = np.pi * middling[on, None]
        x[on] += (np.cos(angle) - 1) * off[on] + np.sin(angle) * np.cross(axis, off[on])
    else:  # all to one side of it
        x[on] -= 2 * off[on] * (off[on, 2:] > 0)
    rings = lost_rings(pattern, x, motion)
    assert rings[f"right {limb}"][0] == 0
    assert rings[f"left {limb}"][0] == 0 if turned else rings[f"left {limb}"][0] >= 5
    monkeypatch.setattr(checks, "share_inside", lambda *_: 0.0)  # cloth moved by hand touches the body, too
    reason = checks.check_garment(pattern, DrapeResult(x, [], np.ones(1000)), motion)
    assert reason is None if turned else f"the left {limb} left it" in reason


@pytest.mark.parametrize(("share", "stands", "sits"), [(0.01, True, True), (0.02, False, True), (0.04, False, False)])
def test_check_outfit_bounds_cloth_through_cloth(snug, monkeypatch, share, stands, sits):
    _, motion, pattern, x, strain = snug
    worn = [DrapedGarment(replace(pattern, levels=pattern.levels * 2), None, DrapeResult(x, [], strain))]
    monkeypatch.setattr(checks, "crossing", lambda *_: [share])
    monkeypatch.setattr(checks, "covered_hands", lambda *_: (0.0, 0.0))
    for sitting, passes in ((False, stands), (True, sits)):
        reason, measured = checks.check_outfit(worn, motion, sitting)
        assert (reason is None) == passes and measured["crossing"] == share


def two_walls(hole: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A wall of cloth (layer 1) a centimetre in front of skin (layer 0) that bulges through it in a small square."""
    x, y = np.meshgrid(a := np.arange(-0.3, 0.3001, 0.01), a)
    n = len(a)
    back = np.stack([x, y, np.where((np.abs(x) < hole) & (np.abs(y) < hole), 0.02, -0.01)], -1).reshape(-1, 3)
    front, faces = np.stack([x, y, 0 * x], -1).reshape(-1, 3), grid_faces(n, n)[:, ::-1]
    return np.concatenate([back, front]), np.concatenate([faces, faces + n * n]), np.repeat([0, 1], len(faces))


def test_poke_through_counts_specks_and_no_openings():
    assert checks.poke_through(*two_walls(0.0)) == 0
    assert 4 <= checks.poke_through(*two_walls(0.0051)) <= checks.MAX_PATCH
    assert checks.poke_through(*two_walls(0.2)) == 0  # a large opening is no speck


@pytest.mark.slow
def test_export_glb_has_the_content_of_the_mesh(figure, tmp_path):
    write_glb(mesh := figure, tmp_path / "f.glb")
    scene = trimesh.load(tmp_path / "f.glb", process=False)
    assert sorted(scene.geometry) == sorted(material.name for material in mesh.materials)
    assert {"skin", "eyes", *mesh.info["garments"]} < set(scene.geometry)
    assert sum(len(part.faces) for part in scene.geometry.values()) == len(mesh.faces)
    np.testing.assert_allclose(scene.bounds, [mesh.vertices.min(0), mesh.vertices.max(0)], atol=1e-6)
    for number, material in enumerate(mesh.materials):
        part, chosen = scene.geometry[material.name], mesh.material == number
        assert part.visual.material.name == material.name
        np.testing.assert_allclose(part.vertices[part.faces], mesh.vertices[mesh.faces[chosen]], atol=1e-6)
        np.testing.assert_allclose(part.visual.uv[part.faces], mesh.uv[chosen], atol=1e-6)
        if material.texture is not None:
            theirs = np.asarray(part.visual.material.baseColorTexture.convert("RGB"))
            np.testing.assert_array_equal(theirs, material.texture)


def document_of(path: Path) -> dict:
    data = path.read_bytes()
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def test_export_glb_holds_its_licence_and_each_texture_once(tmp_path):
    vertices, faces = np.eye(3, dtype=np.float32), np.array([[0, 1, 2], [0, 1, 2], [2, 1, 0]], np.int32)
    pattern = np.random.default_rng(0).integers(0, 256, (4, 4, 3)).astype(np.uint8)
    left = Material(np.ones(3, np.float32), pattern, "left", 0.25, 0.5)
    materials = [left, Material(texture=pattern.copy(), name="right"), Material()]
    uv, info = np.zeros((3, 3, 2), np.float32), {"name": "g7", "seed": 7, "licence": "CC0-1.0"}
    mesh = Mesh(vertices, faces, uv, np.arange(3, dtype=np.int16), materials, None, info)
    write_glb(mesh, tmp_path / "f.glb")
    document = document_of(tmp_path / "f.glb")
    assert len({image["bufferView"] for image in document["images"]}) == 1
    assert "CC0" in document["asset"]["copyright"] and document["asset"]["extras"]["license"] == "CC0-1.0"
    root = document["nodes"][document["scenes"][0]["nodes"][0]]
    assert root["name"] == "g7" and root["extras"] == info
    write_glb(replace(mesh, info={"name": "scan"}), tmp_path / "scan.glb")
    assert "CC0" not in json.dumps(document_of(tmp_path / "scan.glb"))  # a scan is not relight's to give away
    assert [document["nodes"][child]["name"] for child in root["children"]] == ["left", "right", "part 2"]
    read = read_mesh(tmp_path / "f.glb")
    assert read.info["axes"] == {"up": "+y", "front": "+z"}  # need not be found
    assert [material.name for material in read.materials] == ["left", "right", ""]
    assert [(material.roughness, material.specular) for material in read.materials] == [(0.25, 0.5), (1, 0), (1, 0)]


@pytest.mark.slow
def test_with_gloss_gives_materials_the_gloss_of_their_kind(figure):
    found = {material.name: (material.roughness, material.specular) for material in figure.materials}
    for name, index in (("skin", 1.4), ("eyes", 1.376)):  # Fresnel's reflectance at right angles, over 4 %
        assert found[name][1] == pytest.approx(((index - 1) / (index + 1)) ** 2 / 0.04, abs=0.01)
    assert all(0 < roughness <= 1 and 0 < specular <= 1 for roughness, specular in found.values())
    outfit, upper = make.sample(0, 0, 1, 0.0).outfit, Material(name="shoes: upper")
    oxfords, sneakers = (replace(outfit, shoe=replace(outfit.shoe, name=name)) for name in ("oxfords", "sneakers"))
    assert with_gloss(upper, oxfords).roughness < 0.5 < with_gloss(upper, sneakers).roughness


@pytest.mark.slow
def test_clean_of_an_exported_figure_repairs_next_to_nothing(figure, tmp_path):
    write_glb(figure, tmp_path / "f.glb")
    repairs = clean(read_mesh(tmp_path / "f.glb")).info["repairs"]
    assert repairs["merged vertices"] > 500
    # collars touch the edge that they are sewn to; specks of skin and cloth are left under other clothes
    usual = ("merged vertices", "holes", "boundary edges", "parts")
    counts = {what: count for what, count in repairs.items() if what not in usual}
    assert counts.pop("floating parts", 0) < 10 and not counts


def test_seeds_of_lists_and_ranges():
    for text, want in {"7": [7], "0-3": [0, 1, 2, 3], "1,4,2-5": [1, 4, 2, 3, 5]}.items():
        assert seeds_of(text) == want
    for text in ("", "a", "5-2", "-1", "1..3", "1,,2", "²"):
        with pytest.raises(UserError, match="--seeds"):
            seeds_of(text)


def test_write_table_lists_all_figures_of_the_folder(tmp_path):
    """Those of earlier calls too, whatever columns they have."""
    for note in ({"name": "g0001", "garments": ["robe"]}, {"name": "g0000", "pose": "waving"}):
        (tmp_path / f"{note['name']}.json").write_text(json.dumps(note))
        (tmp_path / "g0002.json").write_text("")  # cut short, or of another program
        write_table(tmp_path)
    with open(tmp_path / "figures.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows[0] == {"name": "g0000", "pose": "waving", "garments": ""}
    assert rows[1:] == [{"name": "g0001", "pose": "", "garments": '["robe"]'}]


@pytest.mark.parametrize("fixed", [
    {"garments": ("waistcoat",)},
    {"garments": ("coat", "scarf"), "hair": ("bald", "afro"), "sitting": 0.5},
    {"garments": ("pleated skirt",), "poses": ("sitting", "waving")},
    {"hair": ("beanie",), "sitting": 1.0},
], ids=lambda fixed: " ".join(fixed))  # fmt: skip
@pytest.mark.slow
def test_sample_satisfies_the_constraints(fixed):
    constraints = Constraints(**fixed)
    draw, again = (make.sample(0, attempt, 1, constraints.sitting, constraints) for attempt in (0, 1))
    assert {worn.garment.name for worn in draw.outfit.garments} >= set(constraints.garments)
    assert not constraints.poses or draw.pose.name in constraints.poses
    assert not constraints.hair or draw.outfit.hair.name in constraints.hair
    assert draw.pose.sitting or constraints.sitting < 1
    assert again.person == draw.person and again.outfit != draw.outfit


def test_figures_command_names_are_options_to_copy():
    """A name of several words, or with a comma, is one argument of a shell, and a known name."""
    arguments = [shlex.split(line) for line in CliRunner().invoke(app, ["--names"]).output.splitlines()]
    for option, field in (("--pose", "poses"), ("--garment", "garments"), ("--hair", "hair")):
        names = [name for given, name in arguments if given == option]
        assert len(names) > 10
        Constraints(**{field: tuple(names)})


@pytest.mark.parametrize(("refused", "message"), [
    (lambda: make_figure(1, "huge", 128), "huge"),
    (lambda: make_figure(-1, "draft", 128), "-1"),
    (lambda: make_figure(1, "draft", 8), "8"),
    (lambda: make_figure(0, "draft", 128, 0), "per_subject"),
    (lambda: make_figure(0, "draft", 128, 1, 0), "outfits"),
    (lambda: Constraints(poses=("wavin",)), "did you mean 'waving'"),
    (lambda: Constraints(garments=("toga",)), "no garment is called 'toga'; .*robe"),
    (lambda: Constraints(hair=("bob", "bald ")), "'bald'"),
    (lambda: Constraints(sitting=1.1), "1.1"),
    (lambda: Constraints(sitting=1, poses=("waving",)), "sitting=1 contradicts poses 'waving'"),
])  # fmt: skip
def test_make_figure_and_constraints_refuse_bad_arguments_in_one_sentence(refused, message):
    with pytest.raises(UserError, match=message):
        refused()


@pytest.mark.parametrize(("fixed", "message"), [
    ({"garments": ("jeans", "dress")}, "would have jeans and dress"),
    ({"garments": ("coat",), "sitting": 1.0}, "can be taken in coat"),
    ({"garments": ("dress",), "hair": ("bald",)}, "dress and bald hair"),
])  # fmt: skip
@pytest.mark.slow
def test_constraints_that_nobody_satisfies_are_one_sentence(monkeypatch, fixed, message):
    for name in ("PEOPLE", "OUTFITS"):
        monkeypatch.setattr(f"relight.figures.draw.constraints.{name}", 10)
    constraints = Constraints(**fixed)
    with pytest.raises(UserError, match=message):
        make.sample(3, 0, 1, constraints.sitting, constraints)


@pytest.mark.slow
def test_worker_ends_quietly_when_a_destructor_swallows_the_end():
    program = "import os, signal, time; from relight.figures.commands import start_worker; start_worker()\n"
    program += "class Array:\n    def __del__(self):\n        os.kill(os.getpid(), signal.SIGTERM); time.sleep(0.1)\n"
    command = [sys.executable, "-c", program + "Array(); time.sleep(60)"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=50)
    assert run.returncode == -signal.SIGALRM and not run.stderr


def test_figures_command_ends_quietly_when_terminated(tmp_path):
    """Its workers end with it, and no part of a figure is left."""
    command = [sys.executable, "-m", "relight.cli", "figures", "--seeds", "0-9"]
    command += ["--detail", "draft", "--texture", "128", "--out", str(tmp_path), "--jobs", "2"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, start_new_session=True, **pipes)
    while process.poll() is None and not list(tmp_path.glob("*.json")):  # by then both workers are at work
        time.sleep(0.1)
    process.terminate()
    out, err = process.communicate()  # returns when all that hold the pipes have ended
    assert process.returncode == 143
    assert out == "" and all(line.startswith("figures ") for line in err.splitlines()), err
    assert not [path.name for path in tmp_path.iterdir() if path.suffix not in (".glb", ".json")]
