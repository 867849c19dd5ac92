"""Tells when the hand stands away from where it is asked to be: out of reach, or held off by something."""

import math

import numpy as np

from control.types import Command

AWAY_M = 0.02
MOVING_MPS = 0.01
AFTER_S = 1.0


class ReachWatch:
    """Counts the time for which the hand has stood still beside a reference that stands still."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._still_s = 0.0
        self._hand, self._reference = np.full(3, np.inf), np.full(3, np.inf)

    def step(self, applied: Command, hand_position: np.ndarray, dt_s: float) -> bool:
        """Whether the hand has stood farther than AWAY_M from its reference, on position axes, for AFTER_S.

        Args:
            applied: command whose position the hand shall have.
            hand_position: (3,) m, in heading.
            dt_s: since the last step.
        """
        error = (1.0 - applied.mask) * (applied.position_m - hand_position)
        step = MOVING_MPS * dt_s
        still = math.dist(hand_position, self._hand) < 5.0 * step and math.dist(applied.position_m, self._reference) < step
        self._still_s = self._still_s + dt_s if still and math.hypot(*error) > AWAY_M else 0.0
        self._hand, self._reference = hand_position, applied.position_m
        return self._still_s >= AFTER_S
