"""Ablations: with no switch turned each is the original, and every switch changes what it says."""

from dataclasses import replace

import numpy as np
import pytest

from sim.benchmarks.estimator_ablations import ABLATIONS, ADAPTIVE, GMO_CQP, Ablation
from sim.benchmarks.estimator_scores import Scores
from sim.benchmarks.estimator_trials import draw_plan, watch
from sim.trials.rollout_runner import RolloutRunner

pytestmark = pytest.mark.slow
SAME = tuple(replace(original, name=f"{original.name}: same") for original in (GMO_CQP, ADAPTIVE))


@pytest.fixture(scope="module")
def scores() -> dict[str, Scores]:
    plan = draw_plan(3, 1, "sine", 1.2, (), duration_s=2.5)
    return watch(RolloutRunner(plan, plan.seed), plan, (*SAME, *ABLATIONS)).scores()


@pytest.mark.parametrize("same", SAME, ids=lambda ablation: ablation.original)
def test_the_same_switches_give_the_original(scores: dict[str, Scores], same: Ablation) -> None:
    np.testing.assert_array_equal(scores[same.name].error, scores[same.original].error)


@pytest.mark.parametrize("ablation", ABLATIONS, ids=lambda ablation: ablation.name)
def test_every_switch_turns_something(scores: dict[str, Scores], ablation: Ablation) -> None:
    assert np.abs(scores[ablation.name].error - scores[ablation.original].error).max() > 0.01


def test_constraints_matter_only_where_a_wheel_leaves_its_cone(scores: dict[str, Scores]) -> None:
    with_and_without = scores["gmo_cqp"].error - scores["gmo_cqp: no constraints"].error
    difference = np.abs(with_and_without).max(axis=1)
    assert difference.min() < 1e-4 and difference.max() > 0.01


def test_the_true_velocity_is_that_of_the_frame() -> None:
    plan = draw_plan(3, 1, "sine", 1.0, (), duration_s=1.6)
    runner = RolloutRunner(plan, plan.seed)
    same = replace(ADAPTIVE, name="adaptive: true velocity", true_velocity=True)
    # The velocities differ by the filter's error alone: the estimates stay close, so frame, sign and time fit.
    errors = watch(runner, plan, (same,)).scores()
    assert np.abs(errors[same.name].error - errors["adaptive"].error).max() < 1.5
