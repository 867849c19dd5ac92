"""The last gate before the wire: whatever gains and targets a command has, the torque that it causes is within limits.

Predicted torque is tau = k_p (q_d - q) + k_d (dq_d - dq) + tau_ff. What exceeds the limits is taken off the feed-forward,
which leaves the drive's own feedback as it is. Close to a joint's end the torque towards the end fades to zero.
"""

import numpy as np

from control.joints import JOINT_COUNT, TORQUE_LIMIT
from control.types import JointCommand, SensorFrame
from sim.backends.hardware.limits import HardwareLimits

_LARGEST = 1e4
"""No target, gain or torque of this robot is anywhere near; what is larger could overflow on the way to the motor."""


class UnsoundCommandError(ValueError):
    """A command that must not reach a motor: a wrong shape, or a value that is not finite or absurd; the message names it."""


class CommandLimiter:
    """Holds the limits of one robot."""

    def __init__(self, limits: HardwareLimits, position_lower: np.ndarray, position_upper: np.ndarray) -> None:
        """`position_lower` and `position_upper`: (22,) rad, infinite for wheels."""
        self._lower = position_lower
        self._upper = position_upper
        self._barrier = TORQUE_LIMIT / limits.position_margin_rad

    def check(self, command: JointCommand) -> None:
        """Refuse what no clipping can repair.

        Raises:
            UnsoundCommandError: shape, finiteness, an absurd value, or a negative gain.
        """
        for name in ("position", "velocity", "stiffness", "damping", "torque"):
            value = getattr(command, name)
            if not isinstance(value, np.ndarray) or value.shape != (JOINT_COUNT,):
                raise UnsoundCommandError(f"command {name} must have shape ({JOINT_COUNT},), not {np.shape(value)}")
            if not np.abs(value).max() <= _LARGEST:  # NaN neither
                raise UnsoundCommandError(f"command {name} holds a value that is not finite, or above {_LARGEST:g}")
        if command.stiffness.min() < 0.0 or command.damping.min() < 0.0:
            raise UnsoundCommandError("command stiffness and damping must not be negative")

    def limit(self, command: JointCommand, frame: SensorFrame) -> tuple[JointCommand, bool]:
        """The command with its predicted torque within limits, and whether it had to be changed."""
        q, dq = frame.joint_position, frame.joint_velocity
        torque = command.stiffness * (command.position - q) + command.damping * (command.velocity - dq) + command.torque
        upper = np.minimum(np.maximum(self._barrier * (self._upper - q), 0.0), TORQUE_LIMIT)
        lower = np.maximum(np.minimum(self._barrier * (self._lower - q), 0.0), -TORQUE_LIMIT)
        limited = np.minimum(np.maximum(torque, lower), upper)
        excess = limited - torque
        if not excess.any():
            return command, False
        return (
            JointCommand(command.position, command.velocity, command.stiffness, command.damping, command.torque + excess),
            True,
        )
