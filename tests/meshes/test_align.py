"""Alignment: any axes, units and place of a file end in the same picture."""

from itertools import product

import numpy as np
import pytest
import trimesh
from samples import mesh_of

from relight.core.errors import UserError
from relight.meshes import align
from relight.meshes.alignment import axes_rotation, read_align_table
from relight.meshes.axes import AXES, find_axes
from relight.settings import Align
from relight.sh import rotation_about_y

AUTO = Align(up="auto", front="auto")
PAIRS = [(up, front) for up, front in product(AXES, AXES) if up[1] != front[1]]
FOOT = (0.045, 0.04, 0.14)
POSES = {
    "standing": {},
    "T-pose": {"left_arm": ((0.55, 1.42, 0), (0.35, 0.05, 0.05)), "right_arm": ((-0.55, 1.42, 0), (0.35, 0.05, 0.05))},
    "arms up": {"left_arm": ((0.2, 1.8, 0), (0.05, 0.35, 0.05)), "right_arm": ((-0.25, 1.7, 0), (0.05, 0.35, 0.05))},
    "pointing ahead": {"right_arm": ((-0.22, 1.4, 0.35), (0.05, 0.05, 0.35))},
    "walking": {"left_leg": ((0.1, 0.45, 0.2), (0.07, 0.45, 0.2)), "left_shoe": ((0.1, 0.04, 0.36), FOOT)},
}
SITTING = {
    "torso": ((0, 0.85, 0), (0.17, 0.35, 0.11)),
    "head": ((0, 1.28, 0), (0.09, 0.12, 0.10)),
    "nose": ((0, 1.26, 0.11), (0.015, 0.02, 0.02)),
    "left_eye": ((0.03, 1.3, 0.1), (0.012, 0.012, 0.012)),
    **{f"{side}_arm": ((0.27 * x, 0.85, 0), (0.05, 0.3, 0.05)) for side, x in (("left", 1), ("right", -1))},
    **{f"{side}_thigh": ((0.12 * x, 0.5, 0.25), (0.08, 0.08, 0.3)) for side, x in (("left", 1), ("right", -1))},
    **{f"{side}_leg": ((0.12 * x, 0.25, 0.2), (0.06, 0.25, 0.06)) for side, x in (("left", 1), ("right", -1))},
    **{f"{side}_shoe": ((0.12 * x, 0.04, 0.15), (0.045, 0.04, 0.1)) for side, x in (("left", 1), ("right", -1))},
}


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("up, front", [("+y", "+z"), ("+z", "-y"), ("+z", "+y"), ("+y", "-x"), ("+y", "-z")])
def test_up_and_front_are_found(person, pose, up, front):
    mesh = person(**POSES[pose])
    want = align(mesh, AUTO)
    assert (want.info["align"]["up"], want.info["align"]["front"]) == ("+y", "+z")
    turned = mesh.vertices @ axes_rotation(up, front).astype(np.float32)
    mesh.vertices = turned * 100 + 37  # centimetres, off the origin
    got = align(mesh, AUTO)
    record = got.info["align"]
    assert (record["up"], record["front"]) == (up, front) and got.info["name"] == "person"
    np.testing.assert_allclose(got.vertices, want.vertices, atol=1e-5)
    np.testing.assert_array_equal(got.faces, mesh.faces)
    assert not got.info["warnings"]
    back = got.vertices / record["scale"] @ np.array(record["rotation"]) + record["centre"]
    np.testing.assert_allclose(back, mesh.vertices, atol=1e-3)


@pytest.mark.parametrize("pose, degrees, certain", [({}, 0, True), ({}, 10, True), ({}, 40, False), ({}, 80, True),
                                                    (SITTING, 0, False)])  # fmt: skip
def test_between_two_axes_and_of_somebody_who_sits_the_front_is_a_guess(person, pose, degrees, certain):
    mesh = person(**pose)
    mesh.vertices = mesh.vertices @ rotation_about_y(np.radians(degrees)).T.astype(np.float32)
    told = align(mesh, AUTO).info["warnings"]
    assert not told if certain else "its front is uncertain" in told[0]


def test_under_a_gown_the_face_decides(person):
    around = (0, 0.7, 0), (0.25, 0.7, 0.25)
    hidden = {f"{side}_{part}": around for side in ("left", "right") for part in ("leg", "shoe")}
    head = {"head": ((0, 1.62, 0.06), (0.08, 0.12, 0.10)), "torso": ((0, 1.15, 0), (0.06, 0.4, 0.06))}
    mesh = person(**hidden, **head)
    mesh.vertices = mesh.vertices[:, [2, 1, 0]] * np.float32([-1, 1, 1])  # facing -x
    assert find_axes(mesh)[:2] == ("+y", "-x")


HAT = {"hat": ((0, 1.74, 0), (0.11, 0.015, 0.11))}  # as flat as soles
GOWN = {f"{side}_leg": ((0, 0.45, 0), (0.25, 0.45, 0.25)) for side in ("left", "right")}


@pytest.mark.parametrize("pose", ["standing", "T-pose", "pointing ahead", "walking"])
def test_legs_identify_an_inverted_figure(person, pose):
    mesh = person(**POSES[pose], **HAT)
    assert find_axes(mesh)[0] == "+y"
    mesh.vertices[:, :2] *= -1
    assert find_axes(mesh)[0] == "-y"


UPRIGHT = {
    "both arms up": POSES["arms up"],
    "one arm up": {"left_arm": POSES["arms up"]["left_arm"]},
    "both arms up over a gown": POSES["arms up"] | GOWN,
    "one arm up beside a hat": {"left_arm": ((0.35, 1.42, 0), (0.09, 0.33, 0.09))} | HAT,
    # Thirty locks over each other on the crown have twice the area of two soles, but cover no more than a head.
    "long hair": {f"lock {k}": ((0, 1.738 - 0.0005 * k, -0.12), (0.10, 0.004, 0.16)) for k in range(30)},
}


@pytest.mark.parametrize("name", UPRIGHT)
def test_arms_in_the_air_are_no_legs_and_layers_of_hair_no_soles(person, name):
    assert find_axes(person(**UPRIGHT[name]))[0] == "+y"


@pytest.mark.parametrize(("vertices", "front"), [
    ([[0, 0, 0], [1, 3, 0], [-1, 3, 1], [-1, 3, -1]], None),  # on its tip: no face lies at the lowest point
    ([[0, 0, 0], [0, 0, 9], [1e-9, 0, 9], [0, 1e-9, 9]], "+z"),  # no height where up may be
], ids=["tip", "needle"])  # fmt: skip
def test_other_shapes_get_axes_too(vertices, front):
    up, front, _ = find_axes(mesh_of(vertices, [[0, 1, 2], [0, 2, 3], [0, 3, 1]]), front=front)
    assert up in AXES and front in AXES and up[1] != front[1]


def test_feet_wide_apart_point_where_each_of_them_points(person):
    """One foot on its toes shows little below, so the common middle of the feet lies aside, under the other."""
    flat = {"left_leg": ((0.35, 0.45, 0), (0.07, 0.45, 0.08)), "left_shoe": ((0.35, 0.04, 0.06), FOOT)}
    on_toes = {"right_leg": ((-0.35, 0.47, 0), (0.07, 0.42, 0.08))}
    on_toes["right_shoe"] = (-0.35, 0.12, 0.03), (0.045, 0.12, 0.05)
    assert find_axes(person(**flat, **on_toes))[:2] == ("+y", "+z")


@pytest.mark.parametrize("up, front", PAIRS)
def test_given_axes_are_used(person, up, front):
    mesh = person()
    want = align(mesh, Align(up="+y", front="+z"), 0.1).vertices
    mesh.vertices = (mesh.vertices @ axes_rotation(up, front)).astype(np.float32)
    np.testing.assert_allclose(align(mesh, Align(up=up, front=front), 0.1).vertices, want, atol=1e-6)
    assert np.linalg.det(axes_rotation(up, front)) == pytest.approx(1)


@pytest.mark.parametrize("padding", [0, 0.05, 0.2])
def test_aligned_figures_fill_the_image(person, padding):
    tall = align(person(), AUTO, padding).vertices
    np.testing.assert_allclose(tall.max(axis=0), -tall.min(axis=0), atol=1e-6)
    assert np.ptp(tall[:, 1]) == pytest.approx(2 * (1 - 2 * padding), rel=1e-6)
    wide = person(left_arm=((0.8, 1.3, 0), (0.6, 0.05, 0.05)), right_arm=((-0.8, 1.3, 0), (0.6, 0.05, 0.05)))
    wide = align(wide, Align(up="+y", front="+z"), padding).vertices
    assert np.ptp(wide[:, 0]) == pytest.approx(2 * (1 - 2 * padding), rel=1e-6)
    assert np.ptp(wide[:, 1]) < np.ptp(wide[:, 0])


def test_a_table_overrides_single_figures(tmp_path, person):
    table = tmp_path / "axes.csv"
    rows = "person;;;-z;\nother;;+x;+y;3\nZoë Groß;;+y;+z;90,0\n;x\\turned.obj;+y;+z;90.0\n"
    table.write_text(f"\ufeffname;path;up;front;turn\n{rows}", encoding="utf-8")
    settings = Align(up="+y", front="+z", table=str(table))
    got = align(person(), settings)
    assert got.info["align"]["front"] == "-z"
    want = align(person(), AUTO).vertices
    np.testing.assert_allclose(got.vertices, want * [-1, 1, -1], atol=1e-6)
    for name in ("turned", "Zoe_Gross"):  # of a scan by its file, and as `relight scans list` calls it
        mesh = person()
        mesh.info["name"] = name
        np.testing.assert_allclose(align(mesh, settings).vertices, want[:, [2, 1, 0]] * [1, 1, -1], atol=1e-6)


@pytest.mark.parametrize("text, says", [
    ("up,front\n+y,+z\n", "no column `name`"),
    ("name,up\na,+y\na,+z\n", "twice"),
    ("name,up\na,upward\n", "upward"),
    ("name,turn\na,left\n", "turn of a is 'left': it must be a finite number"),
    ("name,turn\na,-inf\n", "turn of a is '-inf'"),
])  # fmt: skip
def test_malformed_tables_are_refused(tmp_path, text, says):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(UserError, match=says):
        read_align_table(tmp_path / "t.csv")
    with pytest.raises(UserError, match="no file"):
        read_align_table(tmp_path / "none.csv")


def test_axes_that_contradict_are_refused(person):
    with pytest.raises(UserError, match="same axis"):
        align(person(), Align(up="+y", front="-y"))
    for padding in (np.nan, 0.5):
        with pytest.raises(UserError, match=f"padding is {padding}: it must be a finite number from 0 to 0.49"):
            align(person(), Align(up="+y", front="+z"), padding)


@pytest.mark.parametrize("key", ["up", "front"])
@pytest.mark.parametrize("other", ["auto", "+z"])
@pytest.mark.parametrize("axis", ["+q", "y", "+Y"])
def test_settings_that_name_no_axis_are_refused(person, key, other, axis):
    with pytest.raises(UserError) as refused:
        align(person(), Align(**({"up": other, "front": other} | {key: axis})))
    assert str(refused.value) == f"align.{key} {axis!r} is not an axis; +x, -x, +y, -y, +z, -z and auto are"


def test_known_axes_are_used_and_a_guess_gets_a_warning(person, ellipsoid):
    mesh = person()
    mesh.info["axes"] = {"up": "+y", "front": "-z"}
    assert align(mesh, AUTO).info["align"]["front"] == "-z"
    got = align(mesh_of(*ellipsoid((0, 0, 0), (0.3, 0.9, 0.3))), AUTO)
    assert got.info["align"]["front"] == "+z" and "uncertain" in got.info["warnings"][0]


@pytest.mark.parametrize("size", [None, 0.6, 1.2, 3.0])
@pytest.mark.parametrize("up", ["y", "z"])
def test_align_warns_of_a_piece_of_floor(person, size, up):
    """A floor wider than the figure is high is taken for its height; the warning comes with any that may be."""
    mesh = person()
    if size:
        corners = 0.5 * size * np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], np.float32)
        faces = len(mesh.vertices) + np.array([[0, 2, 1], [0, 3, 2]])
        mesh = mesh_of(np.concatenate([mesh.vertices, corners]), np.concatenate([mesh.faces, faces]))
    if up == "z":
        mesh.vertices = mesh.vertices[:, [2, 0, 1]]
    found = align(mesh, AUTO)
    told = [line for line in found.info.get("warnings", []) if f"its -{up} side is flat, as a floor" in line]
    assert bool(told) == bool(size)
    assert align(mesh, Align(up=f"+{up}", front="+z" if up == "y" else "+x")).info["warnings"] == told


def test_align_warns_of_what_a_plinth_stands_on(person):
    """Its walls are flat, too."""
    mesh, box = person(), trimesh.creation.box((1.2, 0.3, 1.2))
    box.apply_translation([0, mesh.vertices[:, 1].min() - 0.15, 0])
    faces = np.concatenate([mesh.faces, len(mesh.vertices) + box.faces])
    mesh = mesh_of(np.concatenate([mesh.vertices, box.vertices]), faces)
    assert "its -y side is flat" in align(mesh, AUTO).info["warnings"][0]
