"""The stream: the newest snapshot at the asked rate, never a queue."""

import itertools
import json
import socket

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from tests.server.running_server import RunningServer

PATH = "/api/v1/stream"


def test_it_sends_whole_states_that_advance(server: RunningServer) -> None:
    with connect(server.socket_url(f"{PATH}?rate_hz=50")) as stream:
        states = [json.loads(stream.recv(10.0)) for _ in range(5)]
    sequences = [state["sequence"] for state in states]
    assert sequences == sorted(set(sequences))
    assert set(states[0]) == set(server.state())


def test_fields_are_chosen_and_the_vital_ones_always_come_along(server: RunningServer) -> None:
    with connect(server.socket_url(f"{PATH}?fields=end_effector,loop")) as stream:
        state = json.loads(stream.recv(10.0))
    assert set(state) == {"sequence", "time_s", "mode", "faults", "end_effector", "loop"}


@pytest.mark.parametrize(
    ("query", "field", "allowed"),
    [
        ("rate_hz=0", "rate_hz", "1 to 100 Hz"),
        ("rate_hz=101", "rate_hz", "1 to 100 Hz"),
        ("rate_hz=nan", "rate_hz", "1 to 100 Hz"),
        ("rate_hz=fast", "rate_hz", "1 to 100 Hz"),
        ("fields=end_effector,secrets", "fields", "end_effector"),
        ("fields=", "fields", "end_effector"),
    ],
)
def test_wrong_queries_are_refused_before_the_socket_opens(server: RunningServer, query: str, field: str, allowed: str) -> None:
    with pytest.raises(InvalidStatus) as refused, connect(server.socket_url(f"{PATH}?{query}")):
        pass
    assert refused.value.response.status_code == 422
    detail = json.loads(refused.value.response.body or b"")["detail"][0]
    assert detail["field"] == field
    assert allowed in detail["allowed"]


def test_foreign_pages_are_refused(server: RunningServer) -> None:
    with pytest.raises(InvalidStatus) as refused, connect(server.socket_url(PATH), origin="https://evil.example"):  # pyright: ignore[reportArgumentType]
        pass
    assert refused.value.response.status_code == 403


def late(stream: Connection, server: RunningServer, last: int, unread: int) -> list[int]:
    """Numbers of the snapshots that come after `unread` of them were not read, up to the newest of then."""
    newest = server.wait_for(lambda state: state["sequence"] > last + unread)["sequence"]
    received = [last]
    while received[-1] < newest:
        received.append(json.loads(stream.recv(10.0))["sequence"])
    return received


def test_a_slow_reader_skips_to_the_newest(server: RunningServer) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as raw:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 32768)
        with connect(server.socket_url(f"{PATH}?rate_hz=100"), sock=raw, max_queue=1, compression=None) as stream:
            received = [json.loads(stream.recv(10.0))["sequence"]]
            # How much the system's own buffers hold is its business; beyond that, nothing waits.
            for unread in (200, 400, 800):
                received = late(stream, server, received[-1], unread)
                skipped = max(after - before for before, after in itertools.pairwise(received))
                if skipped > unread / 2:
                    return
    pytest.fail(f"a reader that paused for {unread} snapshots was sent {len(received)}, of which it missed {skipped} in a row")


def test_a_pause_is_still_alive_on_the_wire(server: RunningServer) -> None:
    server.http.post("/api/v1/run", json={"state": "paused"})
    with connect(server.socket_url(f"{PATH}?rate_hz=100&fields=mode")) as stream:
        states = [json.loads(stream.recv(10.0)) for _ in range(3)]
    assert {state["mode"] for state in states} == {"paused"}
