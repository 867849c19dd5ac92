"""Base velocity and height from rolling contact, joint velocities and the IMU; no ground truth.

The filter's state is the velocity of the IMU itself. Its derivative is exactly what the accelerometer measures, so neither
the angular acceleration nor the centripetal term of the lever arm to the base origin is ever needed:

    d/dt v_imu = R a_imu + g + (v_rolling - v_imu) / tau

Rolling contact gives one velocity per wheel: its lowest material point stands still on the ground. The two extreme wheels
are dropped per axis, which rejects a lifted or spinning wheel and the scrub of skid steering.
"""

import math
from dataclasses import dataclass

import numpy as np

from control.frames import rotation_from_quaternion
from control.joints import LEGS
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.timing import TICK_S
from control.types import BaseState, SensorFrame


@dataclass(frozen=True, slots=True)
class BaseStateConfig:
    """Attributes:
    crossover_s: tau, above which rolling contact corrects the integrated accelerometer. Force estimation needs the
        derivative of this velocity, which rolling contact alone gives only with joint noise and wheel slip.
    period_s: sample period.
    """

    crossover_s: float = 1.0
    period_s: float = TICK_S

    def __post_init__(self) -> None:
        if not self.crossover_s > self.period_s > 0.0:
            raise ValueError(f"crossover_s must exceed period_s > 0, got {self.crossover_s} and {self.period_s}")


class BaseStateEstimator:
    """Complementary filter from sensor frames to `BaseState`, one frame per period."""

    def __init__(self, config: BaseStateConfig, model: RobotModel) -> None:
        self._config = config
        self._model = model
        self._lever = model.imu_position_in_base
        self._velocity = np.zeros(len(model.velocity))
        self._per_wheel = np.empty((len(LEGS), 4))
        self.reset()

    def reset(self) -> None:
        """Start over from rolling contact at the next frame."""
        self._imu_velocity: np.ndarray | None = None
        self._last: BaseState | None = None

    def step(self, sensor: SensorFrame) -> BaseState:
        """Advance one period; moves the model's kinematics to the frame's configuration.

        A frame that is not finite changes nothing: the last state comes back.

        Raises:
            ValueError: the first frame is not finite.
        """
        rotation = rotation_from_quaternion(sensor.orientation_wxyz)
        rates = sensor.angular_velocity
        self._model.update_configuration(rotation, sensor.joint_position)
        rolling_velocity, height = self._rolling_contact(rates, sensor.joint_velocity)

        lever_velocity = rotation @ _cross(rates, self._lever)
        imu_velocity = rolling_velocity + lever_velocity
        if self._imu_velocity is not None:
            correction = (imu_velocity - self._imu_velocity) / self._config.crossover_s
            acceleration = rotation @ sensor.linear_acceleration
            acceleration[2] -= GRAVITY_MPS2
            imu_velocity = self._imu_velocity + self._config.period_s * (acceleration + correction)
        if not math.isfinite(imu_velocity.sum() + height):
            if self._last is None:
                raise ValueError(f"the first sensor frame (time {sensor.time_s} s) is not finite; check the backend")
            return self._last
        self._imu_velocity = imu_velocity
        self._last = BaseState(rotation, (imu_velocity - lever_velocity) @ rotation, np.array(rates), height)
        return self._last

    def _rolling_contact(self, rates: np.ndarray, joint_velocity: np.ndarray) -> tuple[np.ndarray, float]:
        """World velocity (3,) m/s of the base origin and its height m, each the mean of the two middle wheels."""
        velocity, per_wheel, model = self._velocity, self._per_wheel, self._model
        velocity[3:6] = rates
        velocity[model.joint_rows] = joint_velocity
        # With the base's own linear velocity left out, a standing contact point seems to move at its negative.
        per_wheel[:, :3] = model.wheel_contact_jacobians @ velocity
        per_wheel[:, 3] = model.wheel_contact_positions[:, 2]
        per_wheel.sort(axis=0)
        middle = -0.5 * (per_wheel[1] + per_wheel[2])
        return middle[:3], float(middle[3])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of two (3,) vectors, without the overhead of np.cross."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
