"""The arm's frames against the vendor's packed C structures (z1_sdk, message/arm_common.h) and its torque formula."""

import errno
import struct
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from control.timing import TICK_S
from sim.backends.protocol import BackendError
from sim.backends.z1.driver import Z1Config, Z1Driver
from sim.backends.z1.frames import (
    COMMAND_FRAME,
    STATE_FRAME,
    ArmMode,
    FrameError,
    decode,
    new_command,
    new_state,
)
from sim.emulator.arm_controller import ArmController, ArmPorts
from sim.emulator.faults import Faults
from sim.emulator.process import free_udp_port

# SendCmd: head[2], int32 state, bool track, 7 x {T, W, Pos, K_P, K_W}; RecvState: head[2], int32 state,
# 7 x {T, W, Acc, Pos, 2 x {int8 temperature, uint8 error, uint8 connected}}, 6 doubles; both pack(1).
SEND = "<2Bi?" + "5f" * 7
RECV = "<2Bi" + "4f6B" * 7 + "6d"


def test_frames_have_the_vendor_layout() -> None:
    assert (COMMAND_FRAME.itemsize, STATE_FRAME.itemsize) == (struct.calcsize(SEND), struct.calcsize(RECV)) == (147, 208)
    frame = new_command()
    frame["mode"] = ArmMode.LOWCMD
    for index, name in enumerate(("torque", "velocity", "position", "k_p", "k_w")):
        frame["joint"][0][name] = np.arange(7) + 10 * index
    values = struct.unpack(SEND, frame.tobytes())
    assert values[:4] == (0xFE, 0xFF, 16, False)
    assert values[4:9] == (0.0, 10.0, 20.0, 30.0, 40.0) and values[-5:] == (6.0, 16.0, 26.0, 36.0, 46.0)
    state = struct.pack(RECV, 0xFE, 0xFF, 16, *([0.5, 1.5, 2.5, 3.5, 41, 4, 0x40, 0, 0, 0] * 7), *[0.0] * 6)
    record = decode(state, STATE_FRAME)
    joint = record["joint"][6]
    assert [float(joint[name]) for name in ("torque", "velocity", "acceleration", "position")] == [0.5, 1.5, 2.5, 3.5]
    assert joint["motor"][0].tolist() == (41, 4, 0x40)


@pytest.mark.parametrize(
    ("mangle", "says"),
    [
        (lambda b: b[:-1], "207 bytes"),
        (lambda b: b"\0" + b[1:], "starts with 00ff"),
        (lambda b: b[:2] + struct.pack("<i", 17) + b[6:], "mode 17"),
        (lambda b: b[:6] + struct.pack("<f", float("nan")) + b[10:], "not finite"),
    ],
)
def test_unsound_frames_are_refused(mangle: Callable[[bytes], bytes], says: str) -> None:
    with pytest.raises(FrameError, match=says):
        decode(mangle(new_state().tobytes()), STATE_FRAME)


class StillBody:
    """A body that does not move, for an arm controller on its own."""

    time_s = 0.0
    temperature = np.full(22, 30.0)

    class frame:  # noqa: N801
        joint_position = np.linspace(0.0, 2.1, 22)
        joint_velocity = np.zeros(22)
        joint_torque = np.zeros(22)


Arm = tuple[Z1Driver, ArmController, StillBody]


@pytest.fixture
def arm() -> Iterator[Arm]:
    ports = ArmPorts(free_udp_port(), free_udp_port())
    body = StillBody()
    controller = ArmController(ports, body, Faults(), seed=0)  # type: ignore[arg-type]
    driver = Z1Driver(Z1Config("127.0.0.1", ports.command_port, ports.state_port, gain_ramp_s=1.0))
    yield driver, controller, body
    driver.close()
    controller.close()


def obeyed(controller: ArmController) -> np.ndarray:
    """Joint data of the command that the controller obeys, (6,)."""
    assert controller._joint is not None
    return controller._joint


def exchange(driver: Z1Driver, controller: ArmController, body: StillBody, command: np.ndarray) -> None:
    body.time_s += TICK_S
    controller.publish()
    assert driver.poll(body.time_s)
    driver.write(body.time_s, command)
    controller.receive()


def test_low_level_mode_is_entered_without_stiffness_and_then_kept_by_invalid_frames(arm: Arm) -> None:
    driver, controller, body = arm
    command = np.tile([[0.3], [0.0], [25.6], [0.64], [2.0]], 6)
    exchange(driver, controller, body, command)
    assert controller.mode == ArmMode.LOWCMD and not obeyed(controller)["k_p"].any()
    np.testing.assert_allclose(obeyed(controller)["position"], StillBody.frame.joint_position[16:], rtol=1e-6)
    for _ in range(260):
        exchange(driver, controller, body, command)
    assert driver._frame["mode"][0] == ArmMode.INVALID and controller.mode == ArmMode.LOWCMD
    assert 0.4 < obeyed(controller)["k_p"][0] < 0.6  # half way up the ramp, 25.6 N m/rad is one wire unit
    for _ in range(300):
        exchange(driver, controller, body, command)
    joint = obeyed(controller)
    # The vendor's torque formula with wire gains equals the one in SI.
    q, dq = 0.1, -0.2
    vendor = joint["torque"] + 25.6 * joint["k_p"] * (joint["position"] - q) + 0.0128 * joint["k_w"] * (0.0 - dq)
    np.testing.assert_allclose(vendor, 2.0 + 25.6 * (0.3 - q) + 0.64 * 0.2, rtol=1e-5)


def test_damping_is_passive_mode(arm: Arm) -> None:
    driver, controller, body = arm
    exchange(driver, controller, body, np.zeros((5, 6)))
    driver.damp()
    controller.receive()
    assert controller.mode == ArmMode.PASSIVE


def test_a_taken_port_is_named(arm: Arm) -> None:
    driver, _, _ = arm
    with pytest.raises(BackendError, match=f"UDP port {driver.config.state_port}"):
        Z1Driver(driver.config)


@pytest.mark.parametrize("host", ["z1.local", "localhost", "127.0.0.1.example.com", "::1", ""])
def test_the_arm_is_named_by_its_address(host: str) -> None:
    with pytest.raises(ValueError, match="must be an IPv4 address"):
        Z1Config(host)


class DeadNetwork:
    """A socket whose interface has lost its cable."""

    def sendto(self, *_: object) -> int:
        raise OSError(errno.ENETUNREACH, "Network is unreachable")

    recvfrom = sendto


def test_a_network_that_goes_away_is_silence(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    driver, controller, body = arm
    exchange(driver, controller, body, np.zeros((5, 6)))
    heard_s = driver.received_s
    with monkeypatch.context() as dead:
        dead.setattr(driver, "_socket", DeadNetwork())
        for act in (driver.damp, driver.poke, lambda: driver.write(1.0, np.zeros((5, 6)))):
            act()
            assert not driver.poll(1.0)
    assert driver.received_s == heard_s
    exchange(driver, controller, body, np.zeros((5, 6)))
