"""The record's file."""

import numpy as np
import pytest

from relight.files import UserError
from relight.meshes import Mesh


def test_round_trip(tmp_path, person):
    mesh = person()
    mesh.materials[1].texture = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    mesh.info = {"name": "person", "repairs": {"holes": 3}, "turn": 1.5}
    mesh.save(tmp_path / "a.npz")
    again = Mesh.load(tmp_path / "a.npz")
    for field in ("vertices", "faces", "uv", "material", "color"):
        value = getattr(again, field)
        np.testing.assert_array_equal(value, getattr(mesh, field))
        assert value.dtype == getattr(mesh, field).dtype
    assert again.info == mesh.info
    assert again.materials[0].texture is None
    np.testing.assert_array_equal(again.materials[1].texture, mesh.materials[1].texture)


def test_a_file_that_is_cut_or_something_else_is_refused(tmp_path, person):
    person(4).save(tmp_path / "a.npz")
    data = (tmp_path / "a.npz").read_bytes()
    np.savez(tmp_path / "other.npz", x=1)
    (tmp_path / "text.npz").write_text("hello")
    (tmp_path / "empty.npz").write_bytes(b"")
    (tmp_path / "cut.npz").write_bytes(data[: len(data) // 2])
    for name in ("other", "text", "empty", "cut", "missing"):
        with pytest.raises(UserError, match="is not a mesh record"):
            Mesh.load(tmp_path / f"{name}.npz")
