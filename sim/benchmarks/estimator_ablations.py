"""Ablations of the model-based estimators: each turns one switch and leaves the rest as it is.

The true base velocity is handed to an estimator here and nowhere else: it comes from the simulator, not from `control`.
"""

from dataclasses import dataclass, replace

import numpy as np

from control.estimation.adaptive_estimator import AdaptiveConfig, AdaptiveEstimator
from control.estimation.force_estimator import EstimatorInput
from control.estimation.gmo_estimators import GmoConstrained
from control.estimation.model_adaptation import ModelAdaptationConfig
from control.estimation.momentum_observer import FAST_GAINS, PAPER_GAINS, SLOPE_GAINS, ObserverGains
from control.estimation.momentum_residual import MomentumResidual
from control.estimation.projecting_estimator import ProjectingEstimator, estimate_from_wrench
from control.estimation.registry import EstimatorsConfig
from control.estimation.wrench_projection import ProjectionWeights, turn_wrench, unconstrained_wrench
from control.estimation.wrench_qp import WrenchProjectionError
from control.frames import rotation_heading_to_world
from control.robot_model import WRENCH_SIZE, RobotModel
from control.types import ForceEstimate

_NO_SPREAD = 1e-4
"""A prior this narrow holds a scale where it is, against all data of a rollout."""
_SPREADS = ("common_sd", "difference_sd", "friction_common_sd", "friction_difference_sd")

ADAPTATIONS = {
    "none": ModelAdaptationConfig(**dict.fromkeys(_SPREADS, _NO_SPREAD)),
    "scalar": ModelAdaptationConfig(difference_sd=_NO_SPREAD),
    "two-scale": ModelAdaptationConfig(),
    "masses only": ModelAdaptationConfig(friction_common_sd=_NO_SPREAD, friction_difference_sd=_NO_SPREAD),
}


@dataclass(frozen=True, slots=True)
class Ablation:
    """A model-based estimator with other settings; the defaults are those of `original`.

    Attributes:
        name: of the row.
        original: "gmo_cqp" or "adaptive".
        gains: of the observer.
        friction: nominal joint friction is taken out of the residual.
        constraints: of the wheel forces; "gmo_cqp" only.
        adaptation: key of ADAPTATIONS; "adaptive" only.
        true_velocity: the simulator's base velocity instead of the estimated one.
    """

    name: str
    original: str
    gains: ObserverGains
    friction: bool
    constraints: bool = True
    adaptation: str = "two-scale"
    true_velocity: bool = False


GMO_CQP = Ablation("gmo_cqp", "gmo_cqp", PAPER_GAINS, friction=False)
ADAPTIVE = Ablation("adaptive", "adaptive", SLOPE_GAINS, friction=True)

ABLATIONS = (
    replace(GMO_CQP, name="gmo_cqp: no constraints", constraints=False),
    replace(GMO_CQP, name="gmo_cqp: friction model", friction=True),
    replace(GMO_CQP, name="gmo_cqp: true velocity", true_velocity=True),
    replace(GMO_CQP, name="gmo_cqp: gains 70, 2500", gains=FAST_GAINS),
    replace(GMO_CQP, name="gmo_cqp: gains 70, 2500, no constraints", gains=FAST_GAINS, constraints=False),
    replace(ADAPTIVE, name="adaptive: no friction model", friction=False),
    replace(ADAPTIVE, name="adaptive: no adaptation", adaptation="none"),
    replace(ADAPTIVE, name="adaptive: scalar adaptation", adaptation="scalar"),
    replace(ADAPTIVE, name="adaptive: masses adapt, friction does not", adaptation="masses only"),
    replace(ADAPTIVE, name="adaptive: gains 70, 2500, no slope", gains=FAST_GAINS),
    replace(ADAPTIVE, name="adaptive: true velocity", true_velocity=True),
    replace(ADAPTIVE, name="adaptive: gains 6, 20, no slope", gains=PAPER_GAINS),
    replace(ADAPTIVE, name="adaptive: gains 28, 400, no slope", gains=ObserverGains(28.0, 400.0)),
    replace(ADAPTIVE, name="adaptive: gains 141, 10000, no slope", gains=ObserverGains(141.0, 1e4)),
)

ORIGINALS = {"hybrid": "adaptive", "hybrid_paper": "gmo_cqp"} | {ablation.name: ablation.original for ablation in ABLATIONS}
"""What each ablation, and each learned correction, is compared with."""


def make_ablation(ablation: Ablation, model: RobotModel, config: EstimatorsConfig) -> ProjectingEstimator:
    """The estimator of `ablation`, for inputs that carry `model`; all else as in `config`."""
    if ablation.original == "adaptive":
        adaptive = replace(config.adaptive, gains=ablation.gains, adaptation=ADAPTATIONS[ablation.adaptation])
        return _Adaptive(model, adaptive, config.period_s, ablation.friction)
    residual = MomentumResidual(ablation.gains, config.period_s, ablation.friction)
    if ablation.constraints:
        return GmoConstrained(residual, model, config.gmo_weights, config.constraints)
    return _GmoUnconstrained(residual, model, config.gmo_weights)


class _Adaptive(AdaptiveEstimator):
    """`adaptive` with or without nominal joint friction."""

    def __init__(self, model: RobotModel, config: AdaptiveConfig, period_s: float, with_friction: bool) -> None:
        super().__init__(model, config, period_s)
        self.momentum = MomentumResidual(config.gains, period_s, with_friction)


class _GmoUnconstrained(ProjectingEstimator):
    """Minimiser of eq. (10) without its constraints, with the same W_q and R as GMO-CQP."""

    def __init__(self, residual: MomentumResidual, model: RobotModel, weights: ProjectionWeights) -> None:
        super().__init__(residual)
        self._rows = weights.rows(model)
        self._costs = weights.costs()

    def _project(self, inputs: EstimatorInput, residual: np.ndarray) -> ForceEstimate:
        wrench = np.empty(WRENCH_SIZE)
        jacobian = inputs.model.wrench_jacobian
        if not unconstrained_wrench(jacobian, residual, self._rows, self._costs, wrench, self.unexplained):
            raise WrenchProjectionError(None, "H is not positive definite")
        turn_wrench(rotation_heading_to_world(inputs.base.rotation_base_to_world), wrench)
        return estimate_from_wrench(wrench)
