"""A command whose output goes nowhere works on, and ends as if it had been written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from control.paths import ROOT

CODE = """
import logging, os, sys
from sim.processes.standard_streams import protect_standard_streams
protect_standard_streams()
logging.basicConfig(level=logging.INFO)
for _ in range(2000):
    print("x" * 100)
    print("\\udc80", file=sys.stderr)
    logging.info("y" * 100)
    sys.stderr.write("z" * 10_000)
assert os.open(os.devnull, os.O_RDONLY) > 2
os.kill(os.getppid(), 0)
os.write(int(sys.argv[1]), b"done")
"""


def finish(redirection: str) -> None:
    """Run the code in a shell that redirects its output."""
    ours, theirs = os.pipe()
    command = f'"{sys.executable}" -c "$0" {theirs} {redirection}'
    process = subprocess.Popen(
        ["bash", "-c", f"set -o pipefail; {command}", CODE],
        cwd=ROOT,
        pass_fds=(theirs,),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(theirs)
    assert process.wait(60.0) == 0, redirection
    assert os.read(ours, 4) == b"done"
    os.close(ours)


@pytest.mark.parametrize(
    "redirection",
    [">/dev/full", "2>/dev/full", ">/dev/full 2>&1", ">&-", "2>&-", ">&- 2>&- <&-", "| true", "2>&1 | true", "2>&1 | sleep 3"],
)
def test_nothing_written_ends_nothing(redirection: str) -> None:
    finish(redirection)


def test_what_can_be_written_is(tmp_path: Path) -> None:
    finish(f">{tmp_path / 'out'} 2>{tmp_path / 'err'}")
    assert (tmp_path / "out").read_text() == 2000 * ("x" * 100 + "\n")
    assert "\\udc80" in (tmp_path / "err").read_text()
