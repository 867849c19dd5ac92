"""The handle on a spawned control process: what it answers, and what happens when it is killed."""

import os
import signal
import time
from collections.abc import Callable, Iterator

import pytest
from fake_session import FakeSession, failing_session

from server.control_client import MAX_PENDING, ControlClient
from server.control_process import ControlLaunch
from server.errors import ControlDeadError, ControlTimeoutError, InvalidFieldError, MissingError, RefusedError, ServerError
from sim.runtime.simulation import SimulationConfig
from sim.runtime.snapshot import Mode


def eventually(condition: Callable[[], bool]) -> None:
    """Wait for a condition that another process brings about."""
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end, "did not happen"
        time.sleep(0.01)


def answers(client: ControlClient) -> bool:
    """Whether there is room for another call."""
    try:
        return client.call("list_wrenches", 20.0) == []
    except ControlTimeoutError:
        return False


@pytest.fixture(scope="module")
def client() -> Iterator[ControlClient]:
    client = ControlClient(ControlLaunch(make_session=FakeSession))
    client.start()
    client.wait_ready()
    yield client
    client.close()


def test_it_says_what_can_be_selected_and_publishes(client: ControlClient) -> None:
    assert client.wait_ready()["estimators"] == ["adaptive"]
    eventually(lambda: client.snapshot() is not None)
    first = int(client.require_snapshot()["sequence"])
    eventually(lambda: int(client.require_snapshot()["sequence"]) > first + 3)


@pytest.mark.parametrize(
    ("event", "arguments", "error"),
    [
        ("drive", {"request": "stand"}, RefusedError),
        ("select_estimator", {"name": "x"}, InvalidFieldError),
        ("remove_wrench", {"key": 1}, MissingError),
        ("select_controller", {"name": "x"}, ServerError),
    ],
)
def test_errors_arrive_as_what_they_mean(client: ControlClient, event: str, arguments: dict, error: type) -> None:
    with pytest.raises(error):
        client.submit(event, **arguments).result(20.0)


def test_a_set_point_arrives_with_a_fresh_heartbeat(client: ControlClient) -> None:
    client.write_setpoint(sequence=77)
    eventually(lambda: int(client.require_snapshot()["command_sequence"]) == 77)


def test_a_process_that_hangs_times_out_and_does_not_block_its_callers(client: ControlClient) -> None:
    assert client.pid is not None
    os.kill(client.pid, signal.SIGSTOP)
    try:
        with pytest.raises(ControlTimeoutError):
            client.call("estop", 0.05)
        with pytest.raises(ControlTimeoutError, match="restart"):
            for _ in range(MAX_PENDING + 1):
                client.submit("list_wrenches")
        eventually(lambda: client.snapshot_age_s() > 0.5)
        assert not client.busy
    finally:
        os.kill(client.pid, signal.SIGCONT)
    eventually(lambda: answers(client))
    assert client.call("clear_estop", 20.0) == {"latched": False, "mode": "running"}


def test_kill_is_noticed_fails_open_calls_and_a_fresh_process_starts_in_a_hold(client: ControlClient) -> None:
    assert client.pid is not None
    last = int(client.require_snapshot()["sequence"])
    os.kill(client.pid, signal.SIGSTOP)
    open_call = client.submit("list_wrenches")
    os.kill(client.pid, signal.SIGKILL)
    with pytest.raises(ControlDeadError):
        open_call.result(20.0)
    eventually(lambda: not client.alive)
    assert client.live_snapshot() is None
    assert int(client.require_snapshot()["sequence"]) >= last
    with pytest.raises(ControlDeadError, match="restart"):
        client.call("estop")

    client.restart(session=SimulationConfig(scene="box"), estopped=True, paused=True)
    eventually(lambda: client.require_snapshot()["scene"] == b"box")
    assert client.alive
    assert int(client.require_snapshot()["sequence"]) > last
    assert client.require_snapshot()["mode"] == Mode.ESTOP
    assert client.call("clear_estop", 20.0)["mode"] == "paused"


def test_a_session_that_cannot_start_says_why() -> None:
    client = ControlClient(ControlLaunch(make_session=failing_session))
    client.start()
    with pytest.raises(ControlDeadError, match="switch it on"):
        client.wait_ready()
    client.close()
