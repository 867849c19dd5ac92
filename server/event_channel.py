"""The web process's end of the pipe to one control process: events out, their answers back, and the news of its death."""

import itertools
import logging
import queue
import threading
import time
from concurrent.futures import Future
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from server.errors import ControlDeadError, ControlTimeoutError, InvalidFieldError, MissingError, RefusedError, ServerError
from server.messages import Close, Event, Fatal, Outcome, Ready, Reply
from server.session_events import SLOW_EVENTS

MAX_PENDING = 64
RESTART_HINT = "POST /api/v1/control/restart starts a fresh one in a safe hold"

_FIELD_OF_EVENT = {
    "add_wrench": "body",
    "set_mismatch": "per_link",
    "set_tool": "center_of_mass_m",
    "reset": "keyframe",
    "drive": "request",
} | dict.fromkeys(("seek", "branch", "replay"), "time_s")
"""What is left for the session to refuse after the request's own checks; of the others it is `name`."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class _Call:
    event: str
    future: "Future[Any]"
    sent_s: float


class EventChannel:
    """Talks to one control process until that ends. Every method may be called from any thread, and none waits.

    A thread of its own sends, and waits where the process does not read; another one reads.

    Attributes:
        ready: what the session offers, once it ticks; ControlDeadError if it dies before.

    Args:
        process: the control process, started.
        pipe: this side's end. No other process may hold the other one, or its end would go unnoticed.
    """

    def __init__(self, process: BaseProcess, pipe: Connection) -> None:
        self.ready: Future[dict[str, Any]] = Future()
        self._process = process
        self._pipe = pipe
        self._lock = threading.Lock()
        self._calls: dict[int, _Call] = {}
        self._ids = itertools.count(1)
        self._outbox: queue.SimpleQueue[Event | Close | None] = queue.SimpleQueue()
        self._closing = False
        self._death: str | None = None
        self._sender = threading.Thread(target=self._send, name="control-events", daemon=True)
        self._reader = threading.Thread(target=self._read, name="control-replies", daemon=True)
        self._sender.start()
        self._reader.start()

    @property
    def death(self) -> str | None:
        """Why the control process does not run, None while it does."""
        return self._death

    def awaits_slow_event(self, patience_s: float) -> bool:
        """Whether an event that takes long, such as loading a scene, has waited for its answer for less than `patience_s`."""
        oldest = time.monotonic() - patience_s
        with self._lock:
            return any(call.event in SLOW_EVENTS and call.sent_s > oldest for call in self._calls.values())

    def submit(self, event: str, arguments: dict[str, Any]) -> "Future[Any]":
        """Send an event; the future holds its value, or raises the ServerError that its reply means.

        Raises:
            ControlDeadError: the control process does not run.
            ControlTimeoutError: it has not answered so many events that it must be stuck.
        """
        with self._lock:
            if self._death is not None or self._closing:
                raise dead(self._death or "it is being ended")
            if len(self._calls) >= MAX_PENDING:
                raise ControlTimeoutError(f"the control process has not answered {MAX_PENDING} calls; {RESTART_HINT}")
            key = next(self._ids)
            call = self._calls[key] = _Call(event, Future(), time.monotonic())
            self._outbox.put(Event(key, event, arguments))
        return call.future

    def close(self, patience_s: float) -> None:
        """End the control process, by force if it has not ended itself within `patience_s`."""
        with self._lock:
            self._closing = True
            self._outbox.put(Close())
        self._process.join(patience_s)
        if self._process.is_alive():
            self._process.kill()
        self._reader.join(5.0)

    def _send(self) -> None:
        while (message := self._outbox.get()) is not None:
            try:
                self._pipe.send(message)
            except OSError:
                return  # the reader tells why

    def _read(self) -> None:
        reason = None
        try:
            while True:
                message = self._pipe.recv()
                if isinstance(message, Reply):
                    self._resolve(message)
                elif isinstance(message, Ready):
                    self.ready.set_result(message.description)
                elif isinstance(message, Fatal):
                    reason = message.message
        except (EOFError, OSError):
            self._process.join(2.0)
        self._bury(reason or f"exit code {self._process.exitcode}")
        self._outbox.put(None)
        self._sender.join()
        self._pipe.close()

    def _bury(self, reason: str) -> None:
        with self._lock:
            self._death = reason
            orphans, self._calls = list(self._calls.values()), {}
        if not self._closing:
            _log.warning("the control process died: %s", reason)
        error = ControlDeadError(f"the control process died ({reason}); {RESTART_HINT}")
        if not self.ready.done():
            self.ready.set_exception(error)
        for call in orphans:
            _settle(call.future, error)

    def _resolve(self, reply: Reply) -> None:
        with self._lock:
            call = self._calls.pop(reply.id, None)
        if call is not None:
            _settle(call.future, _error(call.event, reply), reply.value)


def dead(reason: str) -> ControlDeadError:
    """No control process runs, for that reason."""
    return ControlDeadError(f"the control process is dead ({reason}); {RESTART_HINT}")


def _settle(future: "Future[Any]", error: Exception | None, value: Any = None) -> None:
    if not future.set_running_or_notify_cancel():
        return  # whoever asked has given up
    if error is None:
        future.set_result(value)
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
