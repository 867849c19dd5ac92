"""Ctrl-C while a command starts, whatever is under way then."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from control.paths import ROOT

SWALLOWS = """
import subprocess, sys, time
from sim.processes.starting import Starting
starting = Starting("farewell")
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"])
print(child.pid, flush=True)
while True:
    try:
        time.sleep(3600)
    except BaseException:
        pass
"""
OVER = """
import time
from sim.processes.starting import Starting
starting = Starting("farewell")
starting.over()
try:
    print(0, flush=True)
    time.sleep(3600)
except KeyboardInterrupt:
    print("in order", flush=True)
    time.sleep(3600)
"""
DEAF = """
import subprocess, sys
from sim.processes.starting import deaf_children
with deaf_children():
    child = subprocess.Popen([sys.executable, "-c", "import signal; print(signal.pthread_sigmask(signal.SIG_BLOCK, ()))"])
child.wait()
import signal
print(signal.pthread_sigmask(signal.SIG_BLOCK, ()), flush=True)
"""


def start(code: str) -> "subprocess.Popen[str]":
    return subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_swallows_every_exception_does_not_hold_it_up_and_children_go_along(number: signal.Signals) -> None:
    process = start(SWALLOWS)
    assert process.stdout is not None
    child = Path("/proc") / process.stdout.readline().strip()
    assert child.exists()
    process.send_signal(number)
    output, errors = process.communicate(timeout=60.0)
    assert (process.returncode, output, errors) == (0, "farewell\n", "")
    deadline = time.monotonic() + 10.0
    while child.exists() and "Z" not in (child / "stat").read_text().rsplit(")", 1)[1].split()[0]:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_once_started_the_first_closes_in_order_and_the_second_ends() -> None:
    process = start(OVER)
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "in order\n"
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60.0)
    assert (process.returncode, output, errors) == (0, "farewell\n", "")


def test_children_that_are_deaf_do_not_hear_the_terminal() -> None:
    output, _ = start(DEAF).communicate(timeout=60.0)
    assert "SIGINT" in output.splitlines()[0]
    assert output.splitlines()[1] == "set()"
