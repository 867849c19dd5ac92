"""What a residual policy adds to the references of the model-based controller (control.whole_body.model_based)."""

import numpy as np

from control.kernels.records import record

CORRECTION = record(hand_velocity=3, hand_force=3, hand_angular_velocity=3, base_velocity=2)
"""In heading.

Fields:
    hand_velocity: m/s, counts on position axes.
    hand_force: N that the hand exerts, counts on force axes.
    hand_angular_velocity: rad/s.
    base_velocity: forward m/s and yaw rad/s, counts while the base is commanded to move.
"""

NO_CORRECTION = np.zeros(1, CORRECTION)
"""Of one robot; not to be written to."""
