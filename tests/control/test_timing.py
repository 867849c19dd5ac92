"""The timetable: no tick does the work of two, whichever estimator feeds the controller and however many there are."""

import math
from collections import Counter

import numpy as np
import pytest

import control.pipeline
from control.command.limits import DEFAULT_COMMAND
from control.estimation.force_estimator import EstimatorInput
from control.estimation.registry import LEARNED_NAMES, MODEL_BASED_NAMES
from control.estimation.wrench_qp import WrenchSolver
from control.joints import JOINT_COUNT, LEGS, NOMINAL_POSITION
from control.pipeline import Pipeline, PipelineConfig
from control.timing import (
    CHEAP_JOBS,
    CONTROL_PERIOD_S,
    MOST_ESTIMATORS,
    SLOT_COUNT,
    TICK_S,
    TIMETABLE,
    Job,
    TimetableError,
    due,
    shown_slots,
    slots,
)
from control.types import ForceEstimate, SensorFrame


def test_a_control_period_is_a_whole_number_of_slots() -> None:
    assert len(TIMETABLE) == SLOT_COUNT
    assert math.isclose(SLOT_COUNT * TICK_S, CONTROL_PERIOD_S)


def test_no_slot_carries_two_heavy_jobs_and_every_job_has_a_slot() -> None:
    assert all(len(set(jobs) - CHEAP_JOBS) <= 1 for jobs in TIMETABLE)
    assert all(slots(job) for job in Job)


@pytest.mark.parametrize("job", [Job.CONTROLLER, Job.REFERENCES, Job.ADAPTATION, Job.NETWORK_STEP, Job.LIVE_ERRORS])
def test_what_counts_in_control_periods_runs_once_in_each(job: Job) -> None:
    assert sum(due(job, tick) for tick in range(SLOT_COUNT)) == 1


def test_references_are_there_when_the_controller_runs() -> None:
    assert (slots(Job.REFERENCES)[0] + 1) % SLOT_COUNT == slots(Job.CONTROLLER)[0]


@pytest.mark.parametrize("count", range(1, MOST_ESTIMATORS + 1))
def test_every_estimator_that_is_shown_has_a_slot_of_its_own(count: int) -> None:
    names = [f"estimator_{index}" for index in range(count)]
    for selected in names:
        shown = shown_slots(names, selected)
        assert set(shown) == {*names} - {selected}
        assert len(set(shown.values())) == count - 1
        assert set(shown.values()) <= set(slots(Job.SHOWN_ESTIMATE))


@pytest.mark.parametrize("selected", ["base", "net", "other", "late"])
def test_an_estimator_that_another_ones_estimate_contains_is_shown_with_it(selected: str) -> None:
    shown = shown_slots(["base", "other", "net", "late"], selected, {"net": "base", "late": "base"})
    assert set(shown) == {"base", "other", "net", "late"} - {selected}
    if selected != "base":
        assert shown["base"] in (shown.get("net"), shown.get("late"))
    apart = [slot for name, slot in shown.items() if name != "base"]
    assert len(set(apart)) == len(apart)


@pytest.mark.parametrize("selected", MODEL_BASED_NAMES + LEARNED_NAMES)
def test_the_quadratic_program_is_solved_once_in_a_control_period_for_all_who_need_it(
    selected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    solved: list[int] = []
    solve = WrenchSolver.solve
    monkeypatch.setattr(WrenchSolver, "solve", lambda self, problem: (solved.append(tick), solve(self, problem))[1])
    pipeline = Pipeline(PipelineConfig(controller="model_based", estimator=selected, policies=None))
    for tick in range(5 * SLOT_COUNT):
        pipeline.step(frame(tick * TICK_S), DEFAULT_COMMAND)
    assert len(solved) == (5 * SLOT_COUNT if selected in ("gmo_cqp", "hybrid_paper") else 5)


def test_an_estimator_without_a_slot_is_refused() -> None:
    names = [f"estimator_{index}" for index in range(MOST_ESTIMATORS + 1)]
    with pytest.raises(TimetableError, match=f"for {MOST_ESTIMATORS} estimators.*{names[-1]}"):
        shown_slots(names, names[0])


class Watched:
    """An estimator that notes the ticks in which it works."""

    def __init__(self, ticks: list[int]) -> None:
        self._ticks = ticks

    def reset(self) -> None:
        """Nothing is kept."""

    def observe(self, inputs: EstimatorInput) -> None:
        self._tick = inputs.tick

    def estimate(self) -> ForceEstimate:
        self._ticks.append(self._tick)
        return ForceEstimate(np.zeros(3), np.zeros((len(LEGS), 3)))

    def set_gains(self, k1: float, k2: float) -> None:
        """There are none."""


def frame(time_s: float) -> SensorFrame:
    zero = np.zeros(JOINT_COUNT)
    attitude, gravity = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 9.81])
    return SensorFrame(time_s, attitude, np.zeros(3), gravity, NOMINAL_POSITION, zero, zero)


def test_a_seventh_estimator_is_shown_and_shares_its_tick_with_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    worked: dict[str, list[int]] = {f"estimator_{index}": [] for index in range(MOST_ESTIMATORS)}
    estimators = {name: Watched(ticks) for name, ticks in worked.items()}
    monkeypatch.setattr(control.pipeline, "make_estimators", lambda model, config: estimators)
    pipeline = Pipeline(PipelineConfig(controller="model_based", estimator="estimator_2", policies=None))
    tick = 0
    for selected in ("estimator_2", "estimator_6", "estimator_0"):
        pipeline.select_estimator(selected)
        for ticks in worked.values():
            ticks.clear()
        for _ in range(3 * SLOT_COUNT):
            pipeline.step(frame(tick * TICK_S), DEFAULT_COMMAND)
            tick += 1
        assert len(worked[selected]) == 3 * SLOT_COUNT
        shown = {name: ticks for name, ticks in worked.items() if name != selected}
        assert {len(ticks) for ticks in shown.values()} == {3}
        jobs = Counter(tick for ticks in shown.values() for tick in ticks)
        assert max(jobs.values()) == 1
        assert all(due(Job.SHOWN_ESTIMATE, tick) for tick in jobs)
