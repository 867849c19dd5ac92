"""Files appear complete or not at all."""

import ast
import errno
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from control.files import replacing, write_whole
from control.paths import ROOT

FULL = """
import resource, signal, sys
from pathlib import Path
from control.files import write_whole
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    write_whole(Path(sys.argv[1]), 5000 * "x")
except OSError:
    sys.exit(7)
"""


def test_a_file_and_its_folders_are_written(tmp_path: Path) -> None:
    write_whole(tmp_path / "a" / "b" / "file.json", "ä")
    write_whole(tmp_path / "a" / "b" / "file.json", b"\x00")
    assert (tmp_path / "a" / "b" / "file.json").read_bytes() == b"\x00"
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] == ["file.json"]


def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "file.npz").write_text("old")
    with pytest.raises(ValueError, match="half-way"), replacing(tmp_path / "file.npz") as partial:
        assert partial.suffix == ".npz"  # numpy would append it
        partial.write_text("ne")
        raise ValueError("half-way")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_a_disk_that_turns_out_full_when_all_is_written_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (tmp_path / "file").write_text("old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_whole(tmp_path / "file", "new")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="no limit on files")
def test_a_file_that_does_not_fit_leaves_the_old_one(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    process = subprocess.run([sys.executable, "-c", FULL, str(tmp_path / "file")], cwd=ROOT, check=False)
    assert process.returncode == 7
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


@pytest.mark.parametrize("part", ["control", "sim", "web", "server"])
def test_no_result_is_written_in_any_other_way(part: str) -> None:
    writers = {"write_text", "write_bytes", "savez", "savez_compressed", "save_npz"}
    for path in (ROOT / part).rglob("*.py"):
        # The second packs into memory.
        if path in (ROOT / "control" / "files.py", ROOT / "control" / "state" / "file.py"):
            continue
        tree = ast.parse(path.read_text())
        guarded = {
            id(inner)
            for node in ast.walk(tree)
            if isinstance(node, ast.With) and any("replacing(" in ast.unparse(item) for item in node.items)
            for inner in ast.walk(node)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and id(node) not in guarded:
                name = ast.unparse(node.func)
                assert name.rpartition(".")[2] not in writers and name not in ("torch.save", "json.dump", "np.save"), (
                    f"{path}:{node.lineno} writes without control.files"
                )
