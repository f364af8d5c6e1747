import gzip
from dataclasses import replace

import pytest
from samples import tarball

from relight.core.errors import UserError
from relight.viewer import runtime


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of the right files with short contents, which stands for the known version."""
    monkeypatch.setenv("RELIGHT_DATA", str(tmp_path / "data"))
    path = tmp_path / "package.tgz"
    integrity = tarball(path, {f"package/dist/{name}": name.encode() for name in runtime.FILES})
    monkeypatch.setattr(runtime, "PACKAGE", replace(runtime.PACKAGE, integrity=integrity))
    return path


def test_a_package_is_kept_and_unpacked(package, tmp_path):
    with pytest.raises(UserError, match="run once `relight web setup`"):
        runtime.unpack(tmp_path)
    kept = runtime.setup(package)
    assert kept == runtime.package_file() and kept.read_bytes() == package.read_bytes()
    package.unlink()
    (tmp_path / "site").mkdir()
    assert [path.read_text() for path in runtime.unpack(tmp_path / "site")] == list(runtime.FILES)
    whole = kept.read_bytes()
    for damaged in (whole[:60], whole[:-60], whole[:40] + bytes(20) + whole[60:], gzip.compress(b""), b"no archive"):
        kept.write_bytes(damaged)
        with pytest.raises(UserError, match="damaged: run `relight web setup` again"):
            runtime.unpack(tmp_path / "site")
