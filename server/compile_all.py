"""All kernels compiled before anything needs them: side by side in several processes, with progress, once per version.

Whoever imports a kernel compiles it if nobody has, one after the other. The console starts with this instead.
"""

import ast
import hashlib
import importlib
import multiprocessing
import os
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from graphlib import TopologicalSorter
from pathlib import Path

from numba.core import config

from control.kernels import compiled
from control.paths import ROOT

PACKAGES = ("control", "sim")
KEPT_S = 30 * 24 * 3600.0
"""Machine code that nothing has loaded for so long is removed."""

_MARK = "\n@kernel("
_COMPLETE = "complete-"


def compile_all(
    progress: Callable[[int, int, str], None],
    root: Path = ROOT,
    packages: tuple[str, ...] = PACKAGES,
    skip: tuple[str, ...] = ("sim.training",),
) -> None:
    """Compile every kernel that is not on disk yet; returns at once where all are, or where nothing can be kept.

    Args:
        progress: told, whenever a file is done, the kernels done so far, how many there are, and the file's module.
        root: folder of the packages, importable from there.
        packages: those that hold kernels.
        skip: packages among them that are left to compile when they are imported.

    Raises:
        Exception: whatever a kernel's compilation raises.
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
    imports = {name: set(_imports(path, sources)) for name, path in sources.items()}
    order = TopologicalSorter({name: _reachable(name, imports) & counts.keys() for name in counts})
    order.prepare()
    running: dict[Future[None], str] = {}
    workers = min(4, max(2, os.cpu_count() or 1))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        while order.is_active():
            # A kernel's callees come first: two processes that need one would both compile it.
            for name in order.get_ready():
                running[pool.submit(_import, name)] = name
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                future.result()
                name = running.pop(future)
                order.done(name)
                done += counts[name]
                progress(done, total, name)
    _remove_old(cache)
    complete.touch()


def _import(name: str) -> None:
    importlib.import_module(name)


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
