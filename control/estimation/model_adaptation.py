"""Online estimate of what the nominal model has wrong: masses on two scales, and joint friction on seven.

If the arm's true inertial parameters are (1 + beta_arm) times nominal, the rest's (1 + beta_rest) times, and the friction of
joint group j (1 + phi_j) times, the residual of the nominal model is r = B x - N beta - F phi. Column j of N (28, 2) is the
inertial and gravity force M vdot + h of the bodies of mass scale j; column j of F (28, 7) is the nominal friction of group j:
each arm joint is one, legs and wheels together are the last. At 50 Hz the unknown wrench x is eliminated from the regularised
least squares of eq. (10), which leaves a 9 x 9 information matrix on theta = [beta, phi]; a Gaussian prior holds what nothing
is known about, and old information fades.

The prior makes the scales of a kind alike to begin with: most of what is unknown, such as a wrong density or cold grease, is
common. One mass scale alone fits a uniform mismatch slightly better and misleads under any other; per-link scales are too
weakly observable while something unknown pushes the arm.
"""

from dataclasses import dataclass

import numpy as np

from control.estimation.wrench_projection import normal_equations
from control.joints import ARM_SLICE
from control.kernels.compiled import kernel
from control.kernels.small_algebra import clip, factorize, solve_positive, substitute_all
from control.robot_model import WRENCH_SIZE, RobotModel
from control.timing import CONTROL_PERIOD_S

ARM, REST = 0, 1
MASSES = slice(0, 2)
FRICTIONS = slice(2, 9)
PARAMETER_COUNT = 9
_FIRST_FRICTION = FRICTIONS.start


@dataclass(frozen=True, slots=True)
class ModelAdaptationConfig:
    """Attributes:
    common_sd: prior standard deviation of what both beta share.
    difference_sd: prior standard deviation of each beta around it.
    friction_common_sd, friction_difference_sd: the same of phi.
    residual_sd: standard deviation of one weighted residual row of eq. (10) while the hand is free. The errors are
        correlated over time, which is why it is far above the sensor noise.
    force_scale_n: force on the hand at which that variance has doubled. Where on the hand a force acts is known to a few
        centimetres only, and the moment that is missing looks like mass.
    memory_s: time constant of forgetting, so that a changed robot is noticed.
    limit: largest |beta|: a robot that is lifted or leans on something is not weightless.
    friction_limit: largest |phi|: friction never drives a joint.
    settle_s: data before this time is ignored while the observer settles.
    moving_s: time over which the motion of a mass is averaged.
    moving_per_s: change of a mass scale per second above which the masses count as moving. Driving and pressing stay below it,
        and after a change of 20 % the force is off by about 1 N when the masses come to rest.
    """

    common_sd: float = 0.2
    difference_sd: float = 0.1
    friction_common_sd: float = 0.4
    friction_difference_sd: float = 0.25
    residual_sd: float = 0.5
    force_scale_n: float = 2.5
    memory_s: float = 10.0
    limit: float = 0.6
    friction_limit: float = 1.0
    settle_s: float = 0.5
    moving_s: float = 1.0
    moving_per_s: float = 0.007

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


def friction_groups(model: RobotModel) -> np.ndarray:
    """(28,) friction group of each generalized row: arm joints 0-5, then legs and wheels 6; -1 for the base, which has none."""
    groups = np.full(len(model.velocity), -1)
    groups[model.joint_rows] = FRICTIONS.stop - FRICTIONS.start - 1
    groups[model.joint_rows[ARM_SLICE]] = np.arange(FRICTIONS.stop - FRICTIONS.start - 1)
    return groups


@kernel("void(f8[::1], f8[::1], f8[::1], i8[::1], f8[:,::1])")
def split_forces(
    inertial_force: np.ndarray,
    friction_force: np.ndarray,
    arm_gravity: np.ndarray,
    arm_rows: np.ndarray,
    forces: np.ndarray,
) -> None:
    """The forces that the parameters scale: N of arm and rest, then F.

    On the arm's rows all of N is the arm's; on the base's the arm's part is taken as its gravity, which dominates there; on
    the legs' the arm has no part.

    Args:
        inertial_force: (28,) N of the whole robot.
        friction_force: (28,) nominal joint friction.
        arm_gravity: (28,) the part of gravity that the arm's links cause.
        arm_rows: (6,) rows of the arm's joints.
        forces: (28, 3) the results.
    """
    for row in range(len(forces)):
        forces[row, 0] = arm_gravity[row]
        forces[row, 2] = friction_force[row]
    for row in arm_rows:
        forces[row, 0] = inertial_force[row]
    for row in range(len(forces)):
        forces[row, 1] = inertial_force[row] - forces[row, 0]


@kernel("void(f8[::1], f8[:,::1], i8[::1], f8[::1], f8[::1])")
def correct_residual(
    residual: np.ndarray, forces: np.ndarray, groups: np.ndarray, parameters: np.ndarray, corrected: np.ndarray
) -> None:
    """What is left for wrenches to explain: r + N beta + F phi.

    Args:
        residual: (28,) r.
        forces: (28, 3) of `split_forces`.
        groups: (28,) of `friction_groups`.
        parameters: (9,) theta = [beta, phi].
        corrected: (28,) the result.
    """
    for row in range(len(residual)):
        corrected[row] = residual[row] + forces[row, 0] * parameters[ARM] + forces[row, 1] * parameters[REST]
        if groups[row] >= 0:
            corrected[row] += forces[row, 2] * parameters[_FIRST_FRICTION + groups[row]]


@kernel(
    "b1(matrix, f8[::1], f8[::1], f8[::1], f8[:,::1], i8[::1], f8, f8, f8[:,::1], f8[::1], f8[:,::1], f8[::1], f8[::1])",
)
def add_instant(
    jacobian: np.ndarray,
    residual: np.ndarray,
    rows: np.ndarray,
    costs: np.ndarray,
    forces: np.ndarray,
    groups: np.ndarray,
    keep: float,
    weight: float,
    prior: np.ndarray,
    limits: np.ndarray,
    information: np.ndarray,
    information_vector: np.ndarray,
    parameters: np.ndarray,
) -> bool:
    """Add one instant to the information on theta and solve for it; False where that is singular.

    Minimising eq. (10) over x leaves the quadratic form of I - W B H^-1 B^T W in the rest of the residual.

    Args:
        jacobian: (18, 28) B^T.
        residual: (28,) r, of the nominal model.
        rows: (28,) diagonal of W_q.
        costs: (18,) diagonal of R.
        forces: (28, 3) of `split_forces`.
        groups: (28,) of `friction_groups`.
        keep: share of the old information that stays; the prior fills up the rest.
        weight: of this instant, one over the variance of a weighted residual row.
        prior: (9, 9) information of the prior, whose mean is zero.
        limits: (9,) of |theta|.
        information: (9, 9) changed.
        information_vector: (9,) changed.
        parameters: (9,) theta, the result.
    """
    size = len(residual)
    regressor = np.zeros((size, PARAMETER_COUNT))
    for row in range(size):
        regressor[row, ARM] = rows[row] * forces[row, 0]
        regressor[row, REST] = rows[row] * forces[row, 1]
        if groups[row] >= 0:
            regressor[row, _FIRST_FRICTION + groups[row]] = rows[row] * forces[row, 2]
    factor, wrench = np.empty((WRENCH_SIZE, WRENCH_SIZE)), np.empty(WRENCH_SIZE)
    normal_equations(jacobian, residual, rows, costs, factor, wrench)
    if not factorize(factor):
        return False
    # The wrenches of all parameters at once: inner loops run over parameters, and skip what no wrench moves.
    wrenches = np.zeros((WRENCH_SIZE, PARAMETER_COUNT))
    for i in range(WRENCH_SIZE):
        for row in range(size):
            if jacobian[i, row] != 0.0:
                for k in range(PARAMETER_COUNT):
                    wrenches[i, k] += jacobian[i, row] * rows[row] * regressor[row, k]
    substitute_all(factor, wrenches)
    unexplained = regressor.copy()
    for i in range(WRENCH_SIZE):
        for row in range(size):
            if jacobian[i, row] != 0.0:
                for k in range(PARAMETER_COUNT):
                    unexplained[row, k] -= rows[row] * jacobian[i, row] * wrenches[i, k]
    explained, shared = np.zeros(PARAMETER_COUNT), np.zeros((PARAMETER_COUNT, PARAMETER_COUNT))
    for row in range(size):
        for k in range(PARAMETER_COUNT):
            explained[k] += unexplained[row, k] * (rows[row] * residual[row])
            for j in range(PARAMETER_COUNT):
                shared[k, j] += unexplained[row, k] * regressor[row, j]
    for k in range(PARAMETER_COUNT):
        information_vector[k] = keep * information_vector[k] - weight * explained[k]
        for j in range(k + 1):
            information[k, j] = keep * information[k, j] + (1.0 - keep) * prior[k, j] + weight * shared[k, j]
            information[j, k] = information[k, j]
    solution = information_vector.copy()
    if not solve_positive(information.copy(), solution):
        return False
    for k in range(PARAMETER_COUNT):
        parameters[k] = clip(solution[k], -limits[k], limits[k])
    return True


@kernel("b1(f8[::1], f8[::1], f8, f8)")
def notice_motion(parameters: np.ndarray, smoothed: np.ndarray, share: float, threshold: float) -> bool:
    """Whether a mass is farther than `threshold` from its low-passed value, which moves towards it by `share` of the way.

    A first-order low-pass lags behind a slope by its time constant times the slope.

    Args:
        parameters: (9,) theta.
        smoothed: (2,) of beta, changed.
    """
    farthest = 0.0
    for k in range(len(smoothed)):
        lag = parameters[k] - smoothed[k]
        smoothed[k] += share * lag
        farthest = max(farthest, abs(lag))
    return farthest > threshold


class ModelAdaptation:
    """Recursive Bayesian least squares on theta = [beta (2), phi (7)].

    Attributes:
        parameters: (9,) current estimate of theta; the next `update` overwrites it.
        moving: whether the masses still move, or nothing is known of them yet.
    """

    STATE = ("_information", "_information_vector", "_elapsed_s", "parameters", "_smoothed", "moving")

    def __init__(self, config: ModelAdaptationConfig) -> None:
        self._config = config
        covariance = np.zeros((PARAMETER_COUNT, PARAMETER_COUNT))
        covariance[MASSES, MASSES] = config.common_sd**2
        covariance[FRICTIONS, FRICTIONS] = config.friction_common_sd**2
        own = np.full(PARAMETER_COUNT, config.friction_difference_sd)
        own[MASSES] = config.difference_sd
        self._prior = np.linalg.inv(covariance + np.diag(own**2))
        self._keep = float(np.exp(-CONTROL_PERIOD_S / config.memory_s))
        self._limits = np.full(PARAMETER_COUNT, config.friction_limit)
        self._limits[MASSES] = config.limit
        self.reset()

    def reset(self) -> None:
        """Back to the prior: the nominal model."""
        self._information = self._prior.copy()
        self._information_vector = np.zeros(PARAMETER_COUNT)
        self._elapsed_s = 0.0
        self.parameters = np.zeros(PARAMETER_COUNT)
        self._smoothed = np.zeros(MASSES.stop)
        self.moving = True

    def update(
        self,
        jacobian: np.ndarray,
        residual: np.ndarray,
        rows: np.ndarray,
        costs: np.ndarray,
        forces: np.ndarray,
        groups: np.ndarray,
        force_n: float,
    ) -> None:
        """Add one instant, see `add_instant`; old information fades as fast as new comes in.

        Args:
            jacobian: (18, 28) B^T.
            residual: (28,) r, of the nominal model.
            rows: (28,) diagonal of W_q.
            costs: (18,) diagonal of R.
            forces: (28, 3) of `split_forces`.
            groups: (28,) of `friction_groups`.
            force_n: estimated size of the force on the hand.
        """
        self._elapsed_s += CONTROL_PERIOD_S
        if self._elapsed_s < self._config.settle_s:
            return
        trust = 1.0 / (1.0 + (force_n / self._config.force_scale_n) ** 2)
        add_instant(
            jacobian,
            residual,
            rows,
            costs,
            forces,
            groups,
            self._keep**trust,
            trust / self._config.residual_sd**2,
            self._prior,
            self._limits,
            self._information,
            self._information_vector,
            self.parameters,
        )
        share, threshold = CONTROL_PERIOD_S / self._config.moving_s, self._config.moving_s * self._config.moving_per_s
        self.moving = notice_motion(self.parameters, self._smoothed, share, threshold)
