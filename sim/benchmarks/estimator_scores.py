"""What the error of a force estimator is called: RMSE as in the paper's table, lag alone, and calibration of sigma."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from control.estimation.momentum_observer import MomentumObserver, ObserverGains


@dataclass(frozen=True, slots=True)
class Scores:
    """One estimator over one rollout, sampled at 50 Hz.

    Attributes:
        error: (n, 3) N, estimate minus truth, in heading.
        sigma: (n, 3) N, NaN where the estimator gives none.
    """

    error: np.ndarray
    sigma: np.ndarray

    @property
    def rmse_axes_n(self) -> np.ndarray:
        """(3,) root mean square of the error per axis."""
        return np.sqrt((self.error**2).mean(axis=0))

    @property
    def rmse_vector_n(self) -> float:
        """Root mean square length of the error, the paper's e_vec."""
        return float(np.sqrt((self.error**2).sum(axis=1).mean()))


def coverage(scores: Sequence[Scores], sigmas: float) -> float | None:
    """Share of single-axis errors within `sigmas` of the estimator's own standard deviations; None where it gives none.

    A Gaussian error of the stated size gives 0.683 within one and 0.954 within two.
    """
    if not scores:
        return None
    inside = np.concatenate([np.abs(score.error) <= sigmas * score.sigma for score in scores])
    known = np.concatenate([np.isfinite(score.sigma) for score in scores])
    return float(inside[known].mean()) if known.any() else None


def coverage_error(scores: Sequence[Scores], sigmas: float) -> float | None:
    """Standard error of `coverage` over rollouts: robots differ, the samples of one do not. None of fewer than two."""
    shares = [share for score in scores if (share := coverage([score], sigmas)) is not None]
    return float(np.std(shares, ddof=1) / np.sqrt(len(shares))) if len(shares) > 1 else None


def mean_and_deviation(values: Sequence[float]) -> tuple[float, float | None]:
    """Mean and sample standard deviation over rollouts; no deviation of a single one."""
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else None


def lag_only_error(force: np.ndarray, gains: ObserverGains, period_s: float) -> np.ndarray:
    """Error (n, 3) N of an observer that is wrong in nothing but its lag.

    The observer's own transfer function, K2 / (s^2 + K1 s + K2) without K3, is applied to the true force: what is left after
    everything else is perfect. On a ramp it settles at -(K1 / K2) times the slope, and at zero with K3.

    Args:
        force: (n, 3) N, true, starting at zero.
        gains: K1, K2 and K3.
        period_s: between samples.
    """
    observer = MomentumObserver(gains, period_s)
    observed = np.empty_like(force)
    momentum, no_input = np.zeros(3), np.zeros(3)
    for index, disturbance in enumerate(force):
        momentum = momentum + period_s * disturbance
        observed[index] = observer.step(momentum, no_input)
    return observed - force
