"""A backend and the pipeline in lockstep: the one thing that the control process, benchmarks and tests all step.

A session has no clock and no sockets. Feed it set-points, tick it, and let it fill a snapshot.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.frames import rotation_z
from control.pipeline import Pipeline, PipelineConfig, PipelineOutput
from control.timing import TICK_S
from control.types import Command
from sim.backends.protocol import GroundTruth
from sim.backends.simulation.mujoco_backend import MujocoBackend
from sim.backends.simulation.sensors import SensorConfig
from sim.backends.simulation.wrenches import ActiveWrench, Pulse
from sim.runtime.snapshot import Mode, command_from_record, command_to_record
from sim.runtime.snapshot_writer import write_faults, write_forces, write_policy, write_robot

DRAG_HEARTBEAT_S = 0.3
"""A drag whose operator has not been heard for this long is let go."""

ERROR_WINDOW_S = 5.0
"""Time constant of the live error of each estimator."""


@dataclass(frozen=True, slots=True)
class SessionConfig:
    """What a session is made of. `seed` draws the sensors' errors."""

    scene: str = "free"
    seed: int = 0
    sensors: SensorConfig = field(default_factory=SensorConfig)
    pipeline: PipelineConfig = field(default_factory=PipelineConfig)


class SessionError(RuntimeError):
    """The session's state forbids the call; the message says what to do."""


class Session:
    """One robot, its pipeline and what the console may do to them. Single-threaded."""

    def __init__(self, config: SessionConfig | None = None) -> None:
        self.config = config or SessionConfig()
        self.backend = self._open_backend()
        self.pipeline = Pipeline(self.config.pipeline)
        self.time_s = 0.0
        self._error_power = np.full(len(self.pipeline.estimator_names), np.nan)
        self._command = DEFAULT_COMMAND
        self._command_sequence = 0
        self._output: PipelineOutput | None = None
        self._truth: GroundTruth | None = None
        self._drag_target: np.ndarray | None = None

    def _open_backend(self) -> MujocoBackend:
        backend = MujocoBackend(self.config.scene, self.config.sensors, self.config.seed)
        backend.open()
        return backend

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
        self._truth = None
        self.time_s += TICK_S
        return self._output

    def tick_setpoint(self, setpoint: np.void, age_s: float) -> None:
        """`tick` from a SETPOINT record, with the drag spring while its operator is alive."""
        dragging = bool(setpoint["drag_active"]) and age_s < DRAG_HEARTBEAT_S
        self._set_drag(setpoint["drag_target_in_world"].copy() if dragging else None)
        command = command_from_record(setpoint["command"])
        self.tick(command, age_s)
        self._command = command
        self._command_sequence = int(setpoint["sequence"])

    def _set_drag(self, target_in_world: np.ndarray | None) -> None:
        if target_in_world is not None or self._drag_target is not None:
            self.backend.set_drag(target_in_world)
        self._drag_target = target_in_world

    def truth(self) -> GroundTruth | None:
        """Ground truth after the last tick, for evaluation; None on hardware."""
        if self._truth is None:
            self._truth = self.backend.truth()
        return self._truth

    def reset(self, seed: int | None = None, keyframe: str = "stand") -> None:
        """Put the simulated robot back and restart the pipeline.

        Raises:
            ValueError: unknown keyframe.
        """
        self.backend.reset(seed=seed, keyframe=keyframe)
        self._restart()

    def set_scene(self, name: str) -> None:
        """Load another scene with the robot at its start.

        Raises:
            ValueError: unknown scene.
        """
        self.backend.set_scene(name)
        self._restart()

    def _reset_pipeline(self) -> None:
        latched = self.pipeline.estop_latched
        self.pipeline.reset()
        if latched:  # only clear_estop clears it
            self.pipeline.estop()

    def _restart(self) -> None:
        self._reset_pipeline()
        self.time_s = 0.0
        self._output = None
        self._truth = None
        self._error_power[:] = np.nan

    def select_controller(self, name: str) -> None:
        """Switch controllers. Raises UnknownNameError (a ValueError) for an unknown name."""
        self.pipeline.select_controller(name)

    def select_estimator(self, name: str, k1: float | None = None, k2: float | None = None) -> None:
        """Choose the estimate that feeds the controller; with both gains, also set its observer's.

        Raises:
            ValueError: unknown name, or gains that are not both given and positive.
        """
        if (k1 is None) != (k2 is None):
            raise ValueError("gains need both k1 and k2")
        self.pipeline.select_estimator(name, None if k1 is None or k2 is None else (k1, k2))

    def set_mismatch(self, mass_scale: float, per_link: dict[str, float] | None = None) -> None:
        """Change the simulated robot's masses while it runs; the pipeline is not told.

        Raises:
            ValueError: out of range, or an unknown link.
        """
        self.backend.set_mismatch(replace(self.backend.mismatch, mass_scale=mass_scale, per_link=per_link or {}))

    def add_wrench(self, **spec: Any) -> int:
        """Start a scripted wrench (fields of sim.backends.simulation.wrenches.Pulse) and return its id.

        Raises:
            ValueError: the message names the field.
        """
        return self.backend.wrenches.add(Pulse(**spec))

    def list_wrenches(self) -> tuple[ActiveWrench, ...]:
        """What acts now, oldest first; the operator's drag is apart."""
        return self.backend.wrenches.list()

    def remove_wrench(self, key: int) -> None:
        """End one wrench. Raises KeyError when it is not at work."""
        self.backend.wrenches.remove(key)

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
        weight = min(1.0, interval_s / ERROR_WINDOW_S)
        for index, name in enumerate(self.pipeline.estimator_names):
            estimate = self._output.estimates.get(name)
            if estimate is None:
                continue
            error = estimate.force_estimated_n - truth.force_true_n
            power = float(error @ error)
            last = self._error_power[index]
            self._error_power[index] = power if np.isnan(last) else last + weight * (power - last)

    def fill(self, record: np.void) -> None:
        """Fill a SNAPSHOT record: everything but the loop's own fields."""
        output, truth = self.output, self.truth()
        names, selected = self.pipeline.estimator_names, self.pipeline.estimator_name
        record["sequence"] += 1
        record["time_s"] = self.time_s
        record["mode"] = self.mode
        write_faults(record, output)
        record["backend"] = self.backend.capabilities.name
        record["scene"] = self.backend.scene
        record["controller"] = self.pipeline.controller_name
        record["estimator"] = selected
        record["command_sequence"] = self._command_sequence
        command_to_record(self._command, record["command"])
        write_robot(record, self._sensor, output, truth)
        write_forces(record, output, truth, names, selected)
        write_policy(record, self.pipeline.controllers[self.pipeline.controller_name])
        record["force_errors_rms_n"] = np.nan
        record["force_errors_rms_n"][: len(names)] = np.sqrt(self._error_power)
        self._fill_simulation(record)

    def _fill_simulation(self, record: np.void) -> None:
        """The fields that only a simulation has."""
        record["mass_scale_true"] = self.backend.mass_scale
        record["drag_active"] = self._drag_target is not None
        record["drag_target_in_world"] = np.nan if self._drag_target is None else self._drag_target
        heading = rotation_z(float(record["heading_yaw"]))
        record["drag_force_n"] = self.backend.wrenches.drag_force_in_world @ heading
