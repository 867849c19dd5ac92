"""The e-stop's own way into the control process: a few words in shared memory, which nothing can fill, delay or stop.

The web process counts how often the e-stop was asked for. The control process looks at every turn and, once it has
published the state after it, answers with the count it acted on and with the mode that came of it. What was asked for while
no control process ran, or while it hung, waits for it or for the next one.
"""

import threading
import time
from typing import Any

import numpy as np

from sim.processes.anonymous_memory import AnonymousMemory
from sim.runtime.snapshot import Mode

_ASKED, _TAKEN, _MODE = range(3)
HELD_S = 0.004
"""Two turns of a control process that ticks."""

HELD_SHARE = 0.1
"""Of the time, at most: presses without end shall not keep everybody else out."""

_LOOK_EVERY_S = 0.0002


def allocate() -> AnonymousMemory:
    """Zeroed memory for one lane, to be given to `EstopLane` here and, as a process argument, in a spawned child."""
    return AnonymousMemory(3 * np.uint64().itemsize)


class EstopLane:
    """View of the lane in one process. `ask` is the web process's, `take` the control process's.

    Args:
        memory: from `allocate`.
    """

    def __init__(self, memory: Any) -> None:
        self._counts = np.frombuffer(memory, np.uint64)
        self._lock = threading.Lock()
        self._free_s = 0.0

    @property
    def asked(self) -> int:
        """How often the e-stop was asked for."""
        return int(self._counts[_ASKED])

    @property
    def pending(self) -> bool:
        """Whether one was asked for that no control process has acted on."""
        return int(self._counts[_TAKEN]) != self.asked

    def ask(self) -> int:
        """Ask for an e-stop, from any thread; returns its number."""
        with self._lock:
            self._counts[_ASKED] += np.uint64(1)
            return self.asked

    @property
    def mode(self) -> Mode:
        """What the last one that was acted on led to. The state may say otherwise by now: others may clear it at any time."""
        return Mode(int(self._counts[_MODE]))

    def take(self, number: int, mode: Mode) -> None:
        """Say that everything up to `number` was acted on and published, and led to `mode`."""
        self._counts[_MODE] = mode
        self._counts[_TAKEN] = number

    def taken(self, number: int) -> bool:
        """Whether the e-stop of that number was acted on and published."""
        return int(self._counts[_TAKEN]) >= number

    def hold_until_taken(self, number: int) -> None:
        """Hold the calling thread until the e-stop of that number was acted on, for at most HELD_S, and not too often.

        An event loop does everybody else's work at each of its turns; whoever waits for the e-stop on it waits for a crowd.
        """
        now = time.monotonic()
        if now < self._free_s:
            return
        self._free_s = now + HELD_S / HELD_SHARE
        while not self.taken(number) and time.monotonic() < now + HELD_S:
            time.sleep(_LOOK_EVERY_S)
