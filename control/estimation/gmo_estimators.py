"""The paper's model-based estimators, Sec. III.B: momentum observer with pseudo-inverse or contact-constrained projection."""

import numpy as np

from control.estimation.momentum_residual import MomentumResidual
from control.estimation.projecting_estimator import ProjectingEstimator, estimate_from_wrench
from control.estimation.wrench_projection import ProjectionWeights, build_wrench_problem, pseudo_inverse_wrench
from control.estimation.wrench_qp import ContactConstraints, WrenchSolver
from control.robot_model import RobotModel
from control.types import ForceEstimate


class GmoPseudoInverse(ProjectingEstimator):
    """GMO-PI: x = B^# r."""

    def _project(self, jacobian: np.ndarray, residual: np.ndarray) -> ForceEstimate:
        wrench = pseudo_inverse_wrench(jacobian, residual)
        self.unexplained = residual - wrench @ jacobian
        return estimate_from_wrench(wrench)


class GmoConstrained(ProjectingEstimator):
    """GMO-CQP: the quadratic program of eq. (10).

    With the same weights and costs the unconstrained minimiser estimates the force as well: what sets GMO-CQP apart from
    GMO-PI is W_q and R. The constraints make the wheel forces physical.
    """

    def __init__(
        self, residual: MomentumResidual, model: RobotModel, weights: ProjectionWeights, constraints: ContactConstraints
    ) -> None:
        super().__init__(residual)
        self._rows = weights.rows(model)
        self._costs = weights.costs()
        self._solver = WrenchSolver(constraints)

    def _project(self, jacobian: np.ndarray, residual: np.ndarray) -> ForceEstimate:
        wrench, _ = self._solver.solve(build_wrench_problem(jacobian, residual, self._rows, self._costs))
        self.unexplained = residual - wrench @ jacobian
        return estimate_from_wrench(wrench)
