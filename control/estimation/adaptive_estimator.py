"""Our model-based estimator: a fast observer that follows slopes, and masses and joint friction that adapt as the robot moves.

The observer is ten times faster than the paper's and loses no force to lag while the force changes steadily. What is then left
is model error: `ModelAdaptation` finds which multiples beta of the inertial and gravity forces N of arm and rest, and which
multiples phi of the nominal joint frictions F, are missing; the corrected residual r + N beta + F phi is projected by the
unconstrained minimum of eq. (10).
"""

import math
from dataclasses import dataclass, field

import numpy as np

from control.estimation.force_estimator import EstimatorInput
from control.estimation.model_adaptation import (
    ARM,
    FRICTIONS,
    MASSES,
    PARAMETER_COUNT,
    REST,
    ModelAdaptation,
    ModelAdaptationConfig,
    friction_groups,
)
from control.estimation.momentum_observer import SLOPE_GAINS, ObserverGains
from control.estimation.momentum_residual import MomentumResidual
from control.estimation.projecting_estimator import ProjectingEstimator
from control.estimation.wrench_projection import (
    FORCE_ROWS,
    SUPPORT_ROWS,
    ProjectionWeights,
    build_wrench_problem,
    project_on_friction_cone,
    solve_positive_definite,
)
from control.joints import ARM_SLICE, LEGS
from control.robot_model import RobotModel
from control.timing import Job, due
from control.types import ForceEstimate


@dataclass(frozen=True, slots=True)
class AdaptiveConfig:
    """Attributes:
    gains: of the observer.
    weights: of eq. (10). Costs on forces are far smaller than the paper-like ones, because a cost on wheel forces that
        carry the robot's weight looks like a lighter robot.
    adaptation: of masses and frictions.
    friction: mu of the cone that the reported wheel forces are moved into; the end-effector force does not depend on it.
    stop_margin_rad: distance from its end at which a joint is taken to lie against it.
    """

    gains: ObserverGains = SLOPE_GAINS
    weights: ProjectionWeights = field(default_factory=lambda: ProjectionWeights(support_cost=1e-6, force_cost=1e-6))
    adaptation: ModelAdaptationConfig = field(default_factory=ModelAdaptationConfig)
    friction: float = 0.8
    stop_margin_rad: float = 0.02


class AdaptiveEstimator(ProjectingEstimator):
    """Fast observer, force-only prior on the end effector, and adaptation of masses and frictions."""

    def __init__(self, model: RobotModel, config: AdaptiveConfig, period_s: float) -> None:
        """`period_s` is the tick length; `model` the one that every tick's input carries."""
        super().__init__(MomentumResidual(config.gains, period_s, with_friction=True))
        self._config = config
        self._model = model
        self._adaptation = ModelAdaptation(config.adaptation)
        self._rows = config.weights.rows(model)
        self._costs = config.weights.costs()
        self._arm_rows = model.joint_rows[ARM_SLICE]
        self._friction_groups = friction_groups(model)

    @property
    def mass_scales(self) -> np.ndarray:
        """(2,) estimated mass over nominal of the arm and of the rest."""
        return 1.0 + self._adaptation.parameters[MASSES]

    def reset(self) -> None:
        """Forget the past, the masses and the frictions."""
        super().reset()
        self._adaptation.reset()

    def observe(self, inputs: EstimatorInput) -> None:
        """Take in one 500 Hz tick, once; one in a control period adapts the model."""
        if not self._residual.observe(inputs):
            return
        if due(Job.ADAPTATION, inputs.tick) and math.isfinite(self.residual.sum()):
            self._adapt()

    def _adapt(self) -> None:
        rows, regressor = self._trusted_rows(), self._regressor()
        corrected = self.residual + regressor @ self._adaptation.parameters
        # R is isotropic, so the frame of the wrenches does not matter here.
        problem = build_wrench_problem(self._model.wrench_jacobian, corrected, rows, self._costs)
        force = solve_positive_definite(problem.hessian, problem.right_side)[FORCE_ROWS]
        self._adaptation.update(problem, rows * self.residual, rows[:, None] * regressor, math.hypot(*force))

    def _project(self, jacobian: np.ndarray, residual: np.ndarray) -> ForceEstimate:
        corrected = residual + self._regressor() @ self._adaptation.parameters
        problem = build_wrench_problem(jacobian, corrected, self._trusted_rows(), self._costs)
        wrench = solve_positive_definite(problem.hessian, problem.right_side)
        self.unexplained = corrected - wrench @ jacobian
        wheel_forces = project_on_friction_cone(wrench[SUPPORT_ROWS].reshape(len(LEGS), 3), self._config.friction)
        return ForceEstimate(wrench[FORCE_ROWS].copy(), wheel_forces, mass_scale=self._mass_scale())

    def _trusted_rows(self) -> np.ndarray:
        """(28,) diagonal of W_q, zero for a joint that may lie against its stop: the stop's torque is unknown."""
        position, margin = self._residual.inputs.sensor.joint_position, self._config.stop_margin_rad
        free = (position > self._model.position_lower + margin) & (position < self._model.position_upper - margin)
        if free.all():
            return self._rows
        rows = self._rows.copy()
        rows[self._model.joint_rows] *= free
        return rows

    def _regressor(self) -> np.ndarray:
        """(28, 9) N of arm and rest, then F. On the arm's rows all of N is the arm's; on the base's the arm's part is taken
        as its gravity, which dominates there; on the legs' the arm has no part."""
        total = self._residual.inertial_force
        regressor = np.empty((len(total), PARAMETER_COUNT))
        arm = self._model.arm_gravity()
        arm[self._arm_rows] = total[self._arm_rows]
        regressor[:, ARM] = arm
        regressor[:, REST] = total - arm
        regressor[:, FRICTIONS] = self._friction_groups
        regressor[:, FRICTIONS] *= self._residual.friction_force[:, None]
        return regressor

    def _mass_scale(self) -> float:
        """Total mass over nominal."""
        arm, rest = self._adaptation.parameters[MASSES].tolist()
        return 1.0 + rest + (arm - rest) * self._model.arm_mass / self._model.total_mass
