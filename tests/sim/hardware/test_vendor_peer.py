"""A peer on the vendor's DDS version, cyclonedds 0.10, understands us, is understood, and outlives our coming and going.

The robot's own processes run the 0.10 series, where a participant with another idea of the types is not a nuisance but the
death of its peers; the last test shows that. The peer is built here from the vendor's types: vendor_peer/.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from control.paths import ROOT
from sim.backends.unitree.dds import INSTALL_HINT, DdsBaseLink, DdsConfig, DdsRobotLink

pytest.importorskip("cyclonedds", reason=INSTALL_HINT)

from sim.backends.unitree import idl
from sim.backends.unitree.driver import BaseDriver
from sim.backends.unitree.messages import LowCommand, LowState
from sim.backends.unitree.mode_release import ModeRelease
from sim.backends.unitree.motors import SLOT_OF_JOINT, used_slots
from sim.backends.unitree.rpc import MOTION_SWITCHER, RpcResponse

HERE = Path(__file__).parent
SOURCES = HERE / "vendor_peer"
GOLDEN = json.loads((HERE / "golden" / "unitree.json").read_text())
PATIENCE_S = 40.0
CONNECTIONS = 20


def why_not() -> str | None:
    """What is missing here to build the peer."""
    missing = [tool for tool in ("idlc", "gcc") if shutil.which(tool) is None]
    if missing:
        return f"{' and '.join(missing)} missing: apt-get install cyclonedds-dev cyclonedds-tools gcc libc6-dev"
    version = subprocess.run(["idlc", "-v"], capture_output=True, text=True).stdout.strip()
    return None if " 0.10." in version else f"the peer must be of the 0.10 series, not {version}"


WHY_NOT = why_not()
pytestmark = [pytest.mark.hardware, pytest.mark.skipif(WHY_NOT is not None, reason=str(WHY_NOT))]


def wait_for(condition: Callable[[], Any]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.002)


class Peer:
    """The program `peer` in a process of its own."""

    def __init__(self, program: Path, domain: int, role: str) -> None:
        self.process = subprocess.Popen(
            [program, str(domain), role],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"CYCLONEDDS_URI": DdsConfig(domain).xml},
        )

    def heard(self) -> dict[str, Any]:
        assert self.process.stdin is not None and self.process.stdout is not None
        with suppress(BrokenPipeError):
            self.process.stdin.write("\n")
            self.process.stdin.flush()
        line = self.process.stdout.readline()
        assert line, f"the peer has died with {self.process.wait()}"
        return json.loads(line)

    def close(self) -> int:
        """End of its input; returns its exit status."""
        self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with `peer` and the sources that the 0.10 IDL compiler made."""
    folder = tmp_path_factory.mktemp("vendor_peer")
    for source in SOURCES.glob("*.idl"):
        subprocess.run(["idlc", "-o", folder, source], check=True)
    sources = [SOURCES / "peer.c", *folder.glob("*.c")]
    subprocess.run(["gcc", "-O1", "-Wall", "-Werror", "-I", folder, *sources, "-o", folder / "peer", "-lddsc"], check=True)
    return folder


@pytest.fixture
def start(built: Path, domain: int) -> Iterator[Callable[[str], Peer]]:
    peers = []

    def start(role: str) -> Peer:
        peers.append(Peer(built / "peer", domain, role))
        return peers[-1]

    yield start
    for peer in peers:
        peer.process.kill()
        peer.process.communicate()


@pytest.fixture
def drive(domain: int) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start driver_stand_in.py."""
    drivers = []

    def drive(connections: int, *types: Path) -> subprocess.Popen[str]:
        command = [sys.executable, HERE / "driver_stand_in.py", str(domain), str(connections), *types]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        drivers.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment))
        return drivers[-1]

    yield drive
    for driver in drivers:
        driver.kill()
        driver.communicate()


@pytest.mark.parametrize("name", ["LowCmd_", "LowState_", "Request_", "Response_"])
def test_the_peer_is_built_from_the_vendor_types(built: Path, name: str) -> None:
    module = "unitree_go" if name.startswith("Low") else "unitree_api"
    macro = rf"TYPE_INFO_CDR_{module}_msg_dds__{name} \(unsigned char \[\]\)\{{(.*?)\}}"
    found = re.search(macro, (built / f"{module}.c").read_text(), re.DOTALL)
    assert found is not None
    assert "".join(re.findall("0x(..)", found[1])) == GOLDEN["type_info_cpp"][name]


def test_a_robot_on_the_vendor_version(start: Callable[[str], Peer], domain: int) -> None:
    peer = start("robot")
    driver = BaseDriver(DdsBaseLink(DdsConfig(domain)), echo_tick=True)
    wait_for(lambda: driver.poll(0.0))
    reading = driver.reading
    assert reading is not None and driver.bad_samples == 0
    slot = SLOT_OF_JOINT.astype(float)
    np.testing.assert_array_equal(reading.joints, [0.25 * slot, -0.5 * slot, 1.5 * slot])
    np.testing.assert_array_equal(reading.motors.temperature, 30.0 + slot)
    np.testing.assert_array_equal(reading.motors.lost, 100 + SLOT_OF_JOINT)
    np.testing.assert_array_equal(reading.inertial, [0.5, -0.5, 0.5, -0.5, 0.25, 0.5, 0.75, 1.5, -2.5, 9.75])
    assert reading.motors.active and reading.motors.hottest == 45.0 and reading.remote_stop
    assert (reading.battery_percent, reading.battery_v) == (77, 28.5)

    release = ModeRelease(driver.link, 0.0, PATIENCE_S)
    release.LIE_DOWN_S = release.ASK_EVERY_S = 0.0
    started = time.monotonic()

    def released() -> bool:
        release.step(time.monotonic() - started)
        assert release.failure is None
        return release.done

    wait_for(released)
    values = np.linspace(-1.0, 2.0, 16)

    def answered() -> bool:
        driver.write(np.array([values, 2 * values, values**2, 3 * values**2, 4 * values]))
        return peer.heard()["sound"] > 0

    wait_for(answered)
    heard = peer.heard()
    assert heard["unsound"] == 0
    # What lies in the peer's memory as the vendor's structure is what our checksum ran over, byte by byte.
    command = driver._command
    assert heard["command"] == (command.data[LowCommand.c_image].tobytes() + command.data[-4:].tobytes()).hex()
    assert used_slots(command.motor["q"]).tolist() == np.float32(values).tolist()
    driver.close()
    assert peer.close() == 0


def test_a_program_on_the_vendor_version(start: Callable[[str], Peer], domain: int) -> None:
    link = DdsRobotLink(DdsConfig(domain))
    peer = start("program")
    received: list[bytes] = []

    def commanded() -> bool:
        received.extend(link.receive())
        return bool(received)

    wait_for(commanded)
    motor = LowCommand.decode(received[-1]).motor
    slots = np.arange(20)
    for field, factor in (("q", 0.25), ("dq", -0.5), ("tau", 1.5), ("kp", 2.0), ("kd", 0.125)):
        np.testing.assert_array_equal(motor[field], factor * slots)

    state = LowState()

    def served() -> bool:
        link.send(state.encode())
        for call in link.requests():
            assert call.service == MOTION_SWITCHER
            link.respond(RpcResponse(call.service, call.id, call.api_id, 0, '{"form": "0", "name": "ai"}'))
        heard = peer.heard()
        assert heard["unsound"] == 0
        return heard["sound"] > 0 and heard["answer"] == {"form": "0", "name": "ai"}

    wait_for(served)
    link.close()
    assert peer.close() == 0


def test_the_peer_outlives_our_coming_and_going(
    start: Callable[[str], Peer], drive: Callable[..., subprocess.Popen[str]], domain: int
) -> None:
    peer = start("robot")
    visitor = drive(CONNECTIONS)
    watchdog = threading.Timer(PATIENCE_S, visitor.kill)
    watchdog.start()
    assert visitor.stdout is not None
    lines = [visitor.stdout.readline().strip() for _ in range(CONNECTIONS + 1)]
    watchdog.cancel()
    assert lines == [*map(str, range(1, CONNECTIONS + 1)), "staying"]
    visitor.kill()
    last = BaseDriver(DdsBaseLink(DdsConfig(domain)))
    before = peer.heard()["sound"]

    def heard() -> bool:
        last.write(np.zeros((5, 16)))
        return last.poll(0.0) and peer.heard()["sound"] > before

    wait_for(heard)
    last.close()
    assert peer.close() == 0


def test_one_word_in_the_types_kills_the_peer(
    start: Callable[[str], Peer], drive: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    """Why every unsigned byte is declared `byte`, and why this file can fail."""
    wrong = tmp_path / "idl.py"
    wrong.write_text(re.sub(r"\bbyte\b", "uint8", Path(idl.__file__).read_text()))
    peer = start("robot")
    peer.heard()
    drive(1, wrong)
    wait_for(lambda: peer.process.poll() is not None)
    assert peer.process.returncode == -signal.SIGSEGV
