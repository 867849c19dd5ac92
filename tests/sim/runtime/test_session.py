"""A session around any backend: it ticks, latches and fills a snapshot, and what the backend has not is not available."""

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.types import JointCommand, SensorFrame
from sim.runtime.session import Session, SessionError
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SETPOINT, SNAPSHOT, Mode, command_to_record

TICKS = 30


class ReplayedRobot:
    """A backend that reads a log, one frame a tick, and remembers what it is told."""

    name = "replay"

    def __init__(self, frames: list[SensorFrame]) -> None:
        self._frames = frames
        self.commands: list[JointCommand] = []
        self.opened = False

    def open(self) -> None:
        self.opened = True

    def read(self) -> SensorFrame:
        return self._frames[len(self.commands)]

    def write(self, command: JointCommand) -> None:
        self.commands.append(command)

    def truth(self) -> None:
        return None

    def close(self) -> None:
        self.opened = False


@pytest.fixture(scope="module")
def log() -> tuple[list[SensorFrame], list[JointCommand]]:
    """Sensor frames of a simulation, and what its pipeline commanded on them."""
    simulation = Simulation(SimulationConfig(seed=4))
    frames, commands = [], []
    for _ in range(TICKS):
        frames.append(simulation.backend.read())
        commands.append(simulation.tick(DEFAULT_COMMAND).joint_command)
    return frames, commands


@pytest.fixture
def robot(log: tuple[list[SensorFrame], list[JointCommand]]) -> ReplayedRobot:
    return ReplayedRobot(log[0])


def test_a_session_drives_any_backend_as_it_drives_the_simulation(
    robot: ReplayedRobot, log: tuple[list[SensorFrame], list[JointCommand]]
) -> None:
    session = Session(robot)
    assert robot.opened
    setpoint = np.zeros(1, SETPOINT)[0]
    command_to_record(DEFAULT_COMMAND, setpoint["command"])
    setpoint["sequence"] = 3
    setpoint["drag_active"] = True  # nothing to drag
    for _ in range(TICKS - 1):
        session.tick_setpoint(setpoint, age_s=0.0)
    for told, original in zip(robot.commands, log[1], strict=False):
        np.testing.assert_array_equal(told.position, original.position)
        np.testing.assert_array_equal(told.torque, original.torque)

    snapshot = np.zeros(1, SNAPSHOT)[0]
    session.track_errors(0.02)
    session.fill(snapshot)
    assert snapshot["backend"] == b"replay" and snapshot["mode"] == Mode.RUNNING and snapshot["command_sequence"] == 3
    assert np.isfinite(snapshot["joint_position"]).all()
    for name in ("force_true_n", "wheel_force_true_n", "mass_scale_true", "drag_force_n", "force_errors_rms_n"):
        assert np.isnan(snapshot[name]).all(), name  # not available, never zero
    assert not snapshot["drag_active"] and snapshot["object_count"] == 0 and snapshot["scene"] == b""


def test_the_estop_latches_on_any_backend(robot: ReplayedRobot) -> None:
    session = Session(robot)
    with pytest.raises(SessionError, match="tick"):
        _ = session.output
    session.tick(DEFAULT_COMMAND)
    session.estop()
    session.tick(DEFAULT_COMMAND)
    assert session.mode is Mode.ESTOP
    assert not robot.commands[-1].stiffness.any() and robot.commands[0].stiffness.any()
    session.clear_estop()
    assert session.mode is not Mode.ESTOP
