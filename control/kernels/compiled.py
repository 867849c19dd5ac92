"""Compiled laws: `kernel` turns a function over plain arrays of one robot into machine code with numba.

A kernel has explicit signatures, so that another memory layout is a TypeError in a test and not a second compilation in
the running loop. It is compiled when its file is imported and kept on disk. Numba would key what it keeps by path and content
of the kernel's own file: a changed callee or constant of another file would stay stale, and a second checkout would compile
all anew. So every kernel has a folder of its own, named after the hash of its code, of every constant that it reads, of the
kernels that it calls, and of numba, numpy and the processor; nothing else is asked.

Environment: NUMBA_DISABLE_JIT=1 runs the kernels as plain Python, NUMBA_BOUNDSCHECK=1 checks their indices.
"""

import hashlib
import logging
import os
import platform
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, TypeVar

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numba.core import config

_Function = TypeVar("_Function", bound=Callable[..., Any])
_log = logging.getLogger(__name__)


class KernelError(TypeError):
    """A kernel reads what is neither a constant nor a kernel; the message names both."""


def cache_directory() -> Path | None:
    """Folder of the machine code of all kernels, created; None where none can be written."""
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
        folder = base / "forcelens" / "kernels"
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError) as error:  # RuntimeError: no home
        _log.warning("compiled kernels cannot be kept (%s): every start compiles them anew; set XDG_CACHE_HOME", error)
        return None


def toolchain() -> str:
    """What machine code depends on besides its source: versions, processor, numba's settings."""
    settings = sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))
    versions = (platform.python_version(), numba.__version__, llvmlite.__version__, np.__version__)
    features = llvmlite.binding.get_host_cpu_features().flatten()
    return repr((versions, platform.machine(), llvmlite.binding.get_host_cpu_name(), features, settings))


CACHE = cache_directory()
_TOOLCHAIN = toolchain()
_digests: dict[Callable[..., Any], str] = {}

_NAMES = vars(numba.types) | {
    "vector": numba.types.Array(numba.types.float64, 1, "A", readonly=True),
    "matrix": numba.types.Array(numba.types.float64, 2, "A", readonly=True),
}


def kernel(*signatures: str, **records: np.dtype) -> Callable[[_Function], _Function]:
    """Decorator `@kernel("f8[::1](f8[:,::1], Gains[::1])", Gains=GAINS)`: compiled with exactly these numba signatures.

    No fastmath: results repeat bit for bit on one machine. Division by zero gives inf or nan as in numpy. Constants and
    arrays of the module are compiled in.

    Args:
        signatures: in numba's words, with `vector` and `matrix` for arrays of float64 of any layout that are only read.
        records: layout (control.kernels.records) of each record that a signature names.

    Raises:
        KernelError: the function reads what is neither a constant nor a kernel.
    """

    def decorate(function: _Function) -> _Function:
        if config.DISABLE_JIT:
            return function
        digest = hashlib.sha256(_TOOLCHAIN.encode())
        for part in _parts(function):
            digest.update(part)
        _digests[function] = digest.hexdigest()[:32]
        names = _NAMES | {name: numba.from_dtype(layout) for name, layout in records.items()}
        types = [eval(signature, {}, names) for signature in signatures]
        with _folders_of_their_own():
            compiled: Any = numba.njit(types, cache=CACHE is not None, error_model="numpy")(function)
        return compiled

    return decorate


class KernelFolder:
    """Numba's "cache locator" of one kernel: the folder is named after all that decides its machine code."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.ensure_cache_path()
        os.utime(folder)  # in use: server.compile_all removes what is not

    @classmethod
    def from_function(cls, function: Callable[..., Any], _file: str) -> "KernelFolder":
        """Called by numba."""
        assert CACHE is not None
        return cls(CACHE / _digests[function])

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        self._folder.mkdir(exist_ok=True)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Nothing: the folder's name tells."""
        return ""

    def get_disambiguator(self) -> str:
        """Nothing: the folder's name tells."""
        return ""


@contextmanager
def _folders_of_their_own() -> Iterator[None]:
    """What is compiled meanwhile is kept in KernelFolder, and other packages' functions where numba keeps them."""
    before = config.CACHE_LOCATOR_CLASSES
    config.CACHE_LOCATOR_CLASSES = f"{__name__}.{KernelFolder.__name__}"
    try:
        yield
    finally:
        config.CACHE_LOCATOR_CLASSES = before


def _parts(function: Callable[..., Any]) -> Iterator[bytes]:
    """All that decides what a function computes."""
    names: set[str] = set()
    for code in _codes(function.__code__):
        names |= set(code.co_names)
        constants = [value for value in code.co_consts if not isinstance(value, CodeType)]
        yield repr((code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars)).encode()
    captured = {name: function.__globals__[name] for name in names if name in function.__globals__}
    closure = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    captured |= {name: cell.cell_contents for name, cell in closure}
    yield repr(function.__defaults__).encode()
    for name, value in sorted(captured.items()):
        yield name.encode()
        yield _constant(value, f"kernel {function.__module__}.{function.__qualname__} reads {name!r}")


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for value in code.co_consts:
        if isinstance(value, CodeType):
            yield from _codes(value)


def _constant(value: object, where: str) -> bytes:
    """What a captured object contributes."""
    callee: Any = getattr(value, "py_func", None)
    if callee in _digests:
        return _digests[callee].encode()
    if isinstance(value, ModuleType):
        if value.__name__ not in ("math", "numpy", "numba"):
            raise KernelError(f"{where}, a module; import the constants themselves, so that a change of theirs is seen")
        return value.__name__.encode()
    if isinstance(value, np.ndarray):
        return repr((value.dtype, value.shape)).encode() + value.tobytes()
    text = repr(value)
    if " at 0x" in text:
        raise KernelError(f"{where}, which is neither a constant nor a kernel: {text}")
    return text.encode()
