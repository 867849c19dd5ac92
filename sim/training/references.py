"""The applied references of the whole batch: the command filter (control.command.filter), robot by robot."""

import numpy as np

from control.command.command_record import commands
from control.command.filter import FILTER_STATE, filter_commands
from control.command.limits import CommandLimits, limits_record


class BatchedReferences:
    """References of every robot, rate-limited towards the commands.

    Attributes:
        applied: COMMAND (n,), changed in place.
    """

    def __init__(self, count: int, limits: CommandLimits) -> None:
        self._limits = limits_record(limits)
        self._states = np.zeros(count, FILTER_STATE)
        self._states["applied"] = commands(count)
        self.applied = self._states["applied"]

    def reset(self, ids: np.ndarray, hand_position: np.ndarray, hand_orientation: np.ndarray) -> None:
        """Start robots from rest at their measured hand: position (m, 3), orientation (m, 4), in heading."""
        start = np.zeros(len(ids), FILTER_STATE)
        start["applied"]["position_m"], start["applied"]["orientation_wxyz"] = hand_position, hand_orientation
        self._states[ids] = start

    def step(self, asked: np.ndarray, hand_position: np.ndarray, force_estimated_n: np.ndarray, dt_s: float) -> None:
        """Move towards the commands.

        Args:
            asked: COMMAND (n,), within the limits.
            hand_position: (n, 3) m, measured, in heading.
            force_estimated_n: (n, 3) N, estimated, in heading.
            dt_s: control period.
        """
        filter_commands(self._limits, asked, hand_position, force_estimated_n, dt_s, self._states)
