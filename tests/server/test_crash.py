"""A control process that is killed: health and state say so, and a restart on request brings a safe hold."""

import os
import signal

import pytest

from tests.server.running_server import RunningServer


@pytest.fixture
def crashed(server: RunningServer) -> RunningServer:
    server.http.patch("/api/v1/command", json={"base_velocity": [0.3, 0, 0]}).raise_for_status()
    pid = server.operator.client.pid
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    server.wait_for(lambda state: state["mode"] == "fault")
    return server


def test_kill_shows_and_restart_holds(crashed: RunningServer) -> None:
    server = crashed
    health = server.http.get("/api/v1/health")
    assert health.status_code == 503
    assert health.json()["status"] == "dead"
    state = server.state()
    assert "CONTROL_PROCESS_DEAD" in state["faults"]
    assert state["loop"]["rate_hz"] == 0.0

    for method, path, body in (
        ("POST", "run", {"state": "running"}),
        ("PATCH", "command", {"guidance": True}),
        ("PUT", "scene", {"name": "free"}),
        ("GET", "wrenches", None),
    ):
        refused = server.http.request(method, f"/api/v1/{path}", json=body)
        assert refused.status_code == 503, path
        assert "/api/v1/control/restart" in refused.json()["detail"]

    assert server.http.post("/api/v1/control/restart").status_code == 200
    held = server.wait_for(lambda state: state["mode"] == "paused")
    assert "CONTROL_PROCESS_DEAD" not in held["faults"]
    assert held["command"]["base_velocity"] == [0.0, 0.0, 0.0]
    assert server.http.get("/api/v1/health").status_code == 200


def test_a_latched_estop_outlives_the_process(server: RunningServer) -> None:
    server.http.post("/api/v1/estop").raise_for_status()
    assert server.http.post("/api/v1/control/restart", json={"force": True}).status_code == 200
    server.wait_for(lambda state: state["mode"] == "estop" and "CONTROL_PROCESS_DEAD" not in state["faults"])


def test_an_estop_while_nothing_runs_is_latched_by_the_next_process(crashed: RunningServer) -> None:
    server = crashed
    assert server.http.post("/api/v1/estop").json() == {"latched": True, "mode": "fault"}
    assert server.http.post("/api/v1/estop/clear").status_code == 503
    server.http.post("/api/v1/control/restart").raise_for_status()
    server.wait_for(lambda state: state["mode"] == "estop")
    assert server.http.patch("/api/v1/command", json={"guidance": True}).status_code == 409
