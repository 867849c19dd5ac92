"""The simulated robot: drives, reported torque, IMU, truth, reset, mismatch and errors."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from control.frames import rotation_from_quaternion, rotation_heading_to_world
from control.joints import ARM_SLICE, JOINT_COUNT, JOINT_NAMES, NOMINAL_POSITION, TORQUE_LIMIT, WHEEL_SLICE
from control.timing import TICK_S
from control.types import JointCommand
from sim.backends.protocol import BackendError, GroundTruth
from sim.backends.simulation.drag_spring import DRAG_LIMIT_N
from sim.backends.simulation.mismatch import Mismatch
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.backends.simulation.sensors import SensorConfig
from sim.backends.simulation.wrenches import Pulse


def random_command(random: np.random.Generator) -> JointCommand:
    """Any gains, references and feed-forward, large enough to saturate some drives."""
    return JointCommand(
        position=NOMINAL_POSITION + random.normal(0.0, 0.3, JOINT_COUNT),
        velocity=random.normal(0.0, 3.0, JOINT_COUNT),
        stiffness=random.uniform(0.0, 80.0, JOINT_COUNT),
        damping=random.uniform(0.0, 4.0, JOINT_COUNT),
        torque=random.normal(0.0, 10.0, JOINT_COUNT),
    )


def generalized_drive_force(backend: MujocoBackend, velocity_before: np.ndarray) -> np.ndarray:
    """What the drives did over the last tick by momentum balance: M dv/h + bias - passive - constraint - applied."""
    model, data = backend.model, backend.data
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    change = data.qvel - velocity_before
    damping_at_end = data.qfrc_passive - model.dof_damping * change
    return mass @ change / TICK_S + data.qfrc_bias - damping_at_end - data.qfrc_constraint


def test_reported_torque_closes_the_momentum_balance_also_in_saturation(standing):
    backend, _ = standing()
    dofs = [backend.model.joint(name).dofadr[0] for name in JOINT_NAMES]
    random = np.random.default_rng(0)
    saturated = 0
    for _ in range(60):
        before = backend.data.qvel.copy()
        backend.write(random_command(random))
        torque = backend.read().joint_torque
        saturated += int((np.abs(torque) >= TORQUE_LIMIT).sum())
        balance = generalized_drive_force(backend, before)
        np.testing.assert_allclose(balance[dofs], torque, atol=1e-7)
        np.testing.assert_allclose(balance[:6], 0.0, atol=1e-7)
    assert saturated > 20


def test_reported_torque_is_the_command_law_with_the_velocity_at_the_end_of_the_tick(standing):
    backend, command = standing()
    command = replace(command, torque=command.torque + 0.5)
    for _ in range(20):
        before = backend.read().joint_position
        backend.write(command)
        frame = backend.read()
        expected = (
            command.stiffness * (command.position - before)
            + command.damping * (command.velocity - frame.joint_velocity)
            + command.torque
        )
        np.testing.assert_allclose(frame.joint_torque, expected, atol=1e-9)


def test_accelerometer_integrates_to_the_velocity_of_the_imu(standing):
    backend, command = standing()
    backend.wrenches.add(Pulse(np.array([60.0, 20.0, 0.0]), duration_s=0.3, body="base"))
    velocity = np.zeros(3)
    twist = np.zeros(6)
    for _ in range(200):
        backend.write(replace(command, velocity=np.full(JOINT_COUNT, 2.0)))
        frame = backend.read()
        specific_force = rotation_from_quaternion(frame.orientation_wxyz) @ frame.linear_acceleration
        velocity += TICK_S * (specific_force - [0.0, 0.0, 9.81])
    site = backend.model.site("imu").id
    mujoco.mj_objectVelocity(backend.model, backend.data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 0)
    assert np.abs(twist[3:]).max() > 0.05
    np.testing.assert_allclose(velocity, twist[3:], atol=1e-3)


def test_robot_at_rest_measures_gravity_and_stands_on_its_weight(standing):
    backend, command = standing()
    for _ in range(500):
        backend.write(command)
    frame, truth = backend.read(), backend.truth()
    np.testing.assert_allclose(frame.linear_acceleration, [0.0, 0.0, 9.81], atol=0.1)
    weight = mujoco.mj_getTotalmass(backend.model) * 9.81
    np.testing.assert_allclose(truth.wheel_forces.sum(0), [0.0, 0.0, weight], atol=0.02 * weight)
    assert truth.wheel_in_contact.all()
    np.testing.assert_allclose(truth.wheel_contact_positions[:, 2], 0.0, atol=1e-3)
    np.testing.assert_array_equal(truth.force_true_n, 0.0)


def test_truth_adds_wrenches_and_contacts_on_the_end_effector(standing):
    """Pressing on the board gives the sum of both, against MuJoCo's contact-by-contact forces."""
    backend, command = standing("board")
    backend.wrenches.add(Pulse(np.array([0.0, 0.0, -70.0]), duration_s=10.0, ramp_s=0.5))
    end_effector = backend.model.geom("end_effector").id
    touched = 0
    for tick in range(700):
        backend.write(command)
        truth = backend.truth()
        contact_force = np.zeros(3)
        local = np.zeros(6)
        for index, contact in enumerate(backend.data.contact):
            if end_effector in contact.geom:
                mujoco.mj_contactForce(backend.model, backend.data, index, local)
                sign = 1.0 if contact.geom[1] == end_effector else -1.0
                contact_force += sign * local[:3] @ contact.frame.reshape(3, 3)
        touched += bool(contact_force.any())
        applied = backend.data.xfrc_applied[backend.model.body("end_effector").id, :3]
        heading = rotation_heading_to_world(backend.data.body("base").xmat.reshape(3, 3))
        np.testing.assert_allclose(truth.force_true_n, (applied + contact_force) @ heading, atol=1e-9, err_msg=str(tick))
        assert contact_force[2] >= 0.0
    assert touched > 50


def test_truth_leaves_out_what_the_robot_does_to_itself():
    backend = MujocoBackend("free", SensorConfig.ideal())
    backend.open()
    model, data = backend.model, backend.data
    # Fold the arm until the tool's ball presses on the trunk.
    random = np.random.default_rng(3)
    columns = [model.joint(name).qposadr[0] for name in JOINT_NAMES[ARM_SLICE]]
    ball = model.geom("end_effector").id
    for _ in range(20000):
        data.qpos[columns] = random.uniform([-2.6, 0.0, -2.8, -1.5, -1.3, 0.0], [2.6, 2.9, 0.0, 1.5, 1.3, 0.0])
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        if (data.contact.geom == ball).any():
            break
    mujoco.mj_forward(model, data)
    assert np.abs(data.cfrc_ext[model.body("end_effector").id]).max() > 1.0
    np.testing.assert_allclose(backend.truth().force_true_n, 0.0, atol=1e-9)


def test_whether_anybody_looks_at_the_truth_changes_neither_it_nor_the_simulation(standing):
    watched, command = standing("box")
    unwatched, _ = standing("box")
    for tick in range(60):
        for backend in (watched, unwatched):
            if tick in (20, 45):
                backend.wrenches.add(Pulse(np.array([15.0, -5.0, 8.0]), duration_s=0.02, point_m=np.array([0.1, 0.0, 0.0])))
            backend.write(command)
        watched.truth()
        if tick % 7 == 0:
            np.testing.assert_array_equal(watched.data.cvel, unwatched.data.cvel)
    np.testing.assert_array_equal(watched.data.qpos, unwatched.data.qpos)
    ours, theirs = watched.truth(), unwatched.truth()
    for name in GroundTruth.__slots__:
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)


def test_reset_repeats_exactly_and_another_seed_differs(standing):
    backend, command = standing(sensors=SensorConfig())

    def run() -> np.ndarray:
        rows = []
        for _ in range(30):
            backend.write(command)
            rows.append(np.concatenate([backend.read().joint_position, backend.read().joint_torque]))
        return np.array(rows)

    backend.reset(seed=5)
    first = run()
    backend.reset()
    np.testing.assert_array_equal(run(), first)
    backend.reset(seed=6)
    assert np.abs(run() - first).max() > 1e-4
    assert backend.time_s == pytest.approx(30 * TICK_S)


def test_reset_ends_wrenches_and_keeps_the_mismatch(standing):
    backend, _ = standing()
    backend.set_mismatch(Mismatch(mass_scale=1.2))
    backend.wrenches.add(Pulse(np.ones(3), duration_s=5.0))
    backend.set_drag(np.array([1.0, 0.0, 1.0]))
    backend.reset()
    assert backend.wrenches.list() == ()
    assert backend.wrenches.drag is None
    assert backend.mass_scale == pytest.approx(1.2)
    backend.set_scene("box")
    assert backend.mass_scale == pytest.approx(1.2)


def test_drag_pulls_towards_the_target_up_to_its_cap(standing):
    backend, command = standing()
    tip = backend.truth().end_effector_position
    backend.set_drag(tip + [0.0, 1.0, 0.0])
    backend.write(command)
    np.testing.assert_allclose(backend.wrenches.drag_force_in_world, [0.0, DRAG_LIMIT_N, 0.0], atol=1e-9)
    backend.set_drag(tip + [0.0, 0.02, 0.0])
    for _ in range(400):
        backend.write(command)
    assert backend.truth().end_effector_position[1] > tip[1] + 0.005
    backend.set_drag(None)
    backend.write(command)
    np.testing.assert_array_equal(backend.truth().force_true_n, 0.0)


def test_wheels_alone_follow_a_velocity_command(standing):
    backend, command = standing()
    velocity = np.zeros(JOINT_COUNT)
    velocity[WHEEL_SLICE] = 3.0
    for _ in range(500):
        backend.write(replace(command, velocity=velocity))
    assert backend.truth().base_linear_velocity[0] == pytest.approx(3.0 * 0.086, rel=0.15)


def test_divergence_is_an_error_and_not_a_silent_reset(standing):
    backend, command = standing()
    backend.data.qvel[3] = np.inf
    with pytest.raises(BackendError, match="reset"):
        backend.write(command)
    backend.reset()
    backend.write(command)


def test_a_closed_backend_and_wrong_names_are_refused(standing):
    backend, command = standing()
    with pytest.raises(ValueError, match=r"free.*door"):
        backend.set_scene("kitchen")
    with pytest.raises(ValueError, match="stand"):
        backend.reset(keyframe="fly")
    assert backend.scene == "free"
    backend.close()
    with pytest.raises(BackendError, match=r"open\(\)"):
        backend.write(command)
