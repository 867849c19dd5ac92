"""The arm's `z1_ctrl`: a UDP server with the vendor's state machine, as far as passive, folding and low-level commands go.

An INVALID mode means "no change", and its joint data count while the mode is LOWCMD: a server that reads joints only from
frames whose mode is LOWCMD never moves, because clients send that once.
"""

import socket
from dataclasses import dataclass

import numpy as np

from control.joints import ARM_SLICE
from control.types import JointCommand
from sim.backends.hardware.io.motions import ARM_FOLDED
from sim.backends.protocol import BackendError
from sim.backends.z1.frames import (
    COMMAND_FRAME,
    DAMPING_PER_WIRE_UNIT,
    JOINT_COUNT,
    STIFFNESS_PER_WIRE_UNIT,
    ArmMode,
    FrameError,
    decode,
    new_state,
)
from sim.emulator.faults import Faults, FaultyChannel
from sim.emulator.joint_readings import JointReadings
from sim.emulator.physics import RobotBody, hold

COMMAND_TIMEOUT_S = 0.1
"""Low-level commands that stop are followed by PASSIVE. What the vendor's process does then is unknown."""

PASSIVE_DAMPING = 2.0
RETURN_S = 2.0


@dataclass(frozen=True, slots=True)
class ArmPorts:
    """Where the emulated z1_ctrl listens and where it sends; the vendor's numbers by default."""

    command_port: int = 8071
    state_port: int = 8072


class ArmController:
    """Joints 1-6 of the arm.

    Attributes:
        mode: of the state machine.
        accepted, bad_frames: command frames obeyed and unsound.
    """

    def __init__(self, ports: ArmPorts, body: RobotBody, faults: Faults, seed: int) -> None:
        """Raises BackendError when the port is taken."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("127.0.0.1", ports.command_port))
        except OSError as error:
            self._socket.close()
            raise BackendError(
                f"UDP port {ports.command_port} of the emulated arm cannot be used ({error.strerror}); "
                "end the other emulator or z1_ctrl"
            ) from error
        self._socket.setblocking(False)
        self._client = ("127.0.0.1", ports.state_port)
        self._body = body
        self._faults = faults
        self._incoming = FaultyChannel(faults, seed, checksummed=True)
        self._outgoing = FaultyChannel(faults, seed + 1, checksummed=True)
        self._state = new_state()
        self._joint: np.ndarray | None = None
        self._command_s = -np.inf
        self._return_start = ARM_FOLDED
        self._return_s = -np.inf
        self._joints = JointReadings(body, faults)
        self.mode = ArmMode.PASSIVE
        self.accepted = self.bad_frames = 0

    def receive(self) -> None:
        """Take in command frames."""
        while True:
            try:
                data, _ = self._socket.recvfrom(4096)
            except ConnectionRefusedError:  # nobody read our last state; that is the client's business
                continue
            except OSError:  # nothing more has arrived, or the network is gone
                return
            arrived = None if self._faults.freeze else self._incoming.corrupt(data)
            if arrived is None:
                continue
            try:
                command = decode(arrived, COMMAND_FRAME)
            except FrameError:
                self.bad_frames += 1
                continue
            self._obey(command)

    def drive(self, command: JointCommand) -> None:
        """Fill the arm's part of a command for this physics step, in place."""
        position, velocity = command.position[ARM_SLICE], command.velocity[ARM_SLICE]
        stiffness, damping, torque = command.stiffness[ARM_SLICE], command.damping[ARM_SLICE], command.torque[ARM_SLICE]
        if self.mode == ArmMode.LOWCMD and self._body.time_s - self._command_s > COMMAND_TIMEOUT_S:
            self.mode = ArmMode.PASSIVE
        if self.mode == ArmMode.LOWCMD and self._joint is not None:
            joint = self._joint
            position[:], velocity[:], torque[:] = joint["position"], joint["velocity"], joint["torque"]
            stiffness[:] = STIFFNESS_PER_WIRE_UNIT * joint["k_p"]
            damping[:] = DAMPING_PER_WIRE_UNIT * joint["k_w"]
        elif self.mode == ArmMode.BACKTOSTART:
            program = hold(np.zeros(len(command.position)))
            progress = min(1.0, (self._body.time_s - self._return_s) / RETURN_S)
            position[:] = self._return_start + progress * (ARM_FOLDED - self._return_start)
            velocity[:] = torque[:] = 0.0
            stiffness[:], damping[:] = program.stiffness[ARM_SLICE], program.damping[ARM_SLICE]
        else:
            position[:] = velocity[:] = stiffness[:] = torque[:] = 0.0
            damping[:] = PASSIVE_DAMPING

    def publish(self) -> None:
        """Send the state of this moment."""
        if self._faults.freeze:
            return
        position, velocity, temperature = self._joints.take()
        joint = self._state["joint"][0]
        joint["position"][:JOINT_COUNT] = position[ARM_SLICE]
        joint["velocity"][:JOINT_COUNT] = velocity[ARM_SLICE]
        joint["torque"][:JOINT_COUNT] = self._body.frame.joint_torque[ARM_SLICE]
        joint["motor"]["temperature"][:JOINT_COUNT, 0] = np.minimum(temperature[ARM_SLICE], 127.0)
        self._state["mode"] = self.mode
        message = self._outgoing.corrupt(self._state.tobytes())
        for datagram in self._outgoing.delayed(message, self._body.time_s):
            try:
                self._socket.sendto(datagram, self._client)
            except OSError:  # no client yet, or no network
                return

    def close(self) -> None:
        """Release the port."""
        self._socket.close()

    def _obey(self, command: np.void) -> None:
        now = self._body.time_s
        asked = ArmMode(int(command["mode"]))
        if asked == ArmMode.BACKTOSTART and self.mode != ArmMode.BACKTOSTART:
            self._return_start, self._return_s = self._body.frame.joint_position[ARM_SLICE].copy(), now
        if asked in (ArmMode.PASSIVE, ArmMode.LOWCMD, ArmMode.BACKTOSTART):
            self.mode = asked
        self.accepted += 1
        if self.mode == ArmMode.LOWCMD:
            self._joint, self._command_s = command["joint"][:JOINT_COUNT].copy(), now
