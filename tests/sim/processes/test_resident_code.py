"""Libraries' code leaves a process's memory and comes back where it runs."""

import subprocess
import sys

import pytest

_RELEASED = """
from pathlib import Path
import numba
import numpy as np
from sim.processes.resident_code import release_code

def of_files_kb():
    return int(Path("/proc/self/status").read_text().split("RssFile:")[1].split()[0])

law = numba.njit("f8(f8)")(lambda x: 2.0 * x)
before = of_files_kb()
release_code()
after = of_files_kb()
again = numba.njit("f8(f8)")(lambda x: 3.0 * x)
assert law(2.0) == 4.0 and again(2.0) == 6.0 and np.linalg.solve(2.0 * np.eye(3), np.ones(3))[0] == 0.5
print(before, after)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what is mapped")
def test_code_that_has_run_leaves_memory_and_runs_again() -> None:
    told = subprocess.run([sys.executable, "-c", _RELEASED], capture_output=True, text=True, check=True).stdout
    before, after = map(int, told.split())
    assert after < 0.7 * before
