"""Memory of code that only the start of a process needed: imports, and the compiler that loads the control laws."""

import ctypes
import logging
from pathlib import Path

_MAPPINGS = Path("/proc/self/smaps")
_DONT_NEED = 4  # of Linux

_log = logging.getLogger(__name__)


def release_code() -> None:
    """Let go of the pages of all libraries' code; those that still run come back from the system's file cache.

    Linux alone; elsewhere, and where memory is locked, they stay.
    """
    if not _MAPPINGS.exists():
        return
    madvise = ctypes.CDLL(None, use_errno=True).madvise
    span = access = path = ""
    for line in _MAPPINGS.read_text(encoding="utf-8", errors="replace").splitlines():
        fields = line.split(maxsplit=5)
        if not fields[0].endswith(":"):
            span, access, path = fields[0], fields[1], fields[-1]
        # What no page of was written has all that is in it in its file.
        elif fields[:2] == ["Anonymous:", "0"] and access == "r-xp" and path.startswith("/"):
            start, end = (int(address, 16) for address in span.split("-"))
            if madvise(ctypes.c_void_p(start), ctypes.c_size_t(end - start), _DONT_NEED) != 0:
                _log.debug("%s stays in memory: error %d", path, ctypes.get_errno())
