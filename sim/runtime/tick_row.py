"""Writes ticks of a session as rows."""

from typing import Any

import numpy as np

from control.joints import JOINT_COUNT
from control.kernels.compiled import kernel
from control.timing import MOST_ESTIMATORS
from control.types import Command, ForceEstimate
from sim.runtime.tick_layout import TICK

_SENSOR, _COMMAND, _AGE, _TARGETS = (
    TICK.fields[name][1] // 8  # pyright: ignore[reportOptionalSubscript]
    for name in ("orientation_wxyz", "command", "command_age_s", "target_position")
)


@kernel("void(f8[::1], f8, f8, f8, vector, vector, vector, vector, vector, vector, vector, vector)")
def put_newest(
    row: np.ndarray,
    time_s: float,
    sensor_time_s: float,
    command_age_s: float,
    orientation_wxyz: np.ndarray,
    angular_velocity: np.ndarray,
    linear_acceleration: np.ndarray,
    joint_position: np.ndarray,
    joint_velocity: np.ndarray,
    joint_torque: np.ndarray,
    target_position: np.ndarray,
    target_velocity: np.ndarray,
) -> None:
    """What is new at every tick, into the numbers of a TICK record."""
    row[0], row[1], row[_AGE] = time_s, sensor_time_s, command_age_s
    for i in range(4):
        row[_SENSOR + i] = orientation_wxyz[i]
    for i in range(3):
        row[_SENSOR + 4 + i], row[_SENSOR + 7 + i] = angular_velocity[i], linear_acceleration[i]
    joints = _SENSOR + 10
    for i in range(JOINT_COUNT):
        row[joints + i] = joint_position[i]
        row[joints + JOINT_COUNT + i] = joint_velocity[i]
        row[joints + 2 * JOINT_COUNT + i] = joint_torque[i]
        row[_TARGETS + i], row[_TARGETS + JOINT_COUNT + i] = target_position[i], target_velocity[i]


class TickRow:
    """The last tick of a session, again and again.

    Commands and estimates are values, which stay the same objects for many ticks: they are written when another one comes.
    """

    def __init__(self) -> None:
        record = np.full(1, np.nan, [("row", "f8", TICK.itemsize // 8)]).view(TICK)
        values = record.view("f8")
        self._bytes = record.view(np.uint8).data
        self._values, self._command = values, values[_COMMAND:_AGE]
        self._applied_mask, self._sigma_n = record["applied_mask"][0], record["sigma_n"][0]
        self._forces_n = record["estimates_n"][0]
        self._told: Command | None = None
        self._applied: Command | None = None
        self._estimates: list[ForceEstimate | None] = [None] * MOST_ESTIMATORS
        self._chosen: ForceEstimate | None = None

    def write(self, session: Any) -> memoryview:
        """Bytes of a TICK record of the last tick of a sim.runtime.session.Session, which the next call overwrites."""
        output, sensor, command, pipeline = session.output, session.sensor, session.command, session.pipeline
        put_newest(
            self._values,
            session.time_s,
            sensor.time_s,
            session.command_age_s,
            sensor.orientation_wxyz,
            sensor.angular_velocity,
            sensor.linear_acceleration,
            sensor.joint_position,
            sensor.joint_velocity,
            sensor.joint_torque,
            output.joint_command.position,
            output.joint_command.velocity,
        )
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
        return self._bytes

    def _write_command(self, command: Command) -> None:
        self._told = command
        values = (command.mask, command.force_n, command.position_m, command.orientation_wxyz, command.base_velocity)
        np.concatenate((*values, (command.guidance,)), out=self._command)
