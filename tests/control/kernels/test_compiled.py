"""Compiled kernels are never stale, and are kept or not, wherever they may be kept: each case in processes of its own."""

import importlib
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from numba.core import config

from control.kernels.compiled import KernelError, kernel
from control.paths import ROOT

COMPILED = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="kernels are plain Python")

INNER = """
    from control.kernels.compiled import kernel
    from laws.constants import FACTOR

    @kernel("f8(f8[::1], i8)")
    def inner(x, i):
        '''Scaled entry.'''
        return FACTOR * x[i]
"""
OUTER = """
    from control.kernels.compiled import kernel
    from laws.inner import inner

    @kernel("f8(f8[::1])")
    def outer(x):
        return 1.0 + inner(x, 0)
"""
ANSWER = """
import sys
import numpy as np
from laws.inner import inner
from laws.outer import outer
x = np.array([2.0, 3.0])
print(outer(x), sum(sum(f.stats.cache_misses.values()) for f in (inner, outer) if hasattr(f, "stats")))
"""
"""Prints the result and how many kernels had to be compiled."""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / "laws"
    folder.mkdir()
    (folder / "__init__.py").touch()
    write(folder, "constants", "FACTOR = 10.0")
    write(folder, "inner", INNER)
    write(folder, "outer", OUTER)
    return folder


def write(package: Path, name: str, text: str) -> None:
    (package / f"{name}.py").write_text(textwrap.dedent(text))


def start(package: Path, script: str = ANSWER, **environment: str) -> subprocess.Popen[str]:
    cache = {"XDG_CACHE_HOME": str(package.parent / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    path = os.pathsep.join((str(package.parent), str(ROOT)))
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    script_file = package.parent / "script.py"
    script_file.write_text(script)
    return subprocess.Popen(
        [sys.executable, str(script_file)],
        env=inherited | {"PYTHONPATH": path} | cache | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(package: Path, script: str = ANSWER, **environment: str) -> str:
    process = start(package, script, **environment)
    output, errors = process.communicate()
    assert process.returncode == 0, errors
    return output.strip()


def test_a_kernel_is_compiled_once_and_again_when_a_callee_or_constant_of_another_file_changes(package: Path) -> None:
    assert run(package) == "21.0 2"
    assert run(package) == "21.0 0"
    write(package, "inner", INNER.replace("FACTOR *", "-FACTOR *"))
    assert run(package) == "-19.0 2"
    write(package, "constants", "FACTOR = 100.0")
    assert run(package) == "-199.0 2"
    write(package, "constants", "FACTOR = 10.0")
    write(package, "inner", INNER)
    assert run(package).split()[0] == "21.0"


def test_a_second_checkout_and_a_moved_line_compile_nothing(package: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    assert run(package) == "21.0 2"
    other = tmp_path_factory.mktemp("other") / "laws"
    shutil.copytree(package, other)
    write(other, "inner", "    # A comment.\n" + INNER)
    assert run(other, XDG_CACHE_HOME=str(package.parent / "cache")) == "21.0 0"


def test_nothing_is_written_beside_the_sources(package: Path) -> None:
    before = sorted(package.rglob("*"))
    run(package)
    assert sorted(package.rglob("*")) == before


def test_without_a_place_to_keep_them_kernels_compile_at_every_start_and_say_so(package: Path) -> None:
    (package.parent / "cache").touch()  # a file, so that no folder can be made in it, whoever tests
    for _ in range(2):
        process = start(package)
        output, errors = process.communicate()
        assert output.strip() == "21.0 2"
        assert "set XDG_CACHE_HOME" in errors


def test_four_processes_at_once_fill_an_empty_cache(package: Path) -> None:
    processes = [start(package) for _ in range(4)]
    for process in processes:
        output, errors = process.communicate()
        assert output.split()[:1] == ["21.0"], errors
    assert run(package) == "21.0 0"


def test_plain_python_and_checked_indices_are_no_machine_code_of_the_product(package: Path) -> None:
    beyond = ANSWER + "\nprint(inner(x, 10**6))"
    assert run(package) == "21.0 2"
    assert run(package, NUMBA_DISABLE_JIT="1") == "21.0 0"
    for setting in ("NUMBA_DISABLE_JIT", "NUMBA_BOUNDSCHECK"):
        process = start(package, beyond, **{setting: "1"})
        _, errors = process.communicate()
        assert "IndexError" in errors, setting


COMPILE_ALL = """
from pathlib import Path
from server.compile_all import compile_all
if __name__ == "__main__":
    compile_all(lambda *state: print(*state), Path(__file__).parent, ("laws",))
"""


def test_all_kernels_compile_ahead_in_the_order_of_their_calls_once(package: Path) -> None:
    assert run(package, COMPILE_ALL).splitlines() == ["0 2 ", "1 2 laws.inner", "2 2 laws.outer"]
    assert run(package) == "21.0 0"
    assert run(package, COMPILE_ALL) == ""
    write(package, "constants", "FACTOR = 100.0")
    assert run(package, COMPILE_ALL).splitlines() == ["0 2 ", "1 2 laws.inner", "2 2 laws.outer"]
    assert run(package) == "201.0 0"


def test_machine_code_that_nothing_loads_any_more_is_removed(package: Path) -> None:
    run(package)
    kernels = package.parent / "cache" / "forcelens" / "kernels"
    current = set(kernels.iterdir())
    old = kernels / "0123456789abcdef"
    old.mkdir()
    for entry in (old, *current):
        os.utime(entry, (0, 0))
    run(package, COMPILE_ALL)
    assert not old.exists()
    assert current < set(kernels.iterdir())


KERNELS_LOADED = """
import sys
import sim.runtime.simulation
modules = [module for name, module in list(sys.modules.items()) if name.startswith(("control.", "sim."))]
kernels = {id(f): f for module in modules for f in vars(module).values() if hasattr(f, "stats") and hasattr(f, "py_func")}
stats = [f.stats for f in kernels.values()]
print(sum(sum(s.cache_misses.values()) for s in stats), sum(bool(s.cache_hits) for s in stats) == len(stats) > 50)
"""
"""Prints how many of the simulation's kernels had to be compiled, and whether all others were loaded."""


@COMPILED
def test_a_later_start_of_the_simulation_compiles_nothing(tmp_path: Path) -> None:
    importlib.import_module("sim.runtime.simulation")
    script = tmp_path / "script.py"
    script.write_text(KERNELS_LOADED)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    answer = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["0", "True"]


@COMPILED
def test_another_layout_is_refused_instead_of_compiled() -> None:
    @kernel("f8(f8[:,::1])")
    def corner(x: np.ndarray) -> float:
        return x[0, 0]

    assert corner(np.ones((2, 2))) == 1.0
    with pytest.raises(TypeError, match="No matching definition"):
        corner(np.asfortranarray(np.ones((2, 2))))


@COMPILED
@pytest.mark.parametrize("captured", [object(), os, lambda: 1.0])
def test_a_kernel_may_read_constants_and_kernels_alone(captured: object) -> None:
    def law(x: float) -> float:
        return captured  # type: ignore[return-value]

    with pytest.raises(KernelError, match=r"law reads 'captured'"):
        kernel("f8(f8)")(law)
