"""Skins of glTF files against the standard's sum over joints; the mesh's own node does not count."""

import numpy as np
import pytest
from samples import glb_of
from scipy.spatial.transform import Rotation

from relight.meshes import read_mesh

COMPONENTS = {"|u1": 5121, "<u2": 5123, "<f4": 5126}
SHAPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
ONE_JOINT, WHOLE = np.array([[0, 0, 0, 0]] * 3, "u1"), np.array([[1, 0, 0, 0]] * 3, "<f4")
MOVED = {"translation": [0, 5, 0], "rotation": [0, 0, 0.6, 0.8], "scale": [0.01, 0.01, 0.01]}


class File:
    """A .glb file that grows by accessors."""

    def __init__(self, **scene):
        self.data, self.scene = b"", {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], **scene}

    def add(self, array, **more):
        array = np.ascontiguousarray(array)
        self.data += b"\0" * (-len(self.data) % 4)
        views, accessors = self.scene["bufferViews"], self.scene["accessors"]
        views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes})
        kind = {"componentType": COMPONENTS[array.dtype.str], "type": SHAPES[array[0].size]}
        accessors.append({"bufferView": len(views) - 1, "count": len(array), **kind, **more})
        self.data += array.tobytes()
        return len(accessors) - 1

    def mesh(self, positions=TRIANGLE, joints=(ONE_JOINT,), weights=(WHOLE,), normalized=False, **more):
        """Returns a mesh whose attributes end in _0, _1 and so on."""
        attributes = {"POSITION": self.add(positions), **{name: self.add(array) for name, array in more.items()}}
        for number, (joint, weight) in enumerate(zip(joints, weights)):
            attributes[f"JOINTS_{number}"] = self.add(joint)
            attributes[f"WEIGHTS_{number}"] = self.add(weight, normalized=normalized)
        return {"primitives": [{"attributes": attributes}]}

    def skin(self, joints, inverse=None):
        """Returns a skin; `inverse` are its inverse bind matrices (J,4,4)."""
        if inverse is None:
            return {"joints": joints}
        columns = np.asarray(inverse, "<f4").swapaxes(1, 2).reshape(-1, 16)
        return {"joints": joints, "inverseBindMatrices": self.add(columns)}

    def read(self, folder):
        (folder / "a.glb").write_bytes(glb_of(self.scene | {"buffers": [{"byteLength": len(self.data)}]}, self.data))
        return read_mesh(folder / "a.glb")


def matrix(translation=(0, 0, 0), rotation=(0, 0, 0, 1), scale=(1, 1, 1)):
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat(rotation).as_matrix() @ np.diag(scale)
    out[:3, 3] = translation
    return out


@pytest.mark.parametrize("parent", [{}, {"scale": [100, 100, 100], "translation": [3, 0, 0]}])
def test_the_node_of_a_skinned_mesh_and_its_parents_do_not_move_it(tmp_path, parent):
    """Body and hair of one skeleton; the same mesh without a skin moves with its node."""
    file = File(scene=0, scenes=[{"nodes": [0, 1, 3]}])
    file.scene["meshes"] = [file.mesh()]
    file.scene["skins"] = [file.skin([0], [np.eye(4)])]
    file.scene["nodes"] = [{"name": "joint"}, {"children": [2, 4], **parent}, {"mesh": 0, "skin": 0, **MOVED},
                           {"mesh": 0, "skin": 0}, {"mesh": 0, **MOVED}]  # fmt: skip
    mesh = file.read(tmp_path)
    for first in (0, 6):  # depth first: node 2, node 4, node 3
        np.testing.assert_allclose(mesh.vertices[first : first + 3], TRIANGLE, atol=1e-6)
    expected = np.c_[TRIANGLE, np.ones(3)] @ (matrix(**parent) @ matrix(**MOVED)).T
    np.testing.assert_allclose(mesh.vertices[3:6], expected[:, :3], rtol=1e-5)
    assert not any("left out" in line for line in mesh.info["warnings"])


def posed(file, seed=0, count=40):
    """A chain of five joints under a moved root, posed away from its bind pose; what it does to a cloud."""
    generator = np.random.default_rng(seed)
    places, scales = generator.normal(size=(6, 3)).tolist(), generator.uniform(0.5, 2, (6, 3)).tolist()
    turns = Rotation.random(6, rng=generator).as_quat().tolist()
    poses = [dict(zip(("translation", "rotation", "scale"), parts)) for parts in zip(places, turns, scales)]
    file.scene["nodes"] = [{**pose, "children": [i + 1]} for i, pose in enumerate(poses[:5])] + [poses[5]]
    file.scene["scenes"] = [{"nodes": [0]}]
    world = np.eye(4)
    placed = [world := world @ matrix(**pose) for pose in poses]
    inverse = [np.linalg.inv(matrix(*generator.normal(size=(1, 3)), Rotation.random(rng=generator).as_quat()))
               for _ in range(5)]  # fmt: skip
    points = generator.normal(size=(count, 3)).astype("<f4")
    joint = generator.integers(0, 5, (count, 4))
    weight = generator.dirichlet(np.ones(4), count).astype("<f4")
    bound = np.array(placed[1:]) @ np.float32(inverse).astype(float)  # joint 0 is node 1
    share = weight / weight.sum(1, keepdims=True)
    expected = np.einsum("vk,vkij,vj->vi", share, bound[joint], np.insert(points, 3, 1, axis=1))[:, :3]
    return points, joint, weight, inverse, expected


@pytest.mark.parametrize("kind", ["u1", "<u2"])
@pytest.mark.parametrize("scale", [1, 2])
@pytest.mark.parametrize("split", [False, True])
def test_a_pose_is_the_weighted_sum_over_its_joints(tmp_path, kind, scale, split):
    """Joints of 8 and 16 bits, weights that sum to 1 or 2, and four joints in two sets of attributes."""
    file = File()
    points, joint, weight, inverse, expected = posed(file, count=42)
    joints, weights = [joint.astype(kind)], [weight * np.float32(scale)]
    if split:
        none = np.zeros_like(weights[0])
        joints, weights = [joints[0], np.roll(joints[0], 2, 1)], [none, none.copy()]
        weights[0][:, :2], weights[1][:, :2] = weight[:, :2], weight[:, 2:]
    file.scene["meshes"] = [file.mesh(points, joints, weights)]
    file.scene["skins"] = [file.skin([1, 2, 3, 4, 5], inverse)]
    file.scene["nodes"].append({"mesh": 0, "skin": 0, **MOVED})
    file.scene["scenes"][0]["nodes"].insert(0, 6)  # before the joints
    np.testing.assert_allclose(file.read(tmp_path).vertices, expected, rtol=1e-4, atol=1e-4)


def test_a_mirrored_rig_shows_its_outside(tmp_path):
    """The joint mirrors x and stretches y: faces are turned over, and normals go with the transposed inverse."""
    normals = np.array([[0.6, 0, 0.8]] * 3, "<f4")
    file = File(nodes=[{"scale": [-1, 1, 2]}, {"mesh": 0, "skin": 0}])
    file.scene["meshes"], file.scene["skins"] = [file.mesh(NORMAL=normals)], [file.skin([0])]
    mesh = file.read(tmp_path)
    a, b, c = mesh.vertices[mesh.faces[0]]
    assert np.cross(b - a, c - a)[2] > 0
    found, expected = mesh.normal[0], np.array([-0.6, 0, 0.4])
    np.testing.assert_allclose(found / np.linalg.norm(found), expected / np.linalg.norm(expected), atol=1e-6)


@pytest.mark.parametrize(("given", "z"), [({"weights": [np.zeros((3, 4), "<f4")]}, 3), ({"joints": ()}, 0)])
def test_vertices_without_weights_go_with_their_first_joint_and_without_joints_stay(tmp_path, given, z):
    file = File(nodes=[{"translation": [0, 0, 3]}, {"mesh": 0, "skin": 0, **MOVED}])
    file.scene["meshes"], file.scene["skins"] = [file.mesh(**given)], [file.skin([0])]
    np.testing.assert_allclose(file.read(tmp_path).vertices, TRIANGLE + [0, 0, z])
