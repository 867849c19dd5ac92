"""The handle on a spawned control process: what it answers, and what happens when it is killed."""

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.errors import ControlDeadError, ControlTimeoutError, InvalidFieldError, MissingError, RefusedError, ServerError
from server.event_channel import MAX_PENDING
from server.state import faults
from sim.runtime.simulation import SimulationConfig
from sim.runtime.snapshot import Mode
from tests.server.fake_session import FakeSession, failing_session


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
    eventually(lambda: client.snapshot() is not None)
    yield client
    client.close()


def test_it_says_what_can_be_selected_and_publishes(client: ControlClient) -> None:
    assert client.wait_ready()["estimators"] == ["adaptive"]
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


@pytest.fixture
def stopped(client: ControlClient) -> Iterator[ControlClient]:
    """The client of a control process that hangs; goes on afterwards."""
    assert client.pid is not None
    os.kill(client.pid, signal.SIGSTOP)
    yield client
    with contextlib.suppress(ProcessLookupError):
        os.kill(client.pid, signal.SIGCONT)
    eventually(lambda: answers(client))


def clear_estop(client: ControlClient) -> Any:
    return client.call("clear_estop", 20.0, estops=client.estops.asked)


def test_a_process_that_hangs_times_out_and_does_not_block_its_callers(stopped: ControlClient) -> None:
    with pytest.raises(ControlTimeoutError):
        stopped.call("list_wrenches", 0.05)
    much = {f"link {number}": 1.0 for number in range(10_000)}  # more than a pipe holds
    with pytest.raises(ControlTimeoutError, match="restart"):
        for _ in range(MAX_PENDING + 1):
            stopped.submit("set_mismatch", mass_scale=1.0, per_link=much)
    eventually(lambda: stopped.snapshot_age_s() > 0.5)
    assert not stopped.death


def test_the_estop_of_a_process_that_hangs_is_the_first_thing_it_does_when_it_goes_on(stopped: ControlClient) -> None:
    assert stopped.pid is not None
    for _ in range(MAX_PENDING):
        stopped.submit("reset")
    number = stopped.estops.ask()
    assert stopped.estops.pending and not stopped.estops.taken(number)
    os.kill(stopped.pid, signal.SIGCONT)
    eventually(lambda: stopped.estops.taken(number))
    assert stopped.require_snapshot()["mode"] == Mode.ESTOP
    eventually(lambda: answers(stopped))
    assert clear_estop(stopped) == {"latched": False, "mode": "running"}


def test_an_estop_that_is_younger_than_its_clearing_stays(stopped: ControlClient) -> None:
    assert stopped.pid is not None
    clearing = stopped.submit("clear_estop", estops=stopped.estops.asked)
    number = stopped.estops.ask()
    os.kill(stopped.pid, signal.SIGCONT)
    with pytest.raises(RefusedError, match="pressed again"):
        clearing.result(20.0)
    assert stopped.estops.taken(number)
    assert stopped.require_snapshot()["mode"] == Mode.ESTOP
    clear_estop(stopped)


def test_kill_is_noticed_fails_open_calls_and_a_fresh_process_starts_in_a_hold(client: ControlClient) -> None:
    assert client.pid is not None
    last = int(client.require_snapshot()["sequence"])
    os.kill(client.pid, signal.SIGSTOP)
    given_up, open_call = client.submit("list_wrenches"), client.submit("list_wrenches")
    given_up.cancel()
    os.kill(client.pid, signal.SIGKILL)
    with pytest.raises(ControlDeadError):
        open_call.result(20.0)
    eventually(lambda: not client.alive)
    assert client.live_snapshot() is None
    assert int(client.require_snapshot()["sequence"]) >= last
    with pytest.raises(ControlDeadError, match="restart"):
        client.call("list_wrenches")

    client.restart(session=SimulationConfig(scene="box"), estopped=True, paused=True)
    eventually(lambda: client.require_snapshot()["scene"] == b"box")
    assert client.alive
    assert int(client.require_snapshot()["sequence"]) > last
    assert client.require_snapshot()["mode"] == Mode.ESTOP
    assert clear_estop(client)["mode"] == "paused"
    client.restart(session=SimulationConfig(), estopped=False, paused=False)  # as the other tests find it


def test_an_estop_that_finds_no_process_is_latched_by_the_next(client: ControlClient) -> None:
    assert client.pid is not None
    os.kill(client.pid, signal.SIGKILL)
    eventually(lambda: not client.alive)
    number = client.estops.ask()
    client.restart(estopped=False)
    eventually(lambda: client.estops.taken(number))
    assert client.require_snapshot()["mode"] == Mode.ESTOP
    client.restart()
    eventually(lambda: client.require_snapshot()["mode"] != Mode.ESTOP)


def test_a_loop_that_cannot_keep_its_rate_says_so(client: ControlClient) -> None:
    client.call("run", 20.0, state="running", speed=None)
    client.call("set_scene", 20.0, name="slow")
    eventually(lambda: client.require_snapshot()["overrun_share"] > 0.9)
    assert "LOOP_OVERRUNS" in faults(client.require_snapshot())
    assert client.require_snapshot()["mode"] == Mode.RUNNING
    client.call("set_scene", 20.0, name="free")


def test_a_session_that_cannot_start_says_why() -> None:
    client = ControlClient(ControlLaunch(make_session=failing_session))
    client.start()
    with pytest.raises(ControlDeadError, match="switch it on"):
        client.wait_ready()
    client.close()
