"""The robot on screen stands as MuJoCo says, body by body."""

import mujoco
import numpy as np
import pytest
import viser

from control.frames import quaternion_multiply, rotation_from_quaternion
from control.joints import JOINT_NAMES
from control.paths import ROBOT_MJCF
from web.scene import VISUALS, BodyTree, Scene


@pytest.mark.parametrize("seed", range(3))
def test_nested_bodies_reproduce_the_forward_kinematics_of_mujoco(seed: int) -> None:
    model = mujoco.MjModel.from_xml_path(str(ROBOT_MJCF))
    data = mujoco.MjData(model)
    joint_position = np.random.default_rng(seed).uniform(-1.0, 1.0, len(JOINT_NAMES))
    data.qpos[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    for name, angle in zip(JOINT_NAMES, joint_position, strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_kinematics(model, data)

    tree = BodyTree.from_mjcf()
    local = tree.orientations(joint_position)
    poses = {"": (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))}
    for index, path in enumerate(tree.paths):
        position, wxyz = poses[path.rpartition("/")[0]]
        offset = tree.positions[index] if index else np.zeros(3)
        poses[path] = position + rotation_from_quaternion(wxyz) @ offset, quaternion_multiply(wxyz, local[index])
        np.testing.assert_allclose(poses[path][0], data.body(tree.names[index]).xpos, atol=1e-12)
        assert abs(poses[path][1] @ data.body(tree.names[index]).xquat) == pytest.approx(1.0)


def test_every_body_has_a_mesh() -> None:
    missing = [name for name in BodyTree.from_mjcf().names if not (VISUALS / f"{name}.glb").is_file()]
    assert not missing


def test_update_moves_the_base_and_only_turns_the_hinges(server: viser.ViserServer, snapshot: np.void) -> None:
    scene = Scene(server)
    snapshot["base_position"] = [1.0, 2.0, 0.4]
    snapshot["joint_position"] = 0.3
    scene.update(snapshot)
    tree = BodyTree.from_mjcf()
    nodes = scene.nodes
    np.testing.assert_allclose(nodes["base"].position, [1.0, 2.0, 0.4])
    for index, name in enumerate(tree.names[1:], start=1):
        np.testing.assert_allclose(nodes[name].position, tree.positions[index])
    np.testing.assert_allclose(nodes["FL_calf"].wxyz, [np.cos(0.15), 0.0, np.sin(0.15), 0.0], atol=1e-6)
