"""Robustness trials: each disturbance is really there, and recovery is timed as its closed form says."""

import numpy as np
import pytest

from control.estimation.momentum_observer import PAPER_GAINS
from control.timing import CONTROL_PERIOD_S, SLOT_COUNT, TICK_S
from sim.benchmarks.estimator_robustness import case_rows
from sim.benchmarks.estimator_robustness_trials import (
    CASES,
    RECOVERED_N,
    SLOPE_RAD,
    STEP_N,
    STEP_S,
    TORQUE_SCALE_STD,
    RobustnessPlan,
    forward,
    recovery_time,
    run_robustness_trial,
    step_force,
)
from sim.benchmarks.estimator_scores import lag_only_error
from sim.benchmarks.estimator_trials import draw_plan
from sim.trials.rollout_runner import RolloutRunner

pytestmark = pytest.mark.slow
NUMBER = {case.name: number for number, case in enumerate(CASES)}


def test_recovery_of_the_paper_observer_is_that_of_its_transfer_function() -> None:
    force = np.zeros((2000, 3))
    force[:, 2] = STEP_N
    error = lag_only_error(force, PAPER_GAINS, TICK_S)[::SLOT_COUNT]
    # 1 - y(t) = exp(-z w t) (cos d t + z / sqrt(1 - z^2) sin d t), the step response of a second-order lag.
    time, zeta, omega = CONTROL_PERIOD_S * np.arange(200), PAPER_GAINS.damping_ratio, PAPER_GAINS.natural_frequency
    damped = omega * np.sqrt(1.0 - zeta**2)
    left = np.exp(-zeta * omega * time) * (np.cos(damped * time) + zeta * omega / damped * np.sin(damped * time))
    expected = time[np.flatnonzero(np.abs(left) > RECOVERED_N / STEP_N)[-1]] + CONTROL_PERIOD_S
    assert recovery_time(error) == pytest.approx(expected, abs=1.5 * CONTROL_PERIOD_S)


def test_recovery_needs_to_last() -> None:
    error = np.zeros((10, 3))
    assert recovery_time(error) == 0.0
    error[6, 1] = 1.1 * RECOVERED_N
    assert recovery_time(error) == pytest.approx(7 * CONTROL_PERIOD_S)
    error[9, 0] = -1.1 * RECOVERED_N
    assert recovery_time(error) is None


def test_a_step_is_scored_from_its_first_tick_on() -> None:
    trial = run_robustness_trial(RobustnessPlan(NUMBER["20 N step"], 0, seed=3))
    assert np.linalg.norm(trial.scores["gmo_cqp"].error[0]) == pytest.approx(STEP_N, rel=0.15)
    fast, slow = trial.recovery_s["adaptive"], trial.recovery_s["gmo_cqp"]
    assert fast is not None and slow is not None and fast < 0.5 * slow
    (row,) = (row for row in case_rows("20 N step", [trial]) if row["estimator"] == "adaptive")
    assert row["recovery_s"] == fast and row["recovered"] == 1
    assert not step_force(0, STEP_S).samples.any()


def test_sensor_cases_change_what_they_name() -> None:
    plan = draw_plan(3, 0, "hold", 1.0, (), 1.0)
    assert CASES[NUMBER["torque constants off by 5 %"]].change(plan).sensors.joint_torque_scale_std == TORQUE_SCALE_STD
    assert CASES[NUMBER["torques 10 ms late"]].change(plan).sensors.torque_delay_ticks * TICK_S == pytest.approx(0.01)


def test_the_robot_drives_up_the_slope() -> None:
    plan, case = draw_plan(3, 0, "slow", 1.0, (), 6.0), CASES[NUMBER["on a 10 degree slope"]]
    runner = RolloutRunner(plan, plan.seed, case.scene(), forward)
    for _ in runner.ticks():
        pass
    assert case.is_scored(runner.backend)
    front, _, rear, _ = runner.backend.truth().wheel_contact_positions
    assert np.arctan((front[2] - rear[2]) / (front[0] - rear[0])) == pytest.approx(SLOPE_RAD, abs=0.03)


def test_bumps_lift_wheels() -> None:
    plan, case = draw_plan(3, 0, "slow", 1.0, (), 4.0), CASES[NUMBER["a wheel lifted"]]
    runner = RolloutRunner(plan, plan.seed, case.scene(), forward)
    lifted = [case.is_scored(runner.backend) for tick in runner.ticks() if tick.index % SLOT_COUNT == 0]
    assert not any(lifted[5:45])  # stands, then drives on the flat
    assert sum(lifted[45:]) > 10


def test_a_case_that_was_never_met_has_no_row() -> None:
    trial = run_robustness_trial(RobustnessPlan(NUMBER["on a 10 degree slope"], 0, seed=3, duration_s=1.2))
    assert not trial.scores and case_rows("on a 10 degree slope", [trial]) == []
