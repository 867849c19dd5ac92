"""The console from a Python program: typed, synchronous, and nothing needed beside numpy and websockets.

    from server.client import Console

    with Console("http://127.0.0.1:8080") as console:
        console.reset(seed=7)
        console.pause()
        with console.wrench([0, 0, 10], duration_s=2.0):
            state = console.step(500)
        print(state.force_estimated_n, state.force_true_n)

SI units, heading frame unless said, forces are those of the environment on the robot; docs of every call at `/docs`. What the
console refuses is raised as a ConsoleError with the console's words.
"""

import contextlib
import http.client
import json
import os
import ssl
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit

import numpy as np
from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.sync.client import connect

DEFAULT_ADDRESS = "http://127.0.0.1:8080"
MAJOR = 0
"""Of the console's version that this client speaks with."""

PATIENCE_S = 35.0
"""A call's longest wait; the console itself gives up after 30 s."""

RENEW_S = 1.0
REOPEN_AFTER_S = 2.0
"""The console closes connections that rest for 5 s."""

_LEASE_HEADER = "Forcelens-Lease"

Vector = Sequence[float] | np.ndarray


class ConsoleError(RuntimeError):
    """The console refused, or cannot be reached; the message says why, and what to do."""


class UnreachableError(ConsoleError):
    """Nothing answers at the address, or no Forcelens does."""


class NotPermittedError(ConsoleError):
    """The token is missing or wrong."""


class RefusedError(ConsoleError):
    """The state forbids it: the e-stop is latched, another operator drives, the scene is wrong."""


class MissingError(ConsoleError):
    """There is no such call or thing."""


class InvalidFieldError(ConsoleError):
    """A value that is not allowed; nothing changed. `fields` are their paths, like `force_n[2]`."""

    fields: tuple[str, ...] = ()


class NotAvailableError(ConsoleError):
    """The console is too busy, or its control process does not run."""


class WaitTimeoutError(ConsoleError, TimeoutError):
    """What was waited for did not happen in time."""


_ERRORS = {401: NotPermittedError, 403: NotPermittedError, 404: MissingError, 409: RefusedError, 413: InvalidFieldError}
_ERRORS |= {422: InvalidFieldError, 429: NotAvailableError, 503: NotAvailableError}


def _error(status: int, body: bytes) -> ConsoleError:
    try:
        detail = json.loads(body)["detail"]
    except (ValueError, LookupError, TypeError):
        detail = body[:200].decode(errors="replace") or f"status {status}"
    entries = detail if isinstance(detail, list) else []
    error = _ERRORS.get(status, ConsoleError)("; ".join(entry["msg"] for entry in entries) or str(detail))
    if isinstance(error, InvalidFieldError):
        error.fields = tuple(entry["field"] for entry in entries)
    return error


@dataclass(frozen=True, slots=True)
class State:
    """A snapshot of robot and console. Vectors that are not available are NaN. `state["odometry"]` is a section as it came."""

    sections: Mapping[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.sections[name]

    def _vector(self, section: str, name: str, size: int = 3) -> np.ndarray:
        value = self.sections[section][name]
        return np.full(size, np.nan) if value is None else np.array(value, float)

    time_s = property(lambda self: float(self["time_s"]), doc="Time of the simulation or of the robot's session, s.")
    mode = property(lambda self: str(self["mode"]), doc="`running`, `paused`, `estop` or `fault`.")
    message = property(lambda self: self["message"], doc="Why the robot does not obey; None while it does.")
    faults = property(lambda self: list(self["faults"]), doc="Names of faults and limits.")

    @property
    def force_estimated_n(self) -> np.ndarray:
        """Force on the hand (3,) N, heading, by the selected estimator."""
        return self._vector("end_effector", "force_estimated_n")

    @property
    def force_true_n(self) -> np.ndarray:
        """Force on the hand (3,) N, heading, from the simulator; NaN on hardware."""
        return self._vector("end_effector", "force_true_n")

    @property
    def force_estimates_n(self) -> dict[str, np.ndarray]:
        """Force on the hand (3,) N, heading, by every estimator."""
        estimates = self["end_effector"]["force_estimates_n"]
        return {name: np.full(3, np.nan) if force is None else np.array(force) for name, force in estimates.items()}

    @property
    def hand_position_m(self) -> np.ndarray:
        """Position of the hand (3,) m, heading."""
        return self._vector("end_effector", "position_m")

    @property
    def base_position_m(self) -> np.ndarray:
        """Position of the base (3,) m, world."""
        return self._vector("base", "position_m")

    @property
    def force_commanded_n(self) -> np.ndarray:
        """Commanded force (3,) N, heading, as applied; NaN on axes that hold a position."""
        applied = self["applied_command"]
        return np.where(np.array(applied["mask"]) == 1, np.array(applied["force_n"], float), np.nan)


class Console:
    """A console. One thread at a time; ends with `close` or as a context.

    Args:
        address: that the console printed, with its token or without; default FORCELENS_ADDRESS, or this machine's port 8080.
        token: if the console wants one; default from the address, or FORCELENS_TOKEN.
        timeout_s: to connect.

    Raises:
        UnreachableError: no console answers there in time; the message tells what to start.
        NotPermittedError: the token is missing or wrong.
    """

    def __init__(self, address: str | None = None, *, token: str | None = None, timeout_s: float = 5.0) -> None:
        address = address or os.environ.get("FORCELENS_ADDRESS") or DEFAULT_ADDRESS
        url = urlsplit(address if "://" in address else f"http://{address}")
        self.address = f"{url.scheme}://{url.netloc}{url.path.rstrip('/')}"
        token = token or next(iter(parse_qs(url.query).get("token", [])), None) or os.environ.get("FORCELENS_TOKEN")
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._timeout_s = timeout_s
        self._wire = _Wire(self.address, timeout_s)
        late = _cure(self.address, f"within {timeout_s:g} s")
        health = _within(timeout_s, lambda: self.call("GET", "health", accept=range(404, 600)), late)
        if not isinstance(health, dict) or "version" not in health:
            raise UnreachableError(_cure(self.address, "as Forcelens does"))
        if int(health["version"].partition(".")[0]) != MAJOR:
            raise UnreachableError(f"{self.address} is Forcelens {health['version']}; install the client of that version")

    def __enter__(self) -> "Console":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; nothing else changes."""
        self._wire.close()

    def call(
        self, method: str, path: str, body: Any = None, *, patience_s: float = PATIENCE_S, accept: Sequence[int] = ()
    ) -> Any:
        """Any call below `/api/v1/`; its answer's JSON, None for none.

        Args:
            method: of HTTP.
            path: below `/api/v1/`.
            body: what JSON can say, or numpy arrays.
            patience_s: longest wait for the answer.
            accept: statuses of refusals whose answer is wanted.
        """
        status, answer = self._wire.exchange(method, f"/api/v1/{path}", _encode(body), self._headers, patience_s)
        if status >= 400 and status not in accept:
            raise _error(status, answer)
        try:
            return json.loads(answer) if answer else None
        except ValueError:
            raise UnreachableError(_cure(self.address, "as Forcelens does")) from None

    def state(self) -> State:
        """The newest snapshot."""
        return State(self.call("GET", "state"))

    def health(self) -> dict[str, Any]:
        """Versions, uptime, loop, and whether all is well, in `status`."""
        return self.call("GET", "health", accept=(503,))

    def stream(self, rate_hz: float = 50.0, fields: Sequence[str] = ()) -> Iterator[State]:
        """Snapshots as they come, the newest only; with `fields`, those sections of it.

        Raises:
            UnreachableError: the console has gone.
        """
        query = f"rate_hz={rate_hz:g}" + (f"&fields={quote(','.join(fields))}" if fields else "")
        url = f"{self.address.replace('http', 'ws', 1)}/api/v1/stream?{query}"
        try:
            with connect(url, additional_headers=self._headers, open_timeout=self._timeout_s, proxy=None) as socket:
                while True:
                    yield State(json.loads(socket.recv(timeout=self._timeout_s)))
        except InvalidStatus as error:
            raise _error(error.response.status_code, bytes(error.response.body or b"")) from None
        except (OSError, WebSocketException) as error:
            raise UnreachableError(f"the stream of {self.address} has ended: {error}") from None

    def wait_until(self, condition: Callable[[State], object], timeout_s: float = 10.0, poll_s: float = 0.02) -> State:
        """The first state that fulfils a condition.

        Raises:
            WaitTimeoutError: none did in time.
        """
        end_s = time.monotonic() + timeout_s
        while not condition(state := self.state()):
            if time.monotonic() > end_s:
                raise WaitTimeoutError(
                    f"did not happen within {timeout_s:g} s; the mode is {state.mode}, {state.message or 'no fault'}"
                )
            time.sleep(poll_s)
        return state

    def run(self, speed: float | None = None) -> None:
        """Let the simulation run, at `speed` times real time; None: as before."""
        self.call("POST", "run", {"state": "running"} | ({} if speed is None else {"speed": speed}))

    def pause(self) -> None:
        """Hold the simulation."""
        self.call("POST", "run", {"state": "paused"})

    def step(self, ticks: int = 1) -> State:
        """Advance a paused simulation by ticks of 2 ms, at its own pace; the state after them."""
        self.call("POST", "step", {"ticks": ticks}, patience_s=PATIENCE_S + 0.002 * ticks)
        return self.state()

    def reset(self, seed: int | None = None, keyframe: str | None = None) -> None:
        """Put the simulated robot back; the command returns to its default."""
        given = {"seed": seed, "keyframe": keyframe}
        self.call("POST", "reset", {name: value for name, value in given.items() if value is not None})

    def command(self, **fields: Any) -> dict[str, Any]:
        """Ask for any of `mask`, `force_n`, `position_m`, `orientation_wxyz`, `base_velocity`, `guidance`; all as asked."""
        return self.call("PATCH", "command", fields)

    def estop(self) -> None:
        """Latch the e-stop; anyone may."""
        self.call("POST", "estop")

    def clear_estop(self) -> None:
        """Let the robot stand up again, with the default command."""
        self.call("POST", "estop/clear")

    def select(self, *, scene: str = "", controller: str = "", estimator: str = "", mass_scale: float | None = None) -> None:
        """Choose any of these; a scene resets the command, and of `mass_scale` the estimators are not told."""
        for what, name in (("scene", scene), ("controller", controller), ("estimator", estimator)):
            if name:
                self.call("PUT", what, {"name": name})
        if mass_scale is not None:
            self.call("PUT", "mismatch", {"mass_scale": mass_scale})

    @contextlib.contextmanager
    def wrench(self, force_n: Vector, duration_s: float = 600.0, *, frame: str = "heading", **more: Any) -> Iterator[int]:
        """An exact force (3,) N on the simulated hand while the context lasts, `duration_s` at most; its id."""
        key = self.push(force_n, duration_s, frame=frame, **more)
        try:
            yield key
        finally:
            with contextlib.suppress(MissingError, RefusedError):  # it has expired
                self.call("DELETE", f"wrenches/{key}")

    def push(self, force_n: Vector, duration_s: float, *, frame: str = "heading", **more: Any) -> int:
        """A force (3,) N on the simulated hand that expires by itself; its id. `more`: ramp_s, torque_nm, point_m, body."""
        return self.call("POST", "wrenches", {"force_n": force_n, "duration_s": duration_s, "frame": frame, **more})["id"]

    @contextlib.contextmanager
    def lease(self, operator: str, *, take_over: bool = False) -> Iterator[None]:
        """Command alone while the context lasts.

        Raises:
            RefusedError: another drives, and `take_over` is not set.
        """
        token = self.call("POST", "lease", {"operator": operator, "take_over": take_over})["token"]
        self._headers[_LEASE_HEADER] = token
        ended = threading.Event()
        keeper = threading.Thread(target=self._keep_lease, args=(operator, ended), daemon=True)
        keeper.start()
        try:
            yield
        finally:
            ended.set()
            keeper.join()
            with contextlib.suppress(ConsoleError):  # it was taken over
                self.call("DELETE", "lease")
            del self._headers[_LEASE_HEADER]

    def _keep_lease(self, operator: str, ended: threading.Event) -> None:
        wire = _Wire(self.address, self._timeout_s)
        body = _encode({"operator": operator})
        while not ended.wait(RENEW_S):
            with contextlib.suppress(UnreachableError):
                status, answer = wire.exchange("POST", "/api/v1/lease", body, self._headers, self._timeout_s)
                if status == 409:
                    break
                if status == 200:
                    self._headers[_LEASE_HEADER] = json.loads(answer)["token"]  # another one, if it had lapsed
        wire.close()

    def run_task(self, name: str, timeout_s: float = 300.0, **options: Any) -> dict[str, Any]:
        """Carry out a task, such as `wipe`, and wait for its end; its `outcome`, `reason`, `metrics`. An exception aborts it.

        Raises:
            WaitTimeoutError: it takes longer than `timeout_s`.
        """
        key = self.call("POST", "tasks", {"name": name, "options": options})["id"]
        end_s = time.monotonic() + timeout_s
        try:
            while (task := self.call("GET", f"tasks/{key}"))["outcome"] is None:
                if time.monotonic() > end_s:
                    raise WaitTimeoutError(f"{name} is still in phase {task['phase']!r} after {timeout_s:g} s")
                time.sleep(0.1)
        except BaseException:
            with contextlib.suppress(ConsoleError):
                self.call("DELETE", f"tasks/{key}")
            raise
        return task

    @contextlib.contextmanager
    def record(self, name: str = "", note: str = "") -> Iterator[str]:
        """Record while the context lasts; the recording's id, for `download`."""
        given = {"name": name, "note": note}
        key = self.call("POST", "recordings", {field: text for field, text in given.items() if text})["id"]
        try:
            yield key
        finally:
            self.call("DELETE", "recordings/current")

    def download(self, recording: str, path: Path) -> Path:
        """Save a recording as a file (MCAP)."""
        call = f"/api/v1/recordings/{quote(recording)}/download"
        status, content = self._wire.exchange("GET", call, None, self._headers, PATIENCE_S)
        if status >= 400:
            raise _error(status, content)
        with path.open("wb") as file:
            file.write(content)
        return path


class _Wire:
    """One HTTP connection that is opened when it is needed, and again after a rest."""

    def __init__(self, address: str, timeout_s: float) -> None:
        self._url = urlsplit(address)
        self._timeout_s = timeout_s
        self._connection: http.client.HTTPConnection | None = None
        self._used_s = 0.0

    def exchange(
        self, method: str, path: str, body: bytes | None, headers: Mapping[str, str], patience_s: float
    ) -> tuple[int, bytes]:
        """Status and body of an answer.

        Raises:
            UnreachableError: there is none.
        """
        if time.monotonic() - self._used_s > REOPEN_AFTER_S:
            self.close()
        sent = {"Content-Type": "application/json", **headers} if body is not None else dict(headers)
        try:
            connection = self._connection = self._connection or self._opened()
            assert connection.sock is not None
            connection.sock.settimeout(patience_s)
            connection.request(method, self._url.path + path, body, sent)
            response = connection.getresponse()
            answer = response.read()
        except (OSError, http.client.HTTPException, ValueError) as error:
            self.close()
            raise UnreachableError(
                _cure(f"{self._url.scheme}://{self._url.netloc}", f"({error or type(error).__name__})")
            ) from None
        self._used_s = time.monotonic()
        if response.will_close:
            self.close()
        return response.status, answer

    def _opened(self) -> http.client.HTTPConnection:
        host, port = self._url.hostname or "", self._url.port
        if self._url.scheme == "https":
            context = ssl.create_default_context()
            connection = http.client.HTTPSConnection(host, port, timeout=self._timeout_s, context=context)
        else:
            connection = http.client.HTTPConnection(host, port, timeout=self._timeout_s)
        connection.connect()
        return connection

    def close(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._connection = None


def _within(timeout_s: float, action: Callable[[], Any], otherwise: str) -> Any:
    """The result of `action`; a name that resolves slowly, or an answer that drips, ends the wait all the same."""
    done: list[Any] = []

    def act() -> None:
        try:
            done.append(action())
        except Exception as error:
            done.append(error)

    thread = threading.Thread(target=act, daemon=True)
    thread.start()
    thread.join(timeout_s)
    result = done[0] if done else UnreachableError(otherwise)
    if isinstance(result, Exception):
        raise result
    return result


def _cure(address: str, how: str) -> str:
    return f"{address} does not answer {how}; start the console with `forcelens`, and give the address that it prints"


def _encode(body: Any) -> bytes | None:
    return None if body is None else json.dumps(body, default=lambda value: value.tolist()).encode()
