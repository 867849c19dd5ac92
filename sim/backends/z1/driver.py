"""Drives the arm through `z1_ctrl`: passive, or low-level commands entered from the measured pose with rising gains.

A jump at the switch to low-level commands has blown the arm's fuse for others (z1_sdk issue 7): the first seconds command
the pose measured at the switch, and stiffness rises from zero.
"""

import socket
from dataclasses import dataclass
from functools import lru_cache
from ipaddress import IPv4Address
from typing import NamedTuple

import numpy as np

from sim.backends.protocol import BackendError
from sim.backends.wire_fields import byte_index
from sim.backends.z1.frames import (
    COMMAND_FRAME,
    DAMPING_PER_WIRE_UNIT,
    JOINT_COUNT,
    MOTOR_STATE,
    STATE_FRAME,
    STIFFNESS_PER_WIRE_UNIT,
    ArmMode,
    FrameError,
    check,
    new_command,
)

_MAX_DATAGRAM = 4096
_JOINTS = byte_index(STATE_FRAME, "joint", ("position", "velocity", "torque"), range(JOINT_COUNT))
_MOTORS = byte_index(STATE_FRAME, "joint", ("motor",), range(JOINT_COUNT))[0]
_TARGETS = byte_index(COMMAND_FRAME, "joint", ("position", "velocity", "k_p", "k_w", "torque"), range(JOINT_COUNT))
_WIRE_UNITS = np.array([1.0, 1.0, STIFFNESS_PER_WIRE_UNIT, DAMPING_PER_WIRE_UNIT, 1.0])[:, None]


@dataclass(frozen=True, slots=True)
class Z1Config:
    """Where `z1_ctrl` is and how gently it is taken over.

    Attributes:
        host: IPv4 address of z1_ctrl; a name would be looked up in every tick. Anything but loopback needs `allow_robot` in
            HardwareConfig.
        command_port: it listens here.
        state_port: it answers here.
        gain_ramp_s: stiffness and feed-forward torque rise over this time after the switch to low-level commands.
    """

    host: str = "127.0.0.1"
    command_port: int = 8071
    state_port: int = 8072
    gain_ramp_s: float = 1.0

    def __post_init__(self) -> None:
        try:
            IPv4Address(self.host)
        except ValueError:
            raise ValueError(f"arm host is {self.host!r}; it must be an IPv4 address, such as 127.0.0.1") from None

    @property
    def is_loopback(self) -> bool:
        """Whether the address can be on this machine only."""
        return IPv4Address(self.host).is_loopback


class ArmMotorsReading(NamedTuple):
    """What changes slowly: (6,) temperatures in degrees Celsius, the `hottest` of them, whether any motor has a fault."""

    temperature: np.ndarray
    hottest: float
    faulty: bool


class ArmReading(NamedTuple):
    """One state of the arm: (3, 6) position in rad, velocity in rad/s, torque in N m; health of the motors."""

    mode: ArmMode
    joints: np.ndarray
    motors: ArmMotorsReading


class Z1Driver:
    """One UDP socket to z1_ctrl. `now` is monotonic seconds in every call."""

    def __init__(self, config: Z1Config) -> None:
        """Raises BackendError when the state port is taken (another client of z1_ctrl is running)."""
        self.config = config
        self._peer = (config.host, config.command_port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        bind_to = "127.0.0.1" if config.is_loopback else ""
        try:
            self._socket.bind((bind_to, config.state_port))
        except OSError as error:
            self._socket.close()
            raise BackendError(
                f"UDP port {config.state_port} of the arm cannot be used ({error.strerror}); end the other client of z1_ctrl"
            ) from error
        self._socket.setblocking(False)
        self._frame = new_command()
        self._frame_bytes = self._frame.view(np.uint8)
        self._entered_s: float | None = None
        self._hold = np.zeros(JOINT_COUNT)
        self.reading: ArmReading | None = None
        self.received_s = -np.inf
        self.received = 0
        self.bad_frames = 0

    def poll(self, now: float) -> bool:
        """Take in what has arrived; True when there is a new state."""
        fresh = False
        while True:
            try:
                data, sender = self._socket.recvfrom(_MAX_DATAGRAM)
            except ConnectionRefusedError:  # a datagram of ours found nobody: the state simply grows old
                continue
            except OSError:  # nothing more has arrived, or the network is gone
                return fresh
            if sender[0] != self._peer[0]:
                continue
            try:
                mode = check(data, STATE_FRAME)
            except FrameError:
                self.bad_frames += 1
                continue
            self.reading = _reading(mode, np.frombuffer(data, np.uint8))
            self.received += 1
            self.received_s = now
            fresh = True

    def write(self, now: float, targets: np.ndarray) -> None:
        """Send position, velocity, stiffness, damping and torque, (5, 6) in SI, switching z1_ctrl to LOWCMD first.

        Until it reports LOWCMD the pose measured at the switch is sent without stiffness; then stiffness rises.
        """
        reading = self.reading
        if reading is None:
            return
        values = targets / _WIRE_UNITS
        if reading.mode != ArmMode.LOWCMD:
            self._entered_s = None
            self._hold = reading.joints[0]
            self._frame["mode"] = ArmMode.LOWCMD
            rise = 0.0
        else:
            if self._entered_s is None:
                self._entered_s = now
            self._frame["mode"] = ArmMode.INVALID
            rise = min(1.0, (now - self._entered_s) / self.config.gain_ramp_s)
        if rise == 0.0:
            values[0], values[1] = self._hold, 0.0
        if rise < 1.0:
            values[2] *= rise
            values[4] *= rise
        self._frame_bytes[_TARGETS] = values.astype("<f4").view(np.uint8)
        self._send()

    def damp(self) -> None:
        """Ask for PASSIVE: z1_ctrl damps the joints itself."""
        self._entered_s = None
        self._frame["mode"] = ArmMode.PASSIVE
        self._frame["joint"] = 0
        self._send()

    def poke(self) -> None:
        """Ask for nothing, so that a z1_ctrl that only answers does answer. Not for a robot that is under control."""
        self._frame["mode"] = ArmMode.INVALID
        self._frame["joint"] = 0
        self._send()

    def close(self) -> None:
        """Close the socket; z1_ctrl keeps its mode."""
        self._socket.close()

    def _send(self) -> None:
        try:
            self._socket.sendto(self._frame.tobytes(), self._peer)
        except OSError:  # nobody listens or the network is gone: the state grows old, the watchdog acts, the base is damped
            return


def _reading(mode: ArmMode, data: np.ndarray) -> ArmReading:
    joints = data[_JOINTS].view("<f4").astype(float)
    return ArmReading(mode, joints, _motors_reading(data[_MOTORS].tobytes()))


@lru_cache(maxsize=4)
def _motors_reading(data: bytes) -> ArmMotorsReading:
    """Of the bytes behind _MOTORS, which stay the same over many states."""
    motor = np.frombuffer(data, MOTOR_STATE).reshape(JOINT_COUNT, 2)
    temperature = motor["temperature"].max(axis=1).astype(float)
    error = (motor["error"][:, 0] | motor["error"][:, 1]) & ~np.uint8(0x40)
    # The upper two bits; the packed C bit field fills a byte from below.
    disconnected = (motor["connected"] >> 6).max(axis=1) == 1
    return ArmMotorsReading(temperature, float(temperature.max()), bool(error.any() or disconnected.any()))
