"""The e-stop's own way into the control process: two counters in shared memory, which nothing can fill, delay or stop.

The web process counts how often the e-stop was asked for. The control process looks at every turn and, once it has
published the state that shows what came of it, answers with the count it acted on. What was asked for while no control
process ran, or while it hung, waits for it or for the next one.
"""

import threading
from typing import Any

import numpy as np

from sim.processes.anonymous_memory import AnonymousMemory

_ASKED, _TAKEN = 0, 1


def allocate() -> AnonymousMemory:
    """Zeroed memory for one lane, to be given to `EstopLane` here and, as a process argument, in a spawned child."""
    return AnonymousMemory(2 * np.uint64().itemsize)


class EstopLane:
    """View of the lane in one process. `ask` is the web process's, `take` the control process's.

    Args:
        memory: from `allocate`.
    """

    def __init__(self, memory: Any) -> None:
        self._counts = np.frombuffer(memory, np.uint64)
        self._lock = threading.Lock()

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

    def take(self, number: int) -> None:
        """Say that everything up to `number` was acted on and published."""
        self._counts[_TAKEN] = number

    def taken(self, number: int) -> bool:
        """Whether the e-stop of that number was acted on and published."""
        return int(self._counts[_TAKEN]) >= number
