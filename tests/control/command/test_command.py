"""Limits, validation and rate limiting of the command."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from control.command.filter import CommandFilter
from control.command.limits import DEFAULT_COMMAND, CommandError, CommandLimits, HandState, clip_command
from control.frames import quaternion_from_rotation, rotation_error, rotation_from_quaternion
from control.joints import NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S

LIMITS = CommandLimits()


def hand_at(command, force=(0.0, 0.0, 0.0)):
    return HandState(command.position_m, rotation_from_quaternion(command.orientation_wxyz), np.array(force))


def vectors(bound):
    return arrays(float, 3, elements=st.floats(-bound, bound))


def test_the_default_command_is_the_hand_of_the_nominal_posture():
    model = RobotModel()
    model.update_configuration(np.eye(3), NOMINAL_POSITION)
    position = model.end_effector_position + np.array([0.0, 0.0, NOMINAL_BASE_HEIGHT_M])
    assert np.allclose(DEFAULT_COMMAND.position_m, position, atol=2e-3)
    assert np.allclose(
        DEFAULT_COMMAND.orientation_wxyz, quaternion_from_rotation(model.end_effector_rotation.copy()), atol=1e-3
    )


def test_the_default_command_is_within_its_own_limits():
    clipped = clip_command(DEFAULT_COMMAND, LIMITS)
    assert np.array_equal(clipped.position_m, DEFAULT_COMMAND.position_m)


@settings(max_examples=60, deadline=None)
@given(position=vectors(5.0), force=vectors(500.0), velocity=vectors(9.0))
def test_clipping_lands_within_every_range_and_changes_nothing_the_second_time(position, force, velocity):
    once = clip_command(replace(DEFAULT_COMMAND, position_m=position, force_n=force, base_velocity=velocity), LIMITS)
    assert np.all(np.abs(once.force_n) <= 40.0)
    assert LIMITS.position_x_m[0] <= once.position_m[0] <= LIMITS.position_x_m[1]
    assert LIMITS.position_y_m[0] <= once.position_m[1] <= LIMITS.position_y_m[1]
    assert LIMITS.position_z_m[0] <= once.position_m[2] <= LIMITS.position_z_m[1]
    assert np.linalg.norm(once.position_m - LIMITS.shoulder_m) <= LIMITS.reach_m + 1e-3
    assert abs(once.base_velocity[2]) <= 0.5
    twice = clip_command(once, LIMITS)
    for name in ("position_m", "force_n", "base_velocity"):
        assert np.allclose(getattr(twice, name), getattr(once, name), atol=1e-3)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("position_m", np.array([0.5, np.nan, 0.5])),
        ("force_n", np.array([np.inf, 0.0, 0.0])),
        ("base_velocity", np.zeros(2)),
        ("mask", np.array([0.0, 0.5, 1.0])),
        ("orientation_wxyz", np.zeros(4)),
    ],
)
def test_what_clipping_cannot_repair_is_refused_by_name(field, value):
    with pytest.raises(CommandError, match=field) as caught:
        clip_command(replace(DEFAULT_COMMAND, **{field: value}), LIMITS)
    assert caught.value.field == field


def test_a_jump_of_the_position_moves_the_reference_at_limited_speed_and_acceleration_and_arrives():
    target = replace(DEFAULT_COMMAND, position_m=np.array([0.45, 0.25, 0.4]))
    command_filter = CommandFilter(LIMITS)
    positions = [DEFAULT_COMMAND.position_m] * 2
    for _ in range(150):
        positions.append(command_filter.step(target, hand_at(DEFAULT_COMMAND), CONTROL_PERIOD_S).position_m)
    velocity = np.diff(positions, axis=0) / CONTROL_PERIOD_S
    acceleration = np.diff(velocity, axis=0) / CONTROL_PERIOD_S
    assert np.linalg.norm(velocity, axis=1).max() <= LIMITS.position_speed_mps + 1e-9
    assert np.linalg.norm(acceleration, axis=1).max() <= LIMITS.position_acceleration_mps2 + 1e-6
    assert np.allclose(positions[-1], target.position_m, atol=1e-3)
    overshoot = (positions[-1] - DEFAULT_COMMAND.position_m) @ (np.array(positions) - target.position_m).T
    assert overshoot.max() < 1e-3


def test_a_jump_of_the_orientation_turns_the_shortest_way_at_limited_rate_and_arrives():
    half_turn = np.array([np.cos(0.7), np.sin(0.7), 0.0, 0.0])
    target = replace(DEFAULT_COMMAND, orientation_wxyz=-half_turn)
    command_filter = CommandFilter(LIMITS)
    last = rotation_from_quaternion(DEFAULT_COMMAND.orientation_wxyz)
    total = 0.0
    for _ in range(200):
        applied = command_filter.step(target, hand_at(DEFAULT_COMMAND), CONTROL_PERIOD_S)
        assert np.linalg.norm(applied.orientation_wxyz) == pytest.approx(1.0)
        rotation = rotation_from_quaternion(applied.orientation_wxyz)
        angle = np.linalg.norm(rotation_error(rotation, last))
        assert angle <= LIMITS.orientation_speed_rps * CONTROL_PERIOD_S + 1e-9
        total += angle
        last = rotation
    direct = rotation_error(rotation_from_quaternion(half_turn), rotation_from_quaternion(DEFAULT_COMMAND.orientation_wxyz))
    assert np.linalg.norm(rotation_error(rotation_from_quaternion(half_turn), last)) < 1e-3
    assert total == pytest.approx(np.linalg.norm(direct), abs=1e-3)


def test_force_and_base_velocity_are_slewed():
    target = replace(
        DEFAULT_COMMAND, mask=np.ones(3), force_n=np.array([20.0, 0.0, -20.0]), base_velocity=np.array([0.5, 0.0, 0.4])
    )
    command_filter = CommandFilter(LIMITS)
    applied = command_filter.step(target, hand_at(DEFAULT_COMMAND), CONTROL_PERIOD_S)
    assert np.allclose(applied.force_n, [1.0, 0.0, -1.0])
    assert np.allclose(applied.base_velocity, [0.02, 0.0, 0.03])
    for _ in range(60):
        applied = command_filter.step(target, hand_at(DEFAULT_COMMAND), CONTROL_PERIOD_S)
    assert np.array_equal(applied.force_n, target.force_n)
    assert np.array_equal(applied.base_velocity, target.base_velocity)


def test_the_first_reference_is_the_measured_hand_not_the_default():
    measured = replace(DEFAULT_COMMAND, position_m=np.array([0.4, 0.1, 0.3]))
    applied = CommandFilter(LIMITS).step(DEFAULT_COMMAND, hand_at(measured), CONTROL_PERIOD_S)
    assert np.allclose(applied.position_m, measured.position_m, atol=1e-3)


def test_an_axis_changes_to_force_at_the_estimated_force():
    command_filter = CommandFilter(LIMITS)
    command_filter.step(DEFAULT_COMMAND, hand_at(DEFAULT_COMMAND), CONTROL_PERIOD_S)
    pressing = replace(DEFAULT_COMMAND, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 20.0]))
    applied = command_filter.step(pressing, hand_at(DEFAULT_COMMAND, force=(3.0, 0.0, 8.0)), CONTROL_PERIOD_S)
    assert np.allclose(applied.force_n, [0.0, 0.0, 9.0])


def test_an_axis_starts_at_no_more_than_may_be_asked_for():
    command_filter = CommandFilter(LIMITS)
    command_filter.step(DEFAULT_COMMAND, hand_at(DEFAULT_COMMAND), CONTROL_PERIOD_S)
    pressing = replace(DEFAULT_COMMAND, mask=np.ones(3))
    applied = command_filter.step(pressing, hand_at(DEFAULT_COMMAND, force=(500.0, -500.0, 0.0)), CONTROL_PERIOD_S)
    assert np.allclose(applied.force_n, [LIMITS.force_n[1] - 1.0, LIMITS.force_n[0] + 1.0, 0.0])


def test_an_axis_changes_to_position_where_the_hand_is():
    command_filter = CommandFilter(LIMITS)
    sliding = replace(DEFAULT_COMMAND, mask=np.array([0.0, 1.0, 0.0]))
    moved = replace(DEFAULT_COMMAND, position_m=DEFAULT_COMMAND.position_m + np.array([0.0, 0.12, 0.0]))
    command_filter.step(sliding, hand_at(DEFAULT_COMMAND), CONTROL_PERIOD_S)
    command_filter.step(sliding, hand_at(moved), CONTROL_PERIOD_S)
    applied = command_filter.step(DEFAULT_COMMAND, hand_at(moved), CONTROL_PERIOD_S)
    assert applied.position_m[1] == pytest.approx(moved.position_m[1], abs=2e-3)
    assert applied.force_n[1] == 0.0


def test_reset_starts_again_at_the_measured_hand():
    command_filter = CommandFilter(LIMITS)
    far = replace(DEFAULT_COMMAND, position_m=np.array([0.4, -0.2, 0.4]))
    command_filter.step(replace(far, base_velocity=np.array([0.5, 0.0, 0.0])), hand_at(far), CONTROL_PERIOD_S)
    command_filter.reset()
    applied = command_filter.step(DEFAULT_COMMAND, hand_at(DEFAULT_COMMAND), CONTROL_PERIOD_S)
    assert np.allclose(applied.position_m, DEFAULT_COMMAND.position_m, atol=1e-3)
    assert np.array_equal(applied.base_velocity, np.zeros(3))
