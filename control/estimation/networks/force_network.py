"""A trained force network at work: features of each step into a window, and its output into newtons."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from control.estimation.networks.force_features import SIGMA_GROUPS, Signals, features, increment_columns, sigma_drivers
from control.estimation.networks.residual_tcn import ResidualTcn, TcnShape

NORMALIZED_LIMIT = 6.0
"""Features are clipped at this many standard deviations, so that no input lies far from where the network was trained."""

LOG_VARIANCE_RANGE = (-8.0, 6.0)
"""Range of the network's logarithm of the variance, in squared units of the output scale."""

_NORMALIZATION = ("feature_mean", "feature_std")


@dataclass(frozen=True, slots=True)
class NetworkManifest:
    """What a weights file is.

    Attributes:
        name: of the estimator that uses it.
        nominal: estimator whose force the network corrects; None where it gives the whole force.
        feature_groups, feature_names: inputs, see control.estimation.networks.force_features.
        increment_groups: groups whose features are changes from the step before.
        shape: of the network.
        period_s: time between two steps.
        output_scale_n: N per unit of the network's force output.
        output_limit_n: (3,) largest force output, from the training set: more is not believed.
        output_noise_n: noise of the output, 0 to trust it all: an output c is shrunk by c^2 / (c^2 + noise^2), Wiener's gain,
            so that nothing is added where there is nothing to correct.
        sigma_scale: (3,) calibration of the standard deviation on the validation set; None where none is given.
        sigma_slopes: (SIGMA_DRIVERS,) change of the standard deviation's logarithm with each of `sigma_drivers`, from the same
            calibration; empty where there is none.
        sha256: of the npz file.
        training: command, commit, dataset, seed.
        metrics: measured on the validation set.
    """

    name: str
    nominal: str | None
    feature_groups: tuple[str, ...]
    increment_groups: tuple[str, ...]
    feature_names: tuple[str, ...]
    shape: TcnShape
    period_s: float
    output_scale_n: float
    output_limit_n: tuple[float, float, float]
    output_noise_n: float
    sigma_scale: tuple[float, float, float] | None
    sigma_slopes: tuple[float, ...] = ()
    sha256: str = ""
    training: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)


class ForceNetwork:
    """A trained network from signals to force: keeps the window of features.

    Before H steps have passed, the steps that are missing on the old side repeat the first one.
    """

    def __init__(self, manifest: NetworkManifest, arrays: dict[str, np.ndarray]) -> None:
        """`arrays`: parameters of the network, "feature_mean" and "feature_std".

        Raises:
            ValueError: an array is missing or has another shape than the manifest's.
        """
        self.manifest = manifest
        self._tcn = ResidualTcn(manifest.shape, arrays)
        for name in _NORMALIZATION:
            if name not in arrays or arrays[name].shape != (manifest.shape.inputs,):
                raise ValueError(f"array {name!r} of shape ({manifest.shape.inputs},) is missing")
        self._mean = arrays["feature_mean"].astype(float)
        self._inverse_std = 1.0 / arrays["feature_std"].astype(float)
        self._increments = increment_columns(manifest.feature_groups, manifest.increment_groups)
        self._window = np.zeros((manifest.shape.history, manifest.shape.inputs))
        self.reset()

    def reset(self) -> None:
        """Forget the window."""
        self._before: np.ndarray | None = None

    def step(self, signals: Signals) -> tuple[np.ndarray, np.ndarray | None]:
        """Take in one step and evaluate.

        Args:
            signals: of this step, (n,) each.

        Returns:
            force (3,) N in heading, the whole one or a correction as the manifest says, and its standard deviation
            (3,) N, or None.
        """
        newest = features(self.manifest.feature_groups, signals)
        before = newest if self._before is None else self._before
        normalized = (newest - self._increments * before - self._mean) * self._inverse_std
        np.minimum(normalized, NORMALIZED_LIMIT, out=normalized)
        np.maximum(normalized, -NORMALIZED_LIMIT, out=normalized)
        if self._before is None:
            self._window[:] = normalized
        else:
            self._window[:-1] = self._window[1:]
            self._window[-1] = normalized
        self._before = newest
        drivers = sigma_drivers(self._window, self._increments, features(SIGMA_GROUPS, signals))
        return scale_output(self._tcn.predict(self._window), drivers, self.manifest)


def scale_output(raw: np.ndarray, drivers: np.ndarray, manifest: NetworkManifest) -> tuple[np.ndarray, np.ndarray | None]:
    """Force (..., 3) N and standard deviation (..., 3) N, or None, of the network's raw output (..., outputs).

    `drivers`: (..., SIGMA_DRIVERS) of `sigma_drivers`.
    """
    scale, limit = manifest.output_scale_n, np.array(manifest.output_limit_n)
    force = np.minimum(np.maximum(scale * raw[..., :3].astype(float), -limit), limit)
    if manifest.output_noise_n > 0.0:
        power = force * force
        force *= power / (power + manifest.output_noise_n**2)
    if manifest.sigma_scale is None:
        return force, None
    low, high = LOG_VARIANCE_RANGE
    log_sigma = 0.5 * np.minimum(np.maximum(raw[..., 3:].astype(float), low), high)
    if manifest.sigma_slopes:
        log_sigma += (drivers @ np.array(manifest.sigma_slopes))[..., None]
    return force, scale * np.array(manifest.sigma_scale) * np.exp(log_sigma)
