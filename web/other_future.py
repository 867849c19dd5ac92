"""What a simulation did before it was set back and went on otherwise, to be drawn beside what it does now."""

from collections import deque
from typing import NamedTuple

import numpy as np

KEPT_S = 60.0


class Seen(NamedTuple):
    """Of one drawn snapshot: where the robot was, and the force that was estimated."""

    time_s: float
    base_position: np.ndarray
    base_orientation_wxyz: np.ndarray
    joint_position: np.ndarray
    force_estimated_n: np.ndarray


class OtherFuture:
    """Remembers what was drawn; when the simulation is set back, what lay ahead is the other future.

    Attributes:
        samples: of it, in order of time; empty without one.
    """

    def __init__(self) -> None:
        self.samples: list[Seen] = []
        self._seen: deque[Seen] = deque()
        self._branch = 0

    def update(self, snapshot: np.void) -> None:
        """Take in a SNAPSHOT record."""
        time_s, branch = float(snapshot["time_s"]), int(snapshot["branch"])
        if branch != self._branch:
            self._branch = branch
            self.samples = [seen for seen in self._seen if seen.time_s > time_s]
            self._seen = deque(seen for seen in self._seen if seen.time_s <= time_s)
        if snapshot["past"]:
            return
        if self._seen and time_s < self._seen[-1].time_s:  # a reset, or another process
            self._seen.clear()
            self.samples = []
        if not self._seen or time_s > self._seen[-1].time_s:
            self._seen.append(_seen(snapshot))
        while time_s - self._seen[0].time_s > KEPT_S:
            self._seen.popleft()

    def at(self, time_s: float) -> Seen | None:
        """The last sample up to a time; None before the futures part, and where the other one ends."""
        if not self.samples or not self.samples[0].time_s <= time_s <= self.samples[-1].time_s:
            return None
        index = int(np.searchsorted([seen.time_s for seen in self.samples], time_s, side="right"))
        return self.samples[index - 1]

    def force_estimated_n(self, time_s: np.ndarray) -> np.ndarray:
        """Force (n, 3) N that was estimated at times (n,); NaN where there is no other future."""
        forces = np.full((len(time_s), 3), np.nan)
        if self.samples:
            times = np.array([seen.time_s for seen in self.samples])
            inside = (time_s >= times[0]) & (time_s <= times[-1])
            index = np.searchsorted(times, time_s[inside], side="right") - 1
            forces[inside] = np.array([seen.force_estimated_n for seen in self.samples])[index]
        return forces


def _seen(snapshot: np.void) -> Seen:
    fields = ("base_position", "base_orientation_wxyz", "joint_position", "force_estimated_n")
    return Seen(float(snapshot["time_s"]), *(snapshot[name].copy() for name in fields))
