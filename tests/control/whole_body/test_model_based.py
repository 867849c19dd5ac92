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
    NOMINAL_BASE_HEIGHT_M,
    NOMINAL_POSITION,
    STIFFNESS,
    TORQUE_LIMIT,
    WHEEL_RADIUS_M,
    WHEEL_SLICE,
)
from control.kernels.records import packed
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.timing import CONTROL_PERIOD_S, TICK_S
from control.types import BaseState, SensorFrame
from control.whole_body.arm import ArmConfig
from control.whole_body.body_terms import BODY_TERMS, body_terms
from control.whole_body.controller import ControllerInput
from control.whole_body.legs import LEGS, LegConfig, ground_forces
from control.whole_body.model_based import ModelBasedConfig, ModelBasedController, ModelBasedLaw
from control.whole_body.reference_correction import CORRECTION, NO_CORRECTION
from control.whole_body.task_memory import TaskMemory, TaskMemoryConfig
from control.whole_body.task_signals import TASK_SIGNALS, task_signals
from control.whole_body.wheels import WHEEL_STATE, WHEELS, WheelConfig, wheel_targets
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.simulation.wrenches import Spring
from sim.runtime.simulation import Simulation

LATERAL = np.array([0.18, -0.18, 0.18, -0.18])


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


class Law:
    """The law of the whole body with its memory, tick by tick."""

    def __init__(self, model, config=None):
        self.law, self.memory = ModelBasedLaw(model, config or ModelBasedConfig()), TaskMemory(TaskMemoryConfig())

    def arm_torque(self, tick, correction=NO_CORRECTION):
        signals = task_signals(tick)
        self.memory.step(signals)
        targets = self.law.targets(body_terms(tick.model), signals, self.memory.values, correction)[0, ARM_SLICE]
        q, dq = tick.sensor.joint_position[ARM_SLICE], tick.sensor.joint_velocity[ARM_SLICE]
        return STIFFNESS[ARM_SLICE] * (targets - q) - DAMPING[ARM_SLICE] * dq


def arm_torque(tick):
    """Of a controller's first tick."""
    law = Law(RobotModel())
    return law.arm_torque(tick)


def correction_of(**parts):
    correction = np.zeros(1, CORRECTION)
    for name, value in parts.items():
        correction[name] = value
    return correction


@pytest.mark.parametrize("tilt", [0.0, 0.2, -0.2])
def test_an_arm_at_its_target_carries_its_weight_and_nothing_else(model, tilt):
    tick = inputs(model, tilt=tilt)
    tick = replace(tick, command=hand_command(tick))
    assert np.allclose(arm_torque(tick), model.gravity[model.joint_rows[ARM_SLICE]], atol=1e-9)


def test_an_arm_and_legs_of_other_estimated_masses_carry_those(model):
    tick = inputs(model)
    tick = replace(tick, command=hand_command(tick), mass_scales=np.array([1.2, 0.9]))
    assert np.allclose(arm_torque(tick), 1.2 * model.gravity[model.joint_rows[ARM_SLICE]], atol=1e-9)
    forces = np.empty((4, 3))
    ground_forces(packed(LEGS, LegConfig())[0], body_terms(model)[0], task_signals(tick)[0], np.zeros(3), forces)
    weight = (1.2 * model.arm_mass + 0.9 * (model.total_mass - model.arm_mass)) * GRAVITY_MPS2
    assert forces[:, 2].sum() == pytest.approx(weight)


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
    pressed = 10.0 * mask
    tick = replace(tick, command=hand_command(tick, mask=mask, force_n=pressed), force_estimated_n=pressed)
    velocity, force, turn = np.array([0.03, -0.02, 0.04]), np.array([5.0, 4.0, -3.0]), np.array([0.1, -0.05, 0.08])
    config = replace(ArmConfig(), damping=1e-6)
    plain, corrected = (Law(RobotModel(), ModelBasedConfig(arm=config)) for _ in range(2))
    correction = correction_of(hand_velocity=velocity, hand_force=force, hand_angular_velocity=turn)
    added = corrected.arm_torque(tick, correction) - plain.arm_torque(tick)
    rows = model.joint_rows[ARM_SLICE]
    jacobian, inertia = model.end_effector_jacobian[:, rows], model.mass_matrix[np.ix_(rows, rows)]
    added -= jacobian[:3].T @ (mask * force)
    joint_velocity = np.linalg.solve(config.velocity_gain * inertia + np.diag(DAMPING[ARM_SLICE]), added)
    assert np.allclose(jacobian @ joint_velocity, np.concatenate([(1.0 - mask) * velocity, turn]), atol=1e-6)


def test_a_force_axis_pushes_harder_while_the_estimate_is_too_low(model):
    tick = inputs(model)
    command = hand_command(tick, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 10.0]))
    law = Law(RobotModel())
    low = replace(tick, command=command, force_estimated_n=np.array([0.0, 0.0, 4.0]))
    jacobian = model.end_effector_jacobian[2, model.joint_rows[ARM_SLICE]]
    first = law.arm_torque(low)
    assert (first - model.gravity[model.joint_rows[ARM_SLICE]]) @ jacobian < 0.0
    later = first
    for _ in range(20):
        later = law.arm_torque(low)
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


def balance(tick, hand_force=(0.0, 0.0, 0.0)):
    legs, forces = packed(LEGS, LegConfig(), total_mass=tick.model.total_mass), np.empty((4, 3))
    ground_forces(legs[0], body_terms(tick.model)[0], task_signals(tick)[0], np.array(hand_force), forces)
    return forces


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (20.0, -10.0, 0.0), (0.0, 15.0, -20.0)])
def test_ground_forces_balance_weight_and_hand_force(model, force):
    ground = balance(inputs(model), force)
    weight = np.array([0.0, 0.0, -model.total_mass * GRAVITY_MPS2])
    assert np.allclose(ground.sum(axis=0) + force + weight, 0.0, atol=1e-8)
    moment = skew(model.end_effector_position - model.center_of_mass) @ np.array(force)
    for position, contact_force in zip(model.wheel_contact_positions, ground, strict=True):
        moment = moment + skew(position - model.center_of_mass) @ contact_force
    assert np.allclose(moment, 0.0, atol=1e-8)


def test_no_other_ground_forces_that_balance_are_smaller(model):
    ground = balance(inputs(model, tilt=0.1), (20.0, -10.0, 5.0))
    grasp = np.concatenate([np.concatenate([np.eye(3), skew(r)]) for r in model.wheel_contact_positions], axis=1)
    smallest = np.linalg.pinv(grasp) @ (grasp @ ground.reshape(12))
    assert np.allclose(ground.reshape(12), smallest, atol=1e-8)


def test_a_pitched_trunk_gets_a_restoring_moment(model):
    gain = (balance(inputs(model, tilt=0.1)) - balance(inputs(model)))[:, 2]
    front, rear = slice(0, 2), slice(2, 4)
    assert gain[front].sum() > gain[rear].sum()


def test_rolling_wheels_tell_the_base_velocity(model):
    velocity = np.zeros(JOINT_COUNT)
    velocity[WHEEL_SLICE] = 0.4 / WHEEL_RADIUS_M
    model.update(np.eye(3), NOMINAL_POSITION, np.array([9.0, 9.0, 9.0]), np.zeros(3), velocity)
    assert np.allclose(rolling_velocity(model), [0.4, 0.0, 0.0], atol=1e-9)


class Wheels:
    """The wheels' law with its memory and state; contacts at LATERAL, evenly loaded unless told otherwise."""

    def __init__(self, model):
        self.gains = packed(
            WHEELS,
            WheelConfig(),
            joint_damping=model.joint_damping[WHEEL_SLICE],
            joint_friction=model.joint_friction[WHEEL_SLICE],
        )
        self.terms, self.state = np.zeros(1, BODY_TERMS), np.zeros(1, WHEEL_STATE)
        self.terms["rotation_heading_to_world"] = np.eye(3)
        self.terms["contacts"][0, :, 1] = LATERAL
        self.memory = TaskMemory(TaskMemoryConfig())

    def step(self, signals, support=1.0, correction=NO_CORRECTION):
        self.memory.step(signals)
        out, memory = np.empty(4), self.memory.values[0]
        now = self.terms[0], signals[0], memory, correction[0]
        wheel_targets(self.gains[0], *now, np.zeros(4), support, 0.0, self.state[0], out)
        return out


def driving(forward=0.0, yaw=0.0, torque=0.0, wheel_angle=0.0):
    signals = np.zeros(1, TASK_SIGNALS)
    signals["command"]["base_velocity"] = (forward, 0.0, yaw)
    signals["joint_position"][0, WHEEL_SLICE] = wheel_angle
    signals["joint_torque"][0, 4] = torque
    return signals


SATURATED = -HardwareLimits().torque_fraction * TORQUE_LIMIT[4]
"""Torque of a thigh for which the drives of a robot would damp, were it to last."""


def test_wheels_roll_at_the_commanded_speed_plus_what_their_drag_needs(model):
    targets = Wheels(model).step(driving(forward=0.43))
    rolling = 0.43 / WHEEL_RADIUS_M
    drag = model.joint_damping[WHEEL_SLICE] * rolling + model.joint_friction[WHEEL_SLICE]
    assert np.allclose(targets, rolling + drag / DAMPING[WHEEL_SLICE], rtol=1e-3)


def test_turning_left_drives_the_right_wheels_ahead_and_builds_up_against_scrub(model):
    wheels = Wheels(model)
    first = wheels.step(driving(yaw=0.4))
    assert np.all(first[[1, 3]] > 0.0)
    assert np.all(first[[0, 2]] < 0.0)
    second = wheels.step(driving(yaw=0.4))
    assert np.all(np.abs(second) > np.abs(first))


def test_the_turn_is_given_up_while_a_leg_is_saturated_and_taken_up_again(model):
    wheels = Wheels(model)
    free = wheels.step(driving(yaw=0.4))
    relieved = wheels.step(driving(yaw=0.4, torque=SATURATED))
    assert np.allclose(relieved, 0.0, atol=1e-9)
    for _ in range(round(WheelConfig().relief_time_s / CONTROL_PERIOD_S) + 1):
        relieved = wheels.step(driving(yaw=0.4))
    assert np.all(np.abs(relieved) > np.abs(free))


def base_correction(forward, turn):
    return correction_of(base_velocity=(forward, turn))


def test_a_correction_of_the_base_drives_on_and_turns_unless_the_legs_cannot_bear_it(model):
    plain = Wheels(model).step(driving(forward=0.4))
    faster = Wheels(model).step(driving(forward=0.3), correction=base_correction(0.1, 0.0))
    assert np.allclose(faster, plain, atol=1e-9)

    turning = Wheels(model).step(driving(forward=0.4), correction=base_correction(0.0, 0.2)) - plain
    drag = 1.0 + model.joint_damping[WHEEL_SLICE] / DAMPING[WHEEL_SLICE]
    assert np.allclose(turning, -0.2 * LATERAL / WHEEL_RADIUS_M * drag, rtol=1e-3)

    relieved = Wheels(model).step(driving(forward=0.4, torque=SATURATED), correction=base_correction(0.0, 0.2))
    assert np.allclose(relieved, plain, atol=1e-9)


def test_a_correction_of_the_base_leaves_standing_wheels_alone(model):
    assert np.allclose(Wheels(model).step(driving(), correction=base_correction(0.1, 0.2)), 0.0)


def test_the_turn_is_given_up_as_a_wheel_is_about_to_lift(model):
    turns = []
    for support in (1.0, 0.15, -0.1):
        targets = Wheels(model).step(driving(yaw=0.4), support)
        turns.append(targets[1] - targets[0])
    assert turns[0] > 1.5 * turns[1] > 0.0
    assert turns[2] == pytest.approx(0.0, abs=1e-9)


def test_standing_wheels_hold_their_angle(model):
    wheels = Wheels(model)
    assert np.allclose(wheels.step(driving()), 0.0)
    assert np.all(wheels.step(driving(wheel_angle=0.1)) < 0.0)


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
