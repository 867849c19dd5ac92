"""The parts import each other in one direction only, and control/ would run on a robot without a simulator."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ORDER = ("control", "sim", "web", "server")
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


def test_the_pipeline_loads_without_a_simulator() -> None:
    code = "import sys, control.pipeline; assert not {'mujoco', 'viser', 'fastapi', 'torch'} & set(sys.modules)"
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
        if path.is_file() and path.suffix not in {".py", ".pyc"} and path.parent.name != "screenshots"
    }
    assert needed - declared == set()
