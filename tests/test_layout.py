"""The parts import each other in one direction only, and control/ would run on a robot without a simulator."""

import ast
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from control.paths import ROOT

ORDER = ("control", "sim", "web", "server")
MOST_FILES = 16
"""Python files in one folder of control/ and sim/: more is a list, not a layout."""
FOREIGN = {"control": {"mujoco", "viser", "fastapi", "uvicorn"}, "sim": {"viser", "fastapi", "uvicorn"}, "web": {"fastapi"}}


def imported_roots(path: Path) -> set[str]:
    roots = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            roots |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            roots.add(node.module.split(".")[0])
    return roots


@pytest.mark.parametrize("part", ORDER)
def test_nothing_imports_against_the_one_direction(part: str) -> None:
    forbidden = set(ORDER[ORDER.index(part) + 1 :]) | FOREIGN.get(part, set())
    for path in (ROOT / part).rglob("*.py"):
        assert not imported_roots(path) & forbidden, path


def imported_modules(path: Path) -> set[str]:
    """Our own modules that a file imports, by dotted name."""
    modules = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            modules |= {name if source_of(name) else node.module for name in names}
    return {module for module in modules if module.split(".")[0] in ORDER and source_of(module)}


def source_of(module: str) -> Path | None:
    path = ROOT / module.replace(".", "/")
    return next((file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file()), None)


def sources() -> Iterator[Path]:
    for part in ORDER:
        yield from (ROOT / part).rglob("*.py")


def test_nothing_imports_a_benchmark_but_benchmarks() -> None:
    benchmarks = ROOT / "sim" / "benchmarks"
    for path in sources():
        if benchmarks not in path.parents:
            assert not {name for name in imported_modules(path) if name.startswith("sim.benchmarks")}, path


def test_no_import_closes_a_circle() -> None:
    arrows = {path: {source_of(name) for name in imported_modules(path)} - {path, None} for path in sources()}
    done: set[Path] = set()

    def walk(path: Path, way: tuple[Path, ...]) -> None:
        assert path not in way, " -> ".join(str(step.relative_to(ROOT)) for step in (*way[way.index(path) :], path))
        if path not in done:
            for target in arrows[path]:
                assert target is not None
                walk(target, (*way, path))
            done.add(path)

    for path in arrows:
        walk(path, ())


def test_no_folder_is_crowded() -> None:
    folders = {path.parent for part in ("control", "sim") for path in (ROOT / part).rglob("*.py")} - {
        ROOT / "sim" / "benchmarks"
    }
    crowded = {
        str(folder.relative_to(ROOT)): count for folder in folders if (count := len([*folder.glob("*.py")])) > MOST_FILES
    }
    assert not crowded


def test_one_file_knows_how_deep_it_lies() -> None:
    # server/__init__.py checks whose `control` this is before anything may import it.
    allowed = {ROOT / "control" / "paths.py", ROOT / "server" / "__init__.py", ROOT / "tests" / "test_layout.py"}
    files = [*sources(), *(ROOT / "tests").rglob("*.py")]
    assert not [path for path in files if ".parents[" in path.read_text() and path not in allowed]


def test_every_folder_of_tests_is_a_package() -> None:
    # Fixtures of package scope end with their folder, and helpers are found by one name wherever pytest starts.
    folders = {path.parent for path in (ROOT / "tests").rglob("*.py")}
    assert not [folder for folder in folders if not (folder / "__init__.py").is_file()]


def test_the_pipeline_loads_without_a_simulator() -> None:
    code = "import sys, control.pipeline; assert not {'mujoco', 'viser', 'fastapi', 'torch'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_a_recorder_holds_neither_compiler_nor_simulator() -> None:
    code = "import sys, sim.recording.recorder; assert not {'numba', 'mujoco', 'pinocchio'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_files_stay_small() -> None:
    long = [str(p) for part in ORDER for p in (ROOT / part).rglob("*.py") if len(p.read_text().splitlines()) > 450]
    assert not long


def test_an_installed_copy_has_every_data_file() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    declared = {path for part, globs in settings["package-data"].items() for glob in globs for path in (ROOT / part).glob(glob)}
    needed = {
        path
        for part in (*ORDER, "assets")
        for path in (ROOT / part).rglob("*")
        if path.is_file() and path.suffix not in {".py", ".pyc", ".md"} and path.parent.name != "screenshots"
    }
    assert needed - declared == set()
