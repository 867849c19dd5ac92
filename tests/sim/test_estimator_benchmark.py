"""The estimator benchmark's own arithmetic, and one short trial end to end."""

from argparse import Namespace
from dataclasses import replace

import numpy as np
import pytest

from sim.benchmarks import estimator
from sim.benchmarks.estimator import coverage, draw_plan, rows_of, run_plan
from sim.benchmarks.estimator_trials import Scores, Trial, run_trial
from sim.benchmarks.report import Report
from sim.rollout_plans import RolloutPlan
from sim.rollout_runner import ATTEMPTS, RejectedError

ARGUMENTS = Namespace(seed=3, profile="hold", per_link=False, quick=True)


def scores(error: list[float], sigma: float = float("nan")) -> Scores:
    return Scores(np.tile(error, (5, 1)), np.full((5, 3), sigma))


def trial(**by_name: Scores) -> Trial:
    return Trial(by_name, 10.0, 15.0, np.zeros((5, 3)), {})


def test_rows_hold_rmse_spread_and_ratio() -> None:
    trials = [
        trial(gmo_cqp=scores([3.0, 0.0, 4.0]), adaptive=scores([1.0, 0.0, 0.0])),
        trial(gmo_cqp=scores([3.0, 0.0, 4.0]), adaptive=scores([0.0, 0.0, -2.0])),
    ]
    reference, adaptive = rows_of(trials, 4, "hold", 0.8, False)
    assert reference["rmse_vector_n"] == pytest.approx(5.0)
    assert reference["ratio_to_gmo_cqp"] == pytest.approx(1.0)
    assert adaptive["rmse_vector_n"] == pytest.approx(1.5)
    assert adaptive["rmse_x_n"] == pytest.approx(0.5) and adaptive["rmse_z_n"] == pytest.approx(1.0)
    assert adaptive["sd_n"] == pytest.approx(np.sqrt(0.5))
    assert adaptive["ratio_to_gmo_cqp"] == pytest.approx(0.3)
    assert adaptive["rejected"] == 4 and adaptive["coverage_2sigma"] is None


def test_coverage_counts_errors_within_two_sigma() -> None:
    assert coverage([scores([1.0, 3.0, -1.9], sigma=1.0)]) == pytest.approx(2 / 3)


def test_plans_repeat_and_share_their_draws_across_mass_scales() -> None:
    light, heavy = draw_plan(ARGUMENTS, 0.8, 2), draw_plan(ARGUMENTS, 1.2, 2)
    assert light == draw_plan(ARGUMENTS, 0.8, 2)
    assert replace(light, mass_scale=1.2) == heavy
    assert draw_plan(ARGUMENTS, 0.8, 3).seed - light.seed >= ATTEMPTS


def test_rejected_rollouts_are_drawn_again_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []

    def falls_twice(plan: RolloutPlan) -> Trial:
        seeds.append(plan.seed)
        if len(seeds) < 3:
            raise RejectedError("fall")
        return trial(adaptive=scores([0.0, 0.0, 0.0]))

    monkeypatch.setattr(estimator, "run_trial", falls_twice)
    kept, rejected = run_plan(draw_plan(ARGUMENTS, 1.0, 0), Report("estimator", 3))
    assert kept is not None and rejected == 2
    assert len(set(seeds)) == 3


def test_a_trial_scores_every_estimator_against_the_force_that_acted() -> None:
    plan = replace(draw_plan(ARGUMENTS, 1.0, 0), duration_s=2.5)
    result = run_trial(plan)
    assert {"gmo_pi", "gmo_cqp", "adaptive"} <= set(result.scores)
    for score in result.scores.values():
        assert len(score.error) >= 70
        assert 0.0 < score.rmse_vector_n < 15.0
    assert result.scores["adaptive"].rmse_vector_n < result.scores["gmo_cqp"].rmse_vector_n + 1.0
    assert np.abs(result.force_true).max() > 1.0
