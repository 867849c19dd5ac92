"""One console under soak: calls on connections of their own, an e-stop that is pressed all along, and a log that is read."""

import http.client
import json
import math
import multiprocessing
import sys
import tempfile
import time
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

from sim.benchmarks.server_process import ServerProcess, children

API = "/api/v1"
PRESS_EVERY_S = 0.5
TIMEOUT_S = 30.0
_TRACEBACK = "Traceback (most recent call last)"


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


class Press(NamedTuple):
    """Of the e-stop: when, by the monotonic clock, and how long until it was confirmed; NaN where it was not."""

    time_s: float
    duration_s: float


def press(port: int) -> Press:
    """Press the e-stop, then clear it."""
    pressed = time.monotonic()
    answer = call(port, "POST", "/estop")
    confirmed = answer.status == 200 and answer.body["latched"]
    if not confirmed:
        print(f"an e-stop was not confirmed: {answer}", file=sys.stderr, flush=True)
    while call(port, "POST", "/estop/clear").status == 429 and time.monotonic() < pressed + TIMEOUT_S:
        time.sleep(0.05)
    return Press(pressed, answer.duration_s if confirmed else math.nan)


class SoakConsole:
    """A server with its log in a file.

    Attributes:
        server: the processes.
        presses: of the e-stop; those that are made all along once they have ended.
    """

    def __init__(self, *arguments: str) -> None:
        self._log = tempfile.TemporaryFile("w+", errors="replace")  # noqa: SIM115 (closed by `stop`)
        self.server = ServerProcess(*arguments, errors=self._log)
        self.presses: list[Press] = []
        context = multiprocessing.get_context("spawn")
        self._ended, self._robot, self._told = context.Event(), context.Lock(), context.Queue()
        # A process of its own: what an attack computes in this one shall not count as time that the console takes.
        self._presser = context.Process(target=_press_on, args=(self.port, self._ended, self._robot, self._told), daemon=True)

    @property
    def port(self) -> int:
        """Of the page."""
        return self.server.port

    def call(self, method: str, path: str, body: Any = None) -> Answer:
        """See `call`."""
        return call(self.port, method, path, body)

    def press(self) -> None:
        """Press the e-stop and count what comes of it; then clear it."""
        self.presses.append(press(self.port))

    def press_all_along(self) -> None:
        """Press twice a second from now on, but while it is `undisturbed`."""
        self._presser.start()

    def end_presses(self) -> None:
        """No more of them."""
        self._ended.set()
        while (told := self._told.get()) is not None:
            self.presses.append(told)
        self._presser.join()

    def undisturbed(self) -> AbstractContextManager[Any]:
        """The robot for somebody else: a press that has begun ends first, none begins within."""
        return self._robot

    def lost_processes(self) -> int:
        """How many of its two processes do not run any more."""
        try:
            return int(self.server.control_pid not in children(self.server.pid))
        except FileNotFoundError:
            return 2

    def tracebacks(self) -> list[str]:
        """Of the log so far."""
        self._log.seek(0)
        return self._log.read().split(_TRACEBACK)[1:]

    def stop(self) -> None:
        """End it."""
        self.server.stop()


def _press_on(port: int, ended: Any, robot: Any, told: Any) -> None:
    while not ended.wait(PRESS_EVERY_S):
        with robot:
            told.put(press(port))
    told.put(None)


def lies(state: dict[str, Any]) -> bool:
    """Whether the robot has fallen: its base leans by more than 60 degrees, or nothing is known of it."""
    orientation = state["base"]["orientation_wxyz"]
    if orientation is None:
        return True
    _, x, y, _ = orientation
    return 1.0 - 2.0 * (x * x + y * y) < math.cos(math.radians(60.0))


def anonymous_mb(pid: int) -> float:
    """Resident memory of a process that no file stands behind."""
    text = Path(f"/proc/{pid}/status").read_text()
    return next(int(line.split()[1]) / 1e3 for line in text.splitlines() if line.startswith("RssAnon"))
