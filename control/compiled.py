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

import numpy as np

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


_NAMES = vars(numba.types) | {
    "vector": numba.types.Array(numba.types.float64, 1, "A", readonly=True),
    "matrix": numba.types.Array(numba.types.float64, 2, "A", readonly=True),
}


def kernel(*signatures: str, **records: np.dtype) -> Callable[[_Function], _Function]:
    """Decorator `@kernel("f8[::1](f8[:,::1], Gains[::1])", Gains=GAINS)`: compiled with exactly these numba signatures.

    No fastmath: results repeat bit for bit on one machine. Division by zero gives inf or nan as in numpy.

    Args:
        signatures: in numba's words, with `vector` and `matrix` for arrays of float64 of any layout that are only read.
        records: layout (control.records) of each record that a signature names.
    """
    names = _NAMES | {name: numba.from_dtype(layout) for name, layout in records.items()}
    types = [eval(signature, {}, names) for signature in signatures]

    def decorate(function: _Function) -> _Function:
        return numba.njit(types, cache=_CACHE is not None, error_model="numpy")(function)

    return decorate
