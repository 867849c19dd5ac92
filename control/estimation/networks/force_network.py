"""A trained force network at work: features of each step into a window, and its output into newtons."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from control.estimation.networks.force_features import (
    SIGMA_DRIVERS,
    SIGMA_GROUPS,
    feature_columns,
    increment_columns,
    numbers,
    sigma_drivers_of,
)
from control.estimation.networks.residual_tcn import ResidualTcn, TcnShape
from control.kernels.compiled import kernel
from control.kernels.records import packed, record
from control.kernels.small_algebra import clip

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


@kernel("b1(f8[::1], i8[::1], f8[::1], b1, f8[::1], f8[::1], f8[::1], f8[:,::1])")
def _take_in(
    signals: np.ndarray,
    columns: np.ndarray,
    before: np.ndarray,
    started: bool,
    increments: np.ndarray,
    mean: np.ndarray,
    inverse_std: np.ndarray,
    window: np.ndarray,
) -> bool:
    """Add a step to the window; False, and nothing changes, where it is not finite.

    Args:
        signals: (columns,) of this step, see `numbers`.
        columns: (features,) which of them the features are.
        before: (features,) of the step before, become those of this one.
        started: whether there was a step before; else this one fills the window.
        increments: (features,) 1 where the network sees the change from the step before, else 0.
        mean, inverse_std: (features,) of the normalisation.
        window: (H, features) normalised, oldest first.
    """
    steps, size = window.shape
    for i in range(size):
        if not math.isfinite(signals[columns[i]]):
            return False
    for t in range(steps - 1):
        for i in range(size):
            window[t, i] = window[t + 1, i]
    for i in range(size):
        newest = signals[columns[i]]
        last = before[i] if started else newest
        value = (newest - increments[i] * last - mean[i]) * inverse_std[i]
        value = clip(value, -NORMALIZED_LIMIT, NORMALIZED_LIMIT)
        for t in range(steps - 1 if started else 0, steps):
            window[t, i] = value
        before[i] = newest
    return True


OUTPUT_SCALE = record(scale_n=(), limit_n=3, noise_n=(), sigma_scale=3, sigma_slopes=SIGMA_DRIVERS)
"""The numbers of a NetworkManifest that turn raw outputs into newtons."""


@kernel("void(Scale, Array(f4, 1, 'A', readonly=True), f8, f8, b1, f8[:], f8[:])", Scale=OUTPUT_SCALE)
def _scale_output(
    scale: np.record, raw: np.ndarray, unlike: float, change: float, gaussian: bool, force: np.ndarray, sigma: np.ndarray
) -> None:
    """f = clip(s y, +-limit), shrunk by f^2 / (f^2 + noise^2); sigma = s k exp(clip(log variance) / 2 + slopes . drivers).

    Args:
        raw: (outputs,) y, and with `gaussian` the logarithms of its variances.
        unlike, change: of `sigma_drivers`.
        force, sigma: (3,) N, the results; sigma only with `gaussian`.
    """
    low, high = LOG_VARIANCE_RANGE
    driven = scale.sigma_slopes[0] * unlike + scale.sigma_slopes[1] * change
    for i in range(3):
        value = clip(scale.scale_n * raw[i], -scale.limit_n[i], scale.limit_n[i])
        power = value * value
        if scale.noise_n > 0.0:
            value *= power / (power + scale.noise_n * scale.noise_n)
        force[i] = value
        if gaussian:
            sigma[i] = scale.scale_n * scale.sigma_scale[i] * math.exp(0.5 * clip(raw[3 + i], low, high) + driven)


@kernel("void(Scale[::1], Array(f4, 2, 'A', readonly=True), matrix, b1, f8[:,::1], f8[:,::1])", Scale=OUTPUT_SCALE)
def _scale_outputs(
    scale: np.ndarray, raw: np.ndarray, drivers: np.ndarray, gaussian: bool, force: np.ndarray, sigma: np.ndarray
) -> None:
    """See `_scale_output`; of n steps each."""
    for n in range(len(raw)):
        _scale_output(scale[0], raw[n], drivers[n, 0], drivers[n, 1], gaussian, force[n], sigma[n])


@kernel("void(Scale[::1], f4[::1], f8[:,::1], f8[::1], f8[::1], i8[::1], b1, f8[::1], f8[::1])", Scale=OUTPUT_SCALE)
def _scale_newest(
    scale: np.ndarray,
    raw: np.ndarray,
    window: np.ndarray,
    increments: np.ndarray,
    signals: np.ndarray,
    mass_columns: np.ndarray,
    gaussian: bool,
    force: np.ndarray,
    sigma: np.ndarray,
) -> None:
    """See `_scale_output`; with the drivers of a window (H, features) and of the mass scales among `signals` (columns,)."""
    unlike, change = 0.0, 0.0
    if gaussian:
        arm, rest = float(signals[mass_columns[0]]), float(signals[mass_columns[1]])
        unlike, change = sigma_drivers_of(window, increments, arm, rest)
    _scale_output(scale[0], raw, unlike, change, gaussian, force, sigma)


def output_record(manifest: NetworkManifest) -> np.ndarray:
    """OUTPUT_SCALE (1,) of a manifest."""
    return packed(
        OUTPUT_SCALE,
        scale_n=manifest.output_scale_n,
        limit_n=manifest.output_limit_n,
        noise_n=manifest.output_noise_n,
        sigma_scale=manifest.sigma_scale or np.nan,
        sigma_slopes=manifest.sigma_slopes or 0.0,
    )


def scale_outputs(raw: np.ndarray, drivers: np.ndarray, manifest: NetworkManifest) -> tuple[np.ndarray, np.ndarray | None]:
    """Force (n, 3) N and standard deviation (n, 3) N, or None, of a network's raw outputs (n, outputs), float32.

    `drivers`: (n, SIGMA_DRIVERS) of `sigma_drivers`.
    """
    force, sigma = np.empty((len(raw), 3)), np.empty((len(raw), 3))
    gaussian = manifest.sigma_scale is not None
    _scale_outputs(output_record(manifest), raw, drivers, gaussian, force, sigma)
    return force, sigma if gaussian else None


class ForceNetwork:
    """A trained network from signals to force: keeps the window of features.

    Before H steps have passed, the steps that are missing on the old side repeat the first one.
    """

    STATE = ("_window", "_before", "_started")

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
        self._gaussian = manifest.sigma_scale is not None
        self._output = output_record(manifest)
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
        flat = numbers(signals)
        window, increments = self._window, self._increments
        if not _take_in(flat, self._columns, self._before, self._started, increments, self._mean, self._inverse_std, window):
            broken = ~np.isfinite(flat[self._columns])
            names = [name for name, is_broken in zip(self.manifest.feature_names, broken, strict=True) if is_broken]
            raise SampleError(f"not finite: {', '.join(names[:3])}{' and more' if len(names) > 3 else ''}")
        self._started = True
        raw = self._tcn.predict(window)
        force, sigma = np.empty(3), np.empty(3)
        _scale_newest(self._output, raw, window, increments, flat, self._sigma_columns, self._gaussian, force, sigma)
        return force, sigma if self._gaussian else None
