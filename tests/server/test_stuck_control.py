"""A control process that is stopped: nothing that waits for it delays health, e-stop and restart, however much is sent."""

import json
import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest
from websockets.sync.client import connect

from server.admission import MAX_BURST, MAX_RATE_HZ
from server.body_limit import MAX_BODY_BYTES
from server.errors import ControlTimeoutError
from server.event_channel import MAX_PENDING
from tests.server.running_server import RunningServer

PATIENCE_S = 20.0


@pytest.fixture
def stuck(server: RunningServer) -> Iterator[RunningServer]:
    """A server whose control process hangs, with as many calls waiting for it as are let through, and more."""
    pid = server.operator.client.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    body = {"mass_scale": 1.0, "per_link": {f"{number:064d}": 1.0 for number in range(64)}}
    callers = MAX_PENDING
    with (
        httpx.Client(base_url=server.http.base_url, timeout=60.0, limits=httpx.Limits(max_connections=callers)) as http,
        ThreadPoolExecutor(callers) as pool,
    ):
        for _ in range(callers):
            pool.submit(http.put, "/api/v1/mismatch", json=body)
        with pytest.raises(ControlTimeoutError):  # then all are there that will be
            while True:
                server.operator.client.submit("list_wrenches").cancel()
        time.sleep(MAX_BURST / MAX_RATE_HZ)  # the callers have used up what is served at once
        yield server
        server.http.post("/api/v1/control/restart", json={"force": True}).raise_for_status()


def test_health_answers_the_estop_latches_and_a_restart_stops_the_next_process(stuck: RunningServer) -> None:
    assert stuck.http.get("/api/v1/health", timeout=PATIENCE_S).json()["status"] in ("busy", "stalled")
    unconfirmed = stuck.http.post("/api/v1/estop", timeout=PATIENCE_S)
    assert unconfirmed.status_code == 503
    assert "restart" in unconfirmed.json()["detail"]
    refused = stuck.http.patch("/api/v1/command", json={"guidance": True}, timeout=PATIENCE_S)
    assert refused.status_code == 409 and "estop/clear" in refused.json()["detail"]
    assert stuck.http.get("/", timeout=PATIENCE_S).status_code == 200
    stuck.http.post("/api/v1/control/restart", json={"force": True}, timeout=PATIENCE_S).raise_for_status()
    assert stuck.http.get("/api/v1/state", timeout=PATIENCE_S).json()["mode"] == "estop"


def test_the_estop_acts_as_soon_as_the_process_goes_on(stuck: RunningServer) -> None:
    pid = stuck.operator.client.pid
    assert pid is not None
    with ThreadPoolExecutor(1) as pool:
        asking = pool.submit(stuck.http.post, "/api/v1/estop", timeout=PATIENCE_S)
        while not stuck.operator.client.estops.pending:
            pass
        os.kill(pid, signal.SIGCONT)
        assert asking.result(PATIENCE_S).json() == {"latched": True, "mode": "estop"}


def test_a_process_that_hangs_is_said_to_since_when_and_no_more_when_it_goes_on(server: RunningServer) -> None:
    pid = server.operator.client.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    try:
        stale = server.wait_for(lambda state: state["mode"] != "running")
        assert (stale["mode"], stale["faults"][-1]) == ("fault", "CONTROL_PROCESS_SILENT")
        assert stale["stale_s"] >= 1.0
        assert stale["loop"]["rate_hz"] == 0.0
        server.wait_for(lambda state: state["stale_s"] > stale["stale_s"])
        assert server.http.get("/api/v1/health").json()["status"] == "stalled"
        assert server.operator.client.live_snapshot() is None
        with connect(server.socket_url("/api/v1/stream?fields=stale_s")) as stream:
            streamed = [json.loads(stream.recv(10.0)) for _ in range(2)]
        assert streamed[0]["faults"][-1] == "CONTROL_PROCESS_SILENT"
        assert streamed[1]["stale_s"] > streamed[0]["stale_s"]
    finally:
        os.kill(pid, signal.SIGCONT)
    server.wait_for(lambda state: state["mode"] == "running" and state["stale_s"] == 0.0)


@pytest.mark.parametrize("announced", [True, False], ids=["announced", "chunked"])
def test_a_large_body_is_refused_unread_and_an_estop_with_one_stops(server: RunningServer, announced: bool) -> None:
    large = b'{"mass_scale": 1.0, "per_link": [' + b"1, " * 700_000 + b"1]}"
    headers = {"Content-Type": "application/json"}
    assert len(large) > 100 * MAX_BODY_BYTES
    pieces = [large[start : start + 65536] for start in range(0, len(large), 65536)]
    refused = server.http.put("/api/v1/mismatch", content=large if announced else iter(pieces), headers=headers)
    assert refused.status_code == 413
    assert "16 KiB" in refused.json()["detail"]
    stopped = server.http.post("/api/v1/estop", content=large if announced else iter(pieces), headers=headers)
    assert stopped.json() == {"latched": True, "mode": "estop"}
    assert server.state()["mode"] == "estop"
