"""Where tasks begin and end: one at a time, in charge of the robot's command until somebody else commands.

A session asks it for the command of every tick. What is asked for while no task is in charge is the operator's.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from control.command.limits import CommandLimits
from control.pipeline import PipelineOutput
from control.timing import TICK_S, Job, due
from control.types import Command
from sim.tasks import TASKS, chosen_options
from sim.tasks.runner import Outcome, TaskRunner
from sim.tasks.standstill import Standstill
from sim.tasks.task import TaskRefusedError
from sim.tasks.view import Site, look

_KEPT = 20
TOOK_OVER = "the operator took over"


@dataclass(slots=True)
class TaskRecord:
    """A task that was begun, and what has become of it."""

    STATE = ("runner", "readings")

    id: int
    name: str
    options: Mapping[str, float]
    runner: TaskRunner
    site: Site
    readings: dict[str, float] = field(default_factory=dict)


class TaskDesk:
    """The tasks of one session.

    What it carries can be taken and put back but while a task is at work: its program cannot.
    """

    STATE = ("_next_id", "_records", "_command", "in_charge", "_position_m", "_standstill")

    def __init__(self, limits: CommandLimits) -> None:
        self._limits = limits
        self._next_id = 1
        self._records: list[TaskRecord] = []
        self._command: Command | None = None
        self.in_charge = False
        self.restart()

    def restart(self) -> None:
        """The odometry begins anew."""
        self._standstill = Standstill()
        self._position_m = np.zeros(2)

    def observe(self, output: PipelineOutput, time_s: float) -> None:
        """Follow the base, also between tasks; after every tick."""
        if due(Job.REFERENCES, round(time_s / TICK_S)):
            velocity = output.applied_command.base_velocity
            self._position_m = self._standstill.step(output.odometry, velocity, time_s)

    @property
    def current(self) -> TaskRecord | None:
        """The task that was begun last; None before the first."""
        return self._records[-1] if self._records else None

    @property
    def running(self) -> bool:
        """Whether a task is at work, or still backs off."""
        current = self.current
        return current is not None and self.in_charge and (current.runner.outcome == Outcome.RUNNING or current.runner.moving)

    def find(self, key: int) -> TaskRecord:
        """A task by its id.

        Raises:
            KeyError: none has it, or it is forgotten.
        """
        for record in self._records:
            if record.id == key:
                return record
        raise KeyError(f"no task {key}; the last {_KEPT} are kept")

    def start(
        self, name: str, options: Mapping[str, float], scene: str | None, output: PipelineOutput, time_s: float
    ) -> TaskRecord:
        """Begin a task from what a tick gave.

        Args:
            name: of sim.tasks.TASKS.
            options: of the task; what is left out is at its default.
            scene: that the robot is in, None where it is not known.
            output: of the last tick.
            time_s: of the session.

        Raises:
            ValueError: no such task or option, or a value out of its range.
            TaskRefusedError: another one is at work, or it cannot begin here.
        """
        chosen = chosen_options(name, options)
        if self.running:
            raise TaskRefusedError("a task is at work; DELETE /api/v1/tasks/current aborts it")
        kind = TASKS[name]
        if scene is not None and kind.SCENE not in ("", scene):
            raise TaskRefusedError(f"task {name!r} needs scene {kind.SCENE!r}, this is {scene!r}; PUT /api/v1/scene first")
        if output.safety.damping:
            raise TaskRefusedError("the drives damp; clear what stopped the robot first")
        site = Site(chosen["site_x_m"], chosen["site_y_m"], chosen["site_yaw_rad"])
        view, task = look(output, self._position_m, time_s, site), kind(chosen)
        task.check(view, self._limits)
        record = TaskRecord(self._next_id, name, chosen, TaskRunner(task, view), site)
        self._next_id += 1
        self._records = [*self._records[-_KEPT + 1 :], record]
        self._command, self.in_charge = None, True
        return record

    def command(self, output: PipelineOutput, time_s: float) -> Command:
        """The command for the next tick, after one that gave `output` at `time_s`; only while a task is in charge."""
        record = self.current
        assert record is not None
        if self._command is None or due(Job.REFERENCES, round(time_s / TICK_S)):
            self._command = record.runner.step(look(output, self._position_m, time_s, record.site))
        return self._command

    def take_tare(self) -> bool:
        """Whether the task asks, this once, that what the hand reads becomes its zero."""
        record = self.current
        if record is None or not record.runner.tare_due:
            return False
        record.runner.tare_due = False
        return True

    def abort(self, output: PipelineOutput, time_s: float, reason: str) -> None:
        """Stop the task at work, which backs off and holds."""
        record = self.current
        if record is not None and self.in_charge:
            record.runner.abort(look(output, self._position_m, time_s, record.site), reason)

    def hand_over(self, output: PipelineOutput, time_s: float, reason: str = TOOK_OVER) -> None:
        """Somebody else commands from now on: an operator, or nobody after an e-stop."""
        self.abort(output, time_s, reason)
        self.in_charge = False

    def drop(self, reason: str) -> None:
        """The robot is put back: a task at work is over at once."""
        if self.running and self.current is not None:
            self.current.runner.drop(reason)
        self.in_charge = False


def task_fields(record: TaskRecord) -> dict[str, object]:
    """A task as REST tells it."""
    runner = record.runner
    metrics = {**runner.task.metrics(), "elapsed_s": runner.elapsed_s, "peak_force_estimated_n": runner.peak_n}
    return {
        "id": record.id,
        "name": record.name,
        "options": dict(record.options),
        "phase": runner.phase,
        "progress": runner.progress,
        "outcome": None if runner.outcome == Outcome.RUNNING else runner.outcome.name.lower(),
        "reason": runner.reason or None,
        "metrics": {key: float(value) if np.isfinite(value) else None for key, value in metrics.items()},
        "readings": dict(record.readings),
        "plan_m": record.site.in_odometry(runner.task.plan()).tolist(),
    }
