"""Base velocity from wheels that roll: without drift or bias, but blind to slip; for damping rather than for estimation."""

import numpy as np

from control.robot_model import RobotModel


def rolling_velocity(model: RobotModel) -> np.ndarray:
    """Velocity (3,) m/s, world-aligned, of the base origin if the contact points of the wheels stand still on average.

    Needs `model.update`. The velocity that the model was updated with enters by its angular and joint parts alone.
    """
    velocity = model.velocity.copy()
    velocity[:3] = 0.0
    return -(model.wheel_contact_jacobians @ velocity).mean(axis=0)
