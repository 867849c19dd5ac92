"""Wheel odometry: where the robot has rolled to, from joint velocities and the IMU's heading; no ground truth.

The base origin moves as the wheels' lowest points, which stand on the ground, seem to move away from it. What slips or is in
the air differs from the others and is dropped: per axis, the mean of the two middle ones of four counts. Integrated, slip in
the long run (skid steering, soft ground) is an error that grows with the way, and the uncertainty says so.

The base's rotation is the difference of two attitudes, not the gyro's rate: its bias would roll a resting robot away by
millimetres a second, while an attitude's error stays as small as it is.
"""

import math
from dataclasses import dataclass

import numpy as np

from control.estimation.rolling_contact import middle_rolling_velocity
from control.kernels.compiled import kernel
from control.kernels.records import config_record, packed, record
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


ODOMETRY = config_record(OdometryConfig())
"""The numbers of OdometryConfig."""

ODOMETRY_STATE = record(
    started=(), start_yaw=(), last_yaw=(), rotation=(3, 3), yaw=(), position=2, way=(), way_from=2, turned=(), turned_from=()
)
"""Zeros before the first step.

Fields:
    started: 1 or 0.
    start_yaw, last_yaw: rad, heading in the IMU's world at the first step and at the last one.
    rotation: of the base to the IMU's world at the last step.
    yaw, position: rad and m, of Odometry.
    way, turned: m and rad, moved so far but for noise; way_from, turned_from: position and yaw up to which that counts.
"""


@kernel("f8(f8[:,:], matrix, i8, i8)")
def _turned(last: np.ndarray, rotation: np.ndarray, i: int, j: int) -> float:
    """Entry (i, j) of the rotation since the last step, in base."""
    return last[0, i] * rotation[0, j] + last[1, i] * rotation[1, j] + last[2, i] * rotation[2, j]


@kernel(
    "UniTuple(f8, 2)(matrix, matrix, f8[:,::1], f8[::1], Config[::1], State[::1], f8[::1])",
    Config=ODOMETRY,
    State=ODOMETRY_STATE,
)
def _roll(
    base_to_world: np.ndarray,
    heading_to_world: np.ndarray,
    jacobian: np.ndarray,
    velocity: np.ndarray,
    config: np.ndarray,
    state: np.ndarray,
    position: np.ndarray,
) -> tuple[float, float]:
    """Advance one period.

    Args:
        base_to_world, heading_to_world: (3, 3).
        jacobian, velocity: see `middle_rolling_velocity`.
        config: ODOMETRY (1,).
        state: ODOMETRY_STATE (1,), moved on.
        position: (2,) m, the result.

    Returns:
        Yaw and standard deviation of the position, of Odometry.
    """
    k, s, rolling = config[0], state[0], np.empty(3)
    yaw = math.atan2(heading_to_world[1, 0], heading_to_world[0, 0])
    if s.started == 0.0:
        s.started, s.start_yaw, s.last_yaw = 1.0, yaw, yaw
        s.rotation[:] = base_to_world
    moving = velocity.copy()
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        moving[3 + axis] = 0.5 * (_turned(s.rotation, base_to_world, j, i) - _turned(s.rotation, base_to_world, i, j)) / TICK_S
    s.rotation[:] = base_to_world
    middle_rolling_velocity(jacobian, moving, rolling)
    x, y = TICK_S * rolling[0], TICK_S * rolling[1]
    if not math.isfinite(x + y):
        x = y = 0.0  # one frame that is lost, of many
    turned = yaw - s.last_yaw
    s.yaw += turned - math.tau * np.rint(turned / math.tau)
    s.last_yaw = yaw
    cosine, sine = math.cos(s.start_yaw), math.sin(s.start_yaw)
    s.position[0] += cosine * x + sine * y
    s.position[1] += cosine * y - sine * x
    step = math.hypot(s.position[0] - s.way_from[0], s.position[1] - s.way_from[1])
    if step > k.step_m:
        s.way += step
        s.way_from[0], s.way_from[1] = s.position[0], s.position[1]
    step = abs(s.yaw - s.turned_from)
    if step > k.step_rad:
        s.turned += step
        s.turned_from = s.yaw
    position[0], position[1] = s.position[0], s.position[1]
    return s.yaw, math.hypot(k.way_share * s.way, k.turn_m * s.turned)


class WheelOdometry:
    """Integrates rolling from where it was reset: origin below the base, x ahead."""

    STATE = ("_state",)

    def __init__(self, config: OdometryConfig, model: RobotModel) -> None:
        self._config = packed(ODOMETRY, config)
        self._model = model
        self._state = np.zeros(1, ODOMETRY_STATE)

    def reset(self) -> None:
        """The next step is the origin."""
        self._state[:] = np.zeros((), ODOMETRY_STATE)

    def step(self) -> Odometry:
        """Advance one period, at the configuration and velocity of the model."""
        model, position = self._model, np.empty(2)
        yaw, sigma = _roll(
            model.rotation_base_to_world,
            model.rotation_heading_to_world,
            model.wrench_jacobian,
            model.velocity,
            self._config,
            self._state,
            position,
        )
        return Odometry(position, yaw, sigma)
