"""The paper's model-based estimators, Sec. III.B: momentum observer with pseudo-inverse or contact-constrained projection."""

import numpy as np

from control.estimation.force_estimator import EstimatorInput
from control.estimation.momentum_residual import MomentumResidual
from control.estimation.projecting_estimator import ProjectingEstimator, estimate_from_wrench
from control.estimation.wrench_projection import (
    ProjectionWeights,
    build_wrench_problem,
    pseudo_inverse_wrench,
    turn_wrench,
    unexplained_residual,
    wrench_jacobian_in_heading,
)
from control.estimation.wrench_qp import ContactConstraints, WrenchSolver
from control.robot_model import RobotModel
from control.types import ForceEstimate


class GmoPseudoInverse(ProjectingEstimator):
    """GMO-PI: x = B^# r."""

    def _project(self, inputs: EstimatorInput, residual: np.ndarray) -> ForceEstimate:
        jacobian = inputs.model.wrench_jacobian
        wrench = pseudo_inverse_wrench(jacobian, residual)
        unexplained_residual(jacobian, wrench, residual, self.unexplained)
        turn_wrench(inputs.model.rotation_heading_to_world, wrench)
        return estimate_from_wrench(wrench)


class GmoConstrained(ProjectingEstimator):
    """GMO-CQP: the quadratic program of eq. (10).

    With the same weights and costs the unconstrained minimiser estimates the force as well: what sets GMO-CQP apart from
    GMO-PI is W_q and R. The constraints make the wheel forces physical.
    """

    STATE = ()
    SCRATCH = ("_solver", "_jacobian")

    def __init__(
        self, residual: MomentumResidual, model: RobotModel, weights: ProjectionWeights, constraints: ContactConstraints
    ) -> None:
        super().__init__(residual)
        self._rows = weights.rows(model)
        self._costs = weights.costs()
        self._solver = WrenchSolver(constraints)
        self._jacobian = np.zeros_like(model.wrench_jacobian)

    def _project(self, inputs: EstimatorInput, residual: np.ndarray) -> ForceEstimate:
        # The pyramid is aligned with the heading frame.
        model = inputs.model
        wrench_jacobian_in_heading(model.wrench_jacobian, model.rotation_heading_to_world, self._jacobian)
        wrench, _ = self._solver.solve(build_wrench_problem(self._jacobian, residual, self._rows, self._costs))
        unexplained_residual(self._jacobian, wrench, residual, self.unexplained)
        return estimate_from_wrench(wrench)
