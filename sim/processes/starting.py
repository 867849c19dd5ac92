"""Ctrl-C and SIGTERM while a command starts: it ends at once, with a plain line, and nothing is left behind.

An exception would not do: an import that catches everything swallows it, any other shows it as a traceback.
"""

import contextlib
import os
import signal
from collections.abc import Iterator
from types import FrameType

from sim.processes.standard_streams import write_or_drop

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Starting:
    """Handles both signals from construction on.

    Args:
        farewell: line to end with.
    """

    def __init__(self, farewell: str) -> None:
        self._farewell = farewell
        self._over = False
        for number in _SIGNALS:
            signal.signal(number, self._handle)

    def over(self) -> None:
        """From now on the first signal raises KeyboardInterrupt, so that all is closed in order; another one ends at once."""
        self._over = True

    def _handle(self, _number: int, _frame: FrameType | None) -> None:
        if self._over:
            self._over = False
            raise KeyboardInterrupt
        children = _children()
        write_or_drop(1, f"{self._farewell}\n".encode())
        for pid in children:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        os._exit(0)  # before a thread of ours can wonder why a child has died


@contextlib.contextmanager
def deaf_children() -> Iterator[None]:
    """What this thread starts meanwhile never hears Ctrl-C, which a terminal sends to all: its parent ends it."""
    from multiprocessing import resource_tracker  # a command's start has no time for it

    resource_tracker.ensure_running()  # starting it would lift the block
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _children() -> list[int]:
    """All children, where Linux lists them; elsewhere they end when their pipes close, as the resource tracker does anyway."""
    pids: list[int] = []
    with contextlib.suppress(OSError):
        for thread in os.listdir("/proc/self/task"):
            with open(f"/proc/self/task/{thread}/children") as children:
                pids += map(int, children.read().split())
    return [pid for pid in pids if not _is_resource_tracker(pid)]


def _is_resource_tracker(pid: int) -> bool:
    with contextlib.suppress(OSError), open(f"/proc/{pid}/cmdline", "rb") as command:
        return b"resource_tracker" in command.read()
    return False
