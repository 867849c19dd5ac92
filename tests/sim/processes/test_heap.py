"""What a process has freed goes back to the system, whichever thread took it and whatever stays beside it."""

import subprocess
import sys

import pytest

GROWN = """
import threading
from sim.processes.heap import return_freed_memory
if {limited}:
    return_freed_memory()
def resident_mb():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6
kept = []
def work():
    for size in range(200_000, 2_000_000, 20_000):
        large = bytearray(size)
        kept.append(bytearray(1000))
        del large
        between = [bytearray(size) for _ in range(4)]
        kept.append(bytearray(1000))
        del between
work()
kept.clear()
before = resident_mb()
for _ in range(8):
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
print(resident_mb() - before)
"""


def grown_mb(*, limited: bool) -> float:
    """Of a process whose threads take, keep little and free much."""
    words = [sys.executable, "-c", GROWN.format(limited=limited)]
    return float(subprocess.run(words, capture_output=True, text=True, check=True, timeout=60).stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="another C library")
def test_freed_memory_goes_back_to_the_system() -> None:
    assert grown_mb(limited=True) < 3.0
