"""Tells when the hand stands away from where it is asked to be: out of reach, or held off by something."""

import math

import numpy as np

from control.types import Command

AWAY_M = 0.02
STILL_M = 0.01
AFTER_S = 1.0


class ReachWatch:
    """Counts the time for which hand and reference have stood still beside each other."""

    STATE = ("_still_s", "_hand", "_reference")

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
        tracked = 1.0 - applied.mask
        error, reference = tracked * (applied.position_m - hand_position), tracked * applied.position_m
        moved = max(math.dist(tracked * hand_position, self._hand), math.dist(reference, self._reference))
        if moved > STILL_M or math.hypot(*error) < AWAY_M:
            self._still_s = 0.0
            self._hand, self._reference = tracked * hand_position, reference
        self._still_s += dt_s
        return self._still_s >= AFTER_S
