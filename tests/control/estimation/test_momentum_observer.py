"""The observer against its closed-form transfer function, and the whole residual against a simulated robot's own dynamics."""

import math

import numpy as np
import pytest

from control.estimation.force_estimator import EstimatorInput
from control.estimation.momentum_observer import FAST_GAINS, PAPER_GAINS, SLOPE_GAINS, MomentumObserver, ObserverGains
from control.estimation.momentum_residual import MomentumResidual, nominal_friction_torque
from control.joints import JOINT_COUNT, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.timing import TICK_S
from control.types import BaseState, SensorFrame


def step_response(gains: ObserverGains, time: np.ndarray) -> np.ndarray:
    """Unit step response of K2 / (s^2 + K1 s + K2), underdamped."""
    zeta, omega = gains.damping_ratio, gains.natural_frequency
    damped = omega * math.sqrt(1 - zeta**2)
    decay = np.exp(-zeta * omega * time)
    return 1 - decay * (np.cos(damped * time) + zeta * omega / damped * np.sin(damped * time))


def test_paper_gains_have_the_paper_bandwidth() -> None:
    assert PAPER_GAINS.natural_frequency == pytest.approx(math.sqrt(20))
    assert PAPER_GAINS.damping_ratio == pytest.approx(0.67, abs=0.005)


@pytest.mark.parametrize("gains", [PAPER_GAINS, FAST_GAINS])
def test_step_response_is_the_second_order_transfer_function(gains: ObserverGains) -> None:
    period = 1e-3 / gains.natural_frequency
    observer = MomentumObserver(gains, period)
    time = np.arange(1, round(10 / gains.natural_frequency / period)) * period
    observer.step(np.zeros(1), np.zeros(1))
    # A constant disturbance of 1 makes the momentum grow linearly while the known input is zero.
    response = np.array([observer.step(np.array([t]), np.zeros(1))[0] for t in time])
    np.testing.assert_allclose(response, step_response(gains, time), atol=2e-3)


@pytest.mark.parametrize("gains", [PAPER_GAINS, FAST_GAINS])
def test_step_response_at_500_hz_stays_close(gains: ObserverGains) -> None:
    observer = MomentumObserver(gains, TICK_S)
    time = np.arange(1, 2000) * TICK_S
    observer.step(np.zeros(1), np.zeros(1))
    response = np.array([observer.step(np.array([t]), np.zeros(1))[0] for t in time])
    lag_of_one_period = gains.natural_frequency * TICK_S
    np.testing.assert_allclose(response, step_response(gains, time), atol=lag_of_one_period)
    assert response[-1] == pytest.approx(1.0, abs=1e-4)


def test_with_a_slope_the_step_response_is_that_of_three_equal_poles() -> None:
    period = 1e-5
    observer = MomentumObserver(SLOPE_GAINS, period)
    pole = SLOPE_GAINS.k3 ** (1 / 3)
    time = np.arange(1, 30_000) * period
    observer.step(np.zeros(1), np.zeros(1))
    response = np.array([observer.step(np.array([t]), np.zeros(1))[0] for t in time])
    x = pole * time
    np.testing.assert_allclose(response, 1 - np.exp(-x) * (1 + x - x * x), atol=2e-3)


@pytest.mark.parametrize(
    "gains, lag_s", [(PAPER_GAINS, PAPER_GAINS.k1 / PAPER_GAINS.k2), (FAST_GAINS, 0.028), (SLOPE_GAINS, 0.0)]
)
def test_a_ramp_is_followed_with_the_lag_of_the_gains(gains: ObserverGains, lag_s: float) -> None:
    observer = MomentumObserver(gains, TICK_S)
    momentum = np.zeros(1)
    observer.step(momentum, np.zeros(1))
    ticks = 4000
    for tick in range(1, ticks):
        momentum = momentum + TICK_S * 15.0 * tick * TICK_S
        observer.step(momentum, np.zeros(1))
    error = 15.0 * (ticks - 1) * TICK_S - observer.residual[0]
    assert error == pytest.approx(15.0 * lag_s, abs=0.02)


@pytest.mark.parametrize(
    "k1, k2, k3", [(1e4, 1e8, 0.0), (1e6, 1.0, 0.0), (1.0, 1e9, 0.0), (90.0, 2700.0, 27000.0), (9e3, 2.7e7, 2.7e10)]
)
def test_every_stable_gain_is_stable_at_500_hz(k1: float, k2: float, k3: float) -> None:
    observer = MomentumObserver(ObserverGains(k1, k2, k3), TICK_S)
    observer.step(np.zeros(1), np.zeros(1))
    for tick in range(1, 3000):
        observer.step(np.array([min(tick, 5) * TICK_S]), np.zeros(1))
    assert abs(observer.residual[0]) < 1.0


@pytest.mark.parametrize("k1, k2", [(0.0, 1.0), (1.0, -1.0), (float("nan"), 1.0), (1.0, float("inf"))])
def test_gains_that_are_not_positive_are_refused(k1: float, k2: float) -> None:
    with pytest.raises(ValueError, match="observer gain"):
        ObserverGains(k1, k2)


@pytest.mark.parametrize("k3", [-1.0, 120.0, float("nan")])
def test_a_slope_gain_that_is_not_stable_is_refused(k3: float) -> None:
    with pytest.raises(ValueError, match="k3"):
        ObserverGains(6.0, 20.0, k3)


def test_retuned_gains_keep_their_kind() -> None:
    assert PAPER_GAINS.retuned(10.0, 50.0) == ObserverGains(10.0, 50.0)
    slow = SLOPE_GAINS.retuned(30.0, 300.0)
    assert slow.k3 == pytest.approx(1000.0)


def test_a_change_of_gains_does_not_jump() -> None:
    observer = MomentumObserver(PAPER_GAINS, TICK_S)
    observer.step(np.zeros(1), np.zeros(1))
    for tick in range(1, 3000):
        observer.step(np.array([tick * TICK_S]), np.zeros(1))
    before = observer.residual[0]
    observer.gains = FAST_GAINS
    assert observer.step(np.array([3000 * TICK_S]), np.zeros(1))[0] == pytest.approx(before, abs=1e-6)


class FallingRobot:
    """Integrates M vdot + h = S^T tau + xi of the model itself, so that the true xi is known exactly."""

    def __init__(self, seed: int) -> None:
        self.model = RobotModel()
        self._rng = np.random.default_rng(seed)
        self.position = NOMINAL_POSITION + 0.1 * self._rng.normal(size=JOINT_COUNT)
        self.velocity = np.zeros(28)
        self.torque = np.zeros(JOINT_COUNT)
        self.time_s = 0.0
        self._phase = self._rng.uniform(0, 6, JOINT_COUNT)
        self._refresh()

    def _refresh(self) -> None:
        v = self.velocity
        self.model.update(np.eye(3), self.position, v[:3], v[3:6], v[self.model.joint_rows])

    def advance(self, disturbance: np.ndarray, friction: bool) -> None:
        """One tick in 10 steps; the base is held upright, so only its joints and its linear motion move."""
        model = self.model
        torque_sum = np.zeros(JOINT_COUNT)
        for _ in range(10):
            h = TICK_S / 10
            torque = 0.5 * np.sin(3.0 * self.time_s + self._phase)
            force = model.momentum_drift + disturbance
            force[model.joint_rows] += torque
            if friction:
                friction_torque = np.empty(JOINT_COUNT)
                joint_velocity = self.velocity[model.joint_rows]
                nominal_friction_torque(joint_velocity, model.joint_friction, model.joint_damping, friction_torque)
                force[model.joint_rows] -= friction_torque
            # pdot = C^T v - g + S^T tau + xi, eq. (4); the upright base is a constraint on its angular velocity.
            rate = force - (model.coriolis_matrix + model.coriolis_matrix.T) @ self.velocity
            keep = np.r_[0:3, 6:28]
            acceleration = np.zeros(28)
            acceleration[keep] = np.linalg.solve(model.mass_matrix[np.ix_(keep, keep)], rate[keep])
            self.velocity = self.velocity + h * acceleration
            self.position = self.position + h * self.velocity[model.joint_rows]
            self.time_s += h
            torque_sum += torque
            self._refresh()
        self.torque = torque_sum / 10

    def inputs(self) -> EstimatorInput:
        joint_velocity = self.velocity[self.model.joint_rows]
        base = BaseState(np.eye(3), self.velocity[:3], self.velocity[3:6], 0.36)
        sensor = SensorFrame(
            self.time_s, np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3), self.position, joint_velocity, self.torque
        )
        return EstimatorInput(round(self.time_s / TICK_S), self.model, sensor, base)


@pytest.mark.parametrize("friction", [False, True])
def test_residual_finds_a_known_generalized_force_on_a_moving_robot(friction: bool) -> None:
    robot = FallingRobot(3)
    wrench = np.array([5.0, -8.0, 12.0, 0.0, 0.0, 0.0])
    residual = MomentumResidual(FAST_GAINS, TICK_S, with_friction=friction)
    residual.observe(robot.inputs())
    # The same second-order lag, applied to the true force: its impulse takes the place of the momentum.
    lagged_truth, impulse = MomentumObserver(FAST_GAINS, TICK_S), np.zeros(28)
    lagged_truth.step(impulse, np.zeros(28))
    for _ in range(150):
        force = robot.model.end_effector_jacobian.T @ wrench
        force[:3] += [0.0, 0.0, robot.model.total_mass * 9.81]
        robot.advance(force, friction)
        residual.observe(robot.inputs())
        impulse = impulse + TICK_S * force
        lagged_truth.step(impulse, np.zeros(28))
    assert np.abs(robot.velocity).max() > 0.5
    keep = np.r_[0:3, 6:28]
    np.testing.assert_allclose(residual.residual[keep], lagged_truth.residual[keep], atol=0.1)


def test_the_friction_taken_out_is_what_is_missing_in_the_residual() -> None:
    robot = FallingRobot(4)
    with_friction, without = (MomentumResidual(SLOPE_GAINS, TICK_S, with_friction=friction) for friction in (True, False))
    for _ in range(60):
        robot.advance(np.zeros(28), True)
        inputs = robot.inputs()
        with_friction.observe(inputs)
        without.observe(inputs)
    difference = with_friction.residual - without.residual
    assert np.abs(difference).max() > 0.1
    np.testing.assert_allclose(with_friction.residuals[0] - with_friction.residuals[2], difference, atol=1e-9)
    np.testing.assert_array_equal(without.residuals[0], without.residuals[2])


def test_observer_starts_at_the_equilibrium_of_rest() -> None:
    robot = FallingRobot(1)
    residual = MomentumResidual(PAPER_GAINS, TICK_S, with_friction=False)
    residual.observe(robot.inputs())
    np.testing.assert_allclose(residual.residual[2], robot.model.total_mass * 9.81, rtol=1e-9)
    np.testing.assert_allclose(residual.residuals[1], robot.model.gravity, atol=1e-9)


def test_sharing_estimators_advance_the_observer_once_per_tick() -> None:
    robot = FallingRobot(2)
    once, twice = (MomentumResidual(FAST_GAINS, TICK_S, with_friction=False) for _ in range(2))
    for _ in range(5):
        robot.advance(np.zeros(28), False)
        once.observe(robot.inputs())
        assert twice.observe(robot.inputs())
        assert not twice.observe(robot.inputs())
    np.testing.assert_array_equal(once.residual, twice.residual)


def test_reading_before_the_first_tick_is_an_error() -> None:
    residual = MomentumResidual(FAST_GAINS, TICK_S, with_friction=False)
    with pytest.raises(RuntimeError, match="observe"):
        _ = residual.inputs
