import hashlib
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from samples import ssim_in_the_box
from skimage.metrics import peak_signal_noise_ratio
from typer.testing import CliRunner

from relight.benchmark.files import MAPS, PICTURES, BenchmarkSet
from relight.benchmark.measures import INVARIANCES, LEAKS
from relight.benchmark.methods import answer
from relight.benchmark.score import COLUMNS, read_scores, score
from relight.benchmark.tables import MethodComparison
from relight.cli import app
from relight.core.errors import UserError
from relight.core.srgb import decode, encode
from relight.photos.network import read_network
from relight.photos.person import OPAQUE


@pytest.fixture
def truth(drawn, tmp_path):
    out = tmp_path / "truth"
    out.mkdir()
    for entry in BenchmarkSet(drawn).entries:
        if not entry.of:
            shutil.copy(drawn / "truth" / f"{entry.name}.npz", out)
    return out


def changed(path, **arrays):
    """The answer in `path` with other arrays; None takes one away."""
    found = {**np.load(path), **arrays}
    photo = str(found.pop("photo"))
    np.savez(path, photo=np.array(photo), **{name: values for name, values in found.items() if values is not None})


def test_score_of_the_truth(drawn, truth):
    row = read_scores(score(drawn, truth).parent)
    assert len(row) == 3
    for name in COLUMNS:
        values = row[name]
        if name in INVARIANCES or name.startswith("ratio"):
            assert np.isnan(values).all(), name
        elif name.endswith(("_ssim", "_psnr")):
            assert np.allclose(values, 1 if name.endswith("_ssim") else 100), name
        elif name not in LEAKS:
            assert np.allclose(values, 0, atol=1e-6), name


def test_score_of_the_untouched_picture(drawn, tmp_path):
    assert answer(drawn, tmp_path, "as_it_is") == 3
    row = read_scores(score(drawn, tmp_path).parent)
    for i, entry in enumerate(e for e in BenchmarkSet(drawn).entries if not e.of):
        photo = np.asarray(Image.open(entry.folder / "photo.png")) / 255
        solid = np.asarray(Image.open(entry.folder / "mask.png")) >= OPAQUE
        found, linear = [], decode(photo[solid])
        for true in np.load(drawn / "truth" / f"{entry.name}.npz")["full"] / 255:
            scale = np.linalg.lstsq(linear.reshape(-1, 1), decode(true[solid]).ravel())[0]
            both = np.stack([photo[solid], encode(scale * linear)])
            error, scaled = np.sqrt(((both - true[solid]) ** 2).sum(-1).mean(1))
            decibel = peak_signal_noise_ratio(true[solid], photo[solid], data_range=1.0)
            found.append((error, decibel, ssim_in_the_box(photo, true, solid), scaled))
        means = row[["ratio", "ratio_psnr", "ratio_ssim", "ratio_factor"]].iloc[i]
        np.testing.assert_allclose(means, np.mean(found, 0), rtol=1e-5)
    assert all(np.isnan(row[name]).all() for name in COLUMNS if not name.startswith("ratio"))


def test_score_of_the_loop_on_the_page(drawn, tmp_path, monkeypatch):
    """The page's loop and its method that wants a background, with a model that leaves the photo as it is."""
    page = (Path(__file__).parents[2] / "docs" / "benchmark.md").read_text()
    loop, method = (part.split("```")[0] for part in page.split("```python\n")[1:3])
    seen = []
    monkeypatch.chdir(tmp_path)
    (tmp_path / "benchmark").symlink_to(drawn)
    exec(method + loop, {"my_model": lambda photo, mask, behind: seen.append(behind) or photo, "np": np})
    answer(drawn, tmp_path / "as_it_is", "as_it_is")
    folders = tmp_path / "answers/mine", tmp_path / "as_it_is"
    mine, theirs = (read_scores(score(drawn, folder).parent) for folder in folders)
    assert np.allclose(mine["full"], theirs["ratio"])
    assert len(seen) == 12 and all(view.dtype == np.uint8 and view.ndim == 3 and view.std() > 1 for view in seen)


def test_score_of_true_maps(drawn, tmp_path):
    """The set is painted by albedo * max(T.L, 0): only rounding to 8 bits and half floats is left, and highlights."""
    answer(drawn, tmp_path, "true_maps")
    row = read_scores(score(drawn, tmp_path).parent)
    assert row["full"].max() < 0.003 and row["full_ssim"].min() > 0.999
    assert row["light"].max() < 1e-5 and row["albedo"].max() < 1e-5
    assert row["shading"].max() < 0.01  # the mean of max(T.L, 0), and max of the mean, in a pixel of the square
    assert row["ratio"].max() < 0.1


def test_score_and_answer_refuse(drawn, truth, tmp_path):
    path = truth / "g900000.1.npz"
    kept = path.read_bytes()
    arrays = dict(np.load(path))
    for changes, words in (
        ({"albedo": arrays["albedo"][1:]}, r"albedo has the shape \(31, 32, 3\), but must have \(32, 32, 3\)"),
        ({"full": arrays["full"][:3]}, r"full has the shape \(3, 64, 64, 3\), but must have \(4, 64, 64, 3\)"),
        ({"light": arrays["light"][:4]}, r"light has the shape \(4, 3\)"),
        ({"full": arrays["full"] / 255}, "full is float64, but must be uint8"),
        ({"albedo": (255 * arrays["albedo"]).astype(np.uint8)}, r"albedo is uint8, but must be float \(linear\)"),
        ({"shading": arrays["shading"] * np.float16(np.inf)}, "shading has values that are not finite numbers"),
        ({"shading": arrays["shading"] * 1e200}, r"shading has values that are not .*, or beyond 1e\+30"),
        ({"relit": arrays["full"]}, "holds relit: it may hold photo, ratio, full, albedo, shading, transport, light"),
        ({"albedo": None}, "all answers of a folder must hold the same arrays"),
        (dict.fromkeys([*PICTURES, *MAPS, "light"]), "is empty: it must hold at least one of ratio, full"),
    ):
        changed(path, **changes)
        with pytest.raises(UserError, match=words) as caught:
            score(drawn, truth)
        assert str(caught.value).count("\n") == 0
        path.write_bytes(kept)
    path.write_bytes((truth / "g900000.2.npz").read_bytes())
    with pytest.raises(UserError, match=r"g900000\.1\.npz answers another picture: its `photo` must be the SHA-256 of"):
        score(drawn, truth)
    path.write_bytes(kept[:200])
    with pytest.raises(UserError, match="is not a benchmark file of relight"):
        score(drawn, truth)
    path.rename(misnamed := truth / "g900000.1_mirror.npz")
    with pytest.raises(UserError, match=r"g900000\.1_mirror\.npz answers no picture of the set"):
        score(drawn, truth)
    misnamed.unlink()
    with pytest.raises(UserError, match=r"there is no .*g900000\.1\.npz: a folder of answers must have one .npz for"):
        score(drawn, truth)
    (tmp_path / "answers.json").write_text('{"set')
    copy = shutil.copytree(drawn, tmp_path / "copy")
    picture = copy / "inputs" / "g900000.2" / "photo.png"
    Image.fromarray(255 - np.asarray(Image.open(picture))).save(picture)
    best = tmp_path / "best"
    for use, given, says in (
        (score, (drawn, tmp_path / "nowhere"), "there is no such folder of answers"),
        (score, (tmp_path, truth), "there is no finished benchmark there"),
        (score, (copy, truth), r"photo\.png has changed since the benchmark was made"),
        (answer, (drawn, tmp_path, "as_it_is"), "holds answers of another method, network or set"),
        (answer, (drawn, best, "best"), "--method best: must be one of network, as_it_is, mean_light, true_maps"),
        (
            answer,
            (drawn, best, "as_it_is", Path("no.onnx")),
            r"--weights no\.onnx is for --method network, not as_it_is",
        ),
    ):
        with pytest.raises(UserError, match=says):
            use(*given)


def test_answer_and_score_of_a_network(drawn, weights, tmp_path):
    out = tmp_path / "tiny"
    says = CliRunner().invoke(app, ["benchmark", "answer", str(out), "--truth", str(drawn), "-w", str(weights)])
    entries = BenchmarkSet(drawn).entries
    assert says.exit_code == 0 and f"{len(entries)} answers written" in says.output
    base = entries[0]
    given = np.load(out / f"{base.name}.npz")
    assert set(given) == {"photo", *PICTURES, *MAPS, "light"}
    assert str(given["photo"]) == hashlib.sha256((base.folder / "photo.png").read_bytes()).hexdigest()
    assert all(given[name].shape == (32, 32, n) for name, n in MAPS.items())
    outside = np.asarray(Image.open(base.folder / "mask.png")) == 0
    photo = np.asarray(Image.open(base.folder / "photo.png"))
    assert all((given[mode][:, outside] == photo[outside]).all() for mode in PICTURES)
    assert answer(drawn, out, "network", weights) == 0  # what is there is kept
    with pytest.raises(UserError, match="holds answers of another method, network or set"):
        answer(drawn, out, "true_maps")
    says = CliRunner().invoke(app, ["benchmark", "score", str(out), "--truth", str(drawn)])
    assert says.exit_code == 0 and "Relit pictures" in says.output and "light: square shifted by 4 px" in says.output
    row = read_scores(out)
    assert np.isfinite([row[name].iloc[0] for name in COLUMNS]).all()
    assert [not np.isnan(v) for v in row["knee"]] == [True, False, False] and np.isfinite(row["full"]).all()
    changed(mirror := out / "g900000.1+mirror.npz", albedo=None)
    with pytest.raises(UserError, match=r"g900000\.1\+mirror\.npz holds"):
        score(drawn, out)
    mirror.unlink()
    with pytest.raises(UserError, match=r"there is no .*g900000\.1\+mirror\.npz"):
        score(drawn, out)
    for entry in entries:
        if entry.of:
            (out / f"{entry.name}.npz").unlink(missing_ok=True)
    score(drawn, out)  # all variants may be left out
    assert np.isnan(read_scores(out)["knee"]).all()


def test_comparison_tables_and_command(drawn, truth, tmp_path):
    answer(drawn, tmp_path / "as_it_is", "as_it_is")
    for folder in (truth, tmp_path / "as_it_is"):
        score(drawn, folder)
    out = tmp_path / "tables"
    out.mkdir()
    says = CliRunner().invoke(app, ["benchmark", "report", str(truth), str(tmp_path / "as_it_is"), "-o", str(out)])
    assert says.exit_code == 0 and "| as_it_is " in says.output
    names = ("pictures", "maps", "invariance")
    assert {p.name for p in out.iterdir()} == {f"benchmark_{name}.{end}" for name in names for end in ("csv", "md")}
    before = {path.name for path in Path.cwd().iterdir()}
    for more in ([], [str(tmp_path / "benchmark_pictures.csv")]):  # beside the answers, where `*` finds it again
        assert CliRunner().invoke(app, ["benchmark", "report", str(tmp_path / "as_it_is"), *more]).exit_code == 0
        assert (tmp_path / "benchmark_pictures.csv").is_file()
    assert {path.name for path in Path.cwd().iterdir()} == before
    rows = [read_scores(truth), read_scores(tmp_path / "as_it_is")]
    made = MethodComparison(rows).tables()
    moves = made["benchmark_invariance"].grid.frame
    assert list(moves.columns) == ["truth"] and len(moves) == len(INVARIANCES | LEAKS)  # as_it_is says nothing
    values, cells = rows[1]["ratio"].to_numpy(), made["benchmark_pictures"].grid.frame["ratio: RMSE"]
    by_figure, found = [values[:2].mean(), values[2]], cells["as_it_is"]
    assert cells["truth"] is None
    assert np.isclose(found.mean, np.mean(by_figure)) and np.allclose(found.values[:, 0], by_figure)
    assert found.low < found.mean < found.high
    for words in ("3 pictures of 2 figures", "Fewer than 6 figures decide nothing"):
        assert words in made["benchmark_pictures"].note
    assert "means over 0 pictures of 0 figures. The last" in made["benchmark_invariance"].note
    answer(drawn, tmp_path / "mean", "mean_light")
    assert read_network().digest in (tmp_path / "mean" / "answers.json").read_text()
    other = read_scores(score(drawn, tmp_path / "mean").parent)
    difference = MethodComparison([rows[1], other]).tables()["benchmark_differences"].grid.frame["ratio: RMSE"]["mean"]
    gaps = other["ratio"].to_numpy() - values
    assert np.isclose(difference.mean, np.mean([gaps[:2].mean(), gaps[2]]))
    os.utime(next((tmp_path / "mean").glob("*.npz")), (4e9, 4e9))
    with pytest.raises(UserError, match=r"mean/scores\.csv is older than the answers beside it"):
        read_scores(tmp_path / "mean")
    with pytest.raises(UserError, match="two folders of answers have the same name"):
        MethodComparison([rows[0], rows[0]])
    lines = (tmp_path / "as_it_is" / "scores.csv").read_text().replace(rows[1].index[0][0], "0" * 16)
    (tmp_path / "as_it_is" / "scores.csv").write_text(lines)
    with pytest.raises(UserError, match="as_it_is and truth were scored on different sets"):
        MethodComparison([read_scores(truth), read_scores(tmp_path / "as_it_is")])
    (truth / "scores.csv").write_text("picture,error\na,1\n")
    with pytest.raises(UserError, match="is not a table of scores, as relight benchmark score writes it"):
        read_scores(truth)
