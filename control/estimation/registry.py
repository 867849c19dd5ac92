"""The force estimators that run side by side, by name."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from control.estimation.adaptive_estimator import AdaptiveConfig, AdaptiveEstimator
from control.estimation.force_estimator import ForceEstimator
from control.estimation.gmo_estimators import GmoConstrained, GmoPseudoInverse
from control.estimation.momentum_observer import PAPER_GAINS, ObserverGains
from control.estimation.momentum_residual import MomentumResidual
from control.estimation.networks.learned_estimators import LearnedEstimator
from control.estimation.networks.network_weights import load_network
from control.estimation.wrench_projection import ProjectionWeights
from control.estimation.wrench_qp import ContactConstraints
from control.paths import WEIGHTS_DIRECTORY
from control.robot_model import RobotModel
from control.timing import TICK_S

MODEL_BASED_NAMES = ("gmo_pi", "gmo_cqp", "adaptive")
LEARNED_NAMES = ("tcn", "hybrid_paper", "hybrid")


@dataclass(frozen=True, slots=True)
class EstimatorsConfig:
    """Attributes:
    period_s: tick length.
    gmo_gains: of the observer that gmo_pi and gmo_cqp share, the paper's.
    gmo_weights: W_q and R of gmo_cqp.
    constraints: contact constraints of gmo_cqp.
    adaptive: all of `adaptive`.
    weights: folder with the networks of the learned estimators; None to run without them.
    names: of those that run, with all that they build on; None for all.
    """

    period_s: float = TICK_S
    gmo_gains: ObserverGains = PAPER_GAINS
    gmo_weights: ProjectionWeights = field(default_factory=ProjectionWeights)
    constraints: ContactConstraints = field(default_factory=ContactConstraints)
    adaptive: AdaptiveConfig = field(default_factory=AdaptiveConfig)
    weights: Path | None = WEIGHTS_DIRECTORY
    names: tuple[str, ...] | None = None


def bases(estimators: Mapping[str, ForceEstimator]) -> dict[str, str]:
    """The estimator from whose estimate another one makes its own, by the name of the other one."""
    names = {id(estimator): name for name, estimator in estimators.items()}
    learned = {name: estimator for name, estimator in estimators.items() if isinstance(estimator, LearnedEstimator)}
    return {name: names[id(estimator.nominal)] for name, estimator in learned.items() if id(estimator.nominal) in names}


def adaptive_of(estimators: Mapping[str, ForceEstimator]) -> AdaptiveEstimator | None:
    """The one whose model of the robot is best, which tells most sharply what no wrench explains; None where none runs."""
    nominal = [estimator.nominal for estimator in estimators.values() if isinstance(estimator, LearnedEstimator)]
    found = [estimator for estimator in (*estimators.values(), *nominal) if isinstance(estimator, AdaptiveEstimator)]
    return found[0] if found else None


def make_estimators(model: RobotModel, config: EstimatorsConfig) -> dict[str, ForceEstimator]:
    """The estimators by name, for inputs that carry `model`: MODEL_BASED_NAMES, then LEARNED_NAMES.

    Raises:
        WeightsError: weights are missing, damaged or do not fit.
    """
    shared = MomentumResidual(config.gmo_gains, config.period_s, with_friction=False)
    constrained = GmoConstrained(shared, model, config.gmo_weights, config.constraints)
    adaptive = AdaptiveEstimator(model, config.adaptive, config.period_s)
    estimators: dict[str, ForceEstimator] = {
        "gmo_pi": GmoPseudoInverse(shared),
        "gmo_cqp": constrained,
        "adaptive": adaptive,
    }
    if config.weights is not None:
        for name in LEARNED_NAMES:
            network = load_network(name, config.weights)
            nominal = constrained if network.manifest.nominal == "gmo_cqp" else adaptive
            estimators[name] = LearnedEstimator(nominal, network, config.period_s)
    return {name: made for name, made in estimators.items() if config.names is None or name in config.names}
