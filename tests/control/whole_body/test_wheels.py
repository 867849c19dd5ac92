"""The wheels' law: driving, turning and standing."""

import numpy as np
import pytest

from control.estimation.rolling_contact import rolling_velocity
from control.joints import DAMPING, JOINT_COUNT, NOMINAL_POSITION, TORQUE_LIMIT, WHEEL_RADIUS_M, WHEEL_SLICE
from control.kernels.records import packed
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S
from control.whole_body.body_terms import BODY_TERMS
from control.whole_body.reference_correction import NO_CORRECTION
from control.whole_body.task_memory import TaskMemory, TaskMemoryConfig
from control.whole_body.task_signals import TASK_SIGNALS
from control.whole_body.wheels import WHEEL_STATE, WHEELS, WheelConfig, wheel_targets
from sim.backends.hardware.limits import HardwareLimits
from tests.control.whole_body.standing import correction_of

LATERAL = np.array([0.18, -0.18, 0.18, -0.18])


@pytest.fixture
def model():
    return RobotModel()


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
