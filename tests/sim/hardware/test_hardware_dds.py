"""The drivers against the emulated robot over real DDS and UDP, on loopback and in lockstep: no clock decides anything."""

import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest

from control.joints import DAMPING, NOMINAL_POSITION, STIFFNESS
from control.paths import ROOT
from control.types import JointCommand
from sim.backends.hardware.backend import unavailable_because
from sim.backends.hardware.io.command_limiter import stack
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.hardware.robot import Robot
from sim.backends.protocol import BackendError
from sim.backends.unitree.dds import DdsBaseLink, DdsConfig, RobotNetworkError
from sim.backends.unitree.mode_release import ModeRelease
from sim.backends.z1.driver import Z1Config
from sim.emulator.physics import CROUCH
from sim.emulator.process import free_udp_port

PATIENCE_S = 30.0


@pytest.fixture
def robot(domain: int) -> Iterator[tuple[Robot, subprocess.Popen[str]]]:
    """Drivers here, `python -m sim.emulator --lockstep` in a process of its own."""
    port = free_udp_port()
    command = [sys.executable, "-m", "sim.emulator", "--lockstep", "--domain", str(domain), "--arm-port", str(port)]
    emulator = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    arm = Z1Config("127.0.0.1", port, port + 1, gain_ramp_s=0.2)
    robot = Robot(DdsBaseLink(DdsConfig(domain)), arm, HardwareLimits(), dry_run=False, echo_tick=True)
    yield robot, emulator
    robot.close()
    emulator.kill()
    emulator.communicate()


def next_state(robot: Robot) -> float:
    """Wait for the next state; returns the robot's time."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        robot.base.link.wait(0.1)
        now = 0.0 if robot.base.reading is None else 1e-3 * robot.base.reading.tick_ms
        if robot.poll(now):
            assert robot.base.reading is not None
            return 1e-3 * robot.base.reading.tick_ms
    raise AssertionError("the emulator is silent")


def release(robot: Robot) -> None:
    next_state(robot)
    mode = ModeRelease(robot.base.link, time.monotonic(), PATIENCE_S)
    mode.LIE_DOWN_S = 0.0
    mode.ASK_EVERY_S = 0.05
    while not mode.done and mode.failure is None:
        mode.step(time.monotonic())
        time.sleep(0.01)
    assert mode.failure is None


def drive(robot: Robot, goal: np.ndarray, steps: int) -> list[np.ndarray]:
    """Move from the measured posture to `goal`, one command per state; returns the measured positions."""
    time_s = next_state(robot)
    assert robot.frame is not None
    start, zero, measured = robot.frame.joint_position.copy(), np.zeros(22), []
    for step in range(steps):
        target = start + min(1.0, 1.5 * step / steps) * (goal - start)
        answered_s = time_s
        while time_s == answered_s:  # a state that comes again is answered again
            robot.write(time_s, stack(JointCommand(target, zero, 2.0 * STIFFNESS, DAMPING)))
            time_s = next_state(robot)
        measured.append(robot.frame.joint_position.copy())
    return measured


@pytest.mark.hardware
def test_lockstep_over_dds_answers_every_state(robot: tuple[Robot, subprocess.Popen[str]]) -> None:
    driver, emulator = robot
    release(driver)
    measured = drive(driver, NOMINAL_POSITION, 700)
    assert driver.base.reading is not None
    assert driver.base.reading.tick_ms == 2 * 700  # one step per command, none twice, none skipped
    assert driver.base.missed == 0 and driver.base.bad_samples == 0
    assert np.abs(measured[-1][:12] - NOMINAL_POSITION[:12]).max() < 0.4  # it stands up
    assert np.abs(measured[-1][:12] - CROUCH[:12]).max() > 0.5
    assert driver.arm.reading is not None and driver.arm.received >= 700
    assert emulator.stdin is not None
    emulator.stdin.write('{"kill": true}\n')
    emulator.stdin.flush()
    assert emulator.wait(PATIENCE_S) == 137


@pytest.mark.hardware
def test_a_second_writer_shows_up_by_count_and_by_traffic(robot: tuple[Robot, subprocess.Popen[str]]) -> None:
    driver, emulator = robot
    release(driver)
    drive(driver, CROUCH, 5)
    assert driver.base.link.foreign_frames() == 0 and driver.base.link.foreign_writers() == 0
    assert emulator.stdin is not None
    emulator.stdin.write('{"second_writer": true}\n')
    emulator.stdin.flush()
    deadline = time.monotonic() + PATIENCE_S
    while not (driver.base.link.foreign_writers() and driver.base.link.foreign_frames()):
        drive(driver, CROUCH, 5)
        assert time.monotonic() < deadline


@pytest.mark.parametrize("options", [{"domain": 0}, {"interface": "eth0"}, {"domain": 0, "interface": "eth0"}])
def test_a_robots_network_needs_consent(options: dict[str, object]) -> None:
    with pytest.raises(RobotNetworkError, match="allow_robot"):
        DdsConfig(**options)  # type: ignore[arg-type]
    assert DdsConfig(**options, allow_robot=True).xml  # type: ignore[arg-type]


@pytest.mark.parametrize("options", [{"domain": 231}, {"interface": 'lo"/><x'}])
def test_nonsense_networks_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        DdsConfig(**options)  # type: ignore[arg-type]


@pytest.mark.hardware
def test_another_version_of_the_library_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert unavailable_because() is None
    monkeypatch.setattr("sim.backends.unitree.dds.metadata.version", lambda name: "0.10.5")
    assert "needs cyclonedds 11.0.1" in str(unavailable_because()) and "found 0.10.5" in str(unavailable_because())
    with pytest.raises(BackendError, match="pip install"):
        DdsBaseLink(DdsConfig())


@pytest.mark.hardware
def test_an_interface_that_does_not_exist_is_named(domain: int) -> None:
    with pytest.raises(BackendError, match="nosuch0"):
        DdsBaseLink(DdsConfig(domain, "nosuch0", allow_robot=True))
