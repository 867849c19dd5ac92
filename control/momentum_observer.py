"""Second-order generalized momentum observer, paper eqs. (5)-(9).

The momentum p = M v of eq. (5) obeys pdot = u + xi, eq. (6), with the known input u = S^T tau + Mdot v - h, eq. (7), and the
disturbance xi, the generalized force of all that the model leaves out. The observer

    d/dt p_hat = u + xi_hat + K1 (p - p_hat),   d/dt xi_hat = K2 (p - p_hat)

makes the residual r = xi_hat, eq. (9), follow xi through K2 / (s^2 + K1 s + K2) per row.
"""

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class ObserverGains:
    """Diagonal gains K1 = k1 I (1/s) and K2 = k2 I (1/s^2).

    Raises:
        ValueError: a gain is not positive and finite.
    """

    k1: float
    k2: float

    def __post_init__(self) -> None:
        for name, gain in (("k1", self.k1), ("k2", self.k2)):
            if not (gain > 0.0 and math.isfinite(gain)):
                raise ValueError(f"observer gain {name} must be positive and finite, got {gain}")

    @property
    def natural_frequency(self) -> float:
        """omega_n in rad/s."""
        return math.sqrt(self.k2)

    @property
    def damping_ratio(self) -> float:
        """zeta."""
        return self.k1 / (2.0 * math.sqrt(self.k2))


PAPER_GAINS = ObserverGains(6.0, 20.0)
"""The paper's K1 and K2: omega_n = sqrt(20) rad/s (0.71 Hz), zeta = 0.67."""

FAST_GAINS = ObserverGains(70.0, 2500.0)
"""omega_n = 50 rad/s: 28 ms of lag instead of 300; above, sensor noise grows faster than lag falls."""


class MomentumObserver:
    """Observer of the disturbance of one momentum vector, or of several input hypotheses about it at once.

    Attributes:
        residual: r, the estimate of xi; the next `step` replaces the array.
    """

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
        h = self._period_s
        self._gains = gains
        # Implicit Euler in closed form: both corrections use the error that remains after them, e / (1 + K1 h + K2 h^2), so
        # every positive gain is stable at every period.
        shared = 1.0 + gains.k1 * h + gains.k2 * h * h
        self._momentum_gain = (shared - 1.0) / shared
        self._residual_gain = gains.k2 * h / shared

    def reset(self) -> None:
        """Forget the state; the next step starts at equilibrium."""
        self._momentum_estimate: np.ndarray | None = None
        self.residual = np.zeros(0)

    def step(self, momentum: np.ndarray, momentum_input: np.ndarray) -> np.ndarray:
        """Advance one period.

        The first step starts at rest equilibrium, xi_hat = -u: what holds the robot up is then known from the first tick,
        instead of being found within a few time constants.

        Args:
            momentum: (n,) p at the end of the period.
            momentum_input: (n,) u over the period, or (k, n) for k hypotheses.

        Returns:
            r, of the shape of `momentum_input`.
        """
        if self._momentum_estimate is None:
            self._momentum_estimate = np.broadcast_to(momentum, momentum_input.shape).copy()
            self.residual = -momentum_input
            return self.residual
        predicted = momentum_input + self.residual
        predicted *= self._period_s
        predicted += self._momentum_estimate
        error = momentum - predicted
        self._momentum_estimate = predicted + self._momentum_gain * error
        self.residual = self.residual + self._residual_gain * error
        return self.residual
