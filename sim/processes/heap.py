"""The C library's heap in processes that run for days."""

import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8  # of glibc's malloc.h
LARGE_BYTES = 128 * 1024
SPARE_BYTES = 1024 * 1024
"""Free at the heap's end that is kept."""


def return_freed_memory() -> None:
    """Give large blocks back to the system once they are freed. Called before the first thread starts.

    By itself glibc keeps a heap for each thread and takes larger and larger blocks from them, and a small one that stays
    behind a large one keeps that in memory: a console grew for hours. Nothing is done where the C library is another.
    """
    if not sys.platform.startswith("linux"):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for option, value in ((_ARENA_MAX, 1), (_MMAP_THRESHOLD, LARGE_BYTES), (_TRIM_THRESHOLD, SPARE_BYTES)):
            mallopt(option, value)
