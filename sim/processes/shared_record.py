"""One numpy record in memory shared by two processes: one writer, any number of readers, newest value wins, nobody waits.

A seqlock: the writer makes the counter odd, copies the record, stores its checksum and makes the counter even again.
A reader copies and accepts the copy if the counter was even and unchanged and the checksum fits. The counter alone
suffices where stores become visible in order (x86); the checksum makes it hold on processors that reorder them.

`allocate` makes memory for a process and its spawned children. Any other mapping of `size_of` bytes will do.
"""

import time
import zlib
from typing import Any

import numpy as np

from sim.processes.anonymous_memory import AnonymousMemory

_HEADER = np.dtype([("counter", "u8"), ("checksum", "u4"), ("padding", "u4")])


def size_of(dtype: np.dtype) -> int:
    """Bytes of memory that one record needs."""
    return _HEADER.itemsize + dtype.itemsize


def allocate(dtype: np.dtype) -> AnonymousMemory:
    """Zeroed memory for one record, to be given to `SharedRecord` here and, as a process argument, in a spawned child."""
    return AnonymousMemory(size_of(dtype))


class SharedRecord:
    """View of the shared memory in one process.

    Args:
        memory: from `allocate`, or another writable buffer of `size_of(dtype)` bytes, aligned to 8.
        dtype: of the record; the same in every process.
    """

    def __init__(self, memory: Any, dtype: np.dtype) -> None:
        view = np.frombuffer(memory, dtype=np.uint8)
        self.dtype = dtype
        self._header = view[: _HEADER.itemsize].view(_HEADER)
        self._body = view[_HEADER.itemsize :]
        self._seen = 0

    def write(self, record: np.ndarray) -> None:
        """Publish `record`, shape (1,). Only one process, and one thread of it, may write."""
        header = self._header[0]
        odd = int(header["counter"]) | 1  # also repairs the counter of a writer that was killed half-way
        data = record.view(np.uint8)
        header["counter"] = odd
        self._body[:] = data
        header["checksum"] = zlib.crc32(data.data)
        header["counter"] = odd + 1

    def read(self, attempts: int = 200) -> np.ndarray | None:
        """A consistent copy, shape (1,). Any thread may read.

        Returns:
            None when nothing has been written yet, or when no attempt met the writer at rest (it died half-way, or the
            reader has a higher priority on the same core: then take the last value).
        """
        header = self._header[0]
        for attempt in range(attempts):
            before = int(header["counter"])
            if before == 0:
                return None
            if not before & 1:
                data = self._body.copy()
                checksum = int(header["checksum"])
                if int(header["counter"]) == before and zlib.crc32(data.data) == checksum:
                    return data.view(self.dtype)
            if attempt > 3:
                time.sleep(5e-5)
        return None

    def read_new(self, attempts: int = 200) -> np.ndarray | None:
        """Like `read`, for one thread; None as well when nothing was written since its last call."""
        counter = int(self._header[0]["counter"])
        if counter == self._seen:
            return None
        newest = self.read(attempts)
        if newest is not None:
            self._seen = counter  # what was written meanwhile is read again
        return newest
