"""Error of a force network on whole rollouts, alone and by kind of rollout."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from control.estimation.networks.force_features import SIGMA_GROUPS, features, increment_columns, sigma_drivers
from control.estimation.networks.force_network import NetworkManifest, scale_outputs
from control.learning.rollout_data import SETTLE_STEPS, Rollout
from control.learning.targets import TrainingTarget
from control.learning.windows import WindowSet


@dataclass(frozen=True, slots=True)
class Prediction:
    """Of one rollout, settling steps left out.

    Attributes:
        error: (T, 3) N, estimate minus truth.
        nominal_error: (T, 3) N, of the nominal estimate alone; None where the network uses none.
        sigma: (T, 3) N, or None.
        drivers: (T, SIGMA_DRIVERS) of control.estimation.networks.force_features.sigma_drivers.
    """

    error: np.ndarray
    nominal_error: np.ndarray | None
    sigma: np.ndarray | None
    drivers: np.ndarray


def vector_rmse(error: np.ndarray) -> float:
    """Root mean square of the length of (T, 3) errors: the paper's e_vec."""
    return float(np.sqrt((error * error).sum(axis=1).mean()))


@torch.no_grad()
def predict(
    module: Callable[[torch.Tensor], torch.Tensor],
    windows: WindowSet,
    rollouts: list[Rollout],
    target: TrainingTarget,
    manifest: NetworkManifest,
    stride: int = 1,
) -> list[Prediction]:
    """Predictions of `module` (in evaluation mode) at every `stride`-th step of `rollouts`, those that `windows` holds."""
    steps = torch.arange(SETTLE_STEPS, windows.step_count, stride)
    increments = increment_columns(target.feature_groups, target.increment_groups)
    predictions = []
    for index, rollout in enumerate(rollouts):
        inputs, _, _ = windows.windows(torch.full_like(steps, index), steps)
        mass_scale = features(SIGMA_GROUPS, rollout.signals(target.features_from))[steps]
        drivers = sigma_drivers(inputs.numpy(), increments, mass_scale)
        force, sigma = scale_outputs(module(inputs).numpy(), drivers, manifest)
        truth = rollout.force_true_n[steps]
        nominal_error = None
        error = force - truth
        if target.nominal is not None:
            nominal = rollout.arrays[f"{target.nominal}.force"][steps]
            nominal_error = nominal - truth
            error = error + nominal
        predictions.append(Prediction(error, nominal_error, sigma, drivers))
    return predictions


def typical_rmse(errors: Sequence[np.ndarray]) -> float:
    """Geometric mean over rollouts of the vector RMSE, N: a percent counts as much under a calm force as under a wild one."""
    return float(np.exp(np.mean([np.log(vector_rmse(error)) for error in errors])))


def by_cell(rollouts: list[Rollout], predictions: list[Prediction]) -> dict[str, list[Prediction]]:
    """Predictions by kind of rollout: "hold 0.8", "sine per-link", ..."""
    groups: dict[str, list[Prediction]] = {}
    for rollout, prediction in zip(rollouts, predictions, strict=True):
        info = rollout.info
        kind = "per-link" if info["per_link"] else f"{info['mass_scale']:.1f}"
        groups.setdefault(f"{info['profile']} {kind}", []).append(prediction)
    return dict(sorted(groups.items()))


def cell_metrics(rollouts: list[Rollout], predictions: list[Prediction]) -> dict[str, dict[str, float]]:
    """Metrics by kind of rollout: mean RMSE with and without the network, coverage."""
    return {name: _metrics(group) for name, group in by_cell(rollouts, predictions).items()}


def relative_error(predictions: list[Prediction]) -> float:
    """Mean vector RMSE over that of the nominal estimate.

    Raises:
        ValueError: a prediction corrects no nominal estimate.
    """
    nominal = [p.nominal_error for p in predictions if p.nominal_error is not None]
    if len(nominal) != len(predictions):
        raise ValueError("only a network that corrects a nominal estimate can be compared with it")
    return _mean_rmse([p.error for p in predictions]) / _mean_rmse(nominal)


def _metrics(group: list[Prediction]) -> dict[str, float]:
    metrics = {"rollouts": float(len(group)), "rmse_vector_n": round(_mean_rmse([p.error for p in group]), 4)}
    nominal = [p.nominal_error for p in group if p.nominal_error is not None]
    if nominal:
        metrics["nominal_rmse_vector_n"] = round(_mean_rmse(nominal), 4)
    within = [np.abs(p.error) <= 2.0 * p.sigma for p in group if p.sigma is not None]
    if within:
        metrics["coverage_2sigma"] = round(float(np.concatenate(within).mean()), 4)
    return metrics


def _mean_rmse(errors: Sequence[np.ndarray]) -> float:
    return float(np.mean([vector_rmse(error) for error in errors]))
