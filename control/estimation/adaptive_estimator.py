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
    MASSES,
    ModelAdaptation,
    ModelAdaptationConfig,
    correct_residual,
    friction_groups,
    split_forces,
)
from control.estimation.momentum_observer import SLOPE_GAINS, ObserverGains
from control.estimation.momentum_residual import MomentumResidual
from control.estimation.projecting_estimator import ProjectingEstimator
from control.estimation.wrench_projection import (
    FORCE_ROWS,
    SUPPORT_ROWS,
    ProjectionWeights,
    project_on_friction_cone,
    turn_wrench,
    unconstrained_wrench,
)
from control.estimation.wrench_qp import WrenchProjectionError
from control.joints import ARM_SLICE, LEGS, STOP_MARGIN_RAD, WHEEL_FRICTION
from control.kernels.compiled import kernel
from control.robot_model import WRENCH_SIZE, RobotModel
from control.timing import Job, due
from control.types import ForceEstimate

_WHEELS = len(LEGS)


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
    friction: float = WHEEL_FRICTION
    stop_margin_rad: float = STOP_MARGIN_RAD


@kernel("void(vector, f8[::1], f8[::1], f8, i8[::1], f8[::1], f8[::1])")
def trust_rows(
    joint_position: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    margin: float,
    joint_rows: np.ndarray,
    rows: np.ndarray,
    trusted: np.ndarray,
) -> None:
    """W_q without the joints that may lie against a stop: the stop's torque is unknown.

    Args:
        joint_position: (22,) rad.
        lower, upper: (22,) rad, stops.
        margin: rad, distance from a stop at which a joint is taken to lie against it.
        joint_rows: (22,) generalized row of each joint.
        rows: (28,) diagonal of W_q.
        trusted: (28,) the result.
    """
    trusted[:] = rows
    for joint in range(len(joint_rows)):
        if not lower[joint] + margin < joint_position[joint] < upper[joint] - margin:
            trusted[joint_rows[joint]] = 0.0


@kernel(
    "b1(vector, f8[::1], f8[::1], f8, i8[::1], f8[::1], f8[:,::1], f8[::1], i8[::1], i8[::1], f8[::1], f8[:,::1], f8[::1],"
    " f8[:,::1], f8, f8[::1], f8[:,::1], f8[::1], f8[::1])"
)
def corrected_wrench(
    joint_position: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    margin: float,
    joint_rows: np.ndarray,
    rows: np.ndarray,
    residuals: np.ndarray,
    arm_gravity: np.ndarray,
    arm_rows: np.ndarray,
    groups: np.ndarray,
    parameters: np.ndarray,
    jacobian: np.ndarray,
    costs: np.ndarray,
    rotation_heading_to_world: np.ndarray,
    friction: float,
    trusted: np.ndarray,
    forces: np.ndarray,
    wrench: np.ndarray,
    unexplained: np.ndarray,
) -> bool:
    """Wrench (18,) in heading that explains r + N beta + F phi; False where H is not positive definite.

    R is isotropic, so it is found in world axes and turned. Wheel forces are then moved into their friction cones.

    Args:
        joint_position, lower, upper, margin, joint_rows, rows, trusted: see `trust_rows`.
        residuals: (3, 28) of MomentumResidual.
        arm_gravity, arm_rows, forces: see `split_forces`.
        groups, parameters: see `correct_residual`.
        jacobian, costs, wrench, unexplained: see `unconstrained_wrench`.
        rotation_heading_to_world: (3, 3).
        friction: mu of the cones.
    """
    trust_rows(joint_position, lower, upper, margin, joint_rows, rows, trusted)
    residual, inertial_force, with_friction = residuals[0], residuals[1], residuals[2]
    split_forces(inertial_force, residual - with_friction, arm_gravity, arm_rows, forces)
    corrected = np.empty(len(residual))
    correct_residual(residual, forces, groups, parameters, corrected)
    if not unconstrained_wrench(jacobian, corrected, trusted, costs, wrench, unexplained):
        return False
    turn_wrench(rotation_heading_to_world, wrench)
    wheel_forces = wrench[SUPPORT_ROWS].reshape((_WHEELS, 3))
    project_on_friction_cone(wheel_forces, friction, wheel_forces)
    return True


class AdaptiveEstimator(ProjectingEstimator):
    """Fast observer, force-only prior on the end effector, and adaptation of masses and frictions."""

    STATE = ("_adaptation",)
    SCRATCH = ("_trusted", "_forces")

    def __init__(self, model: RobotModel, config: AdaptiveConfig, period_s: float) -> None:
        """`period_s` is the tick length; `model` like the one that every tick's input carries."""
        super().__init__(MomentumResidual(config.gains, period_s, with_friction=True))
        self._config = config
        self._adaptation = ModelAdaptation(config.adaptation)
        self._rows = config.weights.rows(model)
        self._costs = config.weights.costs()
        self._arm_rows = model.joint_rows[ARM_SLICE]
        self._friction_groups = friction_groups(model)
        size = len(model.velocity)
        self._trusted, self._forces = np.zeros(size), np.zeros((size, 3))

    @property
    def mass_scales(self) -> np.ndarray:
        """(2,) estimated mass over nominal of the arm and of the rest."""
        return 1.0 + self._adaptation.parameters[MASSES]

    def reset(self) -> None:
        """Forget the past, the masses and the frictions."""
        super().reset()
        self.forget_parameters()

    def forget_parameters(self) -> None:
        """Forget the masses and the frictions: the model is another one now."""
        self._adaptation.reset()

    def observe(self, inputs: EstimatorInput) -> None:
        """Take in one 500 Hz tick, once; one in a control period adapts the model."""
        if not self.momentum.observe(inputs):
            return
        if due(Job.ADAPTATION, inputs.tick) and self.momentum.finite:
            self._adapt()

    def _adapt(self) -> None:
        wrench = self._wrench(self.momentum.inputs)
        # In world axes: R is isotropic, so the frame of the wrenches does not matter here.
        self._adaptation.update(
            self.momentum.inputs.model.wrench_jacobian,
            self.momentum.residual,
            self._trusted,
            self._costs,
            self._forces,
            self._friction_groups,
            math.hypot(*wrench[FORCE_ROWS]),
        )

    def _project(self, inputs: EstimatorInput, residual: np.ndarray) -> ForceEstimate:
        wrench, scales = self._wrench(inputs), self.mass_scales
        arm, rest = scales.tolist()
        total = rest + (arm - rest) * inputs.model.arm_mass / inputs.model.total_mass
        forces, wheels = wrench[FORCE_ROWS], wrench[SUPPORT_ROWS].reshape(_WHEELS, 3)
        return ForceEstimate(forces, wheels, mass_scale=total, mass_scales=scales, mass_adapting=self._adaptation.moving)

    def _wrench(self, inputs: EstimatorInput) -> np.ndarray:
        """(18,) in heading, of the newest residual after correction by the adapted model.

        Raises:
            WrenchProjectionError: H is not positive definite.
        """
        model, wrench = inputs.model, np.empty(WRENCH_SIZE)
        if not corrected_wrench(
            inputs.sensor.joint_position,
            model.position_lower,
            model.position_upper,
            self._config.stop_margin_rad,
            model.joint_rows,
            self._rows,
            self.momentum.residuals,
            model.arm_gravity,
            self._arm_rows,
            self._friction_groups,
            self._adaptation.parameters,
            model.wrench_jacobian,
            self._costs,
            model.rotation_heading_to_world,
            self._config.friction,
            self._trusted,
            self._forces,
            wrench,
            self.unexplained,
        ):
            raise WrenchProjectionError(None, "H is not positive definite; every cost in R must be positive")
        return wrench
