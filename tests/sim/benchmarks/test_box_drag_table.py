"""Table II and what stands beside it: errors with their deviation, estimates with their lag, how far a training got."""

import numpy as np
import pytest

from control.baselines.baseline_weights import METHODS, BaselineManifest, baseline_interface
from control.timing import CONTROL_PERIOD_S
from sim.benchmarks.box_drag import summary
from sim.benchmarks.box_drag_table import estimate_row, lag_s, table_two, training_row
from sim.trials.box_drag import DragResult, DragTrace
from sim.trials.trial import TrialSetup


def trace(own_lag_s: float | None) -> DragTrace:
    """Ten seconds of a swinging lateral force; what feeds the controller is 1 N off, the controller's own is late."""
    time_s = CONTROL_PERIOD_S * np.arange(500)

    def swinging(at_s: np.ndarray) -> np.ndarray:
        return np.stack([0.0 * at_s, 8.0 * np.sin(2.0 * np.pi * 0.2 * at_s), 20.0 + 0.0 * at_s], axis=1)

    true = swinging(time_s)
    own = None if own_lag_s is None else swinging(time_s - own_lag_s)
    return DragTrace(time_s, true, true, true + [0.0, 0.0, 1.0], own)


@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.42])
def test_the_lag_of_an_estimate_is_found_whatever_its_bias(late_s: float):
    late = trace(late_s)
    assert late.own is not None
    assert lag_s(late.own[:, 1] + 3.0, late.true[:, 1]) == pytest.approx(late_s, abs=1e-9)


def test_own_and_fed_estimates_are_judged_on_the_same_drags():
    row = estimate_row([trace(0.1), trace(0.1)])
    assert row["estimate_fed_rmse_n"] == pytest.approx(1.0)
    assert row["estimate_fed_lag_s"] == 0.0
    assert row["estimate_own_lag_s"] == pytest.approx(0.1)
    assert estimate_row([trace(None)])["estimate_own_rmse_n"] is None


def test_the_table_reads_as_the_papers_and_says_how_far_training_got():
    results = [DragResult(1.0, 2.0, -0.2, 0.21, True, trace(None)), DragResult(1.2, 2.0, -0.2, 0.21, False, trace(None))]
    manifest = BaselineManifest("zhi", "zhi", baseline_interface(METHODS["zhi"]), training={"steps": 5000, "ppo_iterations": 3})
    row = summary(TrialSetup("zhi"), results) | training_row(manifest)
    assert (row["environment_steps"], row["learning_curve"]) == (5000, "not flattened")
    head, line = table_two([row]).splitlines()
    assert "e_y [N]" in head
    for cell in ("zhi", "1.10 ± 0.14", "2.00 ± 0.00", "[-0.200, 0.210]", "1 of 2", "not flattened"):
        assert cell in line
    assert training_row(None) == {}
