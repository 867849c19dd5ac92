"""The safety gate: what reaches the drives is within limits whatever a controller or a sensor delivers."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from control.command.limits import DEFAULT_COMMAND
from control.faults import Fault
from control.joints import (
    ARM_SLICE,
    DAMPING,
    JOINT_COUNT,
    LEG_SLICE,
    NOMINAL_POSITION,
    STIFFNESS,
    TORQUE_LIMIT,
    WHEEL_SLICE,
)
from control.robot_model import RobotModel
from control.safety import SafetyConfig, SafetyGate, TargetsError
from control.timing import CONTROL_PERIOD_S, SLOT_COUNT, TICK_S
from control.types import BaseState, SensorFrame

CONFIG = SafetyConfig()


@pytest.fixture(scope="module")
def model():
    return RobotModel()


@pytest.fixture
def gate(model):
    return SafetyGate(CONFIG, model)


def frame(time_s=0.0, position=NOMINAL_POSITION, velocity=None, torque=None):
    zero = np.zeros(JOINT_COUNT)
    return SensorFrame(
        time_s,
        np.array([1.0, 0.0, 0.0, 0.0]),
        np.zeros(3),
        np.array([0.0, 0.0, 9.81]),
        np.array(position, dtype=float),
        zero if velocity is None else velocity,
        zero if torque is None else torque,
    )


def base(tilt=0.0):
    c, s = np.cos(tilt), np.sin(tilt)
    return BaseState(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), np.zeros(3), np.zeros(3), 0.357)


def torque_of(command, sensor):
    return (
        command.stiffness * (command.position - sensor.joint_position)
        + command.damping * (command.velocity - sensor.joint_velocity)
        + command.torque
    )


def run(gate, targets, seconds, start_s=0.0, **frame_options):
    """Fresh targets every 20 ms, as a controller delivers them."""
    results = []
    for tick in range(round(seconds / TICK_S)):
        sensor = frame(start_s + tick * TICK_S, **frame_options)
        if tick % SLOT_COUNT == 0:
            gate.accept(targets, sensor.time_s)
        results.append((*gate.step(sensor, base()), sensor))
    return results[-1]


def fresh(gate, targets, sensor, base_state, reported=Fault.NONE):
    """A tick at which the controller runs."""
    gate.accept(targets, sensor.time_s)
    return gate.step(sensor, base_state, reported)


def test_sound_targets_pass_unchanged_with_the_gains_of_the_drives(gate):
    targets = NOMINAL_POSITION.copy()
    targets[WHEEL_SLICE] = 2.0
    command, status, _ = run(gate, targets, 0.5)
    assert np.allclose(command.position[LEG_SLICE], targets[LEG_SLICE])
    assert np.allclose(command.position[ARM_SLICE], targets[ARM_SLICE])
    assert np.allclose(command.velocity[WHEEL_SLICE], 2.0)
    assert np.array_equal(command.stiffness, STIFFNESS)
    assert np.array_equal(command.damping, DAMPING)
    assert status.faults == Fault.NONE
    assert not status.damping


@settings(max_examples=80, deadline=None)
@given(
    targets=arrays(float, JOINT_COUNT, elements=st.floats(-1e6, 1e6)),
    offset=arrays(float, JOINT_COUNT, elements=st.floats(-0.2, 0.2)),
    velocity=arrays(float, JOINT_COUNT, elements=st.floats(-50.0, 50.0)),
)
def test_predicted_torque_never_exceeds_the_limit(model, targets, offset, velocity):
    gate = SafetyGate(CONFIG, model)
    position = NOMINAL_POSITION + offset
    run(gate, NOMINAL_POSITION, 0.2, position=position)
    for tick in range(20):
        sensor = frame(0.2 + tick * TICK_S, position=position, velocity=velocity)
        command, _ = fresh(gate, targets, sensor, base())
        assert np.all(np.abs(torque_of(command, sensor)) <= TORQUE_LIMIT * (1 + 1e-9))


def test_a_saturated_joint_is_reported_and_the_others_keep_their_targets(gate):
    targets = NOMINAL_POSITION.copy()
    targets[1] += 2.0
    command, status, sensor = run(gate, targets, 0.5)
    assert torque_of(command, sensor)[1] == pytest.approx(TORQUE_LIMIT[1])
    assert Fault.TORQUE_LIMIT in status.faults
    others = np.delete(np.arange(JOINT_COUNT), 1)
    assert np.allclose(command.position[others][:11], targets[others][:11])


def test_a_joint_at_its_end_is_not_pushed_further_but_may_leave(gate, model):
    position = NOMINAL_POSITION.copy()
    position[2] = model.position_upper[2]
    inward, outward = position.copy(), position.copy()
    inward[2] -= 0.2
    outward[2] += 0.2
    command, status, sensor = run(gate, outward, 0.5, position=position)
    assert torque_of(command, sensor)[2] == pytest.approx(0.0, abs=1e-9)
    assert Fault.JOINT_LIMIT in status.faults
    gate.reset()
    command, status, sensor = run(gate, inward, 3.0, position=position)
    assert torque_of(command, sensor)[2] == pytest.approx(-8.0)
    assert status.faults == Fault.NONE


def test_a_target_beyond_an_end_still_carries_a_load_in_mid_range(gate):
    targets = NOMINAL_POSITION.copy()
    targets[17] += 1.9
    command, status, sensor = run(gate, targets, 0.5)
    assert torque_of(command, sensor)[17] == pytest.approx(15.0 * 1.9)
    assert status.faults == Fault.NONE


def test_a_joint_that_is_too_fast_may_only_be_braked(gate):
    velocity = np.zeros(JOINT_COUNT)
    velocity[18] = 1.2 * CONFIG.arm_velocity_rps
    for target, expected in ((+20.0, 0.0), (-20.0, -TORQUE_LIMIT[18])):
        gate.reset()
        targets = NOMINAL_POSITION.copy()
        targets[18] += target
        command, _, sensor = run(gate, targets, 0.6, velocity=velocity)
        assert torque_of(command, sensor)[18] == pytest.approx(expected, abs=1e-9)


def test_targets_are_slewed(gate):
    run(gate, NOMINAL_POSITION, 0.3)
    before, _, _ = run(gate, NOMINAL_POSITION, CONTROL_PERIOD_S, start_s=0.3)
    targets = NOMINAL_POSITION.copy()
    targets[LEG_SLICE] += 0.5
    after, _ = fresh(gate, targets, frame(0.32), base())
    step = after.position - before.position
    assert np.allclose(step[LEG_SLICE], CONFIG.leg_slew_rps * TICK_S)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_targets_that_are_not_finite_are_refused_and_the_last_good_ones_held_then_damped(gate, bad):
    good, _, _ = run(gate, NOMINAL_POSITION, 0.2)
    targets = NOMINAL_POSITION.copy()
    targets[3] = bad
    command, status = fresh(gate, targets, frame(0.2), base())
    assert Fault.NOT_FINITE in status.faults
    assert np.allclose(command.position, good.position)
    for tick in range(60):
        command, status = gate.step(frame(0.202 + tick * TICK_S), base())
        assert Fault.NOT_FINITE in status.faults
        assert np.isfinite(torque_of(command, frame())).all()
    assert status.damping
    _, status = fresh(gate, NOMINAL_POSITION, frame(0.33), base())
    assert status.faults == Fault.NONE


@pytest.mark.parametrize(
    "targets", [np.zeros(21), np.zeros((22, 1)), [0.0] * 22, None, np.full(22, "0"), np.zeros(22, complex)]
)
def test_targets_of_another_shape_or_type_are_a_programming_error(gate, targets):
    with pytest.raises(TargetsError, match="22"):
        gate.accept(targets, 0.0)


@pytest.mark.parametrize("channel", ["joint_position", "joint_velocity"])
def test_a_sensor_that_is_not_finite_damps(gate, channel):
    run(gate, NOMINAL_POSITION, 0.2)
    values = getattr(frame(), channel).copy()
    values[5] = np.nan
    command, status = gate.step(replace(frame(0.2), **{channel: values}), base())
    assert status.damping
    assert Fault.NOT_FINITE in status.faults
    assert np.array_equal(command.stiffness, np.zeros(JOINT_COUNT))


def test_an_attitude_that_is_not_finite_damps(gate):
    run(gate, NOMINAL_POSITION, 0.2)
    _, status = fresh(gate, NOMINAL_POSITION, frame(0.2), base(tilt=np.nan))
    assert status.damping


def test_tilt_warns_then_damps_and_stays_damped_until_cleared(gate):
    run(gate, NOMINAL_POSITION, 0.2)
    _, status = gate.step(frame(0.2), base(0.79))
    assert status.faults == Fault.NONE
    _, status = gate.step(frame(0.202), base(-0.81))
    assert status.faults == Fault.TILT
    assert not status.damping
    _, status = gate.step(frame(0.204), base(1.01))
    assert status.damping
    _, status = gate.step(frame(0.206), base(0.0))
    assert status.damping
    gate.clear()
    _, status = fresh(gate, NOMINAL_POSITION, frame(0.208), base(0.0))
    assert not status.damping


def test_stale_targets_are_held_then_damped_and_return(gate):
    run(gate, NOMINAL_POSITION, 0.2)
    gate.accept(NOMINAL_POSITION, 0.2)
    seen = []
    for tick in range(60):
        _, status = gate.step(frame(0.2 + tick * TICK_S), base())
        seen.append((Fault.STALE_TARGETS in status.faults, status.damping))
    for age, (stale, damped) in zip(np.arange(60) * TICK_S, seen, strict=True):
        if abs(age - CONFIG.hold_timeout_s) > 1e-6:
            assert stale == (age > CONFIG.hold_timeout_s)
        if abs(age - CONFIG.damp_timeout_s) > 1e-6:
            assert damped == (age > CONFIG.damp_timeout_s)
    _, status = fresh(gate, NOMINAL_POSITION, frame(0.4), base())
    assert not status.damping


def test_a_controller_may_fill_the_same_array_again_and_again(gate):
    buffer, untouched = NOMINAL_POSITION.copy(), NOMINAL_POSITION.copy()
    positions = []
    for tick in range(100):
        sensor = frame(tick * TICK_S)
        if tick % SLOT_COUNT == 0:
            buffer[:] = untouched
            gate.accept(buffer, sensor.time_s)
            buffer[:] = np.nan  # whatever happens to it later is the controller's own
        command, status = gate.step(sensor, base())
        assert status.faults == Fault.NONE
        positions.append(command.position[LEG_SLICE])
    assert np.allclose(positions[-1], untouched[LEG_SLICE])


def test_a_stale_operator_stops_the_base_and_nothing_else(gate):
    moving = replace(DEFAULT_COMMAND, base_velocity=np.array([0.5, 0.0, 0.3]), force_n=np.array([0.0, 0.0, 9.0]))
    assert gate.check_command(moving, 0.4) is moving
    for age in (0.6, np.inf, np.nan):
        stopped = gate.check_command(moving, age)
        assert np.array_equal(stopped.base_velocity, np.zeros(3))
        assert np.array_equal(stopped.force_n, moving.force_n)
    _, status = fresh(gate, NOMINAL_POSITION, frame(), base())
    assert Fault.STALE_SETPOINT in status.faults


def test_estop_latches_over_everything_until_cleared(gate):
    run(gate, NOMINAL_POSITION, 0.2)
    gate.estop()
    for seconds in (0.2, 5.0):
        command, status = fresh(gate, NOMINAL_POSITION, frame(seconds), base())
        assert status.estop
        assert status.damping
        assert np.array_equal(command.stiffness, np.zeros(JOINT_COUNT))
        assert command.damping[LEG_SLICE] == pytest.approx(CONFIG.leg_damping)
        assert command.damping[WHEEL_SLICE] == pytest.approx(CONFIG.wheel_damping)
    gate.clear()
    _, status = fresh(gate, NOMINAL_POSITION, frame(5.01), base())
    assert not status.estop


def test_standing_up_starts_at_the_measured_posture_and_torque_and_ends_at_the_targets(gate):
    folded = NOMINAL_POSITION.copy()
    folded[LEG_SLICE] = [0.0, 1.36, -2.6] * 4
    torque = np.full(JOINT_COUNT, 0.3)
    commands = []
    for tick in range(1200):
        sensor = frame(tick * TICK_S, position=folded, torque=torque)
        command, _ = fresh(gate, NOMINAL_POSITION, sensor, base())
        commands.append(torque_of(command, sensor))
    assert np.allclose(commands[0], torque)
    assert np.abs(np.diff(commands, axis=0)).max() < 0.2
    assert commands[500][1] == pytest.approx((commands[0][1] + commands[-1][1]) / 2, rel=0.05)
    assert gate.in_control
    assert commands[-1][1] == pytest.approx(STIFFNESS[1] * (NOMINAL_POSITION[1] - folded[1]), rel=1e-6)


def test_a_standing_robot_is_taken_over_quickly(gate):
    targets = NOMINAL_POSITION.copy()
    targets[1] += 0.2
    run(gate, targets, CONFIG.start_blend_s - 0.01)
    assert not gate.in_control
    command, _, _ = run(gate, targets, 0.03, start_s=CONFIG.start_blend_s - 0.01)
    assert gate.in_control
    assert command.position[1] == pytest.approx(targets[1])


def test_another_controller_in_motion_takes_over_smoothly_and_stays_in_control(gate):
    run(gate, NOMINAL_POSITION, 0.5)
    gate.hand_over()
    after = NOMINAL_POSITION + 0.2 * (STIFFNESS > 0.0)
    applied = []
    for tick in range(round(CONFIG.handover_s / TICK_S) + 1):
        applied.append(fresh(gate, after, frame(0.5 + tick * TICK_S), base())[0].position)
        assert gate.in_control
    assert np.allclose(applied[0], NOMINAL_POSITION * (STIFFNESS > 0.0), atol=1e-9)
    assert np.allclose(applied[-1], after * (STIFFNESS > 0.0))
    # A minimum-jerk blend of 0.2 rad is nowhere faster than 15/8 of its mean speed; the bare slew limit would be far above.
    fastest = np.abs(np.diff(applied, axis=0)).max()
    assert fastest <= 15.0 / 8.0 * 0.2 / CONFIG.handover_s * TICK_S * (1.0 + 1e-6)
    assert fastest < 0.1 * CONFIG.leg_slew_rps * TICK_S


def test_a_handover_while_standing_up_changes_nothing(model):
    lying = NOMINAL_POSITION.copy()
    lying[LEG_SLICE] += 0.4
    gates = [SafetyGate(CONFIG, model) for _ in range(2)]
    for gate in gates:
        run(gate, NOMINAL_POSITION, 0.5, position=lying)
    gates[1].hand_over()
    ends = [run(gate, NOMINAL_POSITION, 0.5, start_s=0.5, position=lying)[0].position for gate in gates]
    assert np.array_equal(ends[0], ends[1])
    assert not gates[1].in_control


def test_before_the_first_targets_the_drives_damp(gate):
    _, status = gate.step(frame(), base())
    assert status.damping


def test_an_encoder_far_beyond_its_joint_damps(gate, model):
    run(gate, NOMINAL_POSITION, 0.2)
    position = NOMINAL_POSITION.copy()
    position[2] = model.position_upper[2] + 1.1 * CONFIG.overtravel_rad
    _, status = fresh(gate, NOMINAL_POSITION, frame(0.2, position=position), base())
    assert status.damping
    assert Fault.JOINT_LIMIT in status.faults


def test_reported_faults_are_passed_on(gate):
    _, status = fresh(gate, NOMINAL_POSITION, frame(), base(), Fault.ESTIMATOR_STALE)
    assert status.faults == Fault.ESTIMATOR_STALE
