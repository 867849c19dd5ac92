"""A real server in processes of its own, as the loop benchmark sees it: through HTTP, websockets and /proc."""

import asyncio
import http.client
import json
import os
import signal
import subprocess
import sys
import time
import urllib.parse
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any

import msgspec
import websockets

from control.paths import ROOT

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [2.0, 2.0, 1.0],
    "fov": 1.0,
    "near": 0.01,
    "far": 100.0,
    "image_height": 720,
    "image_width": 1280,
    "look_at": [0.0, 0.0, 0.3],
    "up_direction": [0.0, 0.0, 1.0],
}
"""Viser's scene is drawn for clients that have said where they look from."""


class ServerProcess:
    """`python -m server` on a free port, with a connection that is kept open; its standard error goes to `errors`.

    Attributes:
        start_s: from the command to a page with its scene served.
        pid: of the web process.
        control_pid: of the control process.
    """

    def __init__(self, *arguments: str, errors: IO[str] | None = None) -> None:
        started = time.perf_counter()
        command = [sys.executable, "-m", "server", "--no-browser", "--port", "0", *arguments]
        self._process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=errors, text=True)
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if "http" not in line:
            raise RuntimeError(f"{' '.join(command)} did not start; see its errors above")
        self.port = urllib.parse.urlsplit(line.split()[-1]).port or 80
        self._connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30.0)
        for path in ("/", "/viser/", "/api/v1/state"):
            self.request("GET", path)
        self.start_s = time.perf_counter() - started
        self.pid = self._process.pid
        self.control_pid = next(pid for pid in children(self.pid) if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes())

    def request(self, method: str, path: str, body: Any = None) -> Any:
        """Answer of a call, parsed if it is JSON.

        Raises:
            RuntimeError: the call was refused.
        """
        content = None if body is None else json.dumps(body)
        headers = {"Content-Type": "application/json"}
        try:
            self._connection.request(method, path, content, headers)
            response = self._connection.getresponse()
        except http.client.RemoteDisconnected:  # the server closes connections that were idle for seconds
            self._connection.close()
            self._connection.request(method, path, content, headers)
            response = self._connection.getresponse()
        text = response.read()
        if response.status >= 400:
            raise RuntimeError(f"{method} {path}: {response.status} {text.decode()}")
        return json.loads(text) if "json" in response.getheader("Content-Type", "") else text

    def state(self) -> dict[str, Any]:
        """GET /api/v1/state."""
        return self.request("GET", "/api/v1/state")

    def resident_mb(self) -> float:
        """Resident memory of all its processes."""
        return sum(resident_mb(pid) for pid in (self.pid, *children(self.pid)))

    def web_cpu_s(self) -> float:
        """Processor time of the web process so far."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S

    def stop(self) -> None:
        """End it."""
        self._connection.close()
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(15.0)
        except subprocess.TimeoutExpired:
            self._process.kill()


def resident_mb(pid: int) -> float:
    """Resident memory of one process."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def children(pid: int) -> list[int]:
    """Process ids of the direct children of any thread of a process."""
    return [int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()]


def watch(port: int, clients: int, rate_hz: float, meanwhile: Callable[[], None]) -> int:
    """Run `meanwhile` while browsers' worth of sockets (state stream and 3-D scene) are read; returns states per client."""
    return asyncio.run(_watch(port, clients, rate_hz, meanwhile))


async def _watch(port: int, clients: int, rate_hz: float, meanwhile: Callable[[], None]) -> int:
    received = [0] * clients
    readers = [asyncio.create_task(_read_stream(port, rate_hz, received, i)) for i in range(clients)]
    readers += [asyncio.create_task(_read_scene(port)) for _ in range(clients)]
    await asyncio.sleep(2.0)  # until the scene has been sent
    before = sum(received)
    await asyncio.to_thread(meanwhile)
    after = sum(received)
    for reader in readers:
        reader.cancel()
    await asyncio.gather(*readers, return_exceptions=True)
    return (after - before) // clients


async def _read_stream(port: int, rate_hz: float, received: list[int], index: int) -> None:
    async with websockets.connect(f"ws://127.0.0.1:{port}/api/v1/stream?rate_hz={rate_hz:g}", proxy=None) as socket:
        async for _ in socket:
            received[index] += 1


async def _read_scene(port: int) -> None:
    protocol = websockets.Subprotocol(f"viser-v{version('viser')}")
    async with websockets.connect(
        f"ws://127.0.0.1:{port}/viser", subprotocols=[protocol], max_size=None, compression=None, proxy=None
    ) as socket:
        await socket.send(msgspec.msgpack.encode(_CAMERA))
        async for _ in socket:
            pass
