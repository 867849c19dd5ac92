"""A server that the tests of this folder share."""

from collections.abc import Iterator

import pytest

from tests.server.running_server import RunningServer, running_server


@pytest.fixture(scope="package")
def shared_server() -> Iterator[RunningServer]:
    with running_server() as running:
        yield running


@pytest.fixture
def server(shared_server: RunningServer) -> RunningServer:
    """The server with the robot at its start, running, and a client that no earlier test has made known by a cookie."""
    http = shared_server.http
    http.cookies.clear()
    if not shared_server.operator.client.alive:
        http.post("/api/v1/control/restart").raise_for_status()
    http.post("/api/v1/estop/clear").raise_for_status()
    http.put("/api/v1/mismatch", json={"mass_scale": 1.0}).raise_for_status()
    http.post("/api/v1/reset").raise_for_status()
    http.post("/api/v1/run", json={"state": "running", "speed": 1.0}).raise_for_status()
    return shared_server
