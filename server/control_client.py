"""The web process's handle on the control process: start, events, snapshots, set-points, health, restart."""

import itertools
import logging
import multiprocessing
import os
import threading
import time
from concurrent.futures import Future
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np

from server.control_process import ControlLaunch, control_process
from server.errors import ControlDeadError, ControlTimeoutError, InvalidFieldError, MissingError, RefusedError, ServerError
from server.messages import Close, Event, Fatal, Outcome, Ready, Reply
from server.session_events import SLOW_EVENTS
from server.setpoint import default_setpoint
from sim.processes import shared_record
from sim.processes.shared_record import SharedRecord
from sim.runtime.snapshot import SETPOINT, SNAPSHOT

START_TIMEOUT_S = 60.0
CALL_TIMEOUT_S = 5.0
SLOW_CALL_TIMEOUT_S = 30.0
MAX_PENDING = 64

RESTART_HINT = "POST /api/v1/control/restart starts a fresh one in a safe hold"

_FIELD_OF_EVENT = {"add_wrench": "body", "set_mismatch": "per_link", "reset": "keyframe", "drive": "request"}
"""What is left for the session to refuse after the request's own checks; of the others it is `name`."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class _Call:
    event: str
    future: "Future[Any]"
    sent_s: float


class ControlClient:
    """Supervises one control process at a time. Every method may be called from any thread.

    Args:
        launch: what the first process is started with.
    """

    def __init__(self, launch: ControlLaunch) -> None:
        self._launch = launch
        self._context = multiprocessing.get_context("spawn")
        self._state_memory = shared_record.allocate(self._context, SNAPSHOT)
        self._setpoint_memory = shared_record.allocate(self._context, SETPOINT)
        self._state = SharedRecord(self._state_memory, SNAPSHOT)
        self._setpoints = SharedRecord(self._setpoint_memory, SETPOINT)
        self._setpoint = default_setpoint()
        self._setpoint_lock = threading.Lock()
        self._lock = threading.Lock()
        self._restart_lock = threading.Lock()
        self._pending: dict[int, _Call] = {}
        self._ids = itertools.count(1)
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._reader: threading.Thread | None = None
        self._ready: Future[dict[str, Any]] = Future()
        self._death: str | None = "it has not been started"
        self._last: np.ndarray | None = None

    @property
    def alive(self) -> bool:
        """Whether the control process runs."""
        return self._death is None

    @property
    def death(self) -> str | None:
        """Why the control process does not run, None while it does."""
        return self._death

    @property
    def busy(self) -> bool:
        """Whether it starts, or an event that takes long, such as loading a scene, still waits for its answer."""
        oldest = time.monotonic() - SLOW_CALL_TIMEOUT_S
        with self._lock:
            if self._death is None and not self._ready.done():
                return True
            return any(call.event in SLOW_EVENTS and call.sent_s > oldest for call in self._pending.values())

    @property
    def pid(self) -> int | None:
        """Process id of the control process, None before the first start."""
        return self._process.pid if self._process is not None else None

    def require_alive(self) -> None:
        """
        Raises:
            ControlDeadError: no control process runs.
        """
        if self._death is not None:
            raise ControlDeadError(f"the control process is dead ({self._death}); {RESTART_HINT}")

    def start(self) -> None:
        """Spawn the control process without waiting for it; `wait_ready` does."""
        with self._lock:
            # Read by BLAS and OpenMP when the child imports numpy: their threads would fight for the loop's core.
            for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
                os.environ[name] = "1"
            ours, theirs = self._context.Pipe()
            self._ready = Future()
            process = self._context.Process(
                target=control_process,
                args=(self._launch, self._state_memory, self._setpoint_memory, theirs),
                name="forcelens-control",
                daemon=True,
            )
            process.start()
            theirs.close()  # so that the child's end is the only one and its death ends the reader
            self._process, self._pipe, self._death = process, ours, None
            self._reader = threading.Thread(
                target=self._read_replies, args=(process, ours), name="control-replies", daemon=True
            )
            self._reader.start()

    def wait_ready(self, timeout_s: float = START_TIMEOUT_S) -> dict[str, Any]:
        """What the session offers, once it ticks.

        Raises:
            ControlDeadError: it died while starting.
            ControlTimeoutError: it is not ready in time.
        """
        try:
            return self._ready.result(timeout_s)
        except TimeoutError:
            raise ControlTimeoutError(f"the control process is not ready after {timeout_s:.0f} s") from None

    def close(self) -> None:
        """End the control process, by force if it does not end itself."""
        with self._lock:
            process, reader, pipe = self._process, self._reader, self._pipe
            self._pipe = None
            if pipe is not None and self._death is None:
                try:
                    pipe.send(Close())
                except OSError:
                    _log.debug("the control process closed its pipe first")
        if process is None or reader is None:
            return
        process.join(2.0)
        if process.is_alive():
            process.kill()
        reader.join(5.0)

    def restart(self, **changes: Any) -> dict[str, Any]:
        """End what is left of the control process and start a fresh one; returns when there is a snapshot of it.

        Args:
            changes: of the last launch, fields of ControlLaunch.

        Raises:
            ControlDeadError, ControlTimeoutError: see wait_ready.
        """
        with self._restart_lock:
            self.close()
            last = self.snapshot()
            sequence = None if last is None else last["sequence"]
            self._launch = replace(self._launch, **changes)
            self.start()
        description = self.wait_ready()
        deadline = time.monotonic() + CALL_TIMEOUT_S
        while (newest := self.snapshot()) is None or newest["sequence"] == sequence:
            self.require_alive()
            if time.monotonic() > deadline:
                raise ControlTimeoutError("the control process publishes nothing")
            time.sleep(0.002)
        return description

    def submit(self, event: str, /, **arguments: Any) -> "Future[Any]":
        """Send an event; the future holds its value, or raises what `call` raises.

        Raises:
            ControlDeadError: no control process runs.
            ControlTimeoutError: it has not answered so many events that it must be stuck.
        """
        future: Future[Any] = Future()
        with self._lock:
            if self._death is not None or self._pipe is None:
                raise ControlDeadError(f"the control process is dead ({self._death}); {RESTART_HINT}")
            if len(self._pending) >= MAX_PENDING:
                raise ControlTimeoutError(f"the control process has not answered {MAX_PENDING} calls; {RESTART_HINT}")
            key = next(self._ids)
            self._pending[key] = _Call(event, future, time.monotonic())
            try:
                self._pipe.send(Event(key, event, arguments))
            except OSError:
                del self._pending[key]
                raise ControlDeadError(f"the control process is dead; {RESTART_HINT}") from None
        return future

    def call(self, event: str, timeout_s: float = CALL_TIMEOUT_S, /, **arguments: Any) -> Any:
        """Send an event and wait for its value.

        Raises:
            InvalidFieldError, RefusedError, MissingError: as the session says.
            ControlDeadError: no control process runs, or it died meanwhile.
            ControlTimeoutError: no answer in time.
        """
        future = self.submit(event, **arguments)
        try:
            return future.result(timeout_s)
        except TimeoutError:
            raise ControlTimeoutError(f"the control process did not answer {event!r} within {timeout_s:g} s") from None

    def snapshot(self) -> np.void | None:
        """The newest SNAPSHOT record, also after the control process died; None before the first."""
        newest = self._state.read()
        if newest is not None:
            self._last = newest
        return None if self._last is None else self._last[0]

    def live_snapshot(self) -> np.void | None:
        """The newest SNAPSHOT record, None while no control process runs."""
        return self.snapshot() if self.alive else None

    def require_snapshot(self) -> np.void:
        """The newest SNAPSHOT record.

        Raises:
            ControlDeadError: there is none.
        """
        snapshot = self.snapshot()
        if snapshot is None:
            raise ControlDeadError("there is no snapshot yet; the control process is starting, or died doing so")
        return snapshot

    def snapshot_age_s(self) -> float:
        """Time since the newest snapshot, infinite before the first."""
        snapshot = self.snapshot()
        return float("inf") if snapshot is None else time.time() - float(snapshot["wall_time_s"])

    def write_setpoint(self, **fields: Any) -> None:
        """Change fields of the set-point that the control process reads, and its heartbeat."""
        with self._setpoint_lock:
            record = self._setpoint[0]
            for name, value in fields.items():
                record[name] = value
            record["heartbeat_s"] = time.monotonic()
            self._setpoints.write(self._setpoint)

    def heartbeat(self) -> None:
        """Tell the control process that the operator's side lives."""
        self.write_setpoint()

    def _read_replies(self, process: Any, pipe: Connection) -> None:
        reason = None
        try:
            while True:
                message = pipe.recv()
                if isinstance(message, Reply):
                    self._resolve(message)
                elif isinstance(message, Ready):
                    self._ready.set_result(message.description)
                elif isinstance(message, Fatal):
                    reason = message.message
        except (EOFError, OSError):
            process.join(2.0)
        self._bury(process, reason or f"exit code {process.exitcode}")
        pipe.close()

    def _bury(self, process: Any, reason: str) -> None:
        with self._lock:
            if process is not self._process:
                return
            self._death = reason
            expected = self._pipe is None
            orphans, self._pending = list(self._pending.values()), {}
        error = ControlDeadError(f"the control process died ({reason}); {RESTART_HINT}")
        if not self._ready.done():
            self._ready.set_exception(error)
        for call in orphans:
            call.future.set_exception(error)
        if not expected:
            _log.warning("the control process died: %s", reason)

    def _resolve(self, reply: Reply) -> None:
        with self._lock:
            call = self._pending.pop(reply.id, None)
        if call is None or not call.future.set_running_or_notify_cancel():
            return
        future, error = call.future, _error(call.event, reply)
        if error is None:
            future.set_result(reply.value)
        else:
            future.set_exception(error)


def _error(event: str, reply: Reply) -> Exception | None:
    match reply.outcome:
        case Outcome.DONE:
            return None
        case Outcome.INVALID:
            problem, _, allowed = str(reply.value).partition("; ")
            return InvalidFieldError(_FIELD_OF_EVENT.get(event, "name"), f"is refused: {problem}", allowed or problem)
        case Outcome.REFUSED:
            return RefusedError(reply.value)
        case Outcome.MISSING:
            return MissingError(reply.value)
        case _:
            return ServerError(reply.value)
