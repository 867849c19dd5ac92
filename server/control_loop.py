"""The real-time loop: events, set-point, tick, snapshot, every period, and nothing that waits on anyone.

Running and pausing, speed and single steps are the loop's own; everything else is the session's.
"""

import gc
import logging
import time
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from control.timing import CONTROL_PERIOD_S, TICK_S, Job, due
from server.messages import Close, Event, Outcome, Reply
from server.pacing import Pacer
from server.session_events import SLOW_EVENTS, EventError, SessionEvents
from server.setpoint import default_setpoint
from sim.backends.protocol import BackendError
from sim.processes.shared_record import SharedRecord
from sim.runtime.session import Session
from sim.runtime.snapshot import SNAPSHOT, Mode

SPEED_RANGE = (0.1, 4.0)
MAX_STEPS = 5000
NOTED_HOLD_S = 0.05

_URGENT = "estop"
_ESTOP_EVENTS = frozenset({"estop", "clear_estop"})
_RESTARTING = frozenset({"reset", "set_scene"})
_SEEN_AFTER_A_TICK = _RESTARTING | {"clear_estop"}
"""A hold makes one tick after these, so that the new state is seen."""

_log = logging.getLogger(__name__)


class ControlLoop:
    """Steps one session at 500 Hz, times the speed factor, until it is closed or its web process is gone.

    Args:
        session: what is stepped.
        state: SNAPSHOT records go out here.
        setpoints: SETPOINT records come in here.
        pipe: events come in and replies go out here.
        pacer: keeps time; its period is set here.
        paused: start in a hold instead of running.
        realtime: whether real-time scheduling was granted, for the snapshot.
    """

    def __init__(
        self,
        session: Session,
        state: SharedRecord,
        setpoints: SharedRecord,
        pipe: Connection,
        pacer: Pacer,
        *,
        paused: bool,
        realtime: bool,
    ) -> None:
        self._session = session
        self._events = SessionEvents(session)
        self._state = state
        self._setpoints = setpoints
        self._pipe = pipe
        self._pacer = pacer
        self._running = not paused
        self._speed = 1.0
        self._steps_left = 1  # so that there is something to show in a hold
        self._step_event: Event | None = None
        self._failure: str | None = None
        self._setpoint = default_setpoint()
        self._snapshot = np.zeros(1, SNAPSHOT)
        self._snapshot[0]["realtime_scheduling"] = realtime
        previous = state.read()
        self._sequence = 0 if previous is None else int(previous[0]["sequence"])  # goes on after a restart
        self._urgent_publish = True
        self._answers: list[tuple[Event, Outcome, Any]] = []
        self._closed = False
        self._ticks = 0  # since the session's reset
        self._idle = 0  # turns without a tick

    def run(self) -> None:
        """Loop until closed."""
        self._pacer.period_s = TICK_S / self._speed
        while not self._closed:
            self._pacer.wait()
            self.turn()
            self._pacer.finish(self._session.time_s)

    def turn(self) -> None:
        """One period's work. Replies go out last, so that whoever has one also sees its effect in the snapshot."""
        self._serve_events()
        self._read_setpoint()
        if self._failure is None and (self._running or self._steps_left > 0):
            self._tick()
        else:
            self._idle += 1
        # A snapshot that someone waits for does not wait for its slot.
        if self._urgent_publish or due(Job.SNAPSHOT, (self._idle or self._ticks) - 1):
            self._publish()
        for event, outcome, value in self._answers:
            if outcome is Outcome.DONE and event.name in _ESTOP_EVENTS:
                mode = self._snapshot[0]["mode"]
                value = {"latched": bool(mode == Mode.ESTOP), "mode": Mode(mode).name.lower()}
            self._send(Reply(event.id, outcome, value))
        self._answers.clear()

    def _tick(self) -> None:
        setpoint = self._setpoint[0]
        try:
            self._session.tick_setpoint(setpoint, _age_s(setpoint))
        except BackendError as error:
            _log.error("the backend failed: %s", error)
            self._failure = str(error)
            self._urgent_publish = True
            self._end_step(Outcome.REFUSED, self._failure)
            return
        self._idle = 0
        self._ticks = round(self._session.time_s / TICK_S)
        if due(Job.LIVE_ERRORS, self._ticks - 1):
            self._session.track_errors(CONTROL_PERIOD_S)
        if self._steps_left > 0:
            self._steps_left -= 1
            if self._steps_left == 0:
                self._urgent_publish = True
                self._end_step(Outcome.DONE, {"time_s": self._session.time_s})

    def _read_setpoint(self) -> None:
        # Few attempts: with a higher priority than the writer, waiting for it would never end. The last one still holds.
        newest = self._setpoints.read(attempts=3)
        if newest is None:
            return
        if newest[0]["sequence"] != self._setpoint[0]["sequence"]:
            self._urgent_publish = True
        self._setpoint = newest

    def _publish(self) -> None:
        record = self._snapshot[0]
        self._session.fill(record)
        self._sequence += 1
        record["sequence"] = self._sequence
        record["wall_time_s"] = time.time()
        record["backend_error"] = (self._failure or "").encode(errors="replace")
        if self._failure is not None:
            record["mode"] = Mode.FAULT
        elif not self._running and record["mode"] == Mode.RUNNING:
            record["mode"] = Mode.PAUSED
        statistics = self._pacer.statistics()
        record["loop_rate_hz"] = statistics.rate_hz
        record["real_time_factor"] = statistics.real_time_factor
        record["overruns"] = statistics.overruns
        record["rebases"] = statistics.rebases
        record["held_s"] = statistics.held_s
        record["lateness_p99_ms"] = statistics.lateness_p99_ms
        record["tick_median_us"] = statistics.tick_median_us
        record["speed"] = self._speed
        self._state.write(self._snapshot)
        self._urgent_publish = False

    def _serve_events(self) -> None:
        if not self._pipe.poll():
            return
        waiting: list[Event] = []
        try:
            while self._pipe.poll():
                message = self._pipe.recv()
                if isinstance(message, Close):
                    self._closed = True
                else:
                    waiting.append(message)
        except (EOFError, OSError):
            _log.warning("the web process is gone; ending")
            self._closed = True
            return
        waiting.sort(key=lambda event: event.name != _URGENT)
        for event in waiting:
            self._serve(event)
        self._urgent_publish = True

    def _serve(self, event: Event) -> None:
        try:
            if event.name == "step":
                self._start_steps(event)
                return
            value = self._set_run(**event.arguments) if event.name == "run" else self._call_session(event)
            self._answers.append((event, Outcome.DONE, value))
        except EventError as error:
            self._answers.append((event, error.outcome, str(error)))
        except Exception as error:
            # A defect in one call must not stop the robot's loop: report it to the caller and go on.
            _log.exception("event %s failed", event.name)
            self._answers.append((event, Outcome.FAILED, f"{type(error).__name__}: {error}"))

    def _call_session(self, event: Event) -> Any:
        started = time.perf_counter()
        try:
            value = self._events.carry_out(event.name, event.arguments)
        finally:
            if event.name in SLOW_EVENTS:
                self._pacer.excuse()
        if event.name in _RESTARTING:
            self._failure = None
            gc.collect()
            gc.freeze()
            self._pacer.excuse()
        if event.name in _SEEN_AFTER_A_TICK:
            self._steps_left = max(self._steps_left, 1)
        held_s = time.perf_counter() - started
        if held_s > NOTED_HOLD_S:
            _log.info("%s held the loop for %.0f ms", event.name, 1e3 * held_s)
        return value

    def _require_simulation(self, what: str) -> None:
        if not self._session.backend.capabilities.is_simulation:
            raise EventError(Outcome.REFUSED, f"{what}: simulation only; a robot cannot be held still or sped up by its clock")

    def _set_run(self, state: str | None, speed: float | None) -> dict[str, Any]:
        self._require_simulation("run and pause")
        if state == "running" and self._failure is not None:
            raise EventError(Outcome.REFUSED, f"the backend failed: {self._failure}; POST /api/v1/reset first")
        if speed is not None and speed != self._speed:
            self._speed = speed
            self._pacer.period_s = TICK_S / speed
        if state is not None:
            self._running = state == "running"
            if self._running:
                self._steps_left = 0
                self._end_step(Outcome.REFUSED, "stepping ended because the simulation was set running")
        return {"state": "running" if self._running else "paused", "speed": self._speed}

    def _start_steps(self, event: Event) -> None:
        self._require_simulation("step")
        if self._running:
            raise EventError(Outcome.REFUSED, 'the simulation is running; POST /api/v1/run {"state": "paused"} first')
        if self._failure is not None:
            raise EventError(Outcome.REFUSED, f"the backend failed: {self._failure}; POST /api/v1/reset first")
        if self._step_event is not None:
            raise EventError(Outcome.REFUSED, "a step is still under way; wait for its answer")
        self._step_event = event
        self._steps_left = event.arguments["ticks"]

    def _end_step(self, outcome: Outcome, value: Any) -> None:
        if self._step_event is not None:
            event, self._step_event = self._step_event, None
            self._answers.append((event, outcome, value))

    def _send(self, reply: Reply) -> None:
        try:
            self._pipe.send(reply)
        except (BrokenPipeError, ConnectionResetError):
            self._closed = True


def _age_s(setpoint: np.void) -> float:
    """Time since the operator's side was last heard. Monotonic: a corrected wall clock must neither stop nor hide anything."""
    heard_s = float(setpoint["heartbeat_s"])
    return time.monotonic() - heard_s if heard_s > 0.0 else float("inf")
