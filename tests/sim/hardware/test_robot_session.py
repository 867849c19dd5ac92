"""The whole stack on the emulated robot, unchanged: sensors over the wire, estimator, controller, drives over the wire."""

from pathlib import Path

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.faults import Fault
from control.types import Command, JointCommand
from sim.backends.hardware.backend import HardwareBackend
from sim.backends.hardware.io.loop import IoLoop
from sim.backends.hardware.records import IoMemory
from sim.backends.hardware.states import DriveState
from sim.runtime.fault_words import fault_words, message
from sim.runtime.robot_session import RobotSession
from sim.runtime.snapshot import SNAPSHOT, Mode
from tests.misshapen_controller import Misshapen
from tests.sim.hardware.hardware_rig import Rig


class LockstepBackend(HardwareBackend):
    """HardwareBackend whose I/O process and robot advance by one tick with every write."""

    def __init__(self, rig: Rig, path: Path) -> None:
        super().__init__(rig.config, clock=lambda: rig.now)
        self._rig = rig
        self._path = path

    def open(self) -> None:
        memory = IoMemory(self._path, create=True)
        self._loop = IoLoop(self._rig.config, self._rig.robot, self._rig.supervisor, memory)
        self._memory = memory
        while self._frame is None:
            self.advance()
            self._refresh()

    def write(self, command: JointCommand) -> None:
        super().write(command)
        self.advance()

    def advance(self) -> None:
        self._rig.emulator.step()
        self._loop.tick(self._rig.now)


class Bench:
    def __init__(self, rig: Rig, path: Path) -> None:
        self.rig = rig
        self.backend = LockstepBackend(rig, path)
        self.session = RobotSession(self.backend)

    def run(self, ticks: int, command: Command = DEFAULT_COMMAND, age_s: float = 0.0) -> None:
        for _ in range(ticks):
            self.session.tick(command, age_s)

    @property
    def snapshot(self) -> np.void:
        record = np.zeros(1, SNAPSHOT)[0]
        self.session.fill(record)
        return record

    def drive(self, request: str, goal: DriveState) -> None:
        self.session.drive(request)
        for _ in range(2000):
            self.session.tick(DEFAULT_COMMAND)
            if self.backend.state == goal:
                return
        raise AssertionError(self.backend.status().message)


@pytest.fixture
def bench(rig: Rig, tmp_path: Path) -> Bench:
    return Bench(rig, tmp_path / "memory")


@pytest.fixture
def standing(bench: Bench) -> Bench:
    bench.rig.start_standing()
    bench.drive("start", DriveState.POLICY)
    bench.run(200)
    return bench


@pytest.mark.slow
def test_guidance_works_on_the_emulated_robot(standing: Bench) -> None:
    robot = standing.rig.emulator.body.backend
    guided = Command(
        DEFAULT_COMMAND.mask,
        DEFAULT_COMMAND.force_n,
        DEFAULT_COMMAND.position_m,
        DEFAULT_COMMAND.orientation_wxyz,
        DEFAULT_COMMAND.base_velocity,
        guidance=True,
    )
    start = robot.truth().base_position[0]
    for _ in range(60):
        robot.set_drag(robot.truth().end_effector_position + [0.1, 0.0, 0.0])
        standing.run(10, guided)
    assert robot.truth().base_position[0] - start > 0.1  # it follows the hand
    record = standing.snapshot
    assert record["backend"] == b"hardware" and record["mode"] == Mode.RUNNING
    np.testing.assert_allclose(record["force_estimated_n"], robot.truth().force_true_n, atol=3.0)
    for name in ("force_true_n", "wheel_force_true_n", "mass_scale_true", "drag_force_n", "force_errors_rms_n"):
        assert np.isnan(record[name]).all(), name  # unavailable, never zero
    status = standing.backend.status()
    assert status.state == DriveState.POLICY and len(status.motors) == 22 and status.states_missed == 0
    assert all(30.0 < motor.temperature_c < 60.0 for motor in status.motors)


def test_estop_latches_on_both_sides_and_clearing_needs_rest(standing: Bench) -> None:
    standing.session.estop()
    standing.run(2)
    assert standing.session.mode == Mode.ESTOP and standing.backend.state == DriveState.FAULT
    assert standing.rig.damps() and standing.backend.status().faults == ("e-stop",)
    standing.session.clear_estop()
    standing.run(2)
    assert standing.session.mode == Mode.FAULT  # still falling
    for _ in range(4000):
        standing.backend.advance()
        if standing.rig.supervisor.at_rest:
            break
    standing.session.clear_estop()
    standing.run(2)
    assert standing.session.mode == Mode.RUNNING and standing.backend.state == DriveState.DAMPED


def test_a_silent_page_damps(standing: Bench) -> None:
    standing.run(2, age_s=0.9)
    assert standing.backend.state == DriveState.POLICY
    standing.run(2, age_s=1.1)
    assert standing.session.mode == Mode.FAULT and standing.rig.damps()


def test_a_controller_with_a_defect_shows_before_it_is_started_and_is_a_fault_while_it_drives(bench: Bench) -> None:
    bench.rig.start_standing()
    pipeline = bench.session.pipeline
    pipeline.add_controller("misshapen", Misshapen(pipeline.controllers["model_based"], sound_s=0.1))
    bench.run(2)
    bench.session.select_controller("misshapen")
    bench.run(40)
    assert bench.snapshot["faults"] == 0
    bench.run(80)
    record = bench.snapshot
    assert bench.backend.state == DriveState.READY and not bench.rig.damps()
    assert record["mode"] == Mode.RUNNING and message(record) is None  # the held stance needs no controller
    assert "misshapen, ValueError: operands could not be broadcast" in fault_words(record)["CONTROLLER_ERROR"]
    assert record["faults"] == Fault.CONTROLLER_ERROR  # what is late or limited has no meaning before it acts

    bench.drive("start", DriveState.POLICY)
    for _ in range(200):
        bench.run(1)
        if bench.rig.damps():
            break
    record = bench.snapshot
    assert bench.backend.state == DriveState.POLICY
    assert record["mode"] == Mode.FAULT and "misshapen" in str(message(record))


def test_an_estimator_with_a_defect_shows_before_the_controller_is_started(bench: Bench) -> None:
    def fail() -> None:
        raise ArithmeticError("no force today")

    bench.rig.start_standing()
    bench.session.pipeline.estimators["hybrid"].estimate = fail  # pyright: ignore[reportAttributeAccessIssue]
    bench.run(60)
    words = fault_words(bench.snapshot)
    assert "hybrid, ArithmeticError: no force today" in words["ESTIMATOR_ERROR"] and "ESTIMATOR_STALE" in words


def test_a_page_can_walk_the_robot_through_its_states(bench: Bench) -> None:
    bench.drive("engage", DriveState.DAMPED)
    bench.drive("release", DriveState.OBSERVE)
    bench.session.drive("stand")
    bench.run(2)
    status = bench.backend.status()
    assert status.refused and "stand up from DAMPED" in status.message


def test_a_robot_has_no_truth_and_knows_its_requests(bench: Bench) -> None:
    with pytest.raises(ValueError, match="engage, stand, start"):
        bench.session.drive("jump")
    assert bench.session.truth() is None
