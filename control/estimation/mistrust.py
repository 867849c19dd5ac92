"""What makes an estimate of the hand force wrong, and how wrong: eq. (9) knows of no contact but those of wheels and hand.

Torque on the arm's joints that no force at the hand explains comes from a contact elsewhere on the arm; a joint against its
stop hides what its torque would tell. Contacts on trunk and legs are told apart by the arm's joints, which they do not load.
"""

import math
from dataclasses import dataclass, replace
from enum import IntFlag

import numpy as np

from control.joints import ARM_SLICE, STOP_MARGIN_RAD
from control.kernels.compiled import kernel
from control.robot_model import RobotModel
from control.types import ForceEstimate


class EstimatorFlag(IntFlag):
    """Reasons to mistrust the estimated force; bits of `estimator_flags`."""

    NONE = 0
    JOINT_AT_STOP = 1
    SELF_CONTACT = 2
    CONTACT_ELSEWHERE = 4
    MASS_ADAPTING = 8


@dataclass(frozen=True, slots=True)
class MistrustConfig:
    """Attributes:
    stop_margin_rad: an arm joint this close to its end may lie against it.
    stop_sd_n: N, that adds to sigma there.
    near_m: distance between arm and body at which they may touch.
    near_sd_n: N, that adds to sigma there.
    unexplained_nm: N m, norm over the arm's joints of the torque that no wrench explains. A free, pushed or driving arm
        stays below 0.16 at masses from 0.8 to 1.2.
    error_per_nm: N per N m of it, that adds to sigma beyond that.
    """

    stop_margin_rad: float = STOP_MARGIN_RAD
    stop_sd_n: float = 0.6
    near_m: float = 0.005
    near_sd_n: float = 4.0
    unexplained_nm: float = 0.25
    error_per_nm: float = 6.0


@kernel("Tuple((b1, f8))(vector, vector, vector, f8, vector, i8[::1])")
def _inspect(
    joint_position: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    margin: float,
    unexplained: np.ndarray,
    rows: np.ndarray,
) -> tuple[bool, float]:
    """Whether one of the arm's joints may lie against a stop, and the norm (N m) of what no wrench explains of the others.

    Args:
        joint_position, lower, upper: (6,) rad, of the arm.
        margin: rad.
        unexplained: (28,) eps of eq. (9).
        rows: (6,) generalized row of each joint.
    """
    stopped, square = False, 0.0
    for joint in range(len(rows)):
        if lower[joint] + margin < joint_position[joint] < upper[joint] - margin:
            square += unexplained[rows[joint]] ** 2
        else:
            stopped = True
    return stopped, math.sqrt(square)


class Mistrust:
    """Flags an estimate and widens its sigma, at every tick."""

    def __init__(self, config: MistrustConfig, model: RobotModel) -> None:
        self._config = config
        self._rows = model.joint_rows[ARM_SLICE]
        self._lower, self._upper = model.position_lower[ARM_SLICE], model.position_upper[ARM_SLICE]

    def judge(
        self, estimate: ForceEstimate, joint_position: np.ndarray, unexplained: np.ndarray, distance_m: float
    ) -> tuple[EstimatorFlag, ForceEstimate]:
        """The reasons to mistrust an estimate, and the estimate with the standard deviation that goes with them.

        Args:
            estimate: of this tick.
            joint_position: (22,) rad.
            unexplained: (28,) of the same tick, `ProjectingEstimator.unexplained`.
            distance_m: between the arm and the rest of the robot.
        """
        config, flags, extra = self._config, EstimatorFlag.NONE, 0.0
        arm = joint_position[ARM_SLICE]
        stopped, torque = _inspect(arm, self._lower, self._upper, config.stop_margin_rad, unexplained, self._rows)
        if stopped:
            flags |= EstimatorFlag.JOINT_AT_STOP
            extra += config.stop_sd_n
        if distance_m < config.near_m:
            flags |= EstimatorFlag.SELF_CONTACT
            extra += config.near_sd_n
        if torque > config.unexplained_nm:
            flags |= EstimatorFlag.CONTACT_ELSEWHERE
            extra += config.error_per_nm * torque
        if extra > 0.0 and estimate.sigma_n is not None:
            estimate = replace(estimate, sigma_n=np.sqrt(estimate.sigma_n**2 + extra**2))
        if estimate.mass_adapting:
            flags |= EstimatorFlag.MASS_ADAPTING
        return flags, estimate
