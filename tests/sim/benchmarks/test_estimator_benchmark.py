"""The estimator benchmark: its table, its bars, its plans, and one short trial end to end."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.benchmarks.estimator import cell_plans, parse
from sim.benchmarks.estimator_plots import plot_bars, plot_force_over_time
from sim.benchmarks.estimator_rows import Cell, cell_bars, cell_rows, coverage_bars
from sim.benchmarks.estimator_scores import Scores
from sim.benchmarks.estimator_trials import RolloutTrial, draw_plan, run_trial
from sim.trials.rollout_runner import ATTEMPTS, RejectedError, RolloutRunner

CELL = Cell("hold", 0.8, per_link=False)
PLAN = draw_plan(3, 0, "hold", 1.0, (), duration_s=2.5)


def scores(error: list[float], sigma: float = float("nan")) -> Scores:
    return Scores(np.tile(error, (5, 1)), np.full((5, 3), sigma))


def trial(rejected: tuple[str, ...] = (), **by_name: Scores) -> RolloutTrial:
    lag_only = {"gmo_cqp": 4.0, "adaptive": 0.5, "hybrid": 0.5}
    return RolloutTrial(PLAN, rejected, by_name, np.zeros((5, 3)), 10.0, 15.0, {name: lag_only[name] for name in by_name})


def test_rows_hold_rmse_spread_and_ratio() -> None:
    trials = [
        trial(("fall",) * 3, gmo_cqp=scores([3.0, 0.0, 4.0]), adaptive=scores([1.0, 0.0, 0.0])),
        trial(("contact",), gmo_cqp=scores([3.0, 0.0, 4.0]), adaptive=scores([0.0, 0.0, -2.0])),
    ]
    reference, adaptive = cell_rows(CELL, trials)
    assert reference["rmse_vector_n"] == pytest.approx(5.0)
    assert reference["ratio_to_gmo_cqp"] == pytest.approx(1.0)
    assert adaptive["rmse_vector_n"] == pytest.approx(1.5)
    assert adaptive["rmse_x_n"] == pytest.approx(0.5) and adaptive["rmse_z_n"] == pytest.approx(1.0)
    assert adaptive["sd_n"] == pytest.approx(np.sqrt(0.5))
    assert adaptive["ratio_to_gmo_cqp"] == pytest.approx(0.3)
    assert adaptive["lag_only_n"] == pytest.approx(0.5)
    assert adaptive["rejected"] == 4 and adaptive["coverage_2sigma"] is None


def test_a_rollout_that_was_given_up_counts_as_rejected_only() -> None:
    rows = cell_rows(CELL, [trial(("fall",) * ATTEMPTS), trial(gmo_cqp=scores([0.0, 0.0, 1.0]))])
    assert rows[0]["rollouts"] == 1 and rows[0]["rejected"] == ATTEMPTS
    assert cell_rows(CELL, [trial(("fall",) * ATTEMPTS)]) == []


def test_bars_say_when_learning_harms_and_when_sigma_is_wrong() -> None:
    def row(name: str, rmse: float, covered: float, ratio: float) -> dict[str, str | int | float | bool | None]:
        return {
            "estimator": name,
            "rmse_vector_n": rmse,
            "coverage_2sigma": covered,
            "ratio_to_original": ratio,
            "ratio_to_gmo_cqp": ratio,
        }

    bars = cell_bars(CELL, [row("hybrid", 0.7, 0.99, 1.1), row("hybrid_paper", 3.0, 0.0, 0.4)])
    held = [bar.holds for bar in bars]
    assert held == [True, False, True, False, True]
    assert cell_bars(CELL, []) == []
    per_link = cell_bars(Cell("sine", 1.0, per_link=True), [row("hybrid", 1.1, 0.95, 1.0)])
    assert per_link[0].limit == 1.2 and all(bar.holds for bar in per_link)


def test_sigma_is_judged_over_all_rollouts_of_a_run() -> None:
    # Half of one robot's errors lie within two sigma, all of the other's: 75 %, and 25 points to either side of it.
    half = Scores(np.repeat([[3.0] * 3, [1.0] * 3], 5, axis=0), np.ones((10, 3)))
    sure = replace(half, error=np.zeros((10, 3)))
    trials = [trial(gmo_cqp=half, hybrid=half), trial(gmo_cqp=half, hybrid=sure), trial(("fall",) * ATTEMPTS)]
    low, high = coverage_bars(trials)
    assert low.value == high.value == pytest.approx(0.75)
    assert not low.holds and high.holds
    hybrid = next(row for row in cell_rows(CELL, trials) if row["estimator"] == "hybrid")
    assert hybrid["coverage_2sigma_se"] == pytest.approx(0.25)
    assert coverage_bars([trial(("fall",) * ATTEMPTS)]) == []


def test_plans_repeat_and_share_their_draws_across_mass_scales() -> None:
    light, heavy = (draw_plan(3, 2, "hold", scale, ("base", "arm_link1"), 20.0) for scale in (0.8, 1.2))
    assert light == draw_plan(3, 2, "hold", 0.8, ("base", "arm_link1"), 20.0)
    assert replace(light, mass_scale=1.2) == heavy and set(light.per_link) == {"base", "arm_link1"}
    assert draw_plan(3, 3, "hold", 0.8, (), 20.0).seed - light.seed >= ATTEMPTS


def test_the_command_line_names_every_cell() -> None:
    plans = cell_plans(parse(["--profile", "hold", "slow", "--rollouts", "3"]))
    assert len(plans) == 6 and all(len(cell) == 3 for cell in plans.values())
    (cell,) = cell_plans(parse(["--per-link", "--quick"]))
    assert cell == Cell("hold", 1.0, per_link=True)


def test_rejected_rollouts_are_drawn_again_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []

    class FallsTwice(RolloutRunner):
        def __init__(self, plan, seed) -> None:
            seeds.append(seed)
            if len(seeds) < 3:
                raise RejectedError("fall")
            super().__init__(plan, seed)

    monkeypatch.setattr("sim.benchmarks.estimator_trials.RolloutRunner", FallsTwice)
    kept = run_trial(replace(PLAN, duration_s=1.1))
    assert kept.rejected == ("fall", "fall") and kept.scores
    assert seeds == [PLAN.seed, PLAN.seed + 1, PLAN.seed + 2]


@pytest.mark.slow
def test_a_trial_scores_every_estimator_against_the_force_that_acted(tmp_path: Path) -> None:
    result = run_trial(PLAN)
    assert {"gmo_pi", "gmo_cqp", "adaptive"} <= set(result.scores)
    for score in result.scores.values():
        assert len(score.error) == len(result.force_true_n) == 75
        assert 0.0 < score.rmse_vector_n < 15.0
    assert result.scores["adaptive"].rmse_vector_n < result.scores["gmo_cqp"].rmse_vector_n + 1.0
    assert np.abs(result.force_true_n).max() > 1.0
    assert 0.0 < result.lag_only_n["adaptive"] < 0.3 * result.lag_only_n["gmo_cqp"]

    pytest.importorskip("matplotlib")
    plot_bars(tmp_path, cell_rows(CELL, [result]))
    plot_force_over_time(tmp_path, [result])
    assert {path.name for path in tmp_path.iterdir()} == {"estimator_bars.png", "estimator_force_z_hold.png"}
