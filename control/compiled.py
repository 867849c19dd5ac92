"""Compiled laws: `kernel` turns a function over plain arrays of one robot into machine code with numba.

A kernel has explicit signatures, so that another memory layout is a TypeError in a test and not a second compilation in
the running loop. Numba keys its cache by the kernel's own file alone: a changed callee in another file would stay stale.
So the cache is one folder per hash of all files that hold kernels.
"""

import hashlib
import logging
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from control.paths import ROOT

_Function = TypeVar("_Function", bound=Callable[..., Any])
_MARK = b"@kernel("
_log = logging.getLogger(__name__)


def kernel_files() -> list[Path]:
    """Files that hold kernels, in order."""
    files = (path for part in ("control", "sim") for path in sorted((ROOT / part).rglob("*.py")))
    return [path for path in files if _MARK in path.read_bytes()]


def source_hash(files: list[Path]) -> str:
    """Hash of the kernels' sources."""
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_directory() -> Path | None:
    """Folder of this version's machine code, created; None where none can be written."""
    base = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    folder = Path(base) / "forcelens" / "kernels" / source_hash(kernel_files())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        _log.warning("compiled kernels cannot be kept (%s): every start compiles them anew; set XDG_CACHE_HOME", error)
        return None


_CACHE = cache_directory()
if _CACHE is not None:
    os.environ["NUMBA_CACHE_DIR"] = str(_CACHE)

import numba  # noqa: E402  (reads NUMBA_CACHE_DIR)

if _CACHE is not None:
    numba.config.CACHE_DIR = str(_CACHE)


def kernel(*signatures: str) -> Callable[[_Function], _Function]:
    """Decorator `@kernel("f8[::1](f8[:,::1], f8[::1])")`: compiled with exactly these numba signatures.

    No fastmath: results repeat bit for bit on one machine. Division by zero gives inf or nan as in numpy.
    """

    def decorate(function: _Function) -> _Function:
        return numba.njit(list(signatures), cache=_CACHE is not None, error_model="numpy")(function)

    return decorate
