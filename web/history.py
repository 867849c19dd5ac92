"""The last seconds of some values, evenly sampled, for charts."""

import numpy as np


class History:
    """Rows of values over a window that ends now.

    Attributes:
        values: (n, columns), oldest first; NaN where nothing was sampled.
    """

    def __init__(self, columns: int, window_s: float, period_s: float) -> None:
        self._window_s = window_s
        self._period_s = period_s
        count = round(window_s / period_s)
        self._time_s = np.full(count, np.nan)
        self.values = np.full((count, columns), np.nan)

    def append(self, time_s: float, values: np.ndarray) -> bool:
        """Add values (columns,) when the next sample is due. A clock that is set back takes what was later away."""
        if 0.0 < self._time_s[-1] - time_s < self._window_s:
            while self._time_s[-1] > time_s - self._period_s:
                self._time_s[1:], self.values[1:] = self._time_s[:-1].copy(), self.values[:-1].copy()
                self._time_s[0], self.values[0] = self._time_s[1] - self._period_s, np.nan
        elapsed = time_s - self._time_s[-1]
        if 0.0 <= elapsed < self._period_s:
            return False
        if not 0.0 <= elapsed < self._window_s:
            self.values[:] = np.nan
            self._time_s = time_s - self._period_s * np.arange(len(self._time_s), 0.0, -1.0)
        self._time_s[:-1], self.values[:-1] = self._time_s[1:].copy(), self.values[1:].copy()
        self._time_s[-1], self.values[-1] = time_s, values
        return True

    @property
    def time_s(self) -> np.ndarray:
        """(n,) of the samples; NaN before the first."""
        return self._time_s

    @property
    def age_s(self) -> np.ndarray:
        """(n,) negative, zero for the newest; NaN before the first sample."""
        return self._time_s - self._time_s[-1]

    def largest(self) -> float:
        """Largest absolute value; zero when there is none."""
        sizes = np.abs(self.values)
        return float(sizes[np.isfinite(sizes)].max(initial=0.0))
