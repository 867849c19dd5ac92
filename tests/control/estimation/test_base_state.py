"""The base-state estimator against closed forms: rolling contact, the crossover, the lever arm of the IMU."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np
import pytest

from control.estimation.base_state import BaseStateConfig, BaseStateEstimator
from control.frames import quaternion_from_rotation
from control.joints import JOINT_COUNT, LEG_SLICE, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION, WHEEL_SLICE
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.types import SensorFrame

CONFIG = BaseStateConfig()
Result = TypeVar("Result")
BLIND = BaseStateConfig(standing_crossover_s=1.0, bias_rate=0.0, standing_bias_rate=0.0)
"""Without an estimate of biases."""
UP = np.array([0.0, 0.0, GRAVITY_MPS2])


@pytest.fixture
def model() -> RobotModel:
    return RobotModel()


def repeat(count: int, step: Callable[[], Result]) -> Result:
    """The last of `count` results."""
    for _ in range(count - 1):
        step()
    return step()


def yaw_rotation(yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rolling_joint_velocity(
    model: RobotModel, rotation: np.ndarray, position: np.ndarray, linear_in_base: np.ndarray, rates: np.ndarray
) -> np.ndarray:
    """Leg and wheel rates that keep all four contact points still while the base moves as given."""
    model.update_configuration(rotation, position)
    jacobian = model.wheel_contact_jacobians.reshape(12, -1)
    legs = model.joint_rows[:16]
    drift = jacobian[:, :6] @ np.concatenate([linear_in_base, rates])
    velocity = np.zeros(JOINT_COUNT)
    velocity[:16] = np.linalg.lstsq(jacobian[:, legs], -drift, rcond=None)[0]
    return velocity


def frame(
    rotation: np.ndarray,
    position: np.ndarray = NOMINAL_POSITION,
    rates: np.ndarray | None = None,
    acceleration: np.ndarray | None = None,
    joint_velocity: np.ndarray | None = None,
) -> SensorFrame:
    return SensorFrame(
        0.0,
        quaternion_from_rotation(rotation),
        np.zeros(3) if rates is None else rates,
        rotation.T @ UP if acceleration is None else acceleration,
        np.array(position),
        np.zeros(JOINT_COUNT) if joint_velocity is None else joint_velocity,
        np.zeros(JOINT_COUNT),
    )


def moving_frame(model: RobotModel, seed: int) -> tuple[SensorFrame, np.ndarray]:
    """A frame of a robot that rolls without slip, and its true base velocity in base."""
    rng = np.random.default_rng(seed)
    position = NOMINAL_POSITION + 0.1 * rng.normal(size=JOINT_COUNT)
    rotation = yaw_rotation(rng.uniform(-3, 3))
    linear, rates = rng.normal(size=3), rng.normal(size=3)
    joint_velocity = rolling_joint_velocity(model, rotation, position, linear, rates)
    return frame(rotation, position, rates, joint_velocity=joint_velocity), linear


@pytest.mark.parametrize("seed", range(5))
def test_rolling_without_slip_gives_the_base_velocity(seed: int, model: RobotModel) -> None:
    sensor, linear = moving_frame(model, seed)
    base = BaseStateEstimator(CONFIG, model).step(sensor)
    np.testing.assert_allclose(base.linear_velocity_in_base, linear, atol=1e-9)
    np.testing.assert_array_equal(base.angular_velocity_in_base, sensor.angular_velocity)


@pytest.mark.parametrize("wheel", range(4))
def test_one_spinning_wheel_or_kicking_leg_is_outvoted(wheel: int, model: RobotModel) -> None:
    sensor, linear = moving_frame(model, 7)
    velocity = sensor.joint_velocity.copy()
    velocity[WHEEL_SLICE][wheel] += 25.0
    velocity[LEG_SLICE][3 * wheel + 1] -= 6.0
    base = BaseStateEstimator(CONFIG, model).step(replace(sensor, joint_velocity=velocity))
    np.testing.assert_allclose(base.linear_velocity_in_base, linear, atol=1e-9)


def test_height_comes_from_the_legs_that_stand(model: RobotModel) -> None:
    standing = BaseStateEstimator(CONFIG, model).step(frame(np.eye(3)))
    assert standing.height_m == pytest.approx(NOMINAL_BASE_HEIGHT_M, abs=0.005)
    lifted = np.array(NOMINAL_POSITION)
    lifted[2] -= 0.6
    raised = BaseStateEstimator(CONFIG, model).step(frame(np.eye(3), lifted))
    assert raised.height_m == pytest.approx(standing.height_m, abs=0.003)


def test_accelerometer_rules_below_the_crossover_and_contact_above(model: RobotModel) -> None:
    """Wheels that claim to stand while the IMU feels 0.5 m/s^2: v(t) = a tau (1 - exp(-t / tau))."""
    estimator = BaseStateEstimator(BLIND, model)
    still = frame(np.eye(3))
    estimator.step(still)
    pushed = replace(still, linear_acceleration=UP + [0.5, 0.0, 0.0])
    velocity = [estimator.step(pushed).linear_velocity_in_base[0] for _ in range(3000)]
    time = np.arange(1, 3001) * CONFIG.period_s
    expected = 0.5 * CONFIG.crossover_s * (1 - np.exp(-time / CONFIG.crossover_s))
    np.testing.assert_allclose(velocity, expected, atol=1e-3)


def test_at_rest_no_bias_of_the_imu_is_taken_for_a_velocity(model: RobotModel) -> None:
    """0.15 m/s^2 of accelerometer, and 10 mrad of attitude, which turn gravity by as much as 0.1 m/s^2."""
    estimator, blind = BaseStateEstimator(CONFIG, model), BaseStateEstimator(BLIND, model)
    still = replace(frame(np.eye(3)), linear_acceleration=UP + [0.15, -0.15 + 0.01 * GRAVITY_MPS2, 0.15])
    base, without = repeat(2500, lambda: (estimator.step(still), blind.step(still)))
    assert np.abs(without.linear_velocity_in_base[[0, 2]]).min() > 0.1
    assert np.abs(base.linear_velocity_in_base).max() < 1e-3


def test_what_was_learned_at_rest_holds_while_the_wheels_roll(model: RobotModel) -> None:
    estimator = BaseStateEstimator(CONFIG, model)
    bias, ahead = np.array([0.1, -0.1, 0.1]), np.array([0.5, 0.0, 0.0])
    for _ in range(2500):
        estimator.step(replace(frame(np.eye(3)), linear_acceleration=UP + bias))
    rolling = rolling_joint_velocity(model, np.eye(3), np.array(NOMINAL_POSITION), ahead, np.zeros(3))
    moving = frame(np.eye(3), joint_velocity=rolling)
    errors = []
    for tick in range(2500):
        push = np.array([0.5 if tick < 500 else 0.0, 0.0, 0.0])
        slipping = np.array(rolling) * min((tick + 1) / 500, 1.0)
        base = estimator.step(replace(moving, linear_acceleration=UP + bias + push, joint_velocity=slipping))
        errors.append(base.linear_velocity_in_base - ahead * min((tick + 1) / 500, 1.0))
    assert np.abs(errors).max() < 0.01


def test_a_robot_whose_wheels_spin_in_the_air_learns_no_absurd_bias(model: RobotModel) -> None:
    estimator = BaseStateEstimator(CONFIG, model)
    still, spinning = frame(np.eye(3)), np.zeros(JOINT_COUNT)
    spinning[WHEEL_SLICE] = 20.0
    for _ in range(1000):
        estimator.step(still)
    for _ in range(1500):
        estimator.step(replace(still, joint_velocity=spinning))
    base = repeat(2500, lambda: estimator.step(still))
    assert np.abs(base.linear_velocity_in_base).max() < 0.01


def test_lever_arm_of_the_imu_is_exact_while_the_base_spins_and_oscillates(model: RobotModel) -> None:
    estimator = BaseStateEstimator(CONFIG, model)
    lever, yaw, worst = model.imu_position_in_base, 0.0, 0.0
    assert np.linalg.norm(lever) > 0.04
    for tick in range(1500):
        time = tick * CONFIG.period_s
        rate, angular_acceleration = 2.0 + np.sin(9 * time), 9 * np.cos(9 * time)
        rates, alpha = np.array([0.0, 0.0, rate]), np.array([0.0, 0.0, angular_acceleration])
        rotation = yaw_rotation(yaw)
        acceleration = UP + np.cross(alpha, lever) + np.cross(rates, np.cross(rates, lever))
        joint_velocity = rolling_joint_velocity(model, rotation, np.array(NOMINAL_POSITION), np.zeros(3), rates)
        base = estimator.step(frame(rotation, rates=rates, acceleration=acceleration, joint_velocity=joint_velocity))
        worst = max(worst, np.abs(base.linear_velocity_in_base).max())
        yaw += rate * CONFIG.period_s + 0.5 * angular_acceleration * CONFIG.period_s**2
    assert worst < 1e-3


def test_a_frame_that_is_not_finite_changes_nothing(model: RobotModel) -> None:
    estimator = BaseStateEstimator(CONFIG, model)
    sensor, linear = moving_frame(model, 3)
    before = estimator.step(sensor)
    poisoned = replace(sensor, joint_velocity=np.full(JOINT_COUNT, np.nan))
    assert estimator.step(poisoned) is before
    after = estimator.step(replace(sensor, linear_acceleration=UP))
    np.testing.assert_allclose(after.linear_velocity_in_base, linear, atol=0.05)
    estimator.reset()
    with pytest.raises(ValueError, match="not finite"):
        estimator.step(poisoned)


def test_crossover_must_exceed_the_period() -> None:
    with pytest.raises(ValueError, match="crossover_s"):
        BaseStateConfig(crossover_s=0.001)
