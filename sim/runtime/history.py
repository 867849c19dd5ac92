"""The last minute of a simulation: any moment of it can be shown, and the simulation can go on from any tick of it.

Every HALF_SECOND all that the session carries is kept (control.state.capture), and besides every tick's resolved inputs and
everything that was done to the session between two ticks. Going back to a tick means putting back the moment before it and
making the ticks after it again, which gives the very same bytes. Showing a moment means showing the snapshot of then.

A task at work cannot be kept, for its program cannot be set back: it is begun again where the moment before it is near, and
what lies farther on in it can be shown only.
"""

from array import array
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from control.state.capture import Moment, StateError
from control.timing import SLOT_COUNT, TICK_S, Job, due
from sim.runtime.session import SessionError
from sim.runtime.simulation import Simulation
from sim.runtime.snapshot import SETPOINT, SNAPSHOT

WINDOW_S = 60.0
HALF_SECOND = 250
"""Ticks from one kept moment to the next: as many are made again at most."""

_ALMOST = HALF_SECOND - SLOT_COUNT
"""Ticks from one kept moment after which the next slot is the next one's: HALF_SECOND is a number of whole periods."""

_WINDOW = round(WINDOW_S / TICK_S)
_SHOWN_EVERY = 5
"""Ticks between two kept snapshots, those that are published."""


class HistoryTimeError(ValueError):
    """A time that the history does not reach; the message tells which it does."""


class _Kept(NamedTuple):
    tick: int
    moment: Moment


class _Deed(NamedTuple):
    """Something done to the session after a tick, before the next one."""

    tick: int
    call: Callable[..., Any]
    arguments: dict[str, Any]


class History:
    """Told of all that happens to one simulation, in order. Single-threaded.

    Attributes:
        branch: counts how often the simulation has gone on from an earlier moment.
    """

    def __init__(self, session: Simulation) -> None:
        self.branch = 0
        self._session = session
        # Written to, so that all of their memory is there: it grows no more, and no tick waits for a page of it.
        self._setpoints = np.full(_WINDOW + HALF_SECOND, np.zeros((), SETPOINT))
        self._setpoint_of_tick = array("q", bytes(8 * len(self._setpoints)))
        self._setpoint: np.void | None = None
        self._setpoint_count = 0
        self._ages_s = array("d", bytes(8 * len(self._setpoints)))
        self._snapshots = np.full(len(self._setpoints) // _SHOWN_EVERY, np.zeros((), SNAPSHOT))
        self._snapshot_bytes = self._snapshots.view(np.uint8).data
        self._snapshot_ticks = np.full(len(self._snapshots), -1)
        self._snapshot_tick = self._snapshot_ticks.data  # to be read and set one by one
        self._kept: deque[_Kept] = deque()
        self._deeds: deque[_Deed] = deque()
        self._last = 0
        self._shown: np.void | None = None
        self._trouble: str | None = None

    def clear(self) -> None:
        """Forget all: the session starts anew."""
        self._kept.clear()
        self._deeds.clear()
        self._snapshot_ticks[:] = -1
        self._shown = self._trouble = None

    @property
    def newest(self) -> Moment | None:
        """What was kept at the newest tick, None if that was not its turn."""
        return self._kept[-1].moment if self._kept and self._kept[-1].tick == self._last else None

    @property
    def trouble(self) -> str | None:
        """Why nothing is kept, None while it is."""
        return self._trouble

    @property
    def start_s(self) -> float:
        """Simulated time of the earliest moment; NaN without any."""
        return TICK_S * max(self._kept[0].tick, self._last - _WINDOW) if self._kept else np.nan

    @property
    def end_s(self) -> float:
        """Simulated time of the newest moment; NaN without any."""
        return TICK_S * self._last if self._kept else np.nan

    @property
    def shown(self) -> np.void | None:
        """The SNAPSHOT record of an earlier moment that is to be shown instead of the newest one."""
        return self._shown

    @property
    def shown_s(self) -> float:
        """Simulated time of what is shown."""
        return self.end_s if self._shown is None else float(self._shown["time_s"])

    def happened(self, call: Callable[..., Any], arguments: dict[str, Any]) -> None:
        """Something was done to the session: calling it again with these arguments does it again."""
        if self._kept:
            self._deeds.append(_Deed(self._last, call, arguments))

    def ticked(self, setpoint: np.void, age_s: float) -> None:
        """The session has ticked with these inputs. The set-point is the object of the tick before while it stays the same."""
        if self._trouble is not None:
            return
        self._last = round(self._session.time_s / TICK_S)
        slot = self._last % len(self._ages_s)
        if setpoint is not self._setpoint:
            self._setpoint = setpoint
            self._setpoint_count += 1
            self._setpoints[self._setpoint_count % len(self._setpoints)] = setpoint
        self._setpoint_of_tick[slot], self._ages_s[slot] = self._setpoint_count, age_s
        self._shown = None
        if not self._kept or (self._last - self._kept[-1].tick > _ALMOST and due(Job.KEPT_MOMENT, self._last - 1)):
            self._keep()

    def published(self, snapshot: np.void) -> None:
        """A SNAPSHOT record of the newest tick."""
        index = self._last // _SHOWN_EVERY % len(self._snapshots)
        if self._kept and self._snapshot_tick[index] // _SHOWN_EVERY != self._last // _SHOWN_EVERY:
            start = index * SNAPSHOT.itemsize
            self._snapshot_bytes[start : start + SNAPSHOT.itemsize] = snapshot.tobytes()
            self._snapshot_tick[index] = self._last

    def show(self, time_s: float) -> None:
        """Show the last snapshot up to a moment; the newest moment is shown by the session itself.

        Raises:
            HistoryTimeError: nothing is kept of then.
        """
        tick = self._tick_of(time_s)
        if tick == self._last:
            self._shown = None
            return
        ticks = self._snapshot_ticks
        earlier = np.where((ticks <= tick) & (ticks >= 0), ticks, -1)
        index = int(earlier.argmax())
        if earlier[index] < 0:
            index = int(np.where(ticks >= 0, ticks, np.iinfo(ticks.dtype).max).argmin())
        self._shown = self._snapshots[index].copy()

    def go_back(self, time_s: float | None, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Set the session back to a moment, by default the one that is shown. What came after it is forgotten.

        A latched e-stop stays latched. `meanwhile` is called after every tick that is made again, and must leave the session
        alone.

        Raises:
            HistoryTimeError: nothing is kept of then.
            SessionError: nothing is kept at all.
        """
        tick = self._tick_of(self.shown_s if time_s is None else time_s)
        session = self._session
        latched = session.pipeline.estop_latched
        start = next(kept.tick for kept in reversed(self._kept) if kept.tick <= tick)
        if tick - start > HALF_SECOND:
            raise HistoryTimeError(
                f"a task was at work at {TICK_S * tick:.3f} s, whose program cannot be set back; "
                f"{TICK_S * (start + HALF_SECOND):.3f} s and before can be gone on from, and what came after it"
            )
        while self._kept[-1].tick > tick:
            self._kept.pop()
        self._kept[-1].moment.restore()
        deeds = [deed for deed in self._deeds if start <= deed.tick < tick]
        while self._deeds and self._deeds[-1].tick >= tick:
            self._deeds.pop()
        published = set(self._snapshot_ticks.tolist())
        for number in range(start + 1, tick + 1):
            while deeds and deeds[0].tick < number:
                deed = deeds.pop(0)
                deed.call(**deed.arguments)
            slot = number % len(self._ages_s)
            session.tick_setpoint(self._setpoints[self._setpoint_of_tick[slot] % len(self._setpoints)], self._ages_s[slot])
            if number in published:  # some readings count from one to the next
                session.readings()
            meanwhile()
        self._last = tick
        # What was asked later is written over, so that set-points never outnumber the ticks they are kept for.
        self._setpoint, self._setpoint_count = None, self._setpoint_of_tick[tick % len(self._ages_s)]
        self._snapshot_ticks[self._snapshot_ticks > tick] = -1
        self._shown = None
        self.branch += 1
        if latched and not session.pipeline.estop_latched:
            session.estop()
            self.happened(session.estop, {})

    def _keep(self) -> None:
        if self._session.tasks.running:
            return
        try:
            self._kept.append(_Kept(self._last, Moment(self._session)))
        except StateError as error:
            self.clear()
            self._trouble = str(error)
            return
        while len(self._kept) > 1 and self._last - self._kept[1].tick >= _WINDOW:
            self._kept.popleft()
        while self._deeds and self._deeds[0].tick < self._kept[0].tick:
            self._deeds.popleft()

    def _tick_of(self, time_s: float) -> int:
        if not self._kept:
            reason = self._trouble or "let the simulation run first"
            raise SessionError(f"there is no history yet: {reason}")
        tick = round(time_s / TICK_S)
        if not round(self.start_s / TICK_S) <= tick <= self._last:
            raise HistoryTimeError(f"the history does not reach {time_s:g} s; {self.start_s:.3f} to {self.end_s:.3f} s")
        return tick
