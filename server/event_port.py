"""The control process's end of the pipe: events in, replies out, and nothing that waits for the web process."""

import logging
import select
from collections import deque
from multiprocessing.connection import Connection

from server.messages import Close, Event, Reply

_log = logging.getLogger(__name__)


class EventPort:
    """Single-threaded.

    Attributes:
        closed: the web process has asked for the end, or is gone.
    """

    def __init__(self, pipe: Connection) -> None:
        self.closed = False
        self._pipe = pipe
        self._waiting: deque[Event] = deque()
        self._outbox: deque[Reply] = deque()
        self._writable = select.poll()
        self._writable.register(pipe.fileno(), select.POLLOUT)

    def receive(self) -> Event | None:
        """The oldest event that has not been handed out yet, None when there is none."""
        try:
            while self._pipe.poll():
                message = self._pipe.recv()
                if isinstance(message, Close):
                    self.closed = True
                else:
                    self._waiting.append(message)
        except (EOFError, OSError):
            _log.warning("the web process is gone; ending")
            self.closed = True
            self._waiting.clear()
        return self._waiting.popleft() if self._waiting else None

    def post(self, reply: Reply) -> None:
        """Send a reply with the next `flush`."""
        self._outbox.append(reply)

    def flush(self) -> None:
        """Send what the pipe takes; what it does not, because nobody reads, waits for the next time."""
        try:
            while self._outbox and self._writable.poll(0):
                self._pipe.send(self._outbox.popleft())
        except (BrokenPipeError, ConnectionResetError):
            self.closed = True
