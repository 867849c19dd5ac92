"""A backend and the pipeline in lockstep: what the control process, benchmarks and tests step.

A session has no clock and no sockets. Feed it set-points, tick it, and let it fill a snapshot. What only a simulation or
only a robot can do stands in sim.runtime.simulation and sim.runtime.robot_session.
"""

import math
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.pipeline import Pipeline, PipelineConfig, PipelineOutput
from control.timing import TICK_S
from control.types import Command, SensorFrame
from sim.backends.protocol import Backend, GroundTruth
from sim.runtime.snapshot import Mode, command_from_record, command_to_record
from sim.runtime.snapshot_limits import check_name, check_pipeline
from sim.runtime.snapshot_writer import write_faults, write_forces, write_policy, write_robot

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
        pipeline_resets: counts how often the pipeline was started afresh.

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
    )

    def __init__(self, backend: BackendT, pipeline: PipelineConfig | None = None) -> None:
        self._backend = backend
        backend.open()
        self.pipeline = Pipeline(pipeline or PipelineConfig())
        check_pipeline(self.pipeline)
        self._error_power = np.empty(len(self.pipeline.estimator_names))
        self._asked, self._asked_command = b"", DEFAULT_COMMAND
        self.gains: tuple[float, float] | None = None
        self.command_age_s = 0.0
        self.pipeline_resets = 0
        self._command_sequence = 0
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

    def write_command(self, record: np.void) -> None:
        """The command of the last tick into a COMMAND record, as it went into the pipeline."""
        command_to_record(self._command, record)

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
        self._sensor = self.backend.read()
        self._output = self.pipeline.step(self._sensor, command, command_age_s)
        self.backend.write(self._output.joint_command)
        self.command_age_s = command_age_s
        self.time_s += TICK_S
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
        self.tick(command, age_s)
        self._command = command
        self._command_sequence = sequence

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

    def estop(self) -> None:
        """Latch the e-stop."""
        self.pipeline.estop()

    def clear_estop(self) -> None:
        """Clear the latched e-stop; the robot stands up from where it is."""
        self.pipeline.clear_estop()

    def track_errors(self, interval_s: float) -> None:
        """Update the live error of every estimator against truth; call once per `interval_s`."""
        truth = self.truth()
        if truth is None or self._output is None:
            return
        weight, true_force = min(1.0, interval_s / ERROR_WINDOW_S), truth.force_true_n.tolist()
        for index, name in enumerate(self.pipeline.estimator_names):
            estimate = self._output.estimates.get(name)
            if estimate is None:
                continue
            error = zip(estimate.force_estimated_n.tolist(), true_force, strict=True)
            power = sum((estimated - true) ** 2 for estimated, true in error)
            last = float(self._error_power[index])
            self._error_power[index] = power if math.isnan(last) else last + weight * (power - last)

    def fill(self, record: np.void) -> None:
        """Fill a SNAPSHOT record but for the loop's own fields. What this session has not is NaN, zero or empty."""
        output, truth = self.output, self.truth()
        names, selected = self.pipeline.estimator_names, self.pipeline.estimator_name
        record["sequence"] += 1
        record["time_s"] = self.time_s
        record["mode"] = self.mode
        write_faults(record, output)
        record["backend"] = self.backend.name
        record["controller"] = self.pipeline.controller_name
        record["estimator"] = selected
        record["command_sequence"] = self._command_sequence
        command_to_record(self._command, record["command"])
        write_robot(record, self._sensor, output, truth)
        write_forces(record, output, truth, names, selected)
        write_policy(record, self.pipeline.controllers[self.pipeline.controller_name])
        record["force_errors_rms_n"] = np.nan
        record["force_errors_rms_n"][: len(names)] = np.sqrt(self._error_power)
        for name in ("mass_scale_true", "drag_target_in_world", "drag_force_n"):
            record[name] = np.nan

    def _forget(self) -> None:
        """As before the first tick, but for the pipeline and what counts on: the command's sequence number."""
        self.time_s = 0.0
        self._command = DEFAULT_COMMAND
        self._unheard_sequence = -1
        self._output: PipelineOutput | None = None
        self._error_power[:] = np.nan

    def _reset_pipeline(self) -> None:
        latched = self.pipeline.estop_latched
        self.pipeline.reset()
        self.pipeline_resets += 1
        if latched:  # only clear_estop clears it
            self.pipeline.estop()
