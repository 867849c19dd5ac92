"""A backend and the pipeline in lockstep: what the control process, benchmarks and tests step.

A session has no clock and no sockets. Feed it set-points, tick it, and let it fill a snapshot. What only a simulation or
only a robot can do stands in sim.runtime.simulation and sim.runtime.robot_session.
"""

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Generic, TypeVar

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.hand_load.tare import TareError
from control.hand_load.tool import Tool
from control.pipeline import Pipeline, PipelineConfig, PipelineOutput
from control.timing import TICK_S
from control.types import Command, SensorFrame
from sim.backends.protocol import Backend, GroundTruth
from sim.runtime.fault_words import ESTOP_LATCHED
from sim.runtime.snapshot import MAX_ESTIMATORS, NAME, Mode, command_from_record
from sim.runtime.snapshot_kernels import track_error_power
from sim.runtime.snapshot_limits import check_name, check_pipeline
from sim.runtime.snapshot_writer import (
    newest_forces,
    numbers_of,
    write_commands,
    write_failures,
    write_forces,
    write_hand_load,
    write_named,
    write_policy,
    write_robot,
    write_session,
    write_task,
)
from sim.tasks.desk import TaskDesk, TaskRecord, task_fields
from sim.tasks.task import TaskRefusedError

_log = logging.getLogger(__name__)

ERROR_WINDOW_S = 5.0
"""Time constant of the live error of each estimator."""

BackendT = TypeVar("BackendT", bound=Backend, covariant=True)


class SessionError(RuntimeError):
    """The session's state forbids the call; the message says what to do."""


class Session(Generic[BackendT]):
    """One backend, its pipeline and what the console may do to any of them. Single-threaded.

    Attributes:
        gains: of the momentum observer, as set last; None for those that it starts with.
        command_age_s: of the last tick, time since the operator was heard.
        own_deeds: counts how often the pipeline was started afresh ("reset"), and how often a task had the hand tared ("tare").

    Args:
        backend: opened here; its owner closes it.
        pipeline: how to make the pipeline.

    Raises:
        BackendError: the backend cannot be opened; the message names the cure.
        SnapshotLimitError: the pipeline's names or their number do not fit into a snapshot.
    """

    STATE = (
        "_backend",
        "pipeline",
        "_error_power",
        "_command_sequence",
        "_asked",
        "_asked_command",
        "_sensor",
        "_output",
        "time_s",
        "_command",
        "_unheard_sequence",
        "gains",
        "command_age_s",
        "tasks",
        "_task_sequence",
    )
    SCRATCH = ("_filled", "_numbers")

    def __init__(self, backend: BackendT, pipeline: PipelineConfig | None = None) -> None:
        self._backend = backend
        backend.open()
        self.pipeline = Pipeline(pipeline or PipelineConfig())
        check_pipeline(self.pipeline)
        names = self.pipeline.estimator_names
        self._error_power = np.empty(len(names))
        self._estimator_names = np.array([*names] + [""] * (MAX_ESTIMATORS - len(names)), NAME)
        self._filled: np.void | None = None
        self._asked, self._asked_command = b"", DEFAULT_COMMAND
        self.gains: tuple[float, float] | None = None
        self.command_age_s = 0.0
        self.own_deeds = {"reset": 0, "tare": 0}
        self._command_sequence = 0
        self.tasks = TaskDesk(self.pipeline.config.limits)
        self._task_sequence = 0
        self._forget()

    @property
    def backend(self) -> BackendT:
        """What the pipeline reads and drives."""
        return self._backend

    @property
    def output(self) -> PipelineOutput:
        """The pipeline's output of the last tick.

        Raises:
            SessionError: no tick has run since the start or the last reset.
        """
        if self._output is None:
            raise SessionError("the session has not ticked yet; call tick() first")
        return self._output

    @property
    def sensor(self) -> SensorFrame:
        """What the pipeline saw at the last tick."""
        return self._sensor

    @property
    def command(self) -> Command:
        """The command of the last tick, as it went into the pipeline."""
        return self._command

    @property
    def mode(self) -> Mode:
        """RUNNING, ESTOP or FAULT; pausing is the caller's business."""
        if self.pipeline.estop_latched:
            return Mode.ESTOP
        if self._output is not None and self._output.safety.damping:
            return Mode.FAULT
        return Mode.RUNNING

    def tick(self, command: Command, command_age_s: float = 0.0) -> PipelineOutput:
        """Advance 2 ms: sense, think, act. `command_age_s` is the time since the operator was last heard."""
        self._sensor = self._backend.read()
        self._output = self.pipeline.step(self._sensor, command, command_age_s)
        self._backend.write(self._output.joint_command)
        self.command_age_s = command_age_s
        self.time_s += TICK_S
        self.tasks.observe(self._output, self.time_s)
        return self._output

    def tick_setpoint(self, setpoint: np.void, age_s: float) -> None:
        """`tick` from a SETPOINT record whose operator was last heard `age_s` ago.

        A base velocity whose operator has fallen silent does not act again when he is heard again, only when he asks anew.
        """
        sequence, asked = int(setpoint["sequence"]), setpoint["command"].tobytes()
        if asked != self._asked:
            self._asked, self._asked_command = asked, command_from_record(setpoint["command"])
        command = self._asked_command
        if age_s > self.pipeline.config.safety.setpoint_timeout_s:
            self._unheard_sequence = sequence
        if sequence == self._unheard_sequence:
            command = replace(command, base_velocity=np.zeros(3))
        if self.tasks.in_charge and sequence != self._task_sequence:
            self.tasks.hand_over(self.output, self.time_s)
        if self.tasks.in_charge:
            command = self._task_command()
        self.tick(command, age_s)
        self._command = command
        self._command_sequence = sequence

    def tick_task(self) -> None:
        """`tick` by the task that is in charge, without an operator; see `start_task`."""
        self._command = self._task_command()
        self.tick(self._command)

    def start_task(self, name: str, options: Mapping[str, float], sequence: int = 0) -> TaskRecord:
        """Begin a task. It commands until it ends, and then holds, until a set-point with another `sequence` comes.

        Raises:
            ValueError: no such task or option, or a value out of its range.
            SessionError: it cannot begin; the message says what to do.
        """
        if self.pipeline.estop_latched:
            raise SessionError(ESTOP_LATCHED)
        try:
            record = self.tasks.start(name, options, self.scene, self.output, self.time_s)
        except TaskRefusedError as refusal:
            raise SessionError(str(refusal)) from None
        self._task_sequence = sequence
        return record

    def abort_task(self, key: int | None = None) -> dict[str, Any]:
        """Stop the task at work, which backs off and holds; answers like `task_fields`.

        Raises:
            KeyError: none is at work, or not that one.
        """
        current = self.tasks.current
        if current is None or not self.tasks.running or key not in (None, current.id):
            raise KeyError("no task is at work" if key is None else f"task {key} is not at work")
        self.tasks.abort(self.output, self.time_s, "it was aborted")
        return self.task_fields()

    def task_fields(self, key: int | None = None) -> dict[str, Any]:
        """What there is to tell of a task, by default the one begun last.

        Raises:
            KeyError: there is none.
        """
        record = self.tasks.current if key is None else self.tasks.find(key)
        if record is None:
            raise KeyError("no task has been begun")
        return task_fields(record)

    @property
    def scene(self) -> str | None:
        """Name of the scene; None where it is not known."""
        return None

    def readings(self) -> dict[str, float]:
        """What can be read off the scene; empty where it is not known."""
        return {}

    def truth(self) -> GroundTruth | None:
        """Ground truth after the last tick, for evaluation; None where the backend has none."""
        return self.backend.truth()

    def select_controller(self, name: str) -> None:
        """Switch controllers.

        Raises:
            UnknownNameError: a ValueError; no controller has this name.
            SnapshotLimitError: the name of a controller that was added later does not fit into a snapshot.
        """
        check_name("controller", name)
        self.pipeline.select_controller(name)

    def select_estimator(self, name: str, k1: float | None = None, k2: float | None = None) -> None:
        """Choose the estimate that feeds the controller; with both gains, also set its observer's.

        Raises:
            ValueError: unknown name, or gains that are not both given and positive.
        """
        if (k1 is None) != (k2 is None):
            raise ValueError("gains need both k1 and k2")
        gains = None if k1 is None or k2 is None else (k1, k2)
        self.pipeline.select_estimator(name, gains)
        self.gains = gains or self.gains

    def tare(self) -> None:
        """Make what the free hand reads now its zero.

        Raises:
            SessionError: the hand presses, moves, or reads more than a bias.
        """
        try:
            self.pipeline.hand_load.tare(self.pipeline.estimator_name, self.output.applied_command)
        except TareError as error:
            raise SessionError(str(error)) from error

    def clear_tare(self) -> None:
        """Take nothing from the estimates any more."""
        self.pipeline.hand_load.clear_tare()

    def set_tool(self, mass_kg: float, center_of_mass_m: list[float]) -> None:
        """Tell what the hand carries.

        Raises:
            ToolError: a ValueError; more than a hand can carry.
        """
        self.pipeline.hand_load.set_tool(Tool(mass_kg, np.array(center_of_mass_m)))

    def identify_tool(self) -> None:
        """Begin the motion that finds the tool.

        Raises:
            SessionError: the hand presses or is led, or the controller does not move the robot.
        """
        if self.mode is not Mode.RUNNING:
            raise SessionError("the robot is stopped; clear the e-stop or the fault first")
        try:
            self.pipeline.hand_load.identify_tool(self.output.applied_command)
        except TareError as error:
            raise SessionError(str(error)) from error

    def estop(self) -> None:
        """Latch the e-stop; a task at work is over."""
        self.tasks.drop("the e-stop was pressed")
        self.pipeline.estop()

    def clear_estop(self) -> None:
        """Clear the latched e-stop; the robot stands up from where it is."""
        self.pipeline.clear_estop()

    def track_errors(self, interval_s: float) -> None:
        """Update the live error of every estimator against truth; call once per `interval_s`."""
        truth = self.truth()
        if truth is None or self._output is None:
            return
        forces = newest_forces(self._output.estimates, self.pipeline.estimator_names)
        track_error_power(forces, truth.force_true_n, min(1.0, interval_s / ERROR_WINDOW_S), self._error_power)

    def fill(self, record: np.void) -> None:
        """Fill a SNAPSHOT record but for the loop's own fields. What this session has not is NaN, zero or empty."""
        output, truth = self.output, self.truth()
        names, selected = self.pipeline.estimator_names, self.pipeline.estimator_name
        if record is not self._filled:  # a console fills the same one again and again
            self._filled, self._numbers = record, numbers_of(record)
        numbers = self._numbers
        write_session(numbers, self.time_s, self.mode, output.safety.faults, self._command_sequence)
        write_failures(record, output.failures)
        record["backend"] = self.backend.name
        record["controller"] = self.pipeline.controller_name
        record["estimator"] = selected
        record["estimator_names"] = self._estimator_names
        write_commands(numbers, self._command, output.applied_command)
        write_robot(numbers, self._sensor, output, truth)
        write_forces(numbers, output, truth, names, selected, self._error_power)
        write_hand_load(record, numbers, self.pipeline.hand_load.state(selected))
        write_policy(record, numbers, self.pipeline.controllers[self.pipeline.controller_name])
        readings = self.readings()
        write_named(record, "reading", readings)
        if self.tasks.running and self.tasks.current is not None:
            self.tasks.current.readings = readings
        write_task(record, self.tasks)

    def _task_command(self) -> Command:
        command = self.tasks.command(self.output, self.time_s)
        if self.tasks.take_tare():
            try:
                self.tare()
            except SessionError as error:
                _log.info("the task goes on without a tare: %s", error)
            else:
                self.own_deeds["tare"] += 1
        return command

    def _forget(self) -> None:
        """As before the first tick, but for the pipeline and what counts on: the command's sequence number."""
        self.time_s = 0.0
        self._command = DEFAULT_COMMAND
        self._unheard_sequence = -1
        self._output: PipelineOutput | None = None
        self._error_power[:] = np.nan

    def _reset_pipeline(self) -> None:
        self.tasks.drop("the robot was put back")
        self.tasks.restart()
        latched = self.pipeline.estop_latched
        self.pipeline.reset()
        self.own_deeds["reset"] += 1
        if latched:  # only clear_estop clears it
            self.pipeline.estop()
