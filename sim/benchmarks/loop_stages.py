"""What a tick consists of: every job of the timetable and every stage that runs at each tick, with its cost and its slots."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.estimation.adaptive_estimator import AdaptiveEstimator
from control.pipeline import Pipeline
from control.timing import CONTROL_PERIOD_S, SLOT_COUNT, TIMETABLE, Job, due
from sim.backends.simulation.ideal_sensors import IdealSensors
from sim.backends.simulation.sensors import SensorModel
from sim.benchmarks.loop_headless import ESTIMATOR, ready_session
from sim.benchmarks.report import Report
from sim.runtime.history import History
from sim.runtime.simulation import Simulation
from sim.runtime.snapshot import SETPOINT, SNAPSHOT

EVERY_TICK = "every tick"


class Stopwatch:
    """Time spent in functions, less what others that are also watched take within them.

    Attributes:
        tick: number of the tick that runs.
        spent_us: by stage, and by the number of each tick in which it ran.
    """

    def __init__(self) -> None:
        self.tick = 0
        self.spent_us: dict[str, dict[int, float]] = {}
        self._within_s = [0.0]

    def watched(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """`function`, whose time counts as that of a stage."""

        def timed(*arguments: Any, **named: Any) -> Any:
            self._within_s.append(0.0)
            start = time.perf_counter()
            try:
                return function(*arguments, **named)
            finally:
                duration = time.perf_counter() - start
                own = duration - self._within_s.pop()
                self._within_s[-1] += duration
                spent = self.spent_us.setdefault(stage, {})
                spent[self.tick] = spent.get(self.tick, 0.0) + 1e6 * own

        return timed


Stage = tuple[str, str, Any, str]
"""Name, the job that it is or EVERY_TICK, and the object and name of the function that carries it out."""


def watched_stages(session: Simulation) -> list[Stage]:
    """All that is watched."""
    pipeline = session.pipeline
    stages: list[Stage] = [
        ("mj_step", EVERY_TICK, mujoco, "mj_step"),
        ("ideal sensors", EVERY_TICK, IdealSensors, "read"),
        ("sensor errors", EVERY_TICK, SensorModel, "measure"),
        ("drives and the rest of the backend", EVERY_TICK, session.backend, "write"),
        ("base state", EVERY_TICK, pipeline._base_state, "step"),
        ("model terms", EVERY_TICK, pipeline.model, "update_velocity"),
        ("safety gate", EVERY_TICK, pipeline._safety, "step"),
        ("rest of the pipeline", EVERY_TICK, Pipeline, "step"),
        ("controller", Job.CONTROLLER.name, Pipeline, "_control"),
        ("references", Job.REFERENCES.name, Pipeline, "_refer"),
        ("adaptation", Job.ADAPTATION.name, AdaptiveEstimator, "_adapt"),
        (f"network of {ESTIMATOR}", Job.NETWORK_STEP.name, pipeline.estimators[ESTIMATOR], "_step"),
        ("snapshot", Job.SNAPSHOT.name, session, "fill"),
        ("live errors", Job.LIVE_ERRORS.name, session, "track_errors"),
        ("history", EVERY_TICK, History, "ticked"),
        ("history's kept moment", Job.KEPT_MOMENT.name, History, "_keep"),
    ]
    for name, estimator in pipeline.estimators.items():
        # What the selected estimator rests on is estimated at every tick too.
        shown = name in pipeline.shown_slots and name != pipeline.bases.get(ESTIMATOR)
        stages.append((f"observer of {name}", EVERY_TICK, estimator, "observe"))
        stages.append((f"estimate of {name}", Job.SHOWN_ESTIMATE.name if shown else EVERY_TICK, estimator, "estimate"))
    return stages


def measure(session: Simulation, ticks: int) -> tuple[dict[str, dict[int, float]], np.ndarray]:
    """See Stopwatch.spent_us; and the whole duration (ticks,), us, of each tick with its jobs."""
    stopwatch, record, whole = Stopwatch(), np.zeros(1, SNAPSHOT)[0], np.empty(ticks)
    history, setpoint = History(session), np.zeros(1, SETPOINT)[0]
    history.ticked(setpoint, 0.0)  # the first moment is kept at once
    with ExitStack() as patches:
        for name, _, target, function in watched_stages(session):
            patches.enter_context(patch.object(target, function, stopwatch.watched(name, getattr(target, function))))
        for tick in range(ticks):
            stopwatch.tick = tick
            start = time.perf_counter()
            session.tick(DEFAULT_COMMAND)
            history.ticked(setpoint, 0.0)
            if due(Job.LIVE_ERRORS, tick):
                session.track_errors(CONTROL_PERIOD_S)
            if due(Job.SNAPSHOT, tick):
                session.fill(record)
            whole[tick] = 1e6 * (time.perf_counter() - start)
    return stopwatch.spent_us, whole


def stages(report: Report, ticks: int) -> None:
    """Add a row for each stage and for each slot. The stopwatch itself costs about a microsecond per stage."""
    session = ready_session(report.seed)
    jobs = {name: job for name, job, _, _ in watched_stages(session)}
    spent_us, whole_us = measure(session, ticks)
    for name, job in jobs.items():
        spent = spent_us.get(name, {})
        ran = sorted({tick % SLOT_COUNT for tick in spent})
        durations = np.array([*spent.values()] or [np.nan])
        _add(report, "stage", name, job, "all" if len(ran) == SLOT_COUNT else " ".join(map(str, ran)), durations)
    for slot, names in enumerate(TIMETABLE):
        shown = [name for name, own in session.pipeline.shown_slots.items() if own == slot]
        text = " ".join([*(job.name for job in names), *shown])
        _add(report, "slot", f"slot {slot}", text, str(slot), whole_us[slot::SLOT_COUNT])


def _add(report: Report, case: str, metric: str, job: str, ran: str, durations: np.ndarray) -> None:
    p50, p99 = np.percentile(durations, [50, 99])
    report.rows.append(
        {
            "case": case,
            "metric": metric,
            "job": job,
            "slots": ran,
            "p50": float(p50),
            "p99": float(p99),
            "max": float(durations.max()),
            "unit": "us",
        }
    )
