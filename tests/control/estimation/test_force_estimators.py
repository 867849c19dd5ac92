"""The model-based estimators on statics that are known in closed form, under injected faults, and against simulated truth."""

from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.estimation.adaptive_estimator import AdaptiveEstimator
from control.estimation.base_state import BaseStateConfig, BaseStateEstimator
from control.estimation.force_estimator import EstimatorInput, ForceEstimator
from control.estimation.gmo_estimators import GmoConstrained, GmoPseudoInverse
from control.estimation.momentum_observer import PAPER_GAINS, SLOPE_GAINS
from control.estimation.registry import MODEL_BASED_NAMES, EstimatorsConfig, make_estimators
from control.estimation.wrench_qp import ContactConstraints, WrenchProjectionError, WrenchSolver
from control.joints import ARM_SLICE, JOINT_COUNT, LEGS, NOMINAL_POSITION
from control.robot_model import RobotModel
from control.timing import TICK_S
from control.types import BaseState, SensorFrame
from sim.runtime.simulation import Simulation, SimulationConfig

FORCE = np.array([6.0, -5.0, 12.0])
PUSH_SHARE = {"gmo_pi": 0.65, "gmo_cqp": 0.03, "adaptive": 0.1}
"""Of a force on the base that an estimator may take for one at the hand: the pseudo-inverse spreads it over everything."""


class StandingRobot:
    """Quasi-static robot: wheels carry what base balance asks for, drives hold the rest. Masses may differ from nominal."""

    def __init__(self, arm_scale: float = 1.0, rest_scale: float = 1.0) -> None:
        self.model = RobotModel()
        self.force = np.zeros(3)
        self.base_wrench = np.zeros(6)
        self.extra_torque = np.zeros(JOINT_COUNT)
        self.position = np.array(NOMINAL_POSITION)
        self.time_s = 0.0
        self._scales = arm_scale, rest_scale

    @property
    def total_scale(self) -> float:
        arm, rest = self._scales
        share = self.model.arm_mass / self.model.total_mass
        return arm * share + rest * (1 - share)

    def tick(self) -> EstimatorInput:
        model, zero = self.model, np.zeros(3)
        model.update(np.eye(3), self.position, zero, zero, np.zeros(JOINT_COUNT))
        arm = model.arm_gravity
        gravity = self._scales[0] * arm + self._scales[1] * (model.gravity - arm)
        unsupported = gravity - model.wrench_jacobian[12:15].T @ self.force
        unsupported[:6] -= self.base_wrench
        contacts = model.wrench_jacobian[:12]
        self.wheel_forces = np.linalg.lstsq(contacts[:, :6].T, unsupported[:6], rcond=None)[0]
        balance = unsupported - contacts.T @ self.wheel_forces
        torque = balance[model.joint_rows] - self.extra_torque
        self.time_s += TICK_S
        sensor = SensorFrame(
            self.time_s,
            np.array([1.0, 0, 0, 0]),
            zero,
            np.array([0, 0, 9.81]),
            self.position.copy(),
            np.zeros(JOINT_COUNT),
            torque,
        )
        return EstimatorInput(round(self.time_s / TICK_S) - 1, model, sensor, BaseState(np.eye(3), zero, zero, 0.36))


def make(robot: StandingRobot) -> dict[str, ForceEstimator]:
    return make_estimators(robot.model, EstimatorsConfig(weights=None))


def run(robot: StandingRobot, estimators: dict[str, ForceEstimator], duration_s: float) -> None:
    for _ in range(round(duration_s / TICK_S)):
        inputs = robot.tick()
        for estimator in estimators.values():
            estimator.observe(inputs)


def wave_arm(robot: StandingRobot, estimators: dict[str, ForceEstimator], duration_s: float) -> None:
    for _ in range(round(duration_s / TICK_S)):
        phase = 0.5 * robot.time_s + np.arange(6)
        robot.position[ARM_SLICE] = NOMINAL_POSITION[ARM_SLICE] + 0.4 * np.sin(phase)
        inputs = robot.tick()
        for estimator in estimators.values():
            estimator.observe(inputs)


def test_all_names_are_made_and_share_one_paper_observer() -> None:
    estimators = make(StandingRobot())
    assert tuple(estimators) == MODEL_BASED_NAMES
    pseudo_inverse, constrained = estimators["gmo_pi"], estimators["gmo_cqp"]
    assert isinstance(pseudo_inverse, GmoPseudoInverse) and isinstance(constrained, GmoConstrained)
    assert pseudo_inverse.momentum is constrained.momentum
    assert pseudo_inverse.momentum.gains == PAPER_GAINS
    pseudo_inverse.set_gains(10.0, 50.0)
    assert constrained.momentum.gains.k2 == 50.0
    with pytest.raises(ValueError, match="k2"):
        constrained.set_gains(10.0, -1.0)


@pytest.mark.parametrize("name", MODEL_BASED_NAMES)
def test_a_constant_force_and_its_wheel_forces_are_recovered(name: str) -> None:
    robot = StandingRobot()
    estimators = make(robot)
    run(robot, estimators, 0.02)
    robot.force = FORCE
    run(robot, estimators, 2.0)
    estimate = estimators[name].estimate()
    np.testing.assert_allclose(estimate.force_estimated_n, FORCE, atol=0.3)
    np.testing.assert_allclose(estimate.wheel_forces_in_heading[:, 2], robot.wheel_forces.reshape(4, 3)[:, 2], atol=1.5)
    assert not estimate.stale


@pytest.mark.parametrize("name, gains", [("gmo_pi", PAPER_GAINS), ("gmo_cqp", PAPER_GAINS), ("adaptive", SLOPE_GAINS)])
def test_a_step_is_followed_at_the_observers_bandwidth(name: str, gains: object) -> None:
    robot = StandingRobot()
    estimators = {name: make(robot)[name]}
    run(robot, estimators, 0.02)
    robot.force = FORCE
    fraction_after = []
    for _ in range(2):
        run(robot, estimators, 0.1)
        fraction_after.append(estimators[name].estimate().force_estimated_n @ FORCE / (FORCE @ FORCE))
    # Closed form of the unit step at 0.1 s and 0.2 s: 0.08 and 0.26 with the paper's gains; 1.25 and 1.07 with three poles at
    # 30 rad/s, which follow a ramp without lag.
    expected = [0.0821, 0.2635] if gains is PAPER_GAINS else [1.249, 1.072]
    np.testing.assert_allclose(fraction_after, expected, atol=0.04)


@pytest.mark.parametrize("arm_scale, rest_scale", [(0.8, 0.8), (1.2, 1.2), (1.25, 0.95)])
def test_wrong_masses_are_found_and_no_longer_look_like_a_force(arm_scale: float, rest_scale: float) -> None:
    robot = StandingRobot(arm_scale, rest_scale)
    estimators = {name: make(robot)[name] for name in ("gmo_cqp", "adaptive")}
    wave_arm(robot, estimators, 6.0)
    robot.force = FORCE
    wave_arm(robot, estimators, 4.0)
    adaptive, constrained = (estimators[name].estimate() for name in ("adaptive", "gmo_cqp"))
    assert adaptive.mass_scale == pytest.approx(robot.total_scale, abs=0.01)
    assert np.linalg.norm(adaptive.force_estimated_n - FORCE) < 1.0
    assert np.linalg.norm(constrained.force_estimated_n - FORCE) > 1.5
    assert isinstance(estimators["adaptive"], AdaptiveEstimator)
    np.testing.assert_allclose(estimators["adaptive"].mass_scales, [arm_scale, rest_scale], atol=0.04)


@pytest.mark.parametrize("name", MODEL_BASED_NAMES)
@pytest.mark.parametrize("axis", range(3))
def test_a_push_on_the_base_hardly_shows_at_the_hand(name: str, axis: int) -> None:
    robot = StandingRobot()
    estimators = {name: make(robot)[name]}
    robot.force = FORCE
    run(robot, estimators, 0.02)
    robot.base_wrench[axis] = 20.0
    run(robot, estimators, 2.0)
    error = estimators[name].estimate().force_estimated_n - FORCE
    assert np.linalg.norm(error) < PUSH_SHARE[name] * 20.0


def test_a_joint_against_its_stop_is_not_taken_for_a_force() -> None:
    robot = StandingRobot()
    estimators = {"adaptive": make(robot)["adaptive"]}
    robot.position[16 + 3] = robot.model.position_upper[16 + 3]
    robot.extra_torque[16 + 3] = -8.0  # the stop's
    robot.force = FORCE
    run(robot, estimators, 1.0)
    np.testing.assert_allclose(estimators["adaptive"].estimate().force_estimated_n, FORCE, atol=0.5)


@pytest.mark.parametrize("name", MODEL_BASED_NAMES)
def test_a_tick_that_is_not_finite_repeats_the_last_good_estimate_as_stale(name: str) -> None:
    robot = StandingRobot()
    robot.force = FORCE
    estimators = {name: make(robot)[name]}
    run(robot, estimators, 2.0)
    good = estimators[name].estimate()
    inputs = robot.tick()
    poisoned = replace(inputs, sensor=replace(inputs.sensor, joint_torque=np.full(JOINT_COUNT, np.nan)))
    estimators[name].observe(poisoned)
    repeated = estimators[name].estimate()
    assert repeated.stale
    np.testing.assert_array_equal(repeated.force_estimated_n, good.force_estimated_n)
    run(robot, estimators, 2.0)
    recovered = estimators[name].estimate()
    assert not recovered.stale
    np.testing.assert_allclose(recovered.force_estimated_n, FORCE, atol=0.5)


def test_an_unsolved_program_is_stale_and_never_zero() -> None:
    robot = StandingRobot()
    robot.force = FORCE
    constrained = make(robot)["gmo_cqp"]
    assert isinstance(constrained, GmoConstrained)
    robot.base_wrench[0] = 300.0  # more than the wheels' friction holds
    run(robot, {"gmo_cqp": constrained}, 2.0)
    good = constrained.estimate()
    constrained._solver = WrenchSolver(ContactConstraints(), max_iterations=1)
    run(robot, {"gmo_cqp": constrained}, TICK_S)
    repeated = constrained.estimate()
    assert repeated.stale and not good.stale
    np.testing.assert_array_equal(repeated.force_estimated_n, good.force_estimated_n)


@pytest.mark.parametrize("name", MODEL_BASED_NAMES)
def test_without_any_good_estimate_the_error_is_raised(name: str) -> None:
    robot = StandingRobot()
    estimator = make(robot)[name]
    inputs = robot.tick()
    estimator.observe(replace(inputs, sensor=replace(inputs.sensor, joint_torque=np.full(JOINT_COUNT, np.nan))))
    with pytest.raises(WrenchProjectionError, match="not finite"):
        estimator.estimate()
    estimator.reset()
    with pytest.raises(RuntimeError, match="observe"):
        estimator.estimate()


def test_reset_forgets_the_masses() -> None:
    robot = StandingRobot(1.2, 1.2)
    estimator = make(robot)["adaptive"]
    wave_arm(robot, {"adaptive": estimator}, 3.0)
    learned = estimator.estimate().mass_scale
    assert learned is not None and learned > 1.1
    estimator.reset()
    run(robot, {"adaptive": estimator}, 0.1)
    assert estimator.estimate().mass_scale == pytest.approx(1.0)


def test_against_the_truth_of_a_heavier_simulated_robot_that_drives() -> None:
    session = Simulation(SimulationConfig(seed=77))
    session.set_mismatch(1.2)
    session.reset()
    session.add_wrench(force_n=[6.0, 0.0, 10.0], duration_s=10.0, ramp_s=0.5)
    command = replace(DEFAULT_COMMAND, base_velocity=np.array([0.3, 0.0, 0.0]))
    errors: dict[str, list[float]] = {name: [] for name in ("gmo_pi", "gmo_cqp", "adaptive")}
    for tick in range(1500):
        session.tick(command)
        if tick > 500 and tick % 10 == 9:
            truth = session.truth()
            for name, squares in errors.items():
                error = session.output.estimates[name].force_estimated_n - truth.force_true_n
                squares.append(float(error @ error))
    rms = {name: np.sqrt(np.mean(squares)) for name, squares in errors.items()}
    assert rms["adaptive"] < 1.5
    assert rms["adaptive"] < rms["gmo_cqp"] < rms["gmo_pi"]
    adaptive = session.output.estimates["adaptive"]
    assert adaptive.mass_scale == pytest.approx(1.2, abs=0.05)
    assert adaptive.wheel_forces_in_heading.shape == (len(LEGS), 3)


def test_base_state_tracks_a_driving_robot_without_truth() -> None:
    session = Simulation(SimulationConfig(seed=5))
    model = RobotModel()
    estimator = BaseStateEstimator(BaseStateConfig(), model)
    command = replace(DEFAULT_COMMAND, base_velocity=np.array([0.4, 0.0, 0.3]))
    errors = []
    for _ in range(1000):
        session.tick(command)
        base = estimator.step(session.backend.read())
        truth = session.truth()
        velocity_error = base.rotation_base_to_world @ base.linear_velocity_in_base - truth.base_linear_velocity
        errors.append([*velocity_error, base.height_m - truth.base_position[2]])
    settled = np.abs(errors[250:]).max(axis=0)
    assert (settled < [0.25, 0.25, 0.25, 0.01]).all()
