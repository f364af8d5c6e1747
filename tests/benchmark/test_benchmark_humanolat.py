"""HumanOLAT's layout, on a twin of it: what is read, what is measured, what is refused in one sentence."""

import re
import shutil
from dataclasses import replace

import numpy as np
import olat_twin as twin
import pytest
from PIL import Image, features
from scipy.ndimage import binary_erosion

from relight.benchmark import humanolat as layout
from relight.benchmark.bakedstage import agreement, bake_as_seen
from relight.benchmark.humanolat import captures, schedule
from relight.benchmark.lightstage import LightStage, measure
from relight.files import UserError
from relight.meshes import read_mesh


@pytest.fixture
def copy(humanolat, tmp_path):
    """A copy that may be broken."""
    return shutil.copytree(humanolat, tmp_path / "copy")


FACETS, EDGES = 0.0045, 0.019


def measured(capture, inside):
    """As `relight.benchmark.captures` measures, with the points known from formulas."""
    camera, seen = capture.camera, twin.surface(int(capture.name[-1]) - 1)
    stage = LightStage.from_positions((capture.lamps - camera.eye) @ camera.rotation.T)
    points = (seen["point"][inside] - camera.eye) @ camera.rotation.T
    return seen, stage, measure(lambda: capture.read_frames(inside), stage, points)


def test_the_schedule_is_that_of_the_published_numbers():
    lit, bright = schedule(331)
    shown = twin.schedule(331)
    assert {frame: lamp for lamp, frame in enumerate(lit)} == {f: lamp for f, lamp in shown.items() if lamp >= 0}
    assert bright == [f for f, lamp in shown.items() if lamp < 0 and f < lit[-1]]
    assert bright == [14, *range(34, 350, 21)] and lit[-1] == 361 and len(lit) == 331


def test_cameras_see_what_the_formulas_say(humanolat):
    found = list(captures(humanolat))
    assert [one.name for one in found] == ["T001.P00.Cam01", "T001.P00.Cam03"] and found[0].subject == "T001"
    assert [one.name for one in captures(humanolat, "Cam03$")] == ["T001.P00.Cam03"]
    for capture in found:
        seen = twin.surface(int(capture.name[-1]) - 1)
        row, column = np.nonzero(seen["mask"])
        points = seen["point"][row, column]
        assert np.allclose(capture.camera.project(points), np.stack([column, row], -1) + 0.5, atol=1e-3)
        rays = capture.camera.rays(column + 0.5, row + 0.5)
        assert np.allclose(rays[:, :3] + rays[:, 3:] * capture.camera.depth(points)[:, None], points, atol=0.01)
        assert np.array_equal(capture.read_mask() == 255, seen["mask"])
        assert capture.missing == 0 and len(capture.frames) == 331 and capture.model is not None


def test_measured_is_baked_to_the_noise(humanolat):
    """Frames come from formulas and the mesh is triangles, so only rounding, lamps and facets make a difference.

    On the slab, which is flat, only the rounding to 8 bits, whose standard deviation is predicted. On the ball, facets
    with edges of 12 mm turn the surface by up to .022. They block lamps below that height, which give at most, with the
    largest Y_lm of .63 and lamps 1.3 times as bright as at the centre, 2 pi .022^2 / 2 * .63 * 1.3 = .0012 of a
    coefficient, and twice that where lamps happen to be there. Facets lie up to .06 mm deep, so near the silhouette
    one sees up to .5 mm beside, where the normal differs by .0017. Together less than FACETS.

    Between the lamps' sum and all directions lies the edge of each shadow: about 16 lamps are next to one that crosses
    the hemisphere, each with up to half a share of .038, a cosine of .5 and a vector of length .85, so
    .5 * .038 * .85 / sqrt(12) * sqrt(16) = .019.
    """
    capture = next(captures(humanolat))
    inside = capture.read_mask() >= 128
    capture.check_order(inside)
    seen, stage, found = measured(capture, inside)
    baked = bake_as_seen(read_mesh(capture.model), capture.camera, inside, stage, 256, 1)
    assert found.known.mean() > 0.99 and found.clipped == 0
    turn = capture.camera.rotation
    ball = seen["ball"][inside]
    inner = (binary_erosion(seen["ball"], iterations=2) | binary_erosion(seen["mask"] & ~seen["ball"]))[inside]
    inner &= found.known & baked.hit
    assert inner.sum() > 300
    assert np.allclose(found.albedo[inner], twin.POWER * seen["albedo"][inside][inner], rtol=0.005)
    facing = (found.normal * (seen["normal"][inside] @ turn.T)).sum(1)[inner]
    assert facing.min() > np.cos(np.radians(0.3))
    row = agreement(found, baked, inside)
    assert row["pixels"] > 500 and 1.0 < row["length"] < 1.4
    assert row["noise"] < 0.002 and 0.5 * EDGES < row["lamps"] < 2 * EDGES
    assert row["difference"] < 1.05 * np.hypot(row["lamps"], row["rest"])
    assert row["shape"] < row["difference"] and abs(row["factor"] - 1) < 0.002 and row["normals"] < 0.1
    steady = inner & ~at_a_shadow(seen, inside, capture)
    apart = np.abs(found.transport - baked.lamp_sums)[steady]
    assert steady.sum() > 150 and (apart < 5 * found.noise[steady] + FACETS).all()
    slab = ~ball[steady]
    ratio = apart[slab] / found.noise[steady][slab]
    assert slab.sum() > 100 and np.sqrt((ratio**2).mean()) < 1.3  # flat: no facets, so rounding is all there is
    confused = replace(capture, lamps=np.roll(capture.lamps, 1, 0))  # each frame is taken for the one before
    assert agreement(measured(confused, inside)[2], baked, inside)["rest"] > 100 * row["rest"]


def at_a_shadow(seen, inside, capture):
    """Pixels (P,) where a lamp's ray touches the ball within .2 mm, which decides whether facets block it."""
    point, normal = seen["point"][inside], seen["normal"][inside]
    near = np.zeros(len(point), bool)
    for lamp in capture.lamps:
        toward = (lamp - point) / np.linalg.norm(lamp - point, axis=1, keepdims=True)
        half = ((twin.BALL - point) * toward).sum(1)
        past = np.sqrt(np.maximum(((twin.BALL - point) ** 2).sum(1) - half**2, 0))
        near |= (half > 0) & (np.abs(past - twin.RADIUS) < 0.2) & ((normal * toward).sum(1) > 0)
    return near


def test_missing_lamps_cost_little_and_are_counted(copy):
    place = copy / "SUBJECT_T001" / "POSE_00" / "images_processed" / "Cam01"
    for number in range(40, 354, 11):  # some of them full-bright
        (place / f"T001_A.{number:06d}.png").unlink()
    capture = next(captures(copy))
    gone = len([n for n in range(40, 354, 11) if twin.schedule(331)[n] >= 0])
    assert capture.missing == gone and len(capture.frames) == len(capture.lamps) == 331 - gone
    inside = capture.read_mask() >= 128
    _, stage, found = measured(capture, inside)
    capture.check_order(inside)
    assert stage.error < 0.003
    baked = bake_as_seen(read_mesh(capture.model), capture.camera, inside, stage, 64, 1)
    row = agreement(found, baked, inside)
    assert row["difference"] < 0.06 and row["rest"] < 0.004


def test_extrinsics_either_way_round(tmp_path, humanolat):
    twin.write(tmp_path, cameras=(1,), count=64, inverse=True)
    first, second = next(captures(tmp_path)).camera, next(captures(humanolat)).camera
    assert np.allclose(first.eye, second.eye, atol=1e-3) and np.allclose(first.rotation, second.rotation, atol=1e-6)


@pytest.mark.skipif(not features.check("avif"), reason="this Pillow has no AVIF")
def test_avif_is_read(tmp_path):
    """Quality 99, as published: a code or two of error."""
    twin.write(tmp_path, count=40, suffix=".avif")
    capture = next(captures(tmp_path))
    inside = capture.read_mask() >= 128
    order = [lamp for lamp in twin.schedule(40).values() if lamp >= 0]
    assert len(order) == len(capture.frames) == 40
    exact = [twin.to_bytes(twin.encode(twin.lit(twin.surface(0), lamp)))[inside] for lamp in capture.lamps]
    errors = [codes.astype(int) - true for (_, codes), true in zip(capture.read_frames(inside), exact)]
    assert np.sqrt(np.mean(np.square(errors))) < 4


def test_without_avif_the_error_names_the_remedy(tmp_path, humanolat, monkeypatch):
    copy = shutil.copytree(humanolat, tmp_path / "copy")
    for path in (copy / "SUBJECT_T001" / "POSE_00" / "images_processed" / "Cam01").iterdir():
        path.rename(path.with_suffix(".avif"))
    monkeypatch.setattr(layout.features, "check", lambda name: False)
    with pytest.raises(UserError, match=r"this Pillow reads no AVIF; pip install --upgrade pillow"):
        next(captures(copy))


POSE = "SUBJECT_T001/POSE_00"
CALIB = "SUBJECT_T001/shared/cameras.calib"
SPIRAL = "SUBJECT_T001/shared/LSX3_light_z_spiral.txt"
LAMPS = "SUBJECT_T001/shared/LSX_light_positions_aligned.pc"


def edit(name, change):
    def broken(folder):
        path = folder / name
        path.write_text(change(path.read_text()))

    return broken


def without(pattern):
    def broken(folder):
        for path in folder.glob(pattern):
            path.unlink()

    return broken


def replace_line(number, text):
    return lambda whole: "\n".join(text if i == number else line for i, line in enumerate(whole.splitlines()))


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (without(f"{POSE}/images_processed/Cam01/*.0001*.png"), r"the frames of \d+ of 331 lamps .* 265 at least"),
        (without(f"{POSE}/images_processed/Cam01/*"), "holds no frames named like CAPTURE.000014.avif"),
        (without(f"{POSE}/segmentations/masks/000/Cam01.png"), "mask: there is no file"),
        (without(CALIB), "calibration: there is no file"),
        (edit(CALIB, lambda text: text[:900]), "three lines of"),
        (edit(CALIB, lambda text: "tc camera calibration v0.3\n"), "names no camera"),
        (edit(CALIB, lambda text: text.replace("extrinsics", "pose", 1)), "camera 0 lacks its extrinsic"),
        (edit(CALIB, replace_line(5, "#\t1 0 x 5")), "extrinsics are three lines of 4 numbers, not '1 0 x 5'"),
        (edit(CALIB, replace_line(5, "#\t2 0 0 5")), "extrinsics of camera 0 are not a rotation and a translation"),
        (edit(CALIB, replace_line(9, "#\t-1 0 .5")), "focal lengths of camera 0 must be positive"),
        (edit(LAMPS, lambda text: re.sub(r"(-?\d+)\.(\d{3})", r"\1\2.", text)), "do not look at the lamps' centre"),
        (edit(LAMPS, replace_line(3, "v 1 2")), "line 4: a lamp is `v x y z`, not '1 2'"),
        (edit(LAMPS, replace_line(3, "v 1 2 nan")), "line 4: a lamp is `v x y z`"),
        (edit(SPIRAL, lambda text: text[:-4]), "must name each of the 331 lamps of .* once"),
        (edit(SPIRAL, replace_line(7, "one")), "line 8: the number of a lamp is expected, not 'one'"),
        (edit(SPIRAL, replace_line(7, "1")), "must name each of the 331 lamps"),
        (lambda folder: (folder / SPIRAL).write_bytes(b"\xff\xfe\x00"), "is not a text file"),
        (lambda folder: (folder / POSE / "images_processed/Cam01").rename(folder / POSE / "images_processed/Cam09"),
         "has the cameras Cam01 to Cam04"),
        (lambda folder: Image.new("RGB", (48, 64), "red").save(folder / POSE / "images_processed/Cam01/B.000020.png"),
         "holds frames of two captures"),
    ],
)  # fmt: skip
def test_what_is_refused(copy, broken, words):
    broken(copy)
    with pytest.raises(UserError, match=words) as caught:
        list(captures(copy))
    assert "\n" not in str(caught.value)


def test_frames_that_are_broken_or_out_of_place(copy):
    place = copy / POSE / "images_processed" / "Cam01"
    capture = next(captures(copy))
    inside = capture.read_mask() >= 128
    frame = place / "T001_A.000200.png"
    kept = frame.read_bytes()
    frame.write_bytes(kept[: len(kept) // 2])
    with pytest.raises(UserError, match=r"000200\.png is damaged or cut short"):
        list(capture.read_frames(inside))
    Image.new("RGB", (40, 64)).save(frame)
    with pytest.raises(UserError, match=r"000200\.png is 40x64 pixels and the first frame 48x64"):
        list(capture.read_frames(inside))
    frame.write_bytes(kept)
    for number in range(200, 361):  # one is missing, and what follows has moved up
        (place / f"T001_A.{number + 1:06d}.png").rename(place / f"T001_A.{number:06d}.png")
    shifted = next(captures(copy))
    with pytest.raises(UserError, match=r"000202\.png should be full-bright and is not brighter than its neighbours"):
        shifted.check_order(inside)
    Image.new("L", (40, 64)).save(copy / POSE / "segmentations/masks/000/Cam01.png")
    with pytest.raises(UserError, match="40x64 pixels"):
        shifted.read_mask()


def test_nothing_there(tmp_path):
    with pytest.raises(UserError, match=r"holds no SUBJECT_\*/POSE_\*/images_processed/Cam\*$"):
        next(captures(tmp_path))
    with pytest.raises(UserError, match=r"'\(' is not a regular expression"):
        next(captures(tmp_path, "("))
