"""Second-order generalized momentum observer, paper eqs. (3)-(8).

The momentum p = M v of eq. (3) obeys pdot = u + xi, eq. (4), with the known input u = S^T tau + Mdot v - h, eq. (5), and the
disturbance xi, the generalized force of all that the model leaves out. The observer

    d/dt p_hat = u + xi_hat + K1 (p - p_hat),   d/dt xi_hat = K2 (p - p_hat)

makes the residual r = xi_hat, eq. (8), follow xi through K2 / (s^2 + K1 s + K2) per row. It lags a ramp by K1 / K2.

A third state that estimates the slope of xi, with gain K3, takes that lag away:

    d/dt xi_hat = zeta_hat + K2 (p - p_hat),   d/dt zeta_hat = K3 (p - p_hat)

follows xi through (K2 s + K3) / (s^3 + K1 s^2 + K2 s + K3). With K3 = 0 it is the observer above.
"""

import math
from dataclasses import dataclass

import numpy as np

from control.kernels.compiled import kernel


@dataclass(frozen=True, slots=True)
class ObserverGains:
    """Diagonal gains K1 = k1 I (1/s), K2 = k2 I (1/s^2) and, to follow slopes, K3 = k3 I (1/s^3).

    Raises:
        ValueError: K1 or K2 is not positive and finite, or K3 not between 0 and K1 K2, where the observer is stable.
    """

    k1: float
    k2: float
    k3: float = 0.0

    def __post_init__(self) -> None:
        for name, gain in (("k1", self.k1), ("k2", self.k2)):
            if not (gain > 0.0 and math.isfinite(gain)):
                raise ValueError(f"observer gain {name} must be positive and finite, got {gain}")
        if not 0.0 <= self.k3 < self.k1 * self.k2:
            raise ValueError(f"observer gain k3 must be at least 0 and below k1 k2, got {self.k3}")

    def retuned(self, k1: float, k2: float) -> "ObserverGains":
        """Other K1 and K2, with K3 in the same ratio to their product.

        Raises:
            ValueError: a gain is not positive and finite.
        """
        return ObserverGains(k1, k2, self.k3 / (self.k1 * self.k2) * k1 * k2)

    def implicit(self, period_s: float) -> tuple[float, float, float]:
        """Gains on the error that remains after a step of implicit Euler: of momentum, residual and slope.

        All corrections use that error, so that stable gains stay stable at every period.
        """
        slope = self.k3 * period_s
        residual = (self.k2 + slope) * period_s
        momentum = (self.k1 + residual) * period_s
        shared = 1.0 + momentum
        return momentum / shared, residual / shared, slope / shared

    @property
    def natural_frequency(self) -> float:
        """omega_n in rad/s, of the observer without slope."""
        return math.sqrt(self.k2)

    @property
    def damping_ratio(self) -> float:
        """zeta, of the observer without slope."""
        return self.k1 / (2.0 * math.sqrt(self.k2))


PAPER_GAINS = ObserverGains(6.0, 20.0)
"""The paper's K1 and K2: omega_n = sqrt(20) rad/s (0.71 Hz), zeta = 0.67."""

FAST_GAINS = ObserverGains(70.0, 2500.0)
"""omega_n = 50 rad/s: 28 ms of lag instead of 300; above, sensor noise grows faster than lag falls."""

SLOPE_GAINS = ObserverGains(90.0, 2700.0, 27000.0)
"""Three poles at 30 rad/s: no lag behind a ramp, at the noise of FAST_GAINS. A step overshoots by a quarter."""


@kernel("b1(f8[::1], f8[:,::1], b1, f8, f8, f8, f8, f8[:,:,::1])")
def observe(
    momentum: np.ndarray,
    momentum_inputs: np.ndarray,
    started: bool,
    period_s: float,
    momentum_gain: float,
    residual_gain: float,
    slope_gain: float,
    state: np.ndarray,
) -> bool:
    """One period of the observer above, for k hypotheses about the input; whether all residuals are finite.

    The first step starts at rest equilibrium, xi_hat = -u: what holds the robot up is then known from the first tick,
    instead of being found within a few time constants.

    Args:
        momentum: (n,) p at the end of the period.
        momentum_inputs: (k, n) u over the period.
        started: whether `state` is the observer's already.
        period_s: s.
        momentum_gain, residual_gain, slope_gain: see `ObserverGains.implicit`.
        state: (3, k, n) p_hat, the residual xi_hat, and zeta_hat; changed to those at the end of the period.
    """
    total = 0.0
    for k in range(momentum_inputs.shape[0]):
        for i in range(len(momentum)):
            if started:
                foreseen = state[1, k, i] + period_s * state[2, k, i]
                predicted = state[0, k, i] + period_s * (momentum_inputs[k, i] + foreseen)
                error = momentum[i] - predicted
                state[0, k, i] = predicted + momentum_gain * error
                state[1, k, i] = foreseen + residual_gain * error
                state[2, k, i] += slope_gain * error
            else:
                state[0, k, i] = momentum[i]
                state[1, k, i] = -momentum_inputs[k, i]
                state[2, k, i] = 0.0
            total += state[1, k, i]
    return math.isfinite(total)


class MomentumObserver:
    """Observer of the disturbance of one momentum vector, or of several input hypotheses about it at once.

    Attributes:
        residual: r, the estimate of xi; the next `step` overwrites the array.
        finite: whether all of it is finite.
    """

    STATE = ("_state", "residual", "finite", "_gains", "_implicit_gains")

    def __init__(self, gains: ObserverGains, period_s: float) -> None:
        self._period_s = period_s
        self.gains = gains
        self.reset()

    @property
    def gains(self) -> ObserverGains:
        """May be changed at any time; the state carries over, so the residual stays continuous."""
        return self._gains

    @gains.setter
    def gains(self, gains: ObserverGains) -> None:
        self._gains = gains
        self._implicit_gains = gains.implicit(self._period_s)

    def reset(self) -> None:
        """Forget the state; the next step starts at equilibrium."""
        self._state: np.ndarray | None = None
        self.residual = np.zeros(0)
        self.finite = True

    def step(self, momentum: np.ndarray, momentum_input: np.ndarray) -> np.ndarray:
        """Advance one period, see `observe`.

        Args:
            momentum: (n,) p at the end of the period.
            momentum_input: (n,) u over the period, or (k, n) for k hypotheses.

        Returns:
            r, of the shape of `momentum_input`.
        """
        hypotheses = momentum_input.reshape(-1, len(momentum))
        started = self._state is not None
        if self._state is None:
            self._state = np.empty((3, *hypotheses.shape))
            self.residual = self._state[1].reshape(momentum_input.shape)
        self.finite = observe(momentum, hypotheses, started, self._period_s, *self._implicit_gains, self._state)
        return self.residual
