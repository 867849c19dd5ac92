"""Base velocity from wheels that roll: without drift or bias, but blind to slip; for damping rather than for estimation."""

import math

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


@kernel("f8(f8, f8, f8, f8)")
def middle(a: float, b: float, c: float, d: float) -> float:
    """Mean of the two middle ones of four numbers; one that is no number counts as the largest."""
    a = math.inf if math.isnan(a) else a
    b = math.inf if math.isnan(b) else b
    c = math.inf if math.isnan(c) else c
    d = math.inf if math.isnan(d) else d
    return 0.5 * (max(min(a, b), min(c, d)) + min(max(a, b), max(c, d)))


@kernel("void(f8[:,::1], f8[::1], f8[::1])")
def middle_rolling_velocity(jacobian: np.ndarray, velocity: np.ndarray, base_velocity: np.ndarray) -> None:
    """Velocity of the base origin if the two middle ones of the contact points, per axis, stand still.

    Args:
        jacobian: (18, 28) B^T of eq. (9).
        velocity: (28,) v; its first three entries are not read.
        base_velocity: (3,) m/s, world-aligned, the result.
    """
    for axis in range(3):
        base_velocity[axis] = -middle(
            contact_speed(jacobian[axis], velocity),
            contact_speed(jacobian[3 + axis], velocity),
            contact_speed(jacobian[6 + axis], velocity),
            contact_speed(jacobian[9 + axis], velocity),
        )


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
