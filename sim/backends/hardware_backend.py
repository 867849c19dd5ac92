"""The Backend of a real robot: shared memory on this side, the I/O process on the other.

Opening starts the I/O process, or attaches to the one that a dead control process has left behind. Whatever happens here,
that process damps the robot on its own.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from control.joints import JOINT_COUNT, JOINT_NAMES
from control.types import JointCommand, SensorFrame
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.records import IO_COMMAND, IO_STATE, IoMemory, memory_path
from sim.backends.hardware.states import DriveState, Request, Trip, describe
from sim.backends.protocol import BackendError, Capabilities
from sim.backends.unitree.dds import INSTALL_HINT

HONESTY = "protocol-verified, not robot-verified"
_ROOT = Path(__file__).resolve().parents[2]
_ALIVE_S = 1.0
_START_S = 20.0
_FIRST_STATE_S = 5.0


def unavailable_because() -> str | None:
    """Why the hardware backend cannot be used on this machine, None when it can."""
    if sys.platform != "linux":
        return "the hardware backend needs Linux (shared memory, process signals)"
    return None if find_spec("cyclonedds") is not None else INSTALL_HINT


def estop_from_anywhere(config: HardwareConfig) -> None:
    """Stop the robot from any process of this user, also when its control process is dead.

    Raises:
        BackendError: no I/O process runs, so nothing of ours moves the robot.
    """
    IoMemory(memory_path(config)).estop = True


@dataclass(frozen=True, slots=True)
class MotorHealth:
    """One row of the health table; `lost` is None for the arm, which does not count."""

    name: str
    temperature_c: float
    torque_nm: float
    lost: int | None


@dataclass(frozen=True, slots=True)
class HardwareStatus:
    """What a page shows of the robot and its link.

    Attributes:
        state: of the drives.
        faults, warnings: in words.
        message: last refusal, failure or fault.
        engaging, progress: release and self-test, or a motion, under way; 0 to 1.
        dry_run: nothing is sent.
        base_age_s, arm_age_s: of their newest states.
        battery_percent, battery_v: as the base reports.
        motors: 22 rows.
        states_received, states_missed, bad_messages, frames_sent, foreign_writers: counters of the link.
        worst_period_ms, tick_work_ms: of the I/O process.
        realtime_scheduling: SCHED_FIFO was granted to it.
    """

    state: DriveState
    faults: tuple[str, ...]
    warnings: tuple[str, ...]
    message: str
    engaging: bool
    progress: float
    dry_run: bool
    base_age_s: float
    arm_age_s: float
    battery_percent: int
    battery_v: float
    motors: tuple[MotorHealth, ...]
    states_received: int
    states_missed: int
    bad_messages: int
    frames_sent: int
    foreign_writers: int
    worst_period_ms: float
    tick_work_ms: float
    realtime_scheduling: bool


class HardwareBackend:
    """Reads states and writes commands through shared memory; `request` moves the drives' state machine.

    Args:
        config: the robot. `dry_run` is on by default.
        clock: monotonic seconds, the same as the I/O process's.
    """

    capabilities = Capabilities(name="hardware", has_truth=False, is_simulation=False)
    scene = "robot"

    def __init__(self, config: HardwareConfig | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.config = config or HardwareConfig()
        self._clock = clock
        self.operator_silent_s = 0.0
        """Time since the operator's page was last heard; goes out with every write and heartbeat."""
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
            self._launch()
        deadline = time.monotonic() + _FIRST_STATE_S
        self._start_s = self._clock()
        while not self._refresh() or self._frame is None:
            self.heartbeat()
            if time.monotonic() > deadline:
                missing = "the base" if not np.isfinite(self._record["base_received_s"]) else "the arm (is z1_ctrl running?)"
                raise BackendError(
                    f"no state from {missing} on DDS domain {self.config.base.domain}, interface "
                    f"{self.config.base.interface!r}; check cable and power, or start `forcelens emulate`"
                )
            time.sleep(0.01)

    def read(self) -> SensorFrame:
        """Newest sensor frame; `time_s` counts from `open`. It grows old when the robot falls silent."""
        self._refresh()
        if self._frame is None:
            raise BackendError("the hardware backend is not open; call open() first")
        return self._frame

    @property
    def last_frame(self) -> SensorFrame:
        """The frame of the last `read`."""
        return self.read() if self._frame is None else self._frame

    def write(self, command: JointCommand) -> None:
        """Hand a command to the I/O process, which sends it while its state is POLICY."""
        record, now = self._command[0], self._clock()
        record["sequence"] += 1
        record["time_s"] = record["alive_s"] = now
        record["operator_silent_s"] = self.operator_silent_s
        record["position"] = command.position
        record["velocity"] = command.velocity
        record["stiffness"] = command.stiffness
        record["damping"] = command.damping
        record["torque"] = command.torque
        self._opened.command.write(self._command)

    def heartbeat(self) -> None:
        """Tell the I/O process that control lives, without a command. `write` does the same."""
        record = self._command[0]
        record["alive_s"] = self._clock()
        record["operator_silent_s"] = self.operator_silent_s
        self._opened.command.write(self._command)

    def request(self, request: Request) -> None:
        """Ask for a change of the drives' state; `status` tells what became of it."""
        record = self._command[0]
        record["request"] = request
        record["request_sequence"] += 1
        record["alive_s"] = self._clock()
        self._opened.command.write(self._command)

    @property
    def state(self) -> DriveState:
        """Of the drives, as of the last `read` or `status`."""
        return DriveState(int(self._record["state"]))

    def handled(self) -> bool:
        """Whether the I/O process has taken the last request."""
        self._refresh()
        return int(self._record["request_sequence"]) == int(self._command[0]["request_sequence"])

    def estop(self) -> None:
        """Latch FAULT: damping from the I/O process's next tick on."""
        self._opened.estop = True

    def truth(self) -> None:
        """A robot has no ground truth."""

    def status(self) -> HardwareStatus:
        """Everything the page shows."""
        self._refresh()
        record, now = self._record, self._clock()
        lost: list[int | None] = [int(value) for value in record["lost"]] + [None] * (JOINT_COUNT - 16)
        motors = zip(JOINT_NAMES, record["temperature"], record["joint_torque"], lost, strict=True)
        return HardwareStatus(
            state=DriveState(int(record["state"])),
            faults=tuple(describe(Trip(int(record["faults"])))),
            warnings=tuple(describe(Trip(int(record["warnings"])))),
            message=bytes(record["message"]).decode(errors="replace"),
            engaging=bool(record["engaging"]),
            progress=float(record["progress"]),
            dry_run=bool(record["dry_run"]),
            base_age_s=now - float(record["base_received_s"]),
            arm_age_s=now - float(record["arm_received_s"]),
            battery_percent=int(record["battery_percent"]),
            battery_v=float(record["battery_v"]),
            motors=tuple(MotorHealth(name, float(t), float(torque), count) for name, t, torque, count in motors),
            states_received=int(record["states_received"]),
            states_missed=int(record["states_missed"]),
            bad_messages=int(record["bad_messages"]),
            frames_sent=int(record["frames_sent"]),
            foreign_writers=int(record["foreign_writers"]),
            worst_period_ms=float(record["worst_period_ms"]),
            tick_work_ms=float(record["tick_work_ms"]),
            realtime_scheduling=bool(record["realtime_scheduling"]),
        )

    def close(self) -> None:
        """Leave the drives in damping and let go; the I/O process keeps damping and ends once the robot is at rest."""
        if self._memory is None:
            return
        if DriveState(int(self._record["state"])) not in (DriveState.DISCONNECTED, DriveState.OBSERVE, DriveState.FAULT):
            self.request(Request.DAMP)
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
        """Take over a living I/O process, continuing its request count."""
        try:
            memory = IoMemory(memory_path(self.config))
        except BackendError:
            return False
        newest = memory.state.read()
        if newest is None or self._clock() - float(newest[0]["time_s"]) > _ALIVE_S:
            return False
        dry_run, pid = bool(newest[0]["dry_run"]), int(newest[0]["pid"])
        if dry_run != self.config.dry_run:
            raise BackendError(f"an I/O process (pid {pid}) runs with dry_run={dry_run}; end it with SIGTERM and open again")
        self._memory = memory
        self._command[0]["request_sequence"] = newest[0]["request_sequence"]
        self._command[0]["sequence"] = time.monotonic_ns()  # never that of the predecessor's last command
        return True

    def _launch(self) -> None:
        environment = dict(os.environ)
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, [str(_ROOT), environment.get("PYTHONPATH")]))
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sim.backends.io_process", "--config", self.config.to_json()],
            stdin=subprocess.DEVNULL,
            env=environment,
            start_new_session=True,  # a signal to our process group must not reach it
        )
        deadline = time.monotonic() + _START_S
        while not self._attach():
            status = self._process.poll()
            if status is not None:
                raise BackendError(f"the I/O process refused to start (status {status}); its message is on standard error")
            if time.monotonic() > deadline:
                raise BackendError(f"the I/O process did not start within {_START_S:.0f} s")
            time.sleep(0.02)

    def _refresh(self) -> bool:
        newest = self._opened.state.read()
        if newest is None:
            return False
        record = self._record = newest[0]
        if record["has_frame"]:
            names = ("orientation_wxyz", "angular_velocity", "linear_acceleration")
            joints = ("joint_position", "joint_velocity", "joint_torque")
            values = [record[name] for name in (*names, *joints)]
            self._frame = SensorFrame(float(record["base_received_s"]) - self._start_s, *values)
        return True
