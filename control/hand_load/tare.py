"""Tare: what a free hand reads becomes its zero."""

import math

import numpy as np

MEAN_S = 0.5
STILL_N = 1.0
LARGEST_N = 15.0


class TareError(RuntimeError):
    """The hand cannot be tared now; the message says why and what to do."""


class Tare:
    """Offsets of the estimators, and the mean of what the selected one reads of late."""

    STATE = ("offsets", "_elapsed_s", "_mean", "_variance")

    def __init__(self) -> None:
        self.offsets: dict[str, np.ndarray] = {}
        self.restart()

    def restart(self) -> None:
        """Forget what was read, but not the offsets."""
        self._elapsed_s = 0.0
        self._mean, self._variance = np.zeros(3), 0.0

    def clear(self) -> None:
        """Forget the offsets as well."""
        self.offsets.clear()
        self.restart()

    def observe(self, force_n: np.ndarray, dt_s: float) -> None:
        """Take in the estimate (3,), N, as it is without offset."""
        self._elapsed_s += dt_s
        weight = min(1.0, dt_s / min(MEAN_S, self._elapsed_s))
        change = force_n - self._mean
        self._mean = self._mean + weight * change
        self._variance += weight * (float(change @ change) - self._variance)

    def steady(self) -> np.ndarray | None:
        """Mean (3,), N, of the last half second, None where too little was read or it varies."""
        still = self._elapsed_s >= MEAN_S and math.sqrt(self._variance) <= STILL_N
        return self._mean if still else None

    def take(self, name: str) -> np.ndarray:
        """Make the mean of the last half second the zero of an estimator; the offset (3,), N, in heading.

        Raises:
            TareError: too little was read, it varies, or is more than a bias.
        """
        if self._elapsed_s < MEAN_S:
            raise TareError("the estimate has just begun; wait a second")
        spread, size = math.sqrt(self._variance), float(np.linalg.norm(self._mean))
        if spread > STILL_N:
            raise TareError(f"the force varies by {spread:.1f} N; let go of the hand and wait until it rests")
        if size > LARGEST_N:
            raise TareError(f"{size:.0f} N is more than a bias; free the hand, or set the tool that it carries")
        self.offsets[name] = self._mean.copy()
        return self._mean
