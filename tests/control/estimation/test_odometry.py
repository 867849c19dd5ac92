"""Wheel odometry against closed forms, and against the simulator's truth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.estimation.odometry import OdometryConfig, WheelOdometry
from control.joints import JOINT_COUNT, NOMINAL_POSITION, WHEEL_SLICE
from control.robot_model import RobotModel
from control.timing import TICK_S
from control.types import Odometry
from sim.runtime.simulation import Simulation, SimulationConfig
from tests.control.estimation.test_base_state import repeat, rolling_joint_velocity, yaw_rotation

SPEED_MPS, YAW_RPS = 0.5, 0.7


class Roller:
    """A robot that rolls without slip, and its odometry."""

    def __init__(self, yaw_rad: float = 0.0) -> None:
        self.model = RobotModel()
        self.odometry = WheelOdometry(OdometryConfig(), self.model)
        self.yaw_rad = yaw_rad

    def roll(self, speed_mps: float, yaw_rps: float, slip: np.ndarray | None = None) -> Odometry:
        """One tick; `slip` (22,) rad/s is added to the joint velocities."""
        rates, position = np.array([0.0, 0.0, yaw_rps]), np.array(NOMINAL_POSITION)
        self.yaw_rad += 0.5 * TICK_S * yaw_rps
        rotation, linear = yaw_rotation(self.yaw_rad), np.array([speed_mps, 0.0, 0.0])
        joint_velocity = rolling_joint_velocity(self.model, rotation, position, linear, rates)
        joint_velocity += 0.0 if slip is None else slip
        self.model.update(rotation, position, linear, rates, joint_velocity)
        odometry = self.odometry.step()
        self.yaw_rad += 0.5 * TICK_S * yaw_rps
        return odometry


@pytest.mark.parametrize("start_rad", [0.0, 2.5])
def test_an_arc_is_found_from_wherever_it_starts(start_rad: float) -> None:
    roller, ticks = Roller(start_rad), 1000
    odometry = repeat(ticks, lambda: roller.roll(SPEED_MPS, YAW_RPS))
    angle, radius = YAW_RPS * ticks * TICK_S, SPEED_MPS / YAW_RPS
    np.testing.assert_allclose(odometry.position_m, [radius * math.sin(angle), radius * (1 - math.cos(angle))], atol=2e-3)
    assert odometry.yaw_rad == pytest.approx(angle, abs=2e-3)


def test_yaw_does_not_wrap() -> None:
    roller = Roller(3.0)
    odometry = repeat(2000, lambda: roller.roll(0.0, -2.0))
    assert odometry.yaw_rad == pytest.approx(-8.0, abs=5e-3)


@pytest.mark.parametrize("wheel", range(4))
def test_a_wheel_that_spins_alone_is_dropped(wheel: int) -> None:
    roller, slip = Roller(), np.zeros(JOINT_COUNT)
    slip[WHEEL_SLICE.start + wheel] = 30.0
    odometry = repeat(500, lambda: roller.roll(SPEED_MPS, 0.0, slip))
    np.testing.assert_allclose(odometry.position_m, [SPEED_MPS, 0.0], atol=5e-3)


def test_uncertainty_grows_with_the_way_and_not_with_noise_at_rest() -> None:
    roller, rng = Roller(), np.random.default_rng(1)
    resting = repeat(2000, lambda: roller.roll(0.0, 0.0, 0.02 * rng.standard_normal(JOINT_COUNT)))
    assert resting.sigma_m < 1e-3
    moved = repeat(1000, lambda: roller.roll(SPEED_MPS, 0.0))
    assert moved.sigma_m == pytest.approx(OdometryConfig().way_share * 1.0, rel=0.05)
    back = repeat(1000, lambda: roller.roll(-SPEED_MPS, 0.0))
    assert back.sigma_m > 1.5 * moved.sigma_m


def test_a_frame_that_is_not_finite_costs_its_own_step_alone() -> None:
    roller, lost = Roller(), np.full(JOINT_COUNT, np.nan)
    repeat(100, lambda: roller.roll(SPEED_MPS, 0.0))
    roller.roll(SPEED_MPS, 0.0, lost)
    odometry = repeat(399, lambda: roller.roll(SPEED_MPS, 0.0))
    np.testing.assert_allclose(odometry.position_m, [SPEED_MPS * 499 * TICK_S, 0.0], atol=1e-3)


def test_a_biased_gyro_moves_no_robot_that_rests() -> None:
    """The attitude is as noisy as an IMU's."""
    model, rng = RobotModel(), np.random.default_rng(2)
    odometry, drift, still = WheelOdometry(OdometryConfig(), model), np.zeros(2), np.zeros(JOINT_COUNT)

    def rest() -> Odometry:
        nonlocal drift
        drift = 0.99 * drift + 1e-4 * rng.standard_normal(2)
        (cx, cy), (sx, sy) = np.cos(drift), np.sin(drift)
        tilted = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]]) @ np.array(
            [[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]]
        )
        model.update(tilted, np.array(NOMINAL_POSITION), np.zeros(3), np.full(3, 0.02), still)
        return odometry.step()

    assert np.linalg.norm(repeat(3000, rest).position_m) < 2e-3  # with the gyro's rate: 4 cm in these 6 s


@pytest.mark.slow
def test_twenty_metres_of_random_driving_end_where_the_robot_is() -> None:
    """And at rest, before, the base velocity is zero within 1 cm/s."""
    simulation = Simulation(SimulationConfig(seed=41))
    rng, way, last, turned, last_yaw = np.random.default_rng(41), 0.0, np.zeros(2), 0.0, 0.0
    output = repeat(2500, lambda: simulation.tick(DEFAULT_COMMAND))
    assert np.abs(output.base.linear_velocity_in_base).max() < 0.01
    simulation.pipeline.reset()
    start = simulation.truth()
    last, command, tick = start.base_position[:2].copy(), DEFAULT_COMMAND, 0
    last_yaw = math.atan2(*start.rotation_heading_to_world[1::-1, 0])
    while way < 20.0:
        if tick % 1000 == 0:
            command = replace(DEFAULT_COMMAND, base_velocity=np.array([rng.uniform(-0.6, 0.6), 0.0, rng.uniform(-0.8, 0.8)]))
        output, tick = simulation.tick(command), tick + 1
        truth = simulation.truth()
        yaw = math.atan2(*truth.rotation_heading_to_world[1::-1, 0])
        turned, last_yaw = turned + math.remainder(yaw - last_yaw, math.tau), yaw
        way, last = way + float(np.linalg.norm(truth.base_position[:2] - last)), truth.base_position[:2].copy()
    true = (last - start.base_position[:2]) @ start.rotation_heading_to_world[:2, :2]
    error = float(np.linalg.norm(output.odometry.position_m - true))
    assert error < 0.02 * way
    assert error < 3.0 * output.odometry.sigma_m
    assert abs(output.odometry.yaw_rad - turned) < math.radians(2.0)
