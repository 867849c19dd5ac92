"""A server as people run it, on a free port, around the real session but with a stand-in for the 3-D scene's server."""

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import httpx
import pytest
import uvicorn
import websockets
from websockets.exceptions import ConnectionClosed

from server.app import create_app
from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.operator import Operator
from server.web_server import uvicorn_config
from web.viser_door import Connection, ViserDoor

SCENE_PROTOCOL = websockets.Subprotocol("viser-test")


@dataclass
class RunningServer:
    """A server in this process, its control process, and a client of it."""

    port: int
    operator: Operator
    http: httpx.Client

    def socket_url(self, path: str) -> str:
        return f"ws://127.0.0.1:{self.port}{path}"

    def state(self) -> dict:
        return self.http.get("/api/v1/state").json()

    def wait_for(self, condition: Callable[[dict], bool]) -> dict:
        """The first state that fulfils a condition."""
        end = time.monotonic() + 20.0
        while not condition(state := self.state()):
            assert time.monotonic() < end, f"did not happen; the state is {state}"
            time.sleep(0.01)
        return state


async def _echo(connection: Connection) -> None:
    with contextlib.suppress(ConnectionClosed):
        while True:
            await connection.send(await connection.recv())


def _choose(_: object, offered: Sequence[str]) -> str | None:
    return SCENE_PROTOCOL if SCENE_PROTOCOL in offered else None


class _Background:
    """An event loop in a thread, where an echo behind a door stands in for Viser."""

    def __init__(self) -> None:
        self.door = ViserDoor()
        self._opened = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)
        self._thread.start()
        assert self._opened.wait(10.0)

    async def _serve(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        async with self.door.serve(_echo, select_subprotocol=_choose):
            self._opened.set()
            await self._stop.wait()

    def stop(self) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(5.0)


@pytest.fixture(scope="session")
def shared_server() -> Iterator[RunningServer]:
    launch = ControlLaunch()
    client = ControlClient(launch)
    client.start()
    scene = _Background()
    operator = Operator(client, launch)
    client.wait_ready()
    server = uvicorn.Server(uvicorn_config(create_app(operator, scene=scene.door)))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30.0) as http:
            running = RunningServer(port, operator, http)
            while not server.started:
                time.sleep(0.01)
            running.wait_for(lambda state: state.get("time_s", 0.0) > 0.0)
            yield running
        server.should_exit = True
        thread.join(10.0)
    scene.stop()
    client.close()


@pytest.fixture
def server(shared_server: RunningServer) -> RunningServer:
    """The server with the robot at its start, running."""
    http = shared_server.http
    if not shared_server.operator.client.alive:
        http.post("/api/v1/control/restart").raise_for_status()
    http.post("/api/v1/estop/clear").raise_for_status()
    http.put("/api/v1/mismatch", json={"mass_scale": 1.0}).raise_for_status()
    http.post("/api/v1/reset").raise_for_status()
    http.post("/api/v1/run", json={"state": "running", "speed": 1.0}).raise_for_status()
    return shared_server
