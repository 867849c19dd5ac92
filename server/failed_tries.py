"""Slows guessing: the answer to a wrong token is held back, the longer the more of them came lately.

A right token never waits, so that nobody can lock the operator out. Hence a guesser that hangs up early is not slowed by this;
against him the token must be long.
"""

import time
from collections.abc import Callable

FIRST_S = 0.1
LONGEST_S = 5.0
FORGET_S = 10.0
"""One failure is forgotten after each such time."""


class FailedTries:
    """Counts for all addresses together, because only wrong tries feel it.

    Args:
        clock: monotonic time in s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures = 0.0
        self._last_s = clock()

    def delay_s(self) -> float:
        """Count a failure; how long its answer must wait, in s."""
        now = self._clock()
        self._failures = max(self._failures - (now - self._last_s) / FORGET_S, 0.0)
        self._last_s = now
        delay = min(FIRST_S * 2.0**self._failures, LONGEST_S)
        # Not beyond the longest delay, or a flood would be remembered for hours.
        if delay < LONGEST_S:
            self._failures += 1.0
        return delay
