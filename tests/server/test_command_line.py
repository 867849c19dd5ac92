"""The command as people type it."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from control.paths import ROOT
from tests.processes import children, runs


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "server", "--no-browser", *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={name: value for name, value in os.environ.items() if name != "FORCELENS_TOKEN"},
    )


@pytest.fixture
def occupied() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener.getsockname()[1]


def test_it_prints_its_address_serves_and_takes_its_processes_along() -> None:
    process = start("--port", "0", "--scene", "free")
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:\d+/", line)
        assert found, line + process.communicate()[1]
        assert httpx.get(found[0], timeout=60.0).status_code == 200
        assert httpx.get(f"{found[0]}api/v1/health", timeout=60.0).json()["status"] == "ok"
        started = [child.pid for child in children(process.pid)]
        assert started
        maps = [Path(f"/proc/{pid}/maps").read_text() for pid in (process.pid, *started)]
        assert any("libmujoco" in each for each in maps)
        assert not any("glfw" in each for each in maps), "a window library was loaded"
        process.send_signal(signal.SIGTERM)
        assert process.wait(60.0) == 0
        # multiprocessing's own resource tracker ends only once its pipe has closed, a moment after its parent.
        deadline = time.monotonic() + 10.0
        while any(map(runs, started)) and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not [pid for pid in started if runs(pid)]
    finally:
        process.kill()


def test_the_token_of_a_file_opens_the_printed_address_and_shows_nowhere_else(tmp_path: Path) -> None:
    token = "ab+cd/ef=="
    file = tmp_path / "token"
    file.write_text(token + "\n")
    process = start("--port", "0", "--token-file", str(file))
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        assert httpx.get(address.partition("?")[0], timeout=60.0).status_code == 401
        assert httpx.get(address, timeout=60.0).status_code == 200
        listed = subprocess.run(["ps", "-ww", "-A", "-o", "args="], capture_output=True, text=True, check=True).stdout
        assert "--token-file" in listed
        assert token not in listed
    finally:
        process.kill()
        process.communicate()


def test_a_port_in_use_is_said_plainly(occupied: int) -> None:
    _, errors = start("--port", str(occupied)).communicate(timeout=60.0)
    assert f"port {occupied}" in errors
    assert "--port" in errors
    assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--host", "0.0.0.0"), "--token"),
        (("--scene", "moon"), "moon"),
        (("--token", ""), "too short"),
        (("--token-file", "/nowhere/token"), "/nowhere/token"),
    ],
)
def test_a_start_that_cannot_work_ends_with_one_line_that_says_why(arguments: tuple[str, ...], said: str) -> None:
    process = start("--port", "0", *arguments)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 2
    last = errors.strip().splitlines()[-1]
    assert last.startswith("forcelens: ")
    assert said in last
