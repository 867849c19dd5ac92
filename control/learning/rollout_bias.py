"""The part of a nominal error that no window can know: what differs from robot to robot and stays over a rollout.

Masses, joint offsets and torque constants shift the estimate by an amount that depends on the posture of the arm and not on
the last 0.4 s. A network trained on it learns the robots of the training set by heart. So it is fitted per rollout, as a
linear function of the arm's posture, and taken out of what the network is taught; its spread still counts for sigma.
"""

import numpy as np

from control.joints import ARM_SLICE
from control.learning.rollout_data import SETTLE_STEPS, Rollout
from control.timing import CONTROL_PERIOD_S

RIDGE = 1e-3
SLOPE_UNIT_NPS = 20.0
"""Brings the slope of the force to the size of the other regressors."""


def rollout_bias(rollout: Rollout, wanted: np.ndarray) -> np.ndarray:
    """Posture-dependent bias (T, 3) N of one rollout.

    The slope of the nominal force is fitted beside it, so that lag does not pass for bias.

    Args:
        rollout: at 50 Hz.
        wanted: (T, 3) N, truth minus nominal estimate.
    """
    posture = rollout.arrays["joint_position"][:, ARM_SLICE].astype(float)
    posture = posture - posture[SETTLE_STEPS:].mean(axis=0)
    regressors = np.column_stack([np.ones(len(posture)), posture])
    force = rollout.arrays["adaptive.force"].astype(float)
    slope = np.gradient(force, CONTROL_PERIOD_S, axis=0) / SLOPE_UNIT_NPS
    design = np.column_stack([regressors, slope])[SETTLE_STEPS:]
    hessian = design.T @ design / len(design) + RIDGE * np.eye(design.shape[1])
    weights = np.linalg.solve(hessian, design.T @ wanted[SETTLE_STEPS:] / len(design))
    return regressors @ weights[: regressors.shape[1]]
