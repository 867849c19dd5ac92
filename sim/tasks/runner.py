"""Plays one task phase by phase, and backs off where it goes wrong."""

from dataclasses import replace
from enum import IntEnum

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.faults import Fault
from control.types import Command
from sim.tasks.task import Phase, Task
from sim.tasks.view import TaskView

BACK_OFF_M = 0.08
BACK_OFF_S = 1.5
BIAS_N = 5.0
"""A resting hand that reads more is held, or touches something, and is not tared."""
FELT_N = 2.0
"""Of a contact whose direction is worth remembering."""
LEANING = 0.98
"""Cosine of a tilt at which a task stops: 0.2 rad."""
NEAREST_M = np.array([0.42, -0.30, 0.30])
FARTHEST_M = np.array([0.72, 0.30, 0.80])
"""Box in heading that backing off does not leave: beyond it the arm comes near the robot, or stretches out."""


class Outcome(IntEnum):
    """How far a task has come. What is not RUNNING is final."""

    RUNNING = 0
    SUCCEEDED = 1
    FAILED = 2
    ABORTED = 3


class TaskRunner:
    """One task at work.

    Attributes:
        task: that is played.
        phase: name of the phase, "back off" while it backs off.
        outcome: so far.
        reason: of a failure, or why it was aborted; empty otherwise.
        moving: whether commands still change; after that the last one holds.
        peak_n: largest estimated force.
        tare_due: what the hand reads now is to become its zero; whoever sees to that sets it back.
    """

    STATE = (
        "outcome",
        "reason",
        "moving",
        "peak_n",
        "tare_due",
        "phase",
        "_phase",
        "_begun_s",
        "_started_s",
        "_seen_s",
        "_done_before",
        "_wrong_since_s",
        "_normal",
        "_back_off",
        "_command",
    )

    def __init__(self, task: Task, view: TaskView) -> None:
        self.task = task
        self.outcome, self.reason, self.moving = Outcome.RUNNING, "", True
        self.peak_n, self.phase, self.tare_due = 0.0, "", False
        self._phases = task.phases()
        self._phase: Phase | None = None
        self._begun_s = self._started_s = self._seen_s = view.time_s
        self._done_before = 0.0
        self._wrong_since_s: float | None = None
        self._normal = np.zeros(3)
        self._back_off: Command | None = None
        self._command = replace(DEFAULT_COMMAND, position_m=view.hand_in_heading_m.copy())
        self._next(view)

    @property
    def elapsed_s(self) -> float:
        """Since it began."""
        return self._seen_s - self._started_s

    @property
    def progress(self) -> float:
        """Share, 0 to 1, of the way to success."""
        if self._phase is None:
            return 1.0 if self.outcome == Outcome.SUCCEEDED else self._done_before
        share = min(1.0, (self._seen_s - self._begun_s) / self._phase.limit_s)
        return self._done_before + share * (self._phase.until - self._done_before)

    def step(self, view: TaskView) -> Command:
        """The command of the next control period."""
        self._seen_s = view.time_s
        size = float(np.linalg.norm(view.force_in_heading_n))
        self.peak_n = max(self.peak_n, size)
        if size > FELT_N:
            self._normal = view.force_in_heading_n / size
        if self._phase is not None:
            self._advance(replace(view, phase_s=view.time_s - self._begun_s))
        elif self._back_off is not None:
            self._command = self._back_off
            if view.time_s - self._begun_s >= BACK_OFF_S:
                if self.outcome == Outcome.RUNNING:
                    self._next(view)
                else:
                    self.moving = False
        return self._command

    def abort(self, view: TaskView, reason: str) -> None:
        """Stop, back off and hold."""
        if self.outcome == Outcome.RUNNING:
            self._end(view, Outcome.ABORTED, reason)

    def drop(self, reason: str) -> None:
        """Be over at once: there is nothing left to back off from."""
        if self.outcome == Outcome.RUNNING:
            self.outcome, self.reason = Outcome.ABORTED, reason
        self.moving, self._phase, self._back_off = False, None, None

    def _advance(self, view: TaskView) -> None:
        phase = self._phase
        assert phase is not None
        problem = _trouble(view) or phase.wrong(view)
        if problem is None:
            self._wrong_since_s = None
        else:
            self._wrong_since_s = view.time_s if self._wrong_since_s is None else self._wrong_since_s
            if view.damping or view.time_s - self._wrong_since_s >= phase.patience_s:
                self._end(view, Outcome.FAILED, f"{phase.name}: {problem}")
                return
        if phase.done(view) or (phase.late is None and view.phase_s >= phase.limit_s):
            self._done_before = phase.until
            self.tare_due = phase.tares and float(np.linalg.norm(view.force_in_heading_n)) < BIAS_N
            self._next(view)
        elif view.phase_s >= phase.limit_s:
            self._end(view, Outcome.FAILED, f"{phase.name}: {phase.late}")
            return
        if self._phase is not None:
            self._command = self._phase.command(replace(view, phase_s=view.time_s - self._begun_s))

    def _next(self, view: TaskView) -> None:
        self._begun_s, self._wrong_since_s, self._back_off = view.time_s, None, None
        self._phase = next(self._phases, None)
        if self._phase is None:
            self.outcome, self.moving = Outcome.SUCCEEDED, False
            self._command = replace(self._command, mask=np.zeros(3), base_velocity=np.zeros(3), guidance=False)
        else:
            self.phase = self._phase.name

    def _end(self, view: TaskView, outcome: Outcome, reason: str) -> None:
        recover = self._phase.recover if self._phase is not None and outcome == Outcome.FAILED else None
        if recover is not None and not view.damping:
            recover(reason)
        else:
            self.outcome, self.reason = outcome, reason
        self.phase, self._phase, self._begun_s = "back off", None, view.time_s
        place = np.clip(view.hand_in_heading_m + BACK_OFF_M * self._normal, NEAREST_M, FARTHEST_M)
        orientation = self._command.orientation_wxyz
        self._back_off = replace(DEFAULT_COMMAND, position_m=place, orientation_wxyz=orientation)
        self._command = self._back_off


def _trouble(view: TaskView) -> str | None:
    """What stops any task."""
    if view.damping:
        return "the drives damp"
    if view.faults & Fault.STALE_SETPOINT:
        return "the operator's side has fallen silent"
    if view.up < LEANING:
        return "the robot leans"
    return None
