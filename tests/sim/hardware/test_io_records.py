"""Shared memory between control and I/O process, and the single-writer lock."""

import os
import shutil
import socket
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from control.paths import ROOT
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.io.loop import HEALTH_EVERY, IoLoop
from sim.backends.hardware.limits import HardwareLimits
from sim.backends.hardware.mailbox import Answer, Mailbox, Order, ask, mailbox_name
from sim.backends.hardware.records import IO_COMMAND, IO_STATE, IoMemory, memory_path
from sim.backends.hardware.states import DriveState, Request, Trip
from sim.backends.hardware.status import HardwareStatus, status_from_record
from sim.backends.protocol import BackendError
from sim.backends.unitree.dds import DdsConfig, RobotNetworkError
from sim.backends.z1.driver import Z1Config
from tests.sim.hardware.hardware_rig import Rig


def test_a_record_arrives_whole_or_not_at_all(tmp_path: Path) -> None:
    writer, reader = IoMemory(tmp_path / "memory", create=True), IoMemory(tmp_path / "memory")
    assert reader.state.read() is None
    record = np.zeros(1, IO_STATE)
    record["sequence"], record["message"] = 7, b"seven"
    writer.state.write(record)
    seen = reader.state.read()
    assert seen is not None and seen["sequence"][0] == 7 and seen["message"][0] == b"seven"
    writer.state._header[0]["counter"] += 1  # a writer killed half-way
    assert reader.state.read() is None
    writer.state.write(record)
    assert reader.state.read() is not None
    writer.state._body[3] ^= 1  # a torn copy
    assert reader.state.read() is None


def test_memory_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / "memory").write_bytes(b"old")
    with pytest.raises(BackendError, match="another version"):
        IoMemory(tmp_path / "memory")
    with pytest.raises(BackendError, match="open the hardware backend first"):
        IoMemory(tmp_path / "missing")


def test_a_missed_record_repeats_no_request(rig: Rig, tmp_path: Path) -> None:
    memory = IoMemory(tmp_path / "memory", create=True)
    loop = IoLoop(rig.config, rig.robot, rig.supervisor, memory)
    record = np.zeros(1, IO_COMMAND)
    record["request"], record["request_sequence"], record["alive_s"] = Request.ENGAGE, 1, rig.now
    memory.command.write(record)
    for tick in range(20):
        rig.emulator.step()
        if tick % 2:
            memory.command._header[0]["counter"] |= 1  # caught writing
        else:
            memory.command.write(record)
        loop.tick(rig.now)
    assert rig.supervisor.engaging and rig.supervisor.message == ""


def test_what_was_never_heard_is_unknown_not_zero(rig: Rig, tmp_path: Path) -> None:
    memory = IoMemory(tmp_path / "memory", create=True)
    loop = IoLoop(rig.config, rig.robot, rig.supervisor, memory)

    def status() -> HardwareStatus:
        record = memory.state.read()
        assert record is not None
        return status_from_record(record[0], rig.now)

    loop.tick(rig.now)
    silent = status()
    assert silent.battery_percent is None and np.isnan(silent.battery_v) and np.isinf(silent.base_age_s)
    for motor in silent.motors:
        assert np.isnan([motor.temperature_c, motor.torque_nm]).all() and motor.lost is None
    for _ in range(HEALTH_EVERY):
        rig.emulator.step()
        loop.tick(rig.now)
    heard = status()
    assert heard.battery_percent in (79, 80)
    assert [motor.lost for motor in heard.motors] == [0] * 16 + [None] * 6
    assert all(np.isfinite([motor.temperature_c, motor.torque_nm]).all() for motor in heard.motors)


def test_the_estop_byte_is_taken_once(rig: Rig, tmp_path: Path) -> None:
    memory, anybody = IoMemory(tmp_path / "memory", create=True), IoMemory(tmp_path / "memory")
    loop = IoLoop(rig.config, rig.robot, rig.supervisor, memory)
    rig.emulator.step()
    loop.tick(rig.now)
    anybody.estop = True
    loop.tick(rig.now)
    state = anybody.state.read()
    assert state is not None and state["state"][0] == DriveState.FAULT and state["faults"][0] == Trip.ESTOP
    assert not anybody.estop and rig.wire.log == []  # not ours yet, so nothing is sent even now


@pytest.fixture
def name() -> str:
    """Of a mailbox of this test alone."""
    return f"forcelens-test-{os.getpid()}"


def hold(name: str, **environment: str) -> subprocess.Popen[bytes]:
    """A process that holds a mailbox and answers nothing."""
    code = "from sim.backends.hardware.mailbox import Mailbox; import sys, time\n"
    code += f"mailbox = Mailbox({name!r}); sys.stdout.write('held'); sys.stdout.flush(); time.sleep(60)"
    holder = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, env=os.environ | environment)
    assert holder.stdout is not None and holder.stdout.read(4) == b"held"
    return holder


def test_the_lock_is_exclusive_whatever_tmpdir_says_and_dies_with_its_holder(name: str, tmp_path: Path) -> None:
    with hold(name, TMPDIR=str(tmp_path)) as holder:
        with pytest.raises(BackendError, match=f"process {holder.pid} already commands"):
            Mailbox(name)
        holder.kill()
    Mailbox(name).close()


def test_orders_are_taken_and_answered(name: str) -> None:
    assert ask(name, Order.REPORT) is None
    mailbox = Mailbox(name)
    with ThreadPoolExecutor(1) as pool:
        asking = pool.submit(ask, name, Order.ESTOP, 20.0)
        while not (orders := mailbox.take()):
            pass
        assert [order for order, _ in orders] == [Order.ESTOP]
        mailbox.answer(orders[0][1], Answer(DriveState.FAULT, True))
        assert asking.result() == Answer(DriveState.FAULT, True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(b"nonsense", f"\0{name}")
        stranger.sendto(b"e" * 5000, f"\0{name}")
    assert mailbox.take() == []
    mailbox.close()


@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("setpriv") is None, reason="needs root to be two users")
def test_a_stranger_gives_no_orders_and_no_answers_and_his_lock_holds_too(name: str) -> None:
    stranger = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", "/usr/bin/env", "python3", "-c"]
    send = f"import socket; socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM).sendto(b'estop', '\\0{name}')"
    mailbox = Mailbox(name)
    subprocess.run([*stranger, send], check=True)
    assert mailbox.take() == []
    mailbox.close()
    answer = f"import socket, sys; s = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM); s.bind('\\0{name}')\n"
    answer += (
        "print('held', flush=True); sender = s.recvfrom(16)[1]; s.sendto(bytes([7, 1]), sender); print('sent', flush=True)"
    )
    with subprocess.Popen([*stranger, answer], stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == b"held\n"
        with pytest.raises(BackendError, match="already commands"):
            Mailbox(name)
        assert ask(name, Order.REPORT, 20.0) is None
        assert holder.stdout.readline() == b"sent\n"


def test_memory_lies_in_a_folder_of_this_user_alone(tmp_path: Path) -> None:
    folder = tmp_path / "forcelens"
    memory = IoMemory(folder / "memory", create=True)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert memory.has_name
    (folder / "memory").unlink()
    assert not memory.has_name
    folder.chmod(0o755)
    with pytest.raises(BackendError, match="open to others"):
        IoMemory(folder / "memory", create=True)


def test_links_that_others_planted_are_not_followed(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.mkdir(0o700)
    (tmp_path / "link").symlink_to(victim)
    with pytest.raises(BackendError, match="no folder of this user"):
        IoMemory(tmp_path / "link" / "memory", create=True)
    (victim / "file").write_text("precious")
    folder = tmp_path / "forcelens"
    folder.mkdir(0o700)
    (folder / "memory").symlink_to(victim / "file")
    with pytest.raises(BackendError, match="cannot be opened"):
        IoMemory(folder / "memory")
    IoMemory(folder / "memory", create=True)
    assert not (folder / "memory").is_symlink()
    assert (victim / "file").read_text() == "precious"


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to be two users")
def test_a_folder_of_another_user_is_refused(tmp_path: Path) -> None:
    (tmp_path / "forcelens").mkdir(0o700)
    os.chown(tmp_path / "forcelens", 65534, 65534)
    with pytest.raises(BackendError, match="belongs to user 65534"):
        IoMemory(tmp_path / "forcelens" / "memory", create=True)


def test_configuration_survives_the_command_line() -> None:
    config = HardwareConfig(
        DdsConfig(0, "eth1", allow_robot=True), Z1Config("192.168.123.220"), HardwareLimits(tilt_damp_rad=0.9), dry_run=False
    )
    assert HardwareConfig.from_json(config.to_json()) == config
    assert memory_path(config) != memory_path(HardwareConfig())
    assert mailbox_name(config) != mailbox_name(HardwareConfig())
    assert str(os.getuid()) in memory_path(config).parent.name


def test_a_dry_run_is_the_default_and_a_remote_arm_needs_consent() -> None:
    assert HardwareConfig().dry_run
    with pytest.raises(RobotNetworkError, match="arm"):
        HardwareConfig(arm=Z1Config("192.168.123.220"))
