"""The Backend of a real robot: shared memory on this side, the I/O process on the other.

Opening starts the I/O process, or attaches to the one that a dead control process has left behind. Whatever happens here,
that process damps the robot on its own.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from control.paths import ROOT
from control.types import JointCommand, SensorFrame
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.io.command_limiter import stack
from sim.backends.hardware.records import IO_COMMAND, IO_STATE, READ_ATTEMPTS, IoMemory, memory_path
from sim.backends.hardware.remote import ALIVE_S, HardwareRemote
from sim.backends.hardware.robot import sensor_frame
from sim.backends.hardware.states import DriveState, Request, Trip
from sim.backends.hardware.status import HardwareStatus, status_from_record
from sim.backends.protocol import BackendError
from sim.backends.unitree.dds import dds_unavailable_because

HONESTY = "protocol-verified, not robot-verified"
CONTROLLED_S = 0.3
"""A control process that was heard this recently lives."""

_START_S = 20.0
_ORPHAN_KNOWN_S = 2.0
"""An I/O process whose control process has died has noticed by then."""

_RELEASE_S = 10.0
_FIRST_STATE_S = 5.0


def unavailable_because() -> str | None:
    """Why the hardware backend cannot be used on this machine, None when it can."""
    if sys.platform != "linux":
        return "the hardware backend needs Linux (shared memory, process signals)"
    return dds_unavailable_because()


class HardwareBackend:
    """Reads states and writes commands through shared memory; `request` moves the drives' state machine.

    Args:
        config: the robot. `dry_run` is on by default.
        clock: monotonic seconds, the same as the I/O process's.
    """

    name = "hardware"

    def __init__(self, config: HardwareConfig | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.config = config or HardwareConfig()
        self._clock = clock
        self.operator_silent_s = 0.0
        """Time since the console's web process was last heard; goes out with every write and heartbeat."""
        self._memory: IoMemory | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._record: np.void = np.zeros(1, IO_STATE)[0]
        self._command = np.zeros(1, IO_COMMAND)
        self._frame: SensorFrame | None = None
        self._start_s = 0.0

    def open(self) -> None:
        """Connect to the robot.

        Raises:
            BackendError: the extra is missing, the I/O process refuses (its reason is in the message), or the robot is silent.
        """
        reason = unavailable_because()
        if reason is not None:
            raise BackendError(reason)
        if not self._attach():
            self._await_release()
            self._launch()
        deadline = time.monotonic() + _FIRST_STATE_S
        self._start_s = self._clock()
        while not self._refresh() or self._frame is None:
            self.heartbeat()
            if time.monotonic() > deadline:
                missing = "the base" if not np.isfinite(self._record["base_received_s"]) else "the arm (is z1_ctrl running?)"
                self.close()
                raise BackendError(
                    f"no state from {missing} on DDS domain {self.config.base.domain}, interface "
                    f"{self.config.base.interface!r}; check cable and power, or start `forcelens emulate`"
                )
            time.sleep(0.01)

    def read(self) -> SensorFrame:
        """Newest sensor frame; `time_s` counts from `open`. It grows old when the robot falls silent.

        Raises:
            BackendError: not open, or the I/O process has died: nobody commands the robot any more.
        """
        self._refresh()
        if self._frame is None:
            raise BackendError("the hardware backend is not open; call open() first")
        if self._clock() - float(self._record["time_s"]) > ALIVE_S:
            raise BackendError(
                f"the I/O process (pid {self.io_pid}) is silent and sends the robot nothing; use the robot's own stop, then "
                "POST /api/v1/control/restart"
            )
        return self._frame

    def write(self, command: JointCommand) -> None:
        """Hand a command to the I/O process, which sends it while its state is POLICY."""
        record, now = self._command[0], self._clock()
        record["sequence"] += 1
        record["time_s"] = record["alive_s"] = now
        record["operator_silent_s"] = self.operator_silent_s
        record["targets"] = stack(command)
        self._opened.command.write(self._command)

    def heartbeat(self) -> None:
        """Tell the I/O process that control lives, without a command. `write` does the same."""
        record = self._command[0]
        record["alive_s"] = self._clock()
        record["operator_silent_s"] = self.operator_silent_s
        self._opened.command.write(self._command)

    def request(self, request: Request) -> int:
        """Ask for a change of the drives' state. `status` tells what became of it, by the sequence number returned here."""
        record = self._command[0]
        record["request"] = request
        record["request_sequence"] += 1
        record["alive_s"] = self._clock()
        self._opened.command.write(self._command)
        return int(record["request_sequence"])

    @property
    def state(self) -> DriveState:
        """Of the drives, as of the last `read` or `status`."""
        return DriveState(int(self._record["state"]))

    @property
    def faults(self) -> Trip:
        """Why the drives damp, as of the last `read` or `status`."""
        return Trip(int(self._record["faults"]))

    @property
    def fault_joints(self) -> int:
        """Whose those are (`states.joint_bits`)."""
        return int(self._record["fault_joints"])

    def estop(self) -> None:
        """Latch FAULT: damping from the I/O process's next tick on."""
        self._opened.estop = True

    def truth(self) -> None:
        """A robot has no ground truth."""

    def status(self) -> HardwareStatus:
        """Everything the page shows."""
        self._refresh()
        return status_from_record(self._record, self._clock())

    def close(self) -> None:
        """Let go: the I/O process damps, and ends when the robot is at rest."""
        if self._memory is not None:
            HardwareRemote(self.config).end()
        self._memory = None
        self._frame = None

    @property
    def io_pid(self) -> int:
        """Process id of the I/O process."""
        return int(self._record["pid"])

    @property
    def _opened(self) -> IoMemory:
        if self._memory is None:
            raise BackendError("the hardware backend is not open; call open() first")
        return self._memory

    def _attach(self) -> bool:
        """Take over a living I/O process that nobody controls, continuing its request count.

        One that ends, or is ended here because its `dry_run` is not ours, is waited for: it damps until the robot rests.
        """
        try:
            memory = IoMemory(memory_path(self.config))
        except BackendError:
            return False
        while (newest := memory.state.read()) is not None and self._lives(newest[0]):
            record = newest[0]
            if not record["ending"]:
                if self._clock() - float(record["control_heard_s"]) < CONTROLLED_S:
                    raise BackendError(f"another control process drives this robot (I/O process {record['pid']}); end it first")
                if record["dry_run"] == self.config.dry_run:
                    self._memory = memory
                    self._command[0]["request_sequence"] = record["request_sequence"]
                    self._command[0]["sequence"] = time.monotonic_ns()  # never that of the predecessor's last command
                    return True
                HardwareRemote(self.config).end()
            time.sleep(0.05)
        return False

    def _await_release(self) -> None:
        """Let an I/O process end whose shared memory was removed: nobody can attach to it."""
        remote, began = HardwareRemote(self.config), time.monotonic()
        while (answer := remote.report()) is not None:
            waited_s = time.monotonic() - began
            if answer.controlled and waited_s > _ORPHAN_KNOWN_S:
                raise BackendError("another control process drives this robot, and its shared memory was removed; end it first")
            if waited_s > _RELEASE_S:
                raise BackendError(f"the I/O process before this one has not let go of the robot within {_RELEASE_S:.0f} s")
            time.sleep(0.05)

    def _lives(self, record: np.void) -> bool:
        return self._clock() - float(record["time_s"]) < ALIVE_S

    def _launch(self) -> None:
        environment = dict(os.environ)
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), environment.get("PYTHONPATH")]))
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sim.backends.hardware.io.process", "--config", self.config.to_json()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            env=environment,
            start_new_session=True,  # a signal to our process group must not reach it
        )
        deadline = time.monotonic() + _START_S
        while not self._attach():
            status = self._process.poll()
            if status is not None:
                assert self._process.stdout is not None
                reason = self._process.stdout.read().decode(errors="replace")
                raise BackendError(reason or f"the I/O process did not start (status {status}); see standard error")
            if time.monotonic() > deadline:
                raise BackendError(f"the I/O process did not start within {_START_S:.0f} s")
            time.sleep(0.02)

    def _refresh(self) -> bool:
        newest = self._opened.state.read(READ_ATTEMPTS)
        if newest is None:
            return False
        record = self._record = newest[0]
        if record["has_frame"]:
            self._frame = sensor_frame(float(record["base_received_s"]) - self._start_s, record["sensors"])
        return True
