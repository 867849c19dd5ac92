"""A trained force network at work: features of each step into a window, and its output into newtons."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from control.compiled import kernel
from control.estimation.networks.force_features import (
    SIGMA_DRIVERS,
    SIGMA_GROUPS,
    feature_columns,
    increment_columns,
    numbers,
    sigma_drivers,
)
from control.estimation.networks.residual_tcn import ResidualTcn, TcnShape
from control.records import packed, record
from control.small_algebra import clip

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


class SampleError(ValueError):
    """A step's features are not all finite; the message names some that are not."""


@kernel("b1(f8[::1], f8[::1], b1, f8[::1], f8[::1], f8[::1], f8[:,::1])")
def _take_in(
    newest: np.ndarray,
    before: np.ndarray,
    started: bool,
    increments: np.ndarray,
    mean: np.ndarray,
    inverse_std: np.ndarray,
    window: np.ndarray,
) -> bool:
    """Add a step to the window; False, and nothing changes, where it is not finite.

    Args:
        newest: (features,) of this step.
        before: (features,) of the step before, becomes `newest`.
        started: whether there was a step before; else this one fills the window.
        increments: (features,) 1 where the network sees the change from the step before, else 0.
        mean, inverse_std: (features,) of the normalisation.
        window: (H, features) normalised, oldest first.
    """
    steps, size = window.shape
    for i in range(size):
        if not math.isfinite(newest[i]):
            return False
    for t in range(steps - 1):
        for i in range(size):
            window[t, i] = window[t + 1, i]
    for i in range(size):
        last = before[i] if started else newest[i]
        value = (newest[i] - increments[i] * last - mean[i]) * inverse_std[i]
        value = clip(value, -NORMALIZED_LIMIT, NORMALIZED_LIMIT)
        for t in range(steps - 1 if started else 0, steps):
            window[t, i] = value
        before[i] = newest[i]
    return True


_NO_DRIVERS = np.zeros((1, SIGMA_DRIVERS))


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
        self._columns, self._sigma_columns = feature_columns(manifest.feature_groups), feature_columns(SIGMA_GROUPS)
        self._increments = increment_columns(manifest.feature_groups, manifest.increment_groups)
        self._window = np.zeros((manifest.shape.history, manifest.shape.inputs))
        self._before = np.zeros(manifest.shape.inputs)
        self._output = OutputScale(manifest)
        self.reset()

    def reset(self) -> None:
        """Forget the window."""
        self._started = False

    def step(self, signals: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Take in one step and evaluate.

        Args:
            signals: SIGNALS (1,) of this step.

        Returns:
            force (3,) N in heading, the whole one or a correction as the manifest says, and its standard deviation
            (3,) N, or None.

        Raises:
            SampleError: a feature is not finite; the window stays as it was, as if there had been no such step.
        """
        newest = numbers(signals)[0, self._columns]
        if not _take_in(newest, self._before, self._started, self._increments, self._mean, self._inverse_std, self._window):
            names = np.array(self.manifest.feature_names)[~np.isfinite(newest)]
            raise SampleError(f"not finite: {', '.join(names[:3])}{' and more' if len(names) > 3 else ''}")
        self._started = True
        raw = self._tcn.predict(self._window)[None]
        drivers = _NO_DRIVERS
        if self.manifest.sigma_scale is not None:
            mass_scales = numbers(signals)[:, self._sigma_columns]
            drivers = sigma_drivers(self._window[None], self._increments, mass_scales)
        force, sigma = self._output(raw, drivers)
        return force[0], None if sigma is None else sigma[0]


OUTPUT_SCALE = record(scale_n=(), limit_n=3, noise_n=(), sigma_scale=3, sigma_slopes=SIGMA_DRIVERS)
"""The numbers of a NetworkManifest that turn raw outputs into newtons."""


@kernel("void(Scale[::1], matrix, matrix, b1, f8[:,::1], f8[:,::1])", Scale=OUTPUT_SCALE)
def _scale_outputs(
    scale: np.ndarray, raw: np.ndarray, drivers: np.ndarray, gaussian: bool, force: np.ndarray, sigma: np.ndarray
) -> None:
    """f = clip(s y, +-limit), shrunk by f^2 / (f^2 + noise^2); sigma = s k exp(clip(log variance) / 2 + slopes . drivers).

    Args:
        raw: (n, outputs) y, and with `gaussian` the logarithms of its variances.
        drivers: (n, SIGMA_DRIVERS).
        force, sigma: (n, 3) N, the results; sigma only with `gaussian`.
    """
    k = scale[0]
    low, high = LOG_VARIANCE_RANGE
    for n in range(len(raw)):
        driven = k.sigma_slopes[0] * drivers[n, 0] + k.sigma_slopes[1] * drivers[n, 1]
        for i in range(3):
            value = clip(k.scale_n * raw[n, i], -k.limit_n[i], k.limit_n[i])
            power = value * value
            if k.noise_n > 0.0:
                value *= power / (power + k.noise_n * k.noise_n)
            force[n, i] = value
            if gaussian:
                sigma[n, i] = k.scale_n * k.sigma_scale[i] * math.exp(0.5 * clip(raw[n, 3 + i], low, high) + driven)


class OutputScale:
    """Newtons of a network's raw outputs, for one step or many."""

    def __init__(self, manifest: NetworkManifest) -> None:
        self._gaussian = manifest.sigma_scale is not None
        self._scale = packed(
            OUTPUT_SCALE,
            scale_n=manifest.output_scale_n,
            limit_n=manifest.output_limit_n,
            noise_n=manifest.output_noise_n,
            sigma_scale=manifest.sigma_scale or np.nan,
            sigma_slopes=manifest.sigma_slopes or 0.0,
        )

    def __call__(self, raw: np.ndarray, drivers: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Force (n, 3) N and standard deviation (n, 3) N, or None, of raw outputs (n, outputs).

        `drivers`: (n, SIGMA_DRIVERS) of `sigma_drivers`.
        """
        force, sigma = np.empty((len(raw), 3)), np.empty((len(raw), 3))
        _scale_outputs(self._scale, raw.astype(float), drivers, self._gaussian, force, sigma)
        return force, sigma if self._gaussian else None
