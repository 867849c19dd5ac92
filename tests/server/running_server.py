"""A server as people run it, on a free port, around the real session but with a stand-in for the 3-D scene's server."""

import asyncio
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import httpx
import uvicorn
import websockets
from fastapi import FastAPI
from websockets.exceptions import ConnectionClosed

from server.app import create_app
from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.operator import Operator
from server.web_server import uvicorn_config
from sim.recording.folder import RecordingFolder
from tests.server.contract import check_answer
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


@contextmanager
def running_server(launch: ControlLaunch | None = None) -> Iterator[RunningServer]:
    """Its processes and threads end with the context."""
    launch = launch or ControlLaunch()
    with closing(ControlClient(launch)) as client, _scene() as scene, tempfile.TemporaryDirectory() as data:
        client.start()
        operator = Operator(client, launch, recordings=RecordingFolder(Path(data)))
        client.wait_ready()
        app = create_app(operator, scene=scene)
        with _served(app) as port, _client(port) as http:
            running = RunningServer(port, operator, http)
            running.wait_for(lambda state: state.get("time_s", 0.0) > 0.0)
            yield running
            operator.recordings.end()


def _client(port: int) -> httpx.Client:
    """Holds every answer of every test against its schema."""
    return httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30.0, event_hooks={"response": [check_answer]})


@contextmanager
def _scene() -> Iterator[ViserDoor]:
    """The door to an echo that stands in for Viser, on an event loop in a thread of its own."""

    async def echo(connection: Connection) -> None:
        with suppress(ConnectionClosed):
            while True:
                await connection.send(await connection.recv())

    def choose(_: object, offered: Sequence[str]) -> str | None:
        return SCENE_PROTOCOL if SCENE_PROTOCOL in offered else None

    async def serve() -> None:
        async with door.serve(echo, select_subprotocol=choose):
            opened.set()
            await asyncio.to_thread(ended.wait)

    door, opened, ended = ViserDoor(), threading.Event(), threading.Event()
    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert opened.wait(10.0)
    try:
        yield door
    finally:
        ended.set()
        thread.join()


@contextmanager
def _served(app: FastAPI) -> Iterator[int]:
    """Port of an application."""
    server = uvicorn.Server(uvicorn_config(app))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            while not server.started:
                time.sleep(0.01)
            yield listener.getsockname()[1]
        finally:
            server.should_exit = True
            thread.join()
