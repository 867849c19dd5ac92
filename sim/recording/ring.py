"""A ring of numpy records in memory shared by two processes: one writer never waits, one reader learns what it missed."""

from typing import Any, NamedTuple

import numpy as np

_RESERVE = 8
"""Slots before the writer that a reader leaves alone: they may be overwritten while it copies."""

_TAKEN = np.uint64(2**64 - 1)
"""Index of a slot that is being written."""


class Batch(NamedTuple):
    """What a reader got: records of consecutive indices from `first`, before which `missed` were overwritten unread."""

    first: int
    records: np.ndarray
    missed: int


class Ring:
    """View of the shared memory in one process.

    Args:
        memory: writable buffer of `size_of(dtype, slots)` bytes, aligned to 8, zeroed before its first use.
        dtype: of the records.
        slots: how many the ring holds.
    """

    def __init__(self, memory: Any, dtype: np.dtype, slots: int) -> None:
        view = np.frombuffer(memory, np.uint8)
        self._slot = _slot(dtype)
        self._head = view[:8].view(np.uint64)
        self._slots = view[64 : 64 + slots * self._slot.itemsize].view(self._slot)
        self._indices = self._slots["index"]
        self._bodies = self._slots["body"]

    @staticmethod
    def size_of(dtype: np.dtype, slots: int) -> int:
        """Bytes of memory."""
        return 64 + slots * _slot(dtype).itemsize

    @property
    def head(self) -> int:
        """Index of the next record."""
        return int(self._head[0])

    def put(self, record: np.ndarray | np.void) -> None:
        """Append a record. Only one thread of one process may."""
        head = int(self._head[0])
        slot = head % len(self._slots)
        self._indices[slot] = _TAKEN
        self._bodies[slot] = record
        self._indices[slot] = head
        self._head[0] = head + 1

    def take(self, tail: int, most: int) -> Batch:
        """Copies of at most `most` records from index `tail` on, or from the oldest that is left."""
        head = self.head
        first = max(tail, head - len(self._slots) + _RESERVE)
        count = min(head - first, most)
        if count <= 0:
            return Batch(tail, self._bodies[:0].copy(), 0)
        slots = np.arange(first, first + count) % len(self._slots)
        records = self._bodies[slots]
        # What was overwritten meanwhile is at the old end.
        torn = int((self._indices[slots] != np.arange(first, first + count, dtype=np.uint64)).sum())
        return Batch(first + torn, records[torn:], first + torn - tail)


def _slot(dtype: np.dtype) -> np.dtype:
    padding = -(8 + dtype.itemsize) % 8
    return np.dtype([("index", "u8"), ("body", dtype), ("padding", f"V{padding}")])
