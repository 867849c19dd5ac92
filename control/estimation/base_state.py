"""Base velocity and height from rolling contact, joint velocities and the IMU; no ground truth.

The filter's state is the velocity of the IMU itself. Its derivative is exactly what the accelerometer measures, so neither
the angular acceleration nor the centripetal term of the lever arm to the base origin is ever needed:

    d/dt v_imu = R (a_imu + c) + g + (v_rolling - v_imu) / tau
    d/dt c     = k R^T (v_rolling - v_imu)

with c, what the accelerometer's bias and the attitude's (which turns gravity into an acceleration) are lacking. Without c they
would leave a velocity of bias times tau. While the wheels stand, rolling contact knows the velocity to millimetres per second,
and corrects both states fast; while they roll and scrub, it corrects slowly what it knows in the long run only.

Rolling contact gives one velocity per wheel: its lowest material point stands still on the ground. The two extreme wheels
are dropped per axis, which rejects a lifted or spinning wheel and the scrub of skid steering.
"""

import math
from dataclasses import dataclass

import numpy as np

from control.estimation.rolling_contact import middle, middle_rolling_velocity
from control.frames import rotation_from_quaternion
from control.joints import WHEEL_RADIUS_M, WHEEL_SLICE
from control.kernels.compiled import kernel
from control.kernels.records import config_record, packed
from control.kernels.small_algebra import clip
from control.robot_model import GRAVITY_MPS2, RobotModel, stack_velocity
from control.timing import TICK_S
from control.types import BaseState, SensorFrame

_WHEELS = (WHEEL_SLICE.start, WHEEL_SLICE.stop)
_UNKNOWN = np.full(3, np.nan)
"""The base's linear velocity, where it is not to be read."""


@dataclass(frozen=True, slots=True)
class BaseStateConfig:
    """Attributes:
    crossover_s: tau, above which rolling contact corrects the integrated accelerometer. Force estimation needs the
        derivative of this velocity, which rolling contact alone gives only with joint noise and wheel slip.
    standing_crossover_s: the same while all wheels stand.
    bias_rate, standing_bias_rate: k, 1/s^2, while the wheels roll, and while they stand; critical damping is 1 / (4 tau^2).
    standing_speed_mps: of the fastest wheel's surface, at which the robot counts half as standing.
    period_s: sample period.
    """

    crossover_s: float = 1.0
    standing_crossover_s: float = 0.25
    bias_rate: float = 0.05
    standing_bias_rate: float = 4.0
    standing_speed_mps: float = 0.02
    period_s: float = TICK_S

    def __post_init__(self) -> None:
        if not self.crossover_s > self.period_s > 0.0:
            raise ValueError(f"crossover_s must exceed period_s > 0, got {self.crossover_s} and {self.period_s}")
        if not self.standing_crossover_s > self.period_s:
            raise ValueError(f"standing_crossover_s must exceed period_s {self.period_s}, got {self.standing_crossover_s}")


BASE_STATE = config_record(BaseStateConfig(), lever=3)
"""The configuration, and the position of the IMU in base, m."""

_LARGEST_BIAS = 0.3
"""m/s^2 per axis. No IMU on its feet has more; a robot on its side would learn any."""

_LARGEST_SURPRISE = 0.1
"""m/s of v_rolling - v_imu that the bias learns from: what exceeds it is slip, or wheels in the air."""


@kernel("void(vector, f8[:,::1])")
def _attitude(orientation_wxyz: np.ndarray, rotation: np.ndarray) -> None:
    """The rotation (3, 3) of a quaternion (4,) wxyz."""
    rotation[:] = rotation_from_quaternion(orientation_wxyz)


@kernel(
    "Tuple((b1, f8))(f8[:,::1], vector, vector, vector, i8[::1], f8[:,::1], f8[:,::1], b1,"
    " Config[::1], f8[::1], f8[::1], f8[::1])",
    Config=BASE_STATE,
)
def complementary_filter(
    rotation_base_to_world: np.ndarray,
    rates: np.ndarray,
    acceleration: np.ndarray,
    joint_velocity: np.ndarray,
    joint_rows: np.ndarray,
    jacobian: np.ndarray,
    contact_points: np.ndarray,
    started: bool,
    config: np.ndarray,
    imu_velocity: np.ndarray,
    correction: np.ndarray,
    base_velocity: np.ndarray,
) -> tuple[bool, float]:
    """One period of the filter above; nothing changes where its result is not finite.

    Args:
        rotation_base_to_world: (3, 3).
        rates: (3,) rad/s, in base.
        acceleration: (3,) m/s^2, specific force at the IMU, in base axes.
        joint_velocity: (22,) rad/s.
        joint_rows: (22,) generalized row of each joint.
        jacobian: (18, 28) B^T of eq. (9).
        contact_points: (4, 3) m, world-aligned, from the base origin.
        started: whether `imu_velocity` is the filter's state already; else rolling contact starts it.
        config: (1,) BASE_STATE.
        imu_velocity: (3,) m/s, in world, state of the filter.
        correction: (3,) m/s^2, in base, c, state of the filter.
        base_velocity: (3,) m/s, in base, of its origin, the result.

    Returns:
        Whether the result is finite, and the height of the base origin above the ground, m.
    """
    r, lever = rotation_base_to_world, config[0].lever
    velocity = np.empty(jacobian.shape[1])
    stack_velocity(_UNKNOWN, rates, joint_velocity, joint_rows, velocity)
    fastest = 0.0
    for wheel in range(_WHEELS[0], _WHEELS[1]):
        fastest = max(fastest, WHEEL_RADIUS_M * abs(joint_velocity[wheel]))
    standing = 1.0 / (1.0 + (fastest / config[0].standing_speed_mps) ** 2)
    velocity_rate = (1.0 - standing) / config[0].crossover_s + standing / config[0].standing_crossover_s
    bias_rate = (1.0 - standing) * config[0].bias_rate + standing * config[0].standing_bias_rate
    cross = (
        rates[1] * lever[2] - rates[2] * lever[1],
        rates[2] * lever[0] - rates[0] * lever[2],
        rates[0] * lever[1] - rates[1] * lever[0],
    )
    new, from_lever, surprise, of_base = np.empty(3), np.empty(3), np.zeros(3), np.empty(3)
    middle_rolling_velocity(jacobian, velocity, of_base)
    height = -middle(contact_points[0, 2], contact_points[1, 2], contact_points[2, 2], contact_points[3, 2])
    total = height
    for axis in range(3):
        from_lever[axis] = r[axis, 0] * cross[0] + r[axis, 1] * cross[1] + r[axis, 2] * cross[2]
        rolling = from_lever[axis] + of_base[axis]
        new[axis] = rolling
        if started:
            change = 0.0
            for i in range(3):
                change += r[axis, i] * (acceleration[i] + correction[i])
            if axis == 2:
                change -= GRAVITY_MPS2
            error = rolling - imu_velocity[axis]
            surprise[axis] = clip(error, -_LARGEST_SURPRISE, _LARGEST_SURPRISE)
            new[axis] = imu_velocity[axis] + config[0].period_s * (change + velocity_rate * error)
        total += new[axis]
    if not math.isfinite(total):
        return False, 0.0
    imu_velocity[:] = new
    for axis in range(3):
        base_velocity[axis] = 0.0
        for i in range(3):
            base_velocity[axis] += (new[i] - from_lever[i]) * r[i, axis]
            correction[axis] += config[0].period_s * bias_rate * surprise[i] * r[i, axis]
        correction[axis] = clip(correction[axis], -_LARGEST_BIAS, _LARGEST_BIAS)
    return True, height


class BaseStateEstimator:
    """Complementary filter from sensor frames to `BaseState`, one frame per period."""

    STATE = ("_imu_velocity", "_correction", "_last")

    def __init__(self, config: BaseStateConfig, model: RobotModel) -> None:
        self._config = packed(BASE_STATE, config, lever=model.imu_position_in_base)
        self._model = model
        self._imu_velocity = np.zeros(3)
        self._correction = np.zeros(3)
        self.reset()

    def reset(self) -> None:
        """Start over from rolling contact at the next frame."""
        self._last: BaseState | None = None
        self._correction[:] = 0.0

    def step(self, sensor: SensorFrame) -> BaseState:
        """Advance one period; moves the model's kinematics to the state that comes back and the frame's joints.

        A frame that is not finite changes nothing: the last state comes back.

        Raises:
            ValueError: the first frame is not finite.
        """
        model = self._model
        rotation, velocity, rates = np.empty((3, 3)), np.empty(3), sensor.angular_velocity
        _attitude(sensor.orientation_wxyz, rotation)
        model.update_configuration(rotation, sensor.joint_position)
        finite, height = complementary_filter(
            rotation,
            rates,
            sensor.linear_acceleration,
            sensor.joint_velocity,
            model.joint_rows,
            model.wrench_jacobian,
            model.wheel_contact_positions,
            self._last is not None,
            self._config,
            self._imu_velocity,
            self._correction,
            velocity,
        )
        if finite:
            self._last = BaseState(rotation, velocity, rates, height)
        elif self._last is None:
            raise ValueError(f"the first sensor frame (time {sensor.time_s} s) is not finite; check the backend")
        else:
            model.update_configuration(self._last.rotation_base_to_world, sensor.joint_position)
        return self._last
