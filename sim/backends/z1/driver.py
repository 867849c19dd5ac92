"""Drives the arm through `z1_ctrl`: passive, or low-level commands entered from the measured pose with rising gains.

A jump at the switch to low-level commands has blown the arm's fuse for others (z1_sdk issue 7): the first seconds command
the pose measured at the switch, and stiffness rises from zero.
"""

import socket
from dataclasses import dataclass
from ipaddress import IPv4Address

import numpy as np

from sim.backends.protocol import BackendError
from sim.backends.z1.frames import (
    DAMPING_PER_WIRE_UNIT,
    JOINT_COUNT,
    STATE_FRAME,
    STIFFNESS_PER_WIRE_UNIT,
    ArmMode,
    FrameError,
    decode,
    new_command,
)

_MAX_DATAGRAM = 4096


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


@dataclass(frozen=True, slots=True)
class ArmReading:
    """One state of the arm: (6,) each, SI; motor temperatures in degrees Celsius, motor faults as the vendor's bits."""

    mode: ArmMode
    position: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray
    temperature: np.ndarray
    error: np.ndarray
    disconnected: np.ndarray


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
                record = decode(data, STATE_FRAME)
            except FrameError:
                self.bad_frames += 1
                continue
            self.reading = _reading(record)
            self.received += 1
            self.received_s = now
            fresh = True

    def write(
        self,
        now: float,
        position: np.ndarray,
        velocity: np.ndarray,
        stiffness: np.ndarray,
        damping: np.ndarray,
        torque: np.ndarray,
    ) -> None:
        """Send low-level targets, (6,) each in SI, switching z1_ctrl to LOWCMD first.

        Until it reports LOWCMD the pose measured at the switch is sent without stiffness; then stiffness rises.
        """
        reading = self.reading
        if reading is None:
            return
        joint = self._frame["joint"][0]
        if reading.mode != ArmMode.LOWCMD:
            self._entered_s = None
            self._hold = reading.position
            self._frame["mode"] = ArmMode.LOWCMD
            rise = 0.0
        else:
            if self._entered_s is None:
                self._entered_s = now
            self._frame["mode"] = ArmMode.INVALID
            rise = min(1.0, (now - self._entered_s) / self.config.gain_ramp_s)
        joint["position"][:JOINT_COUNT] = position if rise > 0.0 else self._hold
        joint["velocity"][:JOINT_COUNT] = velocity if rise > 0.0 else 0.0
        joint["torque"][:JOINT_COUNT] = rise * torque
        joint["k_p"][:JOINT_COUNT] = rise / STIFFNESS_PER_WIRE_UNIT * stiffness
        joint["k_w"][:JOINT_COUNT] = damping / DAMPING_PER_WIRE_UNIT
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


def _reading(record: np.void) -> ArmReading:
    joint = record["joint"][:JOINT_COUNT]
    motor = joint["motor"]
    return ArmReading(
        ArmMode(int(record["mode"])),
        joint["position"].astype(float),
        joint["velocity"].astype(float),
        joint["torque"].astype(float),
        motor["temperature"].max(axis=1).astype(float),
        (motor["error"][:, 0] | motor["error"][:, 1]) & ~np.uint8(0x40),
        # The upper two bits; the packed C bit field fills a byte from below.
        (motor["connected"] >> 6).max(axis=1) == 1,
    )
