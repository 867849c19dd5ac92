"""Base velocity from wheels that roll: without drift or bias, but blind to slip; for damping rather than for estimation."""

import numpy as np

from control.joints import LEGS
from control.kernels.compiled import kernel
from control.robot_model import RobotModel

WHEEL_COUNT = len(LEGS)


@kernel("f8(f8[::1], f8[::1])")
def contact_speed(row: np.ndarray, velocity: np.ndarray) -> float:
    """Speed, m/s, of a contact point along one axis as seen from the base origin.

    With the base's own linear velocity left out, a point that stands seems to move at its negative.

    Args:
        row: (28,) of the point and axis in the contact Jacobian.
        velocity: (28,) v; its first three entries are not read.
    """
    speed = 0.0
    for index in range(3, len(velocity)):
        speed += row[index] * velocity[index]
    return speed


@kernel("void(f8[:,::1], f8[::1], f8[::1])")
def mean_rolling_velocity(jacobian: np.ndarray, velocity: np.ndarray, base_velocity: np.ndarray) -> None:
    """See `rolling_velocity`.

    Args:
        jacobian: (18, 28) B^T of eq. (9).
        velocity: (28,) v; its first three entries are not read.
        base_velocity: (3,) m/s, the result.
    """
    base_velocity[:] = 0.0
    for wheel in range(WHEEL_COUNT):
        for axis in range(3):
            base_velocity[axis] -= contact_speed(jacobian[3 * wheel + axis], velocity) / WHEEL_COUNT


def rolling_velocity(model: RobotModel) -> np.ndarray:
    """Velocity (3,) m/s, world-aligned, of the base origin if the contact points of the wheels stand still on average.

    Needs `model.update`. The velocity that the model was updated with enters by its angular and joint parts alone.
    """
    velocity = np.empty(3)
    mean_rolling_velocity(model.wrench_jacobian, model.velocity, velocity)
    return velocity
