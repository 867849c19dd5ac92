"""Driving that leads nowhere is given up: the base stands against something that no sensor feels.

Its wheels would roll on under the trunk until the robot lay on its back.
"""

from dataclasses import dataclass

import numpy as np

_DRIVEN = np.array([True, False, True])
"""Of a base velocity, [m/s ahead, m/s aside, rad/s]: the wheels roll and turn."""


@dataclass(frozen=True, slots=True)
class BlockedBaseConfig:
    """When a base counts as blocked.

    Attributes:
        least: base velocity [m/s, m/s, rad/s] below which nothing is concluded.
        share: of the velocity that is asked for; a base that has less does not move. Turning has to scrub, and is slower.
        way: [m, m, rad] that it should have gone meanwhile.
        gripping: [m/s, m/s, rad/s] up to which the wheels of a blocked base do not spin. What they roll is its velocity; the
            measured one may be off by as much as counts. Faster ones spin, and only the accelerometer tells.
        off_course_rps: what a driven base may turn faster or slower than it is asked to.
        off_course_rad: turned beyond that, and something has caught a wheel or a leg and turns the base about it.
    """

    least: tuple[float, float, float] = (0.05, 0.05, 0.1)
    share: tuple[float, float, float] = (0.5, 0.5, 0.35)
    way: tuple[float, float, float] = (0.12, 0.12, 0.3)
    gripping: tuple[float, float, float] = (0.15, 0.15, 0.0)
    off_course_rps: float = 0.4
    off_course_rad: float = 0.1


class BlockedBase:
    """Watches the base velocity, and takes the driving out of a command until less, or the other way, is asked for."""

    STATE = ("_way", "_turned", "_blocked")

    def __init__(self, config: BlockedBaseConfig) -> None:
        self.config = config
        self._least, self._limit, self._share = np.array(config.least), np.array(config.way), np.array(config.share)
        self._gripping = np.array(config.gripping)
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._way = np.zeros(3)
        self._turned = 0.0
        self._blocked = np.zeros(3)  # in which direction

    @property
    def blocked(self) -> bool:
        """Some of the driving that is asked for leads nowhere."""
        return bool(self._blocked.any())

    def step(
        self,
        asked: np.ndarray,
        relieved: np.ndarray,
        applied: np.ndarray,
        measured: np.ndarray,
        rolled: np.ndarray,
        dt_s: float,
    ) -> None:
        """Watch for one period.

        Args:
            asked: (3,) base velocity, [m/s, m/s, rad/s] in heading, that the operator or whoever leads the hand asks for.
            relieved: (3,) asked for after that, to stand under a load. For its sake alone nothing is tried again.
            applied: (3,) of the last period's command.
            measured: (3,) that the base has.
            rolled: (3,) that it has if its wheels do not slip.
            dt_s: since the last step.
        """
        config, speed = self.config, np.abs(applied)
        known = np.where(speed < self._gripping, rolled, measured)
        stuck = _DRIVEN & (speed > self._least) & (known * np.sign(applied) < self._share * speed)
        self._way = np.where(stuck, self._way + speed * dt_s, 0.0)
        stopped = self._way > self._limit
        off_course = abs(measured[2] - applied[2]) - config.off_course_rps if speed[0] > self._least[0] else 0.0
        self._turned = self._turned + off_course * dt_s if off_course > 0.0 else 0.0
        stopped[0] |= self._turned > config.off_course_rad
        self._blocked = np.where(stopped, np.sign(applied), self._blocked)
        wanted = (asked * self._blocked > 0.0) | (relieved * self._blocked > 0.0)
        self._blocked = np.where(wanted, self._blocked, 0.0)

    def free(self, velocity: np.ndarray) -> np.ndarray:
        """What of a base velocity (3,) does not drive on against what blocks the base."""
        return np.where(velocity * self._blocked > 0.0, 0.0, velocity)
