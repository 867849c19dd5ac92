"""Calibration of a network's standard deviation on validation: light and heavy robots, slow and fast forces covered alike."""

from collections.abc import Sequence

import numpy as np

from control.learning.evaluation import Prediction

COVERAGE = 0.9545
"""Share of a normal distribution within two standard deviations."""

_ITERATIONS = 40
_NEAR = 1e-3
"""Distance, in logarithm, from the quantile within which a sample no longer weighs more."""


def calibrate(predictions: Sequence[Prediction]) -> tuple[tuple[float, float, float], tuple[float, ...]]:
    """What puts `COVERAGE` of the errors within two standard deviations, whatever the drivers are.

    The quantile of log(|error| / 2 sigma) is fitted as a linear function of the drivers, with one constant per axis.

    Args:
        predictions: with the sigma that the network alone gives.

    Returns:
        Factor on sigma per axis; slope of its logarithm per driver.

    Raises:
        ValueError: a prediction has no sigma.
    """
    sigmas = [p.sigma for p in predictions if p.sigma is not None]
    if len(sigmas) != len(predictions):
        raise ValueError("calibration needs predictions with sigma; train with the Gaussian likelihood")
    ratio = np.concatenate([np.abs(p.error) / (2.0 * sigma) for p, sigma in zip(predictions, sigmas, strict=True)])
    ratio = np.log(np.maximum(ratio, 1e-9))
    drivers = np.concatenate([p.drivers for p in predictions])
    slopes = _quantile_slopes(ratio, drivers)
    x, y, z = np.exp(np.quantile(ratio - (drivers @ slopes)[:, None], COVERAGE, axis=0))
    return (float(x), float(y), float(z)), tuple(slopes.tolist())


def _quantile_slopes(values: np.ndarray, drivers: np.ndarray) -> np.ndarray:
    """(n,) slopes of the COVERAGE quantile of values (T, 3) over drivers (T, n), by reweighted least squares."""
    axes = np.repeat(np.eye(3), len(values), axis=0)
    design = np.hstack([axes, np.tile(drivers, (3, 1))])
    stacked = values.T.reshape(-1)
    weights = np.ones(len(stacked))
    solution = np.zeros(design.shape[1])
    for _ in range(_ITERATIONS):
        weighted = design * weights[:, None]
        # A driver that never varies is not told from the constants: the pseudo-inverse shares it out.
        solution = np.linalg.pinv(weighted.T @ design) @ (weighted.T @ stacked)
        residual = stacked - design @ solution
        weights = np.where(residual > 0.0, COVERAGE, 1.0 - COVERAGE) / np.maximum(np.abs(residual), _NEAR)
    return solution[3:]
