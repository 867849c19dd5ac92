"""The real-time loop: e-stop, events, set-point, tick, snapshot, every period, and nothing that waits on anyone.

Running, pausing and stepping are the loop's own (server.run_control); everything else is the session's.
"""

import gc
import logging
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from control.timing import CONTROL_PERIOD_S, TICK_S, Job, due
from server.estop_lane import EstopLane
from server.event_port import EventPort
from server.history_events import BRANCH, HISTORY_EVENTS, HistoryEvents
from server.messages import Event, Outcome, Reply
from server.pacing import LoopStatistics, Pacer
from server.run_control import RunControl
from server.session_events import READING_EVENTS, SLOW_EVENTS, EventError, SessionEvents
from server.setpoint import default_setpoint, released
from sim.backends.protocol import Backend, BackendError
from sim.processes.shared_record import SharedRecord
from sim.recording import tap as tap_module
from sim.recording.describe import describe_session
from sim.recording.description import Description
from sim.recording.keyframes import Keyframes
from sim.recording.tap import Heads, Tap
from sim.runtime.history import History
from sim.runtime.replay_session import ReplaySession
from sim.runtime.session import Session
from sim.runtime.simulation import Simulation
from sim.runtime.snapshot import SNAPSHOT, Mode
from sim.runtime.tick_row import TickRow

NOTED_HOLD_S = 0.05

_RESTARTING = frozenset({"reset", "set_scene"})
_CLEAR = "clear_estop"
_ERRORS_TRACKED = {"interval_s": CONTROL_PERIOD_S}
_SEEN_AFTER_A_TICK = _RESTARTING | {_CLEAR}
"""A hold makes one tick after these, so that the new state is seen."""

_log = logging.getLogger(__name__)


class ControlLoop:
    """Steps one session at 500 Hz, times the speed factor, until it is closed or its web process is gone.

    Args:
        session: what is stepped.
        state: SNAPSHOT records go out here.
        setpoints: SETPOINT records come in here.
        estops: the e-stop comes in here.
        pipe: events come in and replies go out here.
        pacer: keeps time; its period is set here.
        paused: start in a hold instead of running.
        realtime: whether real-time scheduling was granted, for the snapshot.
        tap: where a recorder listens.
    """

    def __init__(
        self,
        session: Session[Backend],
        state: SharedRecord,
        setpoints: SharedRecord,
        estops: EstopLane,
        pipe: Connection,
        pacer: Pacer,
        *,
        paused: bool,
        realtime: bool,
        tap: Tap | None = None,
    ) -> None:
        self._session = session
        self._events = SessionEvents(session)
        self._history = History(session) if isinstance(session, Simulation) else None
        self._history_events = HistoryEvents(session, self._history, self._heed_estop)
        self._tap = tap or Tap(tap_module.allocate())
        self._row = TickRow()
        self._tapped_ticks = 0  # of the recording, when its last moment was put
        self._keyframes = Keyframes(self._tap, lambda: None if self._history is None else self._history.newest)
        self._own_deeds = dict(session.own_deeds)
        self._state = state
        self._setpoints = setpoints
        self._estops = estops
        self._heeded_estop = False  # told as latched, before it is
        self._port = EventPort(pipe)
        self._pacer = pacer
        self._run = RunControl(running=not paused)
        self._failure: str | None = None
        self._setpoint = default_setpoint()[0]
        self._void_sequence = -1  # of the command that was asked before the last restart
        self._snapshot = np.zeros(1, SNAPSHOT)
        self._record: np.void = self._snapshot[0]
        self._record["realtime_scheduling"] = realtime
        previous = state.read()
        self._sequence = 0 if previous is None else int(previous[0]["sequence"])  # goes on after a restart
        self._statistics: LoopStatistics | None = None  # as in the snapshot
        self._urgent_publish = True
        self._answers: list[tuple[Event, Outcome, Any]] = []
        self._ticks = 0  # since the session's reset
        self._idle = 0  # turns without a tick

    def run(self) -> None:
        """Loop until closed."""
        self._pacer.period_s = self._run.period_s
        while not self._port.closed:
            self._pacer.wait()
            self.turn()
            self._pacer.finish(self._session.time_s)

    def turn(self) -> None:
        """One period's work. Replies go out last, so that whoever has one also sees its effect in the snapshot."""
        stopped = self._take_estop()
        self._serve_events()
        self._read_setpoint()
        if self._failure is None and self._run.ticking:
            self._tick()
        else:
            self._idle += 1
        # A snapshot that someone waits for does not wait for its slot.
        if self._urgent_publish or due(Job.SNAPSHOT, (self._idle or self._ticks) - 1):
            self._publish()
        if stopped is not None:
            self._estops.take(*stopped)
        self._answer()

    def _take_estop(self) -> tuple[int, Mode] | None:
        """Latch the e-stop if one is pending; its number, and the mode that it led to."""
        if not self._estops.pending:
            return None
        asked = self._estops.asked
        try:
            self._session.estop()
            self._happened("estop", self._session.estop, {})
        except BackendError:
            _log.exception("the backend did not take the e-stop")
        self._end_step("the e-stop was pressed")
        self._urgent_publish = True
        return asked, self._session.mode

    def _heed_estop(self) -> None:
        """Confirm an e-stop while the past is made again: nothing goes on from what comes of that before it is latched."""
        if not self._estops.pending:
            return
        asked = self._estops.asked
        self._heeded_estop = True
        self._record["mode"] = Mode.ESTOP
        self._send_snapshot()
        self._estops.take(asked, Mode.ESTOP)

    def _answer(self) -> None:
        for event, outcome, value in self._answers:
            if outcome is Outcome.DONE and event.name == _CLEAR:
                mode = self._record["mode"]
                value = {"latched": bool(mode == Mode.ESTOP), "mode": Mode(mode).name.lower()}
            self._port.post(Reply(event.id, outcome, value))
        self._answers.clear()
        self._port.flush()

    def _tick(self) -> None:
        setpoint = self._setpoint
        if setpoint["sequence"] == self._void_sequence:
            setpoint = released(setpoint)
        age_s = _age_s(setpoint)
        try:
            self._session.tick_setpoint(setpoint, age_s)
        except BackendError as error:
            _log.error("the backend failed: %s", error)
            self._failure = str(error)
            self._urgent_publish = True
            self._end_step(self._failure)
            return
        if self._history is not None:
            self._history.ticked(setpoint, age_s)
        if self._tap.active:
            self._record_tick()
        self._idle = 0
        self._ticks = round(self._session.time_s / TICK_S)
        if due(Job.LIVE_ERRORS, self._ticks - 1):
            self._session.track_errors(CONTROL_PERIOD_S)
            if self._history is not None:
                self._history.happened(self._session.track_errors, _ERRORS_TRACKED)
        step = self._run.ticked()
        if step is not None:
            self._urgent_publish = True
            self._answers.append((step, Outcome.DONE, {"time_s": self._session.time_s}))

    def _read_setpoint(self) -> None:
        # Few attempts: with a higher priority than the writer, waiting for it would never end. The last one still holds.
        # A hold has the time to yield to the writer, and its next tick shall run what was asked before it.
        newest = self._setpoints.read_new(attempts=3) if self._run.running else self._setpoints.read_new()
        if newest is None:
            return
        if newest[0]["sequence"] != self._setpoint["sequence"]:
            self._urgent_publish = True
        self._setpoint = newest[0]

    def _void_setpoint(self) -> None:
        """What was asked before a restart does not act after it, not even until its operator's side has let go of it."""
        newest = self._setpoints.read()
        self._void_sequence = int((self._setpoint if newest is None else newest[0])["sequence"])

    def _publish(self) -> None:
        record, history = self._record, self._history
        past = None if history is None else history.shown
        if past is None:
            self._session.fill(record)
            record["history_start_s"] = record["history_end_s"] = np.nan
        else:
            self._snapshot[0] = past
            record["mode"] = self._session.mode
        if past is not None or isinstance(self._session, ReplaySession):
            self._statistics = None  # those in the record are not of now
        if history is not None:
            record["history_start_s"], record["history_end_s"] = history.start_s, history.end_s
            record["branch"], record["past"] = history.branch, past is not None
        record["failure"] = (self._failure or "").encode()
        if self._failure is not None and record["mode"] != Mode.ESTOP:
            record["mode"] = Mode.FAULT
        elif not self._run.running and record["mode"] == Mode.RUNNING:
            record["mode"] = Mode.PAUSED
        record["tick_histogram"] = self._pacer.tick_histogram
        record["tick_total_s"] = self._pacer.tick_total_s
        record["speed"] = self._run.speed
        statistics = self._pacer.statistics()
        if statistics != self._statistics:
            self._statistics = statistics
            record["loop_rate_hz"] = statistics.rate_hz
            record["real_time_factor"] = statistics.real_time_factor
            record["overruns"] = statistics.overruns
            record["overruns_last_minute"] = statistics.overruns_last_minute
            record["overrun_share"] = statistics.overrun_share
            record["rebases"] = statistics.rebases
            record["held_s"] = statistics.held_s
            record["lateness_p99_ms"] = statistics.lateness_p99_ms
            record["tick_median_us"] = statistics.tick_median_us
        tap = self._tap
        record["recording"] = tap.name if tap.active else b""
        record["recording_s"], record["recording_bytes"] = TICK_S * tap.count, tap.size_bytes
        self._send_snapshot()
        if tap.active and past is None and tap.count > self._tapped_ticks:
            self._tapped_ticks = tap.count
            tap.put_moment(record)
        if history is not None and past is None:
            history.published(record)
        self._urgent_publish = False

    def _send_snapshot(self) -> None:
        self._sequence += 1
        self._record["sequence"] = self._sequence
        self._record["wall_time_s"] = time.time()
        self._record["published_s"] = time.monotonic()
        self._state.write(self._snapshot)

    def _serve_events(self) -> None:
        while (event := self._port.receive()) is not None:
            self._serve(event)
            self._urgent_publish = True
            if event.name in SLOW_EVENTS:
                return  # the e-stop has its turn before the next one

    def _serve(self, event: Event) -> None:
        try:
            if event.name == "step":
                self._require_simulation("step")
                self._require_sound_backend()
                self._run.step(event)
                return
            if event.name == _CLEAR:
                self._require_no_later_estop(event.arguments.pop("estops"))
            if event.name == "start_recording":
                value = self._start_recording(**event.arguments)
            elif event.name == "replay":
                value = self._replay(**event.arguments)
            elif event.name == "run":
                value = self._set_run(**event.arguments)
            elif event.name in HISTORY_EVENTS:
                value = self._look_back(event)
            else:
                value = self._call_session(event)
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
            if self._history is not None:
                self._history.clear()
            self._end_step(f"{event.name} came between")
            self._void_setpoint()
            self._failure = None
            gc.collect()
            gc.freeze()
            self._pacer.excuse()
        elif event.name not in READING_EVENTS:
            self._happened(event.name, self._events.offered[event.name], event.arguments)
        if event.name in _SEEN_AFTER_A_TICK:
            self._run.show_one()
        held_s = time.perf_counter() - started
        if held_s > NOTED_HOLD_S:
            _log.info("%s held the loop for %.0f ms", event.name, 1e3 * held_s)
        return value

    def _replay(self, time_s: float | None = None, state: str | None = None, speed: float | None = None) -> dict[str, Any]:
        session: Any = self._session
        if not isinstance(session, ReplaySession):
            raise EventError(Outcome.REFUSED, "no recording is shown; PUT /api/v1/backend with 'replay' and its id first")
        ended = session.time_s >= session.duration_s
        try:
            session.seek(
                0.0 if time_s is None and state == "playing" and ended else session.time_s if time_s is None else time_s
            )
        except ValueError as error:
            raise EventError(Outcome.INVALID, str(error)) from error
        run = self._run.set({"playing": "running", "paused": "paused", None: None}[state], speed)
        self._pace()
        playing = run["state"] == "running" and session.time_s < session.duration_s
        return {
            "time_s": session.time_s,
            "duration_s": session.duration_s,
            "state": "playing" if playing else "paused",
            "speed": run["speed"],
        }

    def _look_back(self, event: Event) -> dict[str, Any]:
        if event.name == BRANCH and self._tap.active:
            raise EventError(Outcome.REFUSED, "a recording is under way, and time runs on in it; stop it first")
        try:
            value = self._history_events.carry_out(event.name, event.arguments, running=self._run.running)
        finally:
            if self._heeded_estop:
                self._heeded_estop = False
                self._session.estop()
                self._happened("estop", self._session.estop, {})
        if event.name == BRANCH:
            self._pacer.excuse()
            self._end_step("the simulation was set back")
            self._failure = None
        return value

    def _happened(self, name: str, call: Callable[..., Any], arguments: dict[str, Any]) -> None:
        if self._history is not None:
            self._history.happened(call, arguments)
        if self._tap.active:
            self._tap.put_event(name, arguments)

    def _record_tick(self) -> None:
        deeds = self._session.own_deeds
        if deeds != self._own_deeds:
            for name in (name for name in deeds if deeds[name] != self._own_deeds[name]):
                self._tap.put_event(name, {})
            self._own_deeds = dict(deeds)
        self._tap.put_tick(self._row.write(self._session))
        self._keyframes.ticked(self._session.pipeline)

    def _start_recording(self, name: str) -> tuple[Description, Heads]:
        """Its description, and where the tap's other rings stood before it."""
        if isinstance(self._session, ReplaySession):
            raise EventError(Outcome.REFUSED, "a recording is shown; PUT /api/v1/backend with 'simulation' first")
        if self._tap.active:
            raise EventError(Outcome.REFUSED, "a recording is under way; DELETE /api/v1/recordings/current first")
        description = describe_session(self._session)
        heads = self._tap.heads
        self._own_deeds = dict(self._session.own_deeds)
        self._tapped_ticks = 0
        self._tap.start(name)
        self._keyframes.start()
        self._pacer.excuse()
        return description, heads

    def _require_no_later_estop(self, cleared: int) -> None:
        if self._estops.asked != cleared:
            raise EventError(Outcome.REFUSED, "the e-stop was pressed again meanwhile; POST /api/v1/estop/clear once more")

    def _require_simulation(self, what: str) -> None:
        if not isinstance(self._session, Simulation | ReplaySession):
            raise EventError(Outcome.REFUSED, f"{what}: simulation only; a robot cannot be held still or sped up by its clock")

    def _require_sound_backend(self) -> None:
        if self._failure is not None:
            raise EventError(Outcome.REFUSED, f"the backend failed: {self._failure}; POST /api/v1/reset first")

    def _set_run(self, state: str | None, speed: float | None) -> dict[str, Any]:
        self._require_simulation("run and pause")
        if state == "running":
            self._require_sound_backend()
        if state is not None:
            self._end_step(f"the simulation was set {state}")
        answer = self._run.set(state, speed)
        self._pace()
        return answer

    def _pace(self) -> None:
        if self._pacer.period_s != self._run.period_s:
            self._pacer.period_s = self._run.period_s

    def _end_step(self, reason: str) -> None:
        step = self._run.cut_short()
        if step is not None:
            self._answers.append((step, Outcome.REFUSED, f"stepping ended: {reason}"))


def _age_s(setpoint: np.void) -> float:
    """Time since the operator's side was last heard. Monotonic: a corrected wall clock must neither stop nor hide anything."""
    heard_s = float(setpoint["heartbeat_s"])
    return time.monotonic() - heard_s if heard_s > 0.0 else float("inf")
