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

from control.estimation.wrench_projection import WrenchProblem, solve_positive_definite
from control.joints import ARM_SLICE
from control.robot_model import RobotModel
from control.timing import CONTROL_PERIOD_S

ARM, REST = 0, 1
MASSES = slice(0, 2)
FRICTIONS = slice(2, 9)
PARAMETER_COUNT = 9


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

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


def friction_groups(model: RobotModel) -> np.ndarray:
    """(28, 7) 1 where a generalized row belongs to a friction group: arm joints 1-6, then legs and wheels."""
    rows = model.joint_rows
    arm = rows[ARM_SLICE]
    groups = np.zeros((len(model.velocity), len(arm) + 1))
    groups[rows, -1] = 1.0
    groups[arm, -1] = 0.0
    groups[arm, np.arange(len(arm))] = 1.0
    return groups


class ModelAdaptation:
    """Recursive Bayesian least squares on theta = [beta (2), phi (7)].

    Attributes:
        parameters: (9,) current estimate of theta; the next `update` replaces the array.
    """

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

    def update(
        self, problem: WrenchProblem, weighted_residual: np.ndarray, weighted_regressor: np.ndarray, force_n: float
    ) -> None:
        """Add one instant; old information fades as fast as new comes in.

        Args:
            problem: eq. (10) at this instant; its right side is not used.
            weighted_residual: (28,) W_q r, of the nominal model.
            weighted_regressor: (28, 9) W_q [N, F].
            force_n: estimated size of the force on the hand.
        """
        self._elapsed_s += CONTROL_PERIOD_S
        if self._elapsed_s < self._config.settle_s:
            return
        # Minimising over x leaves the quadratic form of I - W B H^-1 B^T W in the rest.
        jacobian = problem.weighted_jacobian
        explained = jacobian.T @ solve_positive_definite(problem.hessian, jacobian @ weighted_regressor)
        unexplained = weighted_regressor - explained
        trust = 1.0 / (1.0 + (force_n / self._config.force_scale_n) ** 2)
        keep, weight = self._keep**trust, trust / self._config.residual_sd**2
        self._information = keep * self._information + (1.0 - keep) * self._prior + weight * unexplained.T @ weighted_regressor
        self._information_vector = keep * self._information_vector - weight * unexplained.T @ weighted_residual
        parameters = np.linalg.solve(self._information, self._information_vector)
        self.parameters = np.clip(parameters, -self._limits, self._limits)
