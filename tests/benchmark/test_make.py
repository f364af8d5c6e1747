from unittest.mock import Mock

import pytest

from relight.benchmark import make as making
from relight.benchmark.files import BenchmarkSet
from relight.benchmark.make import make
from relight.benchmark.picture import Settings
from relight.core.errors import UserError
from relight.figures import make as generate


def test_make_resumes_an_interrupted_set(painter, drawn, settings, tmp_path, monkeypatch):
    asked = []

    def once(recipe, *rest):
        asked.append(recipe.name)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return painter(recipe, *rest)

    monkeypatch.setattr(making, "render_picture", once)
    with pytest.raises(KeyboardInterrupt):
        make(tmp_path, "report", 3, settings)
    inputs = tmp_path / "inputs"
    assert (inputs / "g900000.1").is_dir() and not (inputs / "g900000.2").exists()
    with pytest.raises(UserError, match="no finished benchmark"):
        BenchmarkSet(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(making, "write_panorama", Mock(side_effect=OSError("the disk has gone")))
        with pytest.raises(OSError, match="gone"):
            make(tmp_path, "report", 3, settings)
    assert not (inputs / "g900000.2").exists() and not list(inputs.glob(".*"))
    assert make(tmp_path, "report", 3, settings) == BenchmarkSet(drawn).hash  # that of the set that was made at once
    assert asked == ["g900000.1", "g900000.2", "g900000.2", "g900000.2", "g900001.1"]
    assert make(tmp_path, "report", 3, settings) == BenchmarkSet(drawn).hash
    assert len(asked) == 5, "nothing is drawn again"
    BenchmarkSet(tmp_path).verify()


def test_make_of_more_pictures_keeps_the_first(painter, settings, tmp_path):
    first = make(tmp_path, "choose", 1, settings)
    kept = (tmp_path / "inputs" / "g910000.1" / "photo.png").stat().st_mtime_ns
    second = make(tmp_path, "choose", 2, settings)
    assert first != second and len([e for e in BenchmarkSet(tmp_path).entries if not e.of]) == 2
    assert (tmp_path / "inputs" / "g910000.1" / "photo.png").stat().st_mtime_ns == kept


def test_make_refuses_folders_and_settings(painter, drawn, settings, tmp_path):
    for given in (("choose", 1, settings), ("report", 3, Settings(size=128))):
        with pytest.raises(UserError, match="holds another set, or one with other settings"):
            make(drawn, *given)
    for size in (60, 48, 100):
        with pytest.raises(UserError, match=f"--size {size}: must be a multiple of 16, and at least 64"):
            make(tmp_path, "report", 1, Settings(size=size))


def test_make_mesh_takes_a_spare_seed(monkeypatch):
    refuse = Mock(side_effect=UserError("it does not pass the gates"))
    monkeypatch.setattr(generate, "make_figure", refuse)
    with pytest.raises(UserError, match="seed 900003: it does not pass the gates"):
        making.make_mesh(900_003, Settings())
    assert [call.args[0] for call in refuse.call_args_list] == [900_003, 901_003, 902_003]
