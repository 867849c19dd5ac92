"""The base's pose for tasks: by odometry while it drives, and where it was while it stands.

Odometry integrates the gyroscope's bias too, some millimetres per second at the wheels: a hand that wipes a board for half a
minute from a robot at rest would drift by centimetres. A base that is told to stand is moved by less, by what the hand bears.
"""

import math

import numpy as np

from control.types import Odometry

RESTS_AFTER_S = 0.5
"""Since the base was last told to move: it rolls out."""


class Standstill:
    """Follows an odometry, but for the way that it counts at rest. It turns with it always."""

    STATE = ("_position", "_last", "_moved_s")

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """As the odometry at its reset."""
        self._position = np.zeros(2)
        self._last = np.zeros(2)
        self._moved_s = -math.inf

    def step(self, odometry: Odometry, base_velocity: np.ndarray, time_s: float) -> np.ndarray:
        """Position (2,) m of the base; call once per control period.

        Args:
            odometry: newest.
            base_velocity: (3,) as applied.
            time_s: of the session.
        """
        if base_velocity.any():
            self._moved_s = time_s
        if time_s - self._moved_s < RESTS_AFTER_S:
            self._position = self._position + odometry.position_m - self._last
        self._last = odometry.position_m
        return self._position
