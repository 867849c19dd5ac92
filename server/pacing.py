"""Keeps a loop on an absolute schedule and measures honestly how well it does.

Tick k is due at `start + k * period`, so a late wake-up never shifts the ticks after it. A tick that finishes after the
next one was due is an overrun. A loop that falls more than `REBASE_BEHIND_S` behind drops the lost time instead of racing
after it, and counts that; work that is known to take long (loading a scene) is excused: it moves the schedule too but is
neither overrun nor lateness.
"""

import time
from bisect import bisect_left
from collections import deque
from collections.abc import Callable

import numpy as np

from control.values import value

REBASE_BEHIND_S = 0.1
LATENESS_WINDOW = 2500
"""Ticks whose lateness and duration are kept: 5 s at 500 Hz."""

TICK_BOUNDS_S = (1e-4, 2e-4, 3e-4, 4e-4, 5e-4, 6e-4, 8e-4, 1e-3, 1.25e-3, 1.5e-3, 1.75e-3, 2e-3, 3e-3, 5e-3, 1e-2, 2e-2)
"""Upper bounds of the classes into which the durations of ticks are counted; a last class holds what is longer."""

RATE_WINDOW_S = 1.0
MINUTE_S = 60.0
STATISTICS_EVERY = 250
REST_AFTER_S = 0.005
REST_SHARE = 0.1
LONGEST_REST_S = 0.001
"""A loop that cannot keep up rests after so much work, for a share of it. Linux stops a real-time process that works for 0.95
of a second until that is over (`sched_rt_runtime_us`): 50 ms in which no e-stop acts. Others on its core wait until it rests.
"""


@value
class LoopStatistics:
    """How the loop keeps time. Rates are over the last second, quantiles over the last `LATENESS_WINDOW` ticks.

    `held_s` is the time spent on excused work since the start, `overrun_share` that of the window's ticks that were overruns,
    `overruns_last_minute` how many there were in the last minute, or since the start where that is less long ago.
    """

    rate_hz: float = 0.0
    real_time_factor: float = 0.0
    overruns: int = 0
    overruns_last_minute: int = 0
    overrun_share: float = 0.0
    rebases: int = 0
    held_s: float = 0.0
    lateness_p99_ms: float = 0.0
    tick_median_us: float = 0.0


class Pacer:
    """Call `wait` before and `finish` after every tick.

    Attributes:
        tick_histogram: ticks since the start by their duration, in the classes of TICK_BOUNDS_S.
        tick_total_s: sum of their durations.

    Args:
        period_s: wall-clock time between ticks.
        clock: monotonic seconds.
        sleep: suspends the caller for seconds.
    """

    def __init__(
        self, period_s: float, clock: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._clock = clock
        self._sleep = sleep
        self._period_s = period_s
        self._due_s = clock()
        self._started_s = self._due_s
        self._slept_s = self._due_s
        self._lateness_s = np.zeros(LATENESS_WINDOW)
        self._duration_s = np.zeros(LATENESS_WINDOW)
        self._overran = np.zeros(LATENESS_WINDOW, bool)
        self.tick_histogram = [0] * (len(TICK_BOUNDS_S) + 1)
        self.tick_total_s = 0.0
        self._ticks = 0
        self._overruns = 0
        self._rebases = 0
        self._held_s = 0.0
        self._minute: deque[tuple[float, int]] = deque([(self._due_s, 0)])  # clock and overruns until then
        self._marks: deque[tuple[float, int, float]] = deque()
        self._window = (0.0, 0.0, 0.0)

    @property
    def period_s(self) -> float:
        """Wall-clock time between ticks; setting it restarts the schedule from now."""
        return self._period_s

    @period_s.setter
    def period_s(self, period_s: float) -> None:
        self._period_s = period_s
        self.excuse()

    def wait(self) -> None:
        """Sleep until the next tick is due."""
        now = self._clock()
        if self._due_s > now:
            self._sleep(self._due_s - now)
            self._slept_s = now = self._clock()
        elif now - self._slept_s > REST_AFTER_S:
            self._sleep(min(REST_SHARE * (now - self._slept_s), LONGEST_REST_S))
            self._slept_s = now = self._clock()
        self._started_s = now

    def finish(self, simulated_s: float) -> None:
        """Account for the tick that just ended, at simulated time `simulated_s`, and schedule the next."""
        now = self._clock()
        slot = self._ticks % LATENESS_WINDOW
        self._lateness_s[slot] = self._started_s - self._due_s
        self._duration_s[slot] = duration_s = now - self._started_s
        self.tick_histogram[bisect_left(TICK_BOUNDS_S, duration_s)] += 1
        self.tick_total_s += duration_s
        self._ticks += 1
        self._due_s += self._period_s
        self._overran[slot] = now > self._due_s
        if now > self._due_s:
            self._overruns += 1
            if now - self._due_s > REBASE_BEHIND_S:
                self._rebases += 1
                self._due_s = now
        if self._ticks % 25 == 0:
            self._mark(now, simulated_s)
        if self._ticks % STATISTICS_EVERY == 0:
            self._window = self._measure()
            self._minute.append((now, self._overruns))
            while now - self._minute[0][0] > MINUTE_S:
                self._minute.popleft()

    def excuse(self) -> None:
        """Restart the schedule from now after known slow work in this tick, which then is neither late nor an overrun."""
        now = self._clock()
        self._held_s += now - self._started_s
        self._started_s = self._due_s = now
        self._marks.clear()

    def statistics(self) -> LoopStatistics:
        """Statistics up to the last `finish`; cheap enough for every tick."""
        lateness_p99_s, tick_median_s, overrun_share = self._window
        rate_hz = factor = 0.0
        if len(self._marks) > 1:
            (first_s, first_ticks, first_simulated_s), (last_s, last_ticks, last_simulated_s) = self._marks[0], self._marks[-1]
            rate_hz = (last_ticks - first_ticks) / (last_s - first_s)
            factor = (last_simulated_s - first_simulated_s) / (last_s - first_s)
        return LoopStatistics(
            rate_hz,
            factor,
            self._overruns,
            self._overruns - self._minute[0][1],
            overrun_share,
            self._rebases,
            self._held_s,
            1e3 * lateness_p99_s,
            1e6 * tick_median_s,
        )

    def _mark(self, now: float, simulated_s: float) -> None:
        if self._marks and simulated_s < self._marks[-1][2]:
            self._marks.clear()  # the simulation was reset
        self._marks.append((now, self._ticks, simulated_s))
        while now - self._marks[0][0] > RATE_WINDOW_S and len(self._marks) > 2:
            self._marks.popleft()

    def _measure(self) -> tuple[float, float, float]:
        count = min(self._ticks, LATENESS_WINDOW)
        rank = min(count - 1, int(0.99 * count))
        lateness = np.partition(self._lateness_s[:count], rank)[rank]
        return float(lateness), float(np.median(self._duration_s[:count])), float(self._overran[:count].mean())
