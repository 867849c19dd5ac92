"""The last gate before the wire: whatever gains and targets a command has, the torque that it causes is within limits.

Predicted torque is tau = k_p (q_d - q) + k_d (dq_d - dq) + tau_ff. What exceeds the limits is taken off the feed-forward,
which leaves the drive's own feedback as it is. Close to a joint limit the torque towards the limit fades to zero.
"""

import numpy as np

from control.joints import JOINT_COUNT, TORQUE_LIMIT
from control.types import JointCommand
from sim.backends.hardware.limits import HardwareLimits

_NAMES = ("position", "velocity", "stiffness", "damping", "torque")
_LARGEST = 1e4
"""No target, gain or torque of this robot is anywhere near; what is larger could overflow on the way to the motor."""


def stack(command: JointCommand) -> np.ndarray:
    """(5, 22) copy: position, velocity, stiffness, damping, torque."""
    parts = (command.position, command.velocity, command.stiffness, command.damping, command.torque)
    return np.concatenate(parts).reshape(5, JOINT_COUNT)


class UnsoundCommandError(ValueError):
    """A command that must not reach a motor: a wrong shape, or a value that is not finite or absurd; the message names it."""


class CommandLimiter:
    """Holds the limits of one robot."""

    def __init__(self, limits: HardwareLimits, position_lower: np.ndarray, position_upper: np.ndarray) -> None:
        """`position_lower` and `position_upper`: (22,) rad, infinite for wheels."""
        self._ends = np.stack((position_lower, position_upper))
        self._barrier = TORQUE_LIMIT / limits.position_margin_rad
        self._least = np.stack((-TORQUE_LIMIT, np.zeros(JOINT_COUNT)))
        self._most = np.stack((np.zeros(JOINT_COUNT), TORQUE_LIMIT))
        self._largest = np.full((5, JOINT_COUNT), _LARGEST)
        self._smallest = -self._largest
        self._smallest[2:4] = 0.0  # gains

    def check(self, command: JointCommand) -> None:
        """Refuse what no clipping can repair.

        Raises:
            UnsoundCommandError: shape, finiteness, an absurd value, or a negative gain.
        """
        for name in _NAMES:
            value = getattr(command, name)
            if not isinstance(value, np.ndarray) or value.shape != (JOINT_COUNT,):
                raise UnsoundCommandError(f"command {name} must have shape ({JOINT_COUNT},), not {np.shape(value)}")
        values = stack(command)
        sound = (values >= self._smallest) & (values <= self._largest)  # NaN is neither
        if np.count_nonzero(sound) == sound.size:
            return
        for name, value in zip(_NAMES, values, strict=True):
            if not np.abs(value).max() <= _LARGEST:
                raise UnsoundCommandError(f"command {name} holds a value that is not finite, or above {_LARGEST:g}")
        raise UnsoundCommandError("command stiffness and damping must not be negative")

    def limit(self, command: JointCommand, joints: np.ndarray) -> tuple[np.ndarray, bool]:
        """The command, stacked, with its predicted torque within limits, and whether it had to be changed.

        Args:
            joints: (3, 22) measured position, velocity and torque.
        """
        targets = stack(command)
        feedback = targets[2:4] * (targets[0:2] - joints[0:2])
        torque = feedback[0] + feedback[1] + targets[4]
        lower, upper = np.minimum(np.maximum(self._barrier * (self._ends - joints[0]), self._least), self._most)
        excess = np.minimum(np.maximum(torque, lower), upper) - torque
        clipped = bool(np.count_nonzero(excess))
        if clipped:
            targets[4] += excess
        return targets, clipped
