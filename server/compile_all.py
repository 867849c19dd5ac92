"""All kernels compiled before anything needs them: side by side in several processes, with progress, once per version.

Whoever imports a kernel compiles it if nobody has, one after the other. The console starts with this instead.
"""

import ast
import hashlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from graphlib import TopologicalSorter
from pathlib import Path
from queue import SimpleQueue

from numba.core import config

from control.kernels import compiled
from control.paths import ROOT

PACKAGES = ("control", "sim")
KEPT_S = 30 * 24 * 3600.0
"""Machine code that nothing has loaded for so long is removed."""

_WORKER = """import importlib, sys
sys.path[:] = sys.argv[1:]
for line in sys.stdin:
    importlib.import_module(line.strip())
    sys.stdout.write("done\\n")
    sys.stdout.flush()
"""
_MARK = "\n@kernel("
_COMPLETE = "complete-"


class CompilationError(RuntimeError):
    """A kernel cannot be compiled; the message names its file's module."""


def compile_all(
    progress: Callable[[int, int, str], None],
    root: Path = ROOT,
    packages: tuple[str, ...] = PACKAGES,
    skip: tuple[str, ...] = ("sim.training",),
) -> None:
    """Compile every kernel that is not on disk yet; returns at once where all are, or where nothing can be kept.

    Args:
        progress: told at first, and whenever a file is done, how many kernels are, how many there are, and the file's module.
        root: folder of the packages, importable from there.
        packages: those that hold kernels.
        skip: packages among them that are left to compile when they are imported.

    Raises:
        CompilationError: a kernel cannot be compiled.
    """
    cache = compiled.CACHE
    if cache is None or config.DISABLE_JIT:
        return
    files = [path for package in packages for path in sorted((root / package).rglob("*.py"))]
    complete = cache / f"{_COMPLETE}{_version(files)}"
    if complete.exists():
        complete.touch()
        return
    sources = {".".join(path.relative_to(root).with_suffix("").parts): path for path in files}
    counts = {name: path.read_text().count(_MARK) for name, path in sources.items() if not name.startswith(skip)}
    counts = {name: count for name, count in counts.items() if count}
    done, total = 0, sum(counts.values())
    progress(done, total, "")
    imports = {name: set(_imports(path, sources)) for name, path in sources.items()}
    order = TopologicalSorter({name: _reachable(name, imports) & counts.keys() for name in counts})
    order.prepare()
    running: dict[Future[None], str] = {}
    workers = min(4, max(2, os.cpu_count() or 1))
    with ThreadPoolExecutor(workers) as pool, ExitStack() as stack:
        idle: SimpleQueue[_Worker] = SimpleQueue()
        for _ in range(workers):
            idle.put(stack.enter_context(_Worker()))
        while order.is_active():
            # A kernel's callees come first: two processes that need one would both compile it.
            for name in order.get_ready():
                running[pool.submit(_compile, idle, name)] = name
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                future.result()
                name = running.pop(future)
                order.done(name)
                done += counts[name]
                progress(done, total, name)
    _remove_old(cache)
    complete.touch()


class _Worker:
    """A process that imports; it ends with its context, or when this process does.

    None of a pool's: those outlive a parent that ends in a hurry, and leave semaphores behind.
    """

    def __enter__(self) -> "_Worker":
        self._process = subprocess.Popen(
            [sys.executable, "-c", _WORKER, *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is not for it
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def compile(self, name: str) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(f"{name}\n")
        self._process.stdin.flush()
        if not self._process.stdout.readline():
            raise CompilationError(f"the kernels of {name} cannot be compiled; its traceback is above")


def _compile(idle: "SimpleQueue[_Worker]", name: str) -> None:
    worker = idle.get()
    try:
        worker.compile(name)
    finally:
        idle.put(worker)


def _version(files: list[Path]) -> str:
    """Hash of all sources and of what else machine code depends on."""
    digest = hashlib.sha256(compiled.toolchain().encode())
    for path in files:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:32]


def _imports(path: Path, sources: dict[str, Path]) -> Iterator[str]:
    """Modules of ours that a file imports."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        yield from (name for name in names if name in sources)


def _reachable(name: str, imports: dict[str, set[str]]) -> set[str]:
    """All that importing a module imports."""
    found: set[str] = set()
    ahead = [name]
    while ahead:
        new = imports[ahead.pop()] - found
        found |= new
        ahead += new
    return found - {name}


def _remove_old(cache: Path) -> None:
    oldest = time.time() - KEPT_S
    for entry in cache.iterdir():
        try:
            if entry.stat().st_mtime < oldest:
                shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        except FileNotFoundError:
            continue  # another process removes it too
