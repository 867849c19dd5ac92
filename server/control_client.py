"""The web process's handle on the control process: start, events, snapshots, set-points, e-stop, health, restart."""

import threading
import time
from concurrent.futures import Future
from dataclasses import replace
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np

from server.control_process import ControlLaunch
from server.control_spawner import ControlSpawner
from server.errors import ControlDeadError, ControlTimeoutError
from server.estop_lane import EstopLane
from server.event_channel import EventChannel, dead
from server.setpoint import default_setpoint
from sim.processes.shared_record import SharedRecord
from sim.runtime.snapshot import SETPOINT, SNAPSHOT

START_TIMEOUT_S = 300.0
"""Where no machine code can be kept, the control process compiles all of it. One that dies is noticed at once."""
CALL_TIMEOUT_S = 5.0
SLOW_CALL_TIMEOUT_S = 30.0
CLOSE_PATIENCE_S = 2.0
STALLED_AFTER_S = 1.0
READ_ATTEMPTS = 10
"""Of a snapshot, on the event loop: a process that was stopped half-way through writing one leaves it unreadable."""


class ControlClient:
    """Supervises one control process at a time. Every method may be called from any thread.

    Attributes:
        estops: asks for an e-stop, whatever the control process is doing.
        tap_memory: where the control process tells a recorder of its ticks.

    Args:
        launch: what the first process is started with.
        spawner: may have spawned it already; by default one of its own.
    """

    def __init__(self, launch: ControlLaunch, spawner: ControlSpawner | None = None) -> None:
        self._launch = launch
        self._spawner = ControlSpawner() if spawner is None else spawner
        memories = self._spawner.memories
        self._state = SharedRecord(memories.state, SNAPSHOT)
        self._setpoints = SharedRecord(memories.setpoint, SETPOINT)
        self.estops = EstopLane(memories.estops)
        self.tap_memory = memories.tap
        self._setpoint = default_setpoint()
        self._setpoint_lock = threading.Lock()
        self._restart_lock = threading.Lock()
        self._process: BaseProcess | None = None
        self._channel: EventChannel | None = None
        self._last: np.ndarray | None = None

    @property
    def alive(self) -> bool:
        """Whether the control process runs."""
        return self.death is None

    @property
    def death(self) -> str | None:
        """Why the control process does not run, None while it does."""
        return "it has not been started" if self._channel is None else self._channel.death

    @property
    def busy(self) -> bool:
        """Whether it starts, or works on an event that takes long, such as loading a scene."""
        channel = self._channel
        if channel is None or channel.death is not None:
            return False
        return not channel.ready.done() or channel.awaits_slow_event(CALL_TIMEOUT_S)

    @property
    def pid(self) -> int | None:
        """Process id of the control process, None before the first start."""
        return self._process.pid if self._process is not None else None

    def require_alive(self) -> None:
        """
        Raises:
            ControlDeadError: no control process runs.
        """
        death = self.death
        if death is not None:
            raise dead(death)

    def start(self) -> None:
        """Launch the control process without waiting for it; `wait_ready` does."""
        self._process, pipe = self._spawner.launch(self._launch)
        self._channel = EventChannel(self._process, pipe)

    def wait_ready(self, timeout_s: float = START_TIMEOUT_S) -> dict[str, Any]:
        """What the session offers, once it ticks.

        Raises:
            ControlDeadError: it was not started, or died while starting.
            ControlTimeoutError: it is not ready in time.
        """
        try:
            return self._required().ready.result(timeout_s)
        except TimeoutError:
            raise ControlTimeoutError(f"the control process is not ready after {timeout_s:.0f} s") from None

    def close(self) -> None:
        """End the control process, by force if it does not end itself."""
        if self._channel is not None:
            self._channel.close(CLOSE_PATIENCE_S)

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
        """Send an event, without waiting; the future holds its value, or raises what `call` raises.

        Raises:
            ControlDeadError, ControlTimeoutError: see EventChannel.submit.
        """
        return self._required().submit(event, arguments)

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
        newest = self._state.read(READ_ATTEMPTS)
        if newest is not None:
            self._last = newest
        return None if self._last is None else self._last[0]

    def live_snapshot(self) -> np.void | None:
        """The newest SNAPSHOT record, None while no control process runs, or while it hangs."""
        return self.snapshot() if self.alive and not self.stalled else None

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
        return float("inf") if snapshot is None else time.monotonic() - float(snapshot["published_s"])

    @property
    def stalled(self) -> bool:
        """Whether the control process lives but hangs: it publishes nothing although nothing that takes long was asked."""
        return self.alive and self.snapshot_age_s() > STALLED_AFTER_S and not self.busy

    def write_setpoint(self, **fields: Any) -> None:
        """Change fields of the set-point that the control process reads; also, and without any, a sign of life."""
        with self._setpoint_lock:
            record = self._setpoint[0]
            for name, value in fields.items():
                record[name] = value
            record["heartbeat_s"] = time.monotonic()
            self._setpoints.write(self._setpoint)

    def unheard_s(self) -> float:
        """Time for which this side has given no sign of life."""
        with self._setpoint_lock:
            return time.monotonic() - float(self._setpoint[0]["heartbeat_s"])

    def _required(self) -> EventChannel:
        if self._channel is None:
            raise dead("it has not been started")
        return self._channel
