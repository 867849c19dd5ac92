"""Driving that leads nowhere is given up: the base stands against something that no sensor feels.

Its wheels would roll on under the trunk until the robot lay on its back.
"""

from dataclasses import dataclass, replace

import numpy as np

from control.types import Command

_DRIVEN = np.array([True, False, True])
"""Of a base velocity, [m/s ahead, m/s aside, rad/s]: the wheels roll and turn."""


@dataclass(frozen=True, slots=True)
class BlockedBaseConfig:
    """When a base counts as blocked.

    Attributes:
        least: base velocity [m/s, m/s, rad/s] below which nothing is concluded.
        share: of the velocity that is asked for; a base that has less does not move.
        way: [m, m, rad] that it should have gone meanwhile. Turning has to scrub first, so it gets more.
    """

    least: tuple[float, float, float] = (0.05, 0.05, 0.1)
    share: float = 0.35
    way: tuple[float, float, float] = (0.12, 0.12, 0.3)


class BlockedBase:
    """Watches the base velocity, and takes the driving out of a command until less, or the other way, is asked for."""

    STATE = ("_way", "_blocked")

    def __init__(self, config: BlockedBaseConfig) -> None:
        self._least, self._limit, self._share = np.array(config.least), np.array(config.way), config.share
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._way = np.zeros(3)
        self._blocked = np.zeros(3)  # in which direction

    def step(self, command: Command, applied: np.ndarray, measured: np.ndarray, dt_s: float) -> Command:
        """The command, or one without the driving that leads nowhere.

        Args:
            command: as asked.
            applied: (3,) base velocity of the last period's command, heading frame.
            measured: (3,) that the base has.
            dt_s: since the last step.
        """
        speed = np.abs(applied)
        stuck = _DRIVEN & (speed > self._least) & (measured * np.sign(applied) < self._share * speed)
        self._way = np.where(stuck, self._way + speed * dt_s, 0.0)
        self._blocked = np.where(self._way > self._limit, np.sign(applied), self._blocked)
        self._blocked = np.where(command.base_velocity * self._blocked > 0.0, self._blocked, 0.0)
        if not self._blocked.any():
            return command
        return replace(command, base_velocity=np.where(self._blocked == 0.0, command.base_velocity, 0.0))
