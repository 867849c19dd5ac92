"""One tick of a session as a row of doubles, and how it is written. Recordings hold it (sim.recording.tap)."""

from typing import Any

import numpy as np

from control.joints import JOINT_COUNT
from control.timing import MOST_ESTIMATORS
from control.types import Command, ForceEstimate
from sim.runtime.snapshot import COMMAND

TICK = np.dtype(
    [
        ("time_s", "f8"),  # of the session, after the tick
        ("sensor_time_s", "f8"),
        ("orientation_wxyz", "f8", 4),
        ("angular_velocity", "f8", 3),
        ("linear_acceleration", "f8", 3),
        ("joint_position", "f8", JOINT_COUNT),
        ("joint_velocity", "f8", JOINT_COUNT),
        ("joint_torque", "f8", JOINT_COUNT),
        ("command", [(name, "f8", COMMAND[name].shape) for name in COMMAND.names or ()]),  # as it went into the pipeline
        ("command_age_s", "f8"),
        ("applied_mask", "f8", 3),  # of the command as applied, which the next tick's estimators read
        ("estimates_n", "f8", (MOST_ESTIMATORS, 3)),  # in the order of the pipeline's estimators, NaN where there is none
        ("sigma_n", "f8", 3),
        ("target_position", "f8", JOINT_COUNT),  # to the drives
        ("target_velocity", "f8", JOINT_COUNT),
    ]
)
"""One tick. Units SI; forces in heading, of the environment on the robot. Doubles only, so that it is written as one row."""


class TickRow:
    """The last tick of a session, again and again.

    Commands and estimates are values, which stay the same objects for many ticks: they are written when another one comes.
    """

    def __init__(self) -> None:
        record = np.full(1, np.nan, [("row", "f8", TICK.itemsize // 8)]).view(TICK)
        values = record.view("f8")
        self._bytes = record.view(np.uint8).data
        self._numbers = values.data
        sensor, command, age = (TICK.fields[name][1] // 8 for name in ("orientation_wxyz", "command", "command_age_s"))  # pyright: ignore[reportOptionalSubscript]
        self._sensor, self._command, self._age = values[sensor:command], values[command:age], age
        self._applied_mask, self._sigma_n = record["applied_mask"][0], record["sigma_n"][0]
        self._forces_n = record["estimates_n"][0]
        self._position, self._velocity = record["target_position"][0], record["target_velocity"][0]
        self._told: Command | None = None
        self._applied: Command | None = None
        self._estimates: list[ForceEstimate | None] = [None] * MOST_ESTIMATORS
        self._chosen: ForceEstimate | None = None

    def write(self, session: Any) -> memoryview:
        """Bytes of a TICK record of the last tick of a sim.runtime.session.Session, which the next call overwrites."""
        output, sensor, command, pipeline = session.output, session.sensor, session.command, session.pipeline
        numbers = self._numbers
        numbers[0], numbers[1], numbers[self._age] = session.time_s, sensor.time_s, session.command_age_s
        measured = (
            sensor.orientation_wxyz,
            sensor.angular_velocity,
            sensor.linear_acceleration,
            sensor.joint_position,
            sensor.joint_velocity,
            sensor.joint_torque,
        )
        np.concatenate(measured, out=self._sensor)
        if command is not self._told:
            self._write_command(command)
        applied = output.applied_command
        if applied is not self._applied:
            self._applied = applied
            self._applied_mask[:] = applied.mask
        estimates = output.estimates
        for index, name in enumerate(pipeline.estimator_names):
            estimate = estimates.get(name)
            if estimate is not self._estimates[index]:
                self._estimates[index] = estimate
                self._forces_n[index] = np.nan if estimate is None else estimate.force_estimated_n
        chosen = estimates.get(pipeline.estimator_name)
        if chosen is not self._chosen:
            self._chosen = chosen
            self._sigma_n[:] = np.nan if chosen is None or chosen.sigma_n is None else chosen.sigma_n
        self._position[:] = output.joint_command.position
        self._velocity[:] = output.joint_command.velocity
        return self._bytes

    def _write_command(self, command: Command) -> None:
        self._told = command
        values = (command.mask, command.force_n, command.position_m, command.orientation_wxyz, command.base_velocity)
        np.concatenate((*values, (command.guidance,)), out=self._command)
