"""The start of the commands under odd but permitted circumstances."""

import argparse
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import httpx
import pytest

from control.paths import ROOT
from server.command_line import parser
from server.listening import listen
from sim.emulator.command_line import parser as emulator_parser
from tests.processes import runs, tree

PATIENCE_S = 60.0
MOMENTS = 6
NO_TEMPORARY_FOLDERS = """
import multiprocessing.heap, tempfile
tempfile._candidate_tempdir_list = lambda: []
multiprocessing.heap.Arena._dir_candidates = []
"""

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")


def start(*arguments: str, **options: object) -> "subprocess.Popen[str]":
    environment = {name: value for name, value in os.environ.items() if name != "FORCELENS_TOKEN"}
    environment |= options.pop("env", {})  # type: ignore[arg-type]
    return subprocess.Popen(  # type: ignore[call-overload]
        [sys.executable, "-m", "server", *arguments],
        cwd=ROOT,
        env=environment,
        text=True,
        start_new_session=True,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options},
    )


def eventually(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def listens_to_sigterm(pid: int) -> bool:
    """Whether Python has come to the command's own code: it leaves SIGTERM alone by itself."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    caught = next(int(line.split()[1], 16) for line in lines if line.startswith("SigCgt"))
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def answers(port: int) -> bool:
    with suppress(httpx.TransportError):
        return httpx.get(f"http://127.0.0.1:{port}/api/v1/health", timeout=PATIENCE_S).json().get("status") == "ok"
    return False


@linux
@pytest.mark.realtime
@pytest.mark.parametrize(
    "command", [["--no-browser", "--port", "0"], ["emulate", "--domain", "77"]], ids=["console", "emulate"]
)
def test_ctrl_c_at_any_moment_of_the_start_ends_it_plainly_with_all_its_processes(command: list[str]) -> None:
    if command[0] == "emulate":
        pytest.importorskip("cyclonedds")
    duration_s = time_to_start(command)
    for moment in range(MOMENTS):
        process = start(*command)
        eventually(lambda pid=process.pid: listens_to_sigterm(pid))
        time.sleep(moment / MOMENTS * duration_s)
        started = tree(process.pid)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        output, errors = process.communicate(timeout=PATIENCE_S)
        said = output + errors
        assert process.returncode == 0, said
        assert "Forcelens has stopped" in said or "interrupted" in said
        assert "Traceback" not in said and "KeyboardInterrupt" not in said, said
        eventually(lambda started=started: not any(map(runs, started)))


def time_to_start(command: list[str]) -> float:
    """From the first line of the command's own code to where it works."""
    process = start(*command)
    eventually(lambda: listens_to_sigterm(process.pid))
    begun = time.monotonic()
    stream = process.stderr if command[0] == "emulate" else process.stdout
    assert stream is not None
    assert any("Forcelens is at" in line or "robot on DDS" in line for line in stream)
    duration_s = time.monotonic() - begun
    process.terminate()
    process.communicate(timeout=PATIENCE_S)
    return duration_s


@pytest.mark.parametrize("make", [parser, emulator_parser])
def test_every_port_and_domain_is_refused_by_its_range(
    make: Callable[[], argparse.ArgumentParser], capsys: pytest.CaptureFixture[str]
) -> None:
    options = [option for action in make()._actions for option in action.option_strings if option.endswith(("port", "domain"))]
    assert "--arm-port" in options
    for option in options:
        highest = {"--port": 65535, "--arm-port": 65534, "--domain": 230}[option]
        make().parse_args([option, str(highest)])
        for value in ("-1", str(highest + 1), "99999999999999999999", "8080.5", "http", ""):
            with pytest.raises(SystemExit, match="2"):
                make().parse_args([f"{option}={value}"])
            assert f"to {highest}" in capsys.readouterr().err


def outlives(redirection: str) -> None:
    """A console whose output goes there serves on, and ends when it is told."""
    port = free_port()
    command = f'exec "{sys.executable}" -m server --no-browser --port {port} {redirection}'
    shell = subprocess.Popen(["bash", "-c", command], cwd=ROOT, start_new_session=True)
    try:
        eventually(lambda: answers(port))
        http = httpx.Client(base_url=f"http://127.0.0.1:{port}/api/v1/", timeout=PATIENCE_S)
        http.put("scene", json={"name": "box"}).raise_for_status()  # is logged
        http.post("control/restart", json={"force": True}).raise_for_status()
        assert answers(port), redirection
        os.killpg(shell.pid, signal.SIGINT)
        assert shell.wait(PATIENCE_S) in (0, 128 + signal.SIGINT, -signal.SIGINT), redirection
        eventually(lambda: not answers(port))
    finally:
        with suppress(ProcessLookupError):
            os.killpg(shell.pid, signal.SIGKILL)


@linux
def test_a_log_that_cannot_be_written_ends_nothing() -> None:
    redirections = (">/dev/full 2>&1", "2>&1 | true", ">&- 2>&-")
    with ThreadPoolExecutor(len(redirections)) as pool:
        assert len(list(pool.map(outlives, redirections))) == len(redirections)


@linux
def test_a_command_that_is_refused_leaves_no_process_behind(tmp_path: Path) -> None:
    process = start("--no-browser", "--port", "0", "--token-file", str(tmp_path / "missing"))
    seen: set[int] = set()
    while process.poll() is None:
        seen |= tree(process.pid)
        time.sleep(0.005)
    assert process.communicate()[1].count("\n") == 1 and process.returncode == 2
    assert len(seen) > 1, "the control process is spawned ahead"
    eventually(lambda: not any(map(runs, seen)))


@linux
def test_without_a_folder_for_temporary_files_it_starts(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(NO_TEMPORARY_FOLDERS)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    process = start("--no-browser", "--port", "0", env={"PYTHONPATH": path})
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("Forcelens is at"), line + process.communicate()[1]
        assert answers(int(line.rstrip("/\n").rsplit(":", 1)[1]))
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


@pytest.mark.parametrize("host", ["::", "0::0"])
@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="no IPv6 that takes IPv4 along")
def test_every_address_means_ipv4_too(host: str) -> None:
    with listen(host, 0) as listener:
        for address in ("127.0.0.1", "::1"):
            socket.create_connection((address, listener.getsockname()[1]), timeout=PATIENCE_S).close()


def test_where_ipv6_takes_no_ipv4_along_it_is_said(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(socket, "has_dualstack_ipv6", lambda: False)
    try:
        listen("::", 0).close()
    except OSError:
        pytest.skip("no IPv6")
    assert "--host 0.0.0.0" in caplog.text
