"""Error of a force network on whole rollouts, and the calibration of its standard deviation."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from control.learning.rollout_data import SETTLE_STEPS, Rollout
from control.learning.targets import TrainingTarget
from control.learning.windows import WindowSet
from control.network_weights import NetworkManifest, scale_output

COVERAGE = 0.9545
"""Share of a normal distribution within two standard deviations."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """Of one rollout, settling steps left out.

    Attributes:
        error: (T, 3) N, estimate minus truth.
        nominal_error: (T, 3) N, of the nominal estimate alone; None where the network uses none.
        sigma: (T, 3) N, or None.
    """

    error: np.ndarray
    nominal_error: np.ndarray | None
    sigma: np.ndarray | None


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
    predictions = []
    for index, rollout in enumerate(rollouts):
        inputs, _, _ = windows.windows(torch.full_like(steps, index), steps)
        force, sigma = scale_output(module(inputs).numpy(), manifest)
        truth = rollout.force_true[steps]
        nominal_error = None
        error = force - truth
        if target.nominal is not None:
            nominal = rollout.arrays[f"{target.nominal}.force"][steps]
            nominal_error = nominal - truth
            error = error + nominal
        predictions.append(Prediction(error, nominal_error, sigma))
    return predictions


def mean_rmse(predictions: list[Prediction]) -> float:
    """Mean over rollouts of the vector RMSE, N."""
    return float(np.mean([vector_rmse(p.error) for p in predictions]))


def calibration_scale(predictions: list[Prediction]) -> tuple[float, float, float]:
    """Factor on sigma per axis that puts `COVERAGE` of the errors within two standard deviations.

    Raises:
        ValueError: a prediction has no sigma.
    """
    ratios = []
    for prediction in predictions:
        if prediction.sigma is None:
            raise ValueError("calibration needs predictions with sigma; train with the Gaussian likelihood")
        ratios.append(np.abs(prediction.error) / prediction.sigma)
    x, y, z = np.quantile(np.concatenate(ratios), COVERAGE, axis=0) / 2.0
    return float(x), float(y), float(z)


def cells(rollouts: list[Rollout], predictions: list[Prediction]) -> dict[str, dict[str, float]]:
    """Metrics by kind of rollout ("hold 0.8", "sine per-link", ...): mean RMSE with and without the network, coverage."""
    groups: dict[str, list[Prediction]] = {}
    for rollout, prediction in zip(rollouts, predictions, strict=True):
        info = rollout.info
        kind = "per-link" if info["per_link"] else f"{info['mass_scale']:.1f}"
        groups.setdefault(f"{info['profile']} {kind}", []).append(prediction)
    return {name: _metrics(group) for name, group in sorted(groups.items())}


def _metrics(group: list[Prediction]) -> dict[str, float]:
    metrics = {"rollouts": float(len(group)), "rmse_vector_n": round(mean_rmse(group), 3)}
    nominal = [p.nominal_error for p in group if p.nominal_error is not None]
    if nominal:
        metrics["nominal_rmse_vector_n"] = round(float(np.mean([vector_rmse(error) for error in nominal])), 3)
    within = [np.abs(p.error) <= 2.0 * p.sigma for p in group if p.sigma is not None]
    if within:
        metrics["coverage_2sigma"] = round(float(np.concatenate(within).mean()), 4)
    return metrics
