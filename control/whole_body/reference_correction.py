"""What a residual policy adds to the references of the model-based controller (control.whole_body.model_based)."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class ReferenceCorrection:
    """In heading; arrays have the batch shape in front.

    Attributes:
        hand_velocity: (..., 3) m/s, counts on position axes.
        hand_force: (..., 3) N that the hand exerts, counts on force axes.
        hand_angular_velocity: (..., 3) rad/s.
        base_velocity: (..., 2) forward m/s and yaw rad/s, counts while the base is commanded to move.
    """

    hand_velocity: np.ndarray
    hand_force: np.ndarray
    hand_angular_velocity: np.ndarray
    base_velocity: np.ndarray


NO_CORRECTION = ReferenceCorrection(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
