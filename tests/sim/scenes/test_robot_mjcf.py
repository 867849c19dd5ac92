"""The robot's MJCF: agrees with control.joints, does not touch itself, and its ellipsoid wheels roll and tilt."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from control.frames import rotation_heading_to_world
from control.joints import (
    ARM_JOINT_NAMES,
    DAMPING,
    JOINT_NAMES,
    LEGS,
    NOMINAL_POSITION,
    STIFFNESS,
    TORQUE_LIMIT,
    WHEEL_CENTER_FRAMES,
    WHEEL_FRICTION,
    WHEEL_HALF_WIDTH_M,
    WHEEL_JOINT_NAMES,
    WHEEL_RADIUS_M,
)
from control.paths import ROBOT_MJCF
from control.timing import TICK_S
from sim import scenes
from sim.backends.simulation.ground_truth import GroundTruthReader
from sim.backends.simulation.wrenches import Pulse


@pytest.fixture(scope="module")
def robot() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(ROBOT_MJCF))


def test_gains_and_limits_of_the_actuators_are_those_of_control_joints(robot):
    for index, name in enumerate(JOINT_NAMES):
        actuator = robot.actuator(name)
        assert robot.joint(actuator.trnid[0]).name == name
        assert -actuator.biasprm[1] == STIFFNESS[index]
        assert -actuator.biasprm[2] == DAMPING[index]
        assert actuator.gainprm[0] == (DAMPING[index] if name in WHEEL_JOINT_NAMES else STIFFNESS[index])
        np.testing.assert_array_equal(actuator.forcerange, [-TORQUE_LIMIT[index], TORQUE_LIMIT[index]])
    assert robot.nu == len(JOINT_NAMES)


def test_wheels_are_ellipsoids_of_the_stated_size_and_alone_set_the_ground_friction(robot):
    for leg, frame in zip(LEGS, WHEEL_CENTER_FRAMES, strict=True):
        geom = robot.geom(f"{leg}_wheel")
        assert geom.type[0] == mujoco.mjtGeom.mjGEOM_ELLIPSOID
        np.testing.assert_array_equal(geom.size, [WHEEL_RADIUS_M, WHEEL_HALF_WIDTH_M, WHEEL_RADIUS_M])
        np.testing.assert_array_equal(geom.pos, robot.site(frame).pos)
        assert geom.priority[0] == 1
        assert geom.friction[0] == WHEEL_FRICTION


def test_nominal_posture_is_within_joint_limits_and_level(robot, standing):
    for name, angle in zip(JOINT_NAMES, NOMINAL_POSITION, strict=True):
        joint = robot.joint(name)
        assert not joint.limited[0] or joint.range[0] < angle < joint.range[1]
    backend, _ = standing()
    np.testing.assert_allclose(backend.truth().wheel_contact_positions[:, 2], 0.0, atol=2e-3)


@pytest.mark.slow
def test_reachable_arm_poses_do_not_touch_the_robot():
    """Permanent self-contact would push with forces that no estimator models; real collisions (head, trunk) are rare."""
    model = scenes.build("free").model
    data = mujoco.MjData(model)
    data.qpos[[model.joint(name).qposadr[0] for name in JOINT_NAMES]] = NOMINAL_POSITION
    data.qpos[2] = 0.357
    arm = [model.joint(name) for name in ARM_JOINT_NAMES]
    columns = [joint.qposadr[0] for joint in arm]
    low, high = np.array([joint.range for joint in arm]).T
    random = np.random.default_rng(0)
    floor = model.geom("floor").id
    poses = touching = 0
    while poses < 2000:
        data.qpos[columns] = random.uniform(low, high)
        mujoco.mj_kinematics(model, data)
        x, y, z = data.site("end_effector").xpos
        if not (0.42 < x < 0.72 and abs(y) < 0.25 and 0.25 < z < 0.75):
            continue
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        poses += 1
        touching += bool((data.contact.geom != floor).all(1).any())
    assert touching / poses < 0.01


def test_support_point_of_a_tilted_wheel_is_its_lowest_point():
    """Closed form against a search over the ellipsoid's surface and against MuJoCo's own contact."""
    scene = scenes.build("free")
    model = scene.model
    data = mujoco.MjData(model)
    reader = GroundTruthReader(model, data, scene.robot_bodies, ())
    random = np.random.default_rng(1)
    angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, 721), np.linspace(-1, 1, 401))
    ring = np.sqrt(1 - height**2)
    half_axes = np.array([WHEEL_RADIUS_M, WHEEL_HALF_WIDTH_M, WHEEL_RADIUS_M])
    surface = half_axes * np.stack([ring * np.cos(angle), height, ring * np.sin(angle)], axis=-1).reshape(-1, 3)
    wheel = model.geom("FL_wheel").id
    for roll in random.uniform(-0.6, 0.6, 5):
        data.qpos[:] = 0.0
        data.qpos[2] = 1.0
        data.qpos[3:7] = [np.cos(roll / 2), np.sin(roll / 2), 0, 0]
        data.qpos[[model.joint(name).qposadr[0] for name in JOINT_NAMES]] = NOMINAL_POSITION
        mujoco.mj_kinematics(model, data)
        lowest = reader.lowest_wheel_points()[0]
        points = data.geom_xpos[wheel] + surface @ data.geom_xmat[wheel].reshape(3, 3).T
        assert abs(lowest[2] - points[:, 2].min()) < 2e-5
        np.testing.assert_allclose(lowest, points[points[:, 2].argmin()], atol=2e-3)
        data.qpos[2] -= lowest[2] + 5e-4
        mujoco.mj_forward(model, data)
        contacts = [contact.pos for contact in data.contact if wheel in contact.geom]
        np.testing.assert_allclose(contacts[0][:2], reader.lowest_wheel_points()[0][:2], atol=1e-3)


@pytest.mark.parametrize("speed", [3.0, -6.0])
def test_base_rolls_at_wheel_speed_times_radius(standing, speed):
    """With stiff legs, so that wheel angles are not mixed with the sway of the body."""
    backend, command = standing()
    wheels = np.isin(JOINT_NAMES, WHEEL_JOINT_NAMES)
    stiff = replace(command, stiffness=10 * STIFFNESS, damping=np.where(wheels, 30.0, 10.0))
    columns = [backend.model.joint(name).qposadr[0] for name in WHEEL_JOINT_NAMES]
    for tick in range(1000):
        backend.write(replace(stiff, velocity=np.where(wheels, speed * min(tick / 400, 1.0), 0.0)))
    start, angle = backend.truth().base_position[0], backend.data.qpos[columns].copy()
    for _ in range(500):
        backend.write(replace(stiff, velocity=np.where(wheels, speed, 0.0)))
    moved = backend.truth().base_position[0] - start
    np.testing.assert_allclose(moved, (backend.data.qpos[columns] - angle) * WHEEL_RADIUS_M, rtol=0.01)
    np.testing.assert_allclose(moved, speed * WHEEL_RADIUS_M, rtol=0.02)


def test_force_reference_at_the_end_effector_reads_the_applied_force(standing):
    """In the site's axes it reads what the mount exerts on the tool: less of the applied force, plus the tool's weight."""
    backend, command = standing()
    readings = []
    for force in (np.zeros(3), np.array([3.0, -4.0, 6.0])):
        backend.wrenches.add(Pulse(force, duration_s=3.0, frame="world", ramp_s=0.5))
        for _ in range(1000):
            backend.write(command)
        rotation = backend.data.site("end_effector").xmat.reshape(3, 3)
        readings.append(rotation @ backend.data.sensor("end_effector_force_reference").data)
        backend.wrenches.clear()
    np.testing.assert_allclose(readings[0] - readings[1], [3.0, -4.0, 6.0], atol=0.1)
    heading = rotation_heading_to_world(backend.data.body("base").xmat.reshape(3, 3))
    np.testing.assert_allclose(heading @ backend.truth().force_true_n, [3.0, -4.0, 6.0], atol=1e-2)


def test_the_simulation_steps_once_per_tick(robot):
    assert robot.opt.timestep == TICK_S
