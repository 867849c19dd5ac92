"""What the force estimators share: a momentum residual goes in, a wrench comes out, and a failed projection is said."""

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from control.estimation.force_estimator import EstimatorInput
from control.estimation.momentum_residual import MomentumResidual
from control.estimation.wrench_projection import FORCE_ROWS, SUPPORT_ROWS
from control.estimation.wrench_qp import WrenchProjectionError
from control.joints import JOINT_COUNT, LEGS
from control.types import ForceEstimate


class ProjectingEstimator(ABC):
    """Base of the estimators that project a momentum residual on contact wrenches.

    Attributes:
        momentum: observes the residual r, which other estimators may share.
        unexplained: (28,) eps of eq. (9) at the last estimate, what no wrench explains of the residual that was projected;
            the next estimate overwrites it.
    """

    STATE = ("momentum", "_last", "_estimated_tick", "unexplained")

    def __init__(self, residual: MomentumResidual) -> None:
        self.momentum = residual
        self._last: ForceEstimate | None = None
        self._estimated_tick: int | None = None
        self.unexplained = np.zeros(6 + JOINT_COUNT)

    def set_gains(self, k1: float, k2: float) -> None:
        """Change the observer gains, also for the estimators that share the observer.

        Raises:
            ValueError: a gain is not positive and finite.
        """
        self.momentum.gains = self.momentum.gains.retuned(k1, k2)

    def reset(self) -> None:
        """Forget the past; the next tick starts at rest equilibrium."""
        self.momentum.reset()
        self._last = self._estimated_tick = None
        self.unexplained[:] = 0.0

    def observe(self, inputs: EstimatorInput) -> None:
        """Take in one 500 Hz tick."""
        self.momentum.observe(inputs)

    def estimate(self) -> ForceEstimate:
        """Project the newest residual, once per tick; where that fails, the last good estimate comes back marked stale.

        Raises:
            RuntimeError: nothing has been observed since the last reset.
            WrenchProjectionError: the projection failed and there is no good estimate yet.
        """
        inputs = self.momentum.inputs
        if self._last is not None and self._estimated_tick == inputs.tick:
            return self._last
        self._estimated_tick = inputs.tick
        try:
            if not self.momentum.finite:
                raise WrenchProjectionError(None, "the residual is not finite")
            self._last = self._project(inputs, self.momentum.residual)
        except WrenchProjectionError:
            if self._last is None:
                raise
            self._last = replace(self._last, stale=True)
        return self._last

    @abstractmethod
    def _project(self, inputs: EstimatorInput, residual: np.ndarray) -> ForceEstimate:
        """The estimate at a tick with a finite r (28,); writes `unexplained`.

        Raises:
            WrenchProjectionError: no solution.
        """


def estimate_from_wrench(wrench: np.ndarray) -> ForceEstimate:
    """The forces in a stacked wrench (18,) in heading, eq. (11), which they share the memory of."""
    return ForceEstimate(wrench[FORCE_ROWS], wrench[SUPPORT_ROWS].reshape(len(LEGS), 3))
