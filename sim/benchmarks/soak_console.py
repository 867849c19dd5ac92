"""One console under soak: calls on connections of their own, an e-stop that is pressed all along, and a log that is read."""

import http.client
import json
import math
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

from sim.benchmarks.server_process import ServerProcess, children

API = "/api/v1"
PRESS_EVERY_S = 0.5
TIMEOUT_S = 30.0


class Answer(NamedTuple):
    """Of a call: its status, 0 where none came, its JSON, and the time it took."""

    status: int
    body: Any
    duration_s: float


def call(port: int, method: str, path: str, body: Any = None) -> Answer:
    """One call on a connection of its own, as of somebody who has just come."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT_S)
    started = time.perf_counter()
    try:
        content = None if body is None else json.dumps(body)
        connection.request(method, f"{API}{path}", content, {"Content-Type": "application/json"})
        response = connection.getresponse()
        text = response.read()
        return Answer(response.status, json.loads(text) if text else None, time.perf_counter() - started)
    except (OSError, http.client.HTTPException, ValueError):
        return Answer(0, None, time.perf_counter() - started)
    finally:
        connection.close()


class SoakConsole:
    """A server with its log in a file.

    Attributes:
        server: the processes.
        presses: duration of each e-stop that was confirmed, s.
        lost_estops: number of those that were not.
    """

    def __init__(self, *arguments: str) -> None:
        self._log = tempfile.TemporaryFile("w+", errors="replace")  # noqa: SIM115 (closed by `stop`)
        self.server = ServerProcess(*arguments, errors=self._log)
        self.presses: list[float] = []
        self.lost_estops = 0
        self._ended = threading.Event()
        self._quiet = threading.Event()
        self._presser = threading.Thread(target=self._press_on, daemon=True)

    @property
    def port(self) -> int:
        """Of the page."""
        return self.server.port

    def call(self, method: str, path: str, body: Any = None) -> Answer:
        """See `call`."""
        return call(self.port, method, path, body)

    def press(self) -> None:
        """Press the e-stop and count what comes of it; then clear it."""
        answer = self.call("POST", "/estop")
        if answer.status == 200 and answer.body["latched"]:
            self.presses.append(answer.duration_s)
        else:
            self.lost_estops += 1
        deadline = time.monotonic() + TIMEOUT_S
        while self.call("POST", "/estop/clear").status == 429 and time.monotonic() < deadline:
            time.sleep(0.05)

    def press_all_along(self) -> None:
        """Press twice a second from now on, but while it is `undisturbed`."""
        self._presser.start()

    def undisturbed(self, quiet: bool) -> None:
        """Whether somebody else uses the robot now."""
        if quiet:
            self._quiet.set()
        else:
            self._quiet.clear()

    def lost_processes(self) -> int:
        """How many of its two processes do not run any more."""
        try:
            return int(self.server.control_pid not in children(self.server.pid))
        except FileNotFoundError:
            return 2

    def tracebacks(self) -> int:
        """Of the log so far."""
        self._log.seek(0)
        return self._log.read().count("Traceback (most recent call last)")

    def stop(self) -> None:
        """End it."""
        self._ended.set()
        if self._presser.is_alive():
            self._presser.join()
        self.server.stop()

    def _press_on(self) -> None:
        while not self._ended.wait(PRESS_EVERY_S):
            if not self._quiet.is_set():
                self.press()


def lies(state: dict[str, Any]) -> bool:
    """Whether the robot has fallen: its base leans by more than 60 degrees, or nothing is known of it."""
    orientation = state["base"]["orientation_wxyz"]
    if orientation is None:
        return True
    _, x, y, _ = orientation
    return 1.0 - 2.0 * (x * x + y * y) < math.cos(math.radians(60.0))


def resident_mb(pid: int) -> float:
    """Resident memory of a process."""
    text = Path(f"/proc/{pid}/status").read_text()
    return next(int(line.split()[1]) / 1e3 for line in text.splitlines() if line.startswith("VmRSS"))
