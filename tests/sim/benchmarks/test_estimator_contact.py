"""Contact trials: the hand meets what is there, the truth is what the contact does, and what does not count is said."""

import numpy as np
import pytest

from sim.benchmarks.estimator_contact import contact_rows
from sim.benchmarks.estimator_contact_tasks import APPROACH_S, BOX_FRICTION, BOX_MASS_KG, TASKS
from sim.benchmarks.estimator_contact_trials import AFTER_TOUCH_S, ContactPlan, ContactTrial, run_contact_trial

pytestmark = pytest.mark.slow
PRESS, PUSH, SLIDE = range(3)


@pytest.fixture(scope="module")
def press() -> ContactTrial:
    return run_contact_trial(ContactPlan(PRESS, True, 1.0, seed=1, duration_s=4.0))


@pytest.fixture(scope="module")
def slide() -> ContactTrial:
    return run_contact_trial(ContactPlan(SLIDE, True, 1.0, seed=1, duration_s=5.0))


@pytest.mark.parametrize("task", range(len(TASKS)), ids=[task.name for task in TASKS])
def test_nothing_touches_the_hand_before_the_task(task: int) -> None:
    trial = run_contact_trial(ContactPlan(task, True, 1.0, seed=1, duration_s=APPROACH_S))
    assert trial.failure == "no contact" and not trial.scores


def test_pressing_a_table_is_scored_after_the_first_touch(press: ContactTrial) -> None:
    assert press.failure == "" and press.contact_share == 1.0
    assert press.time_s[0] > APPROACH_S + AFTER_TOUCH_S
    assert press.force_true_n[:, 2].mean() > 4.0
    assert all(len(score.error) == len(press.time_s) for score in press.scores.values())
    assert press.scores["adaptive"].rmse_vector_n < 2.0 and press.ripple_n < 1.0


def test_a_sliding_box_answers_with_its_friction(slide: ContactTrial) -> None:
    x, _, z = slide.force_true_n[-50:].mean(axis=0)
    # The tool's friction carries some of the box's weight, or adds to it: mu (m g + f_z) with f_z up on the robot.
    assert -x == pytest.approx(BOX_FRICTION * (BOX_MASS_KG * 9.81 + z), rel=0.1)


def test_rigid_surfaces_ripple_more_than_padded_ones(slide: ContactTrial) -> None:
    rigid = run_contact_trial(ContactPlan(SLIDE, False, 1.0, seed=1, duration_s=4.0))
    assert rigid.ripple_n > 5.0 * slide.ripple_n


def test_other_parts_may_not_touch(monkeypatch: pytest.MonkeyPatch) -> None:
    low = "sim.benchmarks.estimator_contact_tasks.WALL_X_M"
    monkeypatch.setattr(low, 0.35)  # in the trunk
    assert run_contact_trial(ContactPlan(PUSH, True, 1.0, seed=1, duration_s=0.2)).failure == "contact"


def test_failures_are_counted_and_not_averaged(press: ContactTrial) -> None:
    bad = ContactTrial(press.plan, "fall", {}, 0.0, 0.0, 0.0, np.zeros(0), np.zeros((0, 3)))
    rows = contact_rows("press table", "padded", 1.0, [press, bad])
    assert rows[0]["trials"] == 1 and rows[0]["failed"] == 1
    assert rows[0]["rmse_vector_n"] == pytest.approx(press.scores["gmo_pi"].rmse_vector_n)
    assert contact_rows("press table", "padded", 1.0, [bad]) == []
