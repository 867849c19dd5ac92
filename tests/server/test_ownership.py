"""Another package named like ours is refused with the file that shadows and the cure."""

import subprocess
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from control.paths import ROOT
from server.ownership import ShadowedPackageError, check_ownership


def test_our_own_packages_pass() -> None:
    check_ownership(("control",), ROOT, lambda name: ModuleSpec(name, None, origin=str(ROOT / name / "__init__.py")))


@pytest.mark.parametrize("origin", ["/site-packages/control/__init__.py", None])
def test_a_shadowing_package_is_named_with_the_cure(origin: str | None) -> None:
    with pytest.raises(ShadowedPackageError, match=r"python -m venv") as caught:
        check_ownership(("control",), ROOT, lambda name: ModuleSpec(name, None, origin=origin))
    assert str(origin or "nothing") in str(caught.value)


def test_importing_the_server_beside_python_control_fails_at_once(tmp_path: Path) -> None:
    (tmp_path / "control").mkdir()
    (tmp_path / "control" / "__init__.py").write_text("")
    code = f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]; import server"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert result.returncode != 0
    assert "ShadowedPackageError" in result.stderr
    assert str(tmp_path / "control" / "__init__.py") in result.stderr
