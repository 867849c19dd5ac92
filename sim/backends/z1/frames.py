"""UDP frames between a client and `z1_ctrl`: packed C structures of 147 and 208 bytes (vendor header arm_common.h).

Gains travel in the motors' own units. The vendor's formula for a joint's torque (developer documentation of the Z1) is
    torque = T + 25.6 K_P (Pos - q) + 0.0128 K_W (W - dq),
so stiffness in N m/rad and damping in N m s/rad are divided by those factors on the way out.
"""

import math
from enum import IntEnum

import numpy as np

from sim.backends.wire_fields import byte_index

STIFFNESS_PER_WIRE_UNIT = 25.6
DAMPING_PER_WIRE_UNIT = 0.0128
JOINT_COUNT = 6
WIRE_JOINTS = 7
"""Six joints and the gripper, which this robot does not carry: its entries stay zero."""

HEAD = bytes([0xFE, 0xFF])


class ArmMode(IntEnum):
    """State machine of `z1_ctrl`. A command with INVALID asks for no change; its joint data still count in LOWCMD."""

    INVALID = 0
    PASSIVE = 1
    JOINTCTRL = 2
    CARTESIAN = 3
    MOVEJ = 4
    MOVEL = 5
    MOVEC = 6
    TRAJECTORY = 7
    TOSTATE = 8
    SAVESTATE = 9
    TEACH = 10
    TEACHREPEAT = 11
    CALIBRATION = 12
    SETTRAJ = 13
    BACKTOSTART = 14
    NEXT = 15
    LOWCMD = 16


_JOINT_COMMAND = np.dtype([("torque", "<f4"), ("velocity", "<f4"), ("position", "<f4"), ("k_p", "<f4"), ("k_w", "<f4")])
COMMAND_FRAME = np.dtype([("head", "u1", 2), ("mode", "<i4"), ("track", "u1"), ("joint", _JOINT_COMMAND, WIRE_JOINTS)])
"""147 bytes. The vendor's union also holds a name and a trajectory; LOWCMD uses the joints."""

MOTOR_STATE = np.dtype([("temperature", "i1"), ("error", "u1"), ("connected", "u1")])
_JOINT_STATE = np.dtype(
    [("torque", "<f4"), ("velocity", "<f4"), ("acceleration", "<f4"), ("position", "<f4"), ("motor", MOTOR_STATE, 2)]
)
STATE_FRAME = np.dtype([("head", "u1", 2), ("mode", "<i4"), ("joint", _JOINT_STATE, WIRE_JOINTS), ("posture", "<f8", 6)])
"""208 bytes. Joint 2 has two motors; the others report only the first."""


_NUMBERS = {
    dtype.itemsize: byte_index(dtype, "joint", ("position", "velocity", "torque"), range(WIRE_JOINTS))
    for dtype in (COMMAND_FRAME, STATE_FRAME)
}


class FrameError(ValueError):
    """Bytes that are not a sound arm frame; the message says what is wrong with them."""


def new_command() -> np.ndarray:
    """Zeroed COMMAND_FRAME, shape (1,), with its head."""
    frame = np.zeros(1, COMMAND_FRAME)
    frame["head"] = list(HEAD)
    return frame


def new_state() -> np.ndarray:
    """Zeroed STATE_FRAME, shape (1,), with its head."""
    frame = np.zeros(1, STATE_FRAME)
    frame["head"] = list(HEAD)
    return frame


def decode(data: bytes, dtype: np.dtype) -> np.void:
    """The record of one datagram. Raises as `check`."""
    check(data, dtype)
    return np.frombuffer(data, dtype)[0]


def check(data: bytes, dtype: np.dtype) -> ArmMode:
    """The mode that a sound datagram names.

    Raises:
        FrameError: length, head or mode is wrong, or a joint value is not finite.
    """
    if len(data) != dtype.itemsize:
        raise FrameError(f"arm frame has {len(data)} bytes; it must have {dtype.itemsize}")
    if data[:2] != HEAD:
        raise FrameError(f"arm frame starts with {data[:2].hex()}; it must start with {HEAD.hex()}")
    mode = int.from_bytes(data[2:6], "little", signed=True)
    if not 0 <= mode < len(ArmMode):
        raise FrameError(f"arm frame names mode {mode}; there are 0 to {len(ArmMode) - 1}")
    numbers = np.frombuffer(data, np.uint8)[_NUMBERS[dtype.itemsize]].view("<f4")
    if not math.isfinite(np.add.reduce(numbers, axis=None)):
        raise FrameError("arm frame holds a joint value that is not finite")
    return ArmMode(mode)
