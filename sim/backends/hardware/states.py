"""States of the robot's drives, what may be asked of them, and reasons to damp."""

from enum import IntEnum, IntFlag

import numpy as np

from control.joints import JOINT_NAMES


class DriveState(IntEnum):
    """DISCONNECTED -> OBSERVE -> DAMPED -> STANDING_UP -> READY -> POLICY -> SITTING -> DAMPED; FAULT from anywhere.

    In DISCONNECTED and OBSERVE nothing is published. READY holds the stance; POLICY obeys the control process. FAULT damps
    and stays until it is cleared at rest.
    """

    DISCONNECTED = 0
    OBSERVE = 1
    DAMPED = 2
    STANDING_UP = 3
    READY = 4
    POLICY = 5
    SITTING = 6
    FAULT = 7


ACTIVE = frozenset({DriveState.STANDING_UP, DriveState.READY, DriveState.POLICY, DriveState.SITTING})
"""States in which the motors carry stiffness."""


class Request(IntEnum):
    """What an operator asks for. Anything else than NONE is done at most once per sequence number."""

    NONE = 0
    ENGAGE = 1
    STAND = 2
    START = 3
    HOLD = 4
    SIT = 5
    DAMP = 6
    RELEASE = 7
    CLEAR = 8


ALLOWED_FROM: dict[Request, frozenset[DriveState]] = {
    Request.ENGAGE: frozenset({DriveState.OBSERVE}),
    Request.STAND: frozenset({DriveState.DAMPED}),
    Request.START: frozenset({DriveState.READY}),
    Request.HOLD: frozenset({DriveState.POLICY}),
    Request.SIT: frozenset({DriveState.STANDING_UP, DriveState.READY, DriveState.POLICY}),
    Request.DAMP: ACTIVE | {DriveState.DAMPED},
    Request.RELEASE: frozenset({DriveState.DAMPED}),
    Request.CLEAR: frozenset({DriveState.FAULT}),
}
"""START and HOLD switch between the held stance and the controller; RELEASE stops publishing."""


REQUEST_NAMES = tuple(request.name.lower() for request in Request if request != Request.NONE)


def allowed_requests(state: DriveState) -> list[str]:
    """Names, in lower case, of what may be asked for in `state`."""
    return [request.name.lower() for request, states in ALLOWED_FROM.items() if state in states]


class Trip(IntFlag):
    """Reasons to damp (`faults`) or to warn (`warnings`)."""

    NONE = 0
    STALE_STATE = 1 << 0
    STALE_ARM = 1 << 1
    STALE_COMMAND = 1 << 2
    STALE_OPERATOR = 1 << 3
    TILT = 1 << 4
    NOT_FINITE = 1 << 5
    JOINT_LIMIT = 1 << 6
    JOINT_VELOCITY = 1 << 7
    TORQUE = 1 << 8
    TEMPERATURE = 1 << 9
    BATTERY = 1 << 10
    FOREIGN_WRITER = 1 << 11
    MOTOR = 1 << 12
    ARM = 1 << 13
    ESTOP = 1 << 14
    REMOTE_STOP = 1 << 15
    SIGNAL = 1 << 16
    INTERNAL = 1 << 17
    RESTARTED = 1 << 18
    STAND_UP = 1 << 19
    STUCK_ENCODER = 1 << 20
    TORQUE_CLIPPED = 1 << 21


TRIP_TEXT: dict[Trip, str] = {
    Trip.STALE_STATE: "no state from the base",
    Trip.STALE_ARM: "no state from the arm",
    Trip.STALE_COMMAND: "the control process is silent",
    Trip.STALE_OPERATOR: "the console's web process is silent",
    Trip.TILT: "the base is tilted",
    Trip.NOT_FINITE: "a value is not finite",
    Trip.JOINT_LIMIT: "a joint is beyond its limit",
    Trip.JOINT_VELOCITY: "a joint is too fast",
    Trip.TORQUE: "a motor is at its torque limit",
    Trip.TEMPERATURE: "a motor is hot",
    Trip.BATTERY: "the battery is low",
    Trip.FOREIGN_WRITER: "another program commands the motors",
    Trip.MOTOR: "a motor of the base is not in servo mode",
    Trip.ARM: "the arm reports a motor fault or left low-level mode",
    Trip.ESTOP: "e-stop",
    Trip.REMOTE_STOP: "L2 and B on the remote control",
    Trip.SIGNAL: "the I/O process was told to end",
    Trip.INTERNAL: "the I/O process met an error of its own; its log names it",
    Trip.RESTARTED: "the robot has restarted and its own program owns the motors; engage it again",
    Trip.STAND_UP: "the stance was not reached",
    Trip.STUCK_ENCODER: "an encoder does not move with its motor",
    Trip.TORQUE_CLIPPED: "predicted torque was clipped",
}


_OF_JOINTS = Trip.NOT_FINITE | Trip.JOINT_LIMIT | Trip.JOINT_VELOCITY | Trip.TORQUE | Trip.TEMPERATURE | Trip.STUCK_ENCODER


def joint_bits(joints: np.ndarray) -> int:
    """The joints (22,) bool as a number: bit i is joint i."""
    return sum(1 << int(joint) for joint in np.flatnonzero(joints))


def describe(trips: Trip, joints: int = 0) -> list[str]:
    """One text per bit; where it is of joints, with the names of `joints` (see `joint_bits`)."""
    names = ", ".join(name for joint, name in enumerate(JOINT_NAMES) if joints >> joint & 1)
    return [f"{text}: {names}" if names and trip in _OF_JOINTS else text for trip, text in TRIP_TEXT.items() if trip in trips]
