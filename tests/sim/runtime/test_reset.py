"""Same seed, same inputs, same bytes, whatever came before the reset."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.types import Command
from sim.backends.protocol import BackendError
from sim.runtime.session import SessionError
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SETPOINT, SNAPSHOT, command_to_record

DRIVE_AND_PRESS = replace(
    DEFAULT_COMMAND,
    mask=np.array([0.0, 0.0, 1.0]),
    force_n=np.array([0.0, 0.0, 6.0]),
    base_velocity=np.array([0.3, 0.0, 0.2]),
)
LIVE_ERROR_PERIOD = 10


def run(session: Simulation, command: Command, ticks: int, drag: np.ndarray | None = None) -> None:
    setpoint = np.zeros(1, SETPOINT)[0]
    command_to_record(command, setpoint["command"])
    setpoint["drag_active"] = drag is not None
    setpoint["drag_target_in_world"] = 0.0 if drag is None else drag
    for tick in range(ticks):
        session.tick_setpoint(setpoint, age_s=0.0)
        if tick % LIVE_ERROR_PERIOD == 0:
            session.track_errors(0.02)


def story(session: Simulation, record: np.ndarray) -> Iterator[bytes]:
    """State of the world, and the snapshot as `record` holds it afterwards, along a run that starts with a reset."""
    session.reset(seed=7)
    for command, ticks in ((DEFAULT_COMMAND, 1), (DEFAULT_COMMAND, 249), (DRIVE_AND_PRESS, 200), (DRIVE_AND_PRESS, 300)):
        if command is DRIVE_AND_PRESS:
            session.add_wrench(force_n=[0.0, 5.0, 0.0], duration_s=0.3)
        run(session, command, ticks)
        session.fill(record[0])
        record["sequence"] = 0  # counts on
        data = session.backend.data
        yield data.qpos.tobytes() + data.qvel.tobytes() + data.qacc_warmstart.tobytes()
        yield record.tobytes()


def nothing(_: Simulation) -> None:
    pass


def driving(session: Simulation) -> None:
    run(session, DRIVE_AND_PRESS, 333)


def leading_by_the_hand(session: Simulation) -> None:
    run(session, replace(DEFAULT_COMMAND, guidance=True), 107, drag=np.array([1.2, 0.3, 0.6]))


def other_law_and_estimator(session: Simulation) -> None:
    session.select_controller("model_based")
    session.select_estimator("gmo_pi")
    run(session, DRIVE_AND_PRESS, 55)
    session.select_controller("policy")
    session.select_estimator("hybrid")


def damping(session: Simulation) -> None:
    session.estop()
    run(session, DEFAULT_COMMAND, 61)
    session.clear_estop()


def another_robot(session: Simulation) -> None:
    session.set_mismatch(1.2, {"arm_link3": 0.8})
    run(session, DRIVE_AND_PRESS, 203)
    session.set_mismatch(1.0)


def another_world(session: Simulation) -> None:
    session.set_scene("box")
    run(session, DRIVE_AND_PRESS, 99)
    session.set_scene("free")


def divergence(session: Simulation) -> None:
    session.add_wrench(force_n=[0.0, 0.0, 280.0], duration_s=1.0)
    session.backend.data.qvel[:] = 1e9
    with pytest.raises(BackendError):
        run(session, DEFAULT_COMMAND, 3)


@pytest.fixture(scope="module")
def first_time() -> list[bytes]:
    return list(story(Simulation(SimulationConfig()), np.zeros(1, SNAPSHOT)))


@pytest.mark.parametrize(
    "before",
    [nothing, driving, leading_by_the_hand, other_law_and_estimator, damping, another_robot, another_world, divergence],
)
def test_nothing_survives_a_reset(first_time: list[bytes], before: Callable[[Simulation], None]) -> None:
    session, record = Simulation(SimulationConfig(seed=3)), np.zeros(1, SNAPSHOT)
    run(session, DEFAULT_COMMAND, 20)
    session.fill(record[0])
    before(session)
    assert list(story(session, record)) == first_time


def test_after_a_reset_there_is_nothing_to_show_before_a_tick() -> None:
    session = Simulation(SimulationConfig())
    run(session, DRIVE_AND_PRESS, 3)
    session.reset()
    with pytest.raises(SessionError, match="tick"):
        session.fill(np.zeros(1, SNAPSHOT)[0])
