"""At most one program of this machine commands one robot: a lock that the system drops when its holder dies."""

import fcntl
import os
from pathlib import Path

from sim.backends.protocol import BackendError


class WriterLock:
    """Held from construction to `close` or the end of the process.

    Raises:
        BackendError: another process holds it; the message names that process.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except PermissionError:
            raise BackendError(
                f"lock {path} belongs to another user who has commanded this robot; agree, then delete it"
            ) from None
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(self._descriptor, 32).decode(errors="replace").strip() or "unknown"
            os.close(self._descriptor)
            raise BackendError(
                f"process {holder} already commands this robot (lock {path}); end it, or attach to it instead"
            ) from None
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, f"{os.getpid()}\n".encode(), 0)

    def close(self) -> None:
        """Give the lock back."""
        os.close(self._descriptor)
