"""Wheel odometry: where the robot has rolled to, from joint velocities and the IMU's heading; no ground truth.

The base origin moves as the wheels' lowest points, which stand on the ground, seem to move away from it. What slips or is in
the air differs from the others and is dropped: per axis, the mean of the two middle ones of four counts. Integrated, slip in
the long run (skid steering, soft ground) is an error that grows with the way, and the uncertainty says so.
"""

import math
from dataclasses import dataclass

import numpy as np

from control.estimation.rolling_contact import middle_rolling_velocity
from control.robot_model import RobotModel
from control.timing import TICK_S
from control.types import Odometry


@dataclass(frozen=True, slots=True)
class OdometryConfig:
    """Attributes:
    way_share: standard deviation of the position per metre of way.
    turn_m: the same per radian turned.
    step_m, step_rad: shorter moves than these are noise, and do not count as way or turn.
    """

    way_share: float = 0.01
    turn_m: float = 0.01
    step_m: float = 0.01
    step_rad: float = 0.02


class WheelOdometry:
    """Integrates rolling from where it was reset: origin below the base, x ahead."""

    STATE = (
        "_start_yaw_rad",
        "_last_yaw_rad",
        "_yaw_rad",
        "_position",
        "_way_m",
        "_turned_rad",
        "_way_from",
        "_turned_from_rad",
    )
    SCRATCH = ("_velocity",)

    def __init__(self, config: OdometryConfig, model: RobotModel) -> None:
        self._config = config
        self._model = model
        self._velocity = np.zeros(3)
        self.reset()

    def reset(self) -> None:
        """The next step is the origin."""
        self._start_yaw_rad: float | None = None
        self._last_yaw_rad = 0.0
        self._yaw_rad = 0.0
        self._position = np.zeros(2)
        self._way_m = self._turned_rad = 0.0
        self._way_from, self._turned_from_rad = np.zeros(2), 0.0

    def step(self, heading_to_world: np.ndarray) -> Odometry:
        """Advance one period, at the configuration and velocity of the model.

        Args:
            heading_to_world: (3, 3).
        """
        yaw = math.atan2(heading_to_world[1, 0], heading_to_world[0, 0])
        if self._start_yaw_rad is None:
            self._start_yaw_rad = self._last_yaw_rad = yaw
        middle_rolling_velocity(self._model.wrench_jacobian, self._model.velocity, self._velocity)
        x, y = TICK_S * self._velocity[0], TICK_S * self._velocity[1]
        if not math.isfinite(x + y):
            x = y = 0.0  # one frame that is lost, of many
        self._yaw_rad += math.remainder(yaw - self._last_yaw_rad, math.tau)
        self._last_yaw_rad = yaw
        c, s = math.cos(self._start_yaw_rad), math.sin(self._start_yaw_rad)
        self._position[0] += c * x + s * y
        self._position[1] += c * y - s * x
        if (step := math.dist(self._position, self._way_from)) > self._config.step_m:
            self._way_m, self._way_from = self._way_m + step, self._position.copy()
        if (step := abs(self._yaw_rad - self._turned_from_rad)) > self._config.step_rad:
            self._turned_rad, self._turned_from_rad = self._turned_rad + step, self._yaw_rad
        sigma = math.hypot(self._config.way_share * self._way_m, self._config.turn_m * self._turned_rad)
        return Odometry(self._position.copy(), self._yaw_rad, sigma)
