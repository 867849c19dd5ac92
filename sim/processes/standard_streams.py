"""Standard output and error that never stop a program: what a full disk or a vanished reader does not take is dropped."""

import io
import os
import select
import sys
from typing import Any


def protect_standard_streams() -> None:
    """Replace both streams of this process, which its parent may also have closed."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # Or else whatever is opened next would get this number, and every print would go there.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdout, sys.stderr = _lossy(1, sys.stdout), _lossy(2, sys.stderr)


def write_or_drop(descriptor: int, data: Any) -> None:
    """Write bytes as far as they are taken without waiting."""
    left = memoryview(data).cast("B")
    writable = select.poll()
    writable.register(descriptor, select.POLLOUT)
    try:
        while left and writable.poll(0):
            # A pipe that is ready takes so much at once.
            left = left[os.write(descriptor, left[: select.PIPE_BUF]) :]
    except OSError:
        return


class _LossyFile(io.FileIO):
    def write(self, data: Any, /) -> int:
        write_or_drop(self.fileno(), data)
        return memoryview(data).nbytes


def _lossy(descriptor: int, replaced: Any) -> io.TextIOWrapper:
    encoding = "utf-8" if replaced is None else replaced.encoding
    file = io.BufferedWriter(_LossyFile(descriptor, "w", closefd=False))
    return io.TextIOWrapper(file, encoding=encoding, errors="backslashreplace", line_buffering=True)
