"""The I/O process over real DDS: whoever is killed or falls silent, the emulated motors end up damped.

Runs in real time, so nothing is asserted about durations and the limits that depend on them are wide;
`python -m sim.benchmarks.hardware_link` measures the reactions.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from control.paths import ROOT
from sim.backends.hardware.backend import HardwareBackend
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.hardware.mailbox import Answer
from sim.backends.hardware.records import IoMemory, memory_path
from sim.backends.hardware.remote import HardwareRemote
from sim.backends.hardware.states import DriveState, Request, Trip
from sim.backends.protocol import BackendError
from sim.backends.unitree.dds import DdsConfig, DdsRobotLink
from sim.backends.z1.driver import Z1Config
from sim.emulator.arm_controller import ArmPorts
from sim.emulator.emulator import Emulator, EmulatorConfig
from sim.emulator.process import free_udp_port
from tests.sim.hardware.hardware_rig import BRISK

HERE = Path(__file__).parent
PATIENCE_S = 40.0

pytestmark = [pytest.mark.hardware, pytest.mark.realtime]


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.01)


class Stage:
    """Emulator in a thread of the test, I/O process and control stand-in in processes of their own."""

    def __init__(self, domain: int) -> None:
        port = free_udp_port()
        self.emulator = Emulator(EmulatorConfig(mode="", arm=ArmPorts(port, port + 1)), DdsRobotLink(DdsConfig(domain)))
        self._thread = threading.Thread(target=self.emulator.run_realtime)
        self._thread.start()
        # On a loaded machine the emulated world is slower than the wall clock by which the I/O process moves it.
        wide = HardwareLimits(
            self_test_s=0.3,
            self_test_period_s=5.0,
            state_damp_s=5.0,
            command_damp_s=3.0,
            control_damp_s=6.0,
            operator_damp_s=4.0,
            leg_velocity_rps=300.0,
            arm_velocity_rps=300.0,
            torque_s=5.0,
            stuck_s=5.0,
            orphan_s=0.5,
        )
        arm = Z1Config("127.0.0.1", port, port + 1, gain_ramp_s=0.2)
        motion = replace(BRISK, reached_rad=9.0)
        self.config = HardwareConfig(DdsConfig(domain), arm, wide, motion, dry_run=False)
        self.control: subprocess.Popen[str] | None = None
        self.io_pid = 0

    def start_control(self) -> None:
        self.control = subprocess.Popen(
            [sys.executable, str(HERE / "control_stand_in.py"), self.config.to_json()],
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._operator = threading.Thread(target=self._live, args=(self.control,), daemon=True)
        self.operator_alive = True
        self._operator.start()

    def _live(self, control: subprocess.Popen[str]) -> None:
        assert control.stdin is not None
        while self.operator_alive and control.poll() is None:
            try:
                control.stdin.write("\n")
                control.stdin.flush()
            except (BrokenPipeError, ValueError):
                return
            time.sleep(0.1)

    def drive(self) -> None:
        """Until the robot stands under the stand-in's commands."""
        self.start_control()
        assert self.control is not None and self.control.stdout is not None
        watchdog = threading.Timer(PATIENCE_S, self.control.kill)
        watchdog.start()
        for line in self.control.stdout:
            name, pid, *_ = line.split()
            self.io_pid = int(pid)
            assert name != "FAULT", line
            if name == "POLICY":
                watchdog.cancel()
                return
        raise AssertionError("the stand-in did not get there")

    def status(self) -> DriveState:
        newest = IoMemory(memory_path(self.config)).state.read()
        assert newest is not None
        return DriveState(int(newest[0]["state"]))

    def faults(self) -> Trip:
        newest = IoMemory(memory_path(self.config)).state.read()
        assert newest is not None
        return Trip(int(newest[0]["faults"]))

    def damped(self) -> bool:
        """The base obeys frames without stiffness (not its own time-out), and the arm is passive."""
        command, base = self.emulator.command, self.emulator.base
        fresh = self.emulator.body.time_s - base._command_s < 0.1
        return fresh and not command.stiffness.any() and bool((command.damping > 0).all())

    def close(self) -> None:
        self.operator_alive = False
        if self.control is not None:
            self.control.kill()
            self.control.communicate()
        self.emulator.faults.kill = True
        self._thread.join()
        self.emulator.close()


@pytest.fixture
def stage(domain: int) -> Iterator[Stage]:
    stage = Stage(domain)
    yield stage
    stage.close()


def test_control_killed_then_a_new_one_takes_over(stage: Stage) -> None:
    stage.drive()
    assert stage.control is not None
    stage.control.kill()
    wait_for(lambda: stage.status() == DriveState.FAULT and stage.damped())
    assert stage.faults() & Trip.STALE_COMMAND
    successor = HardwareBackend(stage.config)
    successor.open()
    assert successor.io_pid == stage.io_pid and successor.status().state == DriveState.FAULT

    asked = successor.request(Request.CLEAR)

    def clear() -> bool:
        nonlocal asked
        successor.heartbeat()
        status = successor.status()
        if status.request_sequence == asked and status.state == DriveState.FAULT:
            asked = successor.request(Request.CLEAR)
        return status.state == DriveState.DAMPED

    wait_for(clear)
    HardwareRemote(stage.config).estop()
    wait_for(lambda: stage.status() == DriveState.FAULT and bool(stage.faults() & Trip.ESTOP))
    successor.close()


def test_operator_silent_then_nobody_left(stage: Stage) -> None:
    stage.drive()
    stage.operator_alive = False  # the web process is gone; control lives
    wait_for(lambda: stage.status() == DriveState.FAULT and stage.damped())
    assert stage.faults() & Trip.STALE_OPERATOR
    assert stage.control is not None
    stage.control.kill()
    wait_for(lambda: not memory_path(stage.config).exists())  # at rest and orphaned: it ends


def test_without_its_shared_memory_it_hears_an_estop_damps_and_lets_go(stage: Stage) -> None:
    stage.drive()
    memory_path(stage.config).unlink()
    remote = HardwareRemote(stage.config)
    assert remote.status() is None
    wait_for(lambda: remote.report() == Answer(DriveState.POLICY, True))
    with pytest.raises(BackendError, match="another control process drives this robot"):
        HardwareBackend(stage.config).open()
    assert stage.control is not None
    stage.control.kill()
    remote.estop()
    wait_for(stage.damped)
    wait_for(lambda: (report := remote.report()) is None or report.state == DriveState.FAULT)
    successor = HardwareBackend(stage.config)
    successor.open()  # waits until its predecessor has let go
    assert successor.io_pid != stage.io_pid
    successor.close()
    wait_for(lambda: not memory_path(stage.config).exists())


def test_signals(stage: Stage) -> None:
    stage.drive()
    os.kill(stage.io_pid, signal.SIGUSR1)
    wait_for(lambda: stage.status() == DriveState.FAULT and stage.damped())
    assert stage.faults() & Trip.ESTOP
    os.kill(stage.io_pid, signal.SIGTERM)
    wait_for(lambda: not memory_path(stage.config).exists())


def test_one_writer_only(stage: Stage) -> None:
    stage.drive()
    second = subprocess.run(
        [sys.executable, "-m", "sim.backends.hardware.io.process", "--config", stage.config.to_json()],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert second.returncode == 3 and f"process {stage.io_pid} already commands this robot" in second.stderr
    assert stage.status() == DriveState.POLICY
    with pytest.raises(BackendError, match=f"another control process drives this robot .I/O process {stage.io_pid}"):
        HardwareBackend(HardwareConfig(base=stage.config.base, arm=stage.config.arm)).open()
