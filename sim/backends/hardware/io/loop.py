"""One tick of the I/O process, without its clock and its process: poll, decide, send, report."""

import logging
import os
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from control.types import JointCommand
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.io.supervisor import ControlInput, Supervisor
from sim.backends.hardware.records import IO_STATE, IO_TICK, READ_ATTEMPTS, IoMemory
from sim.backends.hardware.robot import SENSOR_COUNT, Robot
from sim.backends.hardware.states import Request, Trip

_WORST_WINDOW_S = 1.0
HEALTH_EVERY = 10
"""Ticks between two reports of what only people read."""

_log = logging.getLogger("forcelens.io")


class IoLoop:
    """Ticks one robot. The memory's command is read and its state written once per tick.

    Args:
        config: the robot.
        robot: its drivers.
        supervisor: its state machine.
        memory: shared with the control process.
        work_clock: times the tick's own work.
    """

    def __init__(
        self,
        config: HardwareConfig,
        robot: Robot,
        supervisor: Supervisor,
        memory: IoMemory,
        work_clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.config = config
        self.robot = robot
        self.supervisor = supervisor
        self.signalled = Trip.NONE
        """Set by signal handlers: an e-stop from outside, kept until the fault is cleared."""
        self.ending = False
        """Told to end; reported, so that nobody attaches any more."""
        self.control_heard_s = -np.inf
        self._memory = memory
        self._clock = work_clock
        self._record = np.zeros(1, IO_STATE)
        self._message = ""
        for name in ("sensors", "temperature", "battery_percent", "battery_v"):
            self._record[name] = np.nan
        self._record["dry_run"] = config.dry_run
        self._record["pid"] = os.getpid()
        start = SENSOR_COUNT * np.dtype("f8").itemsize
        self._tick_record = self._record.view(np.uint8)[start : start + IO_TICK.itemsize].view(IO_TICK)
        self._sensors = self._record["sensors"][0]
        self._sequence = 0
        self._heard: np.void | None = None
        self._command_sequence = 0
        self._command: JointCommand | None = None
        self._last_s = -np.inf
        self._worst_s = self._worst_shown_s = 0.0
        self._window_s = -np.inf

    def tick(self, now: float, realtime: bool = False) -> bool:
        """One tick at monotonic time `now`; True when the base had a new state.

        Whatever goes wrong in it, the robot is damped: there is nobody else to do it.
        """
        start = self._clock()
        fresh = False
        try:
            fresh = self.robot.poll(now)
            self.supervisor.step(now, fresh, self._control(now))
        except Exception:
            self._fail()
        self._report(now, realtime, self._clock() - start)
        return fresh

    def _fail(self) -> None:
        if Trip.INTERNAL not in self.supervisor.faults:
            _log.exception("a tick has failed")
        with suppress(Exception):  # the next tick tries again
            self.supervisor.fail()

    def _control(self, now: float) -> ControlInput:
        estop = self.signalled
        self.signalled = Trip.NONE
        if self._memory.estop:
            self._memory.estop = False
            estop |= Trip.ESTOP
        newest = self._memory.command.read(READ_ATTEMPTS)
        if newest is not None:
            self._heard = newest[0]
        # Without a new record (a writer caught, or killed, half-way through) the last one simply grows older.
        record = self._heard
        if record is None:
            return ControlInput(estop=estop)
        values: Any = record.item()
        targets, sequence, time_s, self.control_heard_s, operator_silent_s, request, request_sequence = values
        if sequence != self._command_sequence:
            self._command_sequence = sequence
            self._command = JointCommand(*targets)
        return ControlInput(
            self._command,
            now - time_s,
            now - self.control_heard_s,
            operator_silent_s,
            Request(request),
            request_sequence,
            estop,
        )

    def _report(self, now: float, realtime: bool, work_s: float) -> None:
        robot, supervisor = self.robot, self.supervisor
        if now - self._window_s > _WORST_WINDOW_S:
            self._window_s, self._worst_shown_s, self._worst_s = now, self._worst_s, 0.0
        if self._sequence:
            self._worst_s = max(self._worst_s, now - self._last_s)
        self._last_s = now
        self._sequence += 1
        self._tick_record[0] = (
            self._sequence,
            now,
            self.control_heard_s,
            robot.base.received_s,
            robot.arm.received_s,
            supervisor.request_sequence,
            1e3 * work_s,
            1e3 * self._worst_shown_s,
            supervisor.faults,
            supervisor.fault_joints,
            supervisor.state,
            supervisor.engaging,
            supervisor.refused,
            robot.frame is not None,
            self.ending,
            realtime,
        )
        self._sensors[:] = robot.sensors
        if supervisor.message != self._message or self._sequence % HEALTH_EVERY == 1:
            self._report_health(self._record[0], now)
        self._memory.state.write(self._record)

    def _report_health(self, record: np.void, now: float) -> None:
        """What people read, which need not be new at every tick."""
        robot, supervisor = self.robot, self.supervisor
        self._message = supervisor.message
        record["message"] = supervisor.message.encode()[:400]
        record["warnings"] = int(supervisor.warnings)
        record["progress"] = supervisor.progress(now)
        if robot.readings is not None:
            base, arm = robot.readings
            record["temperature"] = robot.temperature()
            record["lost"] = base.motors.lost
            record["battery_percent"] = base.battery_percent
            record["battery_v"] = base.battery_v
            record["arm_mode"] = arm.mode
        record["states_received"] = robot.base.received
        record["states_missed"] = robot.base.missed
        record["bad_messages"] = robot.base.bad_samples + robot.arm.bad_frames
        record["frames_sent"] = robot.base.sent
        record["foreign_writers"] = supervisor.foreign_writers
