"""The record's file."""

import numpy as np
import pytest

from relight.core.errors import UserError
from relight.meshes import Material, Mesh


def test_round_trip_of_a_mesh_and_of_outfits_which_change_materials_only(tmp_path, person):
    mesh = person()
    mesh.materials[1].texture = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    mesh.info = {"name": "person", "repairs": {"holes": 3}, "turn": 1.5}
    mesh.save(tmp_path / "a.npz")
    again = Mesh.load(tmp_path / "a.npz")
    for field in ("vertices", "faces", "uv", "material", "color"):
        value = getattr(again, field)
        np.testing.assert_array_equal(value, getattr(mesh, field))
        assert value.dtype == getattr(mesh, field).dtype
    assert again.info == mesh.info and again.materials[0].texture is None
    np.testing.assert_array_equal(again.materials[1].texture, mesh.materials[1].texture)
    red = Material(np.array([0.5, 0.1, 0.1], np.float32), np.full((2, 3, 3), 9, np.uint8), "", 0.25, 0.75)
    mesh.outfits = [{1: red}, {}]
    mesh.save(tmp_path / "a.npz")
    again = Mesh.load(tmp_path / "a.npz")
    assert [sorted(outfit) for outfit in again.outfits] == [[1], []]
    np.testing.assert_array_equal(again.outfits[0][1].texture, red.texture)
    np.testing.assert_array_equal(again.outfits[0][1].color, red.color)
    assert (again.outfits[0][1].roughness, again.outfits[0][1].specular) == (0.25, 0.75)
    assert (again.materials[0].roughness, again.materials[0].specular) == (1, 0)
    dressed = again.dressed(1)
    assert dressed.materials[0] is again.materials[0] and dressed.materials[1] is again.outfits[0][1]
    assert dressed.vertices is again.vertices and not dressed.outfits
    assert again.dressed(0).materials == again.materials == again.dressed(2).materials


def test_a_file_that_is_cut_or_something_else_is_refused(tmp_path, person):
    person(4).save(tmp_path / "a.npz")
    data = (tmp_path / "a.npz").read_bytes()
    np.savez(tmp_path / "other.npz", x=1)
    (tmp_path / "text.npz").write_text("hello")
    (tmp_path / "empty.npz").write_bytes(b"")
    (tmp_path / "cut.npz").write_bytes(data[: len(data) // 2])
    for name in ("other", "text", "empty", "cut"):
        with pytest.raises(UserError, match="is not a mesh record"):
            Mesh.load(tmp_path / f"{name}.npz")
    with pytest.raises(UserError, match="there is no file"):
        Mesh.load(tmp_path / "missing.npz")
