"""The model-based controller: balance laws of its parts, and the whole in closed loop on noisy sensors."""

from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND, CommandLimits
from control.estimation.rolling_contact import rolling_velocity
from control.frames import quaternion_from_rotation, rotation_heading_to_world, skew
from control.joints import (
    ARM_SLICE,
    DAMPING,
    JOINT_COUNT,
    LEG_SLICE,
    NOMINAL_BASE_HEIGHT_M,
    NOMINAL_POSITION,
    STIFFNESS,
    TORQUE_LIMIT,
    WHEEL_RADIUS_M,
    WHEEL_SLICE,
)
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.timing import CONTROL_PERIOD_S, TICK_S
from control.types import BaseState, SensorFrame
from control.whole_body.arm import ArmConfig, ArmControl
from control.whole_body.controller import ControllerInput
from control.whole_body.legs import LegConfig, LegControl, LegTargets
from control.whole_body.model_based import ModelBasedController
from control.whole_body.reference_correction import NO_CORRECTION, ReferenceCorrection
from control.whole_body.stance import Stance, StanceConfig
from control.whole_body.wheels import WheelConfig, WheelControl
from sim.backends.simulation.wrenches import Spring
from sim.runtime.simulation import Simulation

LATERAL = np.array([0.18, -0.18, 0.18, -0.18])
EVEN = LegTargets(NOMINAL_POSITION[LEG_SLICE], np.zeros(4), 1.0)


@pytest.fixture
def model():
    return RobotModel()


def inputs(model, command=DEFAULT_COMMAND, force=(0.0, 0.0, 0.0), tilt=0.0, joint_velocity=None, torque=None):
    """A robot in its nominal posture, pitched by `tilt` rad about its base."""
    c, s = np.cos(tilt), np.sin(tilt)
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    zero = np.zeros(JOINT_COUNT)
    velocity = zero if joint_velocity is None else joint_velocity
    sensor = SensorFrame(
        0.0,
        quaternion_from_rotation(rotation),
        np.zeros(3),
        np.zeros(3),
        NOMINAL_POSITION,
        velocity,
        zero if torque is None else torque,
    )
    base = BaseState(rotation, np.zeros(3), np.zeros(3), NOMINAL_BASE_HEIGHT_M)
    model.update(rotation, NOMINAL_POSITION, np.zeros(3), np.zeros(3), velocity)
    return ControllerInput(sensor, base, model, command, np.array(force))


def hand_command(tick, **changes):
    """A command whose hand is exactly where the tick measures it."""
    heading = rotation_heading_to_world(tick.base.rotation_base_to_world)
    position = heading.T @ tick.model.end_effector_position + [0.0, 0.0, NOMINAL_BASE_HEIGHT_M]
    orientation = quaternion_from_rotation(heading.T @ tick.model.end_effector_rotation)
    return replace(DEFAULT_COMMAND, position_m=position, orientation_wxyz=orientation, **changes)


def arm_control(model, config=None):
    return ArmControl(config or ArmConfig(), model.position_lower[ARM_SLICE], model.position_upper[ARM_SLICE], CommandLimits())


def arm_torque(tick, arm=None, correction=NO_CORRECTION):
    arm = arm or arm_control(tick.model)
    targets = arm.step(tick, rotation_heading_to_world(tick.base.rotation_base_to_world), arm.on_force(tick), correction)
    q, dq = tick.sensor.joint_position[ARM_SLICE], tick.sensor.joint_velocity[ARM_SLICE]
    return STIFFNESS[ARM_SLICE] * (targets - q) - DAMPING[ARM_SLICE] * dq


@pytest.mark.parametrize("tilt", [0.0, 0.2, -0.2])
def test_an_arm_at_its_target_carries_its_weight_and_nothing_else(model, tilt):
    tick = inputs(model, tilt=tilt)
    tick = replace(tick, command=hand_command(tick))
    assert np.allclose(arm_torque(tick), model.gravity[model.joint_rows[ARM_SLICE]], atol=1e-9)


def test_a_commanded_force_is_fed_forward_through_the_jacobian(model):
    tick = inputs(model)
    rest = arm_torque(replace(tick, command=hand_command(tick)))
    force = np.array([6.0, -4.0, 15.0])
    pressing = replace(tick, command=hand_command(tick, mask=np.ones(3), force_n=force), force_estimated_n=force)
    jacobian = model.end_effector_jacobian[:3, model.joint_rows[ARM_SLICE]]
    assert np.allclose(arm_torque(pressing) - rest, -jacobian.T @ force, atol=1e-9)


def test_a_correction_moves_position_axes_presses_force_axes_and_turns_the_hand(model):
    tick = inputs(model)
    mask = np.array([0.0, 0.0, 1.0])
    tick = replace(tick, command=hand_command(tick, mask=mask))
    velocity, force, turn = np.array([0.03, -0.02, 0.04]), np.array([5.0, 4.0, -3.0]), np.array([0.1, -0.05, 0.08])
    config = replace(ArmConfig(), damping=1e-6)
    plain, corrected = arm_control(model, config), arm_control(model, config)
    added = arm_torque(tick, corrected, ReferenceCorrection(velocity, force, turn, np.zeros(2))) - arm_torque(tick, plain)
    rows = model.joint_rows[ARM_SLICE]
    jacobian, inertia = model.end_effector_jacobian[:, rows], model.mass_matrix[np.ix_(rows, rows)]
    added -= jacobian[:3].T @ (mask * force)
    joint_velocity = np.linalg.solve(config.velocity_gain * inertia + np.diag(DAMPING[ARM_SLICE]), added)
    assert np.allclose(jacobian @ joint_velocity, np.concatenate([(1.0 - mask) * velocity, turn]), atol=1e-6)


def test_a_force_axis_pushes_harder_while_the_estimate_is_too_low(model):
    tick = inputs(model)
    command = hand_command(tick, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 10.0]))
    arm = arm_control(model)
    low = replace(tick, command=command, force_estimated_n=np.array([0.0, 0.0, 4.0]))
    jacobian = model.end_effector_jacobian[2, model.joint_rows[ARM_SLICE]]
    first = arm_torque(low, arm)
    assert (first - model.gravity[model.joint_rows[ARM_SLICE]]) @ jacobian < 0.0
    later = first
    for _ in range(20):
        later = arm_torque(low, arm)
    assert (later - first) @ jacobian < 0.0


def test_before_contact_a_force_axis_approaches_instead_of_pushing(model):
    tick = inputs(model)
    command = hand_command(tick, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 20.0]))
    rows = model.joint_rows[ARM_SLICE]
    inertia = model.mass_matrix[np.ix_(rows, rows)]
    change = arm_torque(replace(tick, command=command)) - model.gravity[rows]
    # Where the torque would take the hand from rest: down, and neither ahead nor aside as a bare J^T F would.
    config = ArmConfig()
    asked = np.linalg.solve(config.velocity_gain * inertia + np.diag(DAMPING[ARM_SLICE]), change)
    hand_velocity = model.end_effector_jacobian[:3, rows] @ asked
    assert hand_velocity == pytest.approx([0.0, 0.0, -config.approach_speed_limit_mps], abs=0.05)


@pytest.mark.slow
def test_in_closed_loop_a_force_that_meets_nothing_leaves_the_hand_at_the_border_of_the_workspace():
    session = Simulation()
    run(session, replace(DEFAULT_COMMAND, mask=np.array([0.0, 1.0, 0.0]), force_n=np.array([0.0, -20.0, 0.0])), 3.0)
    hand = true_hand_in_heading(session)
    assert hand[1] == pytest.approx(CommandLimits().position_y_m[1], abs=0.03)
    assert np.linalg.norm((hand - DEFAULT_COMMAND.position_m)[[0, 2]]) < 0.02


def test_a_position_axis_carries_most_of_an_estimated_load(model):
    tick = inputs(model)
    tick = replace(tick, command=hand_command(tick))
    load = np.array([5.0, 0.0, -5.0])
    change = arm_torque(replace(tick, force_estimated_n=load)) - arm_torque(tick)
    jacobian = model.end_effector_jacobian[:3, model.joint_rows[ARM_SLICE]]
    assert np.allclose(change, -ArmConfig().load_gain * jacobian.T @ load, atol=1e-9)


def test_a_hand_error_is_approached_at_a_limited_speed(model):
    tick = inputs(model)
    far = hand_command(tick)
    far = replace(far, position_m=far.position_m + np.array([0.0, 2.0, 0.0]))
    torque = arm_torque(replace(tick, command=far))
    assert np.all(np.abs(torque) <= TORQUE_LIMIT[ARM_SLICE])
    assert np.abs(torque - model.gravity[model.joint_rows[ARM_SLICE]]).max() < 20.0


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (20.0, -10.0, 0.0), (0.0, 15.0, -20.0)])
def test_ground_forces_balance_weight_and_hand_force(model, force):
    tick = inputs(model)
    legs = LegControl(LegConfig(), Stance(StanceConfig(), model))
    tick = inputs(model)
    ground = legs.ground_forces(tick, np.eye(3), np.array(force))
    weight = np.array([0.0, 0.0, -model.total_mass * GRAVITY_MPS2])
    assert np.allclose(ground.sum(axis=0) + force + weight, 0.0, atol=1e-8)
    moment = skew(model.end_effector_position - model.center_of_mass) @ np.array(force)
    for position, contact_force in zip(model.wheel_contact_positions, ground, strict=True):
        moment = moment + skew(position - model.center_of_mass) @ contact_force
    assert np.allclose(moment, 0.0, atol=1e-8)


def test_a_pitched_trunk_gets_a_restoring_moment(model):
    legs = LegControl(LegConfig(), Stance(StanceConfig(), model))
    level = legs.ground_forces(inputs(model), np.eye(3), np.zeros(3))
    nose_down = legs.ground_forces(inputs(model, tilt=0.1), np.eye(3), np.zeros(3))
    front, rear = slice(0, 2), slice(2, 4)
    gain = (nose_down - level)[:, 2]
    assert gain[front].sum() > gain[rear].sum()


def test_the_stance_follows_the_centre_of_pressure_and_its_legs_put_the_wheels_there(model):
    config = StanceConfig(return_gain=0.0)
    stance = Stance(config, model)
    model.update_configuration(np.eye(3), NOMINAL_POSITION)
    nominal = model.wheel_contact_positions.copy()
    front_loaded = np.array([100.0, 100.0, 10.0, 10.0])
    legs = NOMINAL_POSITION[LEG_SLICE]
    for _ in range(200):
        legs = stance.step(front_loaded, nominal)
    posture = NOMINAL_POSITION.copy()
    posture[LEG_SLICE] = legs
    model.update_configuration(np.eye(3), posture)
    moved = model.wheel_contact_positions - nominal
    assert np.allclose(moved[:, 0], config.limit_m, atol=6e-3)
    assert np.allclose(moved[:, 1], 0.0, atol=1e-3)
    assert np.allclose(stance.shift_velocity, 0.0)


def test_the_stance_leaves_small_offsets_alone(model):
    stance = Stance(StanceConfig(), model)
    model.update_configuration(np.eye(3), NOMINAL_POSITION)
    contacts = model.wheel_contact_positions
    legs = stance.step(np.array([62.0, 62.0, 55.0, 55.0]), contacts)
    assert np.allclose(legs, NOMINAL_POSITION[LEG_SLICE])


def test_rolling_wheels_tell_the_base_velocity(model):
    velocity = np.zeros(JOINT_COUNT)
    velocity[WHEEL_SLICE] = 0.4 / WHEEL_RADIUS_M
    model.update(np.eye(3), NOMINAL_POSITION, np.array([9.0, 9.0, 9.0]), np.zeros(3), velocity)
    assert np.allclose(rolling_velocity(model), [0.4, 0.0, 0.0], atol=1e-9)


def wheels(model):
    return WheelControl(WheelConfig(), model.joint_damping[WHEEL_SLICE], model.joint_friction[WHEEL_SLICE])


def driving(model, forward=0.0, yaw=0.0, **options):
    return inputs(model, replace(DEFAULT_COMMAND, base_velocity=np.array([forward, 0.0, yaw])), **options)


def test_wheels_roll_at_the_commanded_speed_plus_what_their_drag_needs(model):
    targets = wheels(model).step(driving(model, forward=0.43), LATERAL, EVEN, 0.0)
    rolling = 0.43 / WHEEL_RADIUS_M
    drag = model.joint_damping[WHEEL_SLICE] * rolling + model.joint_friction[WHEEL_SLICE]
    assert np.allclose(targets, rolling + drag / DAMPING[WHEEL_SLICE], rtol=1e-3)


def test_turning_left_drives_the_right_wheels_ahead_and_builds_up_against_scrub(model):
    wheel_control = wheels(model)
    first = wheel_control.step(driving(model, yaw=0.4), LATERAL, EVEN, 0.0)
    assert np.all(first[[1, 3]] > 0.0)
    assert np.all(first[[0, 2]] < 0.0)
    second = wheel_control.step(driving(model, yaw=0.4), LATERAL, EVEN, 0.0)
    assert np.all(np.abs(second) > np.abs(first))


def test_the_turn_is_given_up_while_a_leg_is_saturated_and_taken_up_again(model):
    wheel_control = wheels(model)
    free = wheel_control.step(driving(model, yaw=0.4), LATERAL, EVEN, 0.0)
    torque = np.zeros(JOINT_COUNT)
    torque[4] = -1.1 * TORQUE_LIMIT[4]
    relieved = wheel_control.step(driving(model, yaw=0.4, torque=torque), LATERAL, EVEN, 0.0)
    assert np.allclose(relieved, 0.0, atol=1e-9)
    for _ in range(round(WheelConfig().relief_time_s / CONTROL_PERIOD_S) + 1):
        relieved = wheel_control.step(driving(model, yaw=0.4), LATERAL, EVEN, 0.0)
    assert np.all(np.abs(relieved) > np.abs(free))


def base_correction(forward, turn):
    return replace(NO_CORRECTION, base_velocity=np.array([forward, turn]))


def test_a_correction_of_the_base_drives_on_and_turns_unless_the_legs_cannot_bear_it(model):
    plain = wheels(model).step(driving(model, forward=0.4), LATERAL, EVEN, 0.0)
    faster = wheels(model).step(driving(model, forward=0.3), LATERAL, EVEN, 0.0, base_correction(0.1, 0.0))
    assert np.allclose(faster, plain, atol=1e-9)

    turning = wheels(model).step(driving(model, forward=0.4), LATERAL, EVEN, 0.0, base_correction(0.0, 0.2)) - plain
    drag = 1.0 + model.joint_damping[WHEEL_SLICE] / DAMPING[WHEEL_SLICE]
    assert np.allclose(turning, -0.2 * LATERAL / WHEEL_RADIUS_M * drag, rtol=1e-3)

    torque = np.zeros(JOINT_COUNT)
    torque[4] = -1.1 * TORQUE_LIMIT[4]
    saturated = driving(model, forward=0.4, torque=torque)
    relieved = wheels(model).step(saturated, LATERAL, EVEN, 0.0, base_correction(0.0, 0.2))
    assert np.allclose(relieved, plain, atol=1e-9)


def test_a_correction_of_the_base_leaves_standing_wheels_alone(model):
    assert np.allclose(wheels(model).step(driving(model), LATERAL, EVEN, 0.0, base_correction(0.1, 0.2)), 0.0)


def test_the_turn_is_given_up_as_a_wheel_is_about_to_lift(model):
    turns = []
    for support in (1.0, 0.15, -0.1):
        targets = wheels(model).step(driving(model, yaw=0.4), LATERAL, replace(EVEN, support=support), 0.0)
        turns.append(targets[1] - targets[0])
    assert turns[0] > 1.5 * turns[1] > 0.0
    assert turns[2] == pytest.approx(0.0, abs=1e-9)


def test_standing_wheels_hold_their_angle(model):
    wheel_control = wheels(model)
    tick = driving(model)
    assert np.allclose(wheel_control.step(tick, LATERAL, EVEN, 0.0), 0.0)
    moved = NOMINAL_POSITION.copy()
    moved[WHEEL_SLICE] += 0.1
    tick = replace(tick, sensor=replace(tick.sensor, joint_position=moved))
    assert np.all(wheel_control.step(tick, LATERAL, EVEN, 0.0) < 0.0)


def test_targets_are_a_fresh_array_and_repeat_after_reset(model):
    controller = ModelBasedController(model)
    tick = inputs(model, replace(DEFAULT_COMMAND, base_velocity=np.array([0.2, 0.0, 0.2])), force=(2.0, 1.0, 0.0))
    first = controller.step(tick)
    second = controller.step(tick)
    assert first.shape == (JOINT_COUNT,)
    assert first is not second
    controller.reset()
    assert np.array_equal(controller.step(tick), first)


def run(session, command, seconds):
    for _ in range(round(seconds / TICK_S)):
        session.tick(command)


def true_state(session):
    truth = session.truth()
    return truth


def true_hand_in_heading(session):
    truth = true_state(session)
    return (truth.end_effector_position - truth.base_position * [1.0, 1.0, 0.0]) @ truth.rotation_heading_to_world


@pytest.mark.slow
def test_in_closed_loop_the_hand_settles_and_a_spring_is_pressed_with_the_commanded_force():
    session = Simulation()
    target = replace(DEFAULT_COMMAND, position_m=np.array([0.5, 0.12, 0.5]))
    run(session, target, 2.0)
    assert np.linalg.norm(true_hand_in_heading(session) - target.position_m) < 0.015

    anchor = true_state(session).end_effector_position
    session.backend.wrenches.add(Spring(anchor, np.array([0.0, 0.0, 400.0]), np.array([0.0, 0.0, 8.0])))
    pressing = replace(target, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 15.0]))
    run(session, pressing, 2.0)
    assert true_state(session).force_true_n[2] == pytest.approx(15.0, abs=2.0)
    error = true_hand_in_heading(session) - target.position_m
    assert np.linalg.norm(error[:2]) < 0.015


@pytest.mark.slow
def test_in_closed_loop_the_robot_drives_and_turns_and_stops():
    session = Simulation()
    run(session, replace(DEFAULT_COMMAND, base_velocity=np.array([0.4, 0.0, 0.3])), 2.5)
    truth = true_state(session)
    forward = truth.base_linear_velocity @ truth.rotation_heading_to_world[:, 0]
    assert forward == pytest.approx(0.4, abs=0.08)
    # Skid steering scrubs: with four wheels of fixed heading some of the turn is lost.
    assert 0.15 < truth.base_angular_velocity[2] < 0.35
    run(session, DEFAULT_COMMAND, 1.2)
    assert np.linalg.norm(true_state(session).base_linear_velocity[:2]) < 0.05


@pytest.mark.slow
def test_in_closed_loop_the_robot_stands_up_again_after_the_e_stop():
    session = Simulation()
    run(session, DEFAULT_COMMAND, 0.4)
    session.estop()
    run(session, DEFAULT_COMMAND, 0.7)
    assert true_state(session).base_position[2] < 0.25
    session.clear_estop()
    run(session, DEFAULT_COMMAND, 3.5)
    assert true_state(session).base_position[2] == pytest.approx(NOMINAL_BASE_HEIGHT_M, abs=0.01)
    assert np.linalg.norm(true_hand_in_heading(session) - DEFAULT_COMMAND.position_m) < 0.03
