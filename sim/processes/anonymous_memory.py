"""Memory that a process shares with its spawned children: without a name, in no folder, and gone with the last of them."""

import mmap
import os
import tempfile
import weakref
from multiprocessing import reduction
from typing import Any


class AnonymousMemory(mmap.mmap):
    """A writable buffer, zeroed. It is handed to a spawned child as an argument of its process.

    A killed process leaves nothing behind, no resource tracker may unlink it early, and it needs no folder for temporary files.
    """

    _descriptor: int

    def __new__(cls, size: int, descriptor: int | None = None) -> "AnonymousMemory":
        if descriptor is None:
            descriptor = _new_file()
            os.ftruncate(descriptor, size)
        memory = super().__new__(cls, descriptor, size)
        memory._descriptor = descriptor
        weakref.finalize(memory, os.close, descriptor)
        return memory

    def __reduce__(self) -> Any:
        return _received, (len(self), reduction.DupFd(self._descriptor))


def _received(size: int, descriptor: Any) -> AnonymousMemory:
    return AnonymousMemory(size, descriptor.detach())


def _new_file() -> int:
    if hasattr(os, "memfd_create"):
        return os.memfd_create("forcelens")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())
