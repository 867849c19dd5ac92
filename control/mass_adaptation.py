"""Online estimate of how much heavier than nominal the robot is, on two scales: the arm, and everything else.

If the arm's true inertial parameters are (1 + beta_arm) times nominal and the rest's (1 + beta_rest) times, the residual of
the nominal model is r = B x - N beta, where column j of N (28, 2) is the inertial and gravity force M vdot + h of the bodies
of scale j. At 50 Hz the unknown wrench x is eliminated from the regularised least squares of eq. (11), which leaves a
2 x 2 information matrix on beta; a Gaussian prior holds beta where nothing is known, and old information fades.

The prior makes both scales alike to begin with: most of what is unknown, such as a payload's share or a wrong density, is
common. One scale alone fits a uniform mismatch slightly better and misleads under any other; per-link scales are too weakly
observable while something unknown pushes the arm.
"""

from dataclasses import dataclass

import numpy as np

from control.wrench_projection import WrenchProblem, solve_positive_definite

ARM, REST = 0, 1
SCALE_COUNT = 2


@dataclass(frozen=True, slots=True)
class MassAdaptationConfig:
    """Attributes:
    common_sd: prior standard deviation of what both beta share.
    difference_sd: prior standard deviation of each beta around it.
    residual_sd: standard deviation of one weighted residual row of eq. (11) while the hand is free. The errors are
        correlated over time, which is why it is far above the sensor noise.
    force_scale_n: force on the hand at which that variance has doubled. Where on the hand a force acts is known to a few
        centimetres only, and the moment that is missing looks like mass.
    memory_s: time constant of forgetting, so that a changed robot is noticed.
    limit: largest |beta|: a robot that is lifted or leans on something is not weightless.
    settle_s: data before this time is ignored while the observer settles.
    period_s: time between updates.
    """

    common_sd: float = 0.2
    difference_sd: float = 0.1
    residual_sd: float = 1.0
    force_scale_n: float = 5.0
    memory_s: float = 10.0
    limit: float = 0.6
    settle_s: float = 0.5
    period_s: float = 0.02

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


class MassAdaptation:
    """Recursive Bayesian least squares on beta = [arm, rest].

    Attributes:
        beta: (2,) current estimate; the next `update` replaces the array.
    """

    def __init__(self, config: MassAdaptationConfig) -> None:
        self._config = config
        covariance = np.full((SCALE_COUNT, SCALE_COUNT), config.common_sd**2) + config.difference_sd**2 * np.eye(SCALE_COUNT)
        self._prior = np.linalg.inv(covariance)
        self._keep = float(np.exp(-config.period_s / config.memory_s))
        self.reset()

    def reset(self) -> None:
        """Back to the prior: nominal masses."""
        self._information = self._prior.copy()
        self._information_vector = np.zeros(SCALE_COUNT)
        self._elapsed_s = 0.0
        self.beta = np.zeros(SCALE_COUNT)

    def update(
        self, problem: WrenchProblem, weighted_residual: np.ndarray, weighted_regressor: np.ndarray, force_n: float
    ) -> None:
        """Add one instant; old information fades as fast as new comes in.

        Args:
            problem: eq. (11) at this instant; its right side is not used.
            weighted_residual: (28,) W_q r, of the nominal model.
            weighted_regressor: (28, 2) W_q N.
            force_n: estimated size of the force on the hand.
        """
        self._elapsed_s += self._config.period_s
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
        beta = np.linalg.solve(self._information, self._information_vector)
        self.beta = np.clip(beta, -self._config.limit, self._config.limit)
