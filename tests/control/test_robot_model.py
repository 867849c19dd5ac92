"""The Pinocchio model against MuJoCo on the same MJCF, and its own differential laws."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest

from control.frames import rotation_from_quaternion
from control.joints import JOINT_COUNT, JOINT_NAMES, LEGS, WHEEL_HALF_WIDTH_M, WHEEL_RADIUS_M
from control.paths import ROBOT_MJCF
from control.robot_model import RobotModel, RobotModelError

TOLERANCE = 1e-9
SEEDS = range(12)


@dataclass
class State:
    wxyz: np.ndarray
    rotation: np.ndarray
    linear_in_base: np.ndarray
    angular_in_base: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray

    def apply(self, model: RobotModel) -> None:
        model.update(self.rotation, self.joint_position, self.linear_in_base, self.angular_in_base, self.joint_velocity)


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return RobotModel()


@pytest.fixture(scope="module")
def mujoco_model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(ROBOT_MJCF))


def random_state(seed: int) -> State:
    rng = np.random.default_rng(seed)
    wxyz = rng.normal(size=4)
    wxyz /= np.linalg.norm(wxyz)
    return State(
        wxyz,
        rotation_from_quaternion(wxyz),
        rng.normal(size=3),
        rng.normal(size=3),
        rng.uniform(-2, 2, JOINT_COUNT),
        rng.normal(size=JOINT_COUNT) * 3,
    )


def mujoco_data(m: mujoco.MjModel, state: State) -> mujoco.MjData:
    d = mujoco.MjData(m)
    d.qpos[:3] = [0.4, -0.7, 1.3]
    d.qpos[3:7] = state.wxyz
    d.qvel[:3] = state.rotation @ state.linear_in_base
    d.qvel[3:6] = state.angular_in_base
    for name, q, dq in zip(JOINT_NAMES, state.joint_position, state.joint_velocity, strict=True):
        joint = m.joint(name)
        d.qpos[joint.qposadr[0]] = q
        d.qvel[joint.dofadr[0]] = dq
    mujoco.mj_forward(m, d)
    return d


def velocity_map(m: mujoco.MjModel, model: RobotModel, state: State) -> np.ndarray:
    """T (28, 28) with v_pinocchio = T v_mujoco; forces map with T as well because T is orthogonal."""
    t = np.zeros((28, 28))
    t[:3, :3] = state.rotation.T
    t[3:6, 3:6] = np.eye(3)
    for row, name in zip(model.joint_rows, JOINT_NAMES, strict=True):
        t[row, m.joint(name).dofadr[0]] = 1.0
    return t


@pytest.mark.parametrize("seed", SEEDS)
def test_mass_matrix_and_bias_forces_match_mujoco(seed: int, model: RobotModel, mujoco_model: mujoco.MjModel) -> None:
    state = random_state(seed)
    state.apply(model)
    d = mujoco_data(mujoco_model, state)
    t = velocity_map(mujoco_model, model, state)

    mass = np.zeros((28, 28))
    mujoco.mj_fullM(mujoco_model, d, mass)
    np.testing.assert_allclose(model.mass_matrix, t @ mass @ t.T, atol=TOLERANCE)

    # At MuJoCo's qacc = 0 the base velocity in base axes still turns: dv/dt = -w x v.
    acceleration = -np.cross(state.angular_in_base, state.linear_in_base)
    bias = model.mass_matrix[:, :3] @ acceleration + model.coriolis_matrix @ model.velocity + model.gravity
    np.testing.assert_allclose(bias, t @ d.qfrc_bias, atol=TOLERANCE)


@pytest.mark.parametrize("seed", SEEDS)
def test_end_effector_and_contact_jacobians_match_mujoco(seed: int, model: RobotModel, mujoco_model: mujoco.MjModel) -> None:
    state = random_state(seed)
    state.apply(model)
    d = mujoco_data(mujoco_model, state)
    t = velocity_map(mujoco_model, model, state)

    linear, angular = np.zeros((3, 28)), np.zeros((3, 28))
    site = mujoco_model.site("end_effector").id
    mujoco.mj_jacSite(mujoco_model, d, linear, angular, site)
    np.testing.assert_allclose(model.end_effector_jacobian, np.vstack([linear, angular]) @ t.T, atol=TOLERANCE)
    np.testing.assert_allclose(model.end_effector_position, d.site_xpos[site] - d.qpos[:3], atol=TOLERANCE)
    np.testing.assert_allclose(model.end_effector_rotation, d.site_xmat[site].reshape(3, 3), atol=TOLERANCE)

    for index, leg in enumerate(LEGS):
        point = model.wheel_contact_positions[index] + d.qpos[:3]
        mujoco.mj_jac(mujoco_model, d, linear, None, point, mujoco_model.body(f"{leg}_wheel").id)
        np.testing.assert_allclose(model.wheel_contact_jacobians[index], linear @ t.T, atol=TOLERANCE)


@pytest.mark.parametrize("seed", SEEDS)
def test_contact_point_is_the_lowest_of_the_wheel_ellipsoid(seed: int, model: RobotModel, mujoco_model: mujoco.MjModel) -> None:
    state = random_state(seed)
    state.apply(model)
    d = mujoco_data(mujoco_model, state)
    for index, leg in enumerate(LEGS):
        geom = d.geom(f"{leg}_wheel")
        local = geom.xmat.reshape(3, 3).T @ (model.wheel_contact_positions[index] + d.qpos[:3] - geom.xpos)
        half_axes = np.array([WHEEL_RADIUS_M, WHEEL_HALF_WIDTH_M, WHEEL_RADIUS_M])
        assert np.sum((local / half_axes) ** 2) == pytest.approx(1.0, abs=1e-9)
        normal = geom.xmat.reshape(3, 3) @ (local / half_axes**2)
        np.testing.assert_allclose(normal / np.linalg.norm(normal), [0, 0, -1], atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_passivity_and_momentum_drift_by_finite_differences(seed: int, model: RobotModel) -> None:
    state = random_state(seed)
    step = 1e-6

    def mass_matrix_at(time: float) -> np.ndarray:
        turn = state.angular_in_base * time
        angle = np.linalg.norm(turn)
        half = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * turn / angle])
        model.update(
            state.rotation @ rotation_from_quaternion(half),
            state.joint_position + state.joint_velocity * time,
            state.linear_in_base,
            state.angular_in_base,
            state.joint_velocity,
        )
        return model.mass_matrix.copy()

    mass_rate = (mass_matrix_at(step) - mass_matrix_at(-step)) / (2 * step)
    state.apply(model)
    coriolis = model.coriolis_matrix
    np.testing.assert_allclose(mass_rate, coriolis + coriolis.T, atol=1e-6)
    bias = coriolis @ model.velocity + model.gravity
    np.testing.assert_allclose(model.momentum_drift, mass_rate @ model.velocity - bias, atol=1e-5)


def test_mass_properties_and_limits_match_mujoco(model: RobotModel, mujoco_model: mujoco.MjModel) -> None:
    state = random_state(99)
    state.apply(model)
    d = mujoco_data(mujoco_model, state)
    np.testing.assert_allclose(model.center_of_mass, d.subtree_com[1] - d.qpos[:3], atol=TOLERANCE)
    assert model.total_mass == pytest.approx(mujoco_model.body_mass.sum())
    assert model.momentum == pytest.approx(model.mass_matrix @ model.velocity)
    for index, name in enumerate(JOINT_NAMES):
        joint = mujoco_model.joint(name)
        assert model.joint_damping[index] == pytest.approx(mujoco_model.dof_damping[joint.dofadr[0]])
        assert model.joint_friction[index] == pytest.approx(mujoco_model.dof_frictionloss[joint.dofadr[0]])
        if joint.limited[0]:
            assert (model.position_lower[index], model.position_upper[index]) == pytest.approx(tuple(joint.range))
        else:
            assert np.isinf([model.position_lower[index], model.position_upper[index]]).all()


def test_jacobians_follow_a_configuration_update_without_velocities(model: RobotModel) -> None:
    first, second = random_state(1), random_state(2)
    first.apply(model)
    before = model.wrench_jacobian.copy()
    model.update_configuration(second.rotation, second.joint_position)
    only_configuration = model.wrench_jacobian.copy()
    second.apply(model)
    assert np.abs(before - only_configuration).max() > 0.1
    np.testing.assert_array_equal(model.wrench_jacobian, only_configuration)


def test_a_model_without_the_expected_joints_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"missing\.xml"):
        RobotModel(tmp_path / "missing.xml")
    renamed = tmp_path / "robot.xml"
    renamed.write_text(ROBOT_MJCF.read_text().replace("FL_hip", "XX_hip"))
    with pytest.raises(RobotModelError, match="FL_hip"):
        RobotModel(renamed)
