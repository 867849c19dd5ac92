"""The trust benchmark's bookkeeping, and one short trial of each case on the real stack."""

import math

import numpy as np
import pytest

from sim.benchmarks.trust import LIMITS, STOP_CASE, bars, plans, play, rows_of, stop_metrics, summaries
from sim.trials.trial import TrialSetup


def test_every_trial_of_a_mass_has_its_own_seed_and_masses_share_them():
    light, heavy = TrialSetup(mass_scale=0.8), TrialSetup(mass_scale=1.2)
    planned = plans([light, heavy], seed=50, repeats=3, quick=False)
    seeds = [[plan.seed for plan in planned if plan.setup is setup] for setup in (light, heavy)]
    assert seeds[0] == seeds[1] == list(range(50, 50 + len(seeds[0])))


def test_errors_at_a_stop_are_told_as_vector_rmse_and_as_share_within_two_sigma():
    errors = np.array([[0.0, 3.0, 4.0], [0.0, 0.0, 0.0]])
    metrics = stop_metrics(errors, np.full((2, 3), 1.75))
    assert metrics["estimate, RMSE"][0] == pytest.approx(math.sqrt(12.5))
    assert metrics["axes within 2 sigma"][0] == pytest.approx(5 / 6)
    assert metrics["control periods"][0] == 2.0
    assert math.isnan(stop_metrics(np.empty((0, 3)), np.empty((0, 3)))["estimate, RMSE"][0])


def test_quick_trials_tell_everything_that_has_a_bar_and_its_worst_decides():
    planned = plans([TrialSetup()], seed=1000, repeats=1, quick=True)
    rows, stopped = [], []
    for number, plan in enumerate(planned):
        _, result = play((number, plan))
        if isinstance(result, dict):
            rows += rows_of(plan, result)
        else:
            stopped.append(result)
    assert sum(len(errors) for errors, _ in stopped) > 0
    assert set(LIMITS) <= {row["metric"] for row in rows}
    together = stop_metrics(*(np.concatenate(part) for part in zip(*stopped, strict=True)))
    assert all(bar.holds for bar in bars("model_based", rows, together))
    rows.append(rows[0] | {"value": 2.0 * LIMITS[str(rows[0]["metric"])]})
    assert [bar.holds for bar in bars("model_based", rows, together)].count(False) == 1
    assert all(row["case"] != STOP_CASE for row in summaries(rows))
    assert summaries(rows)[0]["trials"] == 2
