"""A ring of numpy records in memory shared by two processes: one writer never waits, one reader learns what it missed."""

from typing import Any, NamedTuple

import numpy as np

_RESERVE = 8
"""Slots before the writer that a reader leaves alone: they may be overwritten while it copies."""

_TAKEN = 2**64 - 1
"""Index of a slot that is being written."""

_HEAD_BYTES = 64
_INDEX_BYTES = 8


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
        slot = _slot(dtype)
        end = _HEAD_BYTES + slots * slot.itemsize
        # The writer's view: plain bytes and words cost a fraction of what fields of an array do.
        self._bytes = memoryview(memory).cast("B")[:end]
        self._words = self._bytes.cast("Q")
        self._record_bytes = dtype.itemsize
        self._slot_bytes = slot.itemsize
        self._count = slots
        records = np.frombuffer(self._bytes[_HEAD_BYTES:], slot)
        self._indices, self._bodies = records["index"], records["body"]

    @staticmethod
    def size_of(dtype: np.dtype, slots: int) -> int:
        """Bytes of memory."""
        return _HEAD_BYTES + slots * _slot(dtype).itemsize

    @property
    def head(self) -> int:
        """Index of the next record."""
        return self._words[0]

    def put(self, record: memoryview | bytes) -> None:
        """Append a record, given as its bytes. Only one thread of one process may."""
        words = self._words
        head = words[0]
        start = _HEAD_BYTES + head % self._count * self._slot_bytes
        index, start = start // 8, start + _INDEX_BYTES
        words[index] = _TAKEN
        self._bytes[start : start + self._record_bytes] = record
        words[index] = head
        words[0] = head + 1

    def take(self, tail: int, most: int) -> Batch:
        """Copies of at most `most` records from index `tail` on, or from the oldest that is left."""
        head = self.head
        first = max(tail, head - self._count + _RESERVE)
        count = min(head - first, most)
        if count <= 0:
            return Batch(tail, self._bodies[:0].copy(), 0)
        slots = np.arange(first, first + count) % self._count
        records = self._bodies[slots]
        # What was overwritten meanwhile is at the old end.
        torn = int((self._indices[slots] != np.arange(first, first + count, dtype=np.uint64)).sum())
        return Batch(first + torn, records[torn:], first + torn - tail)


def bytes_of(record: np.ndarray) -> memoryview:
    """Of an array of one record; they follow its changes."""
    return record.view(np.uint8).data


def _slot(dtype: np.dtype) -> np.dtype:
    padding = -(_INDEX_BYTES + dtype.itemsize) % 8
    return np.dtype([("index", "u8"), ("body", dtype), ("padding", f"V{padding}")])
