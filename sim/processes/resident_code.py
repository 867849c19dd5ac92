"""Memory of code that only the start of a process needed: imports, and the compiler that loads the control laws."""

import ctypes
import logging
from pathlib import Path

_MAPPINGS = Path("/proc/self/maps")
_DONT_NEED = 4  # of Linux

_log = logging.getLogger(__name__)


def release_code() -> None:
    """Let go of the pages of all libraries' code; those that still run come back from the system's file cache.

    Linux alone; elsewhere, and where memory is locked, they stay.
    """
    if not _MAPPINGS.exists():
        return
    madvise = ctypes.CDLL(None, use_errno=True).madvise
    for line in _MAPPINGS.read_text(encoding="utf-8").splitlines():
        span, access, *_, path = line.split(maxsplit=5) if line.count("/") else (line, "", "")
        if access != "r-xp" or not path.startswith("/"):  # never written to, so that the file has all that is in it
            continue
        start, end = (int(address, 16) for address in span.split("-"))
        if madvise(ctypes.c_void_p(start), ctypes.c_size_t(end - start), _DONT_NEED) != 0:
            _log.debug("%s stays in memory: error %d", path, ctypes.get_errno())
